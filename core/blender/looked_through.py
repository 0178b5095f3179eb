"""Which of several glasses does the viewer of a new rig look through?"""

from collections.abc import Sequence

import bpy
import numpy as np

from ..base.arrays import Floats
from ..glass.meshes import box_of
from ..rig.rig import Glass
from .parts import Part


def bounds_of(parts: Sequence[Part | Glass]) -> Floats:
    """Bounds (2, 3) of parts, world, m."""
    return box_of(np.concatenate([part.mesh.bounds for part in parts]))


def looked_through(parts: list[Part], active: bpy.types.Object | None) -> list[Part]:
    """Those of the glass that the viewer looks through: of the active object or, where that is
    none of them, as after a box selection, of the one nearest to the middle of all.
    """
    owners = {part.owner for part in parts}
    if active not in owners:
        middle = bounds_of(parts).mean(axis=0)
        nearest = min(
            parts, key=lambda part: np.linalg.norm(bounds_of([part]).mean(axis=0) - middle)
        )
        active = nearest.owner
    return [part for part in parts if part.owner == active]
