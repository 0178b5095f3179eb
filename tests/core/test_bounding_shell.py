"""The hull in front of curved faces: without a gap, and as fine as faces turn."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass.bounding_shell import SHELL, bounding_shell_steps, edge_turns
from kiriko.core.glass.meshes import areas_of
from kiriko.core.glass.surfaces import make_surface
from known.catmull_clark import LATHE, lathe_cage, limit_mesh
from known.reference_rigs import icosphere, torus, uv_ellipsoid, wavy_slab

# closed, curved all over, and turning by more in one direction than in the other
BODIES = {
    "torus": torus(0.018, 0.003, 64, 8),
    "flat ellipsoid": uv_ellipsoid((0.025, 0.004, 0.015), 40, 12),
    "coarse ball": icosphere(0.025, 1),
    "lathe": limit_mesh(lathe_cage(LATHE, 12), 1),
}


def hull_of(mesh):
    curved = make_surface(mesh).curved
    return curved, run_steps(bounding_shell_steps(curved))


def cross_2d(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@pytest.mark.parametrize("name", BODIES)
def test_a_hull_has_no_gap_and_no_edge_that_meets_another_half_way(name):
    """Each edge of a part is that of one other, which runs the other way."""
    curved, hull = hull_of(BODIES[name])
    assert len(curved.triangle) == len(BODIES[name].triangles)
    n_parts = np.bincount(hull.triangle)
    assert n_parts.max() > n_parts.min() or name == "coarse ball"
    assert n_parts.max() > 4

    points = np.round(hull.corners.reshape(-1, 3) / 1e-8).astype(np.int64)
    number = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1, 3)
    start, end = number, np.roll(number, -1, axis=1)
    n = number.max() + 1
    there, back = (start * n + end).ravel(), (end * n + start).ravel()
    assert len(np.unique(there)) == len(there)
    assert np.array_equal(np.sort(there), np.sort(back))


@pytest.mark.parametrize("name", [*BODIES, "slab"])
def test_parts_are_the_whole_of_each_face(name):
    """Their areas in u, v, none of which is turned over, add up; so are
    their corners where u, v tell, but for the way that they are lifted.
    """
    mesh = BODIES.get(name) or wavy_slab()
    curved, hull = hull_of(mesh)
    a, b, c = hull.places.astype(float).swapaxes(0, 1)
    areas = cross_2d(b - a, c - a) / 2
    assert (areas > 0).all()
    whole = np.bincount(hull.triangle, areas)[curved.triangle]
    assert np.array_equal(whole, np.full(len(whole), 0.5))

    u, v = hull.places.astype(float).reshape(-1, 2).T
    triangle = np.repeat(hull.triangle, 3)
    on_face = curved.points(triangle, u, v)
    lifted = np.linalg.norm(hull.corners.reshape(-1, 3) - on_face, axis=1)
    assert lifted.max() < 0.1 * np.sqrt(areas_of(curved.corners).max())

    # on straight edges they are where these are
    distances = np.stack([v, 1 - u - v, u], axis=1)
    is_straight = (distances == 0) & (curved.neighbour[curved.row[triangle]] < 0)
    is_held = is_straight.any(axis=1)
    assert is_held.any() == (name == "slab")
    assert (lifted[is_held] < 1e-15).all()
    assert (lifted > 0).any()


def test_edges_are_halved_no_more_often_than_their_turn_needs():
    """A tube that turns by 11 degrees from face to face around, and by 2 along,
    is cut into strips across: fewer than the 16 of edges in four parts each.
    """
    curved, hull = hull_of(torus(0.018, 0.003, 180, 32))
    turns = np.sort(np.degrees(edge_turns(curved)), axis=1)
    assert turns[:, 0].max() < 3 < 6 < turns[:, 1].min() < turns.max() < 12
    assert set(np.bincount(hull.triangle).tolist()) == {7, 9}


def test_a_ball_of_many_faces_has_a_part_for_each():
    curved, hull = hull_of(icosphere(0.025, 5))
    assert edge_turns(curved).max() < SHELL.angle
    assert np.array_equal(np.sort(hull.triangle), curved.triangle)


def test_a_face_that_bulges_between_straight_edges_is_cut_inside():
    """Two of its edges do not turn, but the ways across it do: no more than a
    fifth of the bulge stands out of the hull, or lies behind it.
    """
    ball = icosphere(0.025, 1)
    is_smooth = np.arange(len(ball.triangles)) % 3 > 0
    curved, hull = hull_of(replace(ball, is_smooth=is_smooth))
    is_held = (curved.neighbour < 0).sum(axis=1) == 2
    assert is_held.any()
    triangle = curved.triangle[is_held]

    some = np.isin(hull.triangle, triangle)
    places, corners = hull.places[some].astype(float).mean(axis=1), hull.corners[some].mean(axis=1)
    on_face = curved.points(hull.triangle[some], *places.T)
    flat = np.einsum(
        "nk,nkc->nc",
        np.column_stack([1 - places.sum(axis=1), places]),
        curved.corners[hull.triangle[some]],
    )
    bulge = np.linalg.norm(on_face - flat, axis=1).max()
    assert np.linalg.norm(on_face - corners, axis=1).max() < 0.2 * bulge
