"""The sketch of a rig, to be drawn over it: the ways of the light, the lost part of the picture,
the aerial plane, distances. Lines and words as plain data; lengths in m, places in the world.

An incomplete rig, or one that cannot be solved, is sketched as far as it goes: without a plan there
is no light.
"""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from ..base.steps import Pauses
from ..base.vectors import length_of
from ..light.landings import REASON_WORDS, Reason, main_landings
from ..light.light_paths import NOTHING, Tails, Way, following
from ..light.plan import Plan
from ..light.trace import tracing
from ..rig.rig import Rig
from .canvas import CORNERS, MIDDLE, Canvas, canvas_of, outline_of, sight_lines
from .hatching import grid, hatched
from .stations import Dimension, Station, dimensions_between, is_placed, mirrored, stations_of

State = Literal["arrives", "lost", "aerial", "picture"]

TAIL = 0.06  # of the rig's size: so far light that leaves to nowhere is drawn
REACH = 0.5  # of it: so far off the plate or the display may be passed by
LEAST_LOST = 0.005  # of the picture: a smaller part of it that is lost gets no words
OUT_OF_VIEW = Message("outside the viewer's frame")
AERIAL = Message("aerial plane")


class Line(NamedTuple):
    """Joined points (k, 3), and the meaning of their colour."""

    points: Floats
    state: State


class Note(NamedTuple):
    """Words at a place (3,)."""

    place: Floats
    text: str
    state: State


@dataclass(frozen=True, eq=False)
class Light:
    """The light of a picture.

    ways : of its corners, from the lower left on against the clock, and of its middle, without
        those that are behind the viewer
    notes : the reasons why some of it is lost, each at its place
    hatch : (h, 2, 3) lines on the part of the picture that is lost
    """

    ways: tuple[Way, ...] = ()
    notes: tuple[Note, ...] = ()
    hatch: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(frozen=True, eq=False)
class Sketch:
    """All that is drawn of a rig.

    lines : the light's ways, the outlines of picture and aerial plane
    """

    light: Light = field(default_factory=Light)
    lines: tuple[Line, ...] = ()
    notes: tuple[Note, ...] = ()
    dimensions: tuple[Dimension, ...] = ()


def sketching(rig: Rig, plan: Plan | None) -> Pauses[Sketch]:
    """Sketch a rig, by a few rays where there is a plan of it."""
    glasses = [glass.mesh.bounds for glass in rig.glasses if is_placed(glass.mesh)]
    middle = np.mean(glasses, axis=(0, 1)) if glasses else np.zeros(3)
    viewer = rig.viewers[0] if rig.viewers else None
    canvas = canvas_of(rig.picture_place, viewer, middle) if rig.pictures else None

    light = Light()
    if plan is not None and canvas is not None:
        light = yield from _following_picture(plan, canvas)

    # a way that has arrived tells the plates between picture and display; best the middle's
    chief = next((way for way in reversed(light.ways) if way.has_arrived), None)
    stations = stations_of(rig, plan, chief)
    aerial = _aerial_plane(rig, stations)
    lines = [Line(way.points, "arrives" if way.has_arrived else "lost") for way in light.ways]
    lines += [Line(edge, "aerial") for edge in aerial]
    if canvas is not None:
        lines += [Line(edge, "picture") for edge in outline_of(canvas.corners)]

    notes = list(light.notes)
    if len(aerial):
        ends = aerial.reshape(-1, 3)
        notes.append(Note(ends[np.argmax(ends[:, 2])], AERIAL, "aerial"))

    return Sketch(
        light=light,
        lines=tuple(line for line in lines if np.isfinite(line.points).all()),
        notes=tuple(note for note in notes if np.isfinite(note.place).all()),
        dimensions=dimensions_between(stations),
    )


def _aerial_plane(rig: Rig, stations: list[Station]) -> Floats:
    """The edges (e, 2, 3) of the display where it seems to stand, seen by way of the plates."""
    nowhere = np.empty((0, 2, 3))
    if len(rig.displays) != 1 or not is_placed(rig.display.mesh):
        return nowhere
    seen = mirrored(outline_of(rig.display.mesh.corners), stations)
    return nowhere if seen is None else seen


def _following_picture(plan: Plan, canvas: Canvas) -> Pauses[Light]:
    """Follow the light of a picture: of its corners and its middle, and of parts all over it."""
    extent = [part.mesh.bounds for part in (*plan.rig.glasses, *plan.rig.plates, plan.rig.display)]
    size = float(np.linalg.norm(np.ptp(np.concatenate(extent), axis=0)))
    tails = Tails(tail=TAIL * size, reach=REACH * size)

    # corners and middle
    points, _ = canvas.points(np.concatenate([CORNERS, MIDDLE]))
    origins, directions, aims, is_seen = sight_lines(plan.viewer, points)
    ways = yield from following(plan, origins, directions, aims, tails)
    marks = [
        (way, REASON_WORDS.get(way.reason, ""))
        if is_seen[i]
        else (_up_to(origins[i], points[i]), OUT_OF_VIEW)
        for i, way in enumerate(ways)
        if np.isfinite(aims[i])
    ]
    notes = [Note(way.points[-1], words, "lost") for way, words in marks if words]

    # the parts that are lost
    points, is_on = canvas.points(grid())
    origins, directions, _, is_seen = sight_lines(plan.viewer, points)
    found = yield from tracing(plan, origins, directions)
    reason = main_landings(found, len(points)).reason
    is_lost = is_on & ~(is_seen & (reason == Reason.ARRIVED))
    words = np.array([REASON_WORDS.get(Reason(int(r)), "") for r in reason], object)
    words[~is_seen] = OUT_OF_VIEW
    told = {note.text for note in notes}
    notes += _notes_on_parts(points, words, is_lost, told)

    ends, _ = canvas.points(hatched(is_lost, canvas.size).reshape(-1, 2))
    return Light(tuple(way for way, _ in marks), tuple(notes), ends.reshape(-1, 2, 3))


def _up_to(origin: Floats, point: Floats) -> Way:
    """A straight way that is not followed any further."""
    return Way(np.stack([origin, point]), np.full(2, NOTHING), Reason.MISSED_GLASS)


def _notes_on_parts(points: Floats, words: Ints, is_lost: Bools, told: set[str]) -> list[Note]:
    """A note on each reason for which parts of the picture, at points (n, 3), are lost, unless
    it is told already: at the part nearest to the middle of these.
    """
    notes = []
    for text in sorted(set(words[is_lost]) - told):
        some = points[is_lost & (words == text)]
        if len(some) >= LEAST_LOST * len(points):
            nearest = np.argmin(length_of(some - some.mean(axis=0)))
            notes.append(Note(some[nearest], text, "lost"))
    return notes
