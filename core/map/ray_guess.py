"""About how many rays a view map takes, for the progress alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Ints
from .interpolation import CHECKS, PARTS
from .points import Points
from .squares import Squares


@dataclass(frozen=True)
class SquareRays:
    """Numbers of rays, for the progress alone.

    of_square : about as many as a square of each size takes
    of_pixel, of_flat_pixel : and a pixel of the finest; where all glass is flat
    quartered, refused : shares of squares, of the smallest ones, that are expected at the least
    more : times the rays so far, there are always some to come
    """

    of_square: float = 16
    of_pixel: float = 12
    of_flat_pixel: float = 5
    quartered: float = 0.6
    refused: float = 0.5
    more: float = 1.02


SQUARE_RAYS = SquareRays()


@dataclass(frozen=True)
class CutRays:
    """Numbers of rays for the progress alone, by how often cells have been
    quartered; medians of the glasses of `dev.py glasses`.

    of_edge : that it takes to look for the border on an edge
    neighbours : cells that share an edge, on average
    of_quarter : all told, of a quarter or one of the triangles that are cut at the end
    quarters : of a cell, before anything is known of it
    mixed_again : share of mixed cells, which are quartered, where the glass is not flat
    """

    of_edge: tuple[float, ...] = (11.5, 7.0, 4.0, 8.0)
    neighbours: float = 1.8
    of_quarter: tuple[float, ...] = (5.6, 3.2, 0.6, 0.0)
    quarters: tuple[float, ...] = (1.2, 0.95, 1.3)
    mixed_again: float = 0.35


CUT_RAYS = CutRays()


def rays_of_squares(
    n_traced: int, todo: Squares, checking: Squares, refused: float, finest: float, is_flat: bool
) -> float:
    """Those traced, and of squares to be traced, or checked, and of those that come of them.

    Such a share is refused. finest : px^2, of pixels of the finest squares before;
    is_flat : all glass is flat
    """
    n_rays = float(n_traced + len(CHECKS) * len(checking))
    share = max(refused, SQUARE_RAYS.quartered)

    # squares of all sizes, each time a share of them is refused
    size = max(int(squares.size.max(initial=PARTS)) for squares in (todo, checking))
    area = 0.0

    while size > PARTS:
        area += float((todo.size == size).sum()) * size**2
        n_rays += SQUARE_RAYS.of_square * area / size**2
        area = share * (area + float((checking.size == size).sum()) * size**2)
        size //= 2

    # pixels of the smallest
    area += float((todo.size == PARTS).sum() + (checking.size == PARTS).sum()) * PARTS**2
    of_pixel = SQUARE_RAYS.of_flat_pixel if is_flat else SQUARE_RAYS.of_pixel
    return n_rays + of_pixel * (max(refused, SQUARE_RAYS.refused) * area + finest)


def rays_of_cut(
    points: Points,
    cells: Ints,
    chaotic: Sequence[Ints],
    depth: int,
    n_quarters: float,
    effort: int,
) -> float:
    """To find the borders in cells (m, k), quartered so often, then to cut so many quarters,
    and to sample chaotic cells (c, 4).
    """
    branch = points.branch[cells]
    n_edges = (branch != np.roll(branch, -1, axis=1)).sum() / CUT_RAYS.neighbours
    sides = [points.view[corners[:, 1], 0] - points.view[corners[:, 0], 0] for corners in chaotic]
    n_samples = effort * sum((side**2).sum() for side in sides)
    return CUT_RAYS.of_edge[depth] * n_edges + CUT_RAYS.of_quarter[depth] * n_quarters + n_samples
