"""Remedies for lost or illegible light, with measured gains, for the checklist.

Each remedy is found like that of its button, with fewer rays. Only remedies with a gain are
reported, each with its operator. One of them moves the picture and the display to the glass: bent
light spreads less over a shorter distance. For a single viewer the picture's depth changes nothing,
but the display's does; both stay images of each other in the plate.
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
    """Shifts of the picture and the display, (3,) m each."""

    picture: Floats
    display: Floats


def way_to_glass(rig: Rig) -> float:
    """Distance, m, of the picture along its axis towards the first viewer.

    It leads from behind the glass to its back, or with a plate from inside to its front; 0 if there
    is none.
    """
    try:
        middle, axis = plane_of(rig).middle, _axis(rig)
    except RigError:  # no place
        return 0.0
    if not rig.glasses or rig.mirrors or len(rig.plates) > 1:  # the display has another path
        return 0.0
    ahead = np.concatenate([(glass.mesh.vertices - middle) @ axis for glass in rig.glasses])
    back, face = float(ahead.min()), float(ahead.max())
    if back > 0:
        return back
    return max(face, 0.0) if rig.plates else 0.0


def shifts_by(rig: Rig, way: float) -> Shifts:
    """Shifts of picture and display if the picture moves by a distance, m, towards the first
    viewer.
    """
    shift = way * _axis(rig)
    if not rig.plates:
        return Shifts(shift, shift)
    normal = geometric_normals(rig.plates[0].mesh.corners)[0]
    return Shifts(shift, reflect(shift, normal))


def nearer(rig: Rig, way: float) -> Rig:
    """The rig with its picture moved by a distance, m, towards the first viewer."""
    shifts = shifts_by(rig, way)
    return replace(
        rig.joined,
        pictures=(_moved(rig.pictures[0], shifts.picture),),
        displays=(_moved(rig.display, shifts.display),),
    )


def _axis(rig: Rig) -> Floats:
    """Unit normal (3,) of the picture towards the first viewer."""
    plane = plane_of(rig)
    axis = np.cross(*plane.sides)
    axis /= np.linalg.norm(axis)
    return axis * np.sign(axis @ (rig.viewers[0].position - plane.middle))


def _moved(part: PicturePlace | Display, shift: Floats) -> PicturePlace | Display:
    return replace(part, mesh=replace(part.mesh, vertices=part.mesh.vertices + shift))


N_GRID = 32  # points along each edge of a triangle of the picture
WORTH_IT = 1e-3  # fraction of the picture that a remedy has to recover
REACH = 0.5  # of the picture's longer side: limit of a shift
# A part that has to grow beyond LARGE times its size must recover MUCH of the light that misses it.
LARGE, MUCH = 2.0, 0.5
LEAST_REPORTED = 5e-3  # fraction of the picture above which a remaining loss is reported
SMOOTH_GLASS, MOVE_TO_GLASS = "kiriko.smooth_glass", "kiriko.move_to_glass"
ITERATIONS = (10, 100)  # of the Smooth modifier
WORTH_READING = 0.1  # gain of legibility


@dataclass(frozen=True)
class Help:
    """A remedy.

    operator : of its button
    amount : m, by which plate or display grow, the new width of the picture, or its distance to the
        glass; iterations of Smooth; 0 for none
    after : fraction of the picture that arrives then; for remedies of `legible_by`, its legibility
    part : name of the glass to smooth
    """

    operator: str
    amount: float
    after: float
    part: str = ""

    def sentence(self, length_text: Callable[[float], str]) -> Message:
        """A clause such as "make the plate 20 mm larger", with the arriving percentage if light
        stays lost.

        length_text : formats a length, m
        """
        amount = length_text(self.amount)
        clause = {
            "kiriko.fit_plate": Message(
                "make the {part} {amount} larger", part=Message("plate"), amount=amount
            ),
            "kiriko.fit_display": Message(
                "make the {part} {amount} larger", part=Message("display"), amount=amount
            ),
            "kiriko.fit_picture_size": Message("make the picture {amount} wide", amount=amount),
            "kiriko.best_place": Message("move it"),
        }[self.operator]
        if self.after >= 1 - LEAST_REPORTED:
            return clause
        return Message("{clause} ({share} arrives)", clause=clause, share=percent(self.after))


@dataclass(frozen=True)
class Remedies:
    """Fraction of the picture that arrives, lost fractions by reason, and remedies, the best first.

    is_whole : whether every remedy was tried before time ran out
    """

    share: float
    lost: dict[str, float]
    helps: tuple[Help, ...]
    is_whole: bool = True


def find_remedies(
    rig: Rig, plan_of: PlanOf, seconds: float = inf
) -> Generator[float, None, Remedies]:
    """Find remedies that recover lost light for the first viewer; yields progress 0..1.

    seconds : time limit, approximate
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
            continue  # does not apply to this rig
        if help is None:
            is_whole = False
            break
        if help.after > before.share + WORTH_IT and help.amount >= 0:
            helps.append(help)

    helps.sort(key=lambda help: -help.after)
    return Remedies(before.share, lost, tuple(helps), is_whole)


def _until(end: float, steps: Generator[float, None, Help]) -> Generator[float, None, Help | None]:
    """Run long work until a time; None if it is not finished by then."""
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
    """Fraction of the picture that arrives with a larger part; 0 if it is too large for its gain.

    Glass that scatters needs a huge part for little light.
    """
    is_much = fitted.after - fitted.before >= MUCH * misses
    return fitted.after if fitted.size <= LARGE or is_much else 0.0


def _by_picture(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_picture(rig, plan_of, Wanted(share=1 - WORTH_IT, n_grid=N_GRID))
    return Help("kiriko.fit_picture_size", fitted.width, fitted.after)


def _by_place(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    side = float(np.linalg.norm(plane_of(rig).sides, axis=1).max())
    found = yield from best_place(rig, plan_of, Limits(shift=REACH * side))
    # not comparable with the other fractions, which come from fewer rays
    after = found.after if found.after > found.before + WORTH_IT else 0.0
    return Help("kiriko.best_place", 0.0, after)


def legible_by(
    rig: Rig, settings: Settings, before: float, cache: MeshCache | None = None
) -> Generator[float, None, tuple[Help, ...]]:
    """Remedies that raise the first viewer's legibility by WORTH_READING, the best first.

    Each is measured on a changed copy of the rig. For several amounts of a remedy, the first one
    that makes the picture readable is used, otherwise the best. Yields progress 0..1.

    cache : of prepared glass
    """
    tried = _to_read(rig)
    found: dict[str, Help] = {}
    for k, help in enumerate(tried):
        best = found.get(help.operator)
        if best is not None and best.after >= READABLE:
            continue
        steps = card_legibility(with_help(rig, help), settings, cache)
        after = yield from subprogress(steps, k / len(tried), (k + 1) / len(tried))
        if after >= max(before + WORTH_READING, best.after if best else 0.0):
            found[help.operator] = replace(help, after=after)
    return tuple(sorted(found.values(), key=lambda help: -help.after))


def _to_read(rig: Rig) -> list[Help]:
    """Candidates for a picture that is hard to recognise."""
    if not rig.glasses:
        return []
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
