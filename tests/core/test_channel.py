"""Channels: all that is about one viewer is found for each of them, and painted into one image."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kiriko import core
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import session
from kiriko.core.solve.channel import ChannelKey
from known.reference_rigs import ball_rig, lattice_image
from known.work import solve

CORE = Path(core.__file__).parent


@pytest.fixture
def small():
    return ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64))


def test_core_names_no_viewer_of_a_rig():
    """A function of one viewer is told which one: `rig.viewer` is for scripts alone."""
    for path in CORE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr == "viewer":
                assert ast.unparse(node.value).split(".")[-1] != "rig", f"{path}:{node.lineno}"


def test_a_plan_is_the_same_for_each_viewer(small):
    """Nothing is made again for another viewer of the rig, and the wavelength is the plan's."""
    other = replace(small.viewer, name="other")
    plan = compile_plan(small, Settings(wavelength=500e-9))
    seen = plan.seen_by(other)
    assert plan.viewer is small.viewer
    assert seen.viewer is other
    assert seen.layers is plan.layers
    assert seen.media is plan.media
    assert seen.thin_parts is plan.thin_parts


def test_a_solution_of_one_viewer_has_one_channel(small):
    """It is of the rig's viewer, at the wavelength of the settings; what scripts read is its."""
    solution = solve(small, brightness=True)
    (one,) = solution.channels
    assert solution.first is one
    assert one.viewer is small.viewer
    assert one.wavelength == Settings().wavelength
    assert one.map_error is one.view_map.error
    assert solution.picture_coverage == one.picture_coverage
    assert solution.misses is one.misses
    assert solution.source.shape == (64, 64, 3)
    assert solution.seen().shape == solution.ideal().shape == (48, 48, 3)
    assert solution.weight is one.coverage.weight
    assert solution.display_coverage is one.coverage.of_display


def test_a_solve_checks_its_rig_once(small, monkeypatch):
    """Also where the plan is begun again, or made once more as drawn."""
    checked = []
    check = Rig.check
    monkeypatch.setattr(Rig, "check", lambda self: (checked.append(self), check(self)))
    solve(small)
    assert checked == [small]


@pytest.mark.parametrize("ghosts", ["mean", "strongest"])
def test_viewers_that_agree_ask_for_the_image_that_each_asks_for(small, ghosts):
    """Two viewers in the same place: the source image is that of one of them, to rounding; sums
    over shares are twice as large, and every remark stands once.
    """
    one = solve(small, ghosts=ghosts, suppress_glare=0.5, margin=1)
    twins = replace(small, viewers=(small.viewer, replace(small.viewer, name="twin")))
    two = solve(twins, ghosts=ghosts, suppress_glare=0.5, margin=1)
    assert [channel.viewer.name for channel in two.channels] == [small.viewer.name, "twin"]
    assert two.n_rays == one.n_rays  # the place is the same, and so is the map
    np.testing.assert_allclose(two.weight, 2 * one.weight)
    np.testing.assert_allclose(two.source, one.source, atol=1e-6)
    np.testing.assert_array_equal(two.display_coverage, one.display_coverage)
    assert two.picture_coverage == one.picture_coverage
    assert two.remarks == one.remarks


def test_viewers_that_disagree_are_shown_the_mean(small):
    """Of what each asks a display pixel for, by the light it gets from there."""
    right, *_ = small.viewer.axes
    aside = replace(small.viewer, name="aside", position=small.viewer.position + 0.01 * right)
    both = solve(replace(small, viewers=(small.viewer, aside)), disagreement="blended")
    apart = [solve(replace(small, viewers=(viewer,))) for viewer in (small.viewer, aside)]
    total = sum(one.weight[..., None] * one.source for one in apart)
    weight = sum(one.weight for one in apart)
    is_shown = weight > 1e-3
    mean = total[is_shown] / weight[is_shown, None]
    np.testing.assert_allclose(both.source[is_shown], mean, atol=1e-5)
    for channel, one in zip(both.channels, apart, strict=True):
        assert channel.picture_coverage == one.picture_coverage
        np.testing.assert_array_equal(channel.seen(one.source), one.seen())


@pytest.mark.usefixtures("has_kernel")
def test_channels_of_one_colour_each_paint_what_a_white_one_does(small, monkeypatch):
    """A colour is painted by the channels that count in it, by their weights."""

    def of_each_colour(rig: Rig, settings: Settings) -> tuple[ChannelKey, ...]:
        return tuple(
            ChannelKey(viewer, settings.wavelength, tuple(colours))
            for viewer in rig.viewers
            for colours in np.eye(3)
        )

    expected = solve(small).source
    monkeypatch.setattr(session, "channel_keys", of_each_colour)
    found = solve(small)
    (joined,) = found.channels
    assert len(joined.colours) == 3
    assert np.array_equal(found.source, expected)
