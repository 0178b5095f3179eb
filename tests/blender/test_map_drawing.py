"""Images drawn by the graphics card, against painted ones. A Blender without windows can draw from
5.1 on, and with a driver: software OpenGL is one.
"""

from dataclasses import replace
from time import perf_counter

import bpy
import gpu
import numpy as np
import pytest

from bench import brought_glass as glasses
from extension import loaded
from kiriko.core.base.steps import run_steps
from kiriko.core.files.encoding import quantised
from kiriko.core.light.rays import Reason
from kiriko.core.map.view_map import ViewMap
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.channel import WHITE, ChannelKey
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, cube_rig, glass_rig
from small_rigs import pixels, small_rig

SIZE = 1920, 1080
NEAR = 2  # of 255
LONG = 60.0  # s


@pytest.fixture(scope="module", autouse=True)
def graphics() -> None:
    """Draw without a window."""
    if not hasattr(gpu, "init"):
        pytest.skip("This Blender draws in a window only.")
    try:
        gpu.init()
    except Exception as error:  # of this very class
        pytest.skip(f"There is no graphics driver: {error}")


@pytest.fixture
def map_drawing():
    from kiriko.operators import map_drawing

    yield map_drawing
    map_drawing.unregister()


def photograph(n: int = 1024) -> np.ndarray:
    """A picture (n, n, 4) with the spectrum of a photograph, 1 / f, and hard edges."""
    random = np.random.default_rng(1)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    frequency[0, 0] = np.inf
    common = random.standard_normal((n, n))
    planes = []
    for _ in range(3):
        noise = np.fft.fft2(0.7 * common + 0.3 * random.standard_normal((n, n)))
        plane = np.fft.ifft2(noise / frequency**1.2).real
        planes.append(plane / plane.std())
    image = np.stack(planes, axis=2)
    y, x = np.mgrid[:n, :n]
    for _ in range(40):
        column, row, radius = random.random(3) * [n, n, n / 8]
        image[(x - column) ** 2 + (y - row) ** 2 < radius**2] += 0.7 * random.standard_normal(3)
    linear = (1 / (1 + np.exp(-image))) ** 2.2
    return np.dstack([linear, np.ones((n, n))]).astype(np.float32)


def wine_glass(**options):
    mesh = replace(glasses.made("wine glass"), surface="automatic")
    return glass_rig(mesh, **options)


def near(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float:
    """Fraction of some pixels whose 8-bit numbers differ by at most NEAR."""
    ours, theirs = (quantised(image, "uint8").astype(int) for image in (one, other))
    return float((np.abs(ours - theirs).max(axis=2) <= NEAR)[where].mean())


@pytest.mark.parametrize("make", [ball_rig, cube_rig, wine_glass])
def test_drawn_images_are_the_painted_ones(map_drawing, make):
    """99 % of the covered pixels and of those with light are within 2 of 255, on the display, seen
    by the viewer, and without glass.
    """
    a_rig = make(image=photograph())
    width, height = SIZE
    display = replace(a_rig.displays[0], width=width, height=height)
    a_rig = replace(a_rig, displays=(display,))
    session, settings = Session(), Settings()
    solution = run_steps(session.solve(a_rig, settings))
    maps = run_steps(session.view_maps(a_rig, settings))
    source = map_drawing.source_image(a_rig, settings, maps)
    assert near(source, solution.source, solution.weight > 0) > 0.99
    assert near(source, solution.source, solution.source.any(axis=2)) > 0.99

    seen, first = solution.seen(), solution.first
    ours = map_drawing.seen_image(first.view_map, solution.source, settings)
    assert near(ours, seen, first.view_coverage > 0) > 0.99
    assert near(ours, seen, seen.any(axis=2)) > 0.99

    ideal = solution.ideal()
    ours = map_drawing.ideal_image(a_rig.picture, a_rig.viewer)
    assert near(ours, ideal, ideal.any(axis=2)) > 0.98


def test_overlapping_light_is_the_mean_by_weight(map_drawing):
    """Two squares of one viewer land on one display, the second from four times the area: the
    display shows their colours in the parts 1/5 and 4/5.
    """
    a_rig = ball_rig(1, pixels=8, display_pixels=4)
    picture = replace(a_rig.picture, image=np.zeros((8, 8, 4), np.float32), mesh=None)
    picture.image[:4, :4, 0] = picture.image[4:, 4:, 1] = 1.0
    a_rig = replace(a_rig, pictures=(picture,))
    solved = run_steps(Session().view_maps(a_rig, Settings()))[0][1]
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    view = np.concatenate([1 + square, 5 + 2 * square])
    points = replace(
        solved.points.at(np.zeros(8, int)),
        view=view,
        xy=np.concatenate([4 * square, 4 * square]),
        reason=np.full(8, Reason.ARRIVED, np.uint8),
    )
    none = np.empty(0, int)
    view_map = ViewMap(
        (8, 8), (4, 4), points, np.empty((0, 2), int), none, np.empty((0, 25), int),
        np.arange(8).reshape(2, 4), np.empty((0, 3), int), solved.reason, 0.1,
    )  # fmt: skip
    settings = Settings()
    key = ChannelKey(a_rig.viewer, settings.wavelength, WHITE)
    found = map_drawing.source_image(a_rig, settings, [(key, view_map)])
    assert np.allclose(found, [0.2, 0.8, 0.0], atol=1e-3)

    dark = replace(view_map, points=replace(points, xy=points.xy - 9))
    assert not map_drawing.source_image(a_rig, settings, [(key, dark)]).any()


def test_live_draws_while_something_moves_and_paints_at_rest(scene, kiriko, monkeypatch):
    """The first picture after a change is drawn and leaves the image's pixels; the last one is
    painted.
    """
    live, ours = kiriko.operators.live, loaded("operators.map_drawing")
    monkeypatch.setattr(ours, "has_shaders", lambda: True)
    rig = small_rig()
    try:
        bpy.ops.kiriko.live()
        settle(live)
        image = scene.kiriko.result.source
        before = pixels(image).copy()
        rig["PICTURE"].location.x += 1e-3
        bpy.context.view_layer.update()
        first = live.followed().n_pictures
        while live.followed().n_pictures == first:
            live.tick()
        assert ours.texture_for(image) is not None
        assert np.array_equal(pixels(image), before)
        settle(live)
        assert ours.texture_for(image) is None
        assert not np.array_equal(pixels(image), before)
    finally:
        live.stop()


def settle(live) -> None:
    """Take the timer's turns until there is nothing left to do."""
    end = perf_counter() + LONG
    while live.tick() != live.live_follower.IDLE:
        assert perf_counter() < end, "Live never comes to rest."
