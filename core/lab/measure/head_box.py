"""Comparison of solving for all viewers of a box with solving for its middle alone.

Solved for the middle, the picture is right there and off at the ends. Solved for all viewers it is
off in the middle too, but the ends may gain. Heads in the box, each looking at the picture's
centre, measure both: on a grid, for the mean and the largest angle, and along each axis, as curves.

The display shows the weighted mean of the places its viewers need, as with *Sharp*.
"""

from collections.abc import Generator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.numbers import number
from ...base.steps import Steps, hold_progress
from ...bench.part_sizes import plane_of
from ...image.flat_picture import view_of_picture
from ...light.plan import Plan
from ...rig.rig import PicturePlace, Rig
from ...rig.viewer import Viewer
from ..atlas.heads import AXES, HeadBox, Offset, check_viewer, evenly, viewer_at
from ..drawing.svg import Curve, draw, from_zero, points_mm, sheet
from .places_seen import Observer, grid_on, places_of_shown, places_shown

FILE = "head_box.svg"
N_POINTS = 7  # points of the picture, each way
N_ALONG = 7  # heads along an axis, one of them in the middle
N_OVER = {1: 7, 2: 5, 3: 3}  # heads along each axis of the grid, by the number of axes
IS_SPREAD = 1e-4  # of the picture's distance: a smaller spread may be a camera's float32 rounding
ENDS = (("left", "right"), ("bottom", "top"), ("far end", "near end"))  # of AXES, low and high
HEADROOM = 1.4  # space for legends above the curves, which are high at both ends


@dataclass(frozen=True)
class AxisCurve:
    """The picture as seen from heads along an axis of the box, through its middle.

    axis : right, up or forward
    distance_m : of heads, from the leftmost, lowest or farthest end
    mean_arcmin, largest_arcmin : error of points; None if none is seen
    coverage : fraction of the points that is seen, 0..1
    """

    axis: str
    distance_m: tuple[float, ...]
    mean_arcmin: tuple[float | None, ...]
    largest_arcmin: tuple[float | None, ...]
    coverage: tuple[float, ...]


@dataclass(frozen=True)
class Served:
    """Quality of a solved display for the heads of a box.

    mean_arcmin, largest_arcmin : over a grid of heads; None if they see no point
    coverage : fraction of the points that is seen, over the grid, 0..1
    middle_mean_arcmin, middle_largest_arcmin : from the middle of the box
    curves : one for each axis
    """

    mean_arcmin: float | None
    largest_arcmin: float | None
    coverage: float
    middle_mean_arcmin: float | None
    middle_largest_arcmin: float | None
    curves: tuple[AxisCurve, ...]


@dataclass(frozen=True)
class BoxServed:
    """A box of heads before a display solved for all viewers, and for its middle alone.

    size_m : right, up and forward; 0 along axes without spread
    n_viewers : viewers that span the box
    n_heads : heads of the grid
    """

    size_m: Offset
    n_viewers: int
    n_heads: int
    for_all: Served
    for_middle: Served

    @property
    def worse_at_middle_arcmin(self) -> float | None:
        """Increase of the middle's mean error if solved for all, arcmin; None if it sees no
        point.
        """
        both = self.for_all.middle_mean_arcmin, self.for_middle.middle_mean_arcmin
        return None if None in both else both[0] - both[1]


def check_box(rig: Rig) -> None:
    """Raise RigError unless a rig's viewers span a box of heads before a flat picture."""
    for viewer in rig.viewers:
        check_viewer(rig, viewer)
    plane_of(rig)
    _spanned(rig)


def head_box(plan: Plan) -> Generator[float, None, BoxServed]:
    """Look from heads in the box that a rig's viewers span; yields progress 0..1.

    Raises
    ------
    RigError : the viewers span no box, have no heads, or the picture is not a flat rectangle
    """
    rig = plan.rig
    check_box(rig)
    own, box = _spanned(rig)
    low, high = np.array(box.low), np.array(box.high)
    middle, size = (low + high) / 2, high - low
    n_over = N_OVER[len(box.axes)]
    grid = middle + evenly([n_over if s else 1 for s in size], size)
    lines = [
        middle + evenly([N_ALONG if k == axis else 1 for k in range(3)], size) for axis in box.axes
    ]
    heads = [
        viewer_at(own, rig.picture_place, tuple(offset))
        for offset in np.concatenate([grid, *lines])
    ]
    centre = viewer_at(own, rig.picture_place, tuple(middle))
    uv = grid_on(rig.picture_place, N_POINTS)

    found = []
    for looks in (
        [Observer(plan.seen_by(viewer), viewer.weight) for viewer in rig.viewers],
        [Observer(plan.seen_by(centre), 1.0)],
    ):
        done = len(found) / 2
        shown = yield from hold_progress(done, places_shown(looks, uv))
        off = yield from hold_progress(done + 0.25, off_by(plan, heads, uv, shown))
        found.append(_served(off, len(grid), box.axes, size))
    yield 1.0
    return BoxServed(tuple(size.tolist()), len(rig.viewers), len(grid), *found)


def off_by(plan: Plan, heads: Sequence[Viewer], uv: Floats, shown: Floats) -> Steps[Floats]:
    """Errors (k, n), arcmin, of places uv (n, 2) of the picture as heads see them; NaN if unseen.

    shown : (n, 2) display px of these places
    """
    seen = yield from places_of_shown(plan, heads, uv, shown)
    return angles_of(plan.rig.picture_place, heads, uv, seen)


def angles_of(place: PicturePlace, heads: Sequence[Viewer], uv: Floats, seen: Floats) -> Floats:
    """Errors of heads that see places uv (n, 2) of a picture at (k, n, 2) px of their images."""
    found = np.empty(seen.shape[:2])
    for k, head in enumerate(heads):
        found[k] = head.arcmin_between(seen[k], view_of_picture(place, head, uv))
    return found


def _spanned(rig: Rig) -> tuple[Viewer, HeadBox]:
    """A viewer at the mean of all places, and the box of all places along the mean axes."""
    positions = np.array([viewer.position for viewer in rig.viewers])
    left, _, right = np.linalg.svd(sum(viewer.axes for viewer in rig.viewers))
    mean = positions.mean(axis=0)
    nearest = min(rig.viewers, key=lambda viewer: np.linalg.norm(viewer.position - mean))
    own = replace(nearest, position=mean, axes=left @ right)
    offsets = (positions - own.position) @ own.axes.T
    low, high = offsets.min(axis=0), offsets.max(axis=0)
    distance = np.linalg.norm(rig.picture_place.mesh.bounds.mean(axis=0) - own.position)
    is_flat = high - low <= IS_SPREAD * distance
    low[is_flat] = high[is_flat] = ((low + high) / 2)[is_flat]
    if is_flat.all():
        raise RigError(
            "The viewers are all at the same position, so they do not span a box. Add others with"
            " Two Eyes or Grid."
        )
    return own, HeadBox(tuple(low.tolist()), tuple(high.tolist()))


def _served(off: Floats, n_grid: int, axes: Sequence[int], size: Floats) -> Served:
    """Figures of the errors (h, n), arcmin, of heads on the grid, then along each axis; NaN if
    unseen.
    """
    curves = []
    for k, axis in enumerate(axes):
        first = n_grid + k * N_ALONG
        means, largest, shares = zip(*map(_numbers, off[first : first + N_ALONG]), strict=True)
        distances = tuple(np.linspace(0.0, size[axis], N_ALONG).tolist())
        curves.append(AxisCurve(AXES[axis], distances, means, largest, shares))
    middle_mean, middle_largest, _ = _numbers(off[n_grid + N_ALONG // 2])
    return Served(*_numbers(off[:n_grid]), middle_mean, middle_largest, tuple(curves))


def _numbers(off: Floats) -> tuple[float | None, float | None, float]:
    """Mean and largest error, and the fraction of points that is seen."""
    there = off[np.isfinite(off)]
    if not len(there):
        return None, None, 0.0
    return float(there.mean()), float(there.max()), len(there) / off.size


def as_data(found: BoxServed) -> dict[str, Any]:
    """Record for a report: m, arcmin, fractions."""
    return {**asdict(found), "worse_at_middle_arcmin": found.worse_at_middle_arcmin}


def as_svg(found: BoxServed) -> str:
    """A diagram for each axis of the box: errors of both ways to solve."""
    solved = (("for all", found.for_all), ("for the middle", found.for_middle))
    notes = [
        f"solved {name}: {_or_none(served.mean_arcmin)} arcmin on the mean over the box,"
        f" at most {_or_none(served.largest_arcmin)}"
        for name, served in solved
    ]
    columns = []
    for k, curve in enumerate(found.for_all.curves):
        low, high = ENDS[AXES.index(curve.axis)]
        drawn = [
            Curve(f"{name}, {field}", points_mm(curve.distance_m, values))
            for name, served in solved
            for field, values in (
                ("largest", served.curves[k].largest_arcmin),
                ("mean", served.curves[k].mean_arcmin),
            )
        ]
        x, y = ([point[i] for one in drawn for point in one.points] for i in (0, 1))
        diagram = draw(
            f"Heads of a box, {low} to {high}",
            drawn,
            from_zero(f"distance of the head from the {low} of the box (mm)", x),
            from_zero("off by (arcmin)", [HEADROOM * value for value in y]),
            notes,
            is_rising=True,
        )
        columns.append([diagram])
    return sheet(columns)


def _or_none(value: float | None) -> str:
    return "no" if value is None else number(value)
