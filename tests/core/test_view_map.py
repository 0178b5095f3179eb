"""The view map's cells: their cover, where they are cut."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.map import smooth_cells
from kiriko.core.map.pieces import SWING, quads_of
from kiriko.core.map.points import Points
from kiriko.core.map.sampling import sample
from kiriko.core.rig.rig import Blocker, ConstantIndex, Glass, Mesh, Mirror
from kiriko.core.rig.settings import Settings
from known.rasterised import rasterise
from known.reference_rigs import (
    ball_rig,
    bottle,
    box,
    cube_rig,
    icosphere,
    rectangle,
    rig,
    rod,
    torus,
    wavy_slab,
)
from known.work import drain, is_sampled, solve


def view_map(a_rig, **settings):
    return drain(sample(compile_plan(a_rig, Settings(**settings))))


def areas(polygons):
    x, y = np.moveaxis(polygons, 2, 0)
    return 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)


def coverage(found):
    """Area (h, w) of cells and samples on each viewer pixel, the
    former by rasterising them onto the viewer's image.
    """
    sizes = found.view_size, found.view_size
    cells = replace(found, samples=found.samples[:0], sample_area=found.sample_area[:0])
    parts = [rasterise(*sizes, view, view) for view, *_ in cells.pieces(at_pixels=True)]
    w, h = found.view_size
    has_landed = found.points.branch[found.samples] != 0
    column, row = np.floor(found.points.view[found.samples[has_landed]]).astype(int).T
    sampled = np.bincount(row * w + column, found.sample_area[has_landed], w * h)
    return sum(
        [sampled, *(np.bincount(s.display_index, s.display_area, w * h) for s in parts)]
    ).reshape(h, w)


def turned_square(degrees, side=0.02):
    """A square rod along the view axis, turned about it:
    its silhouette crosses the pixels at an angle.
    """
    mesh = box([side, 0.02, side])
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    return Mesh(mesh.vertices @ turn.T, mesh.triangles)


@pytest.mark.numpy_alone
@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0])
def test_cut_cells_cover_the_silhouette_exactly(degrees):
    """Seen in parallel along the rod, the covered area is the
    square's, pixel by pixel as the square covers them.
    """
    a_rig = rig(
        turned_square(degrees), projection="orthographic", pixels=50, field=0.05, display=0.06
    )
    found = view_map(a_rig)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * 10
    a = np.radians(degrees)
    square = corners @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + 25
    exact = rasterise((50, 50), (50, 50), square[None], square[None])
    expected = np.bincount(exact.display_index, exact.display_area, 2500).reshape(50, 50)

    # a border is known to 2^-9 px on each edge; within a pixel it
    # is straight, so a corner's pixel loses a little
    error = np.abs(coverage(found) - expected)
    assert np.sort(error.ravel())[-5] < 2e-3
    assert error.max() < 0.2
    assert abs(coverage(found).sum() - 400) < 0.8


def test_every_piece_has_the_same_orientation_and_none_is_empty():
    """Pieces of cut pixels are convex and wound as the pixels
    are: positive area each, at most 1 in a pixel.
    """
    found = view_map(cube_rig(pixels=128))
    for view, *_ in found.pieces():
        assert (areas(view) > (-1e-12 if view.shape[1] == 3 else 0)).all()
    assert coverage(found).max() < 1 + 1e-9


@pytest.mark.numpy_alone
def test_pieces_and_misses_make_up_the_image():
    """Where all corners of a pixel miss nothing is covered,
    where all arrive on one branch all of it is.
    """
    found = view_map(ball_rig(4, pixels=128))
    has_arrived = np.isin(
        found.reason, [Reason.ARRIVED, Reason.MISSED_DISPLAY]
    )  # cells go on beyond the display
    corners = np.stack(
        [has_arrived[:-1, :-1], has_arrived[:-1, 1:], has_arrived[1:, :-1], has_arrived[1:, 1:]]
    )
    covered = coverage(found)
    assert covered[~corners.any(axis=0)].max() == 0
    assert covered[(found.reason == Reason.ARRIVED)[:-1, :-1] & corners.all(axis=0)].min() > 0.9


def throughput_of_quads(by_node, m):
    """Throughput (m, m) of the quads of one cell with a throughput (5, 5) at its nodes."""
    y, x = np.mgrid[:5, :5] / 4.0
    at = np.stack([x.ravel(), y.ravel()], axis=1)
    alike = np.ones(25, np.uint64), np.zeros(25, np.uint8)
    points = Points(at, at, *alike, by_node.ravel())
    nodes = np.arange(25)[None]
    return quads_of(points, np.zeros((1, 2)), np.ones(1), nodes, m).throughput.reshape(m, m)


@pytest.mark.parametrize("m", [4, 8, 32])
def test_light_that_falls_steeply_within_a_cell_swings_below_nothing_nowhere(m):
    """Light of three nodes of a thousandth and two without: quartics would have it below nothing
    next to them. It stays near the range of the nodes, and where it is smooth it is the quartic's.
    """
    steep = np.broadcast_to([0.8, 0.8, 1e-3, 1e-3, 1e-3], (5, 5))
    for by_node in (steep, steep.T, steep * steep.T):
        found = throughput_of_quads(by_node, m)
        assert found.min() >= by_node.min() / SWING
        assert found.max() <= by_node.max() * SWING

    y, x = np.mgrid[:5, :5] / 4.0
    smooth = np.exp(-3 * x) * np.cos(y)
    grid = smooth_cells.on_grid(smooth.reshape(1, 25, 1), m)[0, ..., 0]
    corners = grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, 1:] + grid[1:, :-1]
    np.testing.assert_allclose(throughput_of_quads(smooth, m), corners / 4, rtol=1e-12)


def test_a_saddle_pixel_is_not_covered_twice():
    """Two rods that meet at a corner inside a pixel: the
    pixel's coverage is their area, not their overlap's.
    """
    s = 0.02
    boxes = tuple(
        Glass(n, box([s, 0.02, s], (x * s / 2 + 3e-4, 0, x * s / 2 + 4e-4)))
        for n, x in (("a", -1), ("b", 1))
    )
    found = view_map(rig(boxes, projection="orthographic", pixels=50, field=0.05, display=0.06))
    covered = coverage(found)
    assert covered.max() < 1 + 1e-9
    assert abs(covered.sum() - 800) < 1.5  # eight corners of squares, each cut off within its pixel


@pytest.mark.numpy_alone
def test_faceted_glass_is_cut_at_its_edges():
    """A flat-shaded ball maps each facet by its own prism:
    cells join no two facets, so they map affinely.
    """
    found = view_map(rig(icosphere(0.025, 1, smooth=False), pixels=64, display=0.2))
    n_inside = 0
    for _, q, *_ in found.pieces(at_pixels=True):
        if q.shape[1] == 4:
            inside = (q > 0).all(axis=(1, 2)) & (q < 512).all(axis=(1, 2))
            bow = np.abs(q[:, 0] - q[:, 1] + q[:, 2] - q[:, 3]).max(axis=1)  # 0 for an affine map
            assert bow[inside].max(initial=0.0) < 0.05 * np.abs(q[:, 2] - q[:, 0]).max()
            n_inside += inside.sum()
    assert n_inside > 100


def dense(a_rig, n=None):
    """Viewer px (n, 2), pixel centres or n random places, and where
    rays traced there land, within the image or not.
    """
    w = a_rig.viewer.width
    h = a_rig.viewer.height
    x, y = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    at = (
        np.stack([x.ravel(), y.ravel()], axis=1)
        if n is None
        else np.random.default_rng(3).uniform(0, (w, h), (n, 2))
    )
    landings = trace_all(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(at))
    return at, np.where((landings.branch != 0)[:, None], landings.xy, np.nan)


def on_display(xy, a_rig):
    with np.errstate(invalid="ignore"):
        return ((xy >= 0) & (xy <= (a_rig.display.width, a_rig.display.height))).all(axis=1)


SCENES = {
    "ball": lambda: ball_rig(5, pixels=256),
    "cube": lambda: cube_rig(pixels=256),
    "bottle": lambda: rig(bottle(), pixels=256),
    "gem": lambda: rig(icosphere(0.025, 0, smooth=False), pixels=256, display=0.2),
    "wavy slab": lambda: rig(wavy_slab(64), pixels=256),
    "critical curve": lambda: rig(
        wavy_slab(96, thickness=0.03, amplitude=0.003), pixels=256, display=0.1
    ),
}


@pytest.mark.parametrize("display", [0.03, 0.1])
@pytest.mark.parametrize("scene", ["bottle", "flat ball", "critical curve"])
def test_shares_are_counted_before_they_are_made(scene, display):
    """Within a tenth, wherever pieces lie on the display, and however far beyond it."""
    mesh = {
        "bottle": bottle,
        "flat ball": lambda: icosphere(0.025, 2, smooth=False),
        "critical curve": lambda: wavy_slab(96, thickness=0.03, amplitude=0.003),
    }[scene]()
    found = view_map(rig(mesh, pixels=96, display=display))
    sizes = found.display_size, found.view_size
    made = sum(len(rasterise(*sizes, view, xy)) for view, xy, *_ in found.pieces())
    assert found.shares_by_kind.sum() == pytest.approx(made, rel=0.1)


@cache
def judged(scene, n=None):
    """A scene's rig, and its rays by `dense`: the same rays for every tolerance."""
    a_rig = SCENES[scene]()
    return a_rig, *dense(a_rig, n)


@pytest.mark.parametrize("tolerance", [0.1, 0.02])
@pytest.mark.parametrize("scene", SCENES)
def test_the_map_keeps_the_tolerance(scene, tolerance):
    """Held to a ray through each pixel's middle: 99.9 % within the tolerance; of the bottle, whose
    rim is cut in quarters at the most, 99 % within 0.05 px or that. Covered masks agree to 0.999.

    The few pixels that are sampled, where borders meet, are near
    to the nearest sample's value, and no nearer.
    """
    a_rig, at, exact = judged(scene)
    found = view_map(a_rig, tolerance=tolerance)
    got = found.display_from_view(at)
    mine = on_display(got, a_rig)
    theirs = on_display(exact, a_rig)

    assert theirs.sum() > 10_000
    is_cut = ~is_sampled(found, at)
    assert is_cut[theirs].mean() > 0.99
    off = np.linalg.norm(got - exact, axis=1)[mine & theirs & is_cut]
    share, most = (0.99, max(tolerance, 0.05)) if scene == "bottle" else (0.999, tolerance)
    assert np.quantile(off, share) <= most
    assert (mine & theirs).sum() / (mine | theirs).sum() >= 0.999

    # whatever the rays through the middles told the map: places that it has never seen
    _, at, exact = judged(scene, 20_000)
    got = found.display_from_view(at)
    mine = on_display(got, a_rig)
    theirs = on_display(exact, a_rig)
    off = np.linalg.norm(got - exact, axis=1)[mine & theirs]
    known = found.error.facet_limited + found.error.unresolved

    assert (off > tolerance).mean() < 1.5 * known + 2e-3
    assert found.sample_area.sum() < 0.01 * 256**2
    off = np.linalg.norm(got - exact, axis=1)[mine & theirs & ~is_sampled(found, at)]
    assert np.sqrt((off**2).mean()) < max(3 * found.error.rms, 0.1 * tolerance)
    assert (mine & theirs).sum() / (mine | theirs).sum() >= 0.998


def test_smooth_optics_needs_few_rays():
    """The ball at 512 px: a fifth of a ray a pixel.

    From 256 to 1024 px rays grow with less than the root of pixels.
    """
    n_rays = {pixels: view_map(ball_rig(4, pixels=pixels)).n_rays for pixels in (256, 1024)}
    assert n_rays[1024] < 0.2 * 1024**2
    assert np.log(n_rays[1024] / n_rays[256]) / np.log(16) < 0.6


THIN = {
    "needle": lambda r: Glass(
        "needle", rod((-0.012, 0, -0.008), (0.011, 0.004, 0.009), r), ConstantIndex(1.8)
    ),
    "bubble": lambda r: Glass(
        "bubble", icosphere(r, 2, centre=(0.0061, 0.003, -0.0047)), ConstantIndex(1.0)
    ),
    "needle before": lambda r: Glass(
        "needle", rod((-0.02, -0.06, 0.02), (0.015, -0.05, -0.02), r), ConstantIndex(1.8)
    ),
}


@pytest.mark.parametrize("thing", THIN)
def test_things_one_pixel_wide_are_found(thing):
    """A needle and a bubble as wide as a pixel, seen through a
    ball: the map knows of every pixel that they change.
    """
    pixels = 256
    ball = Glass("ball", icosphere(0.025, 4), ConstantIndex(1.49))
    # the ball magnifies its contents by about 1.5
    width = 0.05 / pixels * (1.0 if thing == "needle before" else 1 / 1.5)
    a_rig = rig((ball, THIN[thing](width / 2)), pixels=pixels)
    at, exact = dense(a_rig)
    _, without = dense(rig((ball,), pixels=pixels))
    is_changed = on_display(exact, a_rig) != on_display(without, a_rig)
    with np.errstate(invalid="ignore"):
        is_changed |= np.linalg.norm(exact - without, axis=1) > 1.0

    assert is_changed.sum() >= (1 if thing == "bubble" else 100)
    found = view_map(a_rig)
    got = found.display_from_view(at)
    mine = on_display(got, a_rig)
    theirs = on_display(exact, a_rig)
    is_right = mine == theirs
    both = mine & theirs
    is_right[both] = np.linalg.norm(got[both] - exact[both], axis=1) < 0.5
    if thing != "bubble":  # along a needle as thin as a pixel the map is a few samples
        is_right |= is_sampled(found, at)
        assert found.sample_area.sum() < 0.01 * pixels**2

    assert is_right[is_changed].mean() > 0.95


def agreement(a_rig, found, n=40_000):
    """IoU of the places that map and trace take to the display, at random."""
    at, exact = dense(a_rig, n)
    mine = on_display(found.display_from_view(at), a_rig)
    theirs = on_display(exact, a_rig)
    assert theirs.sum() > 0
    return (mine & theirs).sum() / (mine | theirs).sum()


def test_what_is_lost_in_cut_pixels_is_told():
    """A flat-shaded ball of 1280 facets: the part that no piece covers is small, and counted as
    unresolved.
    """
    a_rig = rig(icosphere(0.025, 3, smooth=False), pixels=128, display=0.2)
    found = view_map(a_rig)
    lost = 1 - agreement(a_rig, found)
    told = found.error.unresolved + found.error.facet_limited - found.error.noise
    assert told < 2 * lost + 0.01
    assert lost < told + found.error.noise
    assert lost < 0.02


def test_a_marble_between_the_first_nodes_is_found():
    """A ball of glass that few nodes meet, and from which none of them reaches the display."""
    marble = icosphere(0.0004, 3, centre=(0.0011, 0, 0.0013))
    a_rig = rig(marble, pixels=512)
    assert agreement(a_rig, view_map(a_rig), 2_000_000) > 0.9


@pytest.mark.parametrize("distance", [0.5, 3.0])
def test_a_strip_is_found_from_far_away(distance):
    """A mirror strip five pixels wide beside the glass, met
    by no node: found however far the viewer is.
    """
    pixels, field = 256, 0.05
    a_rig = rig(
        box([0.06, 0.03, 0.06]), pixels=pixels, field=field, display=0.2, viewer_distance=distance
    )
    strip = Mirror(
        "strip", rectangle((0.0033, -0.05, 0), (1, 0, 0), (0, 0, 1), 5 * field / pixels, 0.0031)
    )
    a_rig = replace(a_rig, mirrors=(strip,))
    at, exact = dense(a_rig, 200_000)
    _, without = dense(replace(a_rig, mirrors=()), 200_000)
    is_hidden = on_display(without, a_rig) & ~on_display(exact, a_rig)

    assert is_hidden.sum() > 50
    assert (on_display(view_map(a_rig).display_from_view(at), a_rig) == on_display(exact, a_rig))[
        is_hidden
    ].mean() > 0.95


def test_a_viewer_of_any_size_is_covered_whole():
    """Squares that stick out of the image are clipped: a
    slab fills views of odd sizes to the last pixel.
    """
    for w, h in ((1, 1), (3, 5), (33, 17), (130, 67)):
        a_rig = rig(box([0.3, 0.03, 0.3]), display=0.2)
        viewer = replace(a_rig.viewers[0], width=w, height=h)
        found = view_map(replace(a_rig, viewers=(viewer,)))
        np.testing.assert_allclose(coverage(found), 1, atol=1e-9)
        parts = [
            rasterise(found.display_size, found.view_size, v, d) for v, d, *_ in found.pieces()
        ]
        assert sum(p.area.sum() for p in parts) == pytest.approx(w * h, rel=1e-9)


def test_the_map_without_a_plate_in_reach_is_empty():
    """Nothing lands: no cells, no error, and the reason at every pixel's corner."""
    a_rig = rig(icosphere(0.025, 2), pixels=40)
    away = replace(
        a_rig.plates[0].mesh, vertices=a_rig.plates[0].mesh.vertices + np.array([5.0, 0, 0])
    )
    found = view_map(replace(a_rig, plates=(replace(a_rig.plates[0], mesh=away),)))
    assert not list(found.pieces())
    assert found.reason.shape == (41, 41)
    assert not (found.reason == Reason.ARRIVED).any()
    assert found.error.rms == 0
    assert np.isnan(found.display_from_view(np.array([[20.0, 20.0]]))).all()


@pytest.mark.parametrize(
    "a_rig",
    [rig(torus(0.018, 0.007), pixels=48), rig(icosphere(0.006, 3), pixels=48, field=0.015)],
    ids=["torus", "ball of 12 mm"],
)
def test_the_error_of_the_map_is_no_more_than_the_display_is_wide(a_rig):
    """Strong glass throws light a hundred displays wide: the
    error that is told is that of places on the image.
    """
    error = view_map(a_rig).error
    assert 0 < error.rms <= error.percentile <= np.hypot(512, 512)
    assert error.facet_limited + error.unresolved <= 1


@pytest.mark.parametrize("place", [0.0011, 0.0030, 0.0052])
def test_a_slit_between_two_blockers_is_found(place):
    """Both sides are dark, in ways that differ.

    It is some pixels wide, and between the rays that are first traced.
    """
    width = 0.0004
    sides = (
        rectangle(
            np.array([place + k * (0.1 + width / 2), -0.2, 0]), [1, 0, 0], [0, 0, 1], 0.2, 0.4
        )
        for k in (-1, 1)
    )
    a_rig = replace(
        cube_rig(pixels=256),
        blockers=tuple(Blocker(f"side {k}", mesh) for k, mesh in enumerate(sides)),
    )
    found = solve(a_rig)
    xy = np.random.default_rng(0).uniform(0, 256, (200_000, 2))
    landings = trace_all(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(xy))

    assert found.first.view_coverage.sum() == pytest.approx(
        256**2 * landings.has_arrived.mean(), rel=0.1
    )
