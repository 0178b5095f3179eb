"""Trees over many boxes are cut here first, as tree.c would, so that no call to it takes long.

The tree is the one that a single call would make: the same boxes around the same items, in the
same order; but for those that are so uneven that it is cut 28 deep here, or 40 deep in all.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints, taken
from ...base.steps import Pauses
from ...native.loading import loaded
from ...native.structures import NODE, Made, TreeStructure

AT_ONCE = 1 << 17  # boxes that one call makes a tree over, in 0.06 s
LINE = 64  # bytes that memory hands over together
BLOCK = 1 << 14  # boxes that are looked at together: they stay in the cache
# as in tree.c and tree.h
BINS = 16
FEW = 4
MOST_ITEMS = 16
ROUNDING = np.float32(1e-6)
DEPTH = 28  # that the parts made by a call, 40 and 12 deep, leave of the 80 a tree may have


class _Part(NamedTuple):
    """Some of the boxes (n,), by number, the box (2, 3) around them, and after how many cuts."""

    items: Ints
    box: Floats
    depth: int


class _Tree:
    """A tree that grows over boxes (n, 2, 3): its nodes so far, and the items in their order."""

    def __init__(self, boxes: Floats) -> None:
        self.boxes = boxes
        self.nodes: list[NDArray[np.void]] = []
        self.items: list[NDArray[np.int32]] = []
        self.n_nodes = self.n_items = 0
        # cuts after which boxes are halved, which ends soon
        self.by_halves = DEPTH - int(np.ceil(np.log2(max(len(boxes) / AT_ONCE, 1))))

    def grow(self, items: Ints, depth: int = 0) -> Pauses[tuple[int, int]]:
        """Grow over some boxes (n,), which are so many cuts deep: number and
        0 of the node above them, or where they begin and how many there are.
        """
        if len(items) <= AT_ONCE:
            yield 0
            return self._add(*_make_nodes(taken(self.boxes, items)), items)

        node = np.zeros(1, NODE)
        number = self.n_nodes
        self.nodes.append(node)
        self.n_nodes += 1
        sides, first, count = (node[name][0] for name in ("sides", "first", "count"))
        sides[::2] = np.inf
        sides[1::2] = -np.inf
        first[:] = -1

        parts = yield from self._four_parts(items, depth)
        for k, part in enumerate(parts):
            low, high = part.box.astype(np.float32)
            sides[::2, k] = low - ROUNDING
            sides[1::2, k] = high + ROUNDING
            first[k], count[k] = yield from self.grow(part.items, part.depth)

        return number, 0

    def _four_parts(self, items: Ints, depth: int) -> Pauses[list[_Part]]:
        """The parts that the boxes of a node are: the one with
        the largest box is cut, three times.
        """
        parts = list((yield from self._cut(items, depth)))
        is_whole = [False, False]  # those that nothing is won by cutting
        while len(parts) < 4 and not all(is_whole):
            area = np.where(is_whole, -1.0, [_half_area(part.box) for part in parts])
            largest = int(area.argmax())
            halves = yield from self._cut(parts[largest].items, parts[largest].depth)
            is_whole[largest] = not halves
            if halves:
                parts[largest] = halves[0]
                parts.append(halves[1])
                is_whole.append(False)

        return parts

    def _cut(self, items: Ints, depth: int) -> Pauses[tuple[_Part, ...]]:
        """Cut some boxes (n,) in two where rays are likely to have the least
        to do; no parts where they are few and best stay together.
        """
        if len(items) <= FEW:
            return ()
        if depth < self.by_halves:
            most = np.inf
            if len(items) <= MOST_ITEMS:
                most = len(items) * _half_area(_box_of(taken(self.boxes, items)))
            bins, counts, around, is_wide = yield from _binned(self.boxes, items)
            axis, cut = _best_cut(counts, around, is_wide, most)
            if cut:
                is_before = bins[:, axis] < cut
                yield 0
                return (
                    _Part(items[is_before], _box_of(around[axis, :cut]), depth + 1),
                    _Part(_as_left(items, is_before), _box_of(around[axis, cut:]), depth + 1),
                )

        if len(items) <= MOST_ITEMS:
            return ()
        # all in one place, or far down: any halves will do
        return tuple(
            _Part(half, _box_of(taken(self.boxes, half)), depth + 1)
            for half in np.split(items, [len(items) // 2])
        )

    def _add(self, nodes: NDArray[np.void], order: Ints, items: Ints) -> tuple[int, int]:
        """Take up nodes over some boxes (n,), which are in that order at their ends."""
        begin = self.n_items
        self.items.append(items[order].astype(np.int32))
        self.n_items += len(items)
        if len(nodes) == 1 and nodes["first"][0, 1] < 0:  # a few that are not parted
            return begin, len(items)

        number = self.n_nodes
        is_end = nodes["count"] > 0
        nodes["first"] += np.where(is_end, begin, np.where(nodes["first"] < 0, 0, number))
        self.nodes.append(nodes)
        self.n_nodes += len(nodes)
        return number, 0


def making_tree(boxes: Floats) -> Pauses[tuple[Made, NDArray[np.int32]]]:
    """Make a tree over boxes (n, 2, 3), which are about 1 in size, with pauses.

    And the box (n,) that stands at each position.
    """
    boxes = np.ascontiguousarray(boxes, float)
    if len(boxes) <= AT_ONCE:
        nodes, items = _make_nodes(boxes)
    else:
        tree = _Tree(boxes)
        yield from tree.grow(np.arange(len(boxes)))
        nodes, items = in_lines(np.concatenate(tree.nodes)), np.concatenate(tree.items)

    made = Made(TreeStructure)
    made.point("nodes", nodes, NODE)
    made.point("items", items, np.int32)
    return made, items


def _make_nodes(boxes: Floats) -> tuple[NDArray[np.void], NDArray[np.int32]]:
    """The nodes of a tree over boxes (n, 2, 3), and the box (n,) at each position."""
    nodes = np.empty(len(boxes), NODE)
    items = np.empty(len(boxes), np.int32)
    n_nodes = loaded().kiriko_make_tree(len(boxes), *(a.ctypes.data for a in (boxes, nodes, items)))
    if not n_nodes:
        raise MemoryError
    return in_lines(nodes[:n_nodes]), items


def in_lines(nodes: NDArray[np.void]) -> NDArray[np.void]:
    """A copy of nodes (n,) that begins where a line of the memory does: each fills two."""
    room = np.empty(nodes.nbytes + LINE, np.uint8)
    begin = -room.ctypes.data % LINE
    placed = room[begin : begin + nodes.nbytes].view(NODE)
    placed[:] = nodes
    return placed


def _half_area(box: Floats) -> Floats:
    """Half the surface (...) of boxes (..., 2, 3), 0 of those with nothing in them."""
    x, y, z = np.moveaxis(box[..., 1, :] - box[..., 0, :], -1, 0)
    with np.errstate(invalid="ignore"):
        return np.where(x < 0, 0.0, x * y + y * z + z * x)


def _binned(boxes: Floats, items: Ints) -> Pauses[tuple[NDArray[np.uint8], Ints, Floats, Bools]]:
    """The bins (n, 3) in which the middles of some boxes (n,) lie, along each axis; how many
    there are in each (3, 16), the boxes (3, 16, 2, 3) around them; and which axes (3,) have any.
    """
    blocks = [items[k : k + BLOCK] for k in range(0, len(items), BLOCK)]
    low, high = np.array([[np.inf] * 3, [-np.inf] * 3])
    for block in blocks:
        middle = _middles(taken(boxes, block))
        low = np.minimum(low, middle.min(axis=0))
        high = np.maximum(high, middle.max(axis=0))
        yield 0

    with np.errstate(divide="ignore"):
        scale = BINS / (high - low)

    counts = np.zeros((3, BINS), np.int64)
    around = np.empty((3, BINS, 2, 3))
    around[:, :, 0] = np.inf
    around[:, :, 1] = -np.inf
    bins = []

    for block in blocks:
        some = taken(boxes, block)
        with np.errstate(invalid="ignore"):
            place = (_middles(some) - low) * scale
            bins.append(np.where(place > 0, np.minimum(place, BINS - 1), 0).astype(np.uint8))
        for axis in range(3):
            _sort_in(some, bins[-1][:, axis], counts[axis], around[axis])
        yield 0

    return np.concatenate(bins), counts, around, high > low


def _middles(boxes: Floats) -> Floats:
    return 0.5 * (boxes[:, 0] + boxes[:, 1])


def _box_of(boxes: Floats) -> Floats:
    """The box (2, 3) around boxes (n, 2, 3)."""
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _sort_in(boxes: Floats, bins: NDArray[np.uint8], counts: Ints, around: Floats) -> None:
    """Count boxes (n, 2, 3) in their bins (n,) along an axis,
    and widen what is around those in each.
    """
    found = np.bincount(bins, minlength=BINS)
    there = np.flatnonzero(found)
    start = (np.cumsum(found) - found)[there]
    in_order = taken(boxes, np.argsort(bins, kind="stable"))
    low = np.minimum.reduceat(in_order[:, 0], start)
    high = np.maximum.reduceat(in_order[:, 1], start)
    around[there, 0] = np.minimum(around[there, 0], low)
    around[there, 1] = np.maximum(around[there, 1], high)
    counts += found


def _best_cut(counts: Ints, around: Floats, is_wide: Bools, most: float) -> tuple[int, int]:
    """Axis and bin before which boxes are best parted, by their bins along
    each (3, 16) that is wide; bin 0 where it costs rays no less than `most`.
    """
    before = np.cumsum(counts, axis=1)[:, :-1]
    after = counts.sum(axis=1)[:, None] - before
    areas_before = _half_area(_together(around))[:, :-1]
    areas_after = _half_area(_together(around[:, ::-1]))[:, -2::-1]
    with np.errstate(invalid="ignore"):  # of bins with nothing in them
        cost = before * areas_before + after * areas_after
    cost[~is_wide[:, None] | (before == 0) | (after == 0)] = np.inf
    axis, cut = np.unravel_index(int(cost.argmin()), cost.shape)
    return int(axis), int(cut) + 1 if cost[axis, cut] < most else 0


def _together(around: Floats) -> Floats:
    """Boxes (3, 16, 2, 3) around all bins up to each one."""
    low, high = (
        extreme.accumulate(around[:, :, side], axis=1)
        for side, extreme in enumerate((np.minimum, np.maximum))
    )
    return np.stack([low, high], axis=2)


def _as_left(items: Ints, is_before: Bools) -> Ints:
    """Those of items (n,) that are not before the cut, in the order in which tree.c leaves them.

    It swaps each item before the cut, in turn, with the first one that is not.
    """
    to = np.flatnonzero(is_before)
    n = len(to)
    place = np.flatnonzero(~is_before)
    left = items[place]
    jump = np.append(to, len(items))
    while (place < n).any():
        place = np.where(place < n, jump[np.minimum(place, n)], place)
        jump[:n] = np.where(jump[:n] < n, jump[np.minimum(jump[:n], n)], jump[:n])

    ordered = np.empty_like(left)
    ordered[place - n] = left
    return ordered
