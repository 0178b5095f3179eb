"""The source image: exact where it can be computed by
hand, and the limit of the brute-force splat.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.image.pyramid import Pyramid
from kiriko.core.image.source_image import MOST_LIGHT, Painting, find_filter_taps, grow, splat
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.map.shares import Coverage
from kiriko.core.rig.rig import MirrorArray, PicturePlace
from kiriko.core.rig.settings import Settings
from known.exact_source import exact_source
from known.rasterised import rasterise
from known.reference_rigs import ball_rig, box, cube_rig, rig
from known.work import drain, solve


def waves(size=64):
    """A smooth picture without symmetries."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    r = 0.5 + 0.4 * np.sin(7 * x + 3 * y)
    g = 0.5 + 0.4 * np.cos(5 * y - 2 * x * y)
    return np.stack([r, g, x * y, np.ones_like(x)], axis=2).astype(np.float32)


def ramp(size=64):
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    return np.stack([x, y, 0 * x + 0.25, 0 * x + 1], axis=2).astype(np.float32)


@pytest.mark.numpy_alone
@pytest.mark.parametrize(("pixels", "display_pixels"), [(64, 512), (512, 64), (64, 64), (50, 333)])
def test_without_glass_the_source_is_the_mirrored_picture(pixels, display_pixels):
    """Index 1, a picture as large as the display: each display
    pixel shows the ramp's value at its own centre.
    """
    a_rig = rig(
        box([0.3, 0.01, 0.3]),
        ior=1.0,
        pixels=pixels,
        display_pixels=display_pixels,
        display=0.03,
        image=ramp(),
        projection="orthographic",
        field=0.036,
    )
    solution = solve(a_rig)

    # the mirror image of the picture's top is the display's bottom
    y, x = (np.mgrid[:display_pixels, :display_pixels] + 0.5) / display_pixels
    inner = slice(
        display_pixels // 32, -(display_pixels // 32)
    )  # half a picture pixel at the border is extended
    for channel, expected in ((0, x), (1, y), (2, 0 * x + 0.25)):
        found = solution.source[inner, inner, channel]
        assert np.abs(found - expected[inner, inner]).max() < 1e-6

    assert solution.display_coverage.min() > 1 - 1e-6
    assert solution.picture_coverage > 1 - 1e-9


def rings(number, size=512):
    """As many rings across a picture as that, as light as cos, from black to white."""
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    grey = 0.5 + 0.5 * np.cos(2 * np.pi * number / size * np.hypot(x, y))
    return np.stack([grey, grey, grey, np.ones_like(grey)], axis=2).astype(np.float32)


@pytest.mark.parametrize(("number", "most"), [(24, 0.8e-3), (60, 2.2e-3)], ids=["24", "60"])
def test_fine_rings_in_a_ball_are_off_by_little_and_by_less_at_a_finer_tolerance(number, most):
    """A picture of seven pixels a viewer pixel, of which rings are four and one and a half apart,
    against the closed form's integral of the picture between its pixels over display pixels.

    It is the rms over a seventh of all pixels. One read each along the picture's axes was off by
    0.0027 and 0.0092. What is left at 0.1 px are reads of the longest sides, shares that are cut,
    and a dozen pixels beside the ball's edge, where the map itself is 0.02 px off.
    """
    a_rig = ball_rig(5, pixels=128, display_pixels=128, image=rings(number))
    index = np.arange(3, 128 * 128, 7)
    exact, cover = exact_source(a_rig, index)
    shown = cover > 1 - 1e-9
    assert shown.sum() > 1000

    errors = [
        np.sqrt(np.mean((solve(a_rig, tolerance=t).source[..., 0].flat[index] - exact)[shown] ** 2))
        for t in (0.1, 0.01)
    ]
    assert errors[0] < most, errors
    assert errors[1] < 0.8 * errors[0], errors


def test_no_pinholes_and_no_ghost_lines_in_the_ball():
    """Inside the covered area every pixel is covered, and white shows as white."""
    solution = solve(
        ball_rig(4, pixels=128, display_pixels=512, image=np.ones((4, 4, 4), np.float32))
    )
    covered = solution.display_coverage
    inside = covered > 0
    for shift in ((0, 1), (1, 0)):
        inside &= np.roll(covered, shift, (0, 1)) > 0
        inside &= np.roll(covered, (-shift[0], -shift[1]), (0, 1)) > 0

    inside[[0, -1]] = inside[:, [0, -1]] = False
    assert inside.mean() > 0.5
    assert (covered[inside] > 0.98).mean() > 0.999
    assert np.isfinite(solution.source).all()
    assert solution.source.max() <= 1 + 1e-6


@pytest.mark.parametrize("make", [lambda **o: ball_rig(4, **o), cube_rig], ids=["ball", "cube"])
def test_the_splat_converges_to_the_source_image_as_monte_carlo_does(make):
    """The distance between splat and source image falls as samples^-1/2, to the end of
    the ladder.
    """
    a_rig = make(pixels=96, display_pixels=48, image=waves())
    solution = solve(a_rig)
    plan = compile_plan(a_rig, Settings())
    whole = solution.display_coverage > 0.999
    assert whole.mean() > 0.2
    ladder = np.array([1, 4, 16, 64])
    errors = []
    for spp in ladder:
        difference = drain(splat(plan, int(spp), seed=int(spp)))[whole] - solution.source[whole]
        errors.append(np.sqrt((difference**2).mean()))
    slope = np.polyfit(np.log(ladder), np.log(errors), 1)[0]
    assert -0.6 < slope < -0.42, errors


def test_a_splat_of_all_light_is_the_same_by_an_ideal_plate():
    """There is no other light than the mid-air image's: the same rays, the same image,
    bit for bit.
    """
    plan = compile_plan(cube_rig(pixels=48, display_pixels=48, image=waves()), Settings())
    assert (drain(splat(plan, 2)) == drain(splat(plan, 2, light="folded"))).all()


def test_a_splat_of_all_light_keeps_white_and_comes_to_the_source_image_as_mirrors_get_finer():
    """White by any plate, stray light and all. Blur falls with the pitch.

    Two runs tell it from their noise.
    """
    apart = []
    for pitch in (2e-3, 0.5e-3):
        a_rig = rig(box([0.3, 0.02, 0.3]), pixels=96, display_pixels=48, image=waves())
        mirrors = MirrorArray(pitch=pitch, height=2.5 * pitch)
        a_rig = replace(a_rig, plates=(replace(a_rig.plates[0], array=mirrors),))
        solution = solve(a_rig)
        plan = compile_plan(a_rig, Settings(brightness=True))
        whole = solution.display_coverage > 0.999
        one, other = (
            drain(splat(plan, 16, seed, "folded"))[whole] - solution.source[whole]
            for seed in (1, 2)
        )
        apart.append(np.sqrt(np.mean(one * other)))
        white = replace(a_rig.picture, image=np.ones((2, 2, 4), np.float32), mesh=None)
        shown = drain(
            splat(replace(plan, rig=replace(a_rig, pictures=(white,))), 2, light="folded")
        )
        is_shown = shown.any(axis=2)
        assert is_shown[whole].mean() > 0.99
        np.testing.assert_allclose(shown[is_shown], 1.0, atol=1e-6)

    coarse, fine = apart
    assert coarse > 4 * fine > 0.01


def test_brightness_weighs_by_throughput_and_brightens_what_the_glass_dims():
    """Least squares with T: where one path lands, the source is
    picture / T, so the viewer sees the picture itself.
    """
    a_rig = rig(box([0.3, 0.02, 0.3]), pixels=64, display_pixels=64, image=ramp(), display=0.05)
    plain = solve(a_rig)
    bright = solve(a_rig, brightness=True)
    shown = (plain.source[..., 2] > 0.2) & (plain.display_coverage > 0.999)
    ratio = bright.source[shown][:, 2] / plain.source[shown][:, 2]
    reflected = ((1.49 - 1) / (1.49 + 1)) ** 2
    assert ratio.min() > 1 / (1 - reflected) ** 2 - 1e-4  # normal incidence is the brightest
    assert ratio.max() < 1.01 / (1 - reflected) ** 2
    inner = (slice(24, 40), slice(24, 40))
    np.testing.assert_allclose(bright.seen()[inner], bright.ideal()[inner], atol=2e-2)


def painted(throughput, light, margin=0):
    """A display (h, w) whose every pixel is seen by one viewer pixel, by a throughput (h, w) of
    its own, painted with light of one colour.
    """
    height, width = throughput.shape
    x, y = np.meshgrid(np.arange(float(width)), np.arange(float(height)))
    corners = np.stack([x.ravel(), y.ravel()], axis=1)[:, None] + [[0, 0], [1, 0], [1, 1], [0, 1]]
    shares = rasterise((width, height), (width, height), corners, corners, throughput.ravel())
    coverage = Coverage((width, height), (width, height))
    coverage.add(shares)

    viewer = replace(rig(box([0.3, 0.02, 0.3])).viewer, width=width, height=height)
    image = np.full((height, width, 4), light, np.float32)
    painting = Painting((width, height))
    filter_taps = find_filter_taps(PicturePlace("Picture", width, height), viewer, shares)
    painting.add(Pyramid(image), filter_taps)
    return painting.finished(coverage.weight, margin)


def test_a_display_pixel_seen_by_less_than_rounding_carries_is_dark(has_kernel):
    """By light T a display pixel shows picture / T, to float32's digits, as far as T^2 is a number
    with digits there, 2^-126 and more; fainter ones are dark, as those that nobody sees.
    """
    powers = np.arange(160)
    source = painted(np.exp2(-powers.astype(float)).reshape(8, 20), 0.75)
    expected = np.where(powers <= 63, 0.75 * np.exp2(powers.astype(float)), 0.0)
    np.testing.assert_allclose(source.reshape(-1, 3), expected[:, None].repeat(3, 1), rtol=1e-6)


def test_the_source_image_of_a_picture_of_any_brightness_is_finite(has_kernel):
    """Each pixel is asked for as much light as the picture's by its throughput, or the most that is
    asked for; grown margins and black that is light leave it finite.
    """
    throughput = np.zeros((8, 20))
    throughput[2:6, 4:12] = np.exp2(-np.arange(32.0)).reshape(4, 8)
    light = float(np.float32(1e25))
    source = painted(throughput, light, margin=2)
    brightest = painted(throughput, 1e35, margin=2)
    shown = throughput > 0
    expected = np.minimum(light / throughput[shown], MOST_LIGHT)
    np.testing.assert_allclose(source[shown], expected[:, None].repeat(3, 1), rtol=1e-6)

    display = replace(rig(box([0.3, 0.02, 0.3])).display, black_level=0.999)
    assert np.isfinite(display.source_for(brightest)).all()
    assert (brightest[shown] == np.float32(MOST_LIGHT)).all()


def test_grown_pixels_are_means_of_their_covered_neighbours():
    """At the image's edges, too, and where pixels may not be grown into."""
    random = np.random.default_rng(0)
    covered = random.random((9, 13)) < 0.3
    is_free = random.random(covered.shape) < 0.7
    image = np.where(covered[..., None], random.random((9, 13, 3)), 0).astype(np.float32)
    grown = grow(image, covered, 1, is_free)
    for y, x in np.ndindex(covered.shape):
        around = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        met = image[around][covered[around]]
        is_new = not covered[y, x] and is_free[y, x] and len(met) > 0
        expected = met.mean(axis=0) if is_new else image[y, x]
        assert grown[y, x] == pytest.approx(expected, rel=1e-6)


def test_a_picture_in_the_viewers_own_pixels_is_what_the_viewer_sees():
    """An image without a mesh covers the viewer's frame: the
    seen image is that image, pixel by pixel.
    """
    a_rig = rig(box([0.3, 0.02, 0.3]), pixels=64, display_pixels=512, display=0.06, image=waves(64))
    a_rig = replace(a_rig, pictures=(replace(a_rig.picture, mesh=None),))
    solution = solve(a_rig)
    inner = (slice(1, -1), slice(1, -1))  # the image is extended beyond its edge
    np.testing.assert_allclose(
        solution.ideal()[inner], a_rig.picture.image[inner][..., :3], atol=2e-3
    )
    whole = solution.first.view_coverage > 0.9999
    assert whole.mean() > 0.9
    assert np.abs(solution.seen() - solution.ideal())[whole].max() < 5e-3
