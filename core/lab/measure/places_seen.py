"""Places of a flat picture as viewers see them, on a display of infinitely small pixels.

Viewers k with weights w_k share one display. Its point d shows the place

    p(d) = sum(w_k p_k(d)) / sum(w_k),

where p_k(d) is the place of the picture straight behind the point at which viewer k sees d, as in
`core/solve/disagreement.py`, without pixels. A point P of the picture is shown where p(d) = P. Each
viewer, including those of weight 0, sees it where its light lands on d. For places x_k of the
viewers' images, whose rays land at T_k(x_k), this means

    T_k(x_k) = d for all k,  sum(w_k p_k(x_k)) = P sum(w_k).

Newton's method solves both together: x_k advances by J_k^-1 (d - T_k), where traced rays give the
derivative J_k of T_k, and d satisfies the second equation to first order. Each point iterates as
long as it needs. Viewers of weight 0 do not affect d, so they follow separately.
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
# Viewer px: the last step of a converged place. On the edge between two curved faces a place
# oscillates by the jump between them, 2e-6 on a ball of 5 120 triangles.
IS_KNOWN = 1e-4
BESIDE_PX = 1e-3  # viewer px, step of the numerical derivative


@dataclass(frozen=True, eq=False)
class Observer:
    """A viewer of a plan's display, and its weight.

    weight : 0 if the display does not show the picture for this viewer
    """

    plan: Plan
    weight: float = 0.0


@dataclass(eq=False)
class _PlacesFound:
    """Iterated places of one viewer's image.

    view, display : (n, 2) viewer px, and display px on which their rays land
    branch : (n,) of the light at the straight place; 0 if it lands nowhere
    inverse : (n, 2, 2) viewer px by display px
    step : (n, 2) viewer px, the last one
    reach : (n,) fraction of a step to use: below 1 after a whole step left the branch
    has_arrived : (n,) whether the landing is on the display
    """

    view: Floats
    display: Floats
    branch: NDArray[np.uint64]
    inverse: Floats
    step: Floats
    reach: Floats
    has_arrived: Bools

    def at(self, which: Ints) -> "_PlacesFound":
        """The given rows."""
        return _PlacesFound(*(getattr(self, field.name)[which] for field in fields(self)))


def grid_of(n: int) -> Floats:
    """Centres (n * n, 2) of n x n parts of a picture, u and v in 0..1, row by row from the top."""
    along = (np.arange(n) + 0.5) / n
    return np.stack([grid.ravel() for grid in np.meshgrid(along, 1 - along)], axis=1)


def grid_on(place: PicturePlace, n: int, edge: float | None = None) -> Floats:
    """The same for the part of a picture on its plane, by the plane's UV map.

    edge : inset of the outermost points, relative to a side; half a step by default
    """
    low, high = (bound(place.mesh.uv, (0, 1)) for bound in (np.min, np.max))
    grid = grid_of(n)
    if edge is not None:
        grid = edge + (grid * n - 0.5) / (n - 1) * (1 - 2 * edge)
    return low + grid * (high - low)


def places_seen(looks: Sequence[Observer], uv: Floats) -> Steps[Floats]:
    """Places (k, n, 2), viewer px, at which each viewer sees places of a picture; NaN if unseen.

    Yields numbers of rays. A weighted viewer that receives no light from a straight place does not
    count there.

    uv : (n, 2) places of the picture, v upward

    Raises
    ------
    RigError : the picture is not a flat rectangle, or is seen edge-on
    """
    solved = [look for look in looks if look.weight]
    shown, views = yield from _shown(solved, uv)
    found = dict(zip(map(id, solved), views, strict=True))
    for look in looks:
        if id(look) not in found:
            found[id(look)] = yield from place_of_shown(look.plan, uv, shown)
    return np.stack([found[id(look)] for look in looks])


def places_shown(solved: Sequence[Observer], uv: Floats) -> Steps[Floats]:
    """Display px (n, 2) that show places of a picture; NaN if no viewer is to see it.

    Otherwise like `places_seen`.
    """
    shown, _ = yield from _shown(solved, uv)
    return shown


def place_of_shown(plan: Plan, uv: Floats, shown: Floats) -> Steps[Floats]:
    """Places (n, 2), viewer px, at which a plan's viewer sees places of a picture; NaN if unseen.

    shown : (n, 2) display px of these places, from `places_shown`
    """
    return (yield from places_of_shown(plan, [plan.viewer], uv, shown))[0]


def places_of_shown(
    plan: Plan, viewers: Sequence[Viewer], uv: Floats, shown: Floats
) -> Steps[Floats]:
    """The same for k viewers, (k, n, 2) viewer px.

    Their rays are traced together, because the last few points of a single viewer would take a
    batch each iteration.
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
    """Display px (n, 2) that show places, and viewer px (n, 2) at which each viewer sees them; or
    NaN.
    """
    place = solved[0].plan.rig.picture_place
    plans = [look.plan for look in solved]
    straight = [view_of_picture(place, plan.viewer, uv) for plan in plans]
    mappings = [plane_mapping(place, plan.viewer) for plan in plans]
    wanted = mapped(mappings[0].there, straight[0])[0].T

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
            [one.at(left) for one in found], mappings, weights[:, left], wanted[left]
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
    """Move the places of all viewers as close as possible to the shown points.

    weights : (k, n), 0 if a viewer does not count
    meant : function of point numbers that returns their display px (m, 2), by the present places
        and inverses
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
        # A converged place that comes no closer has reached rounding.
        is_near = (before[left] / 2 < largest) & (largest < IS_KNOWN)
        # A step halved more often than the remaining rounds can double never becomes whole again.
        lost = [(one.branch[left] == 0) | (one.reach[left] * 2.0**n_left < 1) for one in found]
        is_lost = (counts[:, left] & lost).any(axis=0)
        before[left] = largest
        left = left[~(is_lost | (is_whole & (is_near | (largest <= SETTLED_PX))))]


def _of_some(trace: Tracer, left: Ints) -> Tracer:
    """The same for a table of some of the rows."""
    return lambda rows, view: trace(left[rows], view)


def _begun(trace: Tracer, view: Floats) -> Steps[_PlacesFound]:
    """Initial places: points (n, 2), viewer px, as seen straight."""
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
    found: list[_PlacesFound], mappings: list[PlaneMapping], weights: Floats, wanted: Floats
) -> Floats:
    """Display px (n, 2) that show places, to first order; NaN for none.

    weights : (k, n); wanted : (n, 2) picture px
    """
    total = np.zeros((*wanted.shape, 2))
    right = np.zeros(wanted.shape)
    for one, mapping, weight in zip(found, mappings, weights, strict=True):
        by_display = np.einsum("nij,njk->nik", _by_view(mapping, one.view), one.inverse)
        here = np.nan_to_num(one.display)
        at_view = mapped(mapping.there, one.view)[0].T
        total += weight[:, None, None] * by_display
        right += weight[:, None] * (wanted - at_view + np.einsum("nij,nj->ni", by_display, here))

    inverse = inverse_of(total)
    at = np.einsum("nij,nj->ni", inverse, right)
    return np.where(inverse.any(axis=(1, 2))[:, None], at, np.nan)


def _by_view(mapping: PlaneMapping, view: Floats) -> Floats:
    """Derivatives (n, 2, 2) of picture px by viewer px, at places (n, 2)."""
    columns = []
    for step in BESIDE_PX * np.eye(2):
        ahead, behind = (mapped(mapping.there, view + sign * step)[0] for sign in (1, -1))
        columns.append((ahead - behind).T / (2 * BESIDE_PX))
    return np.stack(columns, axis=2)


def _go_on(trace: Tracer, one: _PlacesFound, left: Ints, shown: Floats) -> Steps[None]:
    """Move some places of a viewer's image towards points (m, 2), display px."""
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
    # Places that cannot move are finished, and not found.
    one.step[left] = np.where(can_move[:, None], step, 0.0)
    one.reach[left] = np.where(is_on_branch, np.minimum(1.0, 2 * here.reach), here.reach / 2)
    one.branch[left[~can_move]] = 0


def _is_known(one: _PlacesFound) -> Bools:
    """Whether places (n,) are seen on the display."""
    is_settled = (np.abs(one.step) < IS_KNOWN).all(axis=1) & (one.reach == 1)
    return (one.branch != 0) & one.has_arrived & is_settled
