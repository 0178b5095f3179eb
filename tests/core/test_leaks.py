"""Closed glass does not leak: not one ray at a vertex or an
edge's middle escapes, of 5 k and of 82 k triangles.

Embree's robust mode alone loses 0.2 to 0.9 % of them. `dev.py
extremes` asks all of the larger meshes, here a part.
"""

import numpy as np
import pytest

from kiriko.core.glass.meshes import find_edges
from kiriko.core.glass.solids import contains
from kiriko.core.light import layer_hits
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from known.leaks import SHAPES, START, aims_at, leak_cases, leaks_of
from known.reference_rigs import icosphere, rig

EVERY = {0: 1, 1: 16}  # of the targets of the smaller and larger meshes


@pytest.mark.parametrize("size", EVERY)
def test_no_ray_at_a_vertex_or_edge_escapes(size):
    """From outside and inside, straight on and refracted: all that
    goes in comes out, and nothing is passed through.

    Straight on, light changes sides at each event: their
    number is even from outside and odd from inside.
    """
    for shape, kind, mesh in leak_cases(size):
        assert find_edges(mesh.triangles).n_open == 0
        assert abs(len(mesh.triangles) - (82_000 if size else 5_200)) < 1_000
        inside = np.array(SHAPES[shape][1])
        assert contains(mesh.corners, np.array([inside, START])).tolist() == [True, False]
        found = leaks_of(shape, mesh, EVERY[size])
        assert found.n_rays > 18_000
        assert found.certain > 0.8 * found.n_rays
        assert found[2:] == (0, 0, 0), f"{shape}, {kind}: {found}"


def test_without_its_rescue_the_ray_engine_leaks(monkeypatch):
    """The test can fail: Embree's own answer loses rays at vertices and edges."""
    monkeypatch.setattr(layer_hits, "find_missed_hits", lambda *_: ())
    mesh = icosphere(0.025, 4, smooth=False)
    with loading.off():
        found = leaks_of("ball", mesh)
    assert found.lost > 20


def test_a_ray_that_grazes_an_edge_of_a_fine_mesh_comes_out():
    """It goes in by one facet and along the next, whose plane
    it meets far beside: it is not lost for that.
    """
    ball = icosphere(0.025, 6)
    mesh = Mesh(ball.vertices, ball.triangles)
    targets = aims_at(mesh).targets[[69514, 77798]]
    d = targets - START
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    plan = compile_plan(rig(mesh, ior=1.0, distance=10.0), Settings())
    landings = trace_all(plan, np.tile(START, (2, 1)), d)
    assert (landings.reason != Reason.LOST_INSIDE).all()
    assert (landings.n_events % 2 == 0).all()
