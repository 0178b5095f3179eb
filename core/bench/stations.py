"""Glass, plates and display in the order in which light comes to them: the distances between them,
and the place where the display seems to stand.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..base.vectors import length_of, normalise
from ..light.light_paths import Way
from ..light.optics import reflect
from ..light.plan import Plan
from ..rig.kinds import Kind
from ..rig.rig import Mesh, Rig

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


def stations_of(rig: Rig, plan: Plan | None, way: Way | None) -> list[Station]:
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
