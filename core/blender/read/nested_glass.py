"""Nested glass, converted for Cycles.

Kiriko finds the medium at a point from all solids and their priorities. Cycles has one relative
index of refraction per surface, and separates inside from outside by its normals.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from mathutils.bvhtree import BVHTree

from ...base.arrays import Floats
from ...base.messages import Message
from ...glass.meshes import volume_of
from ...glass.solids import contains, solids_from_mesh
from ...glass.surfaces import Surface
from ...rig.rig import WAVELENGTH, Glass
from .elements import MaterialReading

CLOSE = 1e-5  # solids closer than this fraction of their size touch
MOST_TESTED = 20_000  # vertices tested for their distance to another solid
SAME_VOLUMES = 1e-3  # volumes with a smaller relative difference are equal
MOST_TRIANGLES = 300_000  # for more of them `reasons` would take too long
SAME = 1e-4  # indices with a smaller difference are equal


@dataclass(frozen=True)
class Interface:
    """The surface of a glass object for a renderer.

    index : ratio of its index to the surrounding medium's; None if it changes nothing
    is_inside_out : all its faces are drawn with inward normals
    """

    index: float | None
    is_inside_out: bool


class _Solids:
    """All solids of a rig, each with its glass, and whether they touch or contain each other."""

    def __init__(self, glasses: tuple[Glass, ...]) -> None:
        self.glasses = glasses
        found = [
            (k, solid)
            for k, glass in enumerate(glasses)
            for solid in solids_from_mesh(glass.mesh.flat())
        ]
        self.owners = [k for k, _ in found]
        self.surfaces = [solid for _, solid in found]
        self.volumes = np.array([abs(solid.volume) for solid in self.surfaces])
        self.boxes = np.array([solid.bounds for solid in self.surfaces]).reshape(-1, 2, 3)

        # float32 is exact enough near it
        self._centre = self.boxes.mean(axis=(0, 1)) if found else np.zeros(3)
        self._trees: dict[int, BVHTree] = {}

    def rank(self, i: int) -> tuple[int, float]:
        """Rank of overlapping solids: the highest one fills the overlap."""
        return self.glasses[self.owners[i]].priority, -self.volumes[i]

    def near(self, i: int) -> list[int]:
        """Solids whose boxes overlap the box of i."""
        low = self.boxes[:, 0]
        high = self.boxes[:, 1]
        overlap = ((low <= high[i]) & (low[i] <= high)).all(axis=1)
        return [int(j) for j in np.flatnonzero(overlap) if j != i]

    def holds(self, j: int, i: int) -> bool:
        """Whether solid i, which does not intersect j, is inside j."""
        return self.volumes[j] > self.volumes[i] and bool(
            contains(self.surfaces[j].corners, self.surfaces[i].corners[0, :1])[0]
        )

    def _points(self, i: int) -> Floats:
        return self.surfaces[i].corners.reshape(-1, 3) - self._centre

    def _tree(self, i: int) -> BVHTree:
        if i not in self._trees:
            points = self._points(i)
            faces = np.arange(len(points)).reshape(-1, 3)
            self._trees[i] = BVHTree.FromPolygons(
                points.tolist(), faces.tolist(), all_triangles=True
            )
        return self._trees[i]

    def touch(self, i: int, j: int) -> bool:
        """Whether two solids intersect or touch."""
        if self._tree(i).overlap(self._tree(j)):
            return True

        reach = CLOSE * float(np.ptp(self.boxes[[i, j]], axis=1).max(axis=1).min())
        for one, other in ((i, j), (j, i)):
            points = np.unique(self._points(one), axis=0)
            points = points[:: len(points) // MOST_TESTED + 1]
            if any(
                self._tree(other).find_nearest(point, reach)[0] is not None
                for point in points.tolist()
            ):
                return True

        return False


def interfaces(glasses: tuple[Glass, ...]) -> tuple[list[Interface], list[str]]:
    """The surface of each glass object for a renderer, and a sentence for each reason why a preview
    is not comparable.
    """
    solids = _Solids(glasses)
    ratios: list[set[float | None]] = [set() for _ in glasses]
    reasons: dict[str, None] = {}  # in order, each once

    for i, k in enumerate(solids.owners):
        near = solids.near(i)
        for j in (j for j in near if j < i and solids.touch(i, j)):
            first, last = sorted((glasses[k].name, glasses[solids.owners[j]].name))
            who = (
                Message("'{first}' and '{last}'", first=first, last=last)
                if first != last
                else Message("parts of '{first}'", first=first)
            )
            reasons[Message("{who} touch or overlap, which Cycles cannot render", who=who)] = None

        # relative to the innermost solid around it
        around = max((j for j in near if solids.holds(j, i)), key=solids.rank, default=None)
        if around is None:
            ratios[k].add(glasses[k].ior.at(WAVELENGTH))
        elif solids.rank(around) > solids.rank(i):
            ratios[k].add(None)
        else:
            ratios[k].add(
                glasses[k].ior.at(WAVELENGTH) / glasses[solids.owners[around]].ior.at(WAVELENGTH)
            )

    found = []
    for k, glass in enumerate(glasses):
        if len(ratios[k]) > 1:
            reasons[Message("parts of '{name}' are in different media", name=glass.name)] = None

        own = [
            surface
            for owner, surface in zip(solids.owners, solids.surfaces, strict=True)
            if owner == k
        ]
        side = _side(glass, own)
        if abs(abs(side) - 1) > SAME_VOLUMES:
            reasons[
                Message("normals of '{name}' point inward (recalculate them)", name=glass.name)
            ] = None

        found.append(Interface(next(iter(ratios[k]), None), side < 0))

    return found, [
        Message("The preview differs from Kiriko's result: {why}.", why=reason)
        for reason in reasons
    ]


def _side(glass: Glass, solids: list[Surface]) -> float:
    """+1 if all faces are drawn outward, -1 if all are inward, else between."""
    volume = sum(solid.volume for solid in solids)
    if volume == 0 or any(solid.n_open for solid in solids):
        return 1.0  # an open surface is used as drawn
    return volume_of(glass.mesh.corners) / volume


def reasons(glasses: tuple[Glass, ...], materials: Iterable[MaterialReading]) -> list[Message]:
    """Clauses, without a full stop, on why Cycles shows the artist's own glass differently from
    Kiriko.

    Cycles takes a material's index as a ratio to air and a face's normal as outward, and has no
    priorities.
    """
    if sum(len(glass.mesh.triangles) for glass in glasses) > MOST_TRIANGLES:
        return []

    found, notes = interfaces(glasses)
    clauses = [note.values["why"] for note in notes]
    for glass, shown in zip(glasses, found, strict=True):
        is_nested = shown.index is None or abs(shown.index - glass.ior.at(WAVELENGTH)) > SAME
        if is_nested and not notes:
            clauses.append(Message("'{name}' is inside other glass", name=glass.name))
        if shown.is_inside_out:
            clauses.append(
                Message("normals of '{name}' point inward (recalculate them)", name=glass.name)
            )

    for one in materials:
        if one.own_ior is not None and abs(one.own_ior - one.ior) > SAME:
            clauses.append(
                Message(
                    "the Override IOR of '{name}' differs from its material",
                    name=one.object_name,
                )
            )
    return list(dict.fromkeys(clauses))
