"""Choice of the rays traced for a view map: as few as the tolerance allows.

Squares of the viewer's image are traced at 5 x 5 nodes. If the nodes lie on one branch, and a
biquartic through them keeps the tolerance at six more rays, the square is one cell. Otherwise it is
quartered, down to 4 pixels. At this size the nodes are the pixels' corners: pixels with all corners
on one branch are cells, the others are cut into pieces.
"""

from collections.abc import Generator
from dataclasses import replace
from math import inf
from typing import TypeVar

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.stages import MAP, Span, section, spans
from ..base.steps import Steps, between
from ..light.plan import Plan
from ..light.rays import Reason
from . import smooth_cells
from .cutting import CutPixels, Cutting
from .measured_error import checked
from .points import Paths, Points, is_seen, trace_points
from .samples import n_strata, sample_cells
from .smooth_cells import CHECKS, COLUMN, PARTS, ROW, Squares, are_off_display
from .view_map import ViewMap

Result = TypeVar("Result")


N_ACROSS = 16  # squares along the longer side of the viewer's image at the start
DARK_SIDE_PX = (
    8  # up to this side squares may be dark although their rays are lost in different ways
)


def sample(plan: Plan) -> Generator[float, None, ViewMap]:
    """Trace the display as the viewer sees it, and cut it into cells; yields progress 0..1."""
    return (yield from Sampling(plan).sample())


class Sampling:
    """A view map in the making: the points traced so far, and their numbers at the nodes, -1 for
    none.

    n_rays : traced so far
    progress : 0..1
    is_coarse : for a first picture no pixel is quartered, and no error of the map is measured
    is_checked : whether its error is measured at once
    """

    def __init__(self, plan: Plan, is_coarse: bool = False, is_checked: bool = True) -> None:
        self.plan, self.is_coarse, self.is_checked = plan, is_coarse, is_checked and not is_coarse
        viewer, display = plan.viewer, plan.rig.display
        self.view_size = (viewer.width, viewer.height)
        self.display_size = (display.width, display.height)
        self.tolerance = plan.settings.tolerance
        self.allowed = (1 - smooth_cells.OF_TOLERANCE) * self.tolerance

        self.first_size = max(PARTS, 2 ** int(np.log2(max(self.view_size) / N_ACROSS)))
        n_columns, n_rows = (-(-n // self.first_size) for n in self.view_size)
        self.number = np.full(
            (n_rows * self.first_size + 1, n_columns * self.first_size + 1), -1, np.int32
        )
        x, y = np.meshgrid(np.arange(n_columns), np.arange(n_rows))
        corner = self.first_size * np.stack([x.ravel(), y.ravel()], axis=1)
        self.first = Squares(corner, np.full(len(corner), self.first_size))

        self.points = Points.none()
        low, high = plan.thin_parts().box
        far = np.linalg.norm(
            np.maximum(np.abs(low - viewer.position), np.abs(high - viewer.position))
        )
        self.paths = Paths(far + float(np.linalg.norm(high - low)))
        self.n_rays, self.progress = 0, 0.0
        self.squares, self.borders, self.samples = spans(*((stage,) for stage in MAP))

    def sample(self) -> Generator[float, None, ViewMap]:
        """Make the view map; yields progress 0..1."""
        work = self._run()
        while True:
            try:
                self.n_rays += next(work)
            except StopIteration as end:
                return replace(end.value, n_rays=self.n_rays)
            yield self.progress

    def _during(self, span: Span, work: Steps[Result], n_rays: float = inf) -> Steps[Result]:
        """Advance the progress through a span by the rays of some work, if their number is set."""
        before = self.n_rays
        while True:
            part = min((self.n_rays - before) / max(n_rays, 1), 1.0)
            # squares that fail their checks are larger than the ones traced meanwhile
            self.progress = max(self.progress, between(*span, part))
            try:
                yield next(work)
            except StopIteration as end:
                return end.value

    def _run(self) -> Generator[int, None, ViewMap]:
        none = self.first.at(slice(0))
        todo = self.first
        checking = none
        smooth = none
        finest = none
        n_sizes = int(np.log2(self.first_size / PARTS)) + 1

        while len(todo) or len(checking):
            # nodes not traced yet, and checks of squares found smooth before
            column, row = todo.nodes()
            at = row * self.number.shape[1] + column
            is_missing = np.zeros(self.number.size, bool)  # np.unique would sort them
            is_missing[at[self.number.take(at) < 0]] = True
            missing = np.flatnonzero(is_missing)
            nodes = np.stack(
                [missing % self.number.shape[1], missing // self.number.shape[1]], axis=1
            ).astype(float)
            checks = checking.checks()
            view = np.concatenate([nodes, checks.reshape(-1, 2)])
            # a section for each size, and one for the checks of the smallest squares
            k = int(np.log2(self.first_size / todo.size.min())) if len(todo) else n_sizes
            span = section(self.squares, k, n_sizes + 1)
            work = trace_points(self.plan, view, paths=self.paths)
            found = yield from self._during(span, work, len(view))

            first = len(self.points)
            self.points = self.points.and_more(found)
            self.number.ravel()[missing] = first + np.arange(len(missing))
            yield 0

            missed = self._missed(checking, first + len(missing))
            # the smallest may be as far off as the quads between their nodes
            good = missed <= np.where(
                checking.size == PARTS, np.maximum(self._bent(checking), self.allowed), self.allowed
            )
            smooth = smooth.and_more(checking.at(good))

            is_smooth, is_done = yield from self._sorted(todo)
            refused = todo.at(~is_smooth & ~is_done).and_more(checking.at(~good))
            checking = todo.at(is_smooth)
            finest = finest.and_more(refused.at(refused.size == PARTS))

            todo = refused.at(refused.size > PARTS).quarters()

        return (yield from self._finished(smooth, finest))

    def _at_nodes(self, squares: Squares) -> Ints:
        """Numbers (n, 25) of the points at the nodes of squares."""
        column, row = squares.nodes()
        return self.number[row, column]

    def _sorted(self, squares: Squares) -> Steps[tuple[Bools, Bools]]:
        """Masks of squares (n,): smooth cells if checks confirm it, and squares that show nothing
        of the display.
        """
        nodes = self._at_nodes(squares)
        branch = self.points.branch[nodes]
        xy = take(self.points.xy, nodes)
        is_one = (branch == branch[:, :1]).all(axis=1)
        is_dark = is_one & (branch[:, 0] == 0)
        is_one &= ~is_dark

        is_off_display = are_off_display(xy, branch, np.array(self.display_size))
        is_smooth = is_one & ~is_off_display
        expected = smooth_cells.expected_error(xy[is_smooth])
        is_smooth[is_smooth] = (expected <= self.allowed) | (squares.size[is_smooth] == PARTS)

        # lost in different ways: something between may be visible
        large = np.flatnonzero(is_dark & (squares.size > DARK_SIDE_PX))
        hits = self.paths.hits[nodes[large]]
        is_dark[large] = (hits == hits[:, :1]).all(axis=(1, 2))

        # undecided if something passes close by
        decided = np.flatnonzero(is_smooth | is_dark | is_off_display)
        touched = decided[(yield from self._is_touched(squares.at(decided)))]
        is_smooth[touched] = is_dark[touched] = is_off_display[touched] = False
        return is_smooth, is_dark | is_off_display

    def _is_touched(self, squares: Squares) -> Steps[Bools]:
        """Whether something is close to the rays of squares (n,), but was hit by none of them."""
        paths, nodes = self.paths, self._at_nodes(squares)
        return (yield from self.plan.thin_parts().touch(paths.places, paths.hits, nodes))

    def _bent(self, squares: Squares) -> Floats:
        """Approximate error (n,), display px, of the pixels of the smallest squares, quartered as
        in `Cutting`.
        """
        by_quads = smooth_cells.sag(take(self.points.xy, self._at_nodes(squares)))
        if self.is_coarse:
            return by_quads
        return np.where(by_quads > self.tolerance, by_quads / 4, by_quads)

    def _missed(self, squares: Squares, first: int) -> Floats:
        """Error (n,), display px, of smooth squares at the points traced to check them.

        Inf on another branch.
        """
        n = len(squares)
        n_checks = len(CHECKS)
        nodes = self._at_nodes(squares)
        checks = slice(first, first + n_checks * n)
        expected = smooth_cells.at_checks(take(self.points.xy, nodes)).reshape(-1, 2)
        xy = self.points.xy[checks]
        is_one = self.points.branch[checks] == self.points.branch[nodes[:, 0]].repeat(n_checks)
        off = np.where(is_one, np.linalg.norm(expected - xy, axis=1), np.inf)
        off[~is_seen(expected, xy, self.display_size)] = 0.0
        return off.reshape(n, n_checks).max(axis=1, initial=0.0)

    def _finished(self, smooth: Squares, finest: Squares) -> Generator[int, None, ViewMap]:
        """Cells in the pixels of the finest squares, which no check has accepted, and the whole
        map.
        """
        # corners of the pixels, in order around them
        column, row = finest.nodes()
        at = np.flatnonzero((COLUMN < PARTS) & (ROW < PARTS))
        corners = np.stack([at, at + 1, at + PARTS + 2, at + PARTS + 1], axis=1)
        is_inside = (column[:, at] < self.view_size[0]) & (row[:, at] < self.view_size[1])
        cells = self._at_nodes(finest)[:, corners][is_inside]

        by_row = cells[:, [0, 1, 3, 2]]
        is_off_display = are_off_display(
            take(self.points.xy, by_row), self.points.branch[by_row], np.array(self.display_size)
        )

        # outside the glass there is nothing to find, unless something thin is near, or light is
        # followed there, too
        is_lost = (self.points.reason == Reason.MISSED_GLASS) & (self.points.branch == 0)
        is_past_glass = is_lost[cells].all(axis=1)
        is_touched = yield from self._is_touched(finest)
        is_past_glass &= ~np.broadcast_to(is_touched[:, None], is_inside.shape)[is_inside]

        is_seen = ~is_off_display & ~is_past_glass
        square = np.broadcast_to(np.arange(len(finest))[:, None], is_inside.shape)[is_inside]
        cells, square = cells[is_seen], square[is_seen]
        yield 0

        pieces = yield from self._cut(cells, square)
        view_map = ViewMap(
            view_size=self.view_size,
            display_size=self.display_size,
            points=pieces.points,
            corner=smooth.corner,
            size=smooth.size,
            nodes=self._at_nodes(smooth),
            quads=pieces.quads,
            triangles=pieces.triangles,
            reason=self._reasons(),
            tolerance=self.tolerance,
            views=self.plan.rig.display.views,
        )
        chaotic = pieces.points.view[pieces.chaotic]
        budget = None if self.is_coarse else pieces.budget
        work = sample_cells(self.plan, view_map, chaotic, budget)
        n_rays = n_strata(chaotic, self.plan.settings.samples_along)
        view_map = view_map.with_samples(*(yield from self._during(self.samples, work, n_rays)))
        view_map = replace(view_map, unchecked=None if self.is_coarse else cells)
        return (yield from checked(self.plan, view_map)) if self.is_checked else view_map

    def _cut(self, cells: Ints, square: Ints) -> Steps[CutPixels]:
        """Pieces of pixels (m, 4) in squares (m,), by number."""
        cutting = Cutting(self.plan, self.points, self.is_coarse)
        first, second, last = (section(self.borders, k, 3) for k in range(3))
        some = yield from self._during(first, cutting.pixels(cells, square))
        if not self.is_coarse:
            yield from self._during(second, cutting.quarters(some))
        return (yield from self._during(last, cutting.finished()))

    def _reasons(self) -> np.ndarray:
        """Reason at the corners (h + 1, w + 1) of the viewer's pixels, of a node nearby if not
        traced.
        """
        step = self.first_size // PARTS
        at = self.number[::step, ::step]
        reasons = self.points.reason[at]

        while step > 1:
            step //= 2
            at = self.number[::step, ::step]
            rows, columns = ((np.arange(n) + 1) // 2 for n in at.shape)
            reasons = reasons.take(rows, axis=0).take(columns, axis=1)
            traced = at >= 0
            reasons[traced] = self.points.reason[at[traced]]

        w, h = self.view_size
        return reasons[: h + 1, : w + 1].copy()
