"""The medium at a point, for nested, touching and overlapping solids, by priority.

Source: Schmidt & Budge 2002. A ray's mask has one bit for each solid around it; the highest bit
gives the medium. Solids that touch, directly or through others, form a cluster. Touching solids of
a cluster have different bits, in order of priority if their indices differ. Others share bits,
because no ray is in two of them at once.
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

N_BITS = 52  # of a mask, which must be exact as a float64


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid of a glass.

    surface : in place
    key : of the surface before its motion
    number, glass : the glass it belongs to
    made : the surface before its motion
    motion : from there to its place; None without one
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
    """The media of solids (s,).

    cluster : (s,)
    bit : (s,) uint64 in the cluster's masks
    indices : (s, N_BITS + 1) index of air, then for each bit the index of the touching solid with
        this bit
    n_overlapping : clusters of more than one solid
    absorptions : (s, N_BITS + 1) 1/m, like `indices`; None if nothing absorbs

    A ray is in solids of one cluster at a time, so clusters reuse bits.
    """

    cluster: Ints
    bit: np.ndarray
    indices: Floats
    n_overlapping: int
    absorptions: Floats | None = None

    def index(self, solid: Ints, mask: np.ndarray) -> Floats:
        """Index of refraction (n,) at rays with masks (n,), at the surface of solids (n,)."""
        # frexp's exponent is 1 + the position of the highest bit set, and 0 for none
        return self.indices[solid, np.frexp(mask.astype(float))[1]]

    def absorption(self, solid: Ints, mask: np.ndarray) -> Floats:
        """Absorption (n,), 1/m, around rays with masks (n,), at the surface of solids (n,)."""
        return self.absorptions[solid, np.frexp(mask.astype(float))[1]]


def make_media(
    solids: Sequence[Solid], touch: Bools, wavelength: float, colours: Sequence[float] | None = None
) -> Media:
    """Assign each solid its bit, and the media around it.

    touch : (p, p) which parts touch, solids first, diagonal included
    colours : weights of red, green and blue in the absorbed light; None if absorption is ignored

    Raises
    ------
    RigError
        More solids touch than a mask has bits.
    """
    touch = touch[: len(solids), : len(solids)]
    index = np.array([float(solid.glass.ior.at(wavelength)) for solid in solids])
    absorption = np.zeros(len(solids))
    if colours is not None:
        of_colours = np.array([solid.glass.absorption for solid in solids]).reshape(-1, 3)
        absorption = of_colours @ np.array(colours) / sum(colours)
    rank = [(solid.glass.priority, -abs(solid.surface.volume)) for solid in solids]
    place = np.full(len(solids), -1)  # of each solid's bit
    for i in sorted(range(len(solids)), key=rank.__getitem__):
        is_other = (index != index[i]) | (absorption != absorption[i])
        # solids around a solid touched by this one need different bits
        around = touch[touch[i]].any(axis=0)
        taken = set(place[touch[i] | around & is_other])
        least = 1 + place[touch[i] & is_other].max(initial=-1)
        place[i] = next(bit for bit in range(least, len(solids)) if bit not in taken)
        if place[i] >= N_BITS:
            raise RigError(
                "More than {most} solids around '{name}' touch, overlap or nest: join them with a"
                " Remesh modifier, or move them apart.",
                most=N_BITS,
                name=solids[i].glass.name,
            )

    indices = np.ones((len(solids), N_BITS + 1))
    by, of = np.nonzero(touch)
    indices[by, 1 + place[of]] = index[of]
    cluster = np.unique(components(len(solids), by, of), return_inverse=True)[1].ravel()
    bit = np.uint64(1) << place.astype(np.uint64)
    absorptions = None
    if absorption.any():
        absorptions = np.zeros_like(indices)
        absorptions[by, 1 + place[of]] = absorption[of]
    return Media(cluster, bit, indices, int((np.bincount(cluster) > 1).sum()), absorptions)


# bound, with a margin, on how far a curved surface leaves its facets' box, relative to the box
BULGE = 0.25
PAIRS_AT_ONCE = 1 << 14


def grown(boxes: Floats) -> Floats:
    """Boxes (..., 2, 3) enlarged to hold curved surfaces over any facets within."""
    return _wider(boxes, BULGE * (boxes[..., 1:, :] - boxes[..., :1, :]))


def _wider(boxes: Floats, by: Floats) -> Floats:
    return boxes + by * np.array([[-1.0], [1.0]])


def boxes_touch(boxes: Floats, slack: float, others: Floats | None = None) -> Bools:
    """Whether axis-aligned boxes (n, 2, 3) and others (m, 2, 3), by default the same, overlap or
    are closer than `slack`: (n, m).
    """
    others = boxes if others is None else others
    touch = np.ones((len(boxes), len(others)), bool)
    for axis in range(3):  # one axis at a time needs a third of the memory
        low, high = boxes[:, :, axis].T[:, :, None]
        touch &= (low <= others[:, 1, axis] + slack) & (others[:, 0, axis] <= high + slack)
    return touch


def find_touching(
    solids: Sequence[Solid], surfaces: Sequence[Surface], is_closed: Bools, slack: float
) -> Bools:
    """Which parts touch, overlap or nest, or may do so: (p, p).

    Closed solids do if their faces, in boxes, are closer than `slack`, m, and may if one box holds
    the other. Other parts may if their boxes touch.

    surfaces : of all parts (p), solids first
    is_closed : (p,)
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
    """Whether triangles (n, 3, 3) and others (m, 3, 3) touch; False if a plane separates them."""
    points, away = corners.reshape(-1, 3), others.reshape(-1, 3)
    axis = normalise(away.mean(axis=0) - points.mean(axis=0))
    if (away @ axis).min() - (points @ axis).max() > slack:
        return False
    return _some_touch(boxes_of(corners), boxes_of(others), slack)


def _some_touch(boxes: Floats, others: Floats, slack: float) -> bool:
    """Whether any of boxes (n, 2, 3) and others (m, 2, 3) touch, by recursive halving."""
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
