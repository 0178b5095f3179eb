"""Rigs without a plate: light goes straight from the glass to the display."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiriko.core.base.errors import RigError
from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.offset import parameters
from kiriko.core.image.glare import trace_stray_light
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import REASON_WORDS, Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.native import loading
from kiriko.core.rig.rig import ConstantIndex, Display, Glass, Mesh, Mirror, Picture, Rig, Viewer
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.closed_forms import snell, through_ball, through_slab, unit
from known.reference_rigs import (
    ball_rig,
    box,
    icosphere,
    lattice_image,
    rectangle,
    rotation,
    taken,
)

N = 1.49
X, Y, Z = np.eye(3)
THICK = 0.02


def looking(at, direction, away, field, pixels):
    """A viewer in perspective that looks along a direction (3,) at a point (3,)."""
    forward = unit(np.asarray(direction, float))
    right = unit(np.cross(forward, Z if abs(forward[2]) < 0.9 else Y))
    half = 0.5 * field / away
    return Viewer(
        *("viewer", "perspective", at - away * forward),
        np.stack([right, np.cross(right, forward), forward]),
        *((-half, half, -half, half), pixels, pixels),
    )


def on_display(mesh, *, gap=0.0, direction=(0.3, 0.55, -1.0), ior=N, pixels=32, side=0.12):
    """Glass whose lowest point is at z = 0, on a display that looks up, `gap` below it."""
    direction = unit(np.asarray(direction, float))
    middle = np.array([0, 0, THICK])
    across = unit(np.cross(direction, X))
    return Rig(
        viewers=(looking(middle, direction, 0.5, 0.05, pixels),),
        glasses=(Glass("glass", mesh, ConstantIndex(ior)),),
        plates=(),
        displays=(Display("display", rectangle(-gap * Z, X, Y, side, side), 120, 120),),
        pictures=(
            Picture(
                *("picture", lattice_image(64)),
                rectangle(middle, unit(np.cross(across, -direction)), across, 0.02, 0.02),
            ),
        ),
    )


def slab(size=0.08):
    return box([size, size, THICK], (0, 0, THICK / 2))


def rays_of(rig, n=2000, seed=0):
    size = rig.viewer.width, rig.viewer.height
    return rig.viewer.rays(np.random.default_rng(seed).uniform(0, size, (n, 2)))


def landed(rig, rays, **how):
    return trace_all(compile_plan(rig, Settings(**how)), *rays)


def straight_down(p, d, z):
    """Where rays are at a height."""
    return p + ((z - p[:, 2]) / d[:, 2])[:, None] * d


# against closed forms


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("gap", [0.0, 1e-10, 1e-4, 0.02])
def test_a_slab_on_a_display_shifts_light_as_snell_says(gap):
    """Landings are within 1e-9 m of the closed form, and all of them one branch: so a slab
    that lies on the display is as good as one above it.
    """
    rig = on_display(slab(), gap=gap)
    o, d = rays_of(rig)
    found = landed(rig, (o, d))
    p, along = through_slab(o, d, Z, np.array([0, 0, THICK]), THICK, N)
    expected = straight_down(p, along, -gap)

    is_through = (np.abs(straight_down(o, d, THICK)[:, :2]).max(axis=1) < 0.04) & (
        np.abs(p[:, :2]).max(axis=1) < 0.04
    )
    assert is_through.sum() > 1500
    assert (found.reason[is_through] == Reason.ARRIVED).all()
    assert len(set(found.branch[is_through])) == 1
    assert np.abs(found.positions - expected)[is_through].max() < 1e-9

    # pixels are the same places, x to the right and y down from the upper left corner
    pixel = 0.12 / 120
    in_pixels = (expected[:, :2] * [1, -1] + 0.06) / pixel
    assert np.abs(found.xy - in_pixels)[is_through].max() * pixel < 1e-9


@pytest.mark.usefixtures("has_kernel")
def test_a_ball_over_a_display_is_the_closed_form():
    """Light through a ball lands on the display behind it as the
    formula for a ball has it, to 1e-9 m where it does not graze.
    """
    radius = 0.025
    ball = icosphere(radius, 5, centre=(0, 0, radius))
    rig = on_display(ball, gap=0.01, direction=(0.05, 0.1, -1))
    o, d = rays_of(rig)
    found = landed(rig, (o, d))

    p, along = through_ball(o - radius * Z, d, radius, N)
    expected = straight_down(p + radius * Z, along, -0.01)
    b = np.linalg.norm(np.cross(o - radius * Z, d), axis=1)
    arrives = (b < 0.9 * radius) & (np.abs(expected[:, :2]).max(axis=1) < 0.06) & (along[:, 2] < 0)
    assert arrives.sum() > 800
    assert (found.reason[arrives] == Reason.ARRIVED).all()
    assert np.abs(found.positions - expected)[arrives].max() < 1e-9


# glass that lies on the display


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("seed", range(6))
def test_touching_faces_are_robust_wherever_the_rig_stands(seed):
    """A slab on a display, turned anyhow and up to a metre away, with float32's rounding of
    places: all light arrives by one branch, to a millionth of a metre.
    """
    random = np.random.default_rng(seed)
    turn, shift = rotation(random), random.uniform(-1, 1, 3)
    rig = on_display(slab())
    o, d = rays_of(rig, 500)
    p, along = through_slab(o, d, Z, np.array([0, 0, THICK]), THICK, N)
    is_through = (np.abs(straight_down(o, d, THICK)[:, :2]).max(axis=1) < 0.039) & (
        np.abs(p[:, :2]).max(axis=1) < 0.039
    )
    expected = straight_down(p, along, 0) @ turn.T + shift

    found = landed(taken(rig, turn, 1.0, shift, np.float32), (o @ turn.T + shift, d @ turn.T))
    assert (found.reason[is_through] == Reason.ARRIVED).all()
    assert len(set(found.branch[is_through])) == 1
    assert np.abs(found.positions - expected)[is_through].max() < 1e-6


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("seed", range(3))
def test_light_turned_back_above_a_display_does_not_land(seed):
    """There is air between glass and display: light beyond the critical angle is turned back
    as it is where the display is a millimetre off, and goes the same way from there.
    """
    random = np.random.default_rng(seed)
    turn = rotation(random) if seed else np.eye(3)
    low = on_display(slab(0.05), direction=(1.0, 0.1, -0.15), side=0.4)
    # rays through a side face, to the bottom
    size = low.viewer.width, low.viewer.height
    o, d = low.viewer.rays(random.uniform(0, size, (2000, 2)))
    near = landed(taken(low, turn, dtype=np.float32), (o @ turn.T, d @ turn.T))
    far = landed(on_display(slab(0.05), gap=1e-3, direction=(1.0, 0.1, -0.15), side=0.4), (o, d))
    entry = o + ((-0.025 - o[:, 0]) / d[:, 0])[:, None] * d
    enters = (np.abs(entry[:, 1]) < 0.02) & (entry[:, 2] > 0.001) & (entry[:, 2] < 0.019)

    # so low a viewer sees no place of the bottom through a side face of such glass
    assert enters.sum() > 300
    assert not np.isin(near.reason[enters], [Reason.LOST_INSIDE, Reason.MISSED_PLATE]).any()
    assert (near.reason[enters] == far.reason[enters]).mean() > 0.97
    first = near.n_events[enters] >= 3
    assert first.all()


@pytest.mark.usefixtures("has_kernel")
def test_a_display_hides_the_glass_behind_it():
    """Glass behind a display that it touches is not met: light
    ends on the display's front, and on its back.
    """
    rig = on_display(box([0.08, 0.08, THICK], (0, 0, -THICK / 2)))
    front = landed(rig, rays_of(rig), only_through_glass=False)
    assert (front.reason == Reason.ARRIVED).all()
    assert np.abs(front.positions[:, 2]).max() < 1e-12

    back = replace(rig, displays=(replace(rig.display, mesh=rectangle(0 * X, Y, X, 0.12, 0.12)),))
    assert (landed(back, rays_of(rig), only_through_glass=False).reason == Reason.BLOCKED).all()


@pytest.mark.usefixtures("has_kernel")
def test_a_display_within_glass_is_seen_through_its_front_face_alone():
    """Glass that is cast around a display touches it: light needs no way out."""
    rig = on_display(box([0.08, 0.08, 2 * THICK]), direction=(1.0, 0.4, -0.9))
    o, d = rays_of(rig)
    top = straight_down(o, d, THICK)
    tangential = (d - d[:, 2:] * Z) / N
    into = tangential - np.sqrt(1 - (tangential**2).sum(axis=1, keepdims=True)) * Z
    expected = straight_down(top, into, 0)
    is_in = (np.abs(top[:, :2]).max(axis=1) < 0.04) & (np.abs(expected[:, :2]).max(axis=1) < 0.04)
    found = landed(rig, (o, d))
    assert is_in.sum() > 500
    assert (found.reason[is_in] == Reason.ARRIVED).all()
    assert np.abs(found.positions - expected)[is_in].max() < 1e-9


@settings(max_examples=10, deadline=None, database=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-9, 1e-8, 1e-5, 0.01]))
def test_both_ways_agree_on_glass_at_a_display(seed, gap):
    """Boxes and balls on a display, or near it, mirrors beside them: the kernel and numpy find
    the same landings and reasons.
    """
    random = np.random.default_rng(seed)
    meshes = [
        box(size := random.uniform(0.01, 0.03, 3), (*random.uniform(-0.02, 0.02, 2), size[2] / 2))
        for _ in range(2)
    ]
    radius = random.uniform(0.005, 0.02)
    meshes.append(icosphere(radius, 2, centre=(*random.uniform(-0.02, 0.02, 2), radius)))
    rig = on_display(meshes[0], gap=gap, direction=random.normal(size=3) - [0, 0, 2])
    rig = replace(
        rig,
        glasses=tuple(
            Glass(f"{k}", mesh, ConstantIndex(random.uniform(1.1, 2)), k)
            for k, mesh in enumerate(meshes)
        ),
        mirrors=(Mirror("m", rectangle(np.array([0.05, 0, 0.02]), Y, Z, 0.1, 0.04)),),
    )
    rays = rays_of(rig, 400, seed % 1000)
    how = {
        "only_through_glass": bool(random.random() < 0.5),
        "suppress_glare": float(random.random() < 0.5),
    }
    by_kernel = landed(rig, rays, **how)
    with loading.off():
        by_numpy = landed(rig, rays, **how)
    # of two glasses that stand side by side on one plane either may be named
    same = by_kernel.reason == by_numpy.reason
    same &= np.isclose(by_kernel.xy, by_numpy.xy, rtol=0, atol=1e-6, equal_nan=True).all(axis=1)
    assert same.mean() > 0.99  # rays along an edge


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("seed", range(4))
def test_water_in_a_tank_is_one_way_for_all_rays(seed):
    """Water touches the walls of its glass: light through wall, water and wall is on one
    branch, whichever of two faces in one place rounding puts first, and bent as by three slabs.
    """
    random = np.random.default_rng(seed)
    turn = rotation(random) if seed else np.eye(3)
    shift = random.uniform(-0.5, 0.5, 3) * bool(seed)
    outer, inner = box([0.1, 0.1, THICK], (0, 0, THICK / 2)), box([0.08, 0.08, 0.012], (0, 0, 0.01))
    hollow = Mesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.triangles, inner.triangles[:, ::-1] + len(outer.vertices)]),
    )
    rig = on_display(hollow, gap=0.01)
    water = Glass("water", inner, ConstantIndex(1.333))
    rig = replace(rig, glasses=(*rig.glasses, water))
    o, d = rays_of(rig, 500)

    p, along = straight_down(o, d, THICK), d
    for to, n1, n2 in ((0.016, 1, N), (0.004, N, 1.333), (0, 1.333, N), (-0.01, N, 1)):
        along = snell(along, Z, n1, n2)
        p = straight_down(p, along, to)
    found = landed(taken(rig, turn, 1.0, shift, np.float32), (o @ turn.T + shift, d @ turn.T))
    is_through = (np.abs(straight_down(o, d, 0)[:, :2]).max(axis=1) < 0.025) & (
        np.abs(straight_down(o, d, THICK)[:, :2]).max(axis=1) < 0.025
    )
    assert is_through.sum() > 200
    assert (found.reason[is_through] == Reason.ARRIVED).all()
    assert len(set(found.branch[is_through])) == 1
    expected = p @ turn.T + shift
    assert np.abs(found.positions - expected)[is_through].max() < (1e-6 if seed else 1e-9)


# words and settings


def without_plate(rig):
    """The same rig with its display where the plate shows it, and no plate."""
    aerial = rectangle(np.array([0, 0.05, 0]), X, Z, 0.2, 0.2)
    return replace(rig, plates=(), displays=(replace(rig.display, mesh=aerial),))


@pytest.mark.usefixtures("has_kernel")
def test_nobody_misses_a_plate_that_is_not_there():
    """No ray has that reason, whatever the setting says, which changes nothing."""
    rig = without_plate(ball_rig(2, pixels=32))
    found = landed(rig, rays_of(rig))
    other = landed(rig, rays_of(rig), only_through_plate=False)
    assert Reason.MISSED_PLATE not in found.reason
    assert (found.reason == Reason.ARRIVED).any()
    assert fingerprint(found) == fingerprint(other)


@pytest.mark.usefixtures("has_kernel")
def test_light_past_a_plate_counts_where_it_is_wanted():
    """A display behind the glass, in a rig that has a plate elsewhere: with Only Through Plate
    nothing arrives, without it all that arrives where there is no plate.
    """
    rig = ball_rig(2, pixels=32)
    far = replace(rig.plates[0], mesh=rectangle(np.array([9.0, 0, 0]), Y, Z, 0.1, 0.1))
    rig = replace(without_plate(rig), plates=(far,))
    rays = rays_of(rig)
    assert not landed(rig, rays).has_arrived.any()
    found = landed(rig, rays, only_through_plate=False)
    bare = landed(replace(rig, plates=()), rays)
    assert bare.has_arrived.sum() > 100
    assert np.array_equal(found.reason, bare.reason)
    assert np.allclose(found.xy, bare.xy, equal_nan=True, rtol=0, atol=1e-9)


@pytest.mark.usefixtures("has_kernel")
def test_light_beside_the_glass_comes_straight():
    """Where the settings look beside the glass, light straight from the display has a place."""
    rig = on_display(icosphere(0.015, 3, centre=(0, 0, 0.015)), gap=0.01, direction=(0, 0.1, -1))
    found = landed(rig, rays_of(rig), suppress_glare=1.0)
    light = run_steps(trace_stray_light(compile_plan(rig, Settings())))
    assert found.is_past_glass.sum() > 100
    assert light.seen_of(np.ones((120, 120, 3), np.float32)).share > 0.1


def test_a_rig_without_a_plate_is_solved():
    """Shares sum to one, the seen image is the picture, and no sentence knows of a plate."""
    rig = on_display(slab(), gap=0.005, pixels=64)
    rig.check()
    solution = run_steps(Session().solve(rig, Settings()))
    assert solution.picture_coverage > 0.999
    assert REASON_WORDS[Reason.MISSED_PLATE] not in solution.misses
    assert abs(solution.picture_coverage + sum(solution.misses.values()) - 1) < 1e-6
    wanted, seen = solution.first.ideal(), solution.seen()
    assert np.sqrt(((wanted - seen) ** 2).mean()) < 0.1
    assert not any("plate" in remark.sentence() for remark in solution.remarks)
    assert "mirror array" in solution.left_out
    assert not any("plate" in parameter.name for parameter in parameters(rig))


def test_a_dark_display_without_a_plate_speaks_of_no_plate():
    """The remedies name what is there."""
    rig = on_display(slab())
    for mesh, remedy in (
        (rectangle(9 * X, X, Y, 0.1, 0.1), "no ray reaches the display: move or enlarge it"),
        (rectangle(-0.01 * Z, Y, X, 0.2, 0.2), "turn the display's front to the rig"),
    ):
        turned = replace(rig, displays=(replace(rig.display, mesh=mesh),))
        with pytest.raises(RigError, match=remedy) as told:
            run_steps(Session().solve(turned, Settings()))
        assert "plate" not in str(told.value)
