"""Where light is chaotic pixels are sampled: right on
average, the nearer the more samples, and told.

The judge is brute force: random rays, each on its own.
"""

import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kiriko.core.base import free_memory
from kiriko.core.base.errors import RigError
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.map.samples import strata
from kiriko.core.map.sampling import sample
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, cube_rig, icosphere, rig
from known.work import drain, solve

PIXELS = 48
BLOCKS = 32  # along the display, over which light is summed up


@cache
def facetted():
    """A flat-shaded ball of 1280 facets: light goes through front
    and back ones in thousands of combinations.
    """
    return rig(icosphere(0.025, 3, smooth=False), pixels=PIXELS, display=0.2, display_pixels=256)


@cache
def solved(effort=16):
    return solve(facetted(), effort=effort)


def on_blocks(weight):
    """Light (BLOCKS, BLOCKS) on parts of the display, viewer px^2."""
    step = weight.shape[0] // BLOCKS
    return weight.reshape(BLOCKS, step, BLOCKS, step).sum(axis=(1, 3))


@cache
def brute_force(spp=200):
    """The same light by random rays, and its standard error."""
    a_rig = facetted()
    xy = np.random.default_rng(5).random((spp * PIXELS**2, 2)) * PIXELS
    landings = trace_all(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(xy))
    is_seen, pixel = landings.pixels(256, 256)
    light = on_blocks(np.bincount(pixel[is_seen], minlength=256**2).reshape(256, 256)) / spp
    return light, np.sqrt(np.maximum(light, 1 / spp) / spp)


def test_the_light_is_that_of_random_rays():
    """On each part of the display, within both uncertainties; and in all."""
    light, deviation = brute_force()
    found = on_blocks(solved().weight)
    assert solved().first.map_error.sampled > 0.2
    assert abs(found.sum() - light.sum()) < 0.02 * light.sum()
    # 16 samples a pixel know the light of a part that covers n pixels to 1 / sqrt(16 n)
    error = np.hypot(deviation, np.sqrt(np.maximum(light, 1 / 16) / 16))
    assert np.abs(found - light).max() < 5 * error.max()
    assert np.sqrt(np.mean(((found - light) / error) ** 2)) < 1.2


def test_four_times_the_effort_halves_the_noise():
    """Of the light on single display pixels, against very many samples of the same pixels."""
    many = solved(1024).weight
    noise = [np.sqrt(np.mean((solved(effort).weight - many) ** 2)) for effort in (4, 16, 64)]
    assert noise[1] < 0.6 * noise[0]
    assert noise[2] < 0.6 * noise[1]


def test_the_effort_bounds_the_rays():
    for effort in (1, 8, 16):
        error = solved(effort).first.map_error
        assert 0 < error.n_samples <= max(effort, 4) * PIXELS**2  # a quarter takes one
        assert error.noise == pytest.approx(error.sampled / Settings(effort=effort).samples_along)
        assert error.noise <= error.unresolved <= 1


def test_no_pixel_is_seen_more_than_whole():
    """Strata make up the cells they stand for, and no sample leaves its pixel."""
    assert solved().first.view_coverage.max() <= 1 + 1e-9
    found = solved().first.view_map
    assert found.sample_area.sum() <= PIXELS**2
    shares = [view.mean(axis=1) for view, *_ in found.pieces(at_pixels=True)]
    pixels = np.floor(np.concatenate(shares)).astype(int)
    assert pixels.min() >= 0
    assert pixels.max() < PIXELS


@pytest.mark.numpy_alone
def test_the_map_gives_the_nearest_sample():
    """At a sample the map gives its landing."""
    found = solved().first.view_map
    places = found.points.view[found.samples]
    assert np.array_equal(
        found.display_from_view(places), found.points.xy[found.samples], equal_nan=True
    )


def test_samples_stay_where_they_are():
    """They depend on their cell alone: not on which others are sampled, nor on how many."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cells = square + np.array([[3, 4], [7, 1], [70, 4]])[:, None]
    every, area = strata(cells, 4)
    assert np.array_equal(every[16:32], strata(cells[1:2], 4)[0])
    assert (np.floor(every.reshape(3, 16, 2)) == cells[:, :1]).all()
    assert len(np.unique(np.floor(4 * every[:16]), axis=0)) == 16  # one in each stratum
    assert area.sum() == 3
    quarters, areas = strata(0.5 * square[None] + [3.5, 4.0], 4)
    assert (np.floor(2 * quarters) == [7, 8]).all()
    assert areas.sum() == 0.25


@pytest.mark.numpy_alone
@pytest.mark.parametrize("a_rig", [ball_rig(3, pixels=64), cube_rig(pixels=64)])
def test_clear_glass_is_not_sampled(a_rig):
    """But for the pixels in which a cube's corners are seen, where several edges meet."""
    found = drain(sample(compile_plan(a_rig, Settings())))
    assert found.error.sampled < 0.005
    assert found.sample_area.sum() < 0.005 * 64**2


def test_chaos_is_told_with_what_more_effort_costs():
    (told,) = [note for note in solved().notes if "undersampled" in note]
    assert "with up to 52 rays a pixel. Raise Effort: four times as much" in told
    assert "Shade 'glass' smooth if" in told


def test_more_samples_than_memory_holds_are_refused(monkeypatch):
    monkeypatch.setattr(free_memory, "available", lambda: 1e6)
    with pytest.raises(
        RigError,
        match=r"Sampling where light is chaotic needs about .* lower Effort \(1024\), or",
    ):
        drain(sample(compile_plan(facetted(), Settings(effort=1024))))


def test_places_outside_of_the_view_are_not_on_the_map():
    """Nor a place that is not finite."""
    found = solved().first.view_map
    places = np.array([[np.nan, 1.0], [-1.0, 5.0], [np.inf, 5.0], [5.0, 1e300]])
    assert np.isnan(found.display_from_view(places)).all()
    edge = found.points.view[found.samples]
    edge = edge[np.argsort(edge[:, 1])[:20]]
    assert np.isnan(found.display_from_view(edge * [1, -1])).all()


@pytest.mark.parametrize("effort", [0, 5000, 3.5])
def test_no_effort_is_refused_and_too_much_of_it_and_parts_of_rays(effort):
    with pytest.raises(
        RigError,
        match=f"Effort is {effort:g}: set a whole number from 1 to 4096",
    ):
        replace(Settings(), effort=effort).check()


def test_much_effort_for_few_pixels_takes_little_memory():
    square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    tracemalloc.start()
    places, _ = strata(square, 64)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(places) == 4096
    assert peak < 50e6


@pytest.mark.parametrize("tolerance", [0.1, 0.01, 0.001])
def test_a_ball_has_no_chaos_however_exact_it_is(tolerance):
    """A rim that is bent by more than the tolerance is no
    chaos: it is cut, and no display pixel is left out.
    """
    a_rig = ball_rig(4, pixels=256, display_pixels=256)
    found = solve(a_rig, tolerance=tolerance)
    coarse = solve(a_rig, tolerance=1.0)
    assert found.first.map_error.n_samples == 0
    assert not ((coarse.weight > 1e-3) & (found.weight == 0)).any()
