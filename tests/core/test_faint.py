"""Chaotic light that falls where the display is faint is sampled by more rays, as many as lower the
variance of all display pixels most; and none of it is lost.
"""

from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from kiriko.core.base import free_memory
from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.map import samples
from kiriko.core.map.points import Points
from kiriko.core.map.ray_budget import RayBudget, most_rays
from kiriko.core.map.samples import (
    further_along,
    light_on_blocks,
    numbers_along,
    sample_cells,
    samples_worth,
)
from kiriko.core.map.sampling import Sampling, sample
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, facetted_rig
from known.work import drain, solve

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SIDE = 32  # viewer and display px of a field


def points_at(xy, is_lit=True, reason=0):
    """Points (n,) that land at display pixels, or none of which does."""
    n = len(xy)
    branch = np.full(n, np.uint64(is_lit))
    return Points(np.zeros((n, 2)), np.asarray(xy, float), branch, np.full(n, reason), np.ones(n))


def pixels(side):
    """The corners (side^2, 4, 2) of a square of pixels."""
    row, column = np.divmod(np.arange(side**2), side)
    return SQUARE + np.stack([column, row], axis=1)[:, None]


def a_plan(side=SIDE, effort=16):
    return compile_plan(ball_rig(1, pixels=side, display_pixels=side), Settings(effort=effort))


@pytest.mark.parametrize(
    ("along", "numbers"),
    [
        (1, [1]),
        (2, [2, 3]),
        (3, [3, 4]),
        (4, [4, 6]),
        (8, [8, 12]),
        (12, [12]),
        (13, []),
    ],
)
def test_faint_light_takes_at_most_2_25_times_effort_and_144_further_rays(along, numbers):
    assert numbers_along(along) == numbers
    assert all(n**2 <= min(2.25 * along**2, 144) for n in numbers)


def test_the_light_on_blocks_is_all_that_lands():
    """Through a ball, most of whose light lands: to 2 %."""
    found = solve(ball_rig(3, pixels=64, display_pixels=64, display=0.2))
    light = run_steps(light_on_blocks(found.first.view_map))
    assert light.shape == (64,)
    assert light.sum() == pytest.approx(found.weight.sum(), rel=0.02)
    blocks = found.weight.reshape(8, 8, 8, 8).sum(axis=(1, 3))
    assert np.abs(light.reshape(8, 8) - blocks).max() < 0.1 * blocks.max()


def test_a_cell_is_worth_samples_by_how_faint_light_around_it_is():
    """Effort / b where all of it falls on light b, and by the root of its lit part (Neyman), of
    samples of the other colour alone: its own land beside the display.
    """
    plan = a_plan(16)
    corners = pixels(16)[:3]  # the middle one has the others beside it
    xy = np.array([[1, 1], [1, 1], [99, 1], [99, 1], [12, 1], [12, 1]], float)
    area, owner = np.full(6, 0.5), np.repeat(np.arange(3), 2)
    light = 64 * np.array([0.5, 0.25, 1.0, 1.0])

    def worth(points):
        work = samples_worth(plan, light, points, area, owner, corners.mean(axis=1))
        return run_steps(work)

    # those that tell stand for all three: half again as much light
    b = light[:2] / 64 + 1.5 / 64
    expected = 16 * np.sqrt(np.mean(1 / b**2))
    assert worth(points_at(xy)) == pytest.approx([0, expected, 0])
    assert (worth(points_at(xy, is_lit=False)) == 0).all()
    assert (worth(points_at(xy, reason=Reason.MISSED_GLASS)) == 0).all()


def test_a_cell_takes_as_many_samples_as_it_is_worth_and_its_allowance_has():
    plan = a_plan(8)
    allowance = RayBudget(plan, np.empty((0, 2)))
    middle = np.array([[0.5, 0.5], [1.5, 0.5], [2.5, 0.5], [3.25, 0.25], [3.75, 0.25], [4.5, 0.5]])
    side = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 1.0])
    allowance.take(middle[1:2], 340)
    left = allowance.left.copy()
    worth = np.array([1000, 1000, 51.9, 1000, 1000, 31.9])
    found = further_along(worth, middle, side, 4, allowance)
    assert found.tolist() == [6, 4, 4, 6, 6, 0]
    assert (left - allowance.left)[:5].tolist() == [36, 16, 16, 18, 0]


def in_field(trace, n_times, display=SIDE):
    """Samples of a field of chaotic pixels, so often, whose rays land as a function of their
    places and a generator of random numbers tells.
    """
    a_rig = ball_rig(1, pixels=SIDE, display_pixels=display)
    plan = compile_plan(a_rig, Settings())
    view = solve(a_rig).first.view_map
    none = view.quads[:0], view.triangles[:0], view.corner[:0], view.size[:0], view.nodes[:0]
    names = ("quads", "triangles", "corner", "size", "nodes")
    empty = samples.replace(view, **dict(zip(names, none, strict=True)))
    random = np.random.default_rng(7)

    def traced(plan, places):
        xy = trace(places, random)
        n = len(xy)
        yield n
        return Points(places, xy, np.ones(n, np.uint64), np.zeros(n), np.ones(n))

    with patch.object(samples, "trace_points", traced):
        for _ in range(n_times):
            allowance = RayBudget(plan, np.empty((0, 2)))
            yield run_steps(sample_cells(plan, empty, pixels(SIDE), allowance))


@pytest.mark.parametrize("share", [0.001, 0.003, 0.01, 0.03, 0.1, 0.3])
def test_faint_light_arrives_as_much_as_there_is(share):
    """Of pixels all alike a share goes to a quarter of the display: on average that arrives, within
    three standard errors; and where more samples are worth it they are taken.
    """

    def trace(places, random):
        is_faint = random.random(len(places)) < share
        return random.random((len(places), 2)) * [SIDE, 8] + np.outer(is_faint, [0, 24])

    found = list(in_field(trace, 40))
    arrived = [s.area[s.points.xy[:, 1] >= 24].sum() / SIDE**2 for s in found]
    deviation = np.std(arrived, ddof=1) / np.sqrt(len(arrived))
    assert abs(np.mean(arrived) - share) < 3 * deviation
    assert all(s.area.sum() == pytest.approx(SIDE**2) for s in found)
    more = np.mean([len(s.area) for s in found]) / (16 * SIDE**2)
    assert more > 1.3 if share < 0.02 else more >= 1


@pytest.mark.parametrize("lit", [0.003, 0.01, 0.03])
def test_light_is_kept_where_a_few_samples_are_all_that_lights_a_place(lit):
    """Each 4 x 4 pixels send a part of their light to a block of their own, so that a sample there
    counts among few. Whether one is there is no reason to keep or to weigh less what its pixel
    found. Within three standard errors.
    """

    def trace(places, random):
        group = np.floor(places / 4) + np.array([0, 2])
        is_faint = random.random(len(places)) < lit
        far = random.random((len(places), 2))
        return np.where(is_faint[:, None], 8 * (group + far), far * [96, 8])

    found = list(in_field(trace, 40, display=96))
    arrived = [s.area[s.points.xy[:, 1] >= 8].sum() / SIDE**2 for s in found]
    deviation = np.std(arrived, ddof=1) / np.sqrt(len(arrived))
    assert abs(np.mean(arrived) - lit) < 3 * deviation
    assert min(len(s.area) for s in found) > 1.5 * 16 * SIDE**2


@cache
def solved():
    return solve(facetted_rig())


@cache
def many():
    """Very many samples of all light alike."""
    with without_further():
        return solve(facetted_rig(), effort=4096)


def without_further():
    return patch.object(samples, "numbers_along", lambda along: [])


@pytest.mark.long(
    reason="a comparison of two ways to spend rays: what they show is tested next to it"
)
def test_further_rays_for_faint_light_are_worth_more_than_more_effort():
    """Against very many samples, with all display pixels alike, it errs no more by two fifths
    fewer.
    """
    with without_further():
        alike = solve(facetted_rig(), effort=49)
    ours, theirs = (
        np.sqrt(np.mean((some.source - many().source) ** 2)) for some in (solved(), alike)
    )
    assert solved().first.map_error.n_samples < 0.6 * alike.first.map_error.n_samples
    assert ours < theirs


def test_faint_and_bright_places_have_the_light_that_many_samples_find():
    """The display's blocks, from the faintest to the brightest, by tenths; nothing is where they
    find nothing.
    """
    much, found = (
        some.weight.reshape(16, 4, 16, 4).sum(axis=(1, 3)).ravel() for some in (many(), solved())
    )
    for some in np.array_split(np.argsort(much)[(much == 0).sum() :], 10):
        # n samples of a pixel know a light of so much of a pixel to 1 / sqrt(n)
        light = much[some].sum()
        assert abs(found[some].sum() - light) < np.sqrt(light / 16)
    assert (found[much == 0] == 0).all()


def test_every_place_of_a_pixel_with_further_samples_is_near_one_of_them():
    """So that the map knows it."""
    found = solved().first.view_map
    number = np.floor(found.points.view[found.samples]).astype(int) @ [1, 64]
    whole = np.bincount(number, found.sample_area) > 1 - 1e-9
    further = np.bincount(number) > 16
    row, column = np.divmod(np.flatnonzero(whole & further), 64)
    at = np.stack([column, row], axis=1).repeat(20, axis=0)
    at = at + np.random.default_rng(3).random((len(at), 2))
    rays, _ = found.lookup.nearest_samples(at, np.ones(len(at), bool))
    assert len(at) > 5000
    assert len(rays) == len(at)


def test_numpy_takes_the_same_samples():
    """Of the same cells; where rounding decides on a ray, a few may take others."""
    pytest.importorskip("kiriko_kernel")
    found = solve(facetted_rig(32)).first.view_map
    with loading.off():
        other = solve(facetted_rig(32)).first.view_map
    assert len(found.samples) > 1.5 * 16 * found.sample_area.sum()
    ours, theirs = (set(map(tuple, one.points.view[one.samples])) for one in (found, other))
    assert len(ours ^ theirs) < 0.01 * len(ours)


def test_much_effort_clear_glass_and_first_pictures_take_no_more():
    """Effort of more than 144 gains nothing by it, nor does light of which less than a thousandth
    of the view is chaotic. What would tell which cells are worth more is not done then.
    """
    few = pixels(SIDE)[:1]
    every = pixels(SIDE)[:16]
    allowance = RayBudget(a_plan(), np.empty((0, 2)))
    with patch.object(samples, "light_on_blocks", side_effect=AssertionError):
        for effort, corners, allowed in (
            (169, every, allowance),
            (16, few, allowance),
            (16, every[:0], allowance),
            (16, every, None),
        ):
            work = sample_cells(a_plan(effort=effort), None, corners, allowed)
            found = run_steps(work)
            assert len(found.points) == Settings(effort=effort).samples_along ** 2 * len(corners)
            assert found.area.sum() == pytest.approx(len(corners))


def test_no_pixel_takes_more_rays_than_it_may():
    for effort in (1, 2, 4, 16):
        found = solve(facetted_rig(32), effort=effort).first.view_map
        column, row = np.floor(found.points.view).astype(int).T
        plan = compile_plan(facetted_rig(32), Settings(effort=effort))
        assert np.bincount(33 * row + column).max() <= most_rays(plan)
        samples_of = np.bincount(33 * row[found.samples] + column[found.samples])
        assert samples_of.max() <= max(3.25 * effort, 8)  # quarters take one or two each


def stopped_in_the_second_sampling(plan):
    """The work of a map that waits while further samples are traced."""
    work = Sampling(plan).sample()
    seen = []

    def traced(a_plan, places):
        seen.append(len(places))
        return real(a_plan, places)

    real = samples.trace_points
    with patch.object(samples, "trace_points", traced):
        while len(seen) < 2:
            next(work)
    return work, seen


def test_it_can_be_stopped_while_further_samples_are_traced():
    """The work ends at once, and does so without a trace in what comes after."""
    plan = compile_plan(facetted_rig(32), Settings())
    work, seen = stopped_in_the_second_sampling(plan)
    work.close()
    with pytest.raises(StopIteration):
        next(work)
    found = drain(sample(plan))
    assert len(found.samples) == sum(seen)


def test_further_samples_that_memory_does_not_hold_are_refused():
    """As many bytes as Effort takes are free, and no more."""
    plan = compile_plan(facetted_rig(), Settings())
    n = solved().first.map_error.n_samples
    asked = []
    real = samples.check_free

    def check(needed, *words):
        asked.append(needed)
        with patch.object(free_memory, "available", lambda: asked[0] + 1):
            real(needed, *words)

    with patch.object(samples, "check_free", check), pytest.raises(RigError, match="lower Effort"):
        drain(sample(plan))
    assert asked[1] == samples.BYTES_OF_POINT * n
