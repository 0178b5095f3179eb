"""Whether a mesh was laid out along smooth lines, and the faces
that *Automatic* trusts for it although they are coarse.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core import kernel
from kiriko.core.glass.grid_lines import look_along_lines
from kiriko.core.glass.meshes import find_edges, find_joined
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.glass.vertex_fields import tangent_planes
from kiriko.core.glass.vertices import find_vertices
from kiriko.core.steps import finish
from known.reference_rigs import mean_normals, torus, uv_ellipsoid

MAJOR, MINOR = 0.020, 0.005  # m
RADII = (0.025, 0.020, 0.015)


def looked_at(mesh):
    """How far the vertices (v,) are off smooth lines, m, and how coarse these are."""
    edges = find_edges(mesh.triangles)
    usable = np.ones(len(mesh.triangles), bool)
    joined = find_joined(mesh.corner_normals, edges)
    v = find_vertices(mesh.vertices, mesh.triangles, mesh.corner_normals, usable, edges, joined)
    size = tangent_planes(v).size
    lines = finish(look_along_lines(v, size))
    return lines.scatter * size, lines.phase


def scattered(mesh):
    return looked_at(mesh)[0]


def moved(mesh, by):
    """The mesh with vertices moved at random by so many m rms each way; mean normals."""
    away = np.random.default_rng(4).normal(size=mesh.vertices.shape)
    return mean_normals(replace(mesh, vertices=mesh.vertices + by * away))


def noisy(mesh, by):
    """The mesh with vertices moved out and in at random by so many m rms; mean normals."""
    normals = np.empty_like(mesh.vertices)
    normals[mesh.triangles] = mesh.corner_normals
    away = np.random.default_rng(4).normal(size=(len(normals), 1)) * normals
    return mean_normals(replace(mesh, vertices=mesh.vertices + by * away))


def curved_share(mesh):
    return make_surface(replace(mesh, surface="automatic")).n_curved / len(mesh.triangles)


@pytest.mark.parametrize(("segments", "rings"), [(48, 12), (32, 8), (64, 16)])
def test_vertices_of_a_torus_are_off_by_the_difference_of_a_circle(segments, rings):
    """The closed form of the sixth difference on a circle, around
    the tube: that around the torus is less, those across are more.
    """
    by_circle = MINOR * (2 * np.sin(np.pi / rings)) ** 6 / np.sqrt(924)
    assert scattered(torus(MAJOR, MINOR, segments, rings)) == pytest.approx(by_circle, rel=1e-9)


@pytest.mark.parametrize("radii", [(0.025,) * 3, (0.025, 0.025, 0.012), RADII])
@pytest.mark.parametrize(("segments", "rings"), [(16, 8), (24, 10), (12, 16)])
def test_lines_of_an_ellipsoid_are_as_coarse_as_those_of_a_ball(radii, segments, rings):
    """The closed form of the differences on a circle, around or from pole to pole."""
    by_circle = max((2 * np.sin(np.pi / n)) ** 2 for n in (segments, 2 * rings))
    _, phase = looked_at(uv_ellipsoid(radii, segments, rings))
    assert phase[segments : -segments - 2] == pytest.approx(by_circle, rel=1e-6)


def test_vertices_off_their_place_are_off_by_about_as_much():
    """Out of a smooth surface or along it: of a mesh so fine that its own curve is nothing."""
    fine = torus(MAJOR, MINOR, 256, 64)
    assert scattered(fine).max() < 1e-7
    for shift in (moved, noisy):
        assert 0.5e-5 < np.median(scattered(shift(fine, 1e-5))) < 2e-5


@pytest.mark.parametrize(
    "mesh",
    [
        torus(0.018, 0.007, 16, 8),
        uv_ellipsoid(RADII, 10, 5),
        uv_ellipsoid((0.025, 0.025, 0.012), 16, 8),
        torus(MAJOR, MINOR, 32, 8),
    ],
    ids=["torus", "ellipsoid", "lentil", "Blender's torus"],
)
def test_a_coarse_regular_mesh_is_curved_and_not_when_its_vertices_are_off(mesh):
    """By a seventh of an edge along the surface, or off it."""
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    assert curved_share(mean_normals(mesh)) == 1
    assert curved_share(moved(mesh, 0.15 * edge)) < 0.2
    assert curved_share(noisy(mesh, 0.15 * edge)) < 0.2


@pytest.mark.parametrize("by", [0.0, 2e-5])
def test_the_kernel_and_the_order_of_a_mesh_do_not_count(by):
    """The same faces are curved."""
    mesh = noisy(torus(0.018, 0.007, 16, 8), by)
    surface = make_surface(replace(mesh, surface="automatic"))
    with kernel.off():
        plainly = make_surface(replace(mesh, surface="automatic"))

    random = np.random.default_rng(2)
    of_triangle = random.permutation(len(mesh.triangles))
    of_vertex = random.permutation(len(mesh.vertices))
    shuffled = replace(
        mesh,
        vertices=mesh.vertices[of_vertex],
        triangles=np.argsort(of_vertex)[mesh.triangles][of_triangle],
        corner_normals=mesh.corner_normals[of_triangle],
        is_smooth=mesh.is_smooth[of_triangle],
        surface="automatic",
    )
    assert surface.n_curved > 0
    assert np.array_equal(surface.is_bent, plainly.is_bent)
    assert np.array_equal(surface.is_bent[of_triangle], make_surface(shuffled).is_bent)
