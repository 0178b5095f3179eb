"""The rays that are still to come, by which the progress of a solve is told, against those that
came.

The numbers of `ray_guess` are fitted to the sixteen glasses of `dev.py glasses`. None of these is
among them as it is here.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from kiriko.core.light.planning import make_plan
from kiriko.core.map.interpolation import PARTS
from kiriko.core.map.ray_guess import UNKNOWN
from kiriko.core.map.sampling import Sampling
from kiriko.core.settings import Settings
from kiriko.core.steps import finish
from known.guessed_rays import factors, guessed
from known.reference_rigs import ball_rig, bottle, cube_rig, glass_rig, torus, uv_ellipsoid

GLASSES = {
    "ball": lambda: ball_rig(4, pixels=256),
    "cube": lambda: cube_rig(pixels=256),
    "ellipsoid": lambda: glass_rig(uv_ellipsoid((0.04, 0.05, 0.03)), pixels=256),
    "torus": lambda: glass_rig(torus(0.04, 0.015), pixels=256),
    "hollow bottle": lambda: glass_rig(bottle(), pixels=256),
}


class Traced(NamedTuple):
    """How a view map was made.

    begun : all that was told before the rays could be guessed
    n_sizes : of its squares, from the first to the smallest
    """

    guesses: list[tuple[int, float]]
    n_rays: int
    expected: float
    begun: set[float]
    n_sizes: int


@cache
def traced(name: str) -> Traced:
    """The view map of a glass in the making."""
    sampling = Sampling(make_plan(GLASSES[name](), Settings()))
    begun = set()

    def telling():
        steps = sampling.sample()
        while True:
            try:
                told = next(steps)
            except StopIteration as end:
                return end.value
            if not sampling.ahead.is_guessed:
                begun.add(told)
            yield told

    with guessed() as guesses:
        n_rays = finish(telling()).n_rays
    n_sizes = int(np.log2(sampling.first_size / PARTS)) + 1
    return Traced(guesses, n_rays, sampling.ahead.expected, begun, n_sizes)


@pytest.mark.parametrize("name", GLASSES)
def test_the_rays_to_come_are_guessed_within_a_factor_of_two(name):
    """From 10 % to 90 % of all rays, as it is told, and more than once."""
    made = traced(name)
    found = factors(made.guesses, made.n_rays)
    assert len(found) >= 3
    assert found.min() >= 0.5
    assert found.max() <= 2
    assert made.expected < made.n_rays * 1.05


@pytest.mark.parametrize("name", GLASSES)
def test_the_bar_moves_before_the_rays_can_be_guessed(name):
    """With each size of squares, and stays below a tenth until then."""
    made = traced(name)
    assert sorted(made.begun) == pytest.approx(np.linspace(0, UNKNOWN, made.n_sizes))
    assert UNKNOWN < 0.1


def test_before_a_finer_display_no_tenth_is_told_until_pieces_tell_how_far_light_spreads():
    """Their shares may be most of the work. Before one of as many pixels it is told sooner."""
    for size, waits in ((64, False), (128, True)):
        sampling = Sampling(make_plan(ball_rig(4, pixels=64, display_pixels=size), Settings()))
        told = {False: [0.0], True: [0.0]}
        for part in sampling.sample():
            told[sampling.ahead.n_shares is not None].append(part)
        assert (max(told[False]) <= UNKNOWN) == waits
        assert max(told[True]) > 0.9
