"""Colours of a picture under footprints of any size and shape.

A footprint is the image of a small part of the viewer's image, approximately a parallelogram. It is
divided into parts, each read at its centre between the picture's pixels. Shares thus have the
picture's full resolution, without blur. Only footprints too large for the number of reads use
smaller sizes of the picture.
"""

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, is_frozen
from ..base.errors import RigError
from ..native import image_passes, loading
from .flat_picture import LEAST
from .picture import POINTS_AT_ONCE, PicturePoints

# A footprint's side, picture px, up to twice this long is read at two places, up to four times at
# four, and a longer one at eight. More reads reduce the source image's error until the map's error
# dominates, and the shape of shares cut by display pixels.
SIDE = 0.9
MOST_READS = 8  # along a side
# range of side lengths beyond two (or four) over which each read splits into two: gradual, so
# rounding moves no read, but short, because the reads nearly coincide until then
APART = 0.25
POINT_SIDE = 0.2  # picture px; a shorter side is a point, and full length is reached at twice this

# signs of the far, near and nearest step of each read along a side, by number of reads
STEPS_BY_NUMBER = {
    1: ((0, 0, 0),),
    2: ((-1, 0, 0), (1, 0, 0)),
    4: tuple((far, near, 0) for far, near in product((-1, 1), repeat=2)),
    8: tuple(product((-1, 1), repeat=3)),
}


@dataclass(frozen=True, eq=False)
class Taps:
    """A sparse matrix from pixels of a pyramid to weighted colours of points, for pictures of one
    size.

    Each row adds four neighbouring pixels of a level to a point.

    point : (m,) int32
    levels : level and slice of each run of rows on one level
    pixel : (m,) int32, the upper left of the four, row * width + column
    weight : (4, m) float32, of the upper left, upper right, lower left and lower right one
    """

    point: NDArray[np.int32]
    levels: tuple[tuple[int, slice], ...]
    pixel: NDArray[np.int32]
    weight: NDArray[np.float32]

    @property
    def n_bytes(self) -> int:
        """Bytes of all taps."""
        return self.point.nbytes + self.pixel.nbytes + self.weight.nbytes


def find_taps(points: PicturePoints, weight: Floats, size: tuple[int, int]) -> Taps:
    """Taps for colours times weight (n,) at points of a picture of a size (width, height).

    Reading level k between its pixels filters with a box of one pixel and a tent of two, a total
    variance of 4^k / 4 - 1 / 12 of the picture's pixels. A footprint is read at full size at as
    many places as its sides need. Beyond the largest number, two smaller levels are mixed so that
    total variance matches the footprint's.
    """
    sizes = _level_sizes(size)
    last = len(sizes) - 1
    found = []
    n_rows = 0
    levels: list[tuple[int, slice]] = []
    seen = np.flatnonzero(weight > 0).astype(np.int32)

    for first in range(0, len(seen), POINTS_AT_ONCE):
        some, x, y, part, variance = reads_of(points, seen[first : first + POINTS_AT_ONCE], weight)
        relative = 1 + 4 * variance
        lower = np.minimum((np.frexp(relative)[1] - 1) // 2, last)
        upper_part = np.clip((np.ldexp(relative, -2 * lower) - 1) / 3, 0, 1) * (lower < last)
        of_upper = part * upper_part
        of_lower = part - of_upper

        for k in range(int(lower.min()), int(lower.max()) + 2):
            here = np.where(lower == k, of_lower, np.where(lower == k - 1, of_upper, 0.0))
            rows = np.flatnonzero(here > 0)
            if len(rows):
                scale_x, scale_y = (new / old for new, old in zip(sizes[k], size, strict=True))
                at = x[rows] * scale_x, y[rows] * scale_y
                found.append((some[rows], *_bilinear(sizes[k], *at, here[rows])))
                levels.append((k, slice(n_rows, n_rows + len(rows))))
                n_rows += len(rows)

    if not found:
        return Taps(np.empty(0, np.int32), (), np.empty(0, np.int32), np.empty((4, 0), np.float32))
    point, pixel, weights = (np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True))
    return Taps(point, tuple(levels), pixel, weights)


def _level_sizes(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Width and height of a picture's full, half, quarter ... size."""
    sizes = [size]
    while max(sizes[-1]) > 1:
        sizes.append(tuple((n + 1) // 2 for n in sizes[-1]))
    return sizes


def _bilinear(
    size: tuple[int, int], x: Floats, y: Floats, weight: Floats
) -> tuple[NDArray, NDArray]:
    """Upper left pixel (n,) and weights (4, n), times weight, for bilinear reads: centres at + 0.5,
    edges extended.
    """
    w, h = size
    x = np.clip(x - 0.5, 0, w - 1)
    y = np.clip(y - 0.5, 0, h - 1)
    column = np.minimum(x.astype(np.int32), max(w - 2, 0))
    row = np.minimum(y.astype(np.int32), max(h - 2, 0))
    x -= column

    lower = weight * (y - row)
    upper = weight - lower
    upper_right = upper * x
    lower_right = lower * x
    weights = np.empty((4, len(x)), np.float32)
    weights[0] = upper - upper_right
    weights[1] = upper_right
    weights[2] = lower - lower_right
    weights[3] = lower_right

    return row * np.int32(w) + column, weights


class Pyramid:
    """A picture at full, half, quarter ... size, to read footprints of any size.

    levels : (h, w, 4) float32 each, with contiguous rows; the fourth channel is unused
    """

    def __init__(self, image: NDArray[np.float32]) -> None:
        """Build all levels of an image (h, w, 4), linear, premultiplied."""
        if image.ndim != 3 or min(image.shape[:2]) < 1:
            raise RigError("The picture has no pixels: choose an image.")
        self._frozen = weakref.ref(image) if is_frozen(image) else None
        self.levels = [_in_rows(image, is_fixed=self._frozen is not None)]
        while max(self.levels[-1].shape[:2]) > 1:
            self.levels.append(_halved(self.levels[-1]))

    def is_of(self, image: NDArray[np.float32]) -> bool:
        """Whether it was built from an image equal to this one."""
        if self._frozen is not None and self._frozen() is image:
            return True
        own = self.levels[0]
        if own.shape[:2] != image.shape[:2] or not np.array_equal(own[0, :, :3], image[0, :, :3]):
            return False  # most others differ in the first row
        # contiguous comparison first, six times as fast: most pictures have 1 in the fourth
        # channel, too
        return np.array_equal(own, image) or np.array_equal(own[..., :3], image[..., :3])

    @cached_property
    def _first_in_order(self) -> NDArray[np.float32]:
        """The full size, copied if its rows are reversed in memory."""
        return np.ascontiguousarray(self.levels[0])

    def read(self, taps: Taps) -> NDArray[np.float32]:
        """The linear colour (3, m), over black, added to its point by each row of taps (m,)."""
        values = np.zeros((3, len(taps.pixel)), np.float32)
        for k, rows in taps.levels:
            level = self._first_in_order if k == 0 else self.levels[k]
            h, w, n = level.shape
            right = n * int(w > 1)
            below = n * w * int(h > 1)
            steps = (0, right, below, right + below)
            at = taps.pixel[rows].astype(np.intp) * n
            numbers = level.reshape(-1)

            for channel, value in enumerate(values[:, rows]):
                for step, weight in zip(steps, taps.weight[:, rows], strict=True):
                    value += numbers[step + channel :].take(at) * weight
        return values

    def sample(self, points: PicturePoints) -> Floats:
        """Linear colours (n, 3) at points, over black."""
        taps = find_taps(points, points.cover, self.levels[0].shape[1::-1])
        n = len(points.xy)
        return np.stack([np.bincount(taps.point, value, n) for value in self.read(taps)], axis=1)


def _in_rows(image: NDArray[np.float32], is_fixed: bool) -> NDArray[np.float32]:
    """An image (h, w, n) as four channels with contiguous rows: the same array if it has this form
    and is read-only (is_fixed).
    """
    is_in_rows = image.dtype == np.float32 and image.shape[2] == 4 and image.strides[1:] == (16, 4)
    if is_fixed and is_in_rows:
        return image
    pixels = np.empty((*image.shape[:2], 4), np.float32)
    pixels[..., :3] = image[..., :3]
    pixels[..., 3] = 1.0
    return pixels


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half the size of an image (h, w, 4) by exact area means.

    Odd rows or columns are split between their neighbours.
    """
    h, w, n = image.shape
    if loading.library() is not None and not (h % 2 or w % 2):  # bit-identical
        return image_passes.halved(image)
    halved = np.empty(((h + 1) // 2, (w + 1) // 2, n), np.float32)
    # one channel at a time needs a third of the memory
    for channel in range(n):
        halved[..., channel] = _halved_along(1, _halved_along(0, image[..., channel]))
    return halved


def _halved_along(axis: int, plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half as many rows (axis 0) or columns (1) of a plane (h, w)."""
    n = plane.shape[axis]
    if n == 1:
        return plane
    if n % 2 == 0:  # the same result, many times as fast
        even, odd = (plane[k::2] if axis == 0 else plane[:, k::2] for k in (0, 1))
        return np.float32(0.5) * (even + odd)

    # cumulative sum at an edge: full rows before it, and a fraction of the row across it
    m = (n + 1) // 2
    edges = np.linspace(0, n, m + 1)
    total = np.insert(np.cumsum(plane, axis=axis, dtype=float), 0, 0, axis=axis)
    whole = np.minimum(edges.astype(int), n - 1)
    part = (edges - whole).reshape([-1, 1] if axis == 0 else [1, -1])
    at = np.take(total, whole, axis=axis) + part * np.take(plane, whole, axis=axis)
    return (np.diff(at, axis=axis) * (m / n)).astype(np.float32)


def pyramids_of(
    images: Sequence[NDArray[np.float32]], existing: Sequence[Pyramid] = ()
) -> tuple[Pyramid, ...]:
    """A pyramid for each image (h, w, 4), shared by identical arrays; existing ones are reused."""
    found: dict[int, Pyramid] = {}
    for image in images:
        if id(image) not in found:
            matches = (one for one in existing if one.is_of(image))
            found[id(image)] = next(matches, None) or Pyramid(image)
    return tuple(found[id(image)] for image in images)


class FootprintReads(NamedTuple):
    """Reads of footprints, one row (r,) for each place.

    number : of the point
    x, y : picture px
    weight : (r,)
    variance : along each axis, picture px^2
    """

    number: NDArray[np.int32]
    x: Floats
    y: Floats
    weight: Floats
    variance: Floats


class _Side(NamedTuple):
    """Reads along one side of footprints.

    number : (n,) of places, 1, 2, 4 or 8
    steps : far, near and nearest (n,), in standard deviations: from the centre to each half, from
        there to each quarter, and to each eighth
    """

    number: NDArray[np.integer]
    steps: tuple[Floats, Floats, Floats]


def reads_of(points: PicturePoints, some: NDArray[np.int32], weight: Floats) -> FootprintReads:
    """Reads of some points.

    Reads separate gradually, so rounding a footprint only moves its reads by rounding errors.
    """
    x = points.xy[some, 0]
    y = points.xy[some, 1]
    part = weight[some]
    axes = points.axes[:, some]
    sides = [np.sqrt(12 * (axes[k] * axes[k] + axes[k + 1] * axes[k + 1])) for k in (0, 2)]
    first, second = (_along(side) for side in sides)

    left = _left_to_levels(axes, np.minimum(*sides))
    rows = np.flatnonzero(left > 0)
    axes[:, rows] = _without(axes[:, rows], left[rows])

    found = []
    for n, m in product(STEPS_BY_NUMBER, repeat=2):
        rows = np.flatnonzero((first.number == n) & (second.number == m))
        if len(rows) == 0:
            continue
        steps_along, steps_across = (
            [
                sum(sign * step[rows] for sign, step in zip(signs, side.steps, strict=True))
                for signs in STEPS_BY_NUMBER[number]
            ]
            for side, number in ((first, n), (second, m))
        )
        first_x, first_y, second_x, second_y = axes[:, rows]
        for i, j in product(steps_along, steps_across):
            at = x[rows] + i * first_x + j * second_x, y[rows] + i * first_y + j * second_y
            found.append((some[rows], *at, part[rows] / (n * m), left[rows]))
    return FootprintReads(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _along(side: Floats) -> _Side:
    """Reads along sides (n,), picture px: as many as they need, with the sides' variance."""
    two = np.clip(side / POINT_SIDE - 1, 0, 1)
    relative = side / SIDE
    four = np.clip((relative - 2) / APART, 0, 1)
    eight = np.clip((relative / 2 - 2) / APART, 0, 1)
    far = np.sqrt(two / (1 + four * four / 4 + eight * eight / 16))
    number = np.where(eight > 0, 8, np.where(four > 0, 4, np.where(two > 0, 2, 1)))
    return _Side(number, (far, four * far / 2, eight * far / 4))


def _left_to_levels(axes: Floats, shorter: Floats) -> Floats:
    """Variance (n,) along each axis left to smaller sizes of the picture, for each of the most
    reads.

    For footprints with axes (4, n) and a shorter side (n,).
    """
    each = shorter / MOST_READS
    left = np.maximum(each * each - SIDE * SIDE, 0) / 12
    # limited to the variance in the footprint's narrowest direction, which differs from its sides
    # if they are oblique
    first_x, first_y, second_x, second_y = axes
    area = first_x * second_y - first_y * second_x
    most = 0.75 * area * area / np.maximum((axes * axes).sum(axis=0), LEAST)
    return np.minimum(left, most)


def _without(axes: Floats, left: Floats) -> Floats:
    """Axes (4, n) of footprints with the variance `left` removed along each axis of the picture.

    With L the axes, as a matrix, L L' - left = L K L' with K = 1 - left (L' L)^-1, so the result is
    L times the triangular root of K.
    """
    first_x, first_y, second_x, second_y = axes
    area = first_x * second_y - first_y * second_x
    scale = left / (area * area)
    k = 1 - scale * (second_x * second_x + second_y * second_y)
    askew = scale * (first_x * second_x + first_y * second_y)
    reach = np.sqrt(k)
    along = askew / reach
    across = np.sqrt(1 - scale * (first_x * first_x + first_y * first_y) - along * along)
    return np.stack([
        *(reach * first_x + along * second_x, reach * first_y + along * second_y),
        *(across * second_x, across * second_y),
    ])  # fmt: skip
