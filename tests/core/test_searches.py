"""What is found does not depend on what else is looked for at the same time."""

from contextlib import nullcontext
from dataclasses import fields, replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.light import hits, trace
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.map.borders import N_DIGITS, find_borders
from kiriko.core.map.points import Points, trace_points
from kiriko.core.map.ray_budget import RayBudget
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, bottle, box, icosphere, rig


def are_same(a, b):
    """Are all arrays the same, bit by bit?"""
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(type(a))]
    return all(x is y is None or x.tobytes() == y.tobytes() for x, y in pairs)


@pytest.mark.parametrize("max_events", [1, 3, 32])
def test_rays_that_begin_where_others_have_ended_go_the_same_way(monkeypatch, max_events):
    """Some meet a box alone, some the ball in it, and some are turned back without end."""
    a_rig = rig(box([0.04] * 3, degrees_about_z=20.0), pixels=16)
    a_rig = replace(a_rig, glasses=a_rig.glasses + ball_rig(2).glasses)
    plan = compile_plan(a_rig, Settings(max_events=max_events))
    rays = plan.viewer.rays(16 * np.random.default_rng(0).random((150, 2)))
    with loading.off():
        together, course = run_steps(trace.recording(plan, *rays))
        monkeypatch.setattr(trace, "LIVE_AT_ONCE", 11)
        late, course_of_late = run_steps(trace.recording(plan, *rays))
        kept = run_steps(trace.tracing(plan, *rays, course=course))

    assert together.n_events.max() == max_events
    assert len(np.unique(together.n_events)) >= min((max_events + 1) // 2, 5)
    assert (together.reason[together.n_events < max_events] != Reason.CUT_OFF).all()
    assert are_same(late, together)
    assert are_same(kept, together)
    assert np.array_equal(course_of_late, course)


def test_borders_of_many_edges_are_those_of_each_alone():
    """From the middle of a ball to places beyond its rim; and none of no edges."""
    a_rig = ball_rig(2, pixels=32)
    plan = compile_plan(a_rig, Settings())
    angle = 2 * np.pi * np.arange(24) / 24
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    view = 16 + np.concatenate([np.zeros((1, 2)), 3 * around, 15 * around])
    with loading.off():
        points = run_steps(trace_points(plan, view))
        far = 1 + np.flatnonzero(points.branch[1:] != points.branch[0])
        near = np.zeros(len(far), np.int64)

        def of(some):
            allowance = RayBudget(plan, view[:0])
            return run_steps(find_borders(plan, points, near[some], far[some], allowance))

        found = of(slice(None))
        alone = [of(slice(k, k + 1)) for k in range(0, len(far), 5)]
        nothing = of(slice(0))

    assert len(far) >= 10
    assert (found.branch == points.branch[0]).all()
    for k, border in zip(range(0, len(far), 5), alone, strict=True):
        assert are_same(border, found.at(np.array([k])))
    assert are_same(nothing, Points.none())


@pytest.mark.parametrize("is_off", [False, True])
@pytest.mark.parametrize("n_borders", [1, 100, 5000])
def test_a_border_takes_as_many_rays_as_are_told(n_borders, is_off):
    """From the middle of a ball to places beyond its rim, however many are looked for."""
    with loading.off() if is_off else nullcontext():
        plan = compile_plan(ball_rig(2, pixels=32), Settings())
        angle = 2 * np.pi * np.arange(n_borders) / n_borders
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        view = 16 + np.concatenate([np.zeros((1, 2)), 15 * around])
        points = run_steps(trace_points(plan, view))
        near = np.zeros(n_borders, np.int64)
        allowance = RayBudget(plan, view[:0])
        n_rays = sum(find_borders(plan, points, near, 1 + np.arange(n_borders), allowance))
        assert n_rays == 1 + n_borders * N_DIGITS


@pytest.mark.parametrize("glass", [bottle(), icosphere(0.02, 2)])
def test_rays_that_wait_for_their_hits_go_the_same_way(monkeypatch, glass):
    """Whether those that meet no true hit at first are asked for once more, all at
    once or one by one, before others go on, or with the next events of these.
    """
    plan = compile_plan(rig(glass, pixels=16), Settings())
    rays = plan.viewer.rays(16 * np.random.default_rng(0).random((3000, 2)))
    n_put_off = []
    put_off = hits.LayerSearch.put_off

    def counted(search, some, *where):
        is_put_off = put_off(search, some, *where)
        n_put_off[-1] += len(some) * is_put_off
        return is_put_off

    monkeypatch.setattr(hits.LayerSearch, "put_off", counted)
    found = []
    for times in (np.inf, hits.TIMES_FEW, 1):
        monkeypatch.setattr(hits, "TIMES_FEW", times)
        n_put_off.append(0)
        with loading.off():
            found.append(trace.trace(plan, *rays))

    assert n_put_off[0] == 0
    assert 0 < n_put_off[1] < n_put_off[2]
    assert are_same(found[1], found[0])
    assert are_same(found[2], found[0])
