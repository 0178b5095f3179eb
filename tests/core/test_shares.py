"""Shares against a polygon clipper that knows nothing of edges, rows or cumulative sums."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiriko.core.map import rasterise as rasterise_module
from kiriko.core.map import shares as share_module
from kiriko.core.map.cells import area_within
from kiriko.core.map.shares import Coverage, ShareBatches, add_at
from known.polygons import area_and_centroid, clip, clipped, covariance, pieces_of
from known.rasterised import rasterise, to_display, to_view

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
fixed = settings(derandomize=True, deadline=None, max_examples=150, database=None)


def grid(n_columns, n_rows=None):
    """Viewer pixels as quads (n, 4, 2)."""
    x, y = np.meshgrid(np.arange(float(n_columns)), np.arange(float(n_rows or n_columns)))
    return np.stack([x.ravel(), y.ravel()], axis=1)[:, None] + SQUARE


def by_polygon(shares):
    """Shares of each viewer pixel of a grid, as {pixel: [number of the share]}."""
    order = np.argsort(shares.view_index, kind="stable")
    cuts = np.searchsorted(shares.view_index[order], np.arange(np.prod(shares.view_size) + 1))
    return [order[a:b] for a, b in pairwise(cuts)]


def convex_quads(random, n, size, spread):
    """Convex quads about a random place: a bent parallelogram, of either orientation."""
    a = random.normal(size=(n, 1, 2)) * size
    b = random.normal(size=(n, 1, 2)) * size
    bend = random.uniform(-0.4, 0.4, (n, 1, 2))
    s = SQUARE[:, 0, None] - 0.5
    t = SQUARE[:, 1, None] - 0.5
    # c = bend[0] a + bend[1] b with |bend[0]| + |bend[1]| < 2 keeps the quad convex
    quads = s * a + t * b + s * t * (bend[..., :1] * a + bend[..., 1:] * b)
    return quads + random.uniform(0, spread, (n, 1, 2))


def inverse_bilinear(quad, point):
    """(s, t) in 0..1 with bilinear(quad, s, t) = point, by Newton's method from the middle."""
    st = np.array([0.5, 0.5])
    for _ in range(30):
        s, t = st
        here = (
            (1 - s) * (1 - t) * quad[0]
            + s * (1 - t) * quad[1]
            + s * t * quad[2]
            + (1 - s) * t * quad[3]
        )
        ds = (1 - t) * (quad[1] - quad[0]) + t * (quad[2] - quad[3])
        dt = (1 - s) * (quad[3] - quad[0]) + s * (quad[2] - quad[1])
        st = st + np.linalg.solve(np.stack([ds, dt], axis=1), point - here)

    return st


def coverage(*batches):
    """Coverage of some shares."""
    found = Coverage(batches[0].display_size, batches[0].view_size)
    for shares in batches:
        found.add(shares)
    return found


# --- against the clipper ---


@pytest.mark.parametrize("size", [0.02, 0.3, 1.0, 6.0])
def test_quads_agree_with_clipper(size):
    """Each share has the area and centroid of cell and pixel cut with each other.

    Tolerance: rounding, 1e-11 px.
    """
    random = np.random.default_rng(1)
    width = 37
    height = 23
    n = 12 if size < 6 else 6
    quads = convex_quads(random, n * n, size, 40) - 5
    shares = rasterise((width, height), (n, n), grid(n), quads)

    for number, members in enumerate(by_polygon(shares)):
        expected = clipped(quads[number], width, height)
        total = abs(area_and_centroid(quads[number].tolist())[0])
        assert set(expected) <= set(shares.display_index[members].tolist())
        assert len(members) == len(set(shares.display_index[members].tolist()))
        for i in members:
            area, x, y = expected.get(int(shares.display_index[i]), (0, 0, 0))
            assert shares.display_area[i] == pytest.approx(area, abs=1e-11)
            assert shares.area[i] == pytest.approx(area / total, abs=1e-11 / total)
            if area > 1e-6 * total:
                cell = np.array([number % n, number // n])
                expected_st = inverse_bilinear(quads[number], np.array([x, y]))
                # a centroid is a quotient of areas: 1e-11 over the share's part of the cell
                if shares.display_area[i] != pytest.approx(total, rel=1e-9):
                    np.testing.assert_allclose(
                        shares.view_xy[i] - cell, expected_st, atol=1e-11 / area + 1e-9
                    )


def test_triangles_agree_with_exact_clipper():
    """In rational numbers a triangle's shares differ from
    the exact ones by rounding only, 1e-13 px^2.
    """
    random = np.random.default_rng(2)
    width = 16
    height = 16
    n = 40
    corners = random.uniform(-4, 20, (n, 1, 2)) + random.normal(size=(n, 3, 2)) * random.choice(
        [0.1, 1, 8], (n, 1, 1)
    )
    view = (
        np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        + np.stack([np.arange(n), np.zeros(n)], axis=1)[:, None]
    )
    shares = rasterise((width, height), (n, 1), view, corners)

    for number, members in enumerate(by_polygon(shares)):
        expected = clipped(corners[number], width, height, exact=True)
        total = abs(area_and_centroid(corners[number].tolist())[0])
        found = dict(zip(shares.display_index[members].tolist(), members, strict=True))
        for pixel in expected.keys() | found.keys():
            area, x, y = expected.get(pixel, (0.0, 0, 0))
            share = found.get(pixel)
            assert (0 if share is None else shares.display_area[share]) == pytest.approx(
                area, abs=1e-13
            )
            if area > 1e-6 * total:
                edges = (corners[number, 1:] - corners[number, 0]).T
                weights = np.linalg.solve(edges, np.array([x, y]) - corners[number, 0])
                np.testing.assert_allclose(
                    shares.view_xy[share] - [number, 0], weights, atol=1e-13 / area + 1e-10
                )


coordinate = st.one_of(
    st.floats(-3, 12, allow_nan=False),
    st.integers(-2, 11).map(float),
    st.sampled_from([0.0, 8.0, 0.5, -1e-17, 1e-12]),
)


@fixed
@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3))
def test_any_triangle_agrees_with_exact_clipper(corners):
    """Corners on grid lines, level and upright edges: the
    area in each pixel is exact to 1e-12 px^2.
    """
    shares = rasterise((8, 8), (1, 1), np.array([[[0, 0], [1, 0], [0, 1.0]]]), np.array([corners]))
    image = np.bincount(shares.display_index, shares.display_area, 64)
    expected = np.zeros(64)
    for pixel, (area, _, _) in clipped(corners, 8, 8, exact=True).items():
        expected[pixel] = area
    # a triangle thinner than 1e-5 px is moved by that much,
    # and so can only be told as thin as it is
    height = 1e-5 * np.ptp(np.array(corners), axis=0).max()
    thin = abs(area_and_centroid(corners)[0]) <= height
    np.testing.assert_allclose(image, expected, rtol=0, atol=2 * height if thin else 1e-12)


@fixed
@given(
    st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3),
    st.sampled_from([1.0, 1e3, 1e9]),
    st.sampled_from([(8, 8), (3, 11), (4096, 1)]),
)
def test_the_area_in_a_rectangle_is_the_exact_clippers(corners, far, size):
    """Also of triangles that reach far beyond it, on either side."""
    points = [tuple(Fraction(far * (value - 4)) + 4 for value in corner) for corner in corners]
    part = points
    for axis, limit in enumerate(size):
        part = clip(clip(part, axis, 0, 1), axis, limit, -1)
    exact = float(abs(area_and_centroid(part)[0]))
    x, y = np.array([[float(value) for value in point] for point in points]).T[:, :, None]
    slack = 1e-12 * far * max(size) + 1e-3 * max(size)  # of an edge taken for an upright one
    assert area_within(x, y, size)[0] == pytest.approx(exact, abs=slack)


@pytest.mark.numpy_alone
@fixed
@given(st.lists(st.tuples(coordinate, coordinate), min_size=4, max_size=4))
def test_any_quad_conserves_its_area(corners):
    """Convex, bent in, bow-tie, line or point: no share is
    negative, and inside a display all the area arrives.
    """
    shares = rasterise((18, 18), (1, 1), SQUARE[None], np.array([corners]) + 4)
    assert shares.area.min() > 0
    assert shares.display_area.min() >= 0
    # a bow-tie's diagonal makes two triangles, each right to 1e-9 of it
    assert shares.area.sum() == pytest.approx(1, abs=2e-9)
    assert shares.view_xy.min() >= 0
    assert shares.view_xy.max() <= 1
    pixels = np.stack([shares.display_index % 18, shares.display_index // 18], axis=1)
    # squeezed cells are given a width of 1e-5 px
    assert (pixels + 1 >= np.min(corners, axis=0) + 4 - 1e-4).all()
    assert (pixels <= np.max(corners, axis=0) + 4 + 1e-4).all()


# --- sums and linear functions ---


def turned(points, centre_from, centre_to, scale, angle, flip=False):
    """Points turned and scaled, and the inverse (2, 2) matrix."""
    matrix = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if flip:
        matrix = matrix @ np.diag([-1.0, 1.0])
    return (points - centre_from) @ matrix.T + centre_to, np.linalg.inv(matrix)


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(("view", "scale"), [(24, 8.0), (96, 1.0), (300, 0.125), (96, 1.37)])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2])
def test_affine_map_is_inverted_at_pixel_centres(view, scale, angle, flip):
    """For an affine map the area-weighted mean of the centroids is
    the inverse map of the display pixel's centre.

    So linear functions are reproduced, at any magnification and
    orientation, to 1e-9 viewer px (rounding).
    """
    size = int(view * scale)
    middle = np.array([view / 2, view / 2]), np.array([size / 2 + 0.21, size / 2 - 0.13])
    polygons, inverse = turned(grid(view), *middle, scale, angle, flip)
    shares = rasterise((size, size), (view, view), grid(view), polygons)
    area = to_display(shares, np.ones(len(shares)))
    mean = to_display(shares, shares.view_xy) / np.where(area > 0, area, 1)[..., None]
    full = coverage(shares).of_display > 1 - 1e-12
    assert full.sum() > 0.4 * size * size
    x, y = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    expected = (np.stack([x, y], axis=-1) - middle[1]) @ inverse.T + middle[0]
    np.testing.assert_allclose(mean[full], expected[full], atol=1e-9)
    np.testing.assert_allclose(area[full], 1 / scale**2, rtol=1e-11)


KEYSTONE = np.array(
    [[0.7, 0.1, 0.1], [-0.05, 0.6, 0.12], [0.25, -0.1, 1.0]]
)  # unit square into unit square


def homography(matrix, points):
    """Points (..., 2) mapped by a homography (3, 3)."""
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    return mapped[..., :2] / mapped[..., 2:]


def perspective(points, size):
    """A keystone that maps the unit square into a display, with room to spare."""
    return size * homography(KEYSTONE, points)


@pytest.mark.parametrize("size", [16, 64, 500])
def test_sums_are_the_polygons_areas(size):
    """Inside the display, each cell's shares sum to its area on
    the viewer's image, and to that on the display.
    """
    view = grid(64)
    polygons = perspective(view / 64, size)
    shares = rasterise((size, size), (64, 64), view, polygons)
    np.testing.assert_allclose(to_view(shares, np.ones(len(shares))), 1, rtol=1e-10)
    d1 = polygons[:, 2] - polygons[:, 0]
    d2 = polygons[:, 3] - polygons[:, 1]
    expected = 0.5 * np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
    got = np.bincount(shares.view_index, shares.display_area)
    np.testing.assert_allclose(got, expected, rtol=1e-10)
    # neighbours share their edges: no pinhole, no overlap
    assert np.bincount(shares.display_index, shares.display_area).max() < 1 + 1e-11
    np.testing.assert_allclose(coverage(shares).of_view, 1, rtol=1e-10)


def keystone_means(size):
    """Exact viewer area and centroid (unit square) of each
    display pixel under the keystone, by Gauss's quadrature.
    """
    nodes, weights = np.polynomial.legendre.leggauss(6)
    inverse = np.linalg.inv(KEYSTONE)
    y, x = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    area = np.zeros((size, size))
    moment = np.zeros((size, size, 2))

    for sx, wx in zip(nodes, weights, strict=True):
        for sy, wy in zip(nodes, weights, strict=True):
            point = np.stack([x + 0.5 + sx / 2, y + 0.5 + sy / 2], axis=-1) / size
            # the Jacobian of a homography M is det M / (third homogeneous coordinate)^3
            density = np.linalg.det(inverse) / (point @ inverse[2, :2] + inverse[2, 2]) ** 3
            area += 0.25 * wx * wy * density / size**2
            moment += (0.25 * wx * wy * density / size**2)[..., None] * homography(inverse, point)

    return area, moment / area[..., None]


@pytest.mark.numpy_alone
def test_smooth_map_is_inverted_to_second_order():
    """Halving the cells divides the error of the mean viewer
    position by about four, large cells or small.

    They go from eight display pixels to half of one; 3 leaves room
    for the pixels' changing place among the cells.
    """
    size = 40
    errors = []
    expected = keystone_means(size)[1]
    for n in (5, 10, 20, 40, 80):
        view = grid(n)
        shares = rasterise((size, size), (n, n), view, perspective(view / n, size))
        full = coverage(shares).of_display > 1 - 1e-9
        area = to_display(shares, np.ones(len(shares)))
        mean = to_display(shares, shares.view_xy / n)[full] / area[full][:, None]
        errors.append(np.sqrt(((mean - expected[full]) ** 2).mean()))
    assert (np.array(errors[:-1]) / errors[1:] > 3.0).all()


def test_clipping_at_the_border_keeps_the_part_inside():
    """A cell far larger than the display covers it whole, and
    gives it the part of its area that lies there.
    """
    quad = np.array([[[-1e4, -2e4], [3e4, -1e4], [2e4, 4e4], [-3e4, 1e4]]])
    for polygon in (quad, quad[:, ::-1]):
        shares = rasterise((31, 17), (1, 1), SQUARE[None], polygon)
        np.testing.assert_allclose(coverage(shares).of_display, 1, atol=1e-9)
        total = abs(area_and_centroid(quad[0].tolist())[0])
        assert shares.area.sum() == pytest.approx(31 * 17 / total, rel=1e-9)


# --- caustics and broken cells ---


@pytest.mark.parametrize("k", [3, 4])
@pytest.mark.parametrize("width", [0.0, 1e-17, 1e-12, 1e-8, 1e-5, 1e-3])
@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 2, 2.5])
def test_cells_squeezed_to_a_line_keep_their_area(k, width, angle):
    """On a caustic a cell's image is a line: all its area lies in
    the pixels along it, where an affine map puts it.
    """
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-np.sin(angle), np.cos(angle)])
    view = SQUARE[None, :k]
    line = 7 * (view[..., :1] - 0.5) * along + width * view[..., 1:] * across + [8.43, 8.57]
    shares = rasterise((17, 17), (1, 1), view, line)
    area = 1 if k == 4 else 0.5

    assert shares.area.min() > 0
    assert shares.area.sum() == pytest.approx(area, rel=1e-8)
    assert shares.display_area.sum() == pytest.approx(7 * width * area, rel=1e-6, abs=1e-12)
    s = shares.view_xy[:, :1]
    where = 7 * (s - 0.5) * along + [8.43, 8.57]
    pixel = np.stack([shares.display_index % 17, shares.display_index // 17], axis=1)

    # the share's own point lies in its pixel, up to the width of the line
    big = shares.area > 1e-6
    assert (np.abs(where - pixel - 0.5)[big] <= 0.5 + 2e-3).all()


@pytest.mark.parametrize("place", [(3.3, 4.6), (3.0, 4.0), (0.0, 0.0), (8.0, 4.0)])
def test_cells_squeezed_to_a_point(place):
    """A cell that lands on one point gives all its area to the pixel that holds it.

    A point on a grid line belongs to the pixel on its right and
    below, one on the display's right border to none.
    """
    for k in (3, 4):
        shares = rasterise(
            (8, 8), (1, 1), SQUARE[None, :k], np.broadcast_to(np.array(place), (1, k, 2))
        )
        if place[0] == 8:
            assert len(shares) == 0
            continue
        assert shares.display_index.tolist() == [int(place[1]) * 8 + int(place[0])]
        assert shares.area.sum() == pytest.approx(1 if k == 4 else 0.5, rel=1e-12)


def test_fold_is_seen_from_both_sides():
    """A row of cells folded over (x -> |x|) covers its half
    twice: coverage stays 1, the area doubles.
    """
    view = grid(9, 4)
    image = view.copy()
    image[..., 0] = np.abs(view[..., 0] - 4.5) + 1.25
    image[..., 1] += 1
    shares = rasterise((8, 6), (9, 4), view, image)
    assert shares.area.sum() == pytest.approx(36, rel=1e-9)
    area = to_display(shares, np.ones(len(shares)))
    np.testing.assert_allclose(area[2:4, 2:5], 2, rtol=1e-9)
    assert coverage(shares).of_display.max() == 1


def test_broken_cells_are_left_out():
    """NaN, infinite and huge corners, and cells of no area on
    the viewer's image, give no share and no warning.
    """
    polygons = np.repeat(SQUARE[None] * 2 + 0.5, 6, axis=0)
    view = grid(6, 1)
    polygons[0, 2, 0] = np.nan
    polygons[1, 1, 1] = np.inf
    polygons[2, 3] = [-np.inf, 1e308]
    polygons[3] *= 1e200
    view[4] = view[4, :1]
    with np.errstate(all="raise"):
        shares = rasterise((5, 5), (6, 1), view, polygons)
    assert set(shares.view_index.tolist()) == {5}
    assert shares.area.sum() == pytest.approx(1)
    assert len(rasterise((5, 5), (6, 1), view[:0], polygons[:0])) == 0


def test_one_cell_over_a_large_display_is_cut_in_bands():
    """A cell of millions of pixels is worked off in parts, and
    the parts fit: each pixel is covered once.
    """
    quad = np.array([[[-3.0, 5.0], [1500.0, -10.0], [1400.0, 1210.0], [40.0, 1190.0]]])
    shares = rasterise((1300, 1200), (1, 1), SQUARE[None], quad)
    assert len(np.unique(shares.display_index)) == len(shares)
    assert coverage(shares).of_display[600, 100:1200] == pytest.approx(1, abs=1e-11)
    inside = clip(clip(quad[0].tolist(), 0, 0, 1), 0, 1300, -1)
    inside = clip(clip(inside, 1, 0, 1), 1, 1200, -1)
    assert shares.display_area.sum() == pytest.approx(abs(area_and_centroid(inside)[0]), rel=1e-12)


# --- products ---


def test_products_are_transposes_of_each_other():
    """<A x, y> = <x, A^T y> for any viewer image x and display image y, with throughput
    as weights.
    """
    random = np.random.default_rng(4)
    view = grid(30, 20)
    quads = turned(view, [15, 10], [20, 16], 1.3, 0.7)[0]
    throughput = random.uniform(0, 1, len(view))
    shares = rasterise((40, 32), (30, 20), view, quads, throughput)
    x = random.normal(size=(20, 30, 3))
    y = random.normal(size=(32, 40, 3))
    display = to_display(shares, x.reshape(-1, 3)[shares.view_index], shares.throughput)
    back = to_view(shares, y.reshape(-1, 3)[shares.display_index], shares.throughput)

    assert display.shape == (32, 40, 3)
    assert back.shape == (20, 30, 3)
    assert (display * y).sum() == pytest.approx((x * back).sum(), rel=1e-12)
    one = to_display(shares, x.reshape(-1, 3)[shares.view_index, 0], shares.throughput)
    np.testing.assert_allclose(one, display[..., 0], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("has_path", [False, True])
@pytest.mark.parametrize("has_throughput", [False, True])
@pytest.mark.parametrize("most", [0, 1 << 20], ids=["made again", "kept"])
def test_batches_add_up(monkeypatch, most, has_throughput, has_path):
    """Batches are the shares of all cells, each time they are asked for.

    Few are kept, many are divided anew.
    """
    monkeypatch.setattr(rasterise_module, "SHARES_AT_ONCE", 50)
    monkeypatch.setattr(rasterise_module, "PARTS_AT_ONCE", 64)
    monkeypatch.setattr(share_module, "MOST_CACHED", most)
    view = grid(12)
    asked = []
    quads = turned(view, [6, 6], [9, 9], 1.2, 0.3)[0]
    throughput = np.random.default_rng(7).uniform(0, 1, len(view))
    path = np.arange(len(view), dtype=np.uint64)

    def pieces():
        asked.append(1)
        for some in (slice(0, 70), slice(70, None)):
            yield view[some], quads[some], throughput[some], path[some] if has_path else None

    batches = ShareBatches((18, 18), (12, 12), has_throughput, pieces, has_path)
    assert not batches.are_cached
    whole = rasterise((18, 18), (12, 12), view, quads, throughput if has_throughput else None)
    weight = to_display(whole, np.ones(len(whole)) if not has_throughput else whole.throughput**2)

    for _ in range(2):
        every = list(batches)
        assert len(every) > 3
        assert len(batches) == sum(len(shares) for shares in every) == len(whole)
        for shares in every:
            assert shares.path is None if not has_path else (shares.path == shares.view_index).all()
        found = coverage(*every)
        np.testing.assert_allclose(found.weight, weight, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(found.of_view, coverage(whole).of_view, rtol=1e-12)
        np.testing.assert_allclose(
            found.of_display, coverage(whole).of_display, rtol=1e-12, atol=1e-15
        )

    assert batches.are_cached == bool(most)
    assert len(asked) == (1 if most else 2)


def test_no_cells_have_no_shares():
    """A map without cells, or with none on the display, has no shares, and that is no error."""
    for pieces in ([], [(grid(3), grid(3) - 50, np.ones(9), None)]):
        batches = ShareBatches((8, 8), (3, 3), False, lambda pieces=pieces: iter(pieces))
        assert sum(len(shares) for shares in batches) == len(batches) == 0


def test_what_is_added_to_an_image_is_added_to_what_is_there():
    """The sums of a batch are added to those of others, wherever its pixels lie.

    Without any nothing changes.
    """
    random = np.random.default_rng(8)
    image = random.normal(size=(7, 9))
    expected = image.copy()
    for low, high in ((0, 63), (20, 21), (40, 63), (5, 5)):
        index = random.integers(low, max(high, low + 1), high - low)
        weights = random.normal(size=high - low)
        np.add.at(expected.reshape(-1), index, weights)
        add_at(image, index, weights)
    np.testing.assert_allclose(image, expected, rtol=1e-13)


@pytest.mark.numpy_alone
def test_order_and_chunks_do_not_matter():
    """The image is the same when the cells come shuffled, so no
    share depends on its neighbours in the batch.
    """
    view = grid(200)
    quads = turned(view, [100, 100], [130, 120], 1.1, 0.5)[0]
    order = np.random.default_rng(6).permutation(len(view))
    one = rasterise((256, 256), (200, 200), view, quads)
    other = rasterise((256, 256), (200, 200), view[order], quads[order])
    assert len(one) == len(other)
    np.testing.assert_allclose(
        to_display(one, one.view_xy), to_display(other, other.view_xy), rtol=1e-10, atol=1e-10
    )


@pytest.mark.parametrize("k", [3, 4])
@pytest.mark.parametrize("size", [0.2, 1.0, 5.0])
def test_a_share_reaches_as_far_as_its_part_of_the_cell(k, size):
    """The covariance on the viewer's image is that of what of
    the cell lies in the pixel: single precision, 1e-5.

    Triangles and parallelograms, whose map is affine: of bent quads the affine part counts.
    """
    random = np.random.default_rng(7)
    to_display = random.normal(size=(2, 2)) * size
    view = np.array([[0.0, 0.0], [1.0, 0.2], [1.3, 1.0], [0.3, 0.8]])[:k]

    n_seen = 0
    for _ in range(20):
        display = view @ to_display + random.uniform(4, 12, 2)
        shares = rasterise((16, 16), (2, 2), view[None], display[None])
        parts = pieces_of([tuple(point) for point in display], 16, 16)
        for i, pixel in enumerate(shares.display_index.tolist()):
            part = parts[pixel]
            if len(part) < 3 or abs(area_and_centroid(part)[0]) < 1e-4:
                continue
            inverse = np.linalg.inv(to_display)
            expected = inverse.T @ covariance(part) @ inverse
            xx, xy, yy = shares.covariance[:, i]
            np.testing.assert_allclose(
                [[xx, xy], [xy, yy]], expected, atol=1e-5 * np.trace(expected) + 1e-9
            )
            n_seen += 1

    assert n_seen > 20


def test_slivers_have_no_covariance_but_rounding():
    """However thin a part is, its covariance is that of some
    points of the cell, which is one viewer pixel large.
    """
    random = np.random.default_rng(8)
    quads = convex_quads(random, 400, 1.0, 30) + 1e7 * (random.random((400, 1, 1)) < 0.3)
    quads[::3, :, 0] = np.round(quads[::3, :, 0]) + 1e-9 * quads[::3, :, 1]
    shares = rasterise((10_000_100, 40), (20, 20), grid(20), quads)
    xx, xy, yy = shares.covariance.astype(float)
    assert max(xx.max(), yy.max()) <= 0.25 + 1e-6
    assert (xx >= -1e-6).all()
    assert (yy >= -1e-6).all()
    assert (xy**2 <= xx * yy * (1 + 1e-3) + 1e-6).all()
