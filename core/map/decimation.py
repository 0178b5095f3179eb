"""Triangles that spread far over the display give their light to some of its pixels only.

Where a border lies next to total reflection, a sliver of a viewer pixel is spread over thousands of
display pixels. In hard glass there are so many of these that each display pixel gets light from
hundreds: together a few hundredths of all light, by a hundred times as many shares as all the rest
makes. So a triangle that is a small part of a display pixel's light skips most such pixels, and
gives the others the light of those it skips: the same light in the mean. Where it is a large part
it lights each pixel as exactly as ever.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Ints
from .cells import area_within, columns_of, signed_area
from .dividing import OnDisplay, divided
from .native_divide import Divided
from .shares import index_type


@dataclass(frozen=True)
class ThinningRule:
    """When pixels do without light.

    far_px : display px; a piece that covers fewer does not spread far
    per_pixel : about so many of the pieces that spread over a pixel give it their light
    least_shares : that a piece makes all the same
    block_px : display px; light is added up in blocks of so many each way
    """

    far_px: int = 256
    per_pixel: int = 32
    least_shares: int = 64
    block_px: int = 8


THINNING = ThinningRule()

# a cell is known by its place on the viewer's image, in so many steps a pixel, row by row
STEPS = 1 << 10
ROW = 1 << 31


class Thinning:
    """The light of pieces that spread far, by the part of the display.

    display_size : (width, height), px
    light : (b,) on blocks, row by row, viewer px^2 for each display px^2
    """

    def __init__(self, display_size: tuple[int, int]) -> None:
        self.display_size = display_size
        self._blocks = tuple(-(-n // THINNING.block_px) for n in display_size)
        # the last blocks may reach beyond the display
        width, height = (
            np.minimum(1.0, n / THINNING.block_px - np.arange(blocks))
            for n, blocks in zip(display_size, self._blocks, strict=True)
        )
        self._part_on_display = np.outer(height, width).ravel()
        self.light = np.zeros(len(self._part_on_display))

    def add(self, view: Floats, display: Floats) -> None:
        """Add the light of pieces that may be thinned: polygons (n, k, 2) on the viewer's image and
        on the display, px. All are added before strides are asked for.
        """
        far = np.flatnonzero(self._covered(display) >= THINNING.far_px)
        of_pixel = _light_of(view[far], display[far])
        for number, block, covered in self._by_block(display[far]):
            light = np.bincount(block, covered * of_pixel[number], len(self.light))
            self.light += light / self._part_on_display

    def strides(self, view: Floats, display: Floats) -> Ints:
        """At which distance, px each way, display pixels take the light of pieces, given as
        polygons (n, k, 2): (n,), 1 where all of them do.

        A piece that is a part p of the light lights one pixel in 1 / (per_pixel p). The light of
        a block's pixels is then off by no more than 1 / sqrt(per_pixel) of itself, rms.
        """
        found = np.ones(len(display), np.int64)
        covered = self._covered(display)
        far = np.flatnonzero(covered >= THINNING.far_px)
        # a stride for the whole piece: as its darkest block asks
        least = np.full(len(far), np.inf)
        for number, block, _ in self._by_block(display[far]):
            np.minimum.at(least, number, self.light[block])
        of_pixel = THINNING.per_pixel * _light_of(view[far], display[far])
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.fmin(least / of_pixel, covered[far] / THINNING.least_shares)
        found[far] = np.sqrt(np.maximum(most, 1))
        return found

    def _covered(self, polygons: Floats) -> Floats:
        """Area (n,) of the display that pieces cover, px^2; 0 of those without a place."""
        size = np.prod(self.display_size)
        with np.errstate(invalid="ignore", over="ignore"):
            covered = area_within(*columns_of(polygons), self.display_size)
            return np.where(covered <= size, covered, 0.0)

    def _by_block(self, polygons: Floats) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Number of the piece, block, and the part of the block that it covers, each (m,)."""
        small = polygons / THINNING.block_px
        for _, part in divided([OnDisplay(self._blocks, small, small)], is_numbered=True):
            yield part.number, part.display_index, part.display_area


def _light_of(view: Floats, display: Floats) -> Floats:
    """Viewer px^2 (n,) of triangles or quads for each display px^2 of theirs."""
    with np.errstate(invalid="ignore", over="ignore"):
        areas = (np.abs(signed_area(*columns_of(some))) for some in (view, display))
        return np.divide(*areas)


def in_pixels(part: Divided, view: Floats, stride: int, display_size: tuple[int, int]) -> Divided:
    """Shares of blocks of pixels, stride px each way, as shares of one pixel each.

    It may be any one of the block, as likely as the others, but is the same wherever the cell,
    view (n, k, 2), stands among others: grain that changed with all of them would flicker. What
    falls beside the display is left out.
    """
    width, height = display_size
    row, column = np.divmod(part.display_index.astype(np.int64), -(-width // stride))
    place = np.floor(view.sum(axis=1) * STEPS).astype(np.int64) @ [1, ROW]
    one = _scattered(part.display_index, place[part.number]) % np.uint64(stride * stride)
    down, right = np.divmod(one.astype(np.int64), stride)
    row, column = row * stride + down, column * stride + right
    on = np.flatnonzero((row < height) & (column < width))
    return Divided(
        (row * width + column)[on].astype(index_type(display_size)),
        part.view_xy[on],
        part.covariance[:, on],
        part.area[on],
        part.display_area[on] * stride**2,
        part.number[on],
    )


def _scattered(index: Ints, place: Ints) -> np.ndarray:
    """Numbers (n,) uint64 that look random, of pairs of numbers: the mixing of splitmix64 (Steele,
    Lea and Flood, OOPSLA 2014), of each in turn.
    """
    x = np.zeros(len(index), np.uint64)
    for some in (place, index):
        x += some.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        x ^= x >> np.uint64(31)
    return x
