"""The medium at a point: nested, touching and overlapping
solids by priority (Schmidt & Budge 2002).

A ray's mask has a bit for each solid that it is in; the highest one is that of the medium. Solids
that touch, directly or by others, are a cluster. Those of a cluster that touch have different bits,
by rising priority where their indices differ. The others share bits: no ray is in two of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import RigError
from ..base.fingerprint import fingerprint
from ..base.vectors import normalise
from ..glass.meshes import boxes_of, components
from ..glass.motion import Motion
from ..glass.surfaces import Surface
from ..rig.rig import Glass

N_BITS = 52  # of a mask, which has to be exact as a float64


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid of a glass of that number, where it is; where it
    was made, under its key; how it came from there.
    """

    surface: Surface
    key: str
    number: int
    glass: Glass
    made: Surface
    motion: Motion | None

    @property
    def key_here(self) -> str:
        return self.key if self.motion is None else f"{self.key}@{fingerprint(self.motion)}"


@dataclass(frozen=True, eq=False)
class Media:
    """Solids s: cluster (s,), bit (s,) uint64 in its masks, and indices (s, N_BITS + 1): that of
    air, then for each bit that of the solid that has it and touches this one.

    A ray is in solids of one cluster at a time, so bits are used again from cluster to cluster.
    n_overlapping: clusters of more than one solid.
    """

    cluster: Ints
    bit: np.ndarray
    indices: Floats
    n_overlapping: int

    def index(self, solid: Ints, mask: np.ndarray) -> Floats:
        """Index of refraction (n,) where a ray with masks (n,) is, at the surface of
        solids (n,).
        """
        # frexp's exponent is 1 + the position of the highest bit set, and 0 for none
        return self.indices[solid, np.frexp(mask.astype(float))[1]]


def make_media(solids: Sequence[Solid], touch: Bools, wavelength: float) -> Media:
    """Give each solid its bit, and the indices around it.

    touch : (p, p) which parts touch, solids first, each itself, too

    Raises
    ------
    RigError
        More solids touch than a mask can tell apart.
    """
    touch = touch[: len(solids), : len(solids)]
    index = np.array([float(solid.glass.ior.at(wavelength)) for solid in solids])
    rank = [(solid.glass.priority, -abs(solid.surface.volume)) for solid in solids]
    place = np.full(len(solids), -1)  # of each solid's bit
    for i in sorted(range(len(solids)), key=rank.__getitem__):
        is_other = index != index[i]
        # those around a solid that this one touches, too, are told apart by it
        around = touch[touch[i]].any(axis=0)
        taken = set(place[touch[i] | around & is_other])
        least = 1 + place[touch[i] & is_other].max(initial=-1)
        place[i] = next(bit for bit in range(least, len(solids)) if bit not in taken)
        if place[i] >= N_BITS:
            raise RigError(
                "More than {most} glass solids around '{name}' touch, overlap or nest: join"
                " them by a Remesh modifier, or move them apart.",
                most=N_BITS,
                name=solids[i].glass.name,
            )

    indices = np.ones((len(solids), N_BITS + 1))
    by, of = np.nonzero(touch)
    indices[by, 1 + place[of]] = index[of]
    cluster = np.unique(components(len(solids), by, of), return_inverse=True)[1].ravel()
    bit = np.uint64(1) << place.astype(np.uint64)
    return Media(cluster, bit, indices, int((np.bincount(cluster) > 1).sum()))


# of its size: so far a curved surface stays, with room to spare, within the box of its facets
BULGE = 0.25
PAIRS_AT_ONCE = 1 << 14  # of boxes, each with each


def grown(boxes: Floats) -> Floats:
    """Boxes (..., 2, 3) that curved surfaces stay within, however
    far they bulge out of the boxes of their facets.
    """
    return _wider(boxes, BULGE * (boxes[..., 1:, :] - boxes[..., :1, :]))


def _wider(boxes: Floats, by: Floats) -> Floats:
    return boxes + by * np.array([[-1.0], [1.0]])


def boxes_touch(boxes: Floats, slack: float, others: Floats | None = None) -> Bools:
    """Do axis-aligned boxes (n, 2, 3) and others (m, 2, 3), or the same, overlap or come closer
    than `slack`? (n, m).
    """
    others = boxes if others is None else others
    touch = np.ones((len(boxes), len(others)), bool)
    for axis in range(3):  # one at a time takes a third of the memory
        low, high = boxes[:, :, axis].T[:, :, None]
        touch &= (low <= others[:, 1, axis] + slack) & (others[:, 0, axis] <= high + slack)
    return touch


def find_touching(
    solids: Sequence[Solid], surfaces: Sequence[Surface], is_closed: Bools, slack: float
) -> Bools:
    """Which parts touch, overlap or nest in one another, or may do so? (p, p).

    Closed solids do if their faces, in boxes, come closer than `slack`, m, and may do so if the box
    of one holds the other's. Other parts may do so if their boxes touch.

    surfaces : of all parts (p), those of the solids first; is_closed : (p,)
    """
    boxes = np.stack([surface.bounds for surface in surfaces])
    near = boxes_touch(grown(boxes[: len(solids)]), slack)
    reach = np.zeros(len(boxes))
    for i in np.flatnonzero(near.sum(axis=1) > 1):
        reach[i] = solids[i].made.reach

    boxes = _wider(boxes, reach[:, None, None])
    touch = boxes_touch(boxes, slack)
    for i, j in np.argwhere(np.triu(touch[: len(solids), : len(solids)], 1)):
        may_nest = _holds(boxes[i], boxes[j]) or _holds(boxes[j], boxes[i])
        if not may_nest and is_closed[i] and is_closed[j]:
            corners = (solids[i].surface.corners, solids[j].surface.corners)
            touch[i, j] = touch[j, i] = _faces_touch(*corners, slack + reach[i] + reach[j])
    return touch


def _holds(box: Floats, other: Floats) -> bool:
    return bool((box[0] <= other[0]).all() and (box[1] >= other[1]).all())


def _faces_touch(corners: Floats, others: Floats, slack: float) -> bool:
    """Do triangles (n, 3, 3) and others (m, 3, 3) touch? Not where a plane parts them."""
    points, away = corners.reshape(-1, 3), others.reshape(-1, 3)
    axis = normalise(away.mean(axis=0) - points.mean(axis=0))
    if (away @ axis).min() - (points @ axis).max() > slack:
        return False
    return _some_touch(boxes_of(corners), boxes_of(others), slack)


def _some_touch(boxes: Floats, others: Floats, slack: float) -> bool:
    """Do any of boxes (n, 2, 3) and others (m, 2, 3) touch? Halves of them are asked first."""
    boxes = boxes[boxes_touch(boxes, slack, _around(others))[:, 0]]
    if not len(boxes):
        return False
    others = others[boxes_touch(others, slack, _around(boxes))[:, 0]]
    if len(boxes) * len(others) <= PAIRS_AT_ONCE:
        return bool(boxes_touch(boxes, slack, others).any())
    if len(boxes) < len(others):
        boxes, others = others, boxes
    middles = boxes.sum(axis=1)
    along = middles[:, np.ptp(middles, axis=0).argmax()]
    halves = np.array_split(np.argpartition(along, len(along) // 2), 2)
    return any(_some_touch(boxes[half], others, slack) for half in halves)


def _around(boxes: Floats) -> Floats:
    """The box (1, 2, 3) around boxes (n, 2, 3)."""
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])[None]
