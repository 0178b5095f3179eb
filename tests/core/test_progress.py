"""The rest of a solve as it is told, by a clock that the tests set."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from kiriko.core.image import ghosts
from kiriko.core.image.source_image import Painting
from kiriko.core.light.planning import make_plan
from kiriko.core.map.points import Points
from kiriko.core.map.ray_guess import Rays, RaysAhead, rays_of_finest
from kiriko.core.map.sampling import Sampling
from kiriko.core.map.share_batches import ShareBatches
from kiriko.core.map.share_guess import CellsAndShares, smooth_ahead
from kiriko.core.map.squares import Squares
from kiriko.core.native import loading
from kiriko.core.settings import Settings
from kiriko.core.solve import (
    known,
    pace,
    painted_part,
    painting,
    picture_coverage,
    progress,
    reach,
    session,
)
from kiriko.core.solve.pace import GlassPace, Pace, Seconds
from kiriko.core.solve.progress import Ahead, Bar
from kiriko.core.solve.session import Session
from kiriko.core.steps import finish
from known.reference_rigs import ball_rig, bottle, cube_rig, glass_rig, icosphere, rig, torus

RIGS = {
    "ball": lambda: ball_rig(4, pixels=256),
    "torus": lambda: glass_rig(torus(0.04, 0.015), pixels=256),
    "ball before a finer display": lambda: ball_rig(4, pixels=128, display_pixels=512),
    "cube before a finer display": lambda: cube_rig(pixels=128, display_pixels=512),
    "bottle before a finer display": lambda: glass_rig(bottle(), pixels=128, display_pixels=768),
    "torus before a finer display": lambda: glass_rig(
        torus(0.04, 0.015), pixels=128, display_pixels=768
    ),
}
# s, by the clock that goes by counts
RAY = 2e-6
CELL = 0.5e-6
SHARE = 0.3e-6
MADE = 0.4  # of it
FOUND = 0.8e-6
JOINED = 4e-6
AT_ONCE = GlassPace(searched=1.0, search=0.0, measured=0.0)
OF_COUNTS = Pace(
    flat=AT_ONCE,
    curved=AT_ONCE,
    bent=AT_ONCE,
    painted_pixel=Seconds(0.0),
    painted_cell=Seconds(CELL),
    painted_share=Seconds(SHARE),
    made_share=MADE,
    found_share=FOUND,
    covered_pixel=0.0,
    covered_point=0.0,
    joined_cell=JOINED,
    summed_cell=0.0,
    guessed_cell=0.0,
    measured_point=0.0,
    planned_again=0.0,
)


@contextmanager
def counting_clock(monkeypatch) -> Iterator[list[float]]:
    """A clock that goes by the rays that are traced, the cells that are put together, and gathered
    for the display, and the shares that are made and painted, which take so many seconds each; and
    the pace of solves by it; to find the strongest paths takes its time by shares as well. All
    else takes no time.
    """
    now = [0.0]
    n_found = [0]
    find_strokes = painting.find_strokes

    def find(picture, viewer, shares, reads):
        n_found[0] = len(shares)
        return find_strokes(picture, viewer, shares, reads)

    def goes_by(owner: type, name: str, seconds: Callable[..., float]) -> None:
        of_owner = getattr(owner, name)

        def works(*given):
            now[0] += seconds(*given)
            return of_owner(*given)

        patch.setattr(owner, name, works)

    with monkeypatch.context() as patch:
        for module in (reach, progress, painting):
            patch.setattr(module, "perf_counter", lambda: now[0])
        for module in (pace, progress):
            patch.setattr(module, "times_slower", lambda: 1.0)
        for module in (pace, progress, painted_part):
            patch.setattr(module, "pace", lambda: OF_COUNTS)
        goes_by(RaysAhead, "count", lambda _, n: RAY * n)
        goes_by(RaysAhead, "join", lambda _, n, __: JOINED * n)
        goes_by(ShareBatches, "_gather", lambda _, n: CELL * n)
        goes_by(ShareBatches, "_count", lambda _, __, n: MADE * SHARE * n)
        goes_by(ghosts.Paths, "add_rows", lambda _, pixel, *__: FOUND * len(pixel))
        goes_by(Painting, "add", lambda *_: (1 - MADE) * SHARE * n_found[0])
        patch.setattr(painting, "find_strokes", find)
        yield now


@pytest.mark.skipif(loading.library() is None, reason="numpy takes minutes for it")
@pytest.mark.parametrize(
    ("name", "choice"), [*((name, "mean") for name in RIGS), ("torus", "strongest")]
)
def test_the_rest_is_told_within_a_factor_of_two(monkeypatch, name, choice):
    """From 10 % to 90 % of the work as it is told. Half of the time and more goes to shares, none
    of which is made before all rays are traced, and most to their paths where these are looked for.
    """
    with counting_clock(monkeypatch) as now:
        told, seconds = [], []
        for part in Session().solve(RIGS[name](), Settings(ghosts=choice)):
            told.append(part)
            seconds.append(now[0])
    told, seconds = np.array(told), np.array(seconds)
    some = (told >= 0.1) & (told <= 0.9)
    assert some.sum() >= 10
    factor = seconds[some] * (1 / told[some] - 1) / (now[0] - seconds[some])
    assert factor.min() >= 0.5
    assert factor.max() <= 2


def test_threads_share_what_the_kernel_does():
    """What numpy does takes its time, however many there are."""
    seconds = Seconds(alone=2.0, shared=6.0)
    try:
        loading.use_threads(1)
        of_one = seconds.by_clock / pace.times_slower()
        loading.use_threads(3)
        of_three = seconds.by_clock / pace.times_slower()
    finally:
        loading.use_threads(0)
    assert of_one == pytest.approx(2 + 6)
    assert of_three == pytest.approx(2 + 6 / 3)


def test_while_nothing_new_is_told_the_rest_of_the_time_passes(monkeypatch):
    """Second by second at first, then ever more slowly: it never ends so. A part
    that is done by half when half of its time is over has the other half to go.
    """
    now = [0.0]
    monkeypatch.setattr(progress, "perf_counter", lambda: now[0])

    def silent():
        for _ in range(80):
            now[0] += 0.01
            yield 0.0
        now[0] = 1.0
        yield 0.5

    told = list(Bar().during(silent(), expected=2.0, after=0.0))
    seconds = [0.01 * (k + 1) for k in range(80)]
    rests = [at / part - at for at, part in zip(seconds, told, strict=False)]
    assert rests == sorted(rests, reverse=True)
    assert rests[0] == pytest.approx(2.0 - 0.01, rel=1e-3)
    assert 2.0 - 0.8 < rests[-1] < 2.0
    assert told[-1] == pytest.approx(0.5)


def test_a_search_that_has_ended_tells_how_long_the_next_will_take(monkeypatch):
    """Rays of 1 ms, then 1000 that are searched with and take 10 ms: so will the next 1000.

    While it is under way the first, many at once, do not tell that it is fast.
    """
    monkeypatch.setattr(progress, "times_slower", lambda: 1.0)
    ahead = Ahead(make_plan(cube_rig(pixels=64), Settings()), of_plan=0.0)
    rays = RaysAhead(0)
    rays.count(1000)
    rays.expect(Rays(2000, 2000, searches=2))
    expected = ahead._to_trace(rays, 1.0)

    rays.is_searching = True
    rays.count(1)
    ahead._to_trace(rays, 1.0)
    rays.count(899)
    assert ahead._to_trace(rays, 1.01) == pytest.approx(expected * 1100 / 2000, rel=0.02)

    rays.count(100)
    rays.is_searching = False
    rays.to_come = rays.to_come._replace(searches=1)
    assert ahead._to_trace(rays, 11.0) == pytest.approx(10.0, rel=0.02)


def test_all_that_is_still_to_come_counts_beside_rays(monkeypatch):
    """Cells to be put together and points that a map is measured by: each by its pace. Light is
    summed up only where samples are to be told by it.
    """
    monkeypatch.setattr(pace, "times_slower", lambda: 1.0)
    monkeypatch.setattr(progress, "times_slower", lambda: 1.0)
    ahead = Ahead(make_plan(cube_rig(pixels=64), Settings()), of_plan=0.0)
    rays = RaysAhead(0)
    rays.count(1000)
    rays.expect(Rays(0))
    rays.n_shares = rays.n_pieces = 0.0
    rays.join(0, 0.0)
    before = ahead.seconds(rays, 1.0)

    rays.join(0, 1e6)
    by_cells = ahead.seconds(rays, 1.0) - before
    assert by_cells == pytest.approx(1e6 * pace.pace().joined_cell)
    rays.join(1e6, 0.0)
    assert ahead.seconds(rays, 1.0) == pytest.approx(before, rel=0.05)

    rays.n_pieces = 1e6
    without = ahead.seconds(rays, 1.0)
    rays.sums_light = True
    assert ahead.seconds(rays, 1.0) - without == pytest.approx(1e6 * pace.pace().summed_cell)


def test_light_is_to_be_summed_up_until_it_is():
    """Flat facets are chaotic for the most part."""
    a_rig = rig(icosphere(0.025, 3, smooth=False), pixels=48, display_pixels=48)
    sampling = Sampling(make_plan(a_rig, Settings()))
    told = [sampling.ahead.sums_light for _ in sampling.sample()]
    assert any(told)
    assert not told[-1]


def test_how_much_of_the_picture_is_shown_is_found_with_pauses(monkeypatch):
    """Esc is heard while the rays within pixels are counted, which may be millions."""
    solution = finish(Session().solve(cube_rig(pixels=64), Settings()))
    one = solution.first
    monkeypatch.setattr(picture_coverage, "POINTS_AT_ONCE", 1000)
    steps = picture_coverage.of_the_picture(
        one.plan.rig.picture_place, one.plan.viewer, one.view_map, one.view_coverage
    )
    assert sum(1 for _ in steps) >= len(one.view_map.points) / 1000 > 2
    again = picture_coverage.of_the_picture(
        one.plan.rig.picture_place, one.plan.viewer, one.view_map, one.view_coverage
    )
    assert finish(again) == (one.picture_coverage, one.misses)


def test_time_passes_while_it_is_found_how_much_of_the_picture_is_shown(monkeypatch):
    """That takes a good part of a short solve, and tells of nothing on its way."""
    told = []
    cover = painting.Placed.cover

    def slowly(placed, view_map):
        for _ in range(10):
            now[0] += 0.1
            yield 0
            told.append(parts[-1])
        yield from cover(placed, view_map)

    parts = []
    with counting_clock(monkeypatch) as now:
        monkeypatch.setattr(painting.Placed, "cover", slowly)
        for module in (known, session):
            monkeypatch.setattr(module, "seconds_to_cover", lambda _: 1.0)
        for part in Session().solve(cube_rig(pixels=64), Settings()):
            parts.append(part)
    assert told == sorted(set(told))
    # a second of which half a second is left, as long as it may last longer
    passed = now[0] - 1.0
    assert told[-1] == pytest.approx((passed + 1.0) / (passed + 1.5))


def test_a_square_that_is_only_bent_takes_no_search():
    """Quarters of its pixels lie on its branch: they take rays, but hardly one has a border."""
    plan = make_plan(cube_rig(pixels=64), Settings())
    bent = np.random.default_rng(0).uniform(10, 50, (3, 25, 2))
    found = rays_of_finest(plan, np.ones((3, 25), np.uint64), bent)
    assert found.every >= 3 * 16 * 10
    assert found.searched == 0


def test_a_small_square_that_looks_bent_is_no_cell_before_it_has_passed():
    """It would be one of very many quads; most such squares do not pass."""
    plan = make_plan(cube_rig(pixels=64), Settings())
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    even = 10 + 3 * np.stack([x, y], axis=-1).reshape(25, 2)
    bent = np.random.default_rng(0).uniform(10, 50, (25, 2))
    xy = np.concatenate([bent, even])
    branch = np.ones(50, np.uint64)
    points = Points(xy, xy, branch, np.zeros(50, np.uint8), np.ones(50))
    squares = Squares(np.array([[0, 0], [4, 0]]), np.array([4, 4]))

    def ahead(some: Squares, n_passed: int) -> CellsAndShares:
        return smooth_ahead(
            plan, points, some, n_passed, lambda of: 25 * (of.corner[:, :1] // 4) + np.arange(25)
        )

    alone = ahead(squares.at(np.array([1])), 0)
    assert alone.n_cells > 0
    assert ahead(squares, 0) == alone
    assert ahead(squares, 1).n_cells > 10 * alone.n_cells
