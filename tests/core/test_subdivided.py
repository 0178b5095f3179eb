"""Subdivided meshes with poles, held to the limit of their cage."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass import subdivided
from kiriko.core.glass.quartics import AT_NODES
from kiriko.core.glass.subdivided import exact_limit_steps
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh
from known.catmull_clark import LATHE, Cage, lathe_cage, limit_mesh, ring_cage
from known.on_limits import off_limit, vertices_and_edges
from known.reference_rigs import mean_normals


def looked_for(mesh):
    """Its vertices, and where it is known."""
    v, edges = vertices_and_edges(mesh)
    usable = np.ones(len(mesh.triangles), bool)
    return v, run_steps(exact_limit_steps(v, edges, mesh.polygon, usable))


def cube_cage():
    """A cube of 30 mm, uneven, whose corners are all of three quads."""
    corners = 0.015 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    corners[7] *= 1.4
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Cage.of(corners, np.full(6, 4), np.ravel(quads))


def quad_sphere(n):
    """The faces of a cube of n x n quads each, put onto a ball; mean normals."""
    cage = cube_cage()
    cage = replace(cage, vertices=np.sign(cage.vertices))
    mesh = limit_mesh(cage, n)
    places = 0.02 * mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return mean_normals(replace(mesh, vertices=places))


CAGES = {
    "lathe of 12": lathe_cage(LATHE, 12),
    "lathe of 24": lathe_cage(LATHE, 24),
    "cube": cube_cage(),
}
by_cage = pytest.mark.parametrize("name", CAGES)


@pytest.mark.parametrize(("dtype", "off"), [(np.float64, 1e-11), (np.float32, 1e-4)])
@pytest.mark.parametrize("level", [1, 2])
@by_cage
def test_normals_are_those_of_the_limit(name, level, dtype, off):
    """At all vertices near poles, and at these; in Blender's coordinates as well."""
    limit = limit_mesh(CAGES[name], level)
    rounded = replace(limit, vertices=limit.vertices.astype(dtype).astype(float))
    v, known = looked_for(mean_normals(rounded))
    exact = np.empty_like(v.normal)
    exact[v.of_corner] = limit.corner_normals
    assert known.is_face.mean() > 0.9
    assert (known.rank == 1).any()
    assert np.nanmax(np.abs(known.normal - exact)) < off


@by_cage
def test_faces_go_through_places_of_the_finer_limit_with_its_normals(name):
    """Their nodes are a quarter of an edge apart, where two more levels have vertices."""
    mesh, finer = (limit_mesh(CAGES[name], level) for level in (1, 3))
    _, known = looked_for(mean_normals(mesh))
    some = np.flatnonzero(known.rank == 1)[::7]
    off, turned = off_limit(*known.faces(some), finer)
    assert off < 1e-13
    assert turned < 1e-10


@pytest.mark.parametrize("by", [1e-4, 1e-3])
@by_cage
def test_noise_is_not_taken_for_it(name, by):
    """From 1e-4 of an edge on."""
    mesh = limit_mesh(CAGES[name], 2)
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    away = by * edge * np.random.default_rng(4).normal(size=mesh.vertices.shape)
    assert looked_for(mean_normals(replace(mesh, vertices=mesh.vertices + away)))[1] is None


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_a_ball_of_quads_is_none(n):
    """Fine and smooth, with corners of three quads each, and on the limit of no cage."""
    assert looked_for(quad_sphere(n))[1] is None


@pytest.mark.parametrize("place", [3, 200])
def test_neighbours_meet_whoever_knows_them(place):
    """Along edges between faces on splines, near poles and fitted ones, which are all there where
    one vertex is off its place.
    """
    mesh = limit_mesh(lathe_cage(LATHE, 16), 2)
    vertices = mesh.vertices.copy()
    vertices[mesh.triangles[place, 0]] *= 1.002
    mesh = replace(mean_normals(replace(mesh, vertices=vertices)), surface="automatic")
    _, known = looked_for(mesh)
    assert set(known.rank) >= {0, 2}
    curved = make_surface(mesh).curved
    offsets = np.matmul(AT_NODES, curved.coefficients)
    n_met = 0
    for edge in range(3):
        here = np.flatnonzero(curved.neighbour[:, edge] >= 0)
        there = curved.row[curved.neighbour[here, edge]]
        first = 3 * curved.neighbour_edge[here, edge].astype(int)
        mine = offsets[here, 3 * edge : 3 * edge + 3]
        theirs = offsets[there[:, None], first[:, None] + [2, 1, 0]]
        assert np.abs(mine - theirs).max() < 1e-14
        n_met += len(here)
    assert n_met > len(mesh.triangles)


def test_the_kernel_and_the_order_of_faces_do_not_count():
    """The same faces are curved, the same way, where some are known and others are not."""
    mesh = limit_mesh(lathe_cage(LATHE, 12), 2)
    vertices = mesh.vertices.copy()
    vertices[mesh.triangles[200, 0]] *= 1.01
    mesh = replace(mean_normals(replace(mesh, vertices=vertices)), surface="automatic")
    surface = make_surface(mesh)
    with loading.off():
        plainly = make_surface(mesh)

    random = np.random.default_rng(2)
    order = random.permutation(len(mesh.triangles))
    corner = (np.arange(3) + random.integers(0, 3, len(order))[:, None]) % 3
    shuffled = make_surface(
        replace(
            mesh,
            triangles=np.take_along_axis(mesh.triangles[order], corner, axis=1),
            corner_normals=np.take_along_axis(
                mesh.corner_normals[order], corner[..., None], axis=1
            ),
            polygon=mesh.polygon[order],
        )
    )
    is_curved = surface.curved.row >= 0
    assert np.array_equal(is_curved, plainly.curved.row >= 0)
    assert np.array_equal(is_curved[order], shuffled.curved.row >= 0)
    assert np.abs(surface.curved.coefficients - plainly.curved.coefficients).max() < 1e-12


def test_a_ring_needs_no_more_than_splines():
    """It has no poles."""
    profile = 1e-3 * np.array([(12, -4), (20, -4), (28, -3), (28, 3), (20, 4), (12, 4)])
    mesh: Mesh = mean_normals(limit_mesh(ring_cage(profile, 12), 1))
    assert (looked_for(mesh)[1].rank == 2).all()


def test_a_large_mesh_is_judged_as_any_other(monkeypatch):
    mesh = mean_normals(limit_mesh(lathe_cage(LATHE, 12), 1))
    monkeypatch.setattr(subdivided, "MOST_TRIANGLES", len(mesh.triangles))
    assert looked_for(mesh)[1] is not None
    monkeypatch.setattr(subdivided, "MOST_TRIANGLES", len(mesh.triangles) - 1)
    assert looked_for(mesh)[1] is None


def test_triangles_that_have_a_vertex_twice_do_no_harm():
    """They are beside themselves, and no halves of quads."""
    mesh = mean_normals(limit_mesh(lathe_cage(LATHE, 12), 1))
    dice = np.random.default_rng(0)
    n = len(mesh.triangles)
    for _ in range(20):
        order, first = dice.permutation(n), dice.integers(3, size=n)
        triangles = mesh.triangles[order[:, None], (first[:, None] + np.arange(3)) % 3]
        twice = dice.integers(n, size=40)
        triangles[twice, 1] = triangles[twice, 0]
        _, known = looked_for(replace(mesh, triangles=triangles, polygon=mesh.polygon[order]))
        assert known is None or not known.is_face[twice].any()
