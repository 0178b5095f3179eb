"""The judge of subdivided glass: the limit of a cage does not depend on how often it is divided
first, and is a B-spline where the cage is a grid.
"""

import numpy as np
import pytest

from known.catmull_clark import Cage, divided, limit, limit_mesh
from known.reference_rigs import lathed


def torus_cage(n=12, m=7):
    """A grid of quads around a ring, (n, m, 3)."""
    a, b = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    radius = 3 + np.cos(b) + 0.2 * np.sin(3 * a)
    grid = np.stack([radius * np.cos(a), radius * np.sin(a), np.sin(b)], axis=-1)
    index = np.arange(n * m).reshape(n, m)
    on, up = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    quads = np.stack([index, on, np.roll(on, -1, axis=1), up], axis=-1)
    return grid, Cage.of(grid.reshape(-1, 3), np.full(n * m, 4), quads.ravel())


def lathe_cage(segments=8):
    """Triangles around the poles of a turned body, and triangles between."""
    mesh = lathed(np.array([0, 0.5, 0.9, 0.4, 0]), np.array([-1, -0.8, 0, 0.9, 1.0]), segments)
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    return Cage.of(mesh.vertices[used], np.full(len(mesh.triangles), 3), triangles.ravel())


def test_the_limit_of_a_grid_is_its_spline():
    grid, cage = torus_cage()
    expected = grid
    for axis in (0, 1):
        beside = np.roll(expected, 1, axis=axis) + np.roll(expected, -1, axis=axis)
        expected = (4 * expected + beside) / 6
    slopes = []
    for along, across in ((0, 1), (1, 0)):
        slope = np.roll(grid, -1, axis=along) - np.roll(grid, 1, axis=along)
        beside = np.roll(slope, 1, axis=across) + np.roll(slope, -1, axis=across)
        slopes.append(4 * slope + beside)
    normals = np.cross(*slopes)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)

    places, found = limit(cage)
    assert places == pytest.approx(expected.reshape(-1, 3), abs=1e-14)
    assert found == pytest.approx(normals.reshape(-1, 3), abs=1e-14)


@pytest.mark.parametrize("cage", [torus_cage()[1], lathe_cage()], ids=["torus", "lathe"])
def test_the_limit_is_the_same_however_often_the_cage_is_divided(cage):
    """At vertices of three, four, eight and other faces."""
    once = divided(cage)
    places, normals = limit(once)
    more, same = limit(divided(once))
    n = len(once.vertices)
    assert more[:n] == pytest.approx(places, abs=1e-14)
    assert same[:n] == pytest.approx(normals, abs=1e-12)


def test_facets_of_the_limit_turn_towards_its_normals():
    """By half the edge each time, and look outwards."""
    turns = []
    for levels in (3, 4):
        corners = limit_mesh(lathe_cage(), levels).corners
        normals = limit_mesh(lathe_cage(), levels).corner_normals
        facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facets /= np.linalg.norm(facets, axis=1, keepdims=True)
        turns.append(np.arccos((facets[:, None] * normals).sum(axis=2).clip(-1, 1)).mean())
    assert turns[1] == pytest.approx(turns[0] / 2, rel=0.1)
