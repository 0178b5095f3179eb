"""The view through a pupil, against geometry, single rays and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.image.simulation import LUMINANCE, simulate
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.pupil import even_places, focus_of, in_pupil, pinholes, rays_through
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.through_pupil import LEAST_PLACES, n_places
from known.reference_rigs import ball_rig, box, cube_rig, lattice_image, rig
from known.work import solve


def with_pupil(a_rig, pupil, focus=None):
    viewer = replace(a_rig.viewer, pupil=pupil, focus=focus)
    return replace(a_rig, viewers=(viewer,))


def seen_by(solution, source=None):
    return run_steps(solution.seeing_with_pupil(solution.source if source is None else source))


def test_points_of_the_plane_of_focus_keep_their_pixels():
    """From each place in the pupil; a point farther by d moves by s d / (f (f + d))."""
    viewer = with_pupil(ball_rig(1), 0.004).viewer
    place = ball_rig(1).picture_place
    focus = focus_of(place, viewer)
    assert focus == pytest.approx(1.0)
    xy = np.random.default_rng(0).uniform(0, 512, (20, 2))
    origin, directions = viewer.rays(xy)
    at = origin + (focus / directions[:, 1:2]) * directions
    for one, s in zip(pinholes(place, viewer, 7), even_places(viewer, 7), strict=True):
        assert one.project(at) == pytest.approx(xy, abs=1e-9)
        beyond = origin + ((focus + 0.1) / directions[:, 1:2]) * directions
        tangent = s / (focus + 0.1) - s / focus
        moved = -tangent / (viewer.window[1] - viewer.window[0]) * 512 * [1, -1]
        assert one.project(beyond) - xy == pytest.approx(np.tile(moved, (20, 1)), abs=1e-9)
        rays = rays_through(viewer, xy, np.tile(s, (20, 1)), focus)
        assert np.allclose(rays, one.rays(xy), atol=1e-12)


@pytest.mark.parametrize("spread", [even_places, lambda v, n: in_pupil(v, grid(n))])
def test_places_spread_evenly_over_the_pupil(spread):
    """Area within r grows as r^2, and the mean of x^2 is a quarter of the radius squared."""
    viewer = with_pupil(ball_rig(1), 0.006).viewer
    places = spread(viewer, 1024)
    radius = np.sort(np.linalg.norm(places, axis=1)) / 0.003
    assert np.abs(radius**2 - (np.arange(1024) + 0.5) / 1024).max() < 2 / 32
    assert places.mean(axis=0) == pytest.approx([0, 0], abs=1e-5)
    assert (places**2).mean(axis=0) == pytest.approx(0.003**2 / 4, rel=0.01)


def grid(n):
    along = (np.arange(int(n**0.5)) + 0.5) / int(n**0.5)
    return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)


def test_a_pupil_alone_changes_no_bit():
    """Neither the key of the light nor the source image, and nothing more is traced."""
    plain = ball_rig(3, pixels=64, display_pixels=64)
    wide = with_pupil(plain, 0.004, 0.8)
    assert plain.light_keys == wide.light_keys
    one, other = solve(plain), solve(wide)
    assert (one.source == other.source).all()
    assert one.n_rays == other.n_rays
    assert "sharpening" in other.left_out
    assert (seen_by(one) == one.seen()).all()


@pytest.mark.parametrize("pupil", [0.004, 0.05])
def test_the_mean_of_few_pinholes_is_the_light_of_random_rays(pupil):
    """Each from its own place of the pupil, focused behind the picture; to the noise of the rays.

    A wide pupil has more places.
    """
    image = lattice_image(64)
    a_rig = with_pupil(cube_rig(pixels=48, display_pixels=64, image=image), pupil, 1.2)
    solution = solve(a_rig, brightness=True, only_through_glass=False)
    seen = seen_by(solution)
    plan = compile_plan(a_rig, Settings())
    assert (n_places(plan) > LEAST_PLACES) == (pupil > 0.01)
    found = [run_steps(simulate(plan, solution.source, 40, seed)) for seed in range(4)]
    off = np.mean([(one.image - seen) @ LUMINANCE for one in found], axis=0)
    noise = np.sqrt(np.mean([one.error**2 for one in found]) / 4)
    assert np.sqrt((off**2).mean()) < 1.2 * noise
    blur = np.sqrt((((seen - solution.seen()) @ LUMINANCE) ** 2).mean())
    assert blur > 5 * noise * (pupil > 0.01)


def test_a_display_out_of_focus_blurs_by_its_vergence():
    """Without glass, a white half plane at 1 m and a focus at 2 m: the edge's profile is the
    integral of a disc of diameter pupil (1 / 1 m - 1 / 2 m).
    """
    image = np.ones((64, 64, 4), np.float32)
    bare = rig(box([0.3, 0.03, 0.3]), ior=1.0, pixels=200, field=0.02, image=image)
    a_rig = with_pupil(bare, 0.02, 2.0)
    solution = solve(a_rig, only_through_glass=False)
    source = np.zeros((512, 512, 3), np.float32)
    source[:, 256:] = 1
    seen = seen_by(solution, source)[100, :, 0]
    x = (np.arange(200) + 0.5 - 100) * 0.02 / 200
    u = np.clip(x / (0.02 * 0.5 / 2), -1, 1)
    profile = 0.5 + (u * np.sqrt(1 - u**2) + np.arcsin(u)) / np.pi
    assert min(np.abs(seen - edge).max() for edge in (profile, profile[::-1])) < 0.03


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pupil": 1.5}, "make the pupil smaller"),
        ({"pupil": 0.01, "focus": 0.005}, "make the pupil smaller"),
        ({"pupil": -1.0}, "Diameter"),
        ({"pupil": np.nan}, "Diameter"),
        ({"pupil": 0.004, "focus": 0.0}, "Focus Distance"),
        ({"pupil": 0.004, "projection": "orthographic"}, "orthographic"),
        ({"pupil": 0.004, "position": np.array([0, 2.0, 0])}, "focus distance"),
    ],
)
def test_a_pupil_that_cannot_be_is_refused_in_one_sentence(change, words):
    """Each with its remedy."""
    a_rig = ball_rig(1)
    a_rig = replace(a_rig, viewers=(replace(a_rig.viewer, **change),))
    with pytest.raises(RigError, match=words):
        a_rig.check()
