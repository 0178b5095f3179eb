"""Chaotic light that falls where the display is faint is sampled by more rays, as many as lower the
variance of all display pixels most.
"""

from unittest.mock import patch

import numpy as np
import pytest

from kiriko.core.light.planning import make_plan
from kiriko.core.map import faint, samples
from kiriko.core.map.allowance import Allowance
from kiriko.core.map.faint import light_on_blocks, more_along, numbers_along, samples_worth
from kiriko.core.map.points import Points
from kiriko.core.settings import Settings
from kiriko.core.steps import finish
from known.reference_rigs import ball_rig, glass_rig, icosphere
from known.work import solve

NONE = Points.none()


def points_at(xy, is_lit=True):
    """Points (n,) that land at display pixels, or none of which does."""
    n = len(xy)
    branch = np.full(n, np.uint64(is_lit))
    return Points(np.zeros((n, 2)), np.asarray(xy, float), branch, np.zeros(n), np.ones(n))


@pytest.mark.parametrize(
    ("along", "numbers"),
    [(1, []), (2, [3, 4]), (3, [4, 6, 9]), (4, [6, 8, 12]), (8, [12]), (12, []), (32, [])],
)
def test_faint_light_takes_no_more_rays_than_144_or_the_square_of_effort(along, numbers):
    assert numbers_along(along) == numbers


def test_the_light_on_blocks_is_all_that_lands():
    """Through a ball, most of whose light lands: to 2 %, with the samples given."""
    found = solve(ball_rig(3, pixels=64, display_pixels=64, display=0.2))
    more = points_at([[1.0, 1.0], [63.9, 64.0], [70.0, 1.0]])
    light = finish(light_on_blocks(found.first.view_map, more, np.array([2.0, 3.0, 5.0])))
    bare = finish(light_on_blocks(found.first.view_map, NONE, np.empty(0)))
    assert light.shape == (8, 8)
    assert bare.sum() * 64 == pytest.approx(found.weight.sum(), rel=0.02)
    extra = np.zeros((8, 8))
    extra[0, 0], extra[7, 7] = 2.0, 3.0
    assert (light - bare) * 64 == pytest.approx(extra)


def test_a_cell_is_worth_samples_by_how_faint_its_light_is():
    """Effort / b where all of it falls on light b; by the root of its lit part (Neyman)."""
    plan = make_plan(ball_rig(1, pixels=16, display_pixels=16), Settings(effort=16))
    light = np.array([[1.0, 0.25], [0.01, 1.0]])
    # cells: bright, a quarter as bright, as faint with a quarter lit, beside the display
    xy = [[1, 1], [1, 1], [12, 1], [12, 1], [1, 12], [99, 1], [99, 1], [99, 1], [99, 99]]
    owner = np.array([0, 0, 1, 1, 2, 2, 2, 2, 3])
    worth = samples_worth(plan, light, points_at(xy), np.ones(9), owner, 4)
    assert worth == pytest.approx([16, 64, 16 / 0.01 / 2, 0])
    dark = samples_worth(plan, light, points_at(xy, is_lit=False), np.ones(9), owner, 4)
    assert (dark == 0).all()


def test_a_pixel_takes_as_many_samples_as_its_allowance_has():
    """The largest number that it is worth, or else the largest for which it has rays left."""
    plan = make_plan(ball_rig(1, pixels=8, display_pixels=8), Settings(effort=16))
    allowance = Allowance(plan, np.empty((0, 2)))
    middle = np.array([[0.5, 0.5], [1.5, 0.5], [2.5, 0.5], [3.25, 0.25], [3.75, 0.25], [4.5, 0.5]])
    side = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 1.0])
    allowance.take(middle[1:2], 260)
    left = allowance.left.copy()
    worth = np.array([1000, 1000, 60, 1000, 1000, 28.0])
    found = more_along(worth, middle, side, 4, allowance)
    assert found.tolist() == [12, 8, 8, 12, 12, 0]
    taken = (left - allowance.left)[:5]
    assert taken.tolist() == [144, 64, 64, 72, 0]


def facets():
    """A flat-shaded ball that leaves parts of the display faint, and a picture of many colours."""
    colours = np.random.default_rng(0).random((24, 24, 4))
    colours[..., 3] = 1
    image = colours.repeat(8, axis=0).repeat(8, axis=1).astype(np.float32)
    mesh = icosphere(0.025, 3, smooth=False)
    return glass_rig(mesh, pixels=64, display_pixels=64, image=image)


def test_more_rays_for_faint_light_are_worth_more_than_more_effort():
    """Against very many samples, with all display pixels alike, it errs less by a third fewer
    samples.
    """
    much = solve(facets(), effort=1024).source
    found = solve(facets(), effort=16)
    with patch.object(faint, "numbers_along", lambda along: []):
        alike = solve(facets(), effort=49)
    ours, theirs = (np.sqrt(np.mean((some.source - much) ** 2)) for some in (found, alike))
    assert found.first.map_error.n_samples < 2 / 3 * alike.first.map_error.n_samples
    assert ours < theirs


def test_a_first_picture_takes_no_more():
    square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    plan = make_plan(ball_rig(1, pixels=8, display_pixels=8), Settings())
    with patch.object(samples, "light_on_blocks", side_effect=AssertionError):
        found, area = finish(samples.sample_cells(plan, None, square, None, None))
    assert len(found) == 16
    assert area.sum() == 1
