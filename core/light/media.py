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
from ..glass.meshes import components
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
