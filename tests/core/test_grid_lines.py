"""Whether a mesh was laid out along smooth lines, and the faces
that *Automatic* trusts for it although they are coarse.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass.fitted_faces import tangent_planes
from kiriko.core.glass.grid_lines import line_steps
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.catmull_clark import limit_mesh, ring_cage
from known.judged_meshes import CHOICES, coarse, errors, sheared
from known.on_limits import vertices_and_edges
from known.reference_rigs import mean_normals, rig, smooth_mesh, split_quads, torus, uv_ellipsoid

MAJOR, MINOR = 0.020, 0.005  # m
RADII = (0.025, 0.020, 0.015)


def looked_at(mesh):
    """How far the vertices (v,) are off smooth lines, m, and how coarse these are."""
    v, _ = vertices_and_edges(mesh)
    size = tangent_planes(v).size
    lines = run_steps(line_steps(v, size))
    return lines.scatter * size, lines.phase


def scattered(mesh):
    return looked_at(mesh)[0]


def edge_of(mesh):
    """The mean length of its edges, m."""
    return np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()


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


def landings(mesh, surface, n=1500):
    """Where random rays through the viewer land (n, 2), display px, by a choice of surface."""
    a_rig = rig(replace(mesh, surface=surface), display=0.2, display_pixels=512)
    size = [a_rig.viewer.width, a_rig.viewer.height]
    rays = a_rig.viewer.rays(np.random.default_rng(3).uniform(0, size, (n, 2)))
    found = trace_all(compile_plan(a_rig, Settings()), *rays)
    xy = np.full((n, 2), np.nan)
    xy[found.sample] = found.xy
    return xy


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


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("segments", [12, 32])
def test_straight_lines_of_an_oval_tube_are_not_coarse(segments, dtype):
    """It is as coarse as the ellipse around it: of lines that do not bend rounding alone is left,
    in Blender's coordinates as well.
    """
    a = 2 * np.pi * np.arange(segments) / segments
    z = np.broadcast_to(np.linspace(-0.03, 0.03, 17)[:, None], (17, segments))
    places = np.stack([0.025 * np.cos(a) + 0 * z, 0.015 * np.sin(a) + 0 * z, z], axis=-1)
    out = np.stack([np.cos(a) / 0.025 + 0 * z, np.sin(a) / 0.015 + 0 * z, 0 * z], axis=-1)
    index = np.pad(np.arange(z.size).reshape(z.shape), ((0, 0), (0, 1)), mode="wrap")
    tube = smooth_mesh(
        places.reshape(-1, 3).astype(dtype).astype(float),
        split_quads(index)[:, ::-1],
        out.reshape(-1, 3),
    )
    _, phase = looked_at(tube)
    assert phase == pytest.approx((2 * np.sin(np.pi / segments)) ** 2, rel=1e-3)


@pytest.mark.filterwarnings("error")
def test_vertices_in_one_place_do_not_spoil_other_faces():
    """A triangle drawn to a point by three vertices, which are not joined, has no lines."""
    mesh = mean_normals(torus(MAJOR, MINOR, 12, 8))
    n = len(mesh.vertices)
    with_point = replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, np.full((3, 3), 0.1)]),
        triangles=np.concatenate([mesh.triangles, [[n, n + 1, n + 2]]]),
        corner_normals=np.concatenate([mesh.corner_normals, np.tile([0, 0, 1.0], (1, 3, 1))]),
        is_smooth=np.append(mesh.is_smooth, True),
    )
    surface = make_surface(replace(with_point, surface="automatic"))
    assert surface.n_curved == len(mesh.triangles)


def test_subdivided_glass_is_curved_where_its_patches_meet():
    """A ring by three levels of Subdivision, against the limit of its cage. Normals jump by up to
    two fifths of the gain at the edges between the patches of the spline that it is.
    """
    profile = [(12, -4), (20, -4), (28, -3), (28, 3), (20, 4), (12, 4)]
    cage = ring_cage(1e-3 * np.array(profile), 24)
    mesh = mean_normals(limit_mesh(cage, 3))
    assert curved_share(mesh) == 1

    exact = landings(limit_mesh(cage, 4), "smooth")
    drawn, automatic = (
        np.linalg.norm(landings(mesh, choice) - exact, axis=1) for choice in ("facets", "automatic")
    )
    known = np.isfinite(drawn + automatic)
    assert known.sum() > 500
    for share in (0.5, 0.9, 0.99):
        assert 50 * np.quantile(automatic[known], share) < np.quantile(drawn[known], share)


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
    edge = edge_of(mesh)
    assert curved_share(mean_normals(mesh)) == 1
    assert curved_share(moved(mesh, 0.15 * edge)) < 0.2
    assert curved_share(noisy(mesh, 0.15 * edge)) < 0.2


@pytest.mark.parametrize("by", [0.0, 2e-5])
def test_the_kernel_and_the_order_of_a_mesh_do_not_count(by):
    """The same faces are curved."""
    mesh = noisy(torus(0.018, 0.007, 16, 8), by)
    surface = make_surface(replace(mesh, surface="automatic"))
    with loading.off():
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


@pytest.mark.parametrize("radii", [(0.025,) * 3, (0.025, 0.025, 0.012), RADII])
@pytest.mark.parametrize("segments", [9, 13, 25])
def test_lines_run_straight_on_through_an_odd_pole(radii, segments):
    """All of an ellipsoid's are ellipses: no difference is more than the closed form on the coarser
    one, around or from pole to pole, whatever goes on between two edges; and all are as coarse.
    """
    rings = segments // 2
    off, phase = looked_at(uv_ellipsoid(radii, segments, rings))
    chords = [2 * np.sin(np.pi / n) for n in (segments, 2 * rings)]
    assert off.max() <= max(radii) * max(chords) ** 6 / np.sqrt(924) * (1 + 1e-9)
    assert phase[segments : -segments - 2] == pytest.approx(max(chords) ** 2, rel=1e-6)


@pytest.mark.parametrize(
    ("radii", "segments"), [(RADII, 9), (RADII, 13), (RADII, 15), ((0.025, 0.025, 0.012), 17)]
)
def test_ellipsoids_of_odd_segments_are_followed_as_curved(radii, segments):
    """Light lands where the closed form sends it more nearly than as drawn, and as by *Smooth*."""
    mesh = mean_normals(uv_ellipsoid(radii, segments, segments // 2))
    drawn, smooth, automatic = (
        landings(mesh, choice) for choice in ("facets", "smooth", "automatic")
    )
    assert np.array_equal(automatic, smooth, equal_nan=True)

    a_rig = rig(mesh, display=0.2, display_pixels=512)
    size = [a_rig.viewer.width, a_rig.viewer.height]
    rays = a_rig.viewer.rays(np.random.default_rng(3).uniform(0, size, (len(drawn), 2)))
    exact = closed_forms.landing(a_rig, *closed_forms.through_ellipsoid(*rays, radii, 1.49))
    off_drawn, off = (np.linalg.norm(xy - exact, axis=1) for xy in (drawn, automatic))
    known = np.isfinite(off_drawn + off)
    assert known.sum() > 300
    assert np.median(off[known]) < np.median(off_drawn[known])


def test_a_torus_whose_quads_are_sheared_is_followed_as_curved():
    """Its vertices are those of a torus that is, and lie on smooth lines aslant: a third as far off
    as drawn, and no further than Smooth.
    """
    mesh = sheared("torus", 24, 12)
    assert np.array_equal(mesh.vertices, coarse("torus", (24, 12)).vertices)
    drawn, smooth, automatic = (errors("torus", mesh, choice).rest for choice in CHOICES)
    assert automatic < drawn / 3
    assert automatic == smooth
