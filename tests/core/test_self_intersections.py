"""Shells that cut themselves: what they wind around once or more is glass, and counts once."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.vectors import dot
from kiriko.core.glass.meshes import geometric_normals
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Landings, Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Blocker, Mesh, Rig
from kiriko.core.rig.settings import Settings
from known.closed_forms import landing, unit
from known.reference_rigs import glass_rig, icosphere, rig, split_quads
from known.union_walk import through_union

INDEX = 1.49
SETTINGS = Settings()


def tube(path: np.ndarray, n_sides: int, radius: float) -> Mesh:
    """A closed tube around a closed path (m, 3) in the xz plane."""
    ahead = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    beside = np.cross(ahead, [0, 1, 0])
    angle = 2 * np.pi * (np.arange(n_sides) + 0.3) / n_sides
    ring = np.cos(angle)[:, None, None] * beside + np.sin(angle)[:, None, None] * [0, 1, 0]
    vertices = (path + radius * ring).transpose(1, 0, 2).reshape(-1, 3)

    i, k = np.meshgrid(np.arange(len(path)), np.arange(n_sides), indexing="ij")
    corner = [
        ((i + a) % len(path)) * n_sides + (k + b) % n_sides
        for a, b in [(0, 0), (1, 0), (1, 1), (0, 1)]
    ]
    triangles = np.stack(
        [corner[0], corner[1], corner[2], corner[0], corner[2], corner[3]], axis=-1
    )
    return Mesh(vertices, triangles.reshape(-1, 3))


def eight(n: int = 40) -> Mesh:
    """A tube around the figure of eight, which meets itself in its middle."""
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    path = 0.021 * np.stack([0.8 * np.sin(2 * t), np.zeros(n), np.cos(t)], axis=1)
    return tube(path, 7, 0.006)


def bow() -> Mesh:
    """One of 24 triangles, which no engine is asked about."""
    return tube(0.015 * np.array([[-1, 0, -1.1], [1, 0, 1], [1, 0, -1], [-1, 0, 1.2]]), 3, 0.009)


def rose(n: int = 260) -> Mesh:
    """A tube in eleven loops, through up to a dozen of which a ray goes on its way."""
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    radius = 0.010 + 0.008 * np.cos(7 * t)
    around = radius * np.stack([np.cos(11 * t), 0 * t, np.sin(11 * t)])
    return tube(around.T, 5, 0.004)


def folded() -> Mesh:
    """A ball displaced so far that it cuts itself all over."""
    ball = icosphere(0.018, 3)
    random = np.random.default_rng(5)
    waves, ways = random.normal(scale=250, size=(6, 3)), random.normal(scale=0.004, size=(6, 3))
    return Mesh(ball.vertices + np.sin(ball.vertices @ waves.T) @ ways, ball.triangles)


def traced(a_rig: Rig, xy: np.ndarray) -> tuple[Landings, np.ndarray, np.ndarray]:
    """Landings of rays through viewer px (n, 2), and the rays."""
    origins, directions = a_rig.viewer.rays(xy)
    rays = np.broadcast_to(origins, directions.shape), directions
    return trace_all(compile_plan(a_rig, SETTINGS), *rays), *rays


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("shape", [eight, bow, rose, folded])
def test_it_is_as_the_union_of_all_that_it_winds_around(shape):
    """Rays land where brute force has them, through places
    that a shell winds around twice as well.
    """
    a_rig = glass_rig(shape(), ior=INDEX)
    size = a_rig.viewer.width, a_rig.viewer.height
    xy = np.random.default_rng(0).random((500, 2)) * size
    found, *rays = traced(a_rig, xy)
    walk = through_union(*rays, a_rig.glasses[0].mesh, INDEX, SETTINGS.max_events)
    expected = landing(a_rig, walk.places, walk.directions)

    # light that meets the glass again after the plate is not told by the walk
    asked = (found.reason != Reason.BLOCKED) & (found.reason != Reason.CUT_OFF)
    asked &= (walk.n_events < SETTINGS.max_events) & ~walk.is_inside_out
    has_met = asked & (walk.n_events > 0)
    assert (walk.is_deep & has_met).sum() > 0.1 * has_met.sum()
    assert (found.reason[asked] == Reason.MISSED_GLASS).tolist() == (~has_met[asked]).tolist()
    assert not (found.reason[asked] == Reason.LOST_INSIDE).any()
    both = has_met & found.has_arrived
    assert both.sum() > 30
    np.testing.assert_allclose(found.xy[both], expected[both], rtol=0, atol=1e-5)


def card(y: float, side: float, n: int) -> Blocker:
    """A square across y, of 2 n^2 triangles."""
    x, z = np.meshgrid(*[side * (np.arange(n + 1) / n - 0.5)] * 2)
    vertices = np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=1)
    return Blocker("card", Mesh(vertices, split_quads(np.arange(x.size).reshape(n + 1, n + 1))))


def test_no_ray_slips_through_glass_and_what_stands_behind():
    """Rays at the edges of a ball, some of which Embree lets through, and a card in its layer."""
    a_rig = replace(rig(icosphere(0.02, 2, smooth=False)), blockers=(card(0.06, 0.4, 6),))
    corners = a_rig.glasses[0].mesh.corners
    eye = a_rig.viewer.position
    front = corners[dot(geometric_normals(corners), corners[:, 0] - eye) < 0]
    weight = np.random.default_rng(1).random((40, 1, 1, 1))
    aims = (weight * front + (1 - weight) * np.roll(front, 1, axis=1)).reshape(-1, 3)
    plan = compile_plan(a_rig, SETTINGS)
    with loading.off():
        found = trace_all(plan, np.broadcast_to(eye, aims.shape), unit(aims - eye))
    assert not (found.reason == Reason.MISSED_GLASS).any()


@pytest.mark.usefixtures("has_kernel")
def test_a_card_within_few_triangles_hides_no_face_beyond():
    """Of 72 triangles it is met before those of the glass are asked, of 2 beside them."""
    xy = 256 + 120 * (np.random.default_rng(0).random((4000, 2)) - 0.5)
    few, many = (
        traced(
            replace(glass_rig(bow(), ior=INDEX), blockers=(card(0.0045, 0.012, n),)),
            xy,
        )[0]
        for n in (1, 6)
    )
    assert (few.reason == many.reason).all()
