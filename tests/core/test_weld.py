import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiriko.core.glass.meshes import components, find_edges, volume_of
from kiriko.core.glass.solids import find_turned, split_shells
from kiriko.core.glass.weld import coincident, welded
from kiriko.core.rig.rig import Mesh
from known.reference_rigs import bottle, box, icosphere, split_quads, uv_ellipsoid


def apart(mesh, random=None, noise=0.0, parts=None):
    """The triangles of a mesh with vertices of their own, or those
    of each part of it (t,), moved by up to `noise`.
    """
    if parts is None:
        vertices = mesh.corners.reshape(-1, 3)
        triangles = np.arange(3 * len(mesh.triangles)).reshape(-1, 3)
    else:
        key = parts[:, None] * len(mesh.vertices) + mesh.triangles
        used, triangles = np.unique(key, return_inverse=True)
        vertices = mesh.vertices[used % len(mesh.vertices)]
        triangles = triangles.reshape(-1, 3)
    if noise:
        step = random.normal(size=vertices.shape)
        vertices = vertices + noise * step / np.linalg.norm(step, axis=1, keepdims=True)
    return vertices, triangles


SHAPES = {
    "box": box((0.05, 0.04, 0.03)),
    "ball": icosphere(0.025, 3),
    "bottle": bottle(),
    "ellipsoid": uv_ellipsoid((0.02, 0.03, 0.04)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("noise", [0.0, 2e-9])
def test_faces_apart_become_the_mesh_they_were(shape, noise):
    """Triangles that share no vertex, their copies off by
    rounding, are joined as in the mesh they were cut from.
    """
    mesh = SHAPES[shape]
    vertices, triangles = apart(mesh, np.random.default_rng(1), noise)
    joined = welded(vertices, triangles, 1e-8)
    edges = find_edges(joined)
    wanted = find_edges(mesh.triangles)
    assert edges.n_open == wanted.n_open == 0
    assert {*zip(edges.first, edges.second, strict=True)} == {
        *zip(wanted.first, wanted.second, strict=True)
    }
    assert len(np.unique(joined)) == len(np.unique(mesh.triangles))
    assert np.linalg.norm(vertices[joined] - vertices[triangles], axis=2).max() <= 2 * noise


def test_a_closed_mesh_stays_as_it_is():
    """A body without open edges keeps its vertices, also where another's are in the same place."""
    one = box((0.01, 0.01, 0.01))
    other = box((0.01, 0.01, 0.01), centre=(0.01, 0, 0))
    triangles = np.concatenate([one.triangles, other.triangles + 8])
    assert np.array_equal(
        welded(np.concatenate([one.vertices, other.vertices]), triangles, 1e-6), triangles
    )


@pytest.mark.parametrize("other_way", [False, True])
def test_bodies_that_touch_stay_bodies(other_way):
    """Boxes that share a face, an edge or a corner, drawn face by
    face, fall into closed boxes of their own volume.
    """
    places = [(0, 0, 0), (0.01, 0, 0), (0.01, 0.01, 0), (0.02, 0.01, 0.01), (0.03, 0.02, 0.02)]
    boxes = [box((0.01, 0.01, 0.01), centre=place) for place in places]
    corners = np.concatenate([b.corners[:, ::-1] if other_way else b.corners for b in boxes])
    random = np.random.default_rng(2)
    corners = corners[random.permutation(len(corners))]
    vertices = corners.reshape(-1, 3)
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    joined = welded(vertices, triangles, 1e-9)
    shells, _ = split_shells(Mesh(vertices, joined))

    assert [len(chosen) for chosen, _ in shells] == [12] * len(boxes)
    for chosen, is_flipped in shells:
        assert find_edges(joined[chosen]).n_open == 0
        assert not is_flipped.any()
        assert abs(volume_of(vertices[joined[chosen]])) == pytest.approx(1e-6, rel=1e-9)


def test_faces_wound_either_way_are_joined():
    """The winding of faces does not matter where two edges meet: a turned face is told later."""
    vertices, triangles = apart(icosphere(0.025, 2))
    turned = np.random.default_rng(3).random(len(triangles)) < 0.5
    joined = welded(vertices, np.where(turned[:, None], triangles[:, ::-1], triangles), 0.0)
    assert find_edges(joined).n_open == 0


def test_an_open_sheet_that_is_drawn_twice_does_not_close():
    """A sheet and its copy in the same place stay two sheets:
    joined at their rim they would enclose nothing.
    """
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    both = np.concatenate([triangles, triangles + 4])
    assert np.array_equal(welded(np.concatenate([sheet, sheet]), both, 0.0), both)


def test_what_is_further_apart_than_the_distance_stays_open():
    """Caps a little beside their tube are joined up to the distance and no further."""
    mesh = SHAPES["box"]
    parts = (np.abs(mesh.corners[..., 2] - 0.015).max(axis=1) < 1e-9).astype(int)  # the upper face
    vertices, triangles = apart(mesh, parts=parts)
    lid = np.unique(triangles[parts == 1])
    vertices = vertices.copy()
    vertices[lid] += [0, 0, 1e-6]
    assert find_edges(welded(vertices, triangles, 1.01e-6)).n_open == 0
    assert find_edges(welded(vertices, triangles, 0.99e-6)).n_open == 8


def test_a_pole_of_many_vertices_becomes_one():
    """A sphere of rows whose first and last have a vertex for
    each meridian, as splines make it, is closed.
    """
    n, m = 16, 12
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, m + 1), np.linspace(0, 2 * np.pi, n + 1), indexing="ij"
    )
    points = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )
    joined = welded(
        points.reshape(-1, 3),
        split_quads(np.arange(points[..., 0].size).reshape(m + 1, n + 1)),
        1e-9,
    )
    is_point = (joined == np.roll(joined, 1, axis=1)).any(axis=1)

    assert is_point.sum() == 2 * n
    assert find_edges(joined[~is_point]).n_open == 0
    assert len(np.unique(joined[~is_point])) == (m - 1) * n + 2


@given(
    st.lists(st.tuples(*[st.integers(0, 6)] * 3), min_size=1, max_size=40),
    st.sampled_from([0.0, 0.9, 1.0, 1.5, 2.0]),
    st.sampled_from([0.0, 0.25, 1e6]),
)
def test_coincident_points_are_those_of_all_pairs(points, distance, shift):
    """Labels are the components of the graph of all pairs no further apart than the distance."""
    points = np.array(points, float) + shift
    labels = coincident(points, distance)
    one, other = np.nonzero(np.linalg.norm(points[:, None] - points, axis=2) <= distance)
    wanted = components(len(points), one, other)
    assert np.array_equal(labels[:, None] == labels, wanted[:, None] == wanted)


@pytest.mark.parametrize("wound", [(1, 1, -1), (1, 1, -1, -1), (1, -1, 1, -1), (1, 1, 1, 1)])
def test_where_faces_at_an_edge_do_not_enclose_glass_in_turn_they_stay_apart(wound):
    """Around an edge glass begins and ends in turn.

    Faces that do not keep to that are left as they are.
    """
    n = len(wound)
    angle = 2 * np.pi * np.arange(n) / n
    tips = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    low = np.tile([0, 0, -1.0], (n, 1))
    high = np.tile([0, 0, 1.0], (n, 1))
    vertices = np.stack([low, high, tips], axis=1).reshape(-1, 3)
    triangles = np.arange(3 * n).reshape(n, 3)
    triangles = np.where(np.array(wound)[:, None] > 0, triangles, triangles[:, ::-1])
    vertices = np.concatenate(
        [vertices + np.array([5.0 * k, 0, 0]) for k in range(3)]
    )  # three such edges
    triangles = np.concatenate([triangles + 3 * n * k for k in range(3)])
    joined = find_edges(welded(vertices, triangles, 1e-9))
    alternates = wound == (1, -1, 1, -1)

    assert len(joined.first) == (6 if alternates else 0)
    assert joined.n_open == 9 * n - 2 * len(joined.first)


def test_triangles_that_look_the_other_way_than_most_around_them_are_found():
    """Of each surface that hangs together, whichever way most of it looks; none of a strip with one
    side only, nor of triangles that hang together with none.
    """
    one, other = icosphere(1.0, 2).triangles, icosphere(1.0, 1).triangles
    triangles = np.concatenate([one, other[:, ::-1] + one.max() + 1])
    is_turned = np.random.default_rng(5).random(len(triangles)) < 0.3
    triangles[is_turned] = triangles[is_turned, ::-1]
    assert (find_turned(triangles) == is_turned).all()

    low, high = np.arange(8), np.arange(8) + 8
    after = np.roll(low, -1), np.roll(high, -1)
    strip = np.concatenate(
        [np.stack([low, after[0], high], 1), np.stack([after[0], after[1], high], 1)]
    )
    assert not find_turned(strip).any()
    twisted = np.where(strip[[7, 15]] % 8 == 0, (strip[[7, 15]] + 8) % 16, strip[[7, 15]])
    strip[[7, 15]] = twisted
    assert not find_turned(strip).any()
    assert not find_turned(one[:1]).any()
