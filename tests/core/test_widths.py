"""Chaotic light is spread over as much of the display as it takes for some samples to light each
place; none of it is lost, and source images err less.
"""

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.light.rays import Reason
from kiriko.core.map import pieces
from kiriko.core.map.pieces import LEAST_PX, MOST_PX, TOGETHER, kernel_widths
from kiriko.core.map.points import Points
from kiriko.core.map.shares import add_at
from known.rasterised import rasterise
from known.reference_rigs import facetted_rig
from known.work import solve

SIZE = (320, 192)


def landings(n, seed=0, size=SIZE):
    return np.random.default_rng(seed).random((n, 2)) * size


def mixed(xy, size=SIZE):
    """Sides of the squares of samples that come from anywhere of the view."""
    return widths_of(landings(len(xy), 9, (48, 48)), xy, size)


def widths_of(view, xy, size):
    return run_steps(kernel_widths(view, xy, size))


@pytest.mark.parametrize("per_pixel", [0.125, 0.5, 2, 8, 60])
def test_about_so_many_samples_light_each_place(per_pixel):
    """Of samples that land evenly, to a quarter: blocks in which by chance there are more have
    narrower squares.
    """
    n = int(per_pixel * np.prod(SIZE))
    found = mixed(landings(n))
    together = (found**2).sum() / np.prod(SIZE)
    assert TOGETHER * 0.75 < together < TOGETHER * 1.05
    assert found.max() <= MOST_PX


def test_squares_are_as_wide_as_the_density_at_their_place_asks():
    """Half of the display gets 16 times as many: squares a quarter as wide, to a tenth."""
    few, many = landings(15_000, size=(160, 192)), landings(240_000, 1, size=(160, 192))
    found = mixed(np.concatenate([few, many + np.array([160, 0])]))
    assert found[:15_000].mean() / found[15_000:].mean() == pytest.approx(4, rel=0.1)


def test_few_samples_and_very_many_light_their_own_pixels():
    """Fifteen in a block and a sixteenth in the next; or so many that squares were half a pixel."""
    xy = np.full((15, 2), [17.0, 1.0])
    assert (mixed(np.append(xy, [[15.9, 1]], axis=0)) == LEAST_PX).all()
    assert (mixed(np.append(xy, [[17.0, 1]], axis=0)) == 1).all()
    assert (mixed(landings(120 * 16**2, size=(16, 16)))).max() == LEAST_PX


@pytest.mark.parametrize("patch_px", [1, 2, 4, 8])
@pytest.mark.parametrize("per_pixel", [0.5, 4])
def test_light_that_lies_side_by_side_is_not_mixed(patch_px, per_pixel):
    """Each patch of the display shows a place of the view of its own: where there are samples
    enough to know it, squares are no wider than half a patch.
    """
    n = int(per_pixel * np.prod(SIZE))
    xy = landings(n)
    number = (xy // patch_px).astype(int) @ [1, 1000]
    view = np.random.default_rng(4).random((number.max() + 1, 2))[number] * 48
    view += 0.1 * landings(n, 5, (1, 1))
    found = widths_of(view, xy, SIZE)
    if per_pixel * patch_px**2 >= 2:
        assert found.max() <= max(patch_px / 2, LEAST_PX)
    assert np.median(mixed(xy)) > np.median(found)


@pytest.mark.parametrize("remainder", [1, 3, 8])
def test_blocks_that_the_border_cuts_are_as_dense_as_others(remainder):
    """Squares there are as wide as elsewhere, to a fifth."""
    size = (96 + remainder, 512)
    xy = landings(4 * size[0] * size[1], size=size)
    found = mixed(xy, size)
    is_last = xy[:, 0] > 96
    assert found[is_last].mean() == pytest.approx(found[~is_last].mean(), rel=0.2)


def test_it_can_be_stopped():
    """There is a pause for each size of blocks."""
    view_map = samples_alone(landings(1000), np.ones(1000))
    assert sum(1 for _ in view_map.spread_samples()) >= 5
    assert "sample_width" in vars(view_map)
    assert sum(1 for _ in view_map.spread_samples()) == 0


@pytest.mark.parametrize("place", [[-0.1, 5], [5, 192.1], [np.nan, np.nan], [320.1, 5], [1e300, 5]])
def test_light_beside_the_display_is_not_spread_onto_it(place):
    xy = np.append(landings(5000), [place], axis=0)
    view = landings(5001, 9, (48, 48))
    found = widths_of(view, xy, SIZE)
    assert found[-1] == 0
    assert (found[:-1] > 0).all()
    assert np.array_equal(found[:-1], widths_of(view[:-1], xy[:-1], SIZE))


def test_no_samples_and_a_display_of_one_pixel():
    assert len(mixed(np.empty((0, 2)))) == 0
    assert (mixed(np.full((20, 2), 0.5), (1, 1)) <= 1).all()


def test_the_display_s_border_counts_as_in_it():
    """Landings on the right and the lower border, to the last bit."""
    xy = np.full((16, 2), np.array(SIZE, float))
    assert (mixed(xy) == 1).all()


@cache
def solved(effort=16):
    return solve(facetted_rig(), effort=effort)


@cache
def alone(effort=16):
    """The same, each sample in its own pixel."""
    with patch.object(pieces, "TOGETHER", 1 << 30):
        return solve(facetted_rig(), effort=effort)


def test_all_light_arrives():
    """As much as of the same samples in their own pixels, and in the same parts of the display:
    of 16 px, within what their squares reach beyond.
    """
    ours, theirs = solved().weight, alone().weight
    assert solved().n_rays == alone().n_rays
    assert ours.sum() == pytest.approx(theirs.sum(), rel=1e-9)
    ours, theirs = (w.reshape(4, 16, 4, 16).sum(axis=(1, 3)) for w in (ours, theirs))
    assert np.abs(ours - theirs).max() < 0.1 * theirs.max()


@pytest.mark.parametrize(("away", "gain"), [(0.5, 0.55), (1.5, 0.3), (3, 0.4)])
def test_smooth_light_errs_less_than_in_the_samples_own_pixels(away, gain):
    """Of samples from anywhere that land so far apart, px, the more the further to the right:
    against the closed form, a third to a half of the error.
    """
    n = int(np.prod(SIZE) / away**2)
    xy = landings(n)
    xy[:, 0] = SIZE[0] * np.sqrt(xy[:, 0] / SIZE[0])
    expected = (2 * np.arange(SIZE[0]) + 1) / SIZE[0] * n / np.prod(SIZE)

    def error(wide):
        return np.sqrt(np.mean((lit(xy, wide, np.ones(n)) - expected) ** 2))

    assert error(mixed(xy)) < gain * error(np.full(n, LEAST_PX))


def test_more_effort_errs_less():
    """Through a flat-shaded ball, against very many samples in their own pixels."""
    truth = alone(4096).source
    errors = [np.sqrt(np.mean((solved(n).source - truth) ** 2)) for n in (1, 4, 16, 64)]
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 0.5 * errors[0]


def test_a_flat_shaded_ball_s_light_is_not_mixed():
    """Its facets lie side by side on the display: nearly all samples light their own pixels, and
    the source image errs as little as if all did.
    """
    assert (solved().first.view_map.sample_width <= LEAST_PX).mean() > 0.99
    truth = alone(4096).source
    ours, theirs = (np.sqrt(np.mean((some.source - truth) ** 2)) for some in (solved(), alone()))
    assert ours < 1.01 * theirs


def without_cells(view_map):
    """What a map of samples alone has in the place of cells."""
    names = "quads", "triangles", "corner", "size", "nodes"
    return {name: getattr(view_map, name)[:0] for name in names}


def samples_alone(xy, area):
    """A map of samples that land at display px (n, 2)."""
    found = solved().first.view_map
    n = len(xy)
    one = np.ones(n, np.uint64)
    points = Points(landings(n, 1, (48, 48)), xy, one, np.zeros(n, np.uint8), np.ones(n))
    sizes = {"view_size": (48, 48), "display_size": SIZE}
    view_map = replace(found, points=points, **without_cells(found), **sizes)
    return view_map.with_samples(points, area, np.sqrt(area))


def lit(xy, wide, area):
    """Light (h, w) of samples that land at display px (n, 2), on squares so wide, px (n,)."""
    view_map = samples_alone(xy, area)
    vars(view_map)["sample_width"] = wide
    image = np.zeros(SIZE[::-1])
    for piece in view_map.pieces(at_pixels=True):
        shares = rasterise(SIZE, (48, 48), *piece[:3])
        add_at(image, shares.display_index, shares.area)
    return image


@pytest.mark.parametrize("width", [0.25, 1.0, 5.3, 16.0])
def test_a_sample_lights_a_square_around_it(width):
    """As large a part of each pixel as the square covers, all that it stands for; within the
    display, to the border, and a square narrower than a pixel within that it lands in.
    """
    xy = landings(200)
    xy[0] = 0, 0
    xy[1] = SIZE
    weight = lit(xy, np.full(200, width), np.full(200, 1 / 16))
    pixel = np.minimum(np.floor(xy), np.array(SIZE) - 1)
    first, last = (pixel, pixel + 1) if width < 1 else (0, np.array(SIZE))
    ends = np.stack([np.maximum(xy - width / 2, first), np.minimum(xy + width / 2, last)], axis=2)
    expected = np.zeros_like(weight)
    for end in ends:
        column, row = (
            np.diff(np.clip(np.arange(size + 1), *at)) / np.ptp(at)
            for size, at in zip(SIZE, end, strict=True)
        )
        expected += np.outer(row, column) / 16
    np.testing.assert_allclose(weight, expected, atol=1e-9)


def test_even_light_is_even_up_to_the_border():
    """To a third, where squares end at the border, and none is lost there."""
    n = 120_000
    image = lit(landings(n), np.full(n, 16.0), np.ones(n)) / (n / np.prod(SIZE))
    assert image.sum() == pytest.approx(np.prod(SIZE))
    for along in (0, 1):
        mean = image.mean(axis=along)
        assert 0.66 < mean.min() < mean.max() < 1.25
        assert mean[20:-20] == pytest.approx(1, abs=0.15)


def test_light_that_lands_nowhere_is_not_spread():
    """Samples without a landing, and those that land beside the display."""
    found = solved().first.view_map
    xy = found.points.xy[found.samples]
    landed = found.points.branch[found.samples] != 0
    is_in = landed & (xy >= 0).all(axis=1) & (xy <= found.display_size).all(axis=1)
    assert 0.05 < is_in.mean() < 0.95
    assert np.array_equal(found.sample_width > 0, is_in)


def test_light_beside_the_glass_is_spread_on_its_own():
    """Where Suppress Glare follows it, light through the glass is spread as if it were not there,
    and the other way round: neither lights what the other does.
    """
    xy = np.concatenate([landings(20_000), landings(60_000, 1)])
    is_beside = np.arange(len(xy)) >= 20_000
    both = samples_alone(xy, np.ones(len(xy)))
    both.points.reason[both.samples[is_beside]] = Reason.MISSED_GLASS
    view = both.points.view[both.samples]
    for some in (is_beside, ~is_beside):
        assert np.array_equal(both.sample_width[some], widths_of(view[some], xy[some], SIZE))


@pytest.mark.parametrize("width", [0.25, 1.0, 5.3, 16.0])
def test_the_number_of_shares_is_told(width):
    """To a fifth: of squares, by their widths."""
    view = replace(solved().first.view_map, **without_cells(solved().first.view_map))
    vars(view)["sample_width"] = np.where(view.sample_width > 0, width, 0)
    sizes = view.display_size, view.view_size
    made = sum(len(rasterise(*sizes, *piece[:3]).area) for piece in view.pieces())
    assert view.shares_by_kind[-1] == pytest.approx(made, rel=0.2)
