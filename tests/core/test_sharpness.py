"""How sharp an edge is seen, against closed forms."""

from dataclasses import replace
from math import erf

import numpy as np
import pytest

from kiriko.core.lab.measure.viewer_errors import BRIGHT, DARK, TILT, mtf50, sharpness
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, lattice_image
from known.work import drain

SIDE = 120


def away(shift=0.0):
    """Signed distances, px, of pixels' middles from a slanted edge."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    return x * np.cos(TILT) + y * np.sin(TILT) - shift


def gaussian(sigma, shift=0.0):
    blurred = 0.5 + 0.5 * np.vectorize(erf)(away(shift) / (sigma * np.sqrt(2)))
    return DARK + (BRIGHT - DARK) * blurred


@pytest.mark.parametrize("sigma", [0.7, 1.0, 2.0, 4.0])
def test_a_gaussian_blur(sigma):
    """exp(-2 (pi sigma f)^2) is a half at sqrt(ln 2 / 2) / (pi sigma)."""
    expected = np.sqrt(np.log(2) / 2) / (np.pi * sigma)
    assert mtf50(gaussian(sigma)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("width", [2.0, 4.0, 8.0])
def test_a_box_blur(width):
    """sinc(w f) is a half at w f = 0.603355."""
    light = np.clip(away() / width + 0.5, 0, 1)
    assert mtf50(light) == pytest.approx(0.603355 / width, rel=0.02)


@pytest.mark.parametrize("apart", [3.0, 6.0, 10.0])
def test_a_double_edge(apart):
    """Two images d apart: |cos(pi d f)| times the blur of each."""
    sigma = 0.5
    light = (gaussian(sigma, -apart / 2) + gaussian(sigma, apart / 2)) / 2
    f = np.linspace(0, 1, 1_000_001)
    contrast = np.abs(np.cos(np.pi * apart * f)) * np.exp(-2 * (np.pi * sigma * f) ** 2)
    expected = f[np.argmax(contrast < 0.5)]
    assert expected == pytest.approx(1 / (3 * apart), rel=0.1)
    assert mtf50(light) == pytest.approx(expected, rel=0.02)


def test_what_has_no_edge_has_no_sharpness():
    assert mtf50(np.full((SIDE, SIDE), 0.5)) is None
    assert mtf50(np.full((0, 0), np.nan)) is None
    assert mtf50(np.full((SIDE, SIDE), np.nan)) is None


def test_rows_that_are_not_known_are_left_out():
    light = gaussian(2.0)
    light[::3, 5] = np.nan
    assert mtf50(light) == pytest.approx(mtf50(gaussian(2.0)), rel=0.01)


def turned(viewer, name, angle):
    """A viewer that stands to the right of another by an angle, as seen from the origin."""
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return replace(viewer, name=name, position=turn @ viewer.position, axes=viewer.axes @ turn.T)


def test_blended_is_the_less_sharp_and_sharp_is_as_one_viewer_sees():
    """Two eyes see the edge of either as a double one; Sharp moves one, and leaves it as it is."""
    one = ball_rig(4, pixels=192, display_pixels=192, image=lattice_image(64))
    left, right = (turned(one.viewer, name, angle) for name, angle in (("l", -0.05), ("r", 0.05)))
    both = replace(one, viewers=(left, right))
    (alone,) = drain(sharpness(Session(), one, Settings()))
    sharp, blended = (
        drain(sharpness(Session(), both, Settings(disagreement=way)))
        for way in ("sharp", "blended")
    )
    assert sharp == pytest.approx([alone, alone], rel=0.1)
    assert max(blended) < min(sharp)
