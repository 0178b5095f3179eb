"""The sketch of a rig, to be drawn over it: light paths, the lost part of the picture, the aerial
plane, distances. Lines and words as plain data; lengths in m, places in the world.

An incomplete rig, or one that cannot be solved, is sketched as far as possible: without a plan
there is no light. A picture in the viewer's own pixels has no place of its own; it is drawn across
the view, as far away as the glass.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from ..base.steps import Steps
from ..base.vectors import length_of, normalise
from ..light.display import affine_fit, uv_area
from ..light.light_paths import NOTHING, LightPath, Tails, following
from ..light.optics import reflect
from ..light.plan import Plan
from ..light.rays import REASON_WORDS, Reason, main_landings
from ..light.trace import tracing
from ..rig.rig import Kind, Mesh, PicturePlace, Rig, Viewer

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
MIDDLE = np.array([[0.5, 0.5]])
SPLIT = np.array([[0, 1, 2], [0, 2, 3]])
RECTANGLE = 1e-6  # of its size: how flat, affine and whole a picture is that counts as a rectangle
OFF_TRIANGLE = 1e-9  # barycentric: a place so far beyond all triangles is still on the picture


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture's triangles in space, with the place of each of their corners on the image.

    corners : (t, 3, 3) m, world
    uv : (t, 3, 2) on the picture, 0..1 over all of it, v upward
    """

    corners: Floats
    uv: Floats

    def points(self, places: Floats) -> tuple[Floats, Bools]:
        """Points (n, 3) m of places (n, 2) on the image, and are they on the picture (n,)?

        Beyond the picture's triangles the point is the nearest one's at that place.
        """
        best = np.full(len(places), -np.inf)
        points = np.full((len(places), 3), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            for corners, uv in zip(self.corners, self.uv, strict=True):
                weights = _weights(places, uv)
                inside = weights.min(axis=1)
                is_better = inside > best
                best[is_better] = inside[is_better]
                points[is_better] = weights[is_better] @ corners
        return points, best >= -OFF_TRIANGLE

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m, along its lower and its left edge."""
        points, _ = self.points(CORNERS)
        return float(length_of(points[1] - points[0])), float(length_of(points[3] - points[0]))


def _weights(places: Floats, uv: Floats) -> Floats:
    """Barycentric weights (n, 3) of places (n, 2) in a triangle (3, 2); not finite without area."""
    a, b = uv[1] - uv[0], uv[2] - uv[0]
    p = places - uv[0]
    area = a[0] * b[1] - a[1] * b[0]
    u = (p[:, 0] * b[1] - p[:, 1] * b[0]) / area
    v = (a[0] * p[:, 1] - a[1] * p[:, 0]) / area
    return np.stack([1 - u - v, u, v], axis=1)


def canvas_of(picture: PicturePlace, viewer: Viewer | None, towards: Floats) -> Canvas | None:
    """The canvas of a picture; None where it stands nowhere.

    Parameters
    ----------
    towards : (3,) m, the middle of the glass, by which a picture in the viewer's pixels stands
    """
    if picture.mesh is not None:
        return _of_mesh(picture.mesh)
    if viewer is None:
        return None

    forward = viewer.axes[2]
    size = np.array([viewer.width, viewer.height])
    origins, directions = viewer.rays(np.abs(CORNERS - [0, 1]) * size)
    depth = float((towards - viewer.position) @ forward)
    if not depth > 0:
        return None

    corners = origins + (depth / (directions @ forward))[:, None] * directions
    return Canvas(corners[SPLIT], CORNERS[SPLIT])


def _of_mesh(mesh: Mesh) -> Canvas | None:
    """A mesh whose UV map is stretched over the whole image's square."""
    if mesh.uv is None or not len(mesh.triangles):
        return None
    flat = mesh.uv.reshape(-1, 2)
    low = flat.min(axis=0)
    extent = flat.max(axis=0) - low
    if not (np.isfinite(mesh.corners).all() and np.isfinite(extent).all() and extent.all()):
        return None

    canvas = Canvas(mesh.corners, (mesh.uv - low) / extent)
    return _as_rectangle(canvas) if len(mesh.triangles) > 2 else canvas


def _as_rectangle(canvas: Canvas) -> Canvas:
    """A flat rectangle of many triangles as one of two, in which places
    are found quickly; any other canvas as it is.
    """
    corners = canvas.corners.reshape(-1, 3)
    fit, missed = affine_fit(canvas.uv.reshape(-1, 2), corners)
    is_flat = missed <= RECTANGLE * np.ptp(corners, axis=0).max()
    if not (is_flat and abs(uv_area(canvas.uv) - 1) <= RECTANGLE):
        return canvas
    ends = np.column_stack([CORNERS, np.ones(4)]) @ fit
    return Canvas(ends[SPLIT], CORNERS[SPLIT])


def sight_lines(viewer: Viewer, points: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """Rays from a viewer to points (n, 3) m: origins, directions, distances (n,), and are
    the points within its image (n,)?

    Those of points behind it run along its axis.
    """
    xy = viewer.project(points)
    size = np.array([viewer.width, viewer.height])
    slack = OFF_TRIANGLE * size
    with np.errstate(invalid="ignore"):
        is_seen = ((xy >= -slack) & (xy <= size + slack)).all(axis=1)

    origins, directions = viewer.rays(np.where(np.isfinite(xy), xy, size / 2))
    distances = np.einsum("ni,ni->n", points - origins, directions)
    return origins, directions, np.where(np.isfinite(xy).all(axis=1), distances, np.nan), is_seen


def outline_of(corners: Floats) -> Floats:
    """The edges (e, 2, 3) of triangles (t, 3, 3) that no other of them shares."""
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    # the same number for the same place, whichever triangle has it
    _, place = np.unique(edges.reshape(-1, 3), axis=0, return_inverse=True)
    ends = np.sort(place.reshape(-1, 2), axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return edges[count[number.ravel()] == 1]


@dataclass(frozen=True)
class Hatch:
    """How a lost part is found and hatched. Looked at in Blender, on pictures from 10 to 1000 px.

    n_grid : rays each way, spread over the picture; each stands for the part around it
    n_lines : hatch lines that cross a picture as wide as high from corner to corner
    n_looks : places at which each line is asked whether it is on a lost part, for each ray it
        passes by
    """

    n_grid: int = 40
    n_lines: int = 36
    n_looks: int = 4


HATCH = Hatch()


def grid() -> Floats:
    """Places (n n, 2) on the picture, 0..1, row by row from below: the middles of its parts."""
    middles = (np.arange(HATCH.n_grid) + 0.5) / HATCH.n_grid
    u, v = np.meshgrid(middles, middles)
    return np.stack([u.ravel(), v.ravel()], axis=1)


def hatched(is_lost: Bools, size: tuple[float, float]) -> Floats:
    """Hatch lines (l, 2, 2) on the lost part, by the places of their ends on the picture, 0..1.

    Parameters
    ----------
    is_lost : (n n,) of the parts around `grid`
    size : width and height of the picture, m, so that lines rise at 45 degrees
    """
    if not (is_lost.any() and min(size) > 0):
        return np.empty((0, 2, 2))
    width, height = np.array(size) / max(size)

    # lines y = x + c on a picture of this width and height
    step = 2 / HATCH.n_lines
    offsets = np.arange(-width + step / 2, height, step)
    lines = [_on_line(is_lost, offset, width, height) for offset in offsets]
    return np.concatenate(lines)


def _on_line(is_lost: Bools, offset: float, width: float, height: float) -> Floats:
    """The pieces (l, 2, 2) of one line y = x + offset that lie on lost parts."""
    start = max(0.0, -offset)
    stop = min(width, height - offset)
    n_looks = max(1, round((stop - start) * HATCH.n_grid * HATCH.n_looks / min(width, height)))
    ends = np.linspace(start, stop, n_looks + 1)
    middles = (ends[1:] + ends[:-1]) / 2
    places = np.stack([middles / width, (middles + offset) / height], axis=1)

    # where it goes onto lost parts, and off them
    on = np.concatenate([[False], is_lost[_part_at(places)], [False]])
    first = ends[np.flatnonzero(on[1:] & ~on[:-1])]
    last = ends[np.flatnonzero(on[:-1] & ~on[1:])]
    x = np.stack([first, last], axis=1)
    return np.stack([x / width, (x + offset) / height], axis=2)


def _part_at(places: Floats) -> Ints:
    """The number (n,) of the part of the picture at places (n, 2)."""
    column, row = np.clip(places * HATCH.n_grid, 0, HATCH.n_grid - 1).astype(np.int64).T
    return row * HATCH.n_grid + column


BESIDE = 1.2  # of half the glass's width: so far beside the middle dimension lines run
LEAST_TURN = 1e-6  # sine of the angle between two lines that count as one


class Station(NamedTuple):
    """A part that stands in the light's way: its mesh, and the
    place (3,), m, from which its distance to others is told.
    """

    kind: Kind
    mesh: Mesh
    place: Floats


@dataclass(frozen=True, eq=False)
class Dimension:
    """A distance: between two places (3,), m, drawn `beside` (3,) the line between them."""

    start: Floats
    end: Floats
    beside: Floats

    @property
    def length(self) -> float:
        """Metres from the one to the other."""
        return float(np.linalg.norm(self.end - self.start))


def stations_of(rig: Rig, plan: Plan | None, way: LightPath | None) -> list[Station]:
    """The stations of a rig: the glass that light leaves last, plates and mirrors, the display.

    way : of light that has arrived, best of the picture's middle, by which they and their places
        are told: half way through the glass, and where light meets the others. Without it the rig
        is taken to have one glass and one plate; where it has several, none of them stands there.
        Their places are their middles
    """
    by_kind = {
        Kind.GLASS: rig.glasses,
        Kind.PLATE: rig.plates,
        Kind.MIRROR: rig.mirrors,
        Kind.DISPLAY: rig.displays,
    }
    if plan is None or way is None:
        single = [
            kind for kind in (Kind.GLASS, Kind.PLATE, Kind.DISPLAY) if len(by_kind[kind]) == 1
        ]
        meshes = [by_kind[kind][0].mesh for kind in single]
        return [
            Station(kind, mesh, mesh.bounds.mean(axis=0))
            for kind, mesh in zip(single, meshes, strict=True)
            if is_placed(mesh)
        ]

    met = [int(part) for part in way.parts if part >= 0]
    kinds = [Kind(plan.parts.kind[part]) for part in met]
    places = way.points[way.parts >= 0]
    last_glass = max((k for k, kind in enumerate(kinds) if kind == Kind.GLASS), default=0)

    stations = []
    for k, (part, kind) in enumerate(zip(met, kinds, strict=True)):
        if k < last_glass or kind not in by_kind:
            continue
        place = places[k]
        if kind == Kind.GLASS:
            place = (places[met.index(part)] + place) / 2
        stations.append(Station(kind, by_kind[kind][_number(plan, part, kind)].mesh, place))
    return stations


def is_placed(mesh: Mesh) -> bool:
    """Does a mesh stand somewhere?"""
    return len(mesh.triangles) > 0 and bool(np.isfinite(mesh.bounds).all())


def _number(plan: Plan, part: int, kind: Kind) -> int:
    """The number of a plan's part among the rig's parts of its kind."""
    if kind == Kind.GLASS:
        return int(plan.parts.owner[part])
    return int((plan.parts.kind[:part] == kind).sum())


def mirrored(points: Floats, stations: list[Station]) -> Floats | None:
    """Where points (..., 3) of the display seem to stand, seen by way of all plates and mirrors
    between; None where one of these is bent, or where there is none.
    """
    between = [s for s in stations if s.kind in {Kind.PLATE, Kind.MIRROR}]
    if not between or any(not station.mesh.is_flat for station in between):
        return None

    for station in reversed(between):
        corners = station.mesh.corners
        sides = corners[:, 1:] - corners[:, :1]
        across = np.cross(sides[:, 0], sides[:, 1])
        normal = normalise(across[np.argmax(length_of(across))])
        points = station.place + reflect(points - station.place, normal)
    return points


def dimensions_between(stations: list[Station]) -> tuple[Dimension, ...]:
    """The distances from station to station, all drawn beside
    the light's way, as far as clears the glass.
    """
    glass = next((s.mesh for s in stations if s.kind == Kind.GLASS), None)
    pairs = list(pairwise(station.place for station in stations))
    if not pairs:
        return ()

    # out of the plane in which the light turns, or else level
    lines = [end - start for start, end in pairs]
    across = np.cross(lines[0], lines[-1])
    if np.linalg.norm(across) <= LEAST_TURN * np.linalg.norm(lines[0]) * np.linalg.norm(lines[-1]):
        across = np.cross(lines[0], [0.0, 0.0, 1.0])
    if np.linalg.norm(across) <= LEAST_TURN * np.linalg.norm(lines[0]):
        across = np.array([1.0, 0.0, 0.0])
    across = normalise(across)

    reach = 0.1 * np.linalg.norm(lines[0])
    if glass is not None:
        reach = BESIDE * np.ptp(glass.vertices[np.unique(glass.triangles)] @ across) / 2
    return tuple(Dimension(start, end, reach * across) for start, end in pairs)


State = Literal["arrives", "lost", "aerial", "picture"]

TAIL = 0.06  # of the rig's size: so far light that leaves to nowhere is drawn
REACH = 0.5  # of it: so far off the plate or the display may be passed by
LEAST_LOST = 0.005  # of the picture: a smaller part of it that is lost gets no words
OUT_OF_VIEW = Message("outside the viewer's frame")
AERIAL = Message("mid-air image of the display")


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
class SketchedLight:
    """The light of a picture.

    ways : of its corners, from the lower left on against the clock, and of its middle, without
        those that are behind the viewer
    notes : the reasons why some of it is lost, each at its place
    hatch : (h, 2, 3) lines on the part of the picture that is lost
    """

    ways: tuple[LightPath, ...] = ()
    notes: tuple[Note, ...] = ()
    hatch: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(frozen=True, eq=False)
class Sketch:
    """All that is drawn of a rig.

    lines : the light's ways, the outlines of picture and aerial plane
    """

    light: SketchedLight = field(default_factory=SketchedLight)
    lines: tuple[Line, ...] = ()
    notes: tuple[Note, ...] = ()
    dimensions: tuple[Dimension, ...] = ()


def sketching(rig: Rig, plan: Plan | None) -> Steps[Sketch]:
    """Sketch a rig, by a few rays where there is a plan of it."""
    glasses = [glass.mesh.bounds for glass in rig.glasses if is_placed(glass.mesh)]
    middle = np.mean(glasses, axis=(0, 1)) if glasses else np.zeros(3)
    viewer = rig.viewers[0] if rig.viewers else None
    canvas = canvas_of(rig.picture_place, viewer, middle) if rig.pictures else None

    light = SketchedLight()
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


def _following_picture(plan: Plan, canvas: Canvas) -> Steps[SketchedLight]:
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
    return SketchedLight(tuple(way for way, _ in marks), tuple(notes), ends.reshape(-1, 2, 3))


def _up_to(origin: Floats, point: Floats) -> LightPath:
    """A straight way that is not followed any further."""
    return LightPath(np.stack([origin, point]), np.full(2, NOTHING), Reason.MISSED_GLASS)


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
