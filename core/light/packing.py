"""In which boxes the triangles of a rig are packed, those that lie together in one.

Boxes only save time: whatever is packed together, the same triangles are found near rays. So
triangles stay packed as they were when some of them are moved.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints, each_once

# tuned for time by `dev.py bench`
MOST_PATCHES = 4096  # with more patches whole parts are looked for
IN_BOXES = (512, 64, 8, 1)  # triangles, level by level below those of whole patches
DIGITS = 10  # binary, of each coordinate by which triangles are sorted


class Packed(NamedTuple):
    """Triangles in boxes.

    unit_of_patch : (patches,) the unit, patch or part, that a patch belongs to
    order : (t,) of triangles, unit by unit, neighbours together
    starts : of each level, (boxes + 1,) the first triangle of each box, in their order; the boxes
        of the first level are the units
    """

    unit_of_patch: Ints
    order: Ints
    starts: list[Ints]


class Packing:
    """The boxes of some triangles, found when they are first asked for."""

    def __init__(self) -> None:
        self._packed: Packed | None = None

    def of(self, corners: Floats, patch: Ints, part: Ints) -> Packed:
        """Those of triangles with corners (t, 3, 3), m, in patches (t,) and parts (t,), wherever
        the parts were at first.
        """
        if self._packed is None:
            self._packed = _pack(corners, patch, part)
        return self._packed


def _pack(corners: Floats, patch: Ints, part: Ints) -> Packed:
    n = len(patch)
    _, unit = each_once(patch)
    unit = unit if unit.max() < MOST_PATCHES else part
    unit_of_patch = np.zeros(int(patch.max()) + 1, np.int64)
    unit_of_patch[patch] = unit

    # triangles in an order in which neighbours lie together, unit by unit
    middles = sum(corners.swapaxes(0, 1)) / 3  # numpy is slow along rows of three
    order = np.lexsort([_along_curve(middles), unit])
    unit = unit[order]

    # boxes: of whole units, then of ever fewer triangles
    first = np.flatnonzero(np.diff(unit, prepend=-1))
    within = np.arange(n) - first[unit]
    starts = [
        np.append(first, n),
        *(np.append(np.flatnonzero(within % k == 0), n) for k in IN_BOXES),
    ]
    return Packed(unit_of_patch, order, starts)


def _along_curve(points: Floats) -> Ints:
    """Place (n,) of points (n, 3) along a curve that fills space
    (Morton's): neighbours on it are near each other.
    """
    low = points.min(axis=0)
    steps = ((points - low) / max(float((points - low).max()), 1e-300) * (2**DIGITS - 1)).astype(
        np.int64
    )
    place = np.zeros(len(points), np.int64)
    for digit in range(DIGITS):
        for axis in range(3):
            place |= (steps[:, axis] >> digit & 1) << (3 * digit + axis)
    return place
