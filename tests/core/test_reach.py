"""Glass that stands aside: left out where no light comes near, found where it does."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.light.rays import DeferredObjectError
from kiriko.core.light.trace import trace_all
from kiriko.core.map.sampling import sample
from kiriko.core.rig.rig import ConstantIndex, Glass
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.channel import out_of_sight, sample_reached
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, box, icosphere, rig
from known.work import drain, solve


def with_others(a_rig, *meshes):
    others = (Glass(f"other {k}", mesh, ConstantIndex(1.5)) for k, mesh in enumerate(meshes))
    return replace(a_rig, glasses=(*a_rig.glasses, *others))


def test_what_stands_far_aside_is_left_out_and_changes_nothing():
    """Bit for bit the result of the rig without it, and to rounding that of a plan with it.

    The result says so.
    """
    plain = ball_rig(3, pixels=96)
    a_rig = with_others(
        plain, icosphere(0.02, 3, centre=(0.6, -0.3, 0)), icosphere(0.02, 3, centre=(0, -1.5, 0))
    )

    assert out_of_sight(a_rig, a_rig.viewer) == (1, 2)
    found = solve(a_rig)
    without = solve(plain)
    assert np.array_equal(found.source, without.source)
    assert sum("no light comes near it" in text for text in found.left_out) == 2

    whole = drain(
        sample(compile_plan(a_rig, Settings()))
    )  # another ray engine: cells may be cut otherwise
    at = np.random.default_rng(0).uniform(0, 96, (2000, 2))
    one = found.first.view_map.display_from_view(at)
    other = whole.display_from_view(at)

    assert np.array_equal(np.isnan(one), np.isnan(other))
    seen = ((one >= 0) & (one <= 512)).all(axis=1)
    assert np.abs(one - other)[seen].max() < 0.01


@pytest.mark.parametrize("thin", [False, True])
def test_what_light_comes_by_is_found_though_the_viewer_does_not_look_at_it(thin):
    """Beyond the plate, on the way to the display: a ball, and a rod as thin as a viewer pixel."""
    mesh = (
        box([0.1, 3e-4, 3e-4], (0, 0.15, -0.05))
        if thin
        else icosphere(0.005, 3, centre=(0, 0.15, -0.08))
    )
    a_rig = with_others(ball_rig(3, pixels=128), mesh)

    assert out_of_sight(a_rig, a_rig.viewer) == (1,)
    laps = []
    plan, found = drain(sample_reached(a_rig, a_rig.viewer, Settings(), MeshCache(), laps.append))
    assert laps == ["plan", "tracing", "plan"]
    assert plan.deferred.glasses == ()

    at = np.random.default_rng(0).uniform(0, 128, (2000, 2))
    whole = drain(sample(compile_plan(a_rig, Settings())))
    assert np.array_equal(found.display_from_view(at), whole.display_from_view(at), equal_nan=True)
    assert not any("comes near" in text for text in solve(a_rig).left_out)


def test_rays_that_come_near_are_told():
    a_rig = with_others(ball_rig(3, pixels=32), box([0.01] * 3, (0.3, 0, 0)))
    plan = compile_plan(a_rig, Settings(), deferred=(1,))
    away = np.array([[0.3, -1.0, 0], [0.4, -1.0, 0]])
    along = np.tile([[0.0, 1, 0]], (2, 1))
    with pytest.raises(DeferredObjectError) as found:
        trace_all(plan, away, along)
    assert found.value.boxes == {0}
    assert not trace_all(plan, away[1:], along[1:]).has_arrived.any()
    # beside the cube, but within the bulge that a curved one may have
    with pytest.raises(DeferredObjectError):
        trace_all(plan, np.array([[0.3069, -1.0, 0]]), along[:1])


def test_a_rig_whose_glass_nobody_looks_at_keeps_all_of_it():
    a_rig = rig(box([0.01] * 3, (0.5, 0, 0)), pixels=16)
    assert out_of_sight(a_rig, a_rig.viewer) == ()


def test_a_session_goes_on_when_glass_steps_aside_and_back():
    session = Session()
    near, far = (
        with_others(ball_rig(3, pixels=48), box([0.005] * 3, (x, -0.06, 0))) for x in (0.01, 0.5)
    )
    results = [solve(a_rig, session) for a_rig in (near, far, near)]
    assert np.array_equal(results[0].source, results[2].source)
    assert not np.array_equal(results[0].source, results[1].source)
    assert np.array_equal(results[1].source, solve(ball_rig(3, pixels=48)).source)


def test_what_is_thinner_than_rays_are_apart_is_found_by_what_passes_between_them():
    """A rod of a fortieth of a pixel, between the first rays and
    those that check them, is in the plan all the same.

    Behind a slab, so that nothing else asks for finer squares.
    """
    plain = rig(box([0.1, 0.03, 0.1]), pixels=128)
    a_rig = with_others(plain, box([0.1, 1e-5, 1e-5], (0, 0.1537, -0.1)))
    assert out_of_sight(a_rig, a_rig.viewer) == (1,)

    # with no walls of its box to pass by, none of the rays
    # comes near the rod: none raises DeferredObjectError
    blind = replace(
        compile_plan(a_rig, Settings(), deferred=(1,)),
        thin_parts=compile_plan(plain, Settings()).thin_parts,
    )

    assert drain(sample(blind)).n_rays > 1000
    laps = []
    plan, _ = drain(sample_reached(a_rig, a_rig.viewer, Settings(), MeshCache(), laps.append))
    assert laps == ["plan", "tracing", "plan"]
    assert plan.deferred.glasses == ()
    assert not any("comes near" in text for text in plan.left_out)


def test_of_glass_none_of_which_is_in_sight_none_is_aside():
    """A plan needs some; who looks at none is told so by the solve."""
    behind = tuple(
        Glass(name, box([0.02] * 3, (x, -3, 0))) for name, x in (("a", -0.1), ("b", 0.1))
    )
    before = Glass("c", box([0.02] * 3))
    viewer = rig(behind).viewer
    assert out_of_sight(rig(behind), viewer) == ()
    assert out_of_sight(rig((*behind, before)), viewer) == (0, 1)
    assert out_of_sight(rig((before,)), viewer) == ()
