"""Blender's BVH in Embree's place: the tests of tests/core that
ask a ray engine, and the same landings from both.
"""

import sys
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.light.engines import make_engine
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.solve.session import Session
from known import rules
from known.reference_rigs import (
    ball_rig,
    cube_rig,
    icosphere,
    mean_normals,
    rig,
    split_quads,
    torus,
    wavy_slab,
)
from test_curved import (  # noqa: F401 - collected here as well
    CLOSED,
    test_an_open_sheet_is_met_from_both_sides,
    test_every_ray_from_inside_meets_the_surface,
    test_leaving_the_hull_early_changes_nothing,
    test_light_runs_along_the_surface_inside,
    test_rays_between_facet_and_curved_face_are_found,
    test_rays_beyond_the_outline_meet_nothing,
    test_the_outline_of_a_cavity_is_found,
)
from test_curved import test_no_ray_is_lost_inside as check_leaks
from test_rules import test_a_rule_changes_nothing_but_rounding as check_rule
from test_trace import (  # noqa: F401 - collected here as well
    test_ball_error_falls_with_the_square_of_the_edge,
    test_ellipsoid_agrees_with_the_quadric,
    test_rays_at_vertices_and_edges_do_not_leak,
    test_rays_from_inside_end_at_the_vertices_and_edges_they_are_aimed_at,
    test_smooth_ball_is_right_to_a_hundred_thousandth_of_a_pixel,
)

ONE_TRIANGLE = np.eye(3, dtype=np.float32)[None]
PLANS = {
    "ball": lambda: rules.plan(ball_rig()),
    "ball as drawn": lambda: rules.plan(rig(replace(icosphere(0.025, 5), surface="facets"))),
    "torus": lambda: rules.plan(rig(mean_normals(torus(0.018, 0.007, 64, 32)))),
    "wavy slab": lambda: rules.plan(rig(wavy_slab())),
    "cube": lambda: rules.with_engine(cube_rig()),
}


@pytest.fixture(autouse=True)
def _no_embree(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    assert make_engine(ONE_TRIANGLE).name == "Blender's BVH"
    with loading.off():
        yield


@pytest.mark.parametrize("name", ["ball 1280", "torus", "cylinder 8 x 1", "wavy slab"])
def test_no_ray_is_lost_inside_curved_faces(name):
    """Rays aimed at vertices and edges of closed meshes, and
    40 000 others, come out of the solids they go into.
    """
    check_leaks(name, has_mean_normals=False, ior=1.49)


def test_flat_faces_are_met_as_in_float64():
    """A cube lands where it does when all its triangles are tested in float64."""
    check_rule("few flat faces build no ray engine")


@pytest.mark.parametrize("name", PLANS)
def test_both_engines_lead_to_the_same_landings(name, monkeypatch):
    """The same branches, and landings to 1e-8 px: curved faces
    are searched from slightly other places.
    """
    by_blender = PLANS[name]()
    # they are made when they are first asked
    engines = [planned.layer.engine_triangles.engine for planned in by_blender.layers]
    assert {engine.name for engine in engines} == {"Blender's BVH"}

    monkeypatch.undo()
    by_embree = PLANS[name]()
    assert [plan.used[0] for plan in (by_blender, by_embree)] == [
        "ray engine (Blender's BVH)",
        "ray engine (Embree)",
    ]

    rays = by_embree.rig.viewer.rays(np.random.default_rng(0).uniform(0, 512, (20_000, 2)))
    found, expected = (trace_all(plan, *rays) for plan in (by_blender, by_embree))
    assert expected.has_arrived.sum() > 4_000
    assert np.array_equal(found.branch, expected.branch)
    assert np.abs(found.xy - expected.xy)[expected.has_arrived].max() < 1e-8


@pytest.mark.parametrize("tilt", [0, 1e-9, 1.1e-7, 1.3e-7, 1e-5])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rays_nearly_along_an_axis_meet_vertices_and_edges(axis, tilt):
    """Each ray aimed at a vertex or the middle of an edge of a
    sheet across the axis, where boxes end, meets it.
    """
    at = np.linspace(-0.7, 0.7, 41)
    x, y = (values.ravel() for values in np.meshgrid(at, at, indexing="ij"))
    corners = np.stack([x, y, np.full_like(x, 0.3)], axis=1)[
        split_quads(np.arange(41 * 41).reshape(41, 41))
    ]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    targets = np.unique(
        np.concatenate([corners, middles]).reshape(-1, 3).astype(np.float32), axis=0
    )
    targets = targets[np.abs(targets[:, :2]).max(axis=1) < 0.69]
    direction = np.array([tilt, -tilt, -1])
    engine = make_engine(np.roll(corners, axis, axis=2).astype(np.float32))
    found = engine.shoot(
        np.roll(targets - 1.2 * direction, axis, axis=1).astype(np.float32),
        np.roll(np.tile(direction, (len(targets), 1)), axis, axis=1).astype(np.float32),
    )

    assert len(targets) > 4_000
    assert (found.triangle >= 0).all()
    assert np.abs(found.distance - 1.2).max() < 1e-6


def test_a_solution_says_which_engine_it_is_of():
    """The engine is told with the result."""
    a_rig = ball_rig(3, pixels=48, display_pixels=48)
    assert "ray engine (Blender's BVH)" in run_steps(Session().solve(a_rig)).used


def test_where_there_is_no_engine_one_is_asked_for(monkeypatch):
    """Without Embree and without Blender, the error says what to install."""
    monkeypatch.setitem(sys.modules, "mathutils.bvhtree", None)
    with pytest.raises(RigError, match="install kiriko-kernel or embreex"):
        make_engine(ONE_TRIANGLE)
