"""Normals next to sharp rims and open boundaries, where Blender's means are those of the last
faces alone: half a face off.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass.meshes import find_edges, find_joined, geometric_normals
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.glass.vertices import find_vertices, with_second_ring
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.tessellation import tessellation
from known.closed_forms import unit
from known.lathes import APERTURE, lathe, lens, lens_normals
from known.reference_rigs import icosphere, mean_normals, rig

HIGH = 0.03  # m, of a cone of which half is cut off


def arc(start, stop, steps, radius=APERTURE):
    """Radii and heights on a ball around the origin, between angles from its top, rad."""
    angle = np.linspace(start, stop, steps + 1)
    out = np.sin(angle)
    out[np.abs(out) < 1e-9] = 0
    return radius * np.stack([out, np.cos(angle)], axis=1)


def bowl():
    """Half a ball, hollow, with a flat rim; the inner one faces inwards."""
    outer = arc(np.pi, np.pi / 2, 16)
    inner = arc(np.pi / 2, np.pi, 16, radius=0.019)
    return lathe([outer, [outer[-1], inner[0]], inner], 96)


def open_bowl():
    """Half a ball that encloses nothing."""
    return lathe([arc(np.pi, np.pi / 2, 16)], 96)


def cut_ball():
    """A UV sphere of 16 rings, cut by a plane within a ring."""
    cut = arc(0, np.arccos(-0.25), 1)[1:]
    return lathe([[*[(0, cut[0, 1])], cut[0]], [*cut, *arc(0, np.pi, 16)[9::-1]]], 96)


def ball_normals(places, given):
    """Away from the middle, or towards it, as those that are given."""
    return unit(places) * np.sign((places * given).sum(axis=1, keepdims=True))


def asphere():
    """A dome of fourth degree on a flat disk."""
    radius = np.linspace(APERTURE, 0, 17)
    height = 8 * (APERTURE**2 - radius**2) + 12000 * (APERTURE**4 - radius**4)
    return lathe([[(0, 0), (APERTURE, 0)], np.stack([radius, height], axis=1)], 96)


def asphere_normals(places, given):
    squared = (places**2 * [1, 0, 1]).sum(axis=1, keepdims=True)
    return unit(places * [1, 0, 1] * (16 + 48000 * squared) + [0, 1, 0])


def frustum():
    """A cone without its top, of four long rows."""
    part = np.linspace(0, 0.5, 5)
    side = np.stack([APERTURE * (1 - part), HIGH * part], axis=1)
    return lathe([[(0, 0), side[0]], side, [side[-1], (0, HIGH / 2)]], 64)


def cone_normals(places, given):
    return unit(unit(places * [1, 0, 1]) * HIGH + [0, APERTURE, 0])


BODIES = {
    "lens": (lens, lens_normals),
    "asphere": (asphere, asphere_normals),
    "bowl": (bowl, ball_normals),
    "open bowl": (open_bowl, ball_normals),
    "cut ball": (cut_ball, ball_normals),
    "frustum": (frustum, cone_normals),
}


def found_normals(mesh):
    """At the corners of curved faces (p, 3, 3): places, normals, and the means that are given."""
    curved = make_surface(mesh).curved
    faces = curved.triangle
    return mesh.corners[faces], curved.vertex_normal[curved.vertex], mesh.corner_normals[faces]


@pytest.mark.parametrize("name", BODIES)
def test_normals_at_rims_are_found_as_inner_ones_are(name):
    """They are off by a fiftieth of what they turn by over a face at the most, where the means are
    by a seventh to a half of it. Those of the frustum, whose means are right, stay so.
    """
    make, own_normals = BODIES[name]
    places, normals, given = found_normals(make())
    own = own_normals(*(x.reshape(-1, 3) for x in (places, given))).reshape(places.shape)
    turn = np.linalg.norm(own - np.roll(own, 1, axis=1), axis=2).max()
    off, off_by_means = (np.linalg.norm(x - own, axis=2).max() for x in (normals, given))
    assert off < 0.02 * turn
    assert (off_by_means > 0.15 * turn) != (name == "frustum")


def test_the_kernel_finds_the_same_normals():
    """As numpy does, to rounding."""
    _, normals, _ = found_normals(asphere())
    with loading.off():
        _, others, _ = found_normals(asphere())
    assert np.abs(normals - others).max() < 1e-12


def landings(mesh, rays):
    """Where rays land, by number, through the lens 2 cm before the picture's place."""
    mesh = replace(mesh, vertices=mesh.vertices - [0, 0.02, 0])
    plan = compile_plan(rig(mesh, display=0.1, display_pixels=1024), Settings())
    found = trace_all(plan, *rays)
    return plan, found.sample[found.has_arrived], found.xy[found.has_arrived]


def apart(mesh, through):
    """Plan of a mesh of the lens, and how far light through places (n, 3) lands, px, from that by a
    mesh eight times finer, which is given the lens's own normals.
    """
    eye = np.array([0, -1.0, 0])
    rays = np.tile(eye, (len(through), 1)), unit(through - eye)
    finer = lens(768, 128)
    places, given = (x.reshape(-1, 3) for x in (finer.corners, finer.corner_normals))
    own = lens_normals(places, given).reshape(finer.corners.shape)
    finer = replace(finer, corner_normals=own, has_mean_normals=False)

    plan, a, landed = landings(mesh, rays)
    _, b, meant = landings(finer, rays)
    _, i, j = np.intersect1d(a, b, return_indices=True)
    assert len(i) > 0.95 * len(through)
    return plan, np.linalg.norm(landed[i] - meant[j], axis=1)


def test_the_last_ring_lands_light_as_a_finer_mesh_does():
    """Within 0.1 display px for 95 % of it, where means cost 6."""
    radius = APERTURE * (1 - 1 / 16 * np.linspace(0.01, 0.99, 40))
    turn = np.linspace(0, 2 * np.pi, 50, endpoint=False) + 0.01
    radius, turn = (x.ravel() for x in np.meshgrid(radius, turn))
    through = np.stack([radius * np.cos(turn), 0 * turn - 0.02, radius * np.sin(turn)], axis=1)
    _, off = apart(lens(), through)
    assert np.quantile(off, 0.95) < 0.1


@pytest.mark.parametrize("surface", ["smooth", "facets"])
def test_the_error_of_rims_is_told(surface):
    """Within a factor of 3 of the rms against the lens's own surface, as curved faces and as
    drawn, where it is a hundred times as much.
    """
    around = np.linspace(-APERTURE, APERTURE, 102)[1:-1]
    through = np.stack(np.meshgrid(around, [-0.02], around), axis=-1).reshape(-1, 3)
    through = through[np.hypot(through[:, 0], through[:, 2]) < APERTURE]
    plan, off = apart(replace(lens(), surface=surface), through)
    true = np.sqrt((off**2).mean())
    told = run_steps(tessellation(plan)).error
    assert true / 3 < told < 3 * true
    assert (told > 0.5) == (surface == "facets")


def vertices_of(mesh):
    """The vertices of a mesh that is smooth all over."""
    facets = geometric_normals(mesh.corners)
    edges = find_edges(mesh.triangles)
    is_joined = find_joined(mesh.corner_normals, edges)
    is_usable = np.einsum("tij,tj->ti", mesh.corner_normals, facets) > 0
    return find_vertices(
        mesh.vertices, mesh.triangles, mesh.corner_normals, is_usable, edges, is_joined
    )


def test_closed_bodies_have_no_rim():
    """All is as if rims were not looked for."""
    v = vertices_of(mean_normals(icosphere(0.025, 2)))
    assert with_second_ring(v) is v


def test_one_row_of_faces_has_no_rim():
    """The side of a cylinder tells nothing of how it turns along it, nor do faces around one tip
    tell a dome from a cone.
    """
    side = [(APERTURE, -HIGH), (APERTURE, HIGH)]
    tip = [(APERTURE, 0), (0, HIGH / 3)]
    for profile in (side, tip):
        v = vertices_of(lathe([profile], 32))
        across = with_second_ring(v)
        assert not across.rim.any()
        assert np.array_equal(across.end, v.end)


def test_the_end_of_a_sharp_edge_is_at_no_rim():
    """Faces are all around it; the other vertices of the edge are at one from both sides."""
    mesh = mean_normals(icosphere(0.025, 3))
    v = vertices_of(mesh)
    first, second = int(v.end[v.first[0]]), 0
    onward = next(
        int(k)
        for k in v.end[v.first[first] : v.first[first + 1]]
        if k != second and k not in v.end[v.first[second] : v.first[second + 1]]
    )
    line = {frozenset((second, first)), frozenset((first, onward))}
    edges = find_edges(mesh.triangles)
    is_joined = np.array(
        [
            frozenset((int(mesh.triangles[t, i]), int(mesh.triangles[t, (i + 1) % 3]))) not in line
            for t, i in zip(edges.first, edges.corner_first, strict=True)
        ]
    )
    facets = geometric_normals(mesh.corners)
    is_usable = np.einsum("tij,tj->ti", mesh.corner_normals, facets) > 0
    cut = with_second_ring(
        find_vertices(
            mesh.vertices, mesh.triangles, mesh.corner_normals, is_usable, edges, is_joined
        )
    )
    at_rims = cut.at[cut.rim.any(axis=1)]
    assert np.array_equal(at_rims, np.tile(mesh.vertices[first], (2, 1)))
