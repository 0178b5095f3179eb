"""Suspects: errors of bench, half cube or program in the paper's three photographs.

A photograph is a bench and the image on its display; a suspect changes one or both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kiriko.core.bench.offset import Parameter, moved, parameters
from kiriko.core.glass.motion import Motion
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.solution import without_glass

from .infloasion import GAP, face_of, half_before, infloasion, mirrored
from .published import HALF, PLAIN, SOURCE

CONDITIONS = PLAIN, HALF, SOURCE
PUBLISHED = "published"
PART = "half cube"
BENCH = "bench"
PROGRAM = "program"
MEASUREMENT = "photograph"
TOUCHED = tuple(f"{condition} only" for condition in CONDITIONS)


@dataclass(frozen=True, eq=False)
class Photograph:
    """A bench, and the rig for which the image on its display was made."""

    bench: Rig
    made_for: Rig


@dataclass(frozen=True, eq=False)
class Setup:
    """The three photographs, and the scale at which they are measured."""

    photographs: tuple[Photograph, ...]
    scale: float = 1.0


@dataclass(frozen=True)
class Suspect:
    """Something that may be off.

    where : whom it concerns. `bench`: all three photographs; `half cube`: InFloasion's glass;
        `program`: the rig that the authors' program took for true when it made the source image;
        `published`: bench and program alike are not as the paper says; `photograph`: its
        measurement; `... only`: the bench, while one of the photographs was taken
    tolerance : amount to expect, in the unit
    """

    where: str
    name: str
    unit: str
    tolerance: float
    changed: Callable[[Setup, float], Setup]

    @property
    def title(self) -> str:
        return self.name if self.where == BENCH else f"{self.where}: {self.name}"


def suspects(rig: Rig, tolerance: Callable[[Parameter], float]) -> list[Suspect]:
    """All that may be off in three photographs of a rig,
    in the order in which it has to be applied.

    tolerance : the amount to expect of a parameter
    """
    own = parameters(rig)
    own.append(Parameter(f"{rig.glasses[0].name}: size", "%", 0.1, _resized))
    glass = [p for p in own if p.name.startswith(f"{rig.glasses[0].name}: ")]
    distance = Parameter(f"{rig.viewer.name}: distance", "mm", 1.0, _seen_from)
    thickness = Parameter("thickness", "mm", 0.1, _as_it_is)
    scale = Parameter("scale", "%", 0.1, _as_it_is)
    found = [_suspect(PUBLISHED, p, tolerance, _on_all) for p in (*glass, distance)]
    found.append(_suspect(PART, thickness, tolerance, _cut_thicker))
    found += [_suspect(PART, p, tolerance, _on_half) for p in half_parameters(rig)]
    found += [_suspect(BENCH, p, tolerance, _on_benches) for p in own]
    found += [_suspect(PROGRAM, p, tolerance, _on_program) for p in own]
    found.append(_suspect(MEASUREMENT, scale, tolerance, _at_scale))

    for number, where in enumerate(TOUCHED):
        found += [
            _suspect(where, p, tolerance, partial(_on_one, number)) for p in own if p not in glass
        ]

    return found


def half_parameters(rig: Rig) -> list[Parameter]:
    """Poses and index of the half cube that stands on the
    display: no part of it can sink into that.
    """
    name = f"{infloasion(rig).glasses[1].name}: "
    return [
        replace(p, name=p.name.removeprefix(name), applied=partial(_on_the_display, p))
        for p in parameters(_with_halves(rig))
        if p.name.startswith(name)
    ]


def _on_the_display(parameter: Parameter, rig: Rig, amount: float) -> Rig:
    rig = parameter.applied(rig, amount)
    glass, half = rig.glasses
    display, front = face_of(rig.display.mesh)
    lift = max(GAP - ((half.mesh.corners.reshape(-1, 3) - display) @ front).min(), 0.0)
    return replace(rig, glasses=(glass, moved(half, Motion(np.eye(3), lift * front))))


def _as_it_is(rig: Rig, amount: float) -> Rig:
    return rig


def _resized(rig: Rig, percent: float) -> Rig:
    """The first glass larger, about its middle."""
    glass, *others = rig.glasses
    middle = glass.mesh.bounds.mean(axis=0)
    vertices = middle + (1 + percent / 100) * (glass.mesh.vertices - middle)
    return replace(
        rig, glasses=(replace(glass, mesh=replace(glass.mesh, vertices=vertices)), *others)
    )


def _seen_from(rig: Rig, mm: float) -> Rig:
    """The viewer further away, with the picture as large in its image as before."""
    viewer = rig.viewer
    picture = rig.picture.mesh.bounds.mean(axis=0)
    forward = viewer.axes[2]
    before = (picture - viewer.position) @ forward
    window = tuple(x * before / (before + 1e-3 * mm) for x in viewer.window)
    return replace(
        rig,
        viewers=(replace(viewer, position=viewer.position - 1e-3 * mm * forward, window=window),),
    )


def _suspect(
    where: str, parameter: Parameter, tolerance: Callable[[Parameter], float], change: Callable
) -> Suspect:
    return Suspect(
        where, parameter.name, parameter.unit, tolerance(parameter), partial(change, parameter)
    )


def _on_all(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    return as_planned(parameter.applied(setup.photographs[2].made_for, amount))


def _cut_thicker(parameter: Parameter, setup: Setup, mm: float) -> Setup:
    """The half cube with its cut elsewhere."""
    plain, half, source = setup.photographs
    rig = half.made_for
    glass, piece = half.bench.glasses
    display, front = face_of(rig.display.mesh)
    beside = piece.mesh.vertices[0] - infloasion(rig).glasses[1].mesh.vertices[0]
    whole = mirrored(rig.glasses[0].mesh, *face_of(rig.plates[0].mesh))
    mesh = half_before(whole, display + (GAP - 1e-3 * mm) * front, front)
    piece = moved(replace(piece, mesh=mesh), Motion(np.eye(3), beside + 1e-3 * mm * front))
    half = replace(half, bench=replace(half.bench, glasses=(glass, piece)))
    return replace(setup, photographs=(plain, half, source))


def _on_half(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    plain, half, source = setup.photographs
    half = replace(half, bench=parameter.applied(half.bench, amount))
    return replace(setup, photographs=(plain, half, source))


def _on_benches(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    photographs = (
        replace(p, bench=_with_half(parameter, p.bench, amount)) for p in setup.photographs
    )
    return replace(setup, photographs=tuple(photographs))


def _on_one(number: int, parameter: Parameter, setup: Setup, amount: float) -> Setup:
    photographs = list(setup.photographs)
    one = photographs[number]
    photographs[number] = replace(one, bench=_with_half(parameter, one.bench, amount))
    return replace(setup, photographs=tuple(photographs))


def _with_half(parameter: Parameter, bench: Rig, amount: float) -> Rig:
    """A bench with something off; a half cube goes where the display goes that it stands on."""
    changed = parameter.applied(bench, amount)
    halves = [
        parameter.applied(replace(bench, displays=(half,)), amount).display
        for half in bench.glasses[1:]
    ]
    return replace(changed, glasses=(changed.glasses[0], *halves))


def _on_program(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    plain, half, source = setup.photographs
    source = replace(source, made_for=parameter.applied(source.made_for, amount))
    return replace(setup, photographs=(plain, half, source))


def _at_scale(parameter: Parameter, setup: Setup, percent: float) -> Setup:
    return replace(setup, scale=setup.scale * (1 + percent / 100))


def as_planned(rig: Rig) -> Setup:
    """The three photographs of a bench on which nothing is off."""
    bare = without_glass(rig)
    return Setup((Photograph(rig, bare), Photograph(_with_halves(rig), bare), Photograph(rig, rig)))


def _with_halves(rig: Rig) -> Rig:
    """InFloasion's bench. Mirrors of some height image beside where
    the plate's plane would: there the half stands.
    """
    bare = without_glass(rig)
    by_plane = replace(bare, plates=tuple(replace(plate, array=None) for plate in rig.plates))
    rays = rig.viewer.rays(rig.viewer.project(rig.picture.mesh.bounds.mean(axis=0)[None]))
    places = [
        trace_all(make_plan(r, Settings(only_through_glass=False)), *rays).positions
        for r in (bare, by_plane)
    ]
    both = infloasion(rig)
    halves = (
        moved(half, Motion(np.eye(3), (places[0] - places[1])[0])) for half in both.glasses[1:]
    )
    return replace(both, glasses=(*rig.glasses, *halves))


def taken_for_ideal(setup: Setup) -> Setup:
    """The same benches, with all that is shown made for a plate without mirrors."""

    def ideal(rig: Rig) -> Rig:
        return replace(rig, plates=tuple(replace(plate, array=None) for plate in rig.plates))

    return replace(
        setup, photographs=tuple(replace(p, made_for=ideal(p.made_for)) for p in setup.photographs)
    )
