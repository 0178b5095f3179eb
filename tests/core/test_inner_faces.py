"""Faces within a body bound nothing: it is traced as the body without them is."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from kiriko.core.glass.inner_faces import find_bodies, without_inner
from kiriko.core.glass.solids import solids_from_mesh
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from known.reference_rigs import icosphere, rig
from known.work import solve

SIDE = 4  # cells of a block each way


def block(is_filled):
    """A mesh (and which triangles are within) of filled cells of a grid, each face once: those to
    the outside look out, walls between cells along their axis.
    """
    corners = np.stack(np.meshgrid(*[np.arange(SIDE + 3)] * 3, indexing="ij"), axis=-1)
    filled = np.pad(is_filled, 1)
    triangles, is_wall = [], []
    for axis, *cell in product(range(3), *[range(SIDE + 1)] * 3):
        step = np.eye(3, dtype=int)
        low, high = filled[tuple(cell)], filled[tuple(np.add(cell, step[axis]))]
        if not (low or high):
            continue
        at = np.add(cell, step[axis])
        u, v = step[(axis + 1) % 3], step[(axis + 2) % 3]
        quad = [np.ravel_multi_index(at + d, (SIDE + 3,) * 3) for d in (0 * u, u, u + v, v)]
        quad = quad if low else quad[::-1]
        triangles += [quad[:3], [quad[0], quad[2], quad[3]]]
        is_wall += [low and high] * 2
    return Mesh(corners.reshape(-1, 3) * 1e-2, np.array(triangles)), np.array(is_wall)


@pytest.mark.parametrize("seed", range(20))
def test_faces_within_are_those_between_two_filled_cells(seed):
    """In a block of cells at random, whose bodies touch along edges and at corners, as well."""
    is_filled = np.random.default_rng(seed).random((SIDE,) * 3) < 0.5
    is_filled[1:-1, 1:-1, 1:-1] = True  # an empty cell within would be glass, as nothing tells it
    mesh, is_wall = block(is_filled)
    body = find_bodies(mesh.vertices, mesh.triangles)
    np.testing.assert_array_equal(body == -1, is_wall)
    plain = without_inner(mesh)
    assert len(plain.triangles) == np.count_nonzero(~is_wall)
    volume = sum(solid.volume for solid in solids_from_mesh(mesh))
    assert volume == pytest.approx(1e-6 * is_filled.sum())


def test_a_wall_may_end_at_several_and_be_there_twice():
    """As mirrored halves leave it: each of both faces is within."""
    mesh, is_wall = block(np.ones((SIDE,) * 3, bool))
    twice = np.concatenate([mesh.triangles, mesh.triangles[is_wall][:, ::-1]])
    body = find_bodies(mesh.vertices, twice)
    np.testing.assert_array_equal(body == -1, np.r_[is_wall, np.ones(is_wall.sum(), bool)])


def test_a_cavity_at_a_wall_stays():
    """A hollow cell of a block, whose faces look into it as the faces outside look out."""
    is_filled = np.ones((3,) * 3, bool)
    mesh, is_wall = block(np.pad(is_filled, ((0, 1),) * 3))
    middle = np.linalg.norm(mesh.corners.mean(axis=1) - 2.5e-2, axis=1) < 0.6e-2
    assert middle.sum() == 12
    outward = np.einsum(
        "ti,ti->t",
        np.cross(*np.moveaxis(mesh.corners[:, 1:] - mesh.corners[:, :1], 1, 0)),
        mesh.corners.mean(axis=1) - 2.5e-2,
    )
    turned = np.where((middle & (outward > 0))[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    body = find_bodies(mesh.vertices, turned)
    np.testing.assert_array_equal(body == -1, is_wall & ~middle)
    assert sum(solid.volume for solid in solids_from_mesh(replace(mesh, triangles=turned))) == (
        pytest.approx(26e-6)
    )


def test_a_wall_in_an_open_body_is_no_face_within():
    """Air comes to it through the hole, so that nothing is known to be glass."""
    mesh, is_wall = block(np.pad(np.ones((2, 1, 1), bool), ((0, 2), (0, 3), (0, 3))))
    assert is_wall.sum() == 2
    holed = mesh.triangles[np.r_[False, np.ones(len(mesh.triangles) - 1, bool)]]
    assert (find_bodies(mesh.vertices, holed) >= 0).all()


def walled(mesh):
    """A ball with a disc across, whose rim is a ring of its own edges."""
    corners = mesh.vertices
    ring = np.flatnonzero(np.abs(corners[:, 2]) < 1e-9)
    ring = ring[np.argsort(np.arctan2(*corners[ring, :2].T))]
    centre = len(corners)
    wall = np.stack([ring, np.roll(ring, -1), np.full(len(ring), centre)], axis=1)
    return replace(
        mesh,
        vertices=np.concatenate([corners, [[0, 0, 0]]]),
        triangles=np.concatenate([mesh.triangles, wall]),
    )


def test_light_goes_as_without_the_wall():
    """A flat-shaded ball with a disc across lands light where the ball alone does, to the bit, and
    nothing is told of gaps.
    """
    plain = icosphere(0.025, 3, smooth=False)
    odd = walled(plain)
    assert len(odd.triangles) > len(plain.triangles) + 10
    found = []
    for mesh in (plain, odd):
        a_rig = rig(mesh, pixels=48)
        plan = compile_plan(a_rig, Settings())
        x, y = np.meshgrid(np.linspace(1, 47, 41), np.linspace(1, 47, 41))
        found.append(trace_all(plan, *a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))))
        assert plan.counts.n_open == (0,)
    one, other = found
    assert one.has_arrived.mean() > 0.1
    np.testing.assert_array_equal(one.xy, other.xy)
    assert not [note for note in solve(a_rig).notes if "gaps" in note]
