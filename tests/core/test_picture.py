"""Where the viewer's pixels lie on the picture, and which colours are read there."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.image import flat_picture
from kiriko.core.image import picture as picture_module
from kiriko.core.image.picture import cover_in_view, of_square, picture_from_view, why_unseen
from kiriko.core.image.pyramid import (
    APART,
    MOST_READS,
    POINT_SIDE,
    SIDE,
    Pyramid,
    reads_of,
)
from kiriko.core.image.seen_image import ideal_image
from kiriko.core.rig.rig import Mesh, Picture, PicturePlace, Rig, Viewer
from known.reference_rigs import lattice_image, rectangle


def viewer(projection, shift=0.0):
    a = np.radians(20)
    axes = np.array([[np.cos(a), np.sin(a), 0], [0, 0, 1], [-np.sin(a), np.cos(a), 0]])
    half = 0.05 if projection == "perspective" else 0.06
    return Viewer(
        "v",
        projection,
        np.array([0.02, 0, 0.06]) - axes[2],
        axes,
        (-half + shift, half + shift, -half, half),
        40,
        30,
    )


def ramp(h=8, w=16):
    y, x = (np.mgrid[:h, :w] + 0.5) / np.array([h, w])[:, None, None]
    return np.stack([x, y, 0 * x + 0.5, 0 * x + 1], axis=2).astype(np.float32)


TILTED = rectangle([0.02, 0, 0.05], [0.8, 0.6, 0], [0, 0, 1], 0.07, 0.05)


@pytest.mark.numpy_alone
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_short_way_equals_tracing(projection, monkeypatch):
    """The homography gives the picture's pixels and
    footprints that straight rays to its triangles give.
    """
    v = viewer(projection)
    x, y = np.meshgrid(np.linspace(0, 40, 33), np.linspace(0, 30, 29))
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    a_picture = Picture("p", ramp(), TILTED)
    random = np.random.default_rng(4)
    a, b = random.normal(scale=1e-3, size=(2, 2, len(xy)))
    covariance = np.stack([a[0] ** 2 + b[0] ** 2, a[0] * a[1] + b[0] * b[1], a[1] ** 2 + b[1] ** 2])
    short = picture_from_view(a_picture.place, v, xy, covariance)
    monkeypatch.setattr(flat_picture, "mesh_mapping", lambda *_: None)
    long = picture_from_view(a_picture.place, v, xy, covariance)
    inside = (long.cover > 0) & (short.cover == 1)

    assert inside.sum() > 200
    assert np.array_equal(long.cover > 0, short.cover >= 0.5)
    np.testing.assert_allclose(short.xy[inside], long.xy[inside], atol=1e-9)
    size = long.covariance[:, inside].max(axis=0)
    np.testing.assert_allclose(
        short.covariance[:, inside] / size, long.covariance[:, inside] / size, atol=1e-3
    )
    np.testing.assert_allclose(short.footprint[inside], long.footprint[inside], rtol=1e-2)


def test_projecting_a_point_of_the_picture_gives_its_own_pixel_back():
    """Viewer.project and picture_from_view are inverse to
    each other on the picture, with lens shift.
    """
    v = viewer("perspective", shift=0.01)
    uv = np.random.default_rng(3).random((50, 2))
    a, b, _, d = TILTED.vertices
    points = a + uv[:, :1] * (b - a) + uv[:, 1:] * (d - a)
    found = picture_from_view(Picture("p", ramp(), TILTED).place, v, v.project(points))
    np.testing.assert_allclose(
        found.xy, np.stack([uv[:, 0] * 16, (1 - uv[:, 1]) * 8], axis=1), atol=1e-9
    )


@pytest.mark.parametrize("mesh", [TILTED, None])
def test_a_rig_may_have_a_place_without_pixels(mesh):
    """The place of a picture is known without its colours; who asks for these is told."""
    a_picture = Picture("p", ramp(), mesh)
    place = PicturePlace("p", 16, 8, mesh)
    assert vars(a_picture.place) == vars(place)
    shown = place.showing(a_picture.image)
    assert vars(shown) == vars(a_picture)
    a_rig = Rig((), (), (), (), (place,))
    assert a_rig.picture_place is place
    assert Rig((), (), (), (), (shown,)).picture is shown
    with pytest.raises(RigError, match="The picture has no pixels: choose an image"):
        _ = a_rig.picture


@pytest.mark.parametrize("size", [(40, 30), (263, 129)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    "mesh", [TILTED, replace(TILTED, vertices=TILTED.vertices * 3), "behind", None]
)
def test_the_cover_of_all_pixels_is_that_of_each(mesh, projection, size):
    """Blocks of pixels well within the picture, or beside it, are told by their middles alone."""
    v = replace(viewer(projection), width=size[0], height=size[1])
    if mesh == "behind":
        mesh = replace(TILTED, vertices=TILTED.vertices - 2 * v.axes[2])
    a_picture = Picture("p", ramp(), mesh)
    middles = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in size)), axis=-1).reshape(-1, 2)
    of_each = picture_from_view(a_picture.place, v, middles, of_square(1.0)).cover
    np.testing.assert_allclose(cover_in_view(a_picture.place, v).ravel(), of_each, atol=1e-12)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("middle", "along", "size", "why"),
    [
        ((0, 0, 0, -3), (1, 0), 0.05, "which is behind the viewer: turn the viewer to it"),
        ((3, 0, 0, 0), (1, 0), 0.05, "which is outside its view: move it into the camera's frame"),
        ((0, 3, 0, 0), (1, 0), 0.05, "which is outside its view: move it into the camera's frame"),
        ((0, 0, 0, 0), (0, 1), 0.05, "which is seen edge-on: turn it towards the viewer"),
        ((3, 0, 0, 0), (0, 1), 0.05, "which is outside its view: move it into the camera's frame"),
        (
            (1e-3, 1e-3, 0, 0),
            (1, 0),
            1e-5,
            "which is smaller than a viewer pixel: make it larger, or raise",
        ),
    ],
)
def test_the_reason_why_a_picture_is_not_seen(projection, middle, along, size, why):
    """Behind the viewer, outside its view, edge-on and too small
    are told apart, and none of them is seen at all.
    """
    v = viewer(projection)
    right, up, forward = v.axes
    x, y, _, ahead = middle
    at = v.position + x * right + y * up + (1 + ahead) * forward
    mesh = rectangle(at, along[0] * right + along[1] * forward, up, size, size)
    if size < 1e-3:  # a rectangle is never too small: its outline is smoothed over a pixel
        mesh = replace(mesh, triangles=mesh.triangles[:1], uv=mesh.uv[:1])
    a_picture = Picture("p", ramp(), mesh)
    pixels = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5), axis=-1).reshape(-1, 2)

    if (
        projection == "perspective" or ahead >= 0
    ):  # an orthographic viewer sees things behind it all the same
        assert picture_from_view(a_picture.place, v, pixels, of_square(1.0)).cover.sum() < 1e-6

    assert why_unseen(a_picture.place, v).startswith(why)


def test_a_picture_seen_from_behind_or_edge_on_is_finite():
    """No NaN, whatever side the viewer looks from."""
    v = viewer("perspective")
    edge_on = Mesh(
        np.array([[0, -1, 0], [0, 1, 0], [0, 1, 1], [0, -1, 1.0]]), TILTED.triangles, uv=TILTED.uv
    )
    behind = rectangle([0, -3, 0], [1, 0, 0], [0, 0, 1], 1, 1)
    for mesh in (edge_on, behind):
        image = ideal_image(Picture("p", ramp(), mesh), v)
        assert np.isfinite(image).all()
    assert (ideal_image(Picture("p", ramp(), behind), v) == 0).all()


def test_a_linear_picture_is_read_exactly_at_any_footprint():
    """Away from its edges a linear ramp is the same at every
    level of the pyramid: a mean of a linear function.
    """
    image = ramp(64, 128)
    pyramid = Pyramid(image)
    random = np.random.default_rng(0)
    xy = np.stack([random.uniform(48, 80, 200), random.uniform(24, 40, 200)], axis=1)
    for side in (0.0, 1.0, 1.7, 4.0, 9.3):
        axes = axes_of(np.tile(of_square(side), 200))
        points = picture_module.PicturePoints(xy, np.ones(200), axes)
        expected = np.stack([xy[:, 0] / 128, xy[:, 1] / 64, np.full(200, 0.5)], axis=1)
        np.testing.assert_allclose(pyramid.sample(points), expected, atol=2e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 3), (64, 33)])
def test_every_level_of_the_pyramid_keeps_the_mean(shape):
    """Halving is an exact area mean, for odd sizes too."""
    image = np.random.default_rng(1).random((*shape, 4)).astype(np.float32)
    for level in Pyramid(image).levels:
        found = level[..., :3].mean(axis=(0, 1), dtype=float)
        expected = image[..., :3].mean(axis=(0, 1), dtype=float)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def level_by_level(image, points):
    """Colours (n, 3) of PicturePoints, one by one, from levels made
    of means of 2 x 2: the sizes are powers of two.
    """
    levels = [image[..., :3].astype(float)]
    while len(levels[-1]) > 1:
        n = len(levels[-1]) // 2
        levels.append(levels[-1].reshape(n, 2, n, 2, 3).mean(axis=(1, 3)))

    def read(level, x, y):
        n = len(level)
        x, y = (np.clip(v / 2 ** (len(levels) - n.bit_length()) - 0.5, 0, n - 1) for v in (x, y))
        column, row = (min(int(v), max(n - 2, 0)) for v in (x, y))
        s = x - column
        t = y - row
        right = min(column + 1, n - 1)
        below = min(row + 1, n - 1)
        upper, lower = ((1 - s) * level[r, column] + s * level[r, right] for r in (row, below))
        return (1 - t) * upper + t * lower

    def at_size(x, y, variance):
        spread = [
            4.0**k for k in range(len(levels))
        ]  # the variance of level k is this, less 1 / 3, by 4
        k = int(
            np.clip(np.searchsorted(spread, 1 + 4 * variance, side="right") - 1, 0, len(levels) - 1)
        )
        one = read(levels[k], x, y)
        if k + 1 == len(levels):
            return one
        part = ((1 + 4 * variance) / spread[k] - 1) / 3
        return (1 - part) * one + part * read(levels[k + 1], x, y)

    found = np.zeros((len(points.xy), 3))
    for i, (middle, cover) in enumerate(zip(points.xy, points.cover, strict=True)):
        axes, left = without_left(points.axes[:, i])
        along = [along_side(np.hypot(*points.axes[k : k + 2, i])) for k in (0, 2)]
        found[i] = cover * sum(
            v * w * at_size(*(middle + axes @ (s, t)), left)
            for s, v in along[0]
            for t, w in along[1]
        )

    return found


def along_side(deviation):
    """Steps, in standard deviations, and weights of the reads along a side of a footprint: two that
    come apart from a point, then each of them again. Their variance is the side's.
    """
    side = np.sqrt(12) * deviation
    if side <= POINT_SIDE:
        return [(0, 1)]
    variance = min(side / POINT_SIDE - 1, 1)
    steps = np.array([-1.0, 1.0])
    while 2 * len(steps) <= MOST_READS and side > len(steps) * SIDE:
        over = (side / (len(steps) * SIDE) - 1) * 2 / APART
        steps = np.array([2 * step + end * min(over, 1) for step in steps for end in (-1, 1)])
    steps *= np.sqrt(variance / (steps**2).mean())
    return [(step, 1 / len(steps)) for step in steps]


def without_left(axes):
    """Axes of a footprint, as a matrix, of which a variance is left to levels, and that variance:
    what a read stands for of the shorter side, over that at which there are as many as it takes.
    """
    axes = axes.reshape(2, 2).T
    shorter = np.sqrt(12) * np.hypot(*axes).min()
    most = 0.75 * np.linalg.det(axes) ** 2 / max((axes**2).sum(), 1e-100)
    left = min(max((shorter / MOST_READS) ** 2 - SIDE**2, 0) / 12, most)
    if left > 0:
        axes = axes @ np.linalg.cholesky(np.eye(2) - left * np.linalg.inv(axes.T @ axes))
    return axes, left


def axes_of(covariance):
    """Axes (4, n) of footprints on a picture whose pixels are the viewer's."""
    n = len(covariance[0])
    one, zero = np.ones(n), np.zeros(n)
    return picture_module._axes(np.asarray(covariance, float), (one, zero), (zero, one))


def footprints(random, n, most=2.0):
    """Covariances (3, n) of any size and shape, some of them points and lines."""
    sides = 10 ** random.uniform(-2, most, (2, n))
    turn = random.uniform(0, np.pi, n)
    sides[random.random((2, n)) < 0.1] = 0
    a, b = sides**2 / 12
    c = np.cos(turn)
    s = np.sin(turn)
    return np.stack([a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c])


@pytest.mark.numpy_alone
def test_points_are_read_as_one_by_one():
    """Any places and footprints, beyond the picture's edges and
    larger than it, too: single precision, 1e-6.
    """
    random = np.random.default_rng(9)
    image = random.random((32, 32, 4)).astype(np.float32)
    n = 400
    points = picture_module.PicturePoints(
        random.uniform(-4, 36, (n, 2)),
        np.clip(random.uniform(-0.5, 1.5, n), 0, 1),
        axes_of(footprints(random, n)),
    )
    np.testing.assert_allclose(
        Pyramid(image).sample(points), level_by_level(image, points), atol=1e-6
    )


def all_reads(axes):
    """Places (n, 2), weights (n,) and variances (n,) of the
    reads of one point at the origin of weight 1.
    """
    points = picture_module.PicturePoints(np.zeros((1, 2)), np.ones(1), np.reshape(axes, (4, 1)))
    number, x, y, part, left = reads_of(points, np.zeros(1, np.int32), np.ones(1))
    assert (number == 0).all()
    return np.stack([x, y], axis=1), part, left


def test_reads_reach_as_far_as_the_footprint():
    """All reads of a point together have its weight, its middle and its footprint's covariance, to
    rounding; sides that are nearly points have up to theirs.
    """
    random = np.random.default_rng(10)
    counts = np.zeros(65, int)
    n_levels = 0
    for axes in axes_of(footprints(random, 1200, 1.5)).T:
        places, weights, left = all_reads(axes)
        counts[len(places)] += 1
        n_levels += left[0] > 0
        first, second = np.reshape(axes, (2, 2))
        covariance = np.outer(first, first) + np.outer(second, second)
        size = np.trace(covariance)
        assert weights.sum() == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(weights @ places, 0, atol=1e-12)
        found = np.einsum("n,ni,nj->ij", weights, places, places) + left[0] * np.eye(2)

        missing = np.linalg.eigvalsh(covariance - found)
        sides = np.sqrt(12) * np.hypot(*np.reshape(axes, (2, 2)).T)
        short = sides[sides < 2 * POINT_SIDE]
        assert missing.min() > -1e-9 * size - 1e-15
        assert missing.max() < (short**2).sum() / 12 + 1e-9 * size + 1e-15

    numbers = 2 ** np.arange(2 * np.log2(MOST_READS) + 1).astype(int)
    assert (counts[numbers] > 20).all()
    assert counts[numbers].sum() == 1200
    assert n_levels > 50


def test_reads_do_not_jump():
    """From a point to a line, to a footprint that is read at many places, and on to one that leaves
    a part to levels, reads come apart gradually.
    """
    n = 4001
    t = np.linspace(0, 1, n)
    unit = MOST_READS * SIDE / 3.6  # picture px: footprints of 3.6 leave none yet
    n_left = 0
    for path in (
        lambda t: (0.2 + t, 0.0, 0.2),
        lambda t: (0.1 + t, 0.0, 0.1 + t),
        lambda t: (0.3 + t, 0.2 * t, 0.3 + t / 2),
        lambda t: (0.05 + 0.3 * t, 0.3 * t, 0.05 + 0.35 * t),
        lambda t: (0.02 * t, 0.0, 0.01 * t),
        lambda t: (0.9 + 0.3 * t, 0.1 * t, 0.95 + 0.3 * t),
    ):
        axes = unit * axes_of(np.stack([path(t)[k] + 0 * t for k in range(3)]))
        points = picture_module.PicturePoints(np.zeros((n, 2)), np.ones(n), axes)
        number, x, y, part, left = reads_of(points, np.arange(n, dtype=np.int32), np.ones(n))
        # all moments up to the fourth along some directions tell where the weight is
        moments = [np.bincount(number, part * left, n) / unit**2]
        for along_x, along_y in ((1, 0), (0, 1), (0.6, 0.8), (0.8, -0.6)):
            along = (along_x * x + along_y * y) / unit
            moments += [np.bincount(number, part * along**k, n) for k in (1, 2, 3, 4)]
        assert np.abs(np.diff(moments, axis=1)).max() < 2e-3
        n_left += left.max() > 0
    assert n_left == 2


def test_the_ideal_image_is_the_area_mean_of_the_picture():
    """Seen straight on with two picture pixels a viewer
    pixel, the ideal image is the mean of 2 x 2 to 1 %.
    """
    image = lattice_image(128)
    v = Viewer(
        "v",
        "orthographic",
        np.array([0, -1.0, 0]),
        np.eye(3)[[0, 2, 1]],
        (-0.5, 0.5, -0.5, 0.5),
        64,
        64,
    )
    seen = ideal_image(Picture("p", image, rectangle([0, 0, 0], [1, 0, 0], [0, 0, 1], 1, 1)), v)
    mean = image[..., :3].reshape(64, 2, 64, 2, 3).mean(axis=(1, 3))

    assert np.abs(seen - mean).max() < 0.2
    assert np.abs(seen.mean() - mean.mean()) < 1e-3 * mean.mean()


@pytest.mark.parametrize("shape", [(0, 4, 4), (4, 0, 4)])
def test_a_picture_without_pixels_is_refused(shape):
    with pytest.raises(RigError, match="The picture has no pixels: choose"):
        Pyramid(np.empty(shape, np.float32))


@pytest.mark.parametrize("degrees", [0, 1e-6, 1e-3, 30, 45, 89.999, 90 - 1e-6, 90])
def test_rounding_moves_no_read_of_a_line(degrees):
    """A long and narrow footprint, along an axis or not, that
    single precision rounds is read at the same places.
    """
    random = np.random.default_rng(12)
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    for long in (0.2, 1.0, 18.0, 300.0):
        covariance = np.array([long * c * c + 0.1, long * c * s, long * s * s + 0.1])[:, None]
        expected, *_ = all_reads(axes_of(covariance))
        for _ in range(20):
            rounded = covariance * (1 + 1e-7 * random.uniform(-1, 1, (3, 1)))
            places, *_ = all_reads(axes_of(rounded))
            assert np.abs(places - expected).max() < 1e-5 * np.sqrt(long)
