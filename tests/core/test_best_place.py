"""The best place of a picture and its glass, and the turn that brings a lost part back."""

from dataclasses import replace

import numpy as np
import pytest

import kiriko.core.bench.best_place as search
from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.best_place import (
    ENOUGH,
    WORTH_TURNING,
    Limits,
    best_place,
    turn_back,
    turn_of,
    with_glass_turned,
    with_rest_turned,
)
from kiriko.core.bench.offset import moved
from kiriko.core.bench.picture_light import traced
from kiriko.core.glass.motion import Motion
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh, Rig
from known.brute_force import share_arrived
from known.proposed_rigs import plan_of, rig_around
from known.reference_rigs import box, icosphere


def shifted(rig: Rig, field: str, shift: list[float]) -> Rig:
    parts = getattr(rig, field)
    motion = Motion(np.eye(3), np.array(shift, float))
    return replace(rig, **{field: tuple(moved(part, motion) for part in parts)})


def wedge(degrees: float) -> Glass:
    """A prism whose edge is upright: its faces are so far from parallel."""
    mesh = box((0.08, 0.03, 0.08))
    vertices = mesh.vertices.copy()
    vertices[:, 1] *= 1 + vertices[:, 0] / 0.03 * 2 * np.tan(np.radians(degrees / 2))
    return Glass("wedge", Mesh(vertices, mesh.triangles), ConstantIndex(1.5))


@pytest.fixture(scope="module")
def lost_by_a_wedge() -> Rig:
    """A prism that sends a part of the picture past the plate."""
    rig = rig_around(wedge(16.0), picture=0.02, display=0.3)
    plate = rig.plates[0]
    small = Mesh(
        plate.mesh.vertices.mean(axis=0)
        + 0.08 * (plate.mesh.vertices - plate.mesh.vertices.mean(axis=0)),
        plate.mesh.triangles,
    )
    return replace(rig, plates=(replace(plate, mesh=small),))


def test_light_cannot_tell_which_of_the_two_was_turned() -> None:
    """The glass by a turn, or all else the other way: the same places arrive."""
    rng = np.random.default_rng(1)
    rig = rig_around(Glass("block", box((0.05, 0.04, 0.06))), picture=0.035)
    for turn in rng.normal(0, 0.2, (4, 3)):
        one = run_steps(traced(with_glass_turned(rig, turn), plan_of(), 16))
        other = run_steps(traced(with_rest_turned(rig, turn), plan_of(), 16))
        assert (one.light.reason == other.light.reason).mean() > 0.99
        assert one.share == pytest.approx(other.share, abs=5e-3)
        motion = turn_of(rig, turn)
        back = np.linalg.norm(other.light.positions - other.light.positions[0], axis=1)
        there = np.linalg.norm(one.light.positions - one.light.positions[0], axis=1)
        same = one.light.has_arrived & other.light.has_arrived
        assert np.abs(back - there)[same].max() < 1e-9
        assert motion.points(motion.shift).shape == (3,)


def test_a_picture_beside_its_light_comes_back() -> None:
    """Without refraction its light lands where it stands: a picture 4 mm to the right and 3 mm up
    of a display as large goes back by as much, and is whole.
    """
    rig = rig_around(Glass("slab", box((0.1, 0.02, 0.1)), ConstantIndex(1.0)), picture=0.02)
    rig = replace(rig, displays=rig_around(rig.glasses[0], picture=0.02, display=0.021).displays)
    off = shifted(rig, "pictures", [0.004, 0, 0.003])
    found = run_steps(best_place(off, plan_of(), Limits(shift=0.01)))
    assert found.before == pytest.approx((0.0165 / 0.02) * (0.0175 / 0.02), abs=0.02)
    assert found.shift == pytest.approx([-0.0038, -0.0028], abs=6e-4)
    assert abs(found.turn) < np.radians(2)
    assert found.is_better
    assert found.after > 0.998
    moved_back = replace(off, pictures=(moved(off.picture_place, found.motion),))
    assert share_arrived(moved_back) > 0.99


def test_a_turned_picture_turns_back() -> None:
    """By as much as it is turned in its plane."""
    rig = rig_around(
        Glass("slab", box((0.1, 0.02, 0.1)), ConstantIndex(1.0)), picture=0.02, display=0.0205
    )
    turn = np.radians(8)
    turned_rig = with_glass_turned(
        replace(rig, glasses=(Glass("p", rig.picture_place.mesh),)), np.array([0, turn, 0])
    )
    off = replace(rig, pictures=(replace(rig.picture_place, mesh=turned_rig.glasses[0].mesh),))
    found = run_steps(best_place(off, plan_of(), Limits(shift=0.005)))
    assert abs(found.turn) == pytest.approx(turn, abs=np.radians(1.5))
    assert found.after > found.before + 0.02
    assert found.after > 0.998


def test_a_ball_has_no_better_place() -> None:
    """A picture in the middle of a ball, all of which arrives, stays."""
    rig = rig_around(Glass("ball", icosphere(0.025, 4)), picture=0.02, display=0.05)
    found = run_steps(best_place(rig, plan_of(), Limits(shift=0.005)))
    assert (found.shift == 0).all()
    assert found.turn == 0
    assert not found.is_better
    assert (found.before, found.after) == (1.0, 1.0)


def test_the_best_place_is_that_of_brute_force() -> None:
    """No place of a grid within the limits shows more of a picture in a ball beside the axis."""
    rig = rig_around(Glass("ball", icosphere(0.025, 4)), picture=0.03, plate=0.35, display=0.06)
    off = shifted(rig, "pictures", [0.006, 0, 0.004])
    limit = 0.008
    found = run_steps(best_place(off, plan_of(), Limits(shift=limit, turn=0.0)))
    plans = plan_of()

    def share(rig: Rig) -> float:
        return run_steps(traced(rig, plans, 40)).share

    ways = np.linspace(-limit, limit, 9)
    shares = [share(shifted(off, "pictures", [x, 0, z])) for x in ways for z in ways]
    there = replace(off, pictures=(moved(off.picture_place, found.motion),))
    assert share(there) > max(shares) - 3e-3
    assert found.after > found.before + 0.05


def test_the_glass_turns_where_it_may(lost_by_a_wedge: Rig) -> None:
    """A prism that sends the picture past the plate turns until all of it arrives."""
    rig = lost_by_a_wedge
    still = run_steps(best_place(rig, plan_of(), Limits(shift=1e-4, turn=0.0)))
    found = run_steps(
        best_place(rig, plan_of(), Limits(shift=1e-4, turn=0.0, glass=np.radians(30)))
    )
    assert (still.glass_turn == 0).all()
    assert found.after > still.after + WORTH_TURNING
    assert np.linalg.norm(found.glass_turn) <= np.radians(30) * (1 + 1e-12)
    changed = with_glass_turned(rig, found.glass_turn)
    changed = replace(changed, pictures=(moved(rig.picture_place, found.motion),))
    assert share_arrived(changed) == pytest.approx(found.after, abs=0.02)


def displaced(tilt: float, ior: float, thick: float) -> float:
    """How far, m, a slab tilted by so much, rad, moves a ray aside."""
    inner = np.arcsin(np.sin(tilt) / ior)
    return thick * np.sin(tilt - inner) / np.cos(inner)


def test_the_smallest_turn_that_brings_it_back() -> None:
    """A tilted slab moves the picture past the display's edge: it turns back by as much as Snell's
    law says. By brute force, none of 100 turns about any axis, a tenth smaller, does it.
    """
    tilt, thick = np.radians(30), 0.06
    slab = Glass("slab", box((0.2, thick, 0.2), degrees_about_z=30), ConstantIndex(1.5))
    rig = rig_around(slab, picture=0.02, display=0.03, viewer_distance=20.0, field=0.1)
    found = run_steps(turn_back(rig, plan_of(), np.radians(30)))
    assert found.does_it

    # so much of the lost strip may stay lost
    strip = displaced(tilt, 1.5, thick) - 0.005
    assert found.before == pytest.approx(1 - strip / 0.02, abs=0.03)
    left = 0.005 + (1 - ENOUGH) * strip
    angles = np.linspace(0, tilt, 10001)
    wanted = tilt - np.interp(left, displaced(angles, 1.5, thick), angles)
    assert found.angle == pytest.approx(wanted, rel=0.06)
    assert abs(found.turn[2]) > 0.95 * found.angle  # upright
    assert found.after > 0.98

    plans = plan_of()
    before = run_steps(traced(rig, plans, 24))
    lost = before.light.is_seen & ~before.light.has_arrived

    def brings(turn: np.ndarray) -> float:
        light = run_steps(traced(with_rest_turned(rig, turn), plans, 24))
        back = light.weight[lost & light.light.has_arrived].sum() / light.weight[lost].sum()
        return float(back) if light.share > before.share else 0.0

    assert brings(found.turn) >= ENOUGH - 0.01
    ways = np.random.default_rng(6).normal(size=(100, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert max(brings(0.9 * found.angle * way) for way in ways) < ENOUGH


def test_what_no_turn_brings_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without refraction a turn is no matter to the light; where
    nothing is lost there is nothing to bring back.
    """
    monkeypatch.setattr(search, "STEP_RAD", 0.08)
    slab = Glass("slab", box((0.1, 0.1, 0.1)), ConstantIndex(1.0))
    found = run_steps(turn_back(rig_around(slab, picture=0.02, display=0.01), plan_of(), 0.3))
    assert not found.does_it
    assert found.brought == 0
    with pytest.raises(RigError, match="already arrives"):
        run_steps(turn_back(rig_around(slab, picture=0.02, display=0.05), plan_of(), 0.3))


def test_a_turn_is_found_whatever_the_limit() -> None:
    """A block, turned since about two axes, comes back by the same turn within each wider limit."""
    rig = rig_around(Glass("block", box((0.05, 0.05, 0.05), degrees_about_z=15.8)), picture=0.035)
    off = with_glass_turned(rig, np.radians([9, 0, 24]))
    found = [run_steps(turn_back(off, plan_of(), np.radians(limit))) for limit in (26, 45)]
    assert all(one.does_it for one in found)
    turns = np.stack([one.turn for one in found])
    assert np.abs(turns - turns[0]).max() < 1e-12

    plans = plan_of()
    before = run_steps(traced(off, plans, 24))
    lost = before.light.is_seen & ~before.light.has_arrived
    ways = np.random.default_rng(3).normal(size=(100, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for way in ways:
        light = run_steps(traced(with_rest_turned(off, 0.9 * found[0].angle * way), plans, 24))
        back = light.weight[lost & light.light.has_arrived].sum() / light.weight[lost].sum()
        assert back < ENOUGH or light.share <= before.share
