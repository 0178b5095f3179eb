"""From a place of the viewer's image that shows about a point of the display to the very place.

Newton's method on the light itself: the ray of each place is traced, and its miss, by the inverse
of the map's derivative, is the next step. The derivative begins as that of the piece of the view
map, and is corrected by each step as it turned out (Broyden), so that two or three rays do. A step
that leaves the branch, or comes no nearer, is halved. So the view map's tolerance does not count
here, only whether it knows the branch.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...base.steps import Pauses
from ...light.plan import Plan
from ...map.points import Tracer, trace_points


@dataclass(frozen=True)
class Settling:
    """When a place is good enough; seen on the ball, where the median takes two rays.

    settled : share of the tolerance between the landing and the point; the step that is left then
        makes it a square of that
    most_rays : for one place
    nearby : viewer px, over which the derivative is taken where no piece tells it
    """

    settled: float = 0.01
    most_rays: int = 10
    nearby: float = 1e-3


SETTLING = Settling()


@dataclass(eq=False)
class Places:
    """Places of the viewer's image, each with the point of the display that it is to show.

    view : (n, 2) viewer px, the best so far
    off : (n,) display px between its landing and the point; inf where it is on no branch
    """

    view: Floats
    off: Floats


def settle(
    plan: Plan,
    points: Floats,
    view: Floats,
    view_by_display: Floats,
    branch: NDArray[np.uint64],
) -> Pauses[Places]:
    """Bring places to the points that they are to show; yields the number of rays now and then.

    Parameters
    ----------
    points : (n, 2) display px
    view : (n, 2) viewer px to begin with
    view_by_display : (n, 2, 2) about the inverse of the map's derivative there
    branch : (n,) that light has to take
    """
    n = len(points)
    settled_px = SETTLING.settled * plan.settings.tolerance
    found = Places(view.copy(), np.full(n, np.inf))
    inverse = view_by_display.copy()
    step = np.zeros((n, 2))
    miss = np.zeros((n, 2))
    left = np.arange(n)

    for _ in range(SETTLING.most_rays):
        if not len(left):
            break

        tried = found.view[left] + step[left]
        traced = yield from trace_points(plan, tried)
        new_miss = traced.xy - points[left]
        off = np.where(traced.branch == branch[left], np.hypot(*new_miss.T), np.inf)
        is_nearer = off < found.off[left]

        # how the step turned out corrects the derivative
        some = left[is_nearer]
        is_second = np.isfinite(found.off[some])
        known = some[is_second]
        inverse[known] = _corrected(
            inverse[known], step[known], new_miss[is_nearer][is_second] - miss[known]
        )
        found.view[some] = tried[is_nearer]
        found.off[some] = off[is_nearer]
        miss[some] = new_miss[is_nearer]
        step[some] = -_times(inverse[some], miss[some])

        # a first ray beside its branch has nowhere to go
        others = left[~is_nearer]
        step[others] *= 0.5
        left = left[np.isfinite(found.off[left]) & (found.off[left] > settled_px)]

    last = np.flatnonzero(found.off <= settled_px)
    found.view[last] += step[last]
    return found


def derivative(
    trace: Tracer, view: Floats, display: Floats, branch: NDArray[np.uint64]
) -> Pauses[Floats]:
    """Display px per viewer px (n, 2, 2), columns x and y of the viewer, by rays beside places.

    0 where the rays beside them take other branches.

    trace : traces places, by their rows in the tables
    view, display, branch : (n, 2) viewer px, (n, 2) display px and (n,) of the places
    """
    found = np.zeros((len(view), 2, 2))
    for side in (1, -1):
        # both axes together
        lacks, axis = np.nonzero(~found.any(axis=1))
        if not len(lacks):
            break
        beside = view[lacks]
        beside[np.arange(len(lacks)), axis] += side * SETTLING.nearby
        traced = yield from trace(lacks, beside)
        known = traced.branch == branch[lacks]
        some = lacks[known]
        by_side = (traced.xy[known] - display[some]) / SETTLING.nearby
        found[some, :, axis[known]] = side * by_side
    return found


def inverse_of(matrices: Floats) -> Floats:
    """Inverses of matrices (n, 2, 2); 0 where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    det = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = np.array([[d, -b], [-c, a]]) / det
    return np.where(np.isfinite(found), found, 0.0).transpose(2, 0, 1)


def _corrected(inverse: Floats, step: Floats, change: Floats) -> Floats:
    """Inverses (n, 2, 2) of derivatives, by which a change (n, 2) would have told the step (n, 2)
    that it came of.
    """
    told = _times(inverse, change)
    back = np.einsum("ni,nij->nj", step, inverse)
    along = np.einsum("ni,ni->n", step, told)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        more = (step - told)[:, :, None] * back[:, None, :] / along[:, None, None]
    return inverse + np.where(np.isfinite(more), more, 0.0)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Products (n, 2) of matrices (n, 2, 2) and vectors (n, 2)."""
    return np.einsum("nij,nj->ni", matrices, vectors)
