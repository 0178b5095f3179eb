"""The view map's cells: what they cover, where they are cut."""

import numpy as np
import pytest
from reference_rigs import ball_rig, box, cube_rig, icosphere, rig
from work import drain

from kiriko.core.plan import Settings, make_plan
from kiriko.core.rig import Glass, Mesh
from kiriko.core.shares import rasterise
from kiriko.core.trace import Reason
from kiriko.core.view_map import sample


def view_map(a_rig, **settings):
    return drain(sample(make_plan(a_rig, Settings(**settings))))


def areas(polygons):
    x, y = np.moveaxis(polygons, 2, 0)
    return 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)


def coverage(found):
    """Area (h, w) of the cells on each viewer pixel, by rasterising them onto the viewer's own image."""
    sizes = found.view_size, found.view_size
    parts = [rasterise(*sizes, view, view) for view, _, _ in found.pieces(at_pixels=True)]
    n = found.view_size[0] * found.view_size[1]
    return sum(np.bincount(s.display_index, s.display_area, n) for s in parts).reshape(found.view_size[::-1])


def turned_square(degrees, side=0.02):
    """A square rod along the view axis, turned about it: its silhouette crosses the pixels at an angle."""
    mesh = box([side, 0.02, side])
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    return Mesh(mesh.vertices @ turn.T, mesh.triangles)


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0])
def test_cut_cells_cover_the_silhouette_exactly(degrees):
    """Seen in parallel along the rod, the covered area is the square's, pixel by pixel as the square covers them."""
    a_rig = rig(turned_square(degrees), projection="orthographic", pixels=50, field=0.05, display=0.06)
    found = view_map(a_rig)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * 10
    a = np.radians(degrees)
    square = corners @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + 25
    exact = rasterise((50, 50), (50, 50), square[None], square[None])
    expected = np.bincount(exact.display_index, exact.display_area, 2500).reshape(50, 50)
    # a border is known to 2^-12 px on each edge; within a pixel it is straight, so a corner's pixel loses a little
    error = np.abs(coverage(found) - expected)
    assert np.sort(error.ravel())[-5] < 2e-3
    assert error.max() < 0.2
    assert abs(coverage(found).sum() - 400) < 0.8


def test_every_piece_has_the_same_orientation_and_none_is_empty():
    """Pieces of cut pixels are convex and wound as the pixels are: positive area each, at most 1 in a pixel."""
    found = view_map(cube_rig(pixels=128))
    for view, _, _ in found.pieces():
        assert (areas(view) > (-1e-12 if view.shape[1] == 3 else 0)).all()
    assert coverage(found).max() < 1 + 1e-9


def test_pieces_and_misses_make_up_the_image():
    """Where all corners of a pixel miss nothing is covered, where all arrive on one branch all of it is."""
    found = view_map(ball_rig(4, pixels=128))
    has_arrived = np.isin(found.reason, [Reason.ARRIVED, Reason.MISSED_DISPLAY])  # cells go on beyond the display
    corners = np.stack([has_arrived[:-1, :-1], has_arrived[:-1, 1:], has_arrived[1:, :-1], has_arrived[1:, 1:]])
    covered = coverage(found)
    assert covered[~corners.any(axis=0)].max() == 0
    assert covered[(found.reason == Reason.ARRIVED)[:-1, :-1] & corners.all(axis=0)].min() > 0.9


def test_a_saddle_pixel_is_not_covered_twice():
    """Two rods that meet at a corner inside a pixel: the pixel's coverage is their area, not their overlap's."""
    s = 0.02
    boxes = tuple(
        Glass(n, box([s, 0.02, s], (x * s / 2 + 3e-4, 0, x * s / 2 + 4e-4))) for n, x in (("a", -1), ("b", 1))
    )
    found = view_map(rig(boxes, projection="orthographic", pixels=50, field=0.05, display=0.06))
    covered = coverage(found)
    assert covered.max() < 1 + 1e-9
    assert abs(covered.sum() - 800) < 1.5  # eight corners of squares, each cut off within its pixel


def test_faceted_glass_is_cut_at_its_edges():
    """A flat-shaded ball maps each facet by its own prism: cells join no two facets, so they map affinely."""
    found = view_map(rig(icosphere(0.025, 1, smooth=False), pixels=64, display=0.2))
    n_inside = 0
    for _, q, _ in found.pieces(at_pixels=True):
        if q.shape[1] == 4:
            inside = (q > 0).all(axis=(1, 2)) & (q < 512).all(axis=(1, 2))
            bow = np.abs(q[:, 0] - q[:, 1] + q[:, 2] - q[:, 3]).max(axis=1)  # 0 for an affine map
            assert bow[inside].max(initial=0.0) < 0.05 * np.abs(q[:, 2] - q[:, 0]).max()
            n_inside += inside.sum()
    assert n_inside > 100
