"""Stratified samples of chaotic light, each for the area around it in a viewer pixel.

A pixel has along^2 strata, and a ray through a random place in each: with n of them the error of a
mean falls as 1 / n at best, and as 1 / sqrt(n) at worst, as with random rays. Cells and bisection
would have no end there. Cells whose light falls on faint parts of the display take further samples,
and all samples of a cell count alike. On the display each lights a square (pieces.py).

A display pixel shows the mean of its light, estimated from the samples that land in it. Few land
where light is spread thin: this is most of the error of a glass that spreads light over the whole
display. Let b be the light on a part of the display, relative to the viewer's image spread evenly
over all of it. The variance a cell adds to all display pixels is the mean of 1 / b^2 over its
light, divided by its samples. For a total number of samples it is least if each cell's number is
proportional to the root of this mean (Neyman 1934).

A cell's number of samples must not depend on its own samples, or the estimate is biased: a cell
with a chance hit on a faint place would average it away, and light would be lost. So viewer pixels
are coloured as a chessboard is, and cells of one colour are rated by samples of the other, both
where light goes around them and how much there is on the display. Each cell's light is then right
on average, for any rule.
"""

from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints, take, whole_within
from ..base.free_memory import check_free
from ..base.messages import Message
from ..light.plan import Plan
from ..light.rays import Reason
from .cells import signed_area
from .points import BYTES_OF_POINT, Points, is_in_image, trace_points
from .ray_budget import RayBudget
from .view_map import QUADS_AT_ONCE, ViewMap

BLOCK_PX = 8  # display px, side of the blocks on which light is summed up
TIMES = (1.0, 1.5)  # ratios of further samples to the first ones, along a pixel's side
MOST_ALONG = 12  # further samples along a pixel's side
# least chaotic share of the view worth the time to sum up light for further samples
LEAST_SHARE = 0.001

# pixels of the other colour, at most two columns and rows away
AROUND = [(x, y) for x, y in product(range(-2, 3), repeat=2) if (x + y) % 2]
TINY = 1e-300  # viewer px^2: avoids divisions by 0


def numbers_along(along: int) -> list[int]:
    """Possible numbers of further samples along a pixel's side for faint light, added to the
    `along` of all chaotic light.
    """
    numbers = {int(times * along) for times in TIMES}
    return sorted(n for n in numbers if n <= MOST_ALONG)


def may_take_more(plan: Plan, area: float) -> bool:
    """Whether chaotic light with an area in viewer px^2 may take further samples."""
    whole = plan.viewer.width * plan.viewer.height
    return area >= LEAST_SHARE * whole and bool(numbers_along(plan.settings.samples_along))


def light_on_blocks(view_map: ViewMap) -> Generator[int, None, Floats]:
    """Light (b,), viewer px^2, of the pieces of a map on blocks of the display, row by row. With
    pauses.

    Light of quads of smooth cells, which are small, counts at their middle; of other pieces halfway
    between their middle and their corners.
    """
    light = np.zeros(np.prod(_blocks(view_map.display_size)))

    def add(display: Floats, area: Floats) -> None:
        is_in = is_in_image(display, view_map.display_size)
        # pieces outside the image go to a block of their own: to pick the others takes longer
        block = np.where(is_in, _block_of(display, view_map.display_size), len(light))
        light[:] += np.bincount(block, area, len(light) + 1)[:-1]

    cut = (view_map.quads, view_map.triangles)
    smooth = replace(view_map, quads=cut[0][:0], triangles=cut[1][:0])
    for quads in smooth.pieces(sampled=False):
        width, height = (quads.view[:, 2] - quads.view[:, 0]).T
        add((quads.display[:, 0] + quads.display[:, 2]) / 2, width * height)
        yield 0

    for kind in cut:
        requested = kind[~view_map.is_past_glass(kind[:, 0])]
        for first in range(0, len(requested), QUADS_AT_ONCE):
            corners = requested[first : first + QUADS_AT_ONCE].T
            view, display = (
                np.stack([take(places, corner) for corner in corners])
                for places in (view_map.points.view, view_map.points.xy)
            )
            middle = display.mean(axis=0)
            area = np.abs(signed_area(*np.moveaxis(view, 2, 0))) / len(corners)
            for corner in display:
                add((corner + middle) / 2, area)
            yield 0
    return light


def samples_worth(
    plan: Plan, light: Floats, points: Points, area: Floats, owner: Ints, middle: Floats
) -> Generator[int, None, Floats]:
    """Samples (m,) for a viewer pixel worth taking in chaotic cells with middles (m, 2), viewer px;
    with pauses.

    light : (b,) of all but the samples, on blocks, viewer px^2
    points, area, owner : samples (s,) of the cells, the area, viewer px^2, each represents, and its
        cell's number
    """
    viewer, display = plan.viewer, plan.rig.display
    size = (display.width, display.height)
    even = viewer.width * viewer.height * BLOCK_PX**2 / (display.width * display.height)
    is_lit = is_in_image(points.xy, size) & (points.branch != 0)
    is_lit &= points.reason != Reason.MISSED_GLASS

    row_length = viewer.width + 2  # a pixel on the left is not mistaken for one on the right
    number = np.floor(middle).astype(np.int64) @ [1, row_length]
    pixels, of_cell = np.unique(number, return_inverse=True)
    of_sample = of_cell[owner]
    is_black = np.sum(np.divmod(pixels, row_length), axis=0) % 2 == 0
    yield 0

    worth = np.zeros(len(pixels))
    for is_rated in (is_black, ~is_black):
        rates = ~is_rated[of_sample]
        lit = np.flatnonzero(rates & is_lit)
        block = _block_of(points.xy[lit], size)

        # all light, if the others' samples are like these
        times = area.sum() / max(area[rates].sum(), TINY)
        on_block = light + np.bincount(block, times * area[lit], len(light))

        # sums over pixels, and over the pixels around each
        of_light = area[lit] * (even / on_block[block]) ** 2
        sums = np.bincount(of_sample[lit], of_light, len(pixels))
        areas = np.bincount(of_sample[rates], area[rates], len(pixels))
        around = np.zeros((2, int(is_rated.sum())))
        for x, y in AROUND:
            requested = pixels[is_rated] + x + y * row_length
            at = np.minimum(np.searchsorted(pixels, requested), len(pixels) - 1)
            around += np.where(pixels[at] == requested, [sums[at], areas[at]], 0.0)
        worth[is_rated] = around[0] / np.maximum(around[1], TINY)
        yield 0
    return plan.settings.samples_along**2 * np.sqrt(worth[of_cell])


def further_along(
    worth: Floats, middle: Floats, side: Floats, along: int, budget: RayBudget
) -> Ints:
    """Further samples (m,) along a pixel's side of cells, besides `along`, 0 for none: the largest
    number within their worth.

    worth : (m,) samples for a pixel
    middle, side : (m, 2), (m,) viewer px
    budget : the rays are taken from the budget of their pixels
    """
    found = np.zeros(len(worth), np.int64)
    for n in reversed(numbers_along(along)):
        some = np.flatnonzero((found == 0) & (worth >= along**2 + n**2))
        n_rays = np.maximum((n * side[some]).astype(np.int64), 1) ** 2
        exceeds = budget.exceeds(middle[some], n_rays)
        some = some[~exceeds]
        budget.take(middle[some], n_rays[~exceeds])
        found[some] = n
    return found


def _blocks(display_size: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of the blocks of a display."""
    columns, rows = (-(-n // BLOCK_PX) for n in display_size)
    return columns, rows


def _block_of(display: Floats, display_size: tuple[int, int]) -> Ints:
    """Numbers (n,) of the blocks at display px (n, 2) in the image, its far borders included."""
    columns, rows = _blocks(display_size)
    column, row = whole_within(display / BLOCK_PX, (columns - 1, rows - 1))
    return row * columns + column


TILE_CELLS = 64  # cells each way, after which the random places repeat
MOST_JITTER = 1024  # random places each way, in all cells of a tile


class Samples(NamedTuple):
    """Samples (s,) of chaotic cells, including samples without a landing.

    area : viewer px^2 each represents
    reach : viewer px, side of its stratum
    """

    points: Points
    area: Floats
    reach: Floats


def sample_cells(
    plan: Plan, view_map: ViewMap, corners: Floats, budget: RayBudget | None
) -> Generator[int, None, Samples]:
    """Trace samples of square cells with corners (m, 4, 2), viewer px; yields the number of rays
    traced since.

    view_map : all but the samples
    budget : ray budget for further samples of faint light; None for none

    Raises
    ------
    RigError : not enough free memory
    """
    if not len(corners):
        return Samples(Points.none(), np.empty(0), np.empty(0))

    along = plan.settings.samples_along
    _check_memory(plan, n_strata(corners, along))
    places, area = strata(corners, along)
    points = yield from trace_points(plan, places)
    samples = Samples(points, area, np.sqrt(area))

    whole = _sides(corners) ** 2
    if budget is None or not may_take_more(plan, float(whole.sum())):
        return samples

    owner = _cells_of(corners, along)
    middle = corners.mean(axis=1)
    light = yield from light_on_blocks(view_map)
    worth = yield from samples_worth(plan, light, points, area, owner, middle)
    more = further_along(worth, middle, _sides(corners), along, budget)
    requested = [(n, np.flatnonzero(more == n)) for n in np.unique(more[more > 0])]
    if not requested:
        return samples

    # new random numbers: those before have decided on the cells
    n_rays = sum(n_strata(corners[cells], n) for n, cells in requested)
    _check_memory(plan, len(points) + n_rays)
    parts = [strata(corners[cells], n, seed=1) for n, cells in requested]
    places, area = map(np.concatenate, zip(*parts, strict=True))
    found = yield from trace_points(plan, places)

    # all samples of a cell count alike
    of_found = [cells[_cells_of(corners[cells], n)] for n, cells in requested]
    owner = np.concatenate([owner, *of_found])
    yield 0
    share = whole / np.bincount(owner, minlength=len(whole))
    reach = np.append(samples.reach, np.sqrt(area))
    yield 0
    points = points.and_more(found)
    yield 0
    return Samples(points, share[owner], reach)


def _check_memory(plan: Plan, n_rays: int) -> None:
    viewer = plan.viewer
    effort = plan.settings.effort
    check_free(
        BYTES_OF_POINT * n_rays,
        Message("Sampling where light is chaotic"),
        Message(
            "lower Effort ({effort}), or {remedy}",
            effort=effort,
            remedy=Message(
                "lower the resolution of the viewer '{viewer}' ({viewer_width} x {viewer_height})",
                viewer=viewer.name,
                viewer_width=viewer.width,
                viewer_height=viewer.height,
            ),
        ),
    )


def strata(corners: Floats, along: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Random places (s, 2), one in each stratum of square cells (m, 4, 2), and the strata's areas
    (s,), viewer px.

    A pixel has `along` strata along its side, a smaller cell its part of them, or one. Places
    within a stratum are the same in each solve, for a view of any size: changing noise would
    flicker. Another seed has others.
    """
    places = [np.empty((0, 2))]
    area = [np.empty(0)]
    for side, k, cells in _by_side(corners, along):
        first = corners[cells, 0]
        stratum = np.stack(np.meshgrid(np.arange(k), np.arange(k)), axis=-1).reshape(-1, 2)

        tile = max(1, min(TILE_CELLS, MOST_JITTER // k))
        jitter = np.random.default_rng(seed).random((tile, tile, k * k, 2))
        column, row = (first / side).astype(np.int64).T % tile

        at = first[:, None] + side / k * (stratum + jitter[row, column])
        places.append(at.reshape(-1, 2))
        area.append(np.full(len(first) * k * k, (side / k) ** 2))

    return np.concatenate(places), np.concatenate(area)


def n_strata(corners: Floats, along: int) -> int:
    """Number of strata of square cells (m, 4, 2)."""
    return sum(k * k * len(cells) for _, k, cells in _by_side(corners, along))


def _cells_of(corners: Floats, along: int) -> Ints:
    """Cell (s,), by number, of each stratum of cells (m, 4, 2)."""
    numbers = [np.repeat(cells, k * k) for _, k, cells in _by_side(corners, along)]
    return np.concatenate([np.empty(0, np.int64), *numbers])


def _by_side(corners: Floats, along: int) -> Iterator[tuple[float, int, Ints]]:
    """Sides of cells (m, 4, 2), viewer px, the number of strata along each, and the cells (c,)."""
    sides = _sides(corners)
    for side in np.unique(sides):
        yield float(side), max(1, int(along * side)), np.flatnonzero(sides == side)


def _sides(corners: Floats) -> Floats:
    return corners[:, 1, 0] - corners[:, 0, 0]
