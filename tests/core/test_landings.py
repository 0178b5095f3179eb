"""A ray may have one landing, several or none, in any order: all that follows joins them by ray."""

from dataclasses import fields, replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.bench import picture_light
from kiriko.core.bench import picture_light as bench_light
from kiriko.core.image import glare, simulation, source_image
from kiriko.core.image.simulation import plate_view, simulate
from kiriko.core.image.source_image import splat
from kiriko.core.lab.calibrate import misalignment, visible_range
from kiriko.core.lab.calibrate.misalignment import Bench
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Landings, Reason, join, main_landings
from kiriko.core.light.trace import trace, trace_all, tracing
from kiriko.core.map import points
from kiriko.core.map.points import trace_points
from kiriko.core.map.sampling import sample
from kiriko.core.rig.rig import Mesh, MirrorArray
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import accuracy, tessellation
from known.reference_rigs import ball_rig, cube_rig, icosphere, rig
from known.work import drain

NAMES = [f.name for f in fields(Landings)]


def some_of(landings, which):
    return Landings(*(getattr(landings, name)[which] for name in NAMES))


def ghosts_of(landings):
    """Weaker landings of the same rays, elsewhere, by another way."""
    return replace(
        landings,
        branch=np.where(landings.branch != 0, landings.branch ^ np.uint64(0xABCDEF), 0),
        xy=landings.xy + 7.0,
        throughput=0.5 * landings.throughput,
    )


def lost(landings, is_lost):
    """The same landings, where some rays have none."""
    found = Landings(*(getattr(landings, name).copy() for name in NAMES))
    found.reason[is_lost] = Reason.MISSED_DISPLAY
    found.branch[is_lost] = 0
    found.throughput[is_lost] = found.n_events[is_lost] = found.plate_path[is_lost] = 0
    found.leak[is_lost] = -1
    for name in ("xy", "positions", "directions"):
        getattr(found, name)[is_lost] = np.nan
    return found


def shuffled(landings, seed=1):
    return some_of(landings, np.random.default_rng(seed).permutation(len(landings.sample)))


def strange(landings):
    """Nothing of rays that go to the left on the display, ghosts of every second
    other one, all of them shuffled.
    """
    is_lost = is_left(landings)
    every_second = some_of(ghosts_of(landings), (landings.sample % 2 == 0) & ~is_lost)
    return shuffled(join([some_of(landings, ~is_lost), every_second]))


def is_left(landings):
    return np.nan_to_num(landings.xy[:, 0], nan=np.inf) < 100.0


def plain(landings):
    """What `strange` comes to, one landing a ray."""
    return lost(landings, is_left(landings))


def traced_as(change):
    """A tracer whose landings are changed."""

    def changed(*some, **settings):
        return change((yield from tracing(*some, **settings)))

    return changed


def same(one, other):
    return all(
        np.array_equal(getattr(one, f.name), getattr(other, f.name), equal_nan=True)
        if isinstance(getattr(one, f.name), np.ndarray)
        else getattr(one, f.name) == getattr(other, f.name)
        for f in fields(one)
    )


def without_some(mesh):
    """An open mesh: light goes in and out by the gaps."""
    keep = np.arange(len(mesh.triangles)) % 17 != 0
    return Mesh(
        mesh.vertices, mesh.triangles[keep], mesh.corner_normals[keep], mesh.is_smooth[keep]
    )


def landings_of(a_rig, n=500, seed=0, **settings):
    viewer = a_rig.viewer
    at = np.random.default_rng(seed).random((n, 2)) * (viewer.width, viewer.height)
    return trace_all(compile_plan(a_rig, Settings(**settings)), *viewer.rays(at))


def test_one_landing_a_ray_in_order_is_left_as_it_is():
    """Landings of the tracer that has one for each ray are handed on, not copied."""
    landings = landings_of(ball_rig(2))
    assert main_landings(landings, 500) is landings


def test_the_main_landing_does_not_hang_on_the_order():
    """Permuted, doubled and missing landings give the strongest one a ray, in the rays' order."""
    landings = landings_of(ball_rig(2))
    assert 40 < is_left(landings).sum() < landings.has_arrived.sum()
    assert same(main_landings(shuffled(landings), 500), landings)
    assert same(main_landings(join([ghosts_of(landings), landings, landings]), 500), landings)
    for seed in range(3):
        assert same(main_landings(shuffled(strange(landings), seed), 500), plain(landings))


def test_no_landing_at_all_is_a_miss():
    """Rays without landings missed the display, each of them."""
    landings = main_landings(some_of(landings_of(ball_rig(2)), slice(0)), 3)
    assert (landings.sample == [0, 1, 2]).all()
    assert (landings.reason == Reason.MISSED_DISPLAY).all()
    assert np.isnan(landings.xy).all()
    assert not landings.branch.any()


@pytest.mark.numpy_alone
@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [
        ("branch", 5, 0),
        ("reason", Reason.ARRIVED, Reason.MISSED_DISPLAY),
        ("throughput", 0.6, 0.5),
    ],
)
def test_the_rule_says_which_is_the_main_one(name, better, worse):
    """A landing with a place, on the display, with more throughput."""
    landings = some_of(landings_of(ball_rig(2)), np.arange(2))
    landings.sample[:] = 0
    landings.branch[:] = 5
    landings.reason[:] = Reason.ARRIVED
    landings.throughput[:] = 0.5
    getattr(landings, name)[:] = better, worse
    # whatever counts less speaks for the other one
    if name != "throughput":
        landings.throughput[:] = 0.1, 0.9
    for both in (landings, some_of(landings, [1, 0])):
        assert getattr(main_landings(both, 1), name) == [better]


@pytest.mark.numpy_alone
def test_among_equals_the_first_is_the_main_one():
    """The order of landings is that of `Rays`, transmitted light first."""
    landings = some_of(landings_of(ball_rig(2)), np.zeros(2, int))
    landings.branch[:] = 6, 5
    assert main_landings(landings, 1).branch == [6]


def test_an_expected_branch_comes_first():
    """A landing on the branch that is asked for is taken, weaker though it is."""
    landings = some_of(landings_of(ball_rig(2)), np.full(2, 7))
    landings.sample[:] = 0
    landings.branch[:] = 8, 9
    landings.throughput[:] = 0.9, 0.1
    assert main_landings(landings, 1).branch == [8]
    assert main_landings(landings, 1, np.array([9], np.uint64)).branch == [9]
    assert main_landings(landings, 1, np.array([7], np.uint64)).branch == [8]


def test_points_have_the_landing_of_their_own_ray(monkeypatch):
    """Points in several chunks, whose landings are strange, are as with one landing each."""
    monkeypatch.setattr(points, "TRACED_AT_ONCE", 128)
    a_rig = ball_rig(2)
    plan = compile_plan(a_rig, Settings())
    view = np.random.default_rng(0).random((500, 2)) * a_rig.viewer.width

    found = []
    for change in (strange, plain):
        monkeypatch.setattr(points, "tracing", traced_as(change))
        work = trace_points(plan, view)
        n_rays = 0
        while True:
            try:
                n_rays += next(work)
            except StopIteration as end:
                found.append(end.value)
                break
        assert n_rays == 500

    assert np.isnan(found[0].xy[:, 0]).any()
    assert same(*found)


@pytest.mark.parametrize(
    ("a_rig", "is_chaotic"),
    [
        (cube_rig(pixels=64), False),
        (ball_rig(3, pixels=64), False),
        (rig(icosphere(0.025, 3, smooth=False), pixels=64, display=0.2), True),
    ],
    ids=["cube", "ball", "chaotic"],
)
def test_the_map_of_strange_landings_is_that_of_one_each(a_rig, is_chaotic, monkeypatch):
    """Cells, cut pixels, samples and their error are the same bit for bit, however many
    landings a ray has.
    """
    plan = compile_plan(a_rig, Settings())
    found = []
    for change in (strange, plain):
        monkeypatch.setattr(points, "tracing", traced_as(change))
        found.append(drain(sample(plan)))
    one, other = found
    assert same(one.points, other.points)
    assert len(one.triangles)
    assert bool(len(one.samples)) == is_chaotic
    assert same(replace(one, points=None), replace(other, points=None))


def test_the_bench_joins_landings_by_ray(monkeypatch):
    """Dots seen on a bench that is off, the light of its picture and its visible range are
    the same bit for bit.
    """
    a_rig = ball_rig(2)
    plan = compile_plan(a_rig, Settings())
    view = np.random.default_rng(0).random((40, 2)) * a_rig.viewer.width
    found = []
    few = replace(visible_range.SURVEY, n_steps=4, fine_rad=0.2)
    monkeypatch.setattr(visible_range, "SURVEY", few)

    for change in (strange, plain):
        for module in (misalignment, visible_range):
            monkeypatch.setattr(
                module, "trace_all", lambda *some, change=change: change(trace_all(*some))
            )
        monkeypatch.setattr(bench_light, "tracing", traced_as(change))
        bench = Bench(a_rig, Settings(), view)
        off = np.full(len(bench.parameters), 1e-3)
        found.append(
            [
                bench.seen(off),
                bench.sensitivity()[0],
                drain(visible_range.visible_range(plan)).share,
                drain(picture_light.spread_of(plan, np.eye(4))).across,
            ]
        )

    for one, other in zip(*found, strict=True):
        assert np.isfinite(one).any()
        assert np.array_equal(one, other, equal_nan=True)


def in_halves(landings):
    """Each ray has two landings in one place, with half of its light each, in any order."""
    half = replace(landings, throughput=0.5 * landings.throughput)
    return shuffled(join([half, half]))


@pytest.mark.numpy_alone
def test_a_ray_that_parts_in_halves_shows_the_same(monkeypatch):
    """The simulated image is that of whole rays, to rounding: all light of a ray counts."""
    plan = compile_plan(ball_rig(2, pixels=32), Settings())
    source = np.random.default_rng(0).random((512, 512, 3)).astype(np.float32)
    whole = drain(simulate(plan, source, 4))
    monkeypatch.setattr(simulation, "trace", lambda *a, **k: in_halves(trace(*a, **k)))
    halves = drain(simulate(plan, source, 4))
    assert whole.image.max() > 0.1
    assert np.allclose(halves.image, whole.image, rtol=1e-6, atol=1e-9)


def test_images_and_errors_join_landings_by_ray(monkeypatch):
    """Light beside the glass, the plate's brightness, splatted images, leaks and errors of the
    mesh are the same, to rounding, for landings in any order.
    """
    a_rig = ball_rig(2, pixels=32)
    array = replace(a_rig.plates[0], array=MirrorArray())
    opened = replace(a_rig.glasses[0], mesh=without_some(a_rig.glasses[0].mesh))
    plan = compile_plan(a_rig, Settings())
    by_array = compile_plan(replace(a_rig, plates=(array,)), Settings())
    open_plan = compile_plan(replace(a_rig, glasses=(opened,)), Settings())
    short = compile_plan(replace(a_rig, glasses=(opened,)), Settings(max_events=1))

    monkeypatch.setattr(accuracy, "FURTHER", 1)  # all that is cut off is caught
    found = []
    for change in (lambda landings: landings, shuffled):
        for module in (glare, accuracy, tessellation):
            monkeypatch.setattr(module, "tracing", traced_as(change))
        for module in (simulation, source_image):
            monkeypatch.setattr(
                module, "trace", lambda *a, change=change, **k: change(trace(*a, **k))
            )
        beside = run_steps(glare.trace_stray_light(plan))
        order = np.lexsort(beside.view.T)
        view = run_steps(plate_view(by_array))
        mesh = run_steps(tessellation.tessellation(plan))
        found.append([
            beside.view[order],
            beside.pixel[order],
            [view.brightness, view.blur],
            run_steps(splat(plan, 1)),
            run_steps(accuracy.leaks(open_plan)),
            [run_steps(accuracy.caught(short))],
            [mesh.order, mesh.undecided, mesh.jumps],
        ])  # fmt: skip
    for one, other in zip(*found, strict=True):
        assert np.any(one)
        assert np.allclose(one, other, rtol=1e-6, atol=1e-12)
