"""Tells which bundles of rays passed by something that none
of them met, as `near_misses.py` does, one by one.
"""

import ctypes
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...base.arrays import Bools, Floats, Ints
from ...base.steps import Pauses
from ...glass.meshes import Frames
from ...native.loading import loaded, n_threads
from ...native.structures import Made, PathsStructure, ThinPartsStructure
from .trees import stack_frames

MOST_BUNDLED = 32  # rays
MOST_UNITS = 4096
BUNDLES_AT_ONCE = 1 << 10  # between two pauses


class Boxes:
    """Triangles in boxes of several levels, as the kernel reads them.

    Parameters
    ----------
    boxes : of each level, (n, 2, 3) m
    starts : of each level, (n + 1,) the first triangle in each box
    frames : of the triangles
    unit_of_patch : (patches,) the box of the first level that holds a patch
    """

    def __init__(
        self, boxes: Sequence[Floats], starts: Sequence[Ints], frames: Frames, unit_of_patch: Ints
    ) -> None:
        self._made = made = Made(ThinPartsStructure)
        self._n_units = len(boxes[0])
        inner = [np.searchsorted(below, above) for above, below in pairwise(starts)]
        for level, of_level in enumerate(boxes):
            made.structure.boxes[level] = made.hold(of_level, float).ctypes.data
        for level, children in enumerate(inner):
            made.structure.children[level] = made.hold(children, np.int64).ctypes.data

        made.point("frames", stack_frames(frames), float)
        made.point("unit_of_patch", unit_of_patch, np.int64)
        made.set(n_patches=len(unit_of_patch), n_units=self._n_units)

    def knows(self, rays: Ints) -> bool:
        """Can the kernel tell of bundles of such rays (s, k)?"""
        return 0 < rays.shape[1] <= MOST_BUNDLED and self._n_units <= MOST_UNITS

    def touch(self, places: Floats, met: Ints, rays: Ints, widest: float) -> Pauses[Bools]:
        """Which bundles (s,) come near a patch that none of their rays met: as
        `ThinParts.touch`.
        """
        touched = np.zeros(len(rays), bool)
        made = Made(PathsStructure)
        made.point("places", places, float)
        made.point("met", met, np.int32)
        made.set(n_events=met.shape[1], widest=widest)
        for first in range(0, len(rays), BUNDLES_AT_ONCE):
            some = slice(first, first + BUNDLES_AT_ONCE)
            n, n_rays = made.point("rays", rays[some], np.int64).shape
            made.point("touched", touched[some], bool)  # a view: the kernel writes into the result
            made.set(n=n, n_rays=n_rays)

            structures = ctypes.addressof(self._made.structure), ctypes.addressof(made.structure)
            loaded().kiriko_touch(*structures, n_threads())
            yield 0

        return touched
