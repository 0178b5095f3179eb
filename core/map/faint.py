"""How many samples is light worth that falls where the display is faint?

A display pixel shows the mean of its light, and is known by the samples that land in it. Where
light is spread thin few do, whatever the picture shows there: that is most of the error of a glass
that spreads light over the whole display. With b the light on a part of the display, relative to
the viewer's image spread evenly over all of it, the variance that a cell adds to all display pixels
alike is the mean of 1 / b^2 over its light, divided by its samples. So the variance of a number of
samples is least where each cell has as many as the root of that mean (Neyman 1934).
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Ints
from ..light.plan import Plan
from .allowance import Allowance
from .cells import columns_of, signed_area
from .points import Points, is_in_image
from .view_map import ViewMap


@dataclass(frozen=True)
class FaintRule:
    """When chaotic cells take more samples than Effort says.

    block_px : display px, side of the parts on which light is summed up
    times : as many samples along a pixel's side, one of these
    most_along : samples along a pixel's side, at the most
    from_share : a cell takes a number of samples from this share of it on that it is worth
    """

    block_px: int = 8
    times: tuple[float, ...] = (1.5, 2.0, 3.0)
    most_along: int = 12
    from_share: float = 0.8


FAINT = FaintRule()


def numbers_along(along: int) -> list[int]:
    """How many samples along a pixel's side faint light may take where other light takes `along`:
    no more than its square, so that little Effort stays fast.
    """
    most = min(along**2, FAINT.most_along)
    return sorted({n for n in (int(times * along) for times in FAINT.times) if along < n <= most})


def light_on_blocks(
    view_map: ViewMap, points: Points, area: Floats
) -> Generator[int, None, Floats]:
    """Light (rows, columns) on blocks of the display, of the pieces of a map and of samples (s,)
    that stand for an area (s,), viewer px^2: 1 where the viewer's image is spread evenly over the
    display. A piece's light lies halfway between its corners and its middle. Pauses on the way.
    """
    width, height = view_map.display_size
    columns, rows = (-(-n // FAINT.block_px) for n in (width, height))
    light = np.zeros(rows * columns)

    def add(xy: Floats, some_area: Floats) -> None:
        is_in = is_in_image(xy, view_map.display_size)
        block = block_of(xy[is_in], columns, rows)
        light[:] += np.bincount(block, some_area[is_in], len(light))

    for piece in view_map.pieces():
        of_piece = np.abs(signed_area(*columns_of(piece.view)))
        corners = np.moveaxis(piece.display, 1, 0)
        middle = corners.mean(axis=0)
        for corner in corners:
            add((corner + middle) / 2, of_piece / len(corners))
        yield 0

    landed = np.flatnonzero(points.branch)
    add(points.xy[landed], area[landed])
    even = view_map.view_size[0] * view_map.view_size[1] / (width * height)
    return light.reshape(rows, columns) / (even * FAINT.block_px**2)


def block_of(xy: Floats, columns: int, rows: int) -> Ints:
    """Numbers (n,) of the blocks of display pixels (n, 2) in the image."""
    column, row = (xy / FAINT.block_px).astype(np.int64).T
    return np.minimum(row, rows - 1) * columns + np.minimum(column, columns - 1)


def samples_worth(
    plan: Plan, light: Floats, points: Points, area: Floats, owner: Ints, n_cells: int
) -> Floats:
    """How many samples (m,) for a viewer pixel cells are worth, by the light (rows, columns) on
    blocks where their samples (s,) landed, each of an area (s,), viewer px^2, and a cell (s,).
    """
    display = plan.rig.display
    is_lit = is_in_image(points.xy, (display.width, display.height)) & (points.branch != 0)
    lit = np.flatnonzero(is_lit)
    block = block_of(points.xy[lit], *light.shape[::-1])
    worth = np.bincount(owner[lit], area[lit] / light.ravel()[block] ** 2, n_cells)
    return plan.settings.samples_along**2 * np.sqrt(worth / np.bincount(owner, area, n_cells))


def more_along(
    worth: Floats, middle: Floats, side: Floats, along: int, allowance: Allowance
) -> Ints:
    """How many samples along a pixel's side cells take in place of `along`, 0 for no others.

    They are worth so many (m,) for a pixel, and have middles (m, 2) and sides (m,), viewer px. The
    rays are taken from the allowance of their pixels.
    """
    found = np.zeros(len(worth), np.int64)
    for n in reversed(numbers_along(along)):
        some = np.flatnonzero((found == 0) & (worth >= FAINT.from_share * n**2))
        n_rays = np.maximum((n * side[some]).astype(np.int64), 1) ** 2
        lacks = allowance.lacks(middle[some], n_rays)
        some = some[~lacks]
        allowance.take(middle[some], n_rays[~lacks])
        found[some] = n
    return found
