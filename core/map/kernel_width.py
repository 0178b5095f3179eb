"""Over how much of the display is the light of samples spread?

A sample stands for all light of its stratum, of which it knows one landing. Where samples land far
apart, and from all over the view, a display pixel would show the colours of the few that happen to
land in it, or nothing. So each lights a square around its landing, as wide as it takes for some of
them to light each place: an estimate of density by nearest neighbours (Loftsgaarden and Quesenberry
1965; Silverman 1986, chapter 5). Light is moved by half a width at the most, and none is lost.

Where samples that land close together come from close together, as through facets that show parts
of the picture side by side, their colours are to be told apart, not mixed. That is known by the
variance of their places on the view: within small blocks of the display it is less than in large
ones there, and the same where light is mixed. There, and where next to none land, each sample
lights the pixel that it lands in.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Ints, each_once, taken, whole_within
from ..base.steps import Pauses
from .points import is_in_image


@dataclass(frozen=True)
class WidthRule:
    """How wide the squares are.

    together : about so many samples light a place where light is mixed
    most_px : display px, the side of the largest blocks and of the widest squares, a power of two
    least_px : display px, of samples that light their pixel alone
    mixed : light is, where the variance in smaller blocks is at least so many times that in a large
        one
    least_free : of fewer degrees of freedom no variance is known
    """

    together: int = 16
    most_px: int = 16
    least_px: float = 0.25
    mixed: float = 0.7
    least_free: int = 8


WIDTHS = WidthRule()
SAMPLES_AT_ONCE = 1 << 16  # between two pauses, or those of one of the largest blocks
KEYS = 1 << 16  # numpy sorts numbers below this in time that goes with how many they are


def widths(view: Floats, xy: Floats, display_size: tuple[int, int]) -> Pauses[Floats]:
    """Sides (s,), display px, of the squares over which samples at viewer px (s, 2) that land at
    display px (s, 2) are spread; 0 for those that land beside the display or nowhere.
    """
    found = np.zeros(len(xy))
    lit = np.flatnonzero(is_in_image(xy, display_size))
    found[lit] = WIDTHS.least_px
    yield 0

    # where fewer land no block has as many as are asked for
    large = _large_block(taken(xy, lit), display_size)
    has_many = np.bincount(large)[large] >= WIDTHS.together
    lit, large = lit[has_many], large[has_many]
    yield 0

    # the largest blocks have nothing to do with each other
    for some in _parts(large):
        yield 0
        which = lit[some]
        found[which] = _widths_in(large[some], taken(view, which), taken(xy, which), display_size)
    return found


def _large_block(xy: Floats, display_size: tuple[int, int]) -> Ints:
    """Numbers (s,) of the largest blocks, row by row, of display px (s, 2) in the image."""
    columns, rows = display_size
    column, row = whole_within(xy, (columns - 1, rows - 1))
    return row // WIDTHS.most_px * -(-columns // WIDTHS.most_px) + column // WIDTHS.most_px


def _parts(block: Ints) -> list[Ints]:
    """Samples in blocks (s,), by number, in parts, each of all samples of some blocks."""
    key = (block % KEYS).astype(np.uint16)
    n_until = np.cumsum(np.bincount(key))
    ends = np.searchsorted(n_until, np.arange(SAMPLES_AT_ONCE, len(block), SAMPLES_AT_ONCE))
    return np.split(np.argsort(key, kind="stable"), n_until[np.unique(ends)])


def _widths_in(large: Ints, view: Floats, xy: Floats, display_size: tuple[int, int]) -> Floats:
    """Sides (s,), display px, of the squares of all samples that land in some of the largest
    blocks (s,).
    """
    columns, rows = display_size
    place = whole_within(xy, (columns - 1, rows - 1))
    large = each_once(large)[1]

    width = np.full(len(xy), WIDTHS.least_px)
    most = np.full(len(xy), float(WIDTHS.most_px))
    least_variance = WIDTHS.mixed * _variance(view, large, large)
    side = WIDTHS.most_px
    while side:
        # of ever smaller blocks around the landing the smallest that has so many
        block = _blocks(place, side, large)
        n = np.bincount(block)[block]
        has_many = n >= WIDTHS.together
        area = _area(place, side, display_size)[has_many]
        width[has_many] = np.sqrt(area * WIDTHS.together / n[has_many])

        most[(_variance(view, block, large) < least_variance)[large]] = side / 2
        side //= 2

    width = np.minimum(width, most)
    return np.where(width > 0.5, np.minimum(width, min(display_size)), WIDTHS.least_px)


def _blocks(place: tuple[Ints, Ints], side: int, large: Ints) -> Ints:
    """Numbers (s,) of the blocks of pixels (s,), by column and row, that lie in large ones (s,)."""
    column, row = (along % WIDTHS.most_px // side for along in place)
    along = WIDTHS.most_px // side
    return (large * along + row) * along + column


def _area(place: tuple[Ints, Ints], side: int, display_size: tuple[int, int]) -> Ints:
    """Display px (s,) of the blocks of pixels (s,): the last ones may reach beyond the display."""
    wide, high = (
        np.minimum(side, n - along // side * side)
        for along, n in zip(place, display_size, strict=True)
    )
    return wide * high


def _variance(view: Floats, block: Ints, large: Ints) -> Floats:
    """Of viewer px (s, 2) within blocks (s,), of all blocks in each large one (l,), by the numbers
    (s,) of these; NaN where it is not known.
    """
    n = np.maximum(np.bincount(block), 1)
    squared = sum((along - (np.bincount(block, along) / n)[block]) ** 2 for along in view.T)
    # a block of n samples has n - 1 degrees of freedom
    free = np.bincount(large, 1 - 1 / n[block])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(free > WIDTHS.least_free - 0.5, np.bincount(large, squared) / free, np.nan)
