"""No viewer pixel takes more rays than Effort allows, whatever the glass; its light stays right.

Rays are counted where they start, as they are asked of the viewer.
"""

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.map import measured_error, sampling
from kiriko.core.map.ray_budget import OTHER_RAYS, TIMES_EFFORT, RayBudget, most_rays
from kiriko.core.map.view_map import NO_ERROR
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from known.counted_rays import counted_rays
from known.reference_rigs import (
    ball_rig,
    bottle,
    box,
    cube_rig,
    glass_rig,
    icosphere,
    rig,
    torus,
)
from known.work import solve

SMALL = {"pixels": 40, "display_pixels": 40}


def nested():
    """A ball in a box that is turned: every edge is seen several times."""
    a_rig = rig(box([0.04] * 3, degrees_about_z=20.0), **SMALL)
    return replace(a_rig, glasses=a_rig.glasses + ball_rig(2).glasses)


HARD = {
    "hollow bottle": lambda: glass_rig(bottle(), **SMALL),
    "torus": lambda: glass_rig(torus(0.04, 0.015), **SMALL),
    "1280 flat facets": lambda: rig(icosphere(0.025, 3, smooth=False), **SMALL),
    "80 flat facets": lambda: rig(icosphere(0.025, 1, smooth=False), **SMALL),
    "cube": lambda: cube_rig(**SMALL),
    "ball in a box": nested,
}


def unmeasured(*_):
    """No errors, by no rays."""
    yield 0
    return NO_ERROR


def rays_of_pixels(a_rig, settings):
    """Rays of each pixel for its map alone."""
    plan = compile_plan(a_rig, settings)
    with counted_rays(plan.viewer) as counts, patch.object(measured_error, "measure", unmeasured):
        found = run_steps(sampling.sample(plan))
    assert counts.sum() == found.n_rays
    return counts


@cache
def hard(name):
    return HARD[name]()


@pytest.mark.parametrize("effort", [1, 4, 16, 64])
@pytest.mark.parametrize("name", HARD)
def test_no_pixel_takes_more_rays_than_are_allowed(name, effort):
    """For its map, less than the rays kept for others, at the default and at a fine tolerance."""
    most = TIMES_EFFORT * effort - OTHER_RAYS
    assert rays_of_pixels(hard(name), Settings(effort=effort)).max() <= most
    fine = Settings(effort=effort, tolerance=0.001)
    assert rays_of_pixels(hard(name), fine).max() <= most


@pytest.mark.parametrize("effort", [1, 4])
def test_a_finer_display_allows_more_rays_so_that_no_holes_are_left(effort):
    """For each of its pixels that there is for one of the viewer; of flat facets, which are cut
    exactly, as much of it is lit as by more effort.
    """
    facets = rig(icosphere(0.025, 2, smooth=False), pixels=24, display_pixels=256)
    lit = (solve(facets, effort=effort).weight > 0).mean()
    assert lit == pytest.approx((solve(facets).weight > 0).mean(), rel=0.01)
    most = TIMES_EFFORT * effort * (256**2 // 24**2)
    assert most_rays(compile_plan(facets, Settings(effort=effort))) == most
    assert rays_of_pixels(facets, Settings(effort=effort)).max() < most


def test_a_finer_viewer_takes_no_more_for_it():
    """One display pixel counts where there is less than one."""
    plan = compile_plan(ball_rig(1, pixels=64, display_pixels=8), Settings(effort=2))
    assert most_rays(plan) == TIMES_EFFORT * 2


def test_a_pixel_may_take_all_that_it_is_allowed():
    """Where borders are many and Effort is little, nearly all rays are taken."""
    most = TIMES_EFFORT * 2 - OTHER_RAYS
    assert rays_of_pixels(hard("hollow bottle"), Settings(effort=2)).max() > 0.8 * most


def test_numpy_and_the_kernel_take_the_same_rays():
    """In each pixel, where many have none left."""
    settings = Settings(effort=4)
    by_kernel = rays_of_pixels(hard("hollow bottle"), settings)
    with loading.off():
        assert np.array_equal(rays_of_pixels(hard("hollow bottle"), settings), by_kernel)


def test_less_effort_takes_fewer_rays_and_samples_more():
    """All is sampled that borders cross at the least Effort, and told as not resolved."""
    rays, sampled = [], []
    for effort in (1, 4, 16, 64):
        solution = solve(hard("hollow bottle"), effort=effort)
        error = solution.first.map_error
        rays.append(solution.n_rays)
        sampled.append(error.sampled)
        assert error.noise == pytest.approx(error.sampled / Settings(effort=effort).samples_along)
        assert error.unresolved >= error.noise
    assert sorted(rays) == rays
    assert rays[0] < rays[2] / 2
    assert sampled[0] > 2 * sampled[2]


@cache
def by_default(name):
    return solve(hard(name))


@pytest.mark.parametrize("effort", [1, 4, 64])
@pytest.mark.parametrize("name", ["hollow bottle", "cube", "ball in a box"])
def test_the_light_is_the_same_at_any_effort(name, effort):
    """In all, to 4 % of that by the default, as facets are cut there; no pixel is seen more than
    whole.
    """
    found = solve(hard(name), effort=effort)
    much = by_default(name)
    assert found.first.view_coverage.max() <= 1 + 1e-9
    assert found.weight.sum() == pytest.approx(much.weight.sum(), rel=0.04)


def test_an_allowance_is_taken_row_by_row():
    """Of rays that are asked for at once the first are allowed, as many as are left."""
    plan = compile_plan(ball_rig(1, pixels=8, display_pixels=8), Settings(effort=1))
    allowance = RayBudget(plan, np.array([[2.5, 3.5]]))
    left = TIMES_EFFORT - OTHER_RAYS - 1
    view = np.array([[2.5, 3.9], [2.1, 3.1], [2.9, 3.1], [7.0, 7.0]])
    n_rays = np.array([1, left - 6, 2, left - 4])
    # four are kept, one for each quarter
    assert allowance.exceeds(view, n_rays).tolist() == [True, False, False, False]
    assert allowance.exceeds(view[:1], left - 3).tolist() == [True]
    assert allowance.exceeds(view[:1], left - 4).tolist() == [False]
    allowance.take(view[:3], n_rays[:3])
    assert allowance.exceeds(view).tolist() == [True, True, True, False]
