"""The medium at a point: nested, touching and overlapping
solids by priority (Schmidt & Budge 2002).

Solids whose boxes hang together are a cluster; each has a bit in the cluster's mask, by rising
priority, so that the medium at a point is the highest bit set of the solids it is in.
"""

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..errors import RigError
from ..glass.meshes import components
from ..glass.surfaces import Surface
from ..rig import Glass

MOST_OVERLAPPING = 52  # solids in one cluster: their mask has to be exact as a float64


@dataclass(frozen=True, eq=False)
class Media:
    """Solids s: cluster (s,), bit (s,) uint64 in its mask, and
    row (s,) at which its indices begin in `indices`.

    A cluster's indices are 1.0 (air) and then those of its solids by rising priority. A ray is in
    solids of one cluster at a time, so bits are used again from cluster to cluster. n_overlapping:
    clusters of more than one solid.
    """

    cluster: Ints
    bit: np.ndarray
    row: Ints
    indices: Floats
    n_overlapping: int

    def index(self, solid: Ints, mask: np.ndarray) -> Floats:
        """Index of refraction (n,) where a ray with masks (n,) is, at the surface of
        solids (n,).
        """
        # frexp's exponent is 1 + the position of the highest bit set, and 0 for none
        return self.indices[self.row[solid] + np.frexp(mask.astype(float))[1]]


def boxes_touch(boxes: Floats, slack: float) -> Bools:
    """Do axis-aligned boxes (n, 2, 3) overlap or come closer than `slack`? (n, n)."""
    low = boxes[:, 0]
    high = boxes[:, 1] + slack
    return ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)


def clusters_of(touch: Bools) -> list[Ints]:
    """Groups of solids whose boxes hang together, from who touches whom (n, n)."""
    label = components(len(touch), *np.nonzero(touch))
    return [np.flatnonzero(label == first) for first in np.unique(label)]


def make_media(
    solids: list[Surface], glass_of: list[Glass], slack: float, wavelength: float
) -> Media:
    """Give each solid its bit and the clusters their indices.

    Raises
    ------
    RigError
        More solids hang together than a mask can tell apart.
    """
    member = np.zeros(len(solids), np.int64)
    row = np.zeros(len(solids), np.int64)
    bit = np.zeros(len(solids), np.uint64)
    indices: list[float] = []
    clusters = clusters_of(boxes_touch(np.stack([solid.bounds for solid in solids]), slack))

    for number, cluster in enumerate(clusters):
        if len(cluster) > MOST_OVERLAPPING:
            name = glass_of[cluster[0]].name
            if all(glass_of[i].name == name for i in cluster):
                raise RigError(
                    "The glass '{name}' is in {n} pieces that overlap or nest: make one"
                    " body of them by a Remesh modifier, merge its vertices by distance where they"
                    " belong together, or keep at most {most} pieces.",
                    name=name,
                    n=len(cluster),
                    most=MOST_OVERLAPPING,
                )

            raise RigError(
                "{n} glass solids around '{name}' overlap or nest: join them or keep at"
                " most {most}.",
                n=len(cluster),
                name=name,
                most=MOST_OVERLAPPING,
            )

        by_priority = sorted(cluster, key=lambda i: (glass_of[i].priority, -abs(solids[i].volume)))
        bit[by_priority] = np.uint64(1) << np.arange(len(cluster), dtype=np.uint64)
        row[by_priority] = len(indices)
        member[by_priority] = number
        indices += [1.0, *(float(glass_of[i].ior.at(wavelength)) for i in by_priority)]

    return Media(member, bit, row, np.array(indices), sum(len(cluster) > 1 for cluster in clusters))
