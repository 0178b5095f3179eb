"""Where do viewers see points of a flat picture, on a display of the smallest pixels?

Viewers k with weights w_k ask one display for a picture. Its point d shows the place

    p(d) = sum(w_k p_k(d)) / sum(w_k),

with p_k(d) the place of the picture that lies straight behind where viewer k sees d: that of
`core/solve/disagreement.py`, without its pixels. A point P of the picture is shown where p(d) = P,
and seen by each viewer, of weight 0, too, where its light lands on d. So for places x_k of the
viewers' images, whose rays land at T_k(x_k),

    T_k(x_k) = d for all k,  sum(w_k p_k(x_k)) = P sum(w_k).

Newton's method for all of them at once: x_k goes on by J_k^-1 (d - T_k), with J_k the derivative
of T_k by traced rays, and d is such that the second equation holds then, to first order. Each point
goes on as long as it needs. Where a point is shown does not depend on who else looks: those of
weight 0 go on to the d that is found, each by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints
from ...base.steps import Steps
from ...image.flat_picture import view_of_picture
from ...image.inverse_lookup import PlaneMapping, mapped, plane_mapping
from ...light.plan import Plan
from ...light.rays import Reason
from ...map.points import Tracer, tracer, tracer_of
from ...rig.rig import PicturePlace
from ...rig.viewer import Viewer
from ..warp.view_from_display import derivative, inverse_of

MOST_ROUNDS = 24
SETTLED_PX = 1e-9  # viewer px
# viewer px: the last step of a place that counts as found. A place on the edge of two curved faces
# goes to and fro by the jump between them, 2e-6 on a ball of 5 120 triangles.
IS_KNOWN = 1e-4
BESIDE_PX = 1e-3  # viewer px, over which the way to the picture is derived


@dataclass(frozen=True, eq=False)
class Observer:
    """One who looks at the display, through what is in a plan, and how much it counts.

    weight : 0 where the display does not show the picture for this viewer
    """

    plan: Plan
    weight: float = 0.0


@dataclass(eq=False)
class _PlacesFound:
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

    def at(self, which: Ints) -> "_PlacesFound":
        """Some of the points."""
        return _PlacesFound(*(getattr(self, field.name)[which] for field in fields(self)))


def grid_of(n: int) -> Floats:
    """Places (n * n, 2) of a picture, u and v of 0..1, row by row from the top: the middles of
    n x n parts.
    """
    along = (np.arange(n) + 0.5) / n
    return np.stack([grid.ravel() for grid in np.meshgrid(along, 1 - along)], axis=1)


def grid_on(place: PicturePlace, n: int, edge: float | None = None) -> Floats:
    """The same of the part of a picture that lies on its plane, by the plane's UV map.

    edge : of a side, how far within the picture the outermost points lie; half a step by default
    """
    low, high = (bound(place.mesh.uv, (0, 1)) for bound in (np.min, np.max))
    grid = grid_of(n)
    if edge is not None:
        grid = edge + (grid * n - 0.5) / (n - 1) * (1 - 2 * edge)
    return low + grid * (high - low)


def places_seen(looks: Sequence[Observer], uv: Floats) -> Steps[Floats]:
    """Where each of those who look sees places of a picture: (k, n, 2) viewer px, NaN where it
    sees none; yields numbers of rays.

    A viewer that counts, but to whom no light comes from where a place is seen straight, does not
    count there.

    uv : (n, 2) places of the picture, v upward

    Raises
    ------
    RigError : the picture is no flat rectangle, or is seen edge-on
    """
    solved = [look for look in looks if look.weight]
    shown, views = yield from _shown(solved, uv)
    found = dict(zip(map(id, solved), views, strict=True))
    for look in looks:
        if id(look) not in found:
            found[id(look)] = yield from place_of_shown(look.plan, uv, shown)
    return np.stack([found[id(look)] for look in looks])


def places_shown(solved: Sequence[Observer], uv: Floats) -> Steps[Floats]:
    """Where on the display (n, 2) px places of a picture are shown for those who look; NaN where
    none of them is to see one; else as `places_seen`.
    """
    shown, _ = yield from _shown(solved, uv)
    return shown


def place_of_shown(plan: Plan, uv: Floats, shown: Floats) -> Steps[Floats]:
    """Where a plan's viewer sees places of a picture (n, 2) viewer px; NaN where it sees none.

    shown : (n, 2) display px, where they are shown, as `places_shown` tells
    """
    return (yield from places_of_shown(plan, [plan.viewer], uv, shown))[0]


def places_of_shown(
    plan: Plan, viewers: Sequence[Viewer], uv: Floats, shown: Floats
) -> Steps[Floats]:
    """The same for k viewers of what is in a plan, (k, n, 2) viewer px. Their rays are traced
    together: of one alone the last few points would take a batch each time they go on.
    """
    place, k = plan.rig.picture_place, len(viewers)
    if not k:
        return np.empty((0, len(uv), 2))
    view = np.concatenate([view_of_picture(place, viewer, uv) for viewer in viewers])
    trace = tracer_of(plan, viewers, len(uv))
    of_all = np.tile(shown, (k, 1))
    one = yield from _begun(trace, view)
    yield from _settled([trace], [one], np.ones((1, len(view))), lambda left: of_all[left])
    return np.where(_is_known(one)[:, None], one.view, np.nan).reshape(k, len(uv), 2)


def _shown(solved: Sequence[Observer], uv: Floats) -> Steps[tuple[Floats, list[Floats]]]:
    """Where places are shown, (n, 2) display px, and where each of those who look sees them, (n, 2)
    viewer px; NaN where they are not.
    """
    place = solved[0].plan.rig.picture_place
    plans = [look.plan for look in solved]
    straight = [view_of_picture(place, plan.viewer, uv) for plan in plans]
    ways = [plane_mapping(place, plan.viewer) for plan in plans]
    wanted = mapped(ways[0].there, straight[0])[0].T

    found = []
    traces = [tracer(plan) for plan in plans]
    for trace, view in zip(traces, straight, strict=True):
        found.append((yield from _begun(trace, view)))
    weights = np.stack([
        look.weight * (one.branch != 0) for look, one in zip(solved, found, strict=True)
    ])  # fmt: skip
    display = np.full(wanted.shape, np.nan)

    def meant(left: Ints) -> Floats:
        display[left] = _shown_at(
            [one.at(left) for one in found], ways, weights[:, left], wanted[left]
        )
        return display[left]

    yield from _settled(traces, found, weights, meant)
    known = np.stack([_is_known(one) for one in found])
    is_shown = ((weights == 0) | known).all(axis=0) & (weights > 0).any(axis=0)
    display[~is_shown] = np.nan
    return display, [
        np.where((is_shown & is_known)[:, None], one.view, np.nan)
        for one, is_known in zip(found, known, strict=True)
    ]


def _settled(
    traces: Sequence[Tracer],
    found: Sequence[_PlacesFound],
    weights: Floats,
    meant: Callable[[Ints], Floats],
) -> Steps[None]:
    """Bring the places of all viewers to where points are shown, as far as that can be.

    weights : (k, n), 0 where a viewer does not count
    meant : where some of the points, by their numbers, are shown, (m, 2) display px, by the places
        and inverses so far
    """
    counts = weights > 0
    left = np.flatnonzero(counts.any(axis=0))
    before = np.full(weights.shape[1], np.inf)
    for n_left in reversed(range(MOST_ROUNDS)):
        if not len(left):
            break
        for trace, one in zip(traces, found, strict=True):
            by_view = yield from derivative(
                _of_some(trace, left), one.view[left], one.display[left], one.branch[left]
            )
            one.inverse[left] = inverse_of(by_view)
        shown = meant(left)
        for trace, one in zip(traces, found, strict=True):
            yield from _go_on(trace, one, left, shown)

        largest = np.max([np.abs(one.step[left]).max(axis=1) for one in found], axis=0)
        is_whole = np.all([one.reach[left] == 1 for one in found], axis=0)
        # rounding is reached where a known place comes no nearer
        is_near = (before[left] / 2 < largest) & (largest < IS_KNOWN)
        # a step that was halved more often than it can be doubled again is never a whole one
        lost = [(one.branch[left] == 0) | (one.reach[left] * 2.0**n_left < 1) for one in found]
        is_lost = (counts[:, left] & lost).any(axis=0)
        before[left] = largest
        left = left[~(is_lost | (is_whole & (is_near | (largest <= SETTLED_PX))))]


def _of_some(trace: Tracer, left: Ints) -> Tracer:
    """The same, for a table of some of the rows."""
    return lambda rows, view: trace(left[rows], view)


def _begun(trace: Tracer, view: Floats) -> Steps[_PlacesFound]:
    """Where points (n, 2) viewer px are seen straight, to begin with."""
    n = len(view)
    traced = yield from trace(np.arange(n), view)
    return _PlacesFound(
        view=view.copy(),
        display=traced.xy.copy(),
        branch=traced.branch.copy(),
        inverse=np.zeros((n, 2, 2)),
        step=np.full((n, 2), np.inf),
        reach=np.ones(n),
        has_arrived=traced.reason == Reason.ARRIVED,
    )


def _shown_at(
    found: list[_PlacesFound], ways: list[PlaneMapping], weights: Floats, wanted: Floats
) -> Floats:
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


def _by_view(way: PlaneMapping, view: Floats) -> Floats:
    """Picture px by viewer px (n, 2, 2), at places (n, 2)."""
    columns = []
    for step in BESIDE_PX * np.eye(2):
        ahead, behind = (mapped(way.there, view + sign * step)[0] for sign in (1, -1))
        columns.append((ahead - behind).T / (2 * BESIDE_PX))
    return np.stack(columns, axis=2)


def _go_on(trace: Tracer, one: _PlacesFound, left: Ints, shown: Floats) -> Steps[None]:
    """Move some places of a viewer's image to where it sees points (m, 2) display px."""
    here = one.at(left)
    step = here.reach[:, None] * np.einsum("nij,nj->ni", here.inverse, shown - here.display)
    can_move = np.isfinite(step).all(axis=1) & here.inverse.any(axis=(1, 2)) & (here.branch != 0)
    tried = np.where(can_move[:, None], here.view + step, here.view)
    traced = yield from trace(left, tried)

    is_on_branch = can_move & (traced.branch == here.branch)
    some = left[is_on_branch]
    one.view[some] = tried[is_on_branch]
    one.display[some] = traced.xy[is_on_branch]
    one.has_arrived[some] = traced.reason[is_on_branch] == Reason.ARRIVED
    # those that cannot move are done, and not found
    one.step[left] = np.where(can_move[:, None], step, 0.0)
    one.reach[left] = np.where(is_on_branch, np.minimum(1.0, 2 * here.reach), here.reach / 2)
    one.branch[left[~can_move]] = 0


def _is_known(one: _PlacesFound) -> Bools:
    """Which places (n,) are seen on the display."""
    is_settled = (np.abs(one.step) < IS_KNOWN).all(axis=1) & (one.reach == 1)
    return (one.branch != 0) & one.has_arrived & is_settled
