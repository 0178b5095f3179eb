"""At which places of a picture is a footprint read?

A footprint is the image of a small part of the viewer's image: about a parallelogram. It is divided
into parts, which are read at their middles between the picture's pixels. So a share is read as
finely as the picture is, and nothing of the picture is made blurred. Only footprints of more pixels
than are read leave a rest to smaller sizes of the picture (pyramid.py). The tolerance says how many
reads a footprint is worth (`reads_at`).
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from .flat_picture import LEAST
from .picture import PicturePoints


@dataclass(frozen=True)
class Reads:
    """Into how many parts footprints are divided, each of which is read at its middle.

    The error of a source image falls with them until what is left is that of the map, and the shape
    of shares that the border of a display pixel cut.

    Parameters
    ----------
    side : picture px; up to twice as long a side is read at two places, up to four times as long at
        four, a longer one at eight
    apart : sides beyond two over which each of two places becomes two, and twice as many beyond
        four: gradually, but soon, for until then they read nearly the same
    point_side : picture px; a shorter side is a point, and one of twice as much as long as it is
    most_reads : along a side, 4 or 8
    """

    side: float = 0.9
    apart: float = 0.25
    point_side: float = 0.2
    most_reads: int = 8


READS = Reads()
COARSE_SIDE = 1.0  # in place of side, and of most_reads, where coarse reads are enough
COARSE_READS = 4
FINE_TOLERANCE_PX = 0.2  # display px: from here on coarse reads are enough

# signs of the far, the near and the nearest step of each read along a side, by their number
STEPS_BY_NUMBER = {
    1: ((0, 0, 0),),
    2: ((-1, 0, 0), (1, 0, 0)),
    4: tuple((far, near, 0) for far, near in product((-1, 1), repeat=2)),
    8: tuple(product((-1, 1), repeat=3)),
}


def reads_at(tolerance: float) -> Reads:
    """The reads that a tolerance, display px, is worth."""
    if tolerance < FINE_TOLERANCE_PX:
        return READS
    return replace(READS, side=COARSE_SIDE, most_reads=COARSE_READS)


class FootprintReads(NamedTuple):
    """Where footprints are read, a row (r,) for each place.

    number : of the point; x, y : picture px; weight; variance : along each axis, picture px^2
    """

    number: NDArray[np.int32]
    x: Floats
    y: Floats
    weight: Floats
    variance: Floats


class _Side(NamedTuple):
    """How footprints are read along a side of theirs.

    number : (n,) of places, 1, 2, 4 or 8
    steps : far, near and nearest (n,), standard deviations: from the middle to each half of them,
        from there to each quarter, and to each of eight
    """

    number: NDArray[np.integer]
    steps: tuple[Floats, Floats, Floats]


def reads_of(
    points: PicturePoints, some: NDArray[np.int32], weight: Floats, reads: Reads
) -> FootprintReads:
    """Where some points are read.

    Reads come apart gradually, so that a footprint that rounding changes is read at the same places
    but for rounding.
    """
    x = points.xy[some, 0]
    y = points.xy[some, 1]
    part = weight[some]
    axes = points.axes[:, some]
    sides = [np.sqrt(12 * (axes[k] * axes[k] + axes[k + 1] * axes[k + 1])) for k in (0, 2)]
    first, second = (_along(side, reads) for side in sides)

    left = _left_to_levels(axes, np.minimum(*sides), reads)
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


def _along(side: Floats, reads: Reads) -> _Side:
    """How sides (n,), picture px, are read: as many places as they need, with their variance."""
    two = np.clip(side / reads.point_side - 1, 0, 1)
    relative = side / reads.side
    four = np.clip((relative - 2) / reads.apart, 0, 1)
    eight = np.clip((relative / 2 - 2) / reads.apart, 0, 1) * (reads.most_reads > 4)
    far = np.sqrt(two / (1 + four * four / 4 + eight * eight / 16))
    number = np.where(eight > 0, 8, np.where(four > 0, 4, np.where(two > 0, 2, 1)))
    return _Side(number, (far, four * far / 2, eight * far / 4))


def _left_to_levels(axes: Floats, shorter: Floats, reads: Reads) -> Floats:
    """The variance (n,) along each axis that smaller sizes of the picture add to each of the most
    reads, of footprints with axes (4, n) and a shorter side (n,).
    """
    each = shorter / reads.most_reads
    left = np.maximum(each * each - reads.side * reads.side, 0) / 12
    # no more than the footprint has in its narrowest direction, which is not that of its sides
    # where they are askew
    first_x, first_y, second_x, second_y = axes
    area = first_x * second_y - first_y * second_x
    most = 0.75 * area * area / np.maximum((axes * axes).sum(axis=0), LEAST)
    return np.minimum(left, most)


def _without(axes: Floats, left: Floats) -> Floats:
    """Axes (4, n) of footprints that have less variance, along each axis of the picture.

    With L the axes, as a matrix, L L' - left is L K L' with K = 1 - left (L' L)^-1, and L times the
    triangular root of K has it.
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
