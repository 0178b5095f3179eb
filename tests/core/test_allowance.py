"""No viewer pixel takes more rays than Effort allows, whatever the glass; its light stays right.

Rays are counted where they start, as they are asked of the viewer.
"""

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from kiriko.core.base.steps import finish
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.map import measured_error, sampling
from kiriko.core.map.ray_budget import ALLOWANCE, Allowance, most_rays
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
    mean_normals,
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
    plan = make_plan(a_rig, settings)
    with counted_rays(plan.viewer) as counts, patch.object(measured_error, "measure", unmeasured):
        found = finish(sampling.sample(plan))
    assert counts.sum() == found.n_rays
    return counts


@cache
def hard(name):
    return HARD[name]()


@pytest.mark.parametrize("effort", [1, 4, 16, 64])
@pytest.mark.parametrize("name", HARD)
def test_no_pixel_takes_more_rays_than_are_allowed(name, effort):
    """For its map, less than the rays kept for others, at the default and at a fine tolerance."""
    most = ALLOWANCE.times_effort * effort - ALLOWANCE.apart
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
    most = ALLOWANCE.times_effort * effort * (256**2 // 24**2)
    assert most_rays(make_plan(facets, Settings(effort=effort))) == most
    assert rays_of_pixels(facets, Settings(effort=effort)).max() < most


def test_a_finer_viewer_takes_no_more_for_it():
    """One display pixel counts where there is less than one."""
    plan = make_plan(ball_rig(1, pixels=64, display_pixels=8), Settings(effort=2))
    assert most_rays(plan) == ALLOWANCE.times_effort * 2


def test_a_pixel_may_take_all_that_it_is_allowed():
    """Where borders are many and Effort is little, nearly all rays are taken."""
    most = ALLOWANCE.times_effort * 2 - ALLOWANCE.apart
    assert rays_of_pixels(hard("hollow bottle"), Settings(effort=2)).max() > 0.9 * most


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


def rough_ball():
    """As drawn: bent normals of noisy triangles, each a pixel or two."""
    ball = icosphere(0.025, 4)
    off = 2e-4 * np.random.default_rng(7).standard_normal((len(ball.vertices), 1))
    mesh = replace(ball, vertices=ball.vertices * (1 + off / 0.025))
    return glass_rig(replace(mean_normals(mesh), surface="facets"), **SMALL)


def errors_of(a_rig, effort):
    """Display px between landings and where cells show them, at random places; and all rays."""
    found = solve(a_rig, effort=effort)
    xy = np.random.default_rng(3).random((40_000, 2)) * found.first.view_map.view_size
    landings = trace_all(make_plan(a_rig, Settings()), *a_rig.viewer.rays(xy))
    expected = finish(found.first.view_map.lookup.by_cells(xy))[landings.has_arrived]
    off = np.linalg.norm(expected - landings.xy[landings.has_arrived], axis=1)
    return off[np.isfinite(off)], found.n_rays


def test_more_effort_cuts_finer_where_faces_bend_light_in_each_pixel():
    """The error falls by more than a quarter where it is large, for less than twice the rays; less
    Effort than the default changes nothing there.
    """
    less, default, more = (errors_of(rough_ball(), effort) for effort in (8, 16, 64))
    assert np.quantile(less[0], 0.9) == pytest.approx(np.quantile(default[0], 0.9), rel=0.05)
    assert np.quantile(more[0], 0.9) < 0.75 * np.quantile(default[0], 0.9)
    assert (more[0] > 0.4).mean() < 0.6 * (default[0] > 0.4).mean()
    assert more[1] < 2 * default[1]


def test_more_effort_takes_no_more_rays_of_a_smooth_ball():
    """But at its edge, by a hundredth."""
    rays = [solve(ball_rig(4, pixels=64), effort=effort).n_rays for effort in (16, 64)]
    assert rays[0] <= rays[1] < 1.01 * rays[0]


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
    plan = make_plan(ball_rig(1, pixels=8, display_pixels=8), Settings(effort=1))
    allowance = Allowance(plan, np.array([[2.5, 3.5]]))
    left = ALLOWANCE.times_effort - ALLOWANCE.apart - 1
    view = np.array([[2.5, 3.9], [2.1, 3.1], [2.9, 3.1], [7.0, 7.0]])
    n_rays = np.array([1, left - 3, 2, left])
    # one is kept for the sample
    assert allowance.lacks(view, n_rays).tolist() == [True, False, False, False]
    assert allowance.lacks(view[:1], left).tolist() == [True]
    assert allowance.lacks(view[:1], left - 1).tolist() == [False]
    allowance.take(view[:3], n_rays[:3])
    assert allowance.lacks(view).tolist() == [True, True, True, False]
    allowance.keep(2)
    assert allowance.lacks(view[3:], left - 15 + 1 + 1).tolist() == [True]
