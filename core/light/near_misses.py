"""Near misses: parts close to a bundle of rays but hit by none of them.

Nearby triangles are packed in a hierarchy of boxes.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take, unique_inverse
from ..base.steps import Steps
from ..glass.meshes import Frames, boxes_of
from ..native.loading import library, loaded, n_threads
from ..native.structures import Made, PathsStructure, ThinPartsStructure
from .kernel_trees import stack_frames

# tuned for time by `dev.py bench`
MOST_PATCHES = 4096  # with more patches, whole parts are the units
IN_BOXES = (512, 64, 8, 1)  # triangles, on each level below the units
DIGITS = 10  # bits of each coordinate for sorting triangles


class Packed(NamedTuple):
    """Triangles in boxes.

    unit_of_patch : (patches,) the unit, patch or part, of each patch
    order : (t,) of triangles, unit by unit, neighbours together
    starts : for each level, (boxes + 1,) the first triangle of each box, in order; the boxes of the
        first level are the units
    """

    unit_of_patch: Ints
    order: Ints
    starts: list[Ints]


class Packing:
    """The boxes of some triangles, found on first use."""

    def __init__(self) -> None:
        self._packed: Packed | None = None

    def of(self, corners: Floats, patch: Ints, part: Ints) -> Packed:
        """Boxes of triangles with corners (t, 3, 3), m, in patches (t,) and parts (t,), packed by
        the parts' first placement.
        """
        if self._packed is None:
            self._packed = _pack(corners, patch, part)
        return self._packed


def _pack(corners: Floats, patch: Ints, part: Ints) -> Packed:
    n = len(patch)
    _, unit = unique_inverse(patch)
    unit = unit if unit.max() < MOST_PATCHES else part
    unit_of_patch = np.zeros(int(patch.max()) + 1, np.int64)
    unit_of_patch[patch] = unit

    # neighbouring triangles together, unit by unit
    middles = sum(corners.swapaxes(0, 1)) / 3  # numpy is slow along rows of three
    order = np.lexsort([_along_curve(middles), unit])
    unit = unit[order]

    first = np.flatnonzero(np.diff(unit, prepend=-1))
    within = np.arange(n) - first[unit]
    starts = [
        np.append(first, n),
        *(np.append(np.flatnonzero(within % k == 0), n) for k in IN_BOXES),
    ]
    return Packed(unit_of_patch, order, starts)


def _along_curve(points: Floats) -> Ints:
    """Position (n,) of points (n, 3) along Morton's space-filling curve."""
    low = points.min(axis=0)
    steps = ((points - low) / max(float((points - low).max()), 1e-300) * (2**DIGITS - 1)).astype(
        np.int64
    )
    place = np.zeros(len(points), np.int64)
    for digit in range(DIGITS):
        for axis in range(3):
            place |= (steps[:, axis] >> digit & 1) << (3 * digit + axis)
    return place


@dataclass(frozen=True)
class NearMissOptions:
    """Options of the box search; tuned for time by `dev.py bench`.

    Parameters
    ----------
    pairs_at_once : of bundles and units of the rig
    boxes_at_once : pairs of a bundle and a box
    many, turns : from this number on, pairs are processed in so many turns
    widest : relative to the rig: wider bundles would touch everything; repeated in the kernel's
        thin_parts.c
    """

    pairs_at_once: int = 1 << 18
    boxes_at_once: int = 1 << 13
    many: int = 4096
    turns: int = 2
    widest: float = 1 / 16


NEAR_MISSES = NearMissOptions()


MOST_BUNDLED = 32  # rays
MOST_UNITS = 4096
BUNDLES_AT_ONCE = 1 << 10  # between two pauses


class _KernelBoxes:
    """Triangles in boxes of several levels, in the kernel's form.

    Parameters
    ----------
    boxes : for each level, (n, 2, 3) m
    starts : for each level, (n + 1,) the first triangle in each box
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

    def supports(self, rays: Ints) -> bool:
        """Whether the kernel can process bundles of such rays (s, k)."""
        return 0 < rays.shape[1] <= MOST_BUNDLED and self._n_units <= MOST_UNITS

    def touch(self, places: Floats, met: Ints, rays: Ints, widest: float) -> Steps[Bools]:
        """As `ThinParts.touch`, for bundles (s,)."""
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


@dataclass(frozen=True, eq=False)
class _Bundles:
    """Rays between two of their events, k at a time.

    ends : (n, 2, k, 3)
    owner : (n,) the path they belong to

    A cone around them has its axis along the middle ray.
    """

    ends: Floats
    owner: Ints

    @cached_property
    def outer(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """The upper and the lower line of each cone along each axis: its start, and its extent to
        the end, (3, n).

        A zero extent is never -0.0.
        """
        middle = self.ends.shape[2] // 2
        off = self.ends - self.ends[:, :, middle : middle + 1]
        radius = np.sqrt((off * off).sum(axis=3).max(axis=2)).T
        start, end = np.moveaxis(self.ends[:, :, middle], 0, 2)
        return tuple(
            (
                np.ascontiguousarray(start + sign * radius[0]),
                end - start + sign * (radius[1] - radius[0]) + 0.0,
            )
            for sign in (1, -1)
        )


class ThinParts:
    """Triangles in boxes, searched for patches near a bundle of rays but hit by none of them.

    Parameters
    ----------
    corners : (t, 3, 3) m
    patch, part : (t,) of each triangle
    packing : the boxes, shared by placements of the same triangles
    """

    def __init__(
        self, corners: Floats, patch: Ints, part: Ints, packing: Packing | None = None
    ) -> None:
        packed = (packing or Packing()).of(corners, patch, part)
        self._unit_of_patch, self._starts = packed.unit_of_patch, packed.starts
        self._corners = take(corners, packed.order)
        self.n_units = len(packed.starts[0]) - 1

        low, high = (sides.copy() for sides in boxes_of(self._corners).transpose(1, 2, 0))
        self._boxes = [
            (np.minimum.reduceat(low, s[:-1], axis=1), np.maximum.reduceat(high, s[:-1],
            axis=1)) for s in self._starts
        ]  # fmt: skip

    @cached_property
    def box(self) -> Floats:
        """Lower and upper corner (2, 3), m, of the box around all triangles."""
        low, high = self._boxes[0]
        return np.stack([low.min(axis=1), high.max(axis=1)])

    @cached_property
    def _frames(self) -> Frames:
        return Frames.of(self._corners)

    @cached_property
    def _of_kernel(self) -> _KernelBoxes:
        boxes = [np.stack(sides).transpose(2, 0, 1) for sides in self._boxes]
        return _KernelBoxes(boxes, self._starts, self._frames, self._unit_of_patch)

    def touch(self, places: Floats, met: Ints, rays: Ints) -> Steps[Bools]:
        """Bundles (s,) of k rays close to a patch that none of the rays hit; with pauses.

        Parameters
        ----------
        places : (r, m + 1, 3) m, starts of r rays and places of their events; NaN after the last
        met : (r, m) patch at each event, -1 after the last. Rays are followed until they part or
            diverge; bundles that do so before the first event count as near to everything
        rays : (s, k) the rays of each bundle
        """
        low, high = self.box
        widest = NEAR_MISSES.widest * float(np.linalg.norm(high - low))
        if library() is not None and self._of_kernel.supports(rays):
            return (yield from self._of_kernel.touch(places, met, rays, widest))

        places, met = take(places, rays), take(met, rays)
        is_met = np.zeros((len(places), self.n_units), bool)
        is_there = met >= 0
        is_met[np.nonzero(is_there)[0], self._unit_of_patch[met[is_there]]] = True
        yield 0
        bundles, touched = _bundles(places, met, widest)
        yield 0
        at_once = max(1, NEAR_MISSES.pairs_at_once // self.n_units)
        for first in range(0, len(bundles.owner), at_once):
            i, node = np.nonzero(~is_met[bundles.owner[first : first + at_once]])
            yield from self._look_into(0, bundles, i + first, node, touched)
        return touched

    def _look_into(
        self, level: int, bundles: _Bundles, i: Ints, node: Ints, touched: Bools
    ) -> Steps[None]:
        """Mark the owners of bundles i (n,) close to a triangle in boxes `node` (n,) of a level.

        One triangle is enough for an owner, so many boxes are processed in turns and marked owners
        skipped.
        """
        turns = NEAR_MISSES.turns if len(i) > NEAR_MISSES.many else 1
        for turn in range(turns):
            some = np.arange(turn, len(i), turns)
            some = some[~touched[bundles.owner[i[some]]]]

            for first in range(0, len(some), NEAR_MISSES.boxes_at_once):
                chosen = some[first : first + NEAR_MISSES.boxes_at_once]
                boxes = (np.take(side, node[chosen], axis=1) for side in self._boxes[level])
                near = chosen[_is_in_boxes(bundles, i[chosen], *boxes)]

                if level + 1 < len(self._boxes):
                    pairs = self._within(level + 1, i[near], node[near])
                    yield from self._look_into(level + 1, bundles, *pairs, touched)
                else:
                    is_near = self._is_near(bundles.ends[i[near]], node[near])
                    touched[bundles.owner[i[near[is_near]]]] = True
                    yield 0

    def _within(self, level: int, i: Ints, node: Ints) -> tuple[Ints, Ints]:
        """Pairs of bundles and boxes of a level, from pairs of the level above."""
        low, high = (
            np.searchsorted(self._starts[level], self._starts[level - 1][node + k]) for k in (0, 1)
        )
        owner = np.repeat(np.arange(len(i)), high - low)
        return i[owner], np.arange(len(owner)) - (np.cumsum(high - low) - high)[owner]

    def _is_near(self, ends: Floats, k: Ints) -> Bools:
        """Whether the convex hull of rays with ends (n, 2, r, 3) touches each of triangles k (n,).

        It does not if all rays stay on one side of the plane, or pass beyond the same edge.
        """
        frames = self._frames
        inside = (ends - frames.corner[k][:, None, None]).reshape(len(k), 2 * ends.shape[2], 3)
        axes = np.stack([frames.normal[k], frames.axis_u[k], frames.axis_v[k]], axis=2)
        # heights over the planes, and barycentric coordinates of the projections, (n, 2, r) each
        height, u, v = np.moveaxis(np.matmul(inside, axes), 2, 0).reshape(3, *ends.shape[:3])

        # bundles with rays on both sides of the plane
        near = np.flatnonzero((height.min(axis=(1, 2)) <= 0) & (height.max(axis=(1, 2)) >= 0))
        before, after = np.moveaxis(height[near], 1, 0)
        (u, by_u), (v, by_v) = ((x[near, 0], x[near, 1] - x[near, 0]) for x in (u, v))

        crosses = before * after <= 0
        with np.errstate(invalid="ignore", divide="ignore"):
            t = np.nan_to_num(before / (before - after))
            # The hull meets the plane at the crossings of rays, and between these and the other
            # rays: from the first crossing on, or up to the last if the others start behind the
            # plane.
            first = np.where(crosses, t, 1.0).min(axis=1, keepdims=True)
            last = np.where(crosses, t, 0.0).max(axis=1, keepdims=True)
            ahead = np.sign(before) == np.sign(
                np.where(crosses, before, 0.0).sum(axis=1, keepdims=True)
            )
            low = np.where(crosses, t, np.where(ahead, first, 0.0))
            high = np.where(crosses, t, np.where(ahead, 1.0, last))
            beyond = np.ones((3, len(near)), bool)
            for place in (low, high):
                x = u + place * by_u
                y = v + place * by_v
                beyond &= np.stack([np.fmax.reduce(side, axis=1) < 0 for side in (x, y, 1 - x - y)])

        touched = np.zeros(len(ends), bool)
        touched[near] = ~beyond.any(axis=0)
        return touched


def _bundles(places: Floats, met: Ints, widest: float) -> tuple[_Bundles, Bools]:
    """The rays of bundles between their events while they stay together; and which (s,) are wide
    from the start.

    widest : m, between rays
    """
    parted = np.zeros(len(places), bool)
    ends = [np.empty((0, 2, places.shape[1], 3))]
    owner = [np.empty(0, np.int64)]
    for k in range(met.shape[2]):
        with np.errstate(invalid="ignore"):
            off = np.abs(places[:, :, k + 1] - places[:, :1, k + 1]).max(axis=(1, 2), initial=0.0)
        # rays leaving the rig are followed far beyond it: allow the bundle to be as wide as the rig
        leaves = (met[:, :, k] < 0).any(axis=1)
        is_wide = off > np.where(leaves, widest / NEAR_MISSES.widest, widest)

        parts = (met[:, :, k] != met[:, :1, k]).any(axis=1)
        if k == 0:
            first = is_wide & ~parts
        parted |= is_wide | np.isnan(off)

        chosen = np.flatnonzero(~parted)
        ends.append(np.moveaxis(places[chosen, :, k : k + 2], 2, 1))
        owner.append(chosen)
        parted |= parts
        if parted.all():
            break
    return _Bundles(np.concatenate(ends), np.concatenate(owner)), first


def _is_in_boxes(bundles: _Bundles, i: Ints, low: Floats, high: Floats) -> Bools:
    """Whether the cones around bundles i (n,) meet boxes with corners low and high (3, n).

    Along each axis, at a fraction 0..1 of its length, a cone spans an interval between two lines.
    It meets the box while it is above the lower side and below the upper one, on all axes at once.
    """
    enter = np.zeros(len(i))
    leave = np.ones(len(i))
    for side, (start, extent), is_lower in zip(
        (low, high), bundles.outer, (True, False), strict=True
    ):
        extent = np.take(extent, i, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (side - np.take(start, i, axis=1)) / extent  # inf for always or never
        comes = (extent >= 0) == is_lower
        # along the first axis: reductions over rows of three are several times slower
        enter = np.fmax(enter, np.fmax.reduce(np.where(comes, at, -np.inf), axis=0))
        leave = np.fmin(leave, np.fmin.reduce(np.where(comes, np.inf, at), axis=0))
    return enter <= leave
