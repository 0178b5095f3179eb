"""Where do viewers see points of a flat picture, on a display of the smallest pixels?

Viewers k with weights w_k ask one display for a picture. Its point d shows the place

    p(d) = sum(w_k p_k(d)) / sum(w_k),

with p_k(d) the place of the picture that lies straight behind where viewer k sees d: that of
`core/solve/disagreement.py`, without its pixels. A point P of the picture is shown where p(d) = P,
and seen by each viewer, of weight 0, too, where its light lands on d. So for places x_k of the
viewers' images, whose rays land at T_k(x_k),

    T_k(x_k) = d for all k,  sum(w_k p_k(x_k)) = P sum(w_k).

Newton's method for all of them at once: x_k goes on by J_k^-1 (d - T_k), with J_k the derivative
of T_k by traced rays, and d is such that the second equation holds then, to first order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats
from ..image.asked import Way, mapped, way_of
from ..image.flat_picture import view_of_picture
from ..light.landings import Reason
from ..light.plan import Plan
from ..map.points import trace_points
from ..rig import PicturePlace
from ..steps import Pauses
from ..warp.settling import derivative, inverse_of

MOST_ROUNDS = 24
SETTLED_PX = 1e-9  # viewer px
# viewer px: the last step of a place that counts as found. A place on the edge of two curved faces
# goes to and fro by the jump between them, 2e-6 on a ball of 5 120 triangles.
IS_KNOWN = 1e-4
BESIDE_PX = 1e-3  # viewer px, over which the way to the picture is derived


@dataclass(frozen=True, eq=False)
class Look:
    """One who looks at the display, through what is in a plan, and how much it counts.

    weight : 0 where the display does not show the picture for this viewer
    """

    plan: Plan
    weight: float = 0.0


@dataclass(eq=False)
class _Found:
    """Places of one viewer's image so far.

    view, display : (n, 2) viewer px, and the display px on which their rays land
    branch : (n,) that light takes from where points are seen straight; 0 where none lands
    inverse : (n, 2, 2) viewer px by display px
    step : (n, 2) viewer px, the last
    reach : (n,) part of a step that is taken: less than 1 where a whole one left the branch
    has_arrived : (n,) is the landing within the display?
    """

    view: Floats
    display: Floats
    branch: NDArray[np.uint64]
    inverse: Floats
    step: Floats
    reach: Floats
    has_arrived: Bools


def grid_of(n: int) -> Floats:
    """Places (n * n, 2) of a picture, u and v of 0..1, row by row from the top: the middles of
    n x n parts.
    """
    along = (np.arange(n) + 0.5) / n
    return np.stack([grid.ravel() for grid in np.meshgrid(along, 1 - along)], axis=1)


def grid_on(place: PicturePlace, n: int) -> Floats:
    """The same of the part of a picture that lies on its plane, by the plane's UV map."""
    low, high = (bound(place.mesh.uv, (0, 1)) for bound in (np.min, np.max))
    return low + grid_of(n) * (high - low)


def places_seen(looks: Sequence[Look], uv: Floats) -> Pauses[Floats]:
    """Where each of those who look sees places of a picture: (k, n, 2) viewer px, NaN where it
    sees none; yields numbers of rays.

    A viewer that counts, but to whom no light comes from where a place is seen straight, does not
    count there.

    uv : (n, 2) places of the picture, v upward

    Raises
    ------
    RigError : the picture is no flat rectangle, or is seen edge-on
    """
    place = looks[0].plan.rig.picture_place
    straight = [view_of_picture(place, look.plan.viewer, uv) for look in looks]
    ways = [way_of(place, look.plan.viewer) for look in looks]
    wanted = mapped(ways[0].there, straight[0])[0].T

    found = []
    for look, view in zip(looks, straight, strict=True):
        found.append((yield from _begun(look.plan, view)))
    weights = np.stack([
        look.weight * (one.branch != 0) for look, one in zip(looks, found, strict=True)
    ])  # fmt: skip

    before = np.inf
    for _ in range(MOST_ROUNDS):
        for look, one in zip(looks, found, strict=True):
            by_view = yield from derivative(look.plan, one.view, one.display, one.branch)
            one.inverse = inverse_of(by_view)
        shown = _shown_at(found, ways, weights, wanted)
        for look, one in zip(looks, found, strict=True):
            yield from _go_on(look.plan, one, shown)
        # rounding is reached where known places come no nearer
        largest = max(float(np.abs(one.step).max()) for one in found)
        if largest <= SETTLED_PX or before / 2 < largest < IS_KNOWN:
            break
        before = largest

    is_shown = weights.sum(axis=0) > 0
    for one, weight in zip(found, weights, strict=True):
        is_shown &= (weight == 0) | _is_known(one)
    return np.stack([
        np.where((is_shown & _is_known(one))[:, None], one.view, np.nan) for one in found
    ])  # fmt: skip


def _begun(plan: Plan, view: Floats) -> Pauses[_Found]:
    """Where points (n, 2) viewer px are seen straight, to begin with."""
    traced = yield from trace_points(plan, view)
    n = len(view)
    return _Found(
        view=view.copy(),
        display=traced.xy.copy(),
        branch=traced.branch.copy(),
        inverse=np.zeros((n, 2, 2)),
        step=np.full((n, 2), np.inf),
        reach=np.ones(n),
        has_arrived=traced.reason == Reason.ARRIVED,
    )


def _shown_at(found: list[_Found], ways: list[Way], weights: Floats, wanted: Floats) -> Floats:
    """Where on the display (n, 2) px places are shown, to first order; NaN where on none.

    weights : (k, n); wanted : (n, 2) picture px
    """
    total = np.zeros((*wanted.shape, 2))
    right = np.zeros(wanted.shape)
    for one, way, weight in zip(found, ways, weights, strict=True):
        by_display = np.einsum("nij,njk->nik", _by_view(way, one.view), one.inverse)
        here = np.nan_to_num(one.display)
        asked = mapped(way.there, one.view)[0].T
        total += weight[:, None, None] * by_display
        right += weight[:, None] * (wanted - asked + np.einsum("nij,nj->ni", by_display, here))

    inverse = inverse_of(total)
    at = np.einsum("nij,nj->ni", inverse, right)
    return np.where(inverse.any(axis=(1, 2))[:, None], at, np.nan)


def _by_view(way: Way, view: Floats) -> Floats:
    """Picture px by viewer px (n, 2, 2), at places (n, 2)."""
    columns = []
    for step in BESIDE_PX * np.eye(2):
        ahead, behind = (mapped(way.there, view + sign * step)[0] for sign in (1, -1))
        columns.append((ahead - behind).T / (2 * BESIDE_PX))
    return np.stack(columns, axis=2)


def _go_on(plan: Plan, one: _Found, shown: Floats) -> Pauses[None]:
    """Move the places of a viewer's image to where it sees points (n, 2) display px."""
    step = one.reach[:, None] * np.einsum("nij,nj->ni", one.inverse, shown - one.display)
    can_move = np.isfinite(step).all(axis=1) & one.inverse.any(axis=(1, 2)) & (one.branch != 0)
    tried = np.where(can_move[:, None], one.view + step, one.view)
    traced = yield from trace_points(plan, tried)

    is_on_branch = can_move & (traced.branch == one.branch)
    one.view[is_on_branch] = tried[is_on_branch]
    one.display[is_on_branch] = traced.xy[is_on_branch]
    one.has_arrived[is_on_branch] = traced.reason[is_on_branch] == Reason.ARRIVED
    # those that cannot move are done, and not found
    one.step = np.where(can_move[:, None], step, 0.0)
    one.reach = np.where(is_on_branch, np.minimum(1.0, 2 * one.reach), one.reach / 2)
    one.branch[~can_move] = 0


def _is_known(one: _Found) -> Bools:
    """Which places (n,) are seen on the display."""
    is_settled = (np.abs(one.step) < IS_KNOWN).all(axis=1) & (one.reach == 1)
    return (one.branch != 0) & one.has_arrived & is_settled
