"""Is a pixel cut well, or in doubt? By a ray through its middle, and by its branches."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, mean_at, taken
from ..light.plan import Plan
from ..light.rays import Words
from .points import Points, areas, in_triangles, is_seen


@dataclass(frozen=True)
class CutRule:
    """When pixels are cut, quartered, sampled (docs/design.md, decision 5).

    quarterings : of a pixel, at the most
    least_error_px : display px; an error that cannot get as small as this is left to more Effort,
        or to a larger viewer
    of_effort : Effort for which that holds; n times as much makes it n^2 times as large
    new_share : of the middles of a square's mixed pixels: where more lie
        on new branches its borders are not looked for
    n_doubtful : pixels of a square that are in doubt: as where edges meet, which is no chaos
    gap_share : of a cell: less that its pieces leave out is not looked into
    many_branches : at five places of a cell: as good as at each its own
    apart_px : display px between samples, the median of pixels in
        doubt: further apart they would leave gaps
    least_along : samples along a pixel's side for that median: less
        Effort is set to be faster, and never cuts instead
    """

    quarterings: int = 2
    least_error_px: float = 0.1
    of_effort: int = 16
    new_share: float = 0.25
    n_doubtful: int = 1
    gap_share: float = 1 / 16
    many_branches: int = 4
    apart_px: float = 1.25
    least_along: int = 4


CUT = CutRule()


class Doubts(NamedTuple):
    """What was found by cutting cells (m,).

    is_one : corners on one branch; off : display px by which the middle is missed, as of `_missed`
    n_met : different branches of corners and middle; has_gaps : pieces leave out a lit part
    lacks : they were not cut, since that takes more rays than are left to their pixels
    pieces, owner : (t, 3) lit pieces of those that are not one, and the cells (t,) they are of
    """

    is_one: Bools
    off: Floats
    n_met: Ints
    has_gaps: Bools
    lacks: Bools
    pieces: Ints
    owner: Ints


def worth_rays(tolerance: float, effort: int) -> float:
    """Display px: a cell is quartered again if its error can get as small as this.

    Where the map is smooth an error falls to a quarter then. Where faces bend light in each pixel
    it only halves, and a large error stays too large: what that is worth is a matter of Effort.
    """
    return max(tolerance, CUT.least_error_px * max(1.0, effort / CUT.of_effort) ** 2)


def is_dense(plan: Plan, points: Points, pixels: Ints) -> bool:
    """Would samples of pixels like these (m, 4), each on one
    branch, light all of the display, or leave gaps?
    """
    lit = pixels[points.branch[pixels[:, 0]] != 0]
    if not len(lit):
        return True
    across = np.linalg.norm(points.xy[lit[:, 0]] - points.xy[lit[:, 2]], axis=1) / 2**0.5
    return float(np.median(across)) <= CUT.apart_px * max(
        plan.settings.samples_along, CUT.least_along
    )


def in_chaos(branch: Words, of_middle: Words, is_mixed: Bools, square: Ints) -> Bools:
    """Which mixed cells (m,) lie in squares (m,), by
    number, whose borders are not worth looking for?

    Their middles are on branches (m,) of which the corners (m,
    4) know nothing, as often as the borders are many.
    """
    is_new = is_mixed & (branch != of_middle[:, None]).all(axis=1)
    n_mixed, n_new = (np.bincount(square, some) for some in (is_mixed, is_new))
    return is_mixed & ((n_new > 1) & (n_new > CUT.new_share * n_mixed))[square]


def has_gaps(points: Points, cells: Ints, pieces: Ints, owner: Ints) -> Bools:
    """Do the pieces (t, 3) of cells (m, 4) that own them (t,)
    leave out a part of one with all corners lit?
    """
    covered = np.bincount(owner, areas(points.view, pieces), len(cells))
    side = points.view[cells[:, 1], 0] - points.view[cells[:, 0], 0]
    return (points.branch[cells] != 0).all(axis=1) & (covered < (1 - CUT.gap_share) * side**2)


def missed_by_corners(plan: Plan, points: Points, cells: Ints, middle: Points) -> Floats:
    """By how much (m,), display px, the corners of cells (m, 4) on
    one branch each miss their middles, as `_missed`.
    """
    return _missed(plan, points.branch[cells[:, 0]], mean_at(points.xy, cells), middle)


def missed_by_pieces(
    plan: Plan, points: Points, pieces: Ints, owner: Ints, middle: Points
) -> Floats:
    """By how much (m,), display px, pieces (t, 3) of cells that
    own them (t,) miss their middles, as `_missed`.

    A middle that no piece holds is expected to be dark.
    """
    branch = np.zeros(len(middle), np.uint64)
    xy = np.full((len(middle), 2), np.nan)
    holds, at = in_triangles(
        *(taken(of, pieces) for of in (points.view, points.xy)), taken(middle.view, owner)
    )
    branch[owner[holds]], xy[owner[holds]] = points.branch[pieces[holds, 0]], at[holds]
    return _missed(plan, branch, xy, middle)


def _missed(plan: Plan, branch: Words, xy: Floats, middle: Points) -> Floats:
    """By how much (m,), display px, middles miss the places xy
    (m, 2) where they are expected, on branches (m,).

    inf on another branch, 0 beside the display.
    """
    seen = is_seen(xy, middle.xy, (plan.rig.display.width, plan.rig.display.height))
    off = np.where(seen, np.nan_to_num(np.linalg.norm(xy - middle.xy, axis=1)), 0.0)
    return np.where(branch == middle.branch, off, np.inf)


def n_branches(points: Points, cells: Ints) -> Ints:
    """On how many different branches (m,), none being one, do points (m, k) lie?"""
    branch = np.sort(points.branch[cells], axis=1)
    return 1 + (branch[:, 1:] != branch[:, :-1]).sum(axis=1)
