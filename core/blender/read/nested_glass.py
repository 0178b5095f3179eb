"""Glass in glass, as Cycles has to be told of it.

Kiriko finds the medium at a point from all solids and their priorities; Cycles knows one
relative index of refraction a surface, and which side is inside from its normals.
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

CLOSE = 1e-5  # solids nearer than this share of their size touch
MOST_ASKED = 20_000  # vertices asked for their distance to another solid
SAME_VOLUMES = 1e-3  # volumes that differ by less than this share are the same
MOST_TRIANGLES = 300_000  # with more of them nobody is to wait for `reasons`
SAME = 1e-4  # indices that differ by less are the same


@dataclass(frozen=True)
class Interface:
    """The surface of a glass object, to a renderer.

    index : ratio of its index to that of the medium around it; None where it changes nothing
    is_inside_out : all its faces are drawn looking into the glass
    """

    index: float | None
    is_inside_out: bool


class _Solids:
    """All solids of a rig, the glass each belongs to, and which of them touch or hold
    each other.
    """

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

        # near it float32 is exact enough
        self._centre = self.boxes.mean(axis=(0, 1)) if found else np.zeros(3)
        self._trees: dict[int, BVHTree] = {}

    def rank(self, i: int) -> tuple[int, float]:
        """By this the solid that is there is chosen where several overlap: the highest."""
        return self.glasses[self.owners[i]].priority, -self.volumes[i]

    def near(self, i: int) -> list[int]:
        """Solids whose boxes overlap that of i."""
        low = self.boxes[:, 0]
        high = self.boxes[:, 1]
        overlap = ((low <= high[i]) & (low[i] <= high)).all(axis=1)
        return [int(j) for j in np.flatnonzero(overlap) if j != i]

    def holds(self, j: int, i: int) -> bool:
        """Is solid i, which j does not cut, inside j?"""
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
        """Do two solids cut or touch each other?"""
        if self._tree(i).overlap(self._tree(j)):
            return True

        reach = CLOSE * float(np.ptp(self.boxes[[i, j]], axis=1).max(axis=1).min())
        for one, other in ((i, j), (j, i)):
            points = np.unique(self._points(one), axis=0)
            points = points[:: len(points) // MOST_ASKED + 1]
            if any(
                self._tree(other).find_nearest(point, reach)[0] is not None
                for point in points.tolist()
            ):
                return True

        return False


def interfaces(glasses: tuple[Glass, ...]) -> tuple[list[Interface], list[str]]:
    """The surface of each glass object to a renderer, and one
    sentence for each reason why it cannot be told.
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

        # the index is a ratio to the innermost solid around it
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
        Message("The preview is not comparable: {why}.", why=reason) for reason in reasons
    ]


def _side(glass: Glass, solids: list[Surface]) -> float:
    """+1 where the faces look out of the glass as drawn, -1
    where they all look in, else something between.
    """
    volume = sum(solid.volume for solid in solids)
    if volume == 0 or any(solid.n_open for solid in solids):
        return 1.0  # a surface that encloses nothing is taken as drawn
    return volume_of(glass.mesh.corners) / volume


def reasons(glasses: tuple[Glass, ...], materials: Iterable[MaterialReading]) -> list[Message]:
    """Why Cycles shows the artist's own glass otherwise than Kiriko follows it: a clause for each
    reason, without a full stop.

    Cycles takes a material's index for a ratio to air and a face's normal for the way out, and
    knows no priorities.
    """
    if sum(len(glass.mesh.triangles) for glass in glasses) > MOST_TRIANGLES:
        return []

    found, notes = interfaces(glasses)
    told = [note.values["why"] for note in notes]
    for glass, shown in zip(glasses, found, strict=True):
        is_nested = shown.index is None or abs(shown.index - glass.ior.at(WAVELENGTH)) > SAME
        if is_nested and not notes:
            told.append(Message("'{name}' is inside other glass", name=glass.name))
        if shown.is_inside_out:
            told.append(
                Message("normals of '{name}' point inward (recalculate them)", name=glass.name)
            )

    for one in materials:
        if one.own_ior is not None and abs(one.own_ior - one.ior) > SAME:
            told.append(
                Message(
                    "the Override IOR of '{name}' differs from its material",
                    name=one.object_name,
                )
            )
    return list(dict.fromkeys(told))
