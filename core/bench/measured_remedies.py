"""Remedies for lost or illegible light, with their measured gains, for the checklist.

Each remedy is found as by its own button, with fewer rays. Only remedies that bring something back
are reported, each with its operator. One of them moves the picture to the glass, and the display
with it: bent light spreads less on a shorter way. For one viewer the picture's depth changes
nothing, but the display's does; both stay images of each other in the plate.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.messages import Message
from ..base.steps import subprogress
from ..base.words import percent
from ..glass.meshes import geometric_normals
from ..glass.smoothed import smoothed
from ..light.mesh_cache import MeshCache
from ..light.optics import reflect
from ..light.rays import REASON_WORDS, Reason
from ..rig.rig import Display, PicturePlace, Rig
from ..rig.settings import Settings
from ..solve.legibility import READABLE, card_legibility
from .best_place import Limits, best_place
from .part_sizes import Fitted, Wanted, fit_display, fit_picture, fit_plate, plane_of
from .picture_light import PlanOf, traced


class Shifts(NamedTuple):
    """Of the picture and the display (3,), m."""

    picture: Floats
    display: Floats


def way_to_glass(rig: Rig) -> float:
    """The way of the picture along its axis towards the first viewer, m: from behind the glass to
    its back, or with a plate, from within to its face. 0 if there is none.
    """
    try:
        middle, axis = plane_of(rig).middle, _axis(rig)
    except RigError:  # it has no place
        return 0.0
    if rig.mirrors or len(rig.plates) > 1:  # the display is on a way of its own
        return 0.0
    ahead = np.concatenate([(glass.mesh.vertices - middle) @ axis for glass in rig.glasses])
    back, face = float(ahead.min()), float(ahead.max())
    if back > 0:
        return back
    return max(face, 0.0) if rig.plates else 0.0


def shifts_by(rig: Rig, way: float) -> Shifts:
    """The shifts of picture and display for a way of the picture towards the first viewer, m."""
    shift = way * _axis(rig)
    if not rig.plates:
        return Shifts(shift, shift)
    normal = geometric_normals(rig.plates[0].mesh.corners)[0]
    return Shifts(shift, reflect(shift, normal))


def nearer(rig: Rig, way: float) -> Rig:
    """The rig with its picture so much nearer to the first viewer, m."""
    shifts = shifts_by(rig, way)
    return replace(
        rig,
        pictures=(_moved(rig.pictures[0], shifts.picture),),
        displays=(_moved(rig.display, shifts.display),),
    )


def _axis(rig: Rig) -> Floats:
    """The direction (3,) perpendicular to the picture, towards the first viewer."""
    plane = plane_of(rig)
    axis = np.cross(*plane.sides)
    axis /= np.linalg.norm(axis)
    return axis * np.sign(axis @ (rig.viewers[0].position - plane.middle))


def _moved(part: PicturePlace | Display, shift: Floats) -> PicturePlace | Display:
    return replace(part, mesh=replace(part.mesh, vertices=part.mesh.vertices + shift))


N_GRID = 32  # points along each edge of a triangle of the picture
WORTH_IT = 1e-3  # share of the picture that a remedy has to bring back
REACH = 0.5  # of the picture's longer side: so far it may move
# a part that had to be larger than so many times would have to bring back so much of what misses it
LARGE, MUCH = 2.0, 0.5
TOLD = 5e-3  # share of the picture: more that is lost all the same is told
SMOOTH_GLASS, MOVE_TO_GLASS = "kiriko.smooth_glass", "kiriko.move_to_glass"
ITERATIONS = (10, 100)  # of Smooth
WORTH_READING = 0.1  # of legibility


@dataclass(frozen=True)
class Help:
    """A remedy.

    operator : the button that does it
    amount : m, by which plate or display have to be larger, or the width that the picture then
        has, or its way to the glass; 0 where there is none; iterations of Smooth
    after : share of the picture that then arrives; of remedies by `legible_by`, its legibility
    part : name of the glass that is smoothed
    """

    operator: str
    amount: float
    after: float
    part: str = ""

    def sentence(self, length_text: Callable[[float], str]) -> Message:
        """A clause, as "make the plate 20 mm larger", with the share where some is still lost.

        length_text : a length, m, in words
        """
        amount = length_text(self.amount)
        clause = {
            "kiriko.fit_plate": Message("make the plate {amount} larger", amount=amount),
            "kiriko.fit_display": Message("make the display {amount} larger", amount=amount),
            "kiriko.fit_picture_size": Message("make the picture {amount} wide", amount=amount),
            "kiriko.best_place": Message("move it"),
        }[self.operator]
        if self.after >= 1 - TOLD:
            return clause
        return Message("{clause} ({share} arrives)", clause=clause, share=percent(self.after))


@dataclass(frozen=True)
class Remedies:
    """The share of the picture that arrives, shares that do not by
    reason, and what helps, the most helpful first.

    is_whole : was every remedy tried? Else time was over before.
    """

    share: float
    lost: dict[str, float]
    helps: tuple[Help, ...]
    is_whole: bool = True


def find_remedies(
    rig: Rig, plan_of: PlanOf, seconds: float = inf
) -> Generator[float, None, Remedies]:
    """Find what brings lost light of the picture back to the first viewer, within about so many
    seconds; yields progress 0..1.
    """
    rig = replace(rig, viewers=rig.viewers[:1])
    end = perf_counter() + seconds
    before = yield from subprogress(traced(rig, plan_of, N_GRID), 0.0, 0.1)
    lost = {reason: share for reason, share in before.lost.items() if share > WORTH_IT}
    if not lost:
        return Remedies(before.share, lost, ())

    misses_display, misses_plate = (
        lost.get(REASON_WORDS[reason], 0.0)
        for reason in (Reason.MISSED_DISPLAY, Reason.MISSED_PLATE)
    )
    remedies = [_by_picture, _by_place]
    if misses_display:
        remedies.insert(0, partial(_by_display, misses_display))
    if misses_plate and rig.plates:
        remedies.insert(0, partial(_by_plate, misses_plate))

    helps = []
    is_whole = True
    for n, remedy in enumerate(remedies):
        start = 0.1 + 0.9 * n / len(remedies)
        steps = subprogress(remedy(rig, plan_of), start, start + 0.9 / len(remedies))
        try:
            help = yield from _until(end, steps)
        except RigError:
            continue  # it is no remedy for this rig
        if help is None:
            is_whole = False
            break
        if help.after > before.share + WORTH_IT and help.amount >= 0:
            helps.append(help)

    helps.sort(key=lambda help: -help.after)
    return Remedies(before.share, lost, tuple(helps), is_whole)


def _until(end: float, steps: Generator[float, None, Help]) -> Generator[float, None, Help | None]:
    """Long work that is given up at a time, and then finds nothing."""
    while True:
        if perf_counter() >= end:
            steps.close()
            return None
        try:
            yield next(steps)
        except StopIteration as done:
            return done.value


def _by_plate(misses: float, rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_plate(rig, plan_of, Wanted(n_grid=N_GRID))
    return Help("kiriko.fit_plate", fitted.more, _worth(fitted, misses))


def _by_display(misses: float, rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_display(rig, plan_of, Wanted(n_grid=N_GRID))
    return Help("kiriko.fit_display", fitted.more, _worth(fitted, misses))


def _worth(fitted: Fitted, misses: float) -> float:
    """The share of the picture that arrives with a part so large, 0 where that is too large for
    the little that it brings back of the share that misses it, as behind glass that scatters.
    """
    is_much = fitted.after - fitted.before >= MUCH * misses
    return fitted.after if fitted.size <= LARGE or is_much else 0.0


def _by_picture(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_picture(rig, plan_of, Wanted(share=1 - WORTH_IT, n_grid=N_GRID))
    return Help("kiriko.fit_picture_size", fitted.width, fitted.after)


def _by_place(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    side = float(np.linalg.norm(plane_of(rig).sides, axis=1).max())
    found = yield from best_place(rig, plan_of, Limits(shift=REACH * side))
    # its shares are of more rays than the others'
    after = found.after if found.after > found.before + WORTH_IT else 0.0
    return Help("kiriko.best_place", 0.0, after)


def legible_by(
    rig: Rig, settings: Settings, before: float, kept: MeshCache | None = None
) -> Generator[float, None, tuple[Help, ...]]:
    """Remedies that raise the legibility for the first viewer by WORTH_READING, the most helpful
    first. Each is measured on a changed copy of the rig; yields progress 0..1.

    Of the amounts of one remedy that is the first by which the picture can be read, else the best.

    kept : glass that is made ready
    """
    tried = _to_read(rig)
    found: dict[str, Help] = {}
    for k, help in enumerate(tried):
        best = found.get(help.operator)
        if best is not None and best.after >= READABLE:
            continue
        steps = card_legibility(with_help(rig, help), settings, kept)
        after = yield from subprogress(steps, k / len(tried), (k + 1) / len(tried))
        if after >= max(before + WORTH_READING, best.after if best else 0.0):
            found[help.operator] = replace(help, after=after)
    return tuple(sorted(found.values(), key=lambda help: -help.after))


def _to_read(rig: Rig) -> list[Help]:
    """Remedies to be tried for a picture that is hard to recognise."""
    glass = max(rig.glasses, key=lambda glass: len(glass.mesh.triangles))
    tried = [Help(SMOOTH_GLASS, n, 0.0, glass.name) for n in ITERATIONS]
    way = way_to_glass(rig)
    return [Help(MOVE_TO_GLASS, way, 0.0), *tried] if way else tried


def with_help(rig: Rig, help: Help) -> Rig:
    """The rig after a remedy of `legible_by`."""
    if help.operator == MOVE_TO_GLASS:
        return nearer(rig, help.amount)
    glasses = tuple(
        replace(glass, mesh=smoothed(glass.mesh, round(help.amount)))
        if glass.name == help.part
        else glass
        for glass in rig.glasses
    )
    return replace(rig, glasses=glasses)
