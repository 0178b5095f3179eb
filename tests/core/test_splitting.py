"""Rays that split at half mirrors: some of the light goes on straight, some is reflected."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.image.glare import trace_stray_light
from kiriko.core.image.simulation import OTHER_PATH, simulate
from kiriko.core.light.compile_plan import MOST_COPIES, compile_plan
from kiriko.core.light.rays import main_landings
from kiriko.core.light.trace import recording, trace_all, tracing
from kiriko.core.native import loading
from kiriko.core.rig.rig import ConstantIndex, Glass, HalfMirror, Lens, Mirror, Retroreflector
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, rectangle

SETTINGS = Settings(only_through_glass=False, only_through_plate=False, max_events=40)
X, Y, Z = np.eye(3)


@pytest.fixture(params=["kernel", "numpy"])
def tracer(request):
    with nullcontext() if request.param == "kernel" else loading.off():
        yield request.param


def panes(n, up=Y + Z, kind=HalfMirror, **options):
    """A rig with n mirrors before its ball, one behind the other, at 45 degrees or as told."""
    mirrors = tuple(
        kind(f"pane {k}", rectangle((-0.5 + 0.1 * k) * Y, X, up, 0.2, 0.2), **options)
        for k in range(n)
    )
    fields = {HalfMirror: "half_mirrors", Mirror: "mirrors"}
    return replace(ball_rig(2, pixels=64), **{fields[kind]: mirrors})


def test_both_paths_are_those_of_no_pane_and_of_a_mirror(tracer):
    """A landing for each, with its share of the light, by its ray's number; the straight one of
    light that arrives is the main one.
    """
    a_rig = panes(1, reflectance=0.4, absorption=0.3)
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, 64, (3000, 2)))
    apart = [replace(a_rig, half_mirrors=()), panes(1, kind=Mirror)]
    straight, reflected = (trace_all(compile_plan(one, SETTINGS), o, d) for one in apart)
    plan = compile_plan(a_rig, SETTINGS)
    found = trace_all(plan, o, d)
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
    assert set(found.throughput) == {0.4, 0.3}


@pytest.mark.parametrize(
    ("prefers", "share"), [("brighter", 0.7), ("reflected", 0.3), ("transmitted", 0.7)]
)
def test_the_preferred_path_carries_the_picture_where_both_arrive(tracer, prefers, share):
    """Straight through a pane, or by the pane and a mirror over it, to one large display."""
    a_rig = panes(1, reflectance=0.3, prefers=prefers)
    wide = replace(a_rig.display, mesh=rectangle(Y, X, Z, 9, 9))
    side = Mirror("side", rectangle(-0.5 * Y + Z, X, Y + Z, 1, 1))
    a_rig = replace(a_rig, glasses=(), plates=(), displays=(wide,), mirrors=(side,))
    o, d = a_rig.viewer.rays(np.full((5, 2), 32.0) + np.arange(5)[:, None])
    found = trace_all(compile_plan(a_rig, SETTINGS), o, d)
    assert (found.has_arrived).sum() == 10
    np.testing.assert_allclose(main_landings(found, 5).throughput, share)


def test_paths_are_bounded(tracer):
    """Light to and fro between panes splits at each; no ray has more than eight paths, and none
    fainter than a ten-thousandth.
    """
    a_rig = panes(2, up=Z)
    close = rectangle(-0.4 * Y, X, 0.1 * Y + Z, 0.2, 0.2)
    a_rig = replace(a_rig, half_mirrors=(a_rig.half_mirrors[0], HalfMirror("b", close)))
    plan = compile_plan(a_rig, SETTINGS)
    found = trace_all(plan, *plan.viewer.rays(np.full((500, 2), 32.5)))
    assert (np.bincount(found.sample, minlength=500) <= 1 + MOST_COPIES).all()
    assert np.bincount(found.sample).max() > 3
    faint = replace(
        a_rig, half_mirrors=tuple(replace(m, reflectance=0.99) for m in a_rig.half_mirrors)
    )
    found = trace_all(compile_plan(faint, SETTINGS), *plan.viewer.rays(np.full((50, 2), 32.5)))
    assert found.throughput[found.has_arrived].min(initial=1) >= 1e-4


def test_a_path_is_that_of_the_main_landing(tracer):
    """The recorded hits of light that a pane reflects to the display lead to it, from the pane."""
    pane = HalfMirror("pane", rectangle(0 * X, X, Y - Z, 0.4, 0.4))
    base = ball_rig(2, pixels=64)
    down = replace(base.display, mesh=rectangle(-0.3 * Z, X, Y, 0.4, 0.4))
    a_rig = replace(base, glasses=(), plates=(), displays=(down,), half_mirrors=(pane,))
    plan = compile_plan(a_rig, SETTINGS)
    o, d = a_rig.viewer.rays(np.random.default_rng(1).uniform(0, 64, (50, 2)))
    steps = []
    main = main_landings(run_steps(tracing(plan, o, d, steps=steps)), 50)
    assert main.has_arrived.all()
    first, second = steps[:2]
    for step in (first, second):
        assert np.array_equal(np.sort(step.rays), np.arange(50))
    at = np.empty((2, 50, 3))
    for places, step in zip(at, (first, second), strict=True):
        places[step.rays] = step.place
    t = -(o[:, 1] + o[:, 2]) / (d[:, 1] + d[:, 2])  # the pane's plane: y + z = 0
    np.testing.assert_allclose(at[0], o + t[:, None] * d, atol=1e-12)
    np.testing.assert_allclose(at[1], main.positions, atol=1e-12)
    landings, courses = run_steps(recording(plan, o, d))
    assert len(courses) == len(landings.sample) == 100


def test_glass_that_reflects_shares_light_by_fresnel(tracer):
    """At one face the reflected light is 1 - T of the transmitted one's T, and lands where a mirror
    in that face sends it.
    """
    water = Glass("water", box([1, 1, 0.2], (0, 0, -0.1)), ConstantIndex(1.333), reflects=True)
    base = ball_rig(2, pixels=64)
    eye = replace(
        base.viewer,
        position=np.array([0, -1.0, 1]),
        axes=np.array([X, (Y + Z) / 2**0.5, (Y - Z) / 2**0.5]),
    )
    wall = replace(base.display, mesh=rectangle(Y + Z, X, Z, 3, 3))
    a_rig = replace(base, viewers=(eye,), glasses=(water,), plates=(), displays=(wall,))
    mirror = Mirror("face", rectangle(0 * X, X, Y, 1, 1))
    o, d = eye.rays(np.random.default_rng(2).uniform(0, 64, (200, 2)))
    found = trace_all(compile_plan(a_rig, SETTINGS), o, d)
    expected = trace_all(
        compile_plan(replace(a_rig, glasses=(), mirrors=(mirror,)), SETTINGS), o, d
    )
    assert expected.has_arrived.all()
    main = found.at(found.has_arrived & (found.n_events == 2))
    main = main.at(np.argsort(main.sample))
    assert np.array_equal(main.sample, np.arange(200))
    np.testing.assert_allclose(main.xy, expected.xy, atol=1e-6)
    c1 = -d[:, 2]
    c2 = np.sqrt(1 - (1 - c1**2) / 1.333**2)
    s = (c1 - 1.333 * c2) / (c1 + 1.333 * c2)
    p = (1.333 * c1 - c2) / (1.333 * c1 + c2)
    np.testing.assert_allclose(main.throughput, (s**2 + p**2) / 2, rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reflectance": 1.5}, "Reflectance 1.5: set it from 0 to 1"),
        ({"reflectance": 0.6, "absorption": 0.6}, "more light than it gets"),
        ({"prefers": "both"}, "prefers 'both'"),
    ],
)
def test_impossible_half_mirrors_are_one_sentence(options, words):
    with pytest.raises(RigError, match=words):
        panes(1, **options).check()


def test_half_mirrors_face_to_face_are_refused():
    """Light between two parallel ones that overlap would have no end; apart they are fine."""
    with pytest.raises(RigError, match="'pane 0' and 'pane 1' face each other"):
        panes(2, up=Z).check()
    a_rig = panes(1, up=Z)
    away = HalfMirror("b", rectangle(0.1 * Y + X, X, Z, 0.2, 0.2))
    replace(a_rig, half_mirrors=(*a_rig.half_mirrors, away)).check()


def test_glass_that_reflects_may_not_touch_the_display():
    """Its lower face and the display's front would be one place with two paths."""
    base = ball_rig(2, pixels=64)
    slab = Glass("slab", box([0.1, 0.1, 0.01], (0, 0, 0.005)), reflects=True)
    under = replace(base.display, mesh=rectangle(0 * Z, X, Y, 0.1, 0.1))
    a_rig = replace(base, glasses=(slab,), plates=(), displays=(under,))
    with pytest.raises(RigError, match="'slab' touches the display"):
        compile_plan(a_rig, SETTINGS)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_random_benches_have_the_same_light_with_and_without_the_kernel(seed):
    """Half mirrors, lenses, retroreflectors and glass that reflects, in random places."""
    dice = np.random.default_rng(seed)

    def sheet():
        right, up, _ = np.linalg.qr(dice.normal(size=(3, 3)))[0]
        size = dice.uniform(0.02, 0.2, 2)
        return rectangle(dice.uniform(-0.1, 0.1, 3), right, up, *size)

    a_rig = ball_rig(int(dice.integers(0, 3)), pixels=64)
    preference = ("brighter", "reflected", "transmitted")[dice.integers(3)]
    glasses = [replace(a_rig.glasses[0], reflects=bool(dice.integers(2)), prefers=preference)]
    a_rig = replace(
        a_rig,
        glasses=tuple(glasses[: dice.integers(2)]),
        half_mirrors=tuple(
            HalfMirror(f"half {k}", sheet(), dice.uniform(), 0.0, preference)
            for k in range(dice.integers(3))
        ),
        retroreflectors=tuple(Retroreflector("retro", sheet()) for _ in range(dice.integers(2))),
        lenses=tuple(Lens("lens", sheet(), dice.uniform(-1, 1)) for _ in range(dice.integers(2))),
        displays=(replace(a_rig.display, mesh=rectangle(0.3 * Y, X, Z, 2, 2)),),
    )
    plan = compile_plan(a_rig, replace(SETTINGS, brightness=bool(dice.integers(2))))
    rays = a_rig.viewer.rays(dice.uniform(0, 64, (300, 2)))
    found = []
    for context in (nullcontext, loading.off):
        with context():
            some = trace_all(compile_plan(a_rig, plan.settings), *rays)
            found.append(some.at(np.lexsort((some.branch, some.throughput.round(9), some.sample))))
    one, other = found
    # a copy too many or too few where rounding decides about an edge or a throughput
    n_one, n_other = (np.bincount(some.sample, minlength=300) for some in found)
    same = n_one == n_other
    assert same.mean() > 0.97
    one, other = (some.at(same[some.sample]) for some in found)
    is_same = (one.branch == other.branch) & (one.reason == other.reason)
    is_same |= (one.branch == 0) & (other.branch == 0)
    assert is_same.mean() > 0.97
    for name in ("xy", "throughput", "rank"):
        a, b = (getattr(some, name)[is_same].astype(float) for some in (one, other))
        off = np.abs(a - b)
        assert np.nanquantile(off, 0.97) < 1e-6 if np.isfinite(off).any() else True, name


def test_simulation_adds_up_all_paths_and_names_the_other():
    """A pane before a white display that fills the view: light arrives straight, and by a mirror
    over the pane; each path has its share of white.
    """
    a_rig = panes(1, reflectance=0.3)
    wide = replace(a_rig.display, mesh=rectangle(Y, X, Z, 9, 9), width=8, height=8)
    side = Mirror("side", rectangle(-0.5 * Y + Z, X, Y + Z, 1, 1))
    a_rig = replace(a_rig, glasses=(), plates=(), displays=(wide,), mirrors=(side,))
    plan = compile_plan(a_rig, SETTINGS)
    found = run_steps(simulate(plan, np.ones((8, 8, 3), np.float32), spp=2))
    np.testing.assert_allclose(found.image, 1.0, atol=1e-6)
    assert found.luminance[OTHER_PATH] == pytest.approx(0.3)
    split = run_steps(trace_stray_light(plan)).split_of(np.ones((8, 8, 3), np.float32))
    assert split == (pytest.approx(0.7), pytest.approx(0.3))


def test_among_equals_the_transmitted_light_carries_the_picture():
    """At the default reflectance both paths of a pane are as bright; one rule holds for all pixels,
    whatever number of mirrors the reflected light meets.
    """
    a_rig = panes(1)
    wide = replace(a_rig.display, mesh=rectangle(Y, X, Z, 9, 9))
    sides = tuple(
        Mirror(f"side {k}", rectangle(-0.5 * Y + Z + 0.02 * k * X, X, Y + Z, 0.02, 1))
        for k in range(-4, 5)
    )
    a_rig = replace(a_rig, glasses=(), plates=(), displays=(wide,), mirrors=sides)
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(8, 56, (200, 2)))
    main = main_landings(trace_all(compile_plan(a_rig, SETTINGS), o, d), 200)
    assert (main.n_events == 2).all()


def test_a_slanted_pane_near_the_display_does_not_touch_it():
    """Its box holds a part of the display, its faces do not lie on it."""
    base = ball_rig(2, pixels=64)
    pane = box([0.2, 0.003, 0.3])
    a = np.pi / 4
    turn = np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])
    slab = Glass("pane", replace(pane, vertices=pane.vertices @ turn), reflects=True)
    under = replace(base.display, mesh=rectangle(-0.08 * Z, X, Y, 0.1, 0.1))
    compile_plan(replace(base, glasses=(slab,), plates=(), displays=(under,)), SETTINGS)
