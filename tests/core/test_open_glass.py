"""Glass with gaps: the way of light there, how much of it
is told, and no word where no light comes by.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import MeshError, RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.optics import plane_symmetry, refract
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.accuracy import leaks, measure
from known.reference_rigs import ball_rig, box, rectangle, rig
from known.work import drain, solve

WIDE = 0.3
BACK = np.array([0, 1.0, 0])


def without(mesh, normal):
    """The mesh without its faces that look along a normal."""
    across = np.cross(
        mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0]
    )
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return replace(mesh, triangles=mesh.triangles[across @ normal < 0.9])


def slab(y, thickness=0.02, wide=WIDE):
    return box([wide, thickness, wide], centre=(0, y, 0))


def glasses(*meshes):
    return tuple(Glass(f"glass {k}", mesh, ConstantIndex(1.49)) for k, mesh in enumerate(meshes))


def traced(a_rig, n=41):
    plan = compile_plan(a_rig, Settings())
    x, y = np.meshgrid(np.linspace(5, 507, n), np.linspace(5, 507, n))
    o, d = a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    return plan, d, trace_all(plan, o, d)


@pytest.mark.parametrize("before", [True, False], ids=["two solids", "one solid"])
def test_light_that_leaves_by_a_gap_enters_the_next_glass_from_air(before):
    """Behind a slab without a back it goes on as within glass; the
    next slab takes it in as from air, and lets it out.

    The slab that follows is of another cluster, whose mask has
    fewer solids than that of the two that touch.
    """
    first = (slab(-0.01),) if before else ()
    plan, d, landings = traced(
        rig(glasses(*first, without(slab(0.01), BACK), slab(0.08)), display=0.2)
    )
    inside, _, _ = refract(
        d, -np.broadcast_to(BACK, d.shape), np.ones(len(d)), np.full(len(d), 1.49)
    )
    expected = plane_symmetry(inside, np.tile(np.array([0, 1, -1]) / 2**0.5, (len(d), 1)))

    assert landings.has_arrived.mean() > 0.9
    np.testing.assert_allclose(
        landings.directions[landings.has_arrived], expected[landings.has_arrived], atol=1e-14
    )

    assert (landings.leak == len(first)).all()
    assert run_steps(leaks(plan)) == (0.0,) * len(first) + (pytest.approx(1.0), 0.0)


def test_light_that_comes_in_by_a_gap_is_told():
    """A slab without its front: light meets the back from within without having entered."""
    plan, _, landings = traced(rig(glasses(without(slab(0.0), -BACK))))
    assert (landings.leak == 0).all()
    assert run_steps(leaks(plan)) == (pytest.approx(1.0),)


def test_a_gap_that_no_light_comes_by_is_not_told():
    """A slab without one of its sides, far from the picture's
    light, is as good as a closed one: no note.
    """
    whole = slab(0.0)
    holed = without(slab(0.0), np.array([0, 0, 1.0]))
    _, _, closed = traced(rig(whole))
    plan, _, open_ = traced(rig(holed))
    assert plan.counts.n_open == (4,)
    np.testing.assert_array_equal(open_.xy, closed.xy)
    assert (open_.leak == -1).all()
    assert solve(rig(holed, pixels=32)).notes == ()


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_the_share_of_light_that_goes_through_a_gap_is_told(share):
    """A back that ends in the middle of the picture lets half of
    its light through, and so on: the note says so.
    """
    holed = without(slab(0.0), BACK)
    edge = 0.015 - 0.03 * share
    ends = [
        [edge, 0.01, 0.15],
        [edge, 0.01, -0.15],
    ]  # the back is drawn from corners 2 and 3 on so far
    holed = Mesh(
        np.concatenate([holed.vertices, ends]),
        np.concatenate([holed.triangles, [[2, 3, 8], [2, 8, 9]]]),
    )
    a_rig = rig(holed, pixels=64)
    (found,) = drain(measure(compile_plan(a_rig, Settings()))).leaks

    assert found == pytest.approx(share, abs=0.02)
    (note,) = [note for note in solve(a_rig).notes if "gaps" in note]
    assert note.startswith(
        f"{100 * found:.0f} % of the picture's light leaks through gaps in 'glass'"
    )
    solution = solve(a_rig)
    assert solution.warnings == (note,)
    assert solution.misses["went through gaps in the glass"] == pytest.approx(found)
    assert solution.picture_coverage == pytest.approx(1 - share, abs=0.02)
    assert solution.picture_coverage + sum(solution.misses.values()) == pytest.approx(1)


def test_closed_glass_has_no_leak():
    """No ray through a smooth ball comes upon a face from
    the wrong side, and none is asked about it.
    """
    plan, _, landings = traced(ball_rig(4))
    assert plan.open_parts == ()
    assert (landings.leak == -1).all()
    assert run_steps(leaks(plan)) == (0.0,)


def test_what_left_by_a_gap_and_misses_all_is_not_lost_inside():
    """Light that left through a gap and meets nothing more
    has missed the plate, as all that is outside.
    """
    a_rig = rig(glasses(without(slab(0.0), BACK)), plate=0.001)
    _, _, landings = traced(a_rig)
    assert (landings.leak == 0).all()
    assert (landings.reason == Reason.MISSED_PLATE).mean() > 0.9
    assert not np.isin(landings.reason, (Reason.LOST_INSIDE, Reason.CUT_OFF)).any()


def test_glass_without_its_front_is_refused_for_its_gap():
    """No ray meets its front, so that by the rule of fronts none meets the glass: the
    gap is why.
    """
    mesh = box([0.05] * 3)
    is_front = mesh.vertices[mesh.triangles][..., 1].max(axis=1) < 0  # the viewer stands at -y
    a_rig = rig(replace(mesh, triangles=mesh.triangles[~is_front]), pixels=16)
    with pytest.raises(
        RigError,
        match=r"100 % of the picture's light leaks through gaps in 'glass'\. Close",
    ):
        solve(a_rig)


def test_flat_glass_is_refused():
    """A plane encloses nothing, however it is turned.

    A sheet a thousandth as thick as wide does.
    """
    right = np.array([2, -1, 0]) / 5**0.5
    up = np.array([3, 6, -5]) / 70**0.5
    with pytest.raises(MeshError, match="'glass' is flat: add a Solidify modifier"):
        solve(rig(replace(rectangle(np.zeros(3), right, up, 0.05, 0.03), uv=None), pixels=8))
    assert not box([0.05, 5e-5, 0.05]).is_flat
