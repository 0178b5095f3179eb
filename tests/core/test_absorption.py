"""Absorbing glass: light fades by Beer and Lambert's law, exp(-absorption * length inside)."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import main_landings
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass, HalfMirror, Mesh
from kiriko.core.rig.settings import Settings
from known.closed_forms import snell, through_ball
from known.reference_rigs import ball_rig, box, lattice_image, rectangle, rig
from known.work import solve

PER_METRE = (5.0, 20.0, 60.0)
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def tinted(a_rig, *absorptions):
    """The rig with these absorptions of its glasses, 1/m."""
    each = absorptions or [PER_METRE] * len(a_rig.glasses)
    glasses = zip(a_rig.glasses, each, strict=True)
    return replace(a_rig, glasses=tuple(replace(one, absorption=a) for one, a in glasses))


def passed(a_rig, xy, colours=BLUE, **settings):
    """Throughputs of rays through viewer px (n, 2) that reach the display; NaN for others."""
    plan = compile_plan(a_rig, Settings(brightness=True, colours=colours, **settings))
    found = main_landings(trace_all(plan, *a_rig.viewers[0].rays(xy)), len(xy))
    return np.where(found.has_arrived, found.throughput, np.nan)


@pytest.fixture
def xy():
    return np.random.default_rng(2).uniform(160, 352, (400, 2))


@pytest.mark.parametrize("colours", [RED, BLUE, (1.0, 1.0, 1.0)])
def test_light_through_a_slab_fades_by_its_length(has_kernel, xy, colours):
    """The length is the thickness over the cosine inside; white light takes the mean."""
    clear = rig(box([0.06, 0.02, 0.06]))
    ratio = passed(tinted(clear), xy, colours) / passed(clear, xy, colours)
    d = clear.viewers[0].rays(xy)[1]
    inside = snell(d, np.array([0, -1.0, 0]), 1, 1.49)
    a = np.dot(colours, PER_METRE) / sum(colours)
    is_seen = np.isfinite(ratio)
    assert is_seen.sum() > 100
    expected = np.exp(-a * 0.02 / np.abs(inside[:, 1]))
    np.testing.assert_allclose(ratio[is_seen], expected[is_seen], rtol=1e-12)


def test_light_through_a_ball_fades_by_its_chord(has_kernel, xy):
    """The chord is 2 R cos of the angle inside."""
    clear = ball_rig(6)
    ratio = passed(tinted(clear), xy) / passed(clear, xy)
    o, d = clear.viewers[0].rays(xy)
    leaves, _ = through_ball(o, d, 0.025, 1.49)
    nearest = np.linalg.norm(o - (o * d).sum(-1, keepdims=True) * d, axis=1)
    chord = 2 * 0.025 * np.cos(np.arcsin(nearest / 0.025 / 1.49))
    is_seen = np.isfinite(ratio) & np.isfinite(leaves[:, 0])
    assert is_seen.sum() > 100
    np.testing.assert_allclose(ratio[is_seen], np.exp(-60 * chord)[is_seen], rtol=1e-9)


def test_each_medium_absorbs_its_own_part(has_kernel, xy):
    """A box of another glass inside a box: the inner one wins by size, with the same index and
    with another.
    """
    for inner_ior in (1.49, 1.6):
        outside = Glass("outer", box([0.08, 0.04, 0.08]), ConstantIndex(1.49))
        inside = Glass("inner", box([0.07, 0.01, 0.07]), ConstantIndex(inner_ior))
        both = tinted(rig((outside, inside)), (0.0, 0.0, 30.0), (0.0, 0.0, 80.0))
        clear = tinted(both, *[(0.0, 0.0, 0.0)] * 2)
        ratio = passed(both, xy) / passed(clear, xy)
        d = both.viewers[0].rays(xy)[1]
        front = np.array([0, -1.0, 0])
        outer, inner = (np.abs(snell(d, front, 1, n)[:, 1]) for n in (1.49, inner_ior))
        expected = np.exp(-30 * 0.03 / outer - 80 * 0.01 / inner)
        is_seen = np.isfinite(ratio)
        assert is_seen.sum() > 100
        np.testing.assert_allclose(ratio[is_seen], expected[is_seen], rtol=1e-9)


def test_a_cavity_absorbs_nothing(has_kernel, xy):
    """A shell inside the shell is air."""
    shell, hole = box([0.08, 0.04, 0.08]), box([0.07, 0.01, 0.07])
    vertices = np.concatenate([shell.vertices, hole.vertices])
    inner = hole.triangles[:, ::-1] + len(shell.vertices)
    hollow = rig(Mesh(vertices, np.concatenate([shell.triangles, inner])))
    d = hollow.viewers[0].rays(xy)[1]
    ratio = passed(tinted(hollow), xy) / passed(hollow, xy)
    along = np.abs(snell(d, np.array([0, -1.0, 0]), 1, 1.49)[:, 1])
    is_seen = np.isfinite(ratio)
    assert is_seen.sum() > 100
    np.testing.assert_allclose(ratio[is_seen], np.exp(-60 * 0.03 / along)[is_seen], rtol=1e-9)


def test_split_light_fades_on_both_paths(has_kernel, xy):
    """A reflecting glass: the copy continues in the glass, and each path loses light by its own
    length, which is at least the chord.
    """
    (ball,) = tinted(ball_rig(4)).glasses
    half = HalfMirror("half", rectangle(np.array([0, 0.06, 0]), *np.eye(3)[[0, 2]], 0.1, 0.1))
    splitting = replace(ball_rig(4), glasses=(replace(ball, reflects=True),), half_mirrors=(half,))
    found = passed(splitting, xy)
    clear = passed(tinted(splitting, (0.0, 0.0, 0.0)), xy)
    is_seen = np.isfinite(found) & np.isfinite(clear)
    assert (found[is_seen] < clear[is_seen] * np.exp(-60 * 0.03)).all()


def test_absorption_counts_with_brightness_alone(has_kernel, xy):
    """Without Brightness throughput is 1, and tinted glass has the image of clear glass."""
    small = ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64))
    np.testing.assert_array_equal(solve(tinted(small)).source, solve(small).source)
    assert len(solve(tinted(small)).first.colours) == 0


def test_each_colour_is_as_bright_as_it_passes():
    """With Brightness, each colour has a channel: what is seen of a white picture is each colour's
    own light, and grey glass needs one channel only.
    """
    white = np.ones((8, 8, 4), np.float32)
    small = ball_rig(4, pixels=64, display_pixels=96, image=white)
    found = solve(tinted(small), brightness=True)
    assert len(found.first.colours) == 3
    flat = np.full((96, 96, 3), 0.5, np.float32)
    clear = solve(small, brightness=True).seen(flat)[32, 32]
    seen = found.seen(flat)[32, 32]
    np.testing.assert_allclose(seen / clear, np.exp(-0.05 * np.array(PER_METRE)), rtol=2e-3)
    assert "absorption" in found.used
    grey = solve(tinted(small, (20.0,) * 3), brightness=True)
    assert not grey.first.colours
    np.testing.assert_allclose(grey.seen(flat)[32, 32] / clear, np.exp(-1.0), rtol=2e-3)


def test_negative_absorption_is_refused():
    """One sentence."""
    with pytest.raises(RigError, match="Absorption -1 per m"):
        tinted(ball_rig(2), (0.0, -1.0, 0.0)).check()
