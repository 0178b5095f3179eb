"""Rays that split: by an interaction of this test alone, which sends half of the light on straight
and reflects the other half.
"""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.light import interactions, trace
from kiriko.core.light.compile_plan import MOST_COPIES, compile_plan
from kiriko.core.light.meetings import Interaction
from kiriko.core.light.optics import reflect
from kiriko.core.light.rays import MIRROR, PASS, main_landings
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import Kind, Mirror
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, rectangle

SPLITTER = 31  # as in kiriko.h
SETTINGS = Settings(only_through_glass=False, only_through_plate=False, max_events=40)
X, Y, Z = np.eye(3)


def interact(plan, rays, i, hits, by_layer):
    rays.throughput[i] *= 0.5
    normals, patch = plan.triangles.normals[hits.triangle], plan.triangles.patch[hits.triangle]
    splits, copies = rays.split(i)
    rays.directions[copies] = reflect(rays.directions[i[splits]], normals[splits])
    rays.add_to_branch(copies, patch[splits], MIRROR)
    rays.add_to_branch(i, patch, PASS)


@pytest.fixture(params=["kernel", "numpy"])
def way(request, monkeypatch):
    monkeypatch.setitem(
        interactions.INTERACTIONS, SPLITTER, Interaction(interact, None, splits=True)
    )
    monkeypatch.setattr(
        trace, "ENDS", np.resize(trace.ENDS, SPLITTER + 1) & (np.arange(SPLITTER + 1) < 5)
    )
    with nullcontext() if request.param == "kernel" else loading.off():
        yield


def panes(n, up=Y + Z):
    """A rig with n mirrors before its ball, one behind the other, at 45 degrees or as told."""
    a_rig = ball_rig(2, pixels=64)
    mirrors = tuple(
        Mirror(f"pane {k}", rectangle((-0.5 + 0.1 * k) * Y, X, up, 0.2, 0.2)) for k in range(n)
    )
    return replace(a_rig, mirrors=mirrors)


def splitting(plan):
    """A plan whose mirrors split rays."""
    kind = np.where(plan.parts.kind == Kind.MIRROR, SPLITTER, plan.parts.kind)
    return replace(plan, parts=replace(plan.parts, kind=kind), n_copies=MOST_COPIES)


def test_both_ways_are_those_of_no_pane_and_of_a_mirror(way):
    """A landing for each, with half of the throughput, by its ray's number; the straight one of
    light that arrives is the main one.
    """
    a_rig = panes(1)
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, 64, (3000, 2)))
    mirrored = compile_plan(a_rig, SETTINGS)
    apart = [compile_plan(replace(a_rig, mirrors=()), SETTINGS), mirrored]
    straight, reflected = (trace_all(plan, o, d) for plan in apart)
    found = trace_all(splitting(mirrored), o, d)
    order = np.lexsort((found.n_events, found.sample))
    assert np.array_equal(found.sample[order], np.repeat(np.arange(len(o)), 2))
    assert straight.has_arrived.mean() > 0.3

    main = main_landings(found, len(o))
    for name in ("reason", "xy", "positions", "directions", "leak", "plate_path"):
        both = np.stack([getattr(straight, name), getattr(reflected, name)], axis=1)
        values = getattr(found, name)
        near = [
            np.isclose(values.astype(float), both[found.sample, k].astype(float), 0, 1e-5, True)
            for k in (0, 1)
        ]
        is_one = [np.all(one.reshape(len(values), -1), axis=1) for one in near]
        assert (is_one[0] | is_one[1]).all(), name
    np.testing.assert_allclose(
        main.xy[straight.has_arrived], straight.xy[straight.has_arrived], atol=1e-5
    )
    assert (found.throughput == 0.5).all()


def test_ways_are_bounded(way):
    """Light to and fro between panes splits at each; no ray has more than eight ways."""
    plan = splitting(compile_plan(panes(4, up=Z), SETTINGS))
    found = trace_all(plan, *plan.viewer.rays(np.full((500, 2), 32.5)))
    assert (np.bincount(found.sample, minlength=500) == 1 + MOST_COPIES).all()
