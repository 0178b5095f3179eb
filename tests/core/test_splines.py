"""Meshes of quads that lie on the surface that Subdivision goes towards, held to its limit."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass import surface_fit
from kiriko.core.glass.splines import find_quad_lines, spline_steps
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from known.catmull_clark import LATHE, lathe_cage, limit_mesh, ring_cage, uneven_profile
from known.on_limits import off_limit, vertices_and_edges
from known.reference_rigs import mean_normals, rig, split_quads, torus


def looked_for(mesh):
    """Its vertices, and where it lies on splines."""
    v, edges = vertices_and_edges(mesh)
    return v, run_steps(spline_steps(v, find_quad_lines(v, edges, mesh.polygon)))


def grid_mesh(places):
    """A mesh of quads with mean normals, of places (m, n, 3) that go round both ways."""
    m, n = places.shape[:2]
    index = np.pad(np.arange(m * n).reshape(m, n), ((0, 1), (0, 1)), mode="wrap")
    triangles = split_quads(index)
    nothing = np.zeros((len(triangles), 3, 3))
    mesh = Mesh(places.reshape(-1, 3), triangles, nothing, np.ones(len(triangles), bool))
    return replace(mean_normals(mesh), polygon=np.tile(np.arange(m * n), 2))


def bumpy_torus(n, period, high):
    """A torus whose tube is thicker and thinner in waves of so many edges each way."""
    a = 2 * np.pi * np.arange(n) / n
    wave = np.sin(2 * np.pi * np.arange(n) / period)
    tube = 0.007 * (1 + high * wave[:, None] * wave)
    far = 0.018 + tube * np.cos(a)[:, None]
    high = tube * np.sin(a)[:, None] + 0 * far
    return grid_mesh(np.stack([far * np.cos(a), high, far * np.sin(a)], axis=-1))


@pytest.mark.parametrize(("dtype", "off"), [(np.float64, 1e-12), (np.float32, 5e-6)])
@pytest.mark.parametrize(("points", "level"), [(3, 1), (4, 1), (7, 1), (4, 2), (6, 3)])
def test_normals_of_subdivided_rings_are_those_of_the_limit(points, level, dtype, off):
    """At all vertices, to rounding. After three levels many vertices are nearer to any spline than
    Blender rounds, and off by as little.
    """
    limit = limit_mesh(ring_cage(uneven_profile(0, points), 24), level)
    rounded = replace(limit, vertices=limit.vertices.astype(dtype).astype(float))
    v, splines = looked_for(mean_normals(rounded))
    exact = np.empty_like(v.normal)
    exact[v.of_corner] = limit.corner_normals
    assert splines.is_face.all()
    assert np.abs(splines.normal - exact).max() < (5e-6 if level == 3 else off)


@pytest.mark.parametrize("seed", range(3))
def test_faces_go_through_places_of_the_finer_limit_with_its_normals(seed):
    """Their nodes are a quarter of an edge apart, where two more levels have vertices."""
    cage = ring_cage(uneven_profile(seed, 4), 6)
    mesh, finer = (limit_mesh(cage, level) for level in (1, 3))
    _, splines = looked_for(mean_normals(mesh))
    off, turned = off_limit(*splines.faces(np.arange(len(mesh.triangles))), finer)
    assert off < 1e-14
    assert turned < 1e-12


@pytest.mark.parametrize(("points", "seed"), [(4, 0), (5, 2), (6, 1), (8, 1)])
def test_rings_of_one_level_land_light_where_their_limit_does(points, seed):
    """More than fifty times nearer than as drawn, at half of the rays and at nine in ten; the judge
    has four levels and its own normals over facets.
    """
    cage = ring_cage(uneven_profile(seed, points), 24)
    mesh, exact = mean_normals(limit_mesh(cage, 1)), limit_mesh(cage, 4)
    viewer = rig(mesh, display=0.2, display_pixels=512).viewer
    size = [viewer.width, viewer.height]
    rays = viewer.rays(np.random.default_rng(3).uniform(0, size, (1500, 2)))

    def landings(mesh, surface):
        a_rig = rig(replace(mesh, surface=surface), display=0.2, display_pixels=512)
        found = trace_all(compile_plan(a_rig, Settings()), *rays)
        xy = np.full((1500, 2), np.nan)
        xy[found.sample] = found.xy
        return xy

    judge = landings(exact, "facets")
    drawn, automatic = (
        np.linalg.norm(landings(mesh, surface) - judge, axis=1)
        for surface in ("facets", "automatic")
    )
    known = np.isfinite(drawn + automatic)
    assert known.sum() > 200
    for share in (0.5, 0.9):
        assert 50 * np.quantile(automatic[known], share) < np.quantile(drawn[known], share)


@pytest.mark.parametrize("n", [16, 75, 128, 256])
def test_fine_smooth_surfaces_are_no_splines(n):
    """Whose lines are nearer to any spline than vertices are rounded, too, from 75 edges around."""
    mesh = mean_normals(torus(0.018, 0.007, n, n))
    quads = replace(mesh, polygon=np.tile(np.arange(n * n), 2))
    assert looked_for(quads)[1] is None
    assert make_surface(quads).n_curved == make_surface(mesh).n_curved


@pytest.mark.parametrize("period", [6, 8, 12, 16])
def test_waves_are_no_splines(period):
    """Seven places around the middle of a slope are the same there as on a spline."""
    assert looked_for(bumpy_torus(96, period, 0.1))[1] is None


@pytest.mark.parametrize("by", [1e-4, 1e-3, 1e-2])
def test_noise_is_on_no_spline(by):
    """From 1e-4 of an edge on."""
    mesh = limit_mesh(ring_cage(uneven_profile(1, 6), 24), 2)
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    away = np.random.default_rng(4).normal(size=mesh.vertices.shape)
    assert (
        looked_for(mean_normals(replace(mesh, vertices=mesh.vertices + by * edge * away)))[1]
        is None
    )


@pytest.mark.parametrize("level", [1, 2])
def test_around_poles_nothing_is_taken_for_splines(level):
    """Faces that touch a vertex of more or fewer than four quads are none; all that are lie on the
    limit.
    """
    mesh = limit_mesh(lathe_cage(LATHE, 12), level)
    v, splines = looked_for(mean_normals(mesh))
    exact = np.empty_like(v.normal)
    exact[v.of_corner] = mesh.corner_normals
    known = np.isfinite(splines.normal[:, 0])
    assert 0.3 < splines.is_face.mean() < 0.9
    assert np.abs(splines.normal - exact)[known].max() < 1e-12

    # each quad is split into (a, b, c) and (a, c, d)
    corners = np.concatenate([mesh.triangles[0::2].ravel(), mesh.triangles[1::2, 2]])
    is_regular = np.bincount(corners) == 4
    assert is_regular[mesh.triangles[splines.is_face]].all()


def test_meshes_of_triangles_pay_nothing(monkeypatch):
    """Without polygons nothing is looked for."""
    mesh = replace(mean_normals(torus(0.018, 0.007, 16, 8)), surface="automatic")
    monkeypatch.setattr(surface_fit, "exact_limit_steps", lambda *_: pytest.fail("looked for"))
    assert make_surface(mesh).n_curved == len(mesh.triangles)
