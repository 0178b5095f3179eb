"""The compiled kernel gives the results of numpy's way, one by one, and breaks on nothing."""

import ctypes
import re
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import build_kernel
from kiriko.core.base.arrays import frozen
from kiriko.core.base.steps import run_steps
from kiriko.core.glass import (
    curved,
    curved_hits,
    fitted_faces,
    native_fit,
    paraboloids,
    quartics,
)
from kiriko.core.glass.fitted_faces import RIDGE
from kiriko.core.glass.quartics import NODES
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.glass.vertices import Vertices
from kiriko.core.image import outline, picture, pyramid, source_image
from kiriko.core.image.picture import of_square
from kiriko.core.image.pyramid import Pyramid
from kiriko.core.image.source_image import Painting, find_filter_taps
from kiriko.core.light import (
    kernel_tracer,
    kernel_trees,
    layer_hits,
    media,
    near_misses,
    plate,
    ray_engine,
    trace,
)
from kiriko.core.light import rays as rays_module
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.light.near_misses import ThinParts
from kiriko.core.light.rays import DeferredObjectError, Landings, Rays, Reason
from kiriko.core.light.trace import recording, trace_all, tracing
from kiriko.core.map import borders, native_divide
from kiriko.core.map import cells as cells_module
from kiriko.core.map import rasterise as map_rasterise
from kiriko.core.map import shares as share_module
from kiriko.core.map.points import Paths, trace_points
from kiriko.core.map.shares import Lot, Shares
from kiriko.core.native import loading, structures
from kiriko.core.native.structures import STRUCTURES
from kiriko.core.rig.rig import Blocker, Glass, Mesh, MirrorArray, Picture, PicturePlace, Viewer
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.tessellation import _as_parabolic
from known.both_ways import find_parted
from known.rasterised import rasterise, to_display
from known.reference_rigs import (
    ball_rig,
    barrel,
    bottle,
    box,
    cube_rig,
    icosphere,
    lathed,
    mean_normals,
    rectangle,
    rig,
    torus,
    uv_ellipsoid,
    wavy_slab,
)

pytestmark = pytest.mark.skipif(loading.library() is None, reason="the kernel is switched off")

N_RAYS = 6000
DEFAULT = Settings()
PX = 1e-8  # display px: landings are the same but for rounding, which caustics make larger
CHAOTIC = 10  # events
EXACT = "reason", "branch", "n_events", "plate_path", "leak"


def rays_of(a_rig, n=N_RAYS, seed=0):
    viewer = a_rig.viewer
    return viewer.rays(np.random.default_rng(seed).random((n, 2)) * [viewer.width, viewer.height])


def both_ways(a_rig, some=DEFAULT, n=N_RAYS, light="imaged"):
    """Landings by numpy and by the kernel, of the same rays through the same curved faces."""
    rays = rays_of(a_rig, n)
    plan = compile_plan(a_rig, some)
    with loading.off():
        expected = trace_all(plan, *rays, light)
    assert "compiled kernel" in plan.used
    return expected, trace_all(plan, *rays, light)


def turned_ball():
    """A glass that was only moved, in the plan of the one before."""
    kept = MeshCache()
    mesh = icosphere(0.025, 3)
    compile_plan(rig(mesh), Settings(), kept)
    c = np.cos(0.3)
    s = np.sin(0.3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved = replace(
        mesh,
        vertices=mesh.vertices @ turn.T + [0.002, 0.001, -0.001],
        corner_normals=mesh.corner_normals @ turn.T,
    )
    plan = compile_plan(rig(moved), Settings(), kept)

    assert any(held.layer.motion is not None for held in plan.layers)
    return plan


def without_some(mesh):
    """An open mesh: light goes in and out by the gap."""
    keep = np.ones(len(mesh.triangles), bool)
    keep[::17] = False
    return Mesh(
        mesh.vertices, mesh.triangles[keep], mesh.corner_normals[keep], mesh.is_smooth[keep]
    )


def bent_facets(mesh):
    return replace(mesh, surface="facets")


def turned_vase(segments=32):
    """Narrow and wide by turns, as a lathe makes it."""
    height = np.linspace(-0.03, 0.03, 14)
    radius = 0.014 + 0.006 * np.sin(180 * height)
    radius[[0, -1]] = 0.0
    return lathed(radius, height, segments)


def with_blocker(a_rig):
    return replace(
        a_rig,
        blockers=(Blocker("card", rectangle([0, 0.03, 0.01], [1, 0, 0], [0, 0, 1], 0.02, 0.02)),),
    )


def two(*meshes):
    return rig(tuple(Glass(f"glass {i}", mesh) for i, mesh in enumerate(meshes)))


def by_threads(work, numbers=(1, 2, 7, 1000)):
    """Results of the same work by other numbers of threads."""
    found = []
    try:
        for number in numbers:
            loading.use_threads(number)
            found.append(work())
    finally:
        loading.use_threads(0)
    return found


def bits(found):
    """The bytes of all arrays in results."""
    if isinstance(found, np.ndarray):
        return found.tobytes()
    if is_dataclass(found):
        return [bits(getattr(found, f.name)) for f in fields(found)]
    return [bits(one) for one in found] if isinstance(found, (list, tuple)) else found


RIGS = {
    "ball": lambda: ball_rig(4),
    "cube": cube_rig,
    "ball as drawn": lambda: rig(bent_facets(icosphere(0.025, 4))),
    "flat ball": lambda: rig(icosphere(0.025, 3, smooth=False)),
    "torus": lambda: rig(torus(0.018, 0.007, 64, 32)),
    "torus, mean normals": lambda: rig(mean_normals(torus(0.018, 0.007, 64, 32))),
    "ellipsoid": lambda: rig(uv_ellipsoid([0.025, 0.015, 0.03])),
    "wavy slab": lambda: rig(wavy_slab()),
    "barrel": lambda: rig(barrel(0.02, 0.05, 0.003, 48, 24)),
    "lathed": lambda: rig(turned_vase()),
    "bottle as drawn": lambda: rig(bent_facets(bottle())),
    "open ball": lambda: rig(without_some(icosphere(0.025, 3))),
    "two balls": lambda: two(
        icosphere(0.015, 3, centre=(-0.016, 0, 0)), icosphere(0.015, 3, centre=(0.016, 0, 0))
    ),
    "ball in a box": lambda: two(box([0.06] * 3), icosphere(0.02, 3)),
    "boxes that touch": lambda: two(
        box([0.03] * 3, (-0.015, 0, 0)), box([0.03] * 3, (0.015, 0, 0))
    ),
    "boxes that overlap": lambda: two(
        box([0.04] * 3, (-0.01, 0, 0)), box([0.04] * 3, (0.01, 0.01, 0))
    ),
    "with a card": lambda: with_blocker(ball_rig(3)),
    "diamond": lambda: rig(box([0.03] * 3, degrees_about_z=31.0), ior=2.42),
}


def assert_same(expected, found, px=PX):
    """Landings are alike, but of light that is turned so
    often that of rounding it makes another path.
    """
    is_long = expected.n_events >= CHAOTIC
    for name in EXACT:
        differs = getattr(expected, name) != getattr(found, name)
        assert not differs[~is_long].any(), name
        assert differs.mean() < 1e-3, name
    assert np.array_equal(np.isnan(expected.xy[~is_long]), np.isnan(found.xy[~is_long]))
    for name, most in (("xy", px), ("positions", 1e-9), ("directions", 1e-9), ("throughput", 1e-9)):
        off = np.abs(getattr(expected, name) - getattr(found, name))[~is_long]
        assert np.quantile(np.nan_to_num(off), 0.999) < most, name


@pytest.mark.parametrize("name", RIGS)
def test_same_landings(name):
    """Same branch, reason and number of events of each ray.

    Landings to 1e-8 px in 99.9 %, on all kinds of rigs.
    """
    expected, found = both_ways(RIGS[name]())
    assert expected.has_arrived.mean() > 0.05
    assert_same(expected, found)


@pytest.mark.parametrize(
    "some",
    [
        {"brightness": True},
        {"only_through_glass": False},
        {"suppress_glare": 1.0},
        {"max_events": 3},
    ],
    ids=str,
)
@pytest.mark.parametrize("name", ["ball", "cube", "two balls"])
def test_same_landings_by_other_settings(name, some):
    """Brightness weighs paths alike.

    Light beside the glass, and light that is cut off, end alike.
    """
    assert_same(*both_ways(RIGS[name](), Settings(**some)))


@pytest.mark.parametrize("light", ["imaged", "folded", "reflected"])
def test_same_light_at_an_ideal_plate(light):
    """Whichever light is followed: it decides the fate of light that comes past the plate."""
    assert_same(*both_ways(ball_rig(3), Settings(only_through_glass=False), light=light))


def test_a_glass_that_was_only_moved():
    """Rays are taken to where its faces were made, and their normals back."""
    plan = turned_ball()
    rays = rays_of(plan.rig)
    found = trace_all(plan, *rays)
    with loading.off():
        assert_same(trace_all(plan, *rays), found)


def test_same_ways_and_courses():
    """The record of each event is the same; a ray leaves its course at the same event."""
    a_rig = rig(torus(0.018, 0.007, 64, 32))
    plan = compile_plan(a_rig, Settings())
    rays = rays_of(a_rig, 2000)

    ways = []
    words = []
    led = []
    for way in (loading.off(), nullcontext()):
        steps = []
        with way:
            run_steps(tracing(plan, *rays, steps=steps))
            words.append(run_steps(recording(plan, *rays))[1])
        ways.append(steps)

    assert np.array_equal(*words)
    assert len(ways[0]) == len(ways[1]) > 2
    for expected, found in zip(*ways, strict=True):
        for name in ("rays", "patch", "triangle", "left"):
            order = [
                np.argsort(step.rays if name != "left" else step.left) for step in (expected, found)
            ]
            of = [
                getattr(step, name)[at] for step, at in zip((expected, found), order, strict=True)
            ]
            assert np.array_equal(*of), name
        np.testing.assert_allclose(
            found.place[np.argsort(found.rays)],
            expected.place[np.argsort(expected.rays)],
            atol=1e-11,
        )

    other = np.roll(words[0], 1, axis=0)  # each ray on the course of another
    with loading.off():
        led.append(run_steps(tracing(plan, *rays, course=other)))
    led.append(run_steps(tracing(plan, *rays, course=other)))

    assert np.array_equal(led[0].branch, led[1].branch)
    assert 0 < (led[0].branch != 0).mean() < 1


def test_glass_aside_is_told():
    """A ray that comes near glass that is not in the plan is told by the same error."""
    a_rig = two(icosphere(0.015, 2), icosphere(0.01, 2, centre=(0, 0.05, 0)))
    plan = compile_plan(a_rig, Settings(), deferred=(1,))
    rays = rays_of(a_rig, 200)
    with pytest.raises(DeferredObjectError) as found:
        run_steps(tracing(plan, *rays))
    assert found.value.boxes == {0}


@pytest.mark.parametrize("moves", [False, True])
def test_paraboloids_over_facets(moves):
    """Light through paraboloids over a facetted torus lands at the same places.

    Where a ray slips between two of them, either way may find another face.
    """
    mesh = bent_facets(torus(0.02, 0.008, 24, 12))
    kept = MeshCache()
    compile_plan(rig(mesh), DEFAULT, kept)
    plan = compile_plan(rig(replace(mesh, vertices=mesh.vertices + 1e-3 * moves)), DEFAULT, kept)
    (held,) = (held for held in plan.layers if held.layer.has_engine)
    assert (held.layer.motion is not None) == moves
    layers = [
        replace(other, layer=_as_parabolic(plan, other)) if other is held else other
        for other in plan.layers
    ]
    changed = replace(plan, layers=tuple(layers))
    rays = rays_of(plan.rig)
    with loading.off():
        expected = trace_all(changed, *rays)
    found = trace_all(changed, *rays)
    is_same = (found.branch == expected.branch) & (found.branch != 0)
    assert is_same.sum() > 0.99 * (expected.branch != 0).sum() > 300
    assert np.nanmax(np.abs(found.xy - trace_all(plan, *rays).xy)[is_same]) > 1  # they bend light
    assert (np.abs(found.xy - expected.xy)[is_same].max(axis=1) < 1e-5).mean() > 0.99


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_random_rigs(seed):
    """Balls, boxes and tori of random sizes and places, apart,
    touching or overlapping, of random index: the same.
    """
    dice = np.random.default_rng(seed)
    makers = (
        lambda: icosphere(
            dice.uniform(0.005, 0.025), int(dice.integers(0, 4)), bool(dice.integers(2))
        ),
        lambda: box(dice.uniform(0.005, 0.05, 3), degrees_about_z=dice.uniform(0, 360)),
        lambda: torus(dice.uniform(0.01, 0.02), dice.uniform(0.002, 0.009), 24, 12),
    )
    meshes = [makers[dice.integers(3)]() for _ in range(dice.integers(1, 4))]
    meshes = [
        replace(mesh, vertices=mesh.vertices + dice.uniform(-0.03, 0.03, 3)) for mesh in meshes
    ]
    a_rig = replace(two(*meshes))
    glasses = tuple(replace(glass, ior=a_rig.glasses[0].ior) for glass in a_rig.glasses)
    expected, found = both_ways(
        replace(a_rig, glasses=glasses), Settings(brightness=bool(dice.integers(2))), 400
    )
    differs = (expected.branch != found.branch) | (expected.reason != found.reason)

    # light that is turned many times makes one rounding error into another path
    assert not differs[expected.n_events < 10].any()
    assert differs.mean() < 0.01
    same = ~differs & np.isfinite(expected.xy[:, 0])
    off = np.abs(expected.xy - found.xy)[same].max(axis=1, initial=0.0)

    assert (np.quantile(off, 0.98) < 1e-7) if len(off) else True


def spoilt_vase():
    """A mesh that contradicts itself."""
    mesh = turned_vase(12)
    noise = np.random.default_rng(3).normal(size=(len(mesh.vertices), 1))
    return replace(mesh, vertices=mesh.vertices * (1 + 0.03 * noise))


def far_spike(metres=5520.0):
    """A ball with flat faces, one vertex of which lies many metres aside."""
    mesh = icosphere(0.025, 2, smooth=False)
    vertices = mesh.vertices.copy()
    vertices[np.argmax(vertices[:, 0])] = [metres, 0.15 * metres, -0.76 * metres]
    return replace(mesh, vertices=vertices, corner_normals=None)


@pytest.mark.parametrize("make", [spoilt_vase, far_spike])
def test_where_ways_part_the_kernel_has_met_the_nearer_face(make):
    """Numpy's engine in float32 lets a ray through, or takes it to meet a face that it passes by:
    the kernel is right.
    """
    a_rig = rig(make())
    found = find_parted(compile_plan(a_rig, DEFAULT), *rays_of(a_rig, 20_000))
    assert 0 < found.n_parted < 1e-2 * found.n_rays
    assert found.n_wrong == 0


def behind_hull(plan):
    """The layer of curved faces."""
    (layer,) = (held.layer for held in plan.layers if held.layer.curved is not None)
    return layer


def test_a_ray_that_is_lost_behind_a_hull_has_all_faces_asked():
    """The tree over them is made when the first is lost, and all rays beside it go once more: the
    same landings, ways and courses to the bit as where the tree is there.
    """
    a_rig = rig(bottle())
    rays = rays_of(a_rig)

    def followed(plan):
        steps = []
        landings = run_steps(tracing(plan, *rays, steps=steps))
        return landings, steps, *run_steps(recording(plan, *rays))

    def made():
        return compile_plan(replace(a_rig, glasses=rig(bottle()).glasses), DEFAULT)

    plan = made()
    assert not kernel_trees.has_face_tree(behind_hull(plan))
    found = followed(plan)
    assert kernel_trees.has_face_tree(behind_hull(plan))
    recorded, courses = run_steps(recording(made(), *rays))

    landings, steps, of_recorded, of_courses = followed(plan)
    assert np.array_equal(courses, of_courses)
    for ours, theirs in ((found[0], landings), (recorded, of_recorded)):
        for f in fields(Landings):
            assert np.array_equal(getattr(ours, f.name), getattr(theirs, f.name), equal_nan=True)
    assert len(found[1]) == len(steps)
    for ours, theirs in zip(found[1], steps, strict=True):
        assert all(map(np.array_equal, ours, theirs))


NAN = np.nan
INF = np.inf
WILD = [
    [NAN] * 3,
    [INF, 0, 0],
    [0, 0, 0],
    [1e300, 1, 1],
    [0, -INF, NAN],
    [1e-320, 0, 0],
    [1e-308, 1e-308, 0],
    [0, 1, 0],
]


@pytest.mark.parametrize("name", ["ball", "cube", "open ball", "two balls", "barrel"])
def test_no_ray_breaks_it(name):
    """Rays that are none, infinitely far or without a direction end somewhere.

    Their neighbours are none the worse.
    """
    a_rig = RIGS[name]()
    plan = compile_plan(a_rig, Settings())
    o, d = rays_of(a_rig, len(WILD))
    expected = trace_all(plan, o, d)
    wild = np.array(WILD, float)
    mixed = np.concatenate([o, wild, o]), np.concatenate([d, d, wild])
    found = trace_all(plan, *mixed)
    assert np.isin(found.reason, list(Reason)).all()
    assert np.array_equal(found.xy[: len(o)], expected.xy, equal_nan=True)


ARRAYS = {
    "crossed": MirrorArray(crossing_error=0.002, phase=(0.3, -7.6)),
    "holes": MirrorArray(layout="holes", has_fresnel=False, phase=(0.1, 0.7)),
    "radial": MirrorArray(layout="radial", reflectance=0.9),
}


@pytest.mark.parametrize("light", ["imaged", "folded", "reflected"])
@pytest.mark.parametrize("layout", ARRAYS)
def test_plates_of_mirrors(layout, light):
    """Light crosses mirrors, or is reflected by the face, as by numpy's closed form.

    From either side.
    """
    a_rig = ball_rig(3, field=0.06)
    plates = (replace(a_rig.plates[0], array=ARRAYS[layout]),)
    some = Settings(brightness=True, only_through_glass=False)
    expected, found = both_ways(replace(a_rig, plates=plates), some, light=light)
    assert (expected.plate_path > 0).mean() > 0.3
    assert_same(expected, found)


@pytest.mark.parametrize("is_known", [True, False])
def test_a_plan_says_what_traces_its_rays(monkeypatch, is_known):
    """The kernel, however many events their ways and courses may have; numpy where there is a part
    that the kernel does not know.
    """
    if not is_known:
        monkeypatch.setattr(kernel_tracer, "KINDS", (0,))
    by_numpy = []
    by_events = trace.by_events
    monkeypatch.setattr(trace, "by_events", lambda *rays: by_numpy.append(rays) or by_events(*rays))
    a_rig = ball_rig(2, pixels=64)
    plan = compile_plan(a_rig, Settings(max_events=20_000))
    view = np.random.default_rng(0).uniform(0, 64, (300, 2))
    found = run_steps(trace_points(plan, view, paths=Paths(1.0)))
    run_steps(trace_points(plan, view, courses=[]))
    assert ("compiled kernel" in plan.used) == is_known
    assert ("compiled kernel (unsupported parts)" in plan.left_out) != is_known
    assert bool(by_numpy) != is_known
    with loading.off():
        expected = run_steps(trace_points(compile_plan(a_rig, Settings()), view))
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-6)


def test_a_library_of_another_version_is_not_used(monkeypatch):
    """Sizes of structures are compared when it is loaded: one that
    differs, is broken or missing is as good as none.
    """
    monkeypatch.setattr(loading, "MOST_LAYERS", 7)
    loading.loaded.cache_clear()
    try:
        assert loading.library() is None
        monkeypatch.undo()
        for path in (None, Path(__file__)):
            monkeypatch.setattr(loading, "find_library", lambda path=path: path)
            loading.loaded.cache_clear()
            assert loading.library() is None
            plan = compile_plan(ball_rig(1), Settings())
            assert "compiled kernel (not available)" in plan.left_out
    finally:
        monkeypatch.undo()
        loading.loaded.cache_clear()

    assert loading.library() is not None


def test_arrays_of_another_kind_are_not_written_to():
    """Where numpy's whole numbers are of 4 bytes, as on
    Windows before numpy 2, none are handed over.
    """
    plan = compile_plan(ball_rig(1), Settings())
    rays = Rays(*rays_of(plan.rig, 10), None, False)
    rays.leak = rays.leak.astype(np.int32)
    with pytest.raises(TypeError, match="leak is no array of int64"):
        kernel_tracer.state_of(rays)
    for name, dtype in kernel_tracer.STATE.items():
        assert getattr(Rays(*rays_of(plan.rig, 10), None, False), name).dtype == dtype


def test_masks_of_other_clusters_are_left_alone():
    """A far card makes the size of one place large: a box a
    micrometre beside others is another cluster's.
    """
    beside, *same = (box([0.02] * 3, (0, side * (0.01 + 5e-7), 0)) for side in [-1, *20 * [1]])
    far = Blocker("card", rectangle([0, 0, 1e7], [1, 0, 0], [0, 1, 0], 1.0, 1.0))
    expected, found = both_ways(replace(two(beside, *same), blockers=(far,)), n=500)
    assert (expected.n_events > 3).any()
    for name in EXACT:
        assert np.array_equal(getattr(expected, name), getattr(found, name)), name


# --- ends of branches ---


def some_edges(plan, n=400, seed=0):
    """Edges between places anywhere, of which each begins on a branch that its end is not on; some
    are likely to end on the way.
    """
    dice = np.random.default_rng(seed)
    view = dice.random((2 * n, 2)) * [plan.viewer.width, plan.viewer.height]
    points = run_steps(trace_points(plan, view))
    near = np.flatnonzero((points.branch[:n] != 0) & (points.branch[:n] != points.branch[n:]))
    courses = []
    run_steps(trace_points(plan, points.view[near], courses=courses))
    end = np.where(dice.random(len(near)) < 0.4, dice.uniform(0.01, 1, len(near)), 1.0)
    return points, borders.BorderEdges(near, near + n, np.concatenate(courses), end)


class Taken:
    """An allowance that no ray exceeds."""

    def take(self, view, n_rays):
        self.n_rays = n_rays


def ends_of(plan, points, edges):
    """Where branches end, the last points on them, and how many rays that took."""
    taken = Taken()
    found = run_steps(borders.last_on_branch(plan, points, edges, taken))
    return *found, taken.n_rays


def seen_in_parallel(a_rig):
    """By a viewer without perspective."""
    viewer = replace(a_rig.viewer, projection="orthographic", window=(-0.03, 0.03, -0.02, 0.025))
    return replace(a_rig, viewers=(viewer,))


ENDING = {
    **{name: RIGS[name] for name in ("ball", "cube", "open ball", "torus", "two balls")},
    "bottle": lambda: rig(bottle()),
    "in parallel": lambda: seen_in_parallel(ball_rig(4)),
}


@pytest.mark.parametrize("name", ENDING)
def test_same_ends_of_branches(name):
    """As by halves that are traced together: the same places by as many rays, where rounding does
    not decide.
    """
    plan = compile_plan(ENDING[name](), DEFAULT)
    points, edges = some_edges(plan)
    with loading.off():
        end, last, n_tried = ends_of(plan, points, edges)
    assert 0 < np.mean(n_tried == 1) < 0.5
    assert ((end > 0) & (end < 1)).mean() > 0.5

    found_end, found, found_tried = ends_of(plan, points, edges)
    same = found_end == end
    assert same.mean() > 0.99
    assert np.array_equal(found_tried[same], n_tried[same])
    assert np.array_equal(found.view[same], last.view[same])
    assert np.array_equal(found.branch, last.branch)
    # next to its end a branch grazes a face, where rounding grows
    off = np.abs(found.xy - last.xy)[same]
    assert np.quantile(off, 0.9) < PX
    assert off.max() < 1e-4
    np.testing.assert_allclose(found.throughput[same], last.throughput[same], rtol=1e-9)


# --- shares ---

VIEW = np.array([[0.0, 0.0], [1.0, 0.1], [1.2, 1.0], [0.1, 0.9]])  # of a cell, viewer px


def blobs(dice, shape, size=3.0):
    """Polygons of any shape about random places of a display, and beside it."""
    n, k = shape
    return dice.normal(size=(n, k, 2)) * size + dice.uniform(-2, 19, (n, 1, 2))


def lines(dice, shape, width):
    """Polygons squeezed to lines."""
    n, k = shape
    along = dice.normal(size=(n, k, 1)) * dice.normal(size=(n, 1, 2))
    return 6 * along + dice.uniform(0, 17, (n, 1, 2)) + width * dice.normal(size=(n, k, 2))


def spoilt(dice, polygons, value, part=0.1):
    """Polygons some of whose coordinates are another value."""
    return np.where(dice.random(polygons.shape) < part, value, polygons)


NASTY = {
    **{
        f"of {size:g} px": lambda dice, shape, size=size: blobs(dice, shape, size)
        for size in (1e-9, 0.02, 1, 40)
    },
    **{
        f"huge, {size:g} px": lambda dice, shape, size=size: blobs(dice, shape, size)
        for size in (1e4, 1e14, 1e300)
    },
    **{
        f"thin, {width:g} px": lambda dice, shape, width=width: lines(dice, shape, width)
        for width in (0, 1e-8, 1e-5)
    },
    "on the grid": lambda dice, shape: np.round(blobs(dice, shape)),
    "level, on the grid": lambda dice, shape: blobs(dice, shape) * [1, 0] + [0, 5],
    "upright": lambda dice, shape: blobs(dice, shape) * [0, 1] + [5.3, 0],
    "points": lambda dice, shape: blobs(dice, shape)[:, :1].repeat(shape[1], axis=1),
    "two corners alike": lambda dice, shape: blobs(dice, shape)[:, [0, 0, *range(2, shape[1])]],
    "one corner far away": lambda dice, shape: (
        blobs(dice, shape) * np.array([1e7, 1, 1, 1])[: shape[1], None]
    ),
    "of all scales": lambda dice, shape: (
        blobs(dice, shape) * 10.0 ** dice.uniform(-30, 20, (*shape, 2))
    ),
    "no numbers": lambda dice, shape: spoilt(dice, blobs(dice, shape), np.nan),
    "infinite": lambda dice, shape: spoilt(dice, spoilt(dice, blobs(dice, shape), np.inf), -np.inf),
}


def by_cell_and_pixel(shares, n_cells):
    """Cell and pixel, area, display area, middle and covariance of
    shares, whose throughput is the cell's number.

    Two triangles of one quad that lie in one pixel count as one.
    """
    n_pixels = int(np.prod(shares.display_size))
    assert shares.throughput.max(initial=0) < n_cells
    key, which = np.unique(shares.throughput * n_pixels + shares.display_index, return_inverse=True)
    area, display_area = (
        np.bincount(which, values) for values in (shares.area, shares.display_area)
    )
    values = np.concatenate([shares.view_xy.T, shares.covariance])

    return (
        key,
        area,
        display_area,
        np.stack([np.bincount(which, shares.area * row) for row in values]) / area,
    )


def assert_same_shares(size, view, polygons):
    """Numpy's way, cell by cell, and the kernel divide cells
    alike: areas to 1e-12 of the cell, places to 1e-10 of it.

    A centroid is a quotient of areas, and so as exact as these
    are to the share. Covariances are single, 1e-4.
    """
    n = len(polygons)
    number = np.arange(float(n))
    with loading.off(), np.errstate(invalid="ignore", over="ignore"):
        parts = [
            rasterise(size, (2, 2), *(a[i : i + 1] for a in (view, polygons, number)))
            for i in range(n)
        ]

    expected = share_module.joined(parts)
    found = rasterise(size, (2, 2), view, polygons, number)
    (key, *of_numpy), (other, *of_kernel) = (
        by_cell_and_pixel(some, n) for some in (expected, found)
    )
    both, here, there = np.intersect1d(key, other, return_indices=True)
    for keys, area in ((key, of_numpy[0]), (other, of_kernel[0])):
        assert area[~np.isin(keys, both)].max(initial=0) < 1e-12
    area, display_area, values = (a[..., here] for a in of_numpy)
    np.testing.assert_allclose(of_kernel[0][there], area, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        of_kernel[1][there], display_area, rtol=1e-9, atol=1e-12 * display_area.max(initial=0)
    )
    off = np.abs(of_kernel[2][:, there] - values) * area

    assert off[:2].max(initial=0) < 1e-10
    np.testing.assert_allclose(off[2:], 0, atol=1e-4 * np.abs(values[2:] * area).max(initial=1))
    return found


@pytest.mark.parametrize("k", [3, 4])
@pytest.mark.parametrize("name", NASTY)
def test_same_shares(name, k):
    """Of triangles and quads, folded or not, thin, on grid
    lines, larger than the display or not there at all.
    """
    dice = np.random.default_rng(11)
    view = VIEW[:k] + dice.normal(size=(120, k, 2)) * 0.05
    found = assert_same_shares((17, 11), view, NASTY[name](dice, (120, k)))
    assert len(found) or name.startswith("huge")


def test_same_coverage():
    """Each viewer pixel has the sums of the shares that lie in it, or are nearest to it,
    whichever way.
    """
    dice = np.random.default_rng(4)
    n = 500
    places = np.concatenate([dice.uniform(-2, 9, (n - 3, 2)), [[7, 5], [0, 0], [-0.0, 4.999]]])
    shares = Shares(
        (3, 2), (7, 5), dice.integers(0, 6, n), places, np.zeros((3, n), np.float32),
        dice.random(n) / n, dice.random(n) / n,
    )  # fmt: skip

    def found():
        coverage = share_module.Coverage((3, 2), (7, 5))
        coverage.add(shares)
        return coverage.of_view

    by_kernel = found()
    with loading.off():
        np.testing.assert_allclose(by_kernel, found(), rtol=1e-14)
    assert by_kernel.sum() == pytest.approx(shares.area.sum(), rel=1e-12)


@pytest.mark.parametrize("k", [3, 4])
def test_same_polygons_across_an_outline(k):
    """Those on both sides of it are told apart from those that touch it, lie within it, beside
    it, or at one of its corners beside it.
    """
    dice = np.random.default_rng(5)
    lines = np.array([[1.0, 0, -2], [-1, 0, 6], [0, 1, -2], [0.6, -0.8, 3]])
    somewhere = dice.uniform(0, 8, (400, 1, 2)) + dice.uniform(-1, 1, (400, k, 2))
    on_grid = dice.integers(0, 8, (400, 1, 2)) + VIEW[None, :k]
    view = np.concatenate([somewhere, on_grid, on_grid + 1e-7])
    found = outline._across(lines, view)
    with loading.off():
        np.testing.assert_array_equal(found, outline._across(lines, view))
    assert 100 < len(found) < 700


@settings(max_examples=200)
@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=8, max_size=8))
def test_no_polygon_breaks_it(corners):
    """Whatever floats its corners are on both images: its shares lie on the display."""
    view, display = np.array(corners).reshape(2, 1, 4, 2)
    for polygons in (display, np.clip(np.nan_to_num(display), -9, 9)):
        for k in (3, 4):
            found = rasterise((5, 4), (2, 2), view[:, :k], polygons[:, :k])
            assert ((found.display_index >= 0) & (found.display_index < 20)).all()
            assert (found.area > 0).all()


@pytest.mark.parametrize("size", [(1300, 40), (40, 1300), (200_000, 3)])
def test_shares_for_which_there_is_no_room(monkeypatch, size):
    """Where room ends, within a cell or a row of it, is gone
    on: bit for bit the same as with room for all.
    """
    width, height = size
    quads = np.array(
        [
            [[-0.2, -0.3], [1.1, -0.1], [0.9, 1.2], [0.1, 1.1]],
            [[0.1, 0.1], [0.9, 0.8], [0.9, 0.1], [0.1, 0.8]],
        ]
    )
    quads = np.concatenate([quads * size, np.full((1, 4, 2), np.nan), 1.4 * VIEW[None]])
    view = np.broadcast_to(VIEW, quads.shape)
    throughput = np.array([0.5, 0.25, 1.0, 2.0])
    whole = rasterise(size, (2, 2), view, quads, throughput)

    assert len(whole) > 0.8 * width * height
    monkeypatch.setattr(native_divide, "LEAST_CAPACITY", 0)
    for at_once in (1000, 257):
        monkeypatch.setattr(map_rasterise, "SHARES_AT_ONCE", at_once)
        parts = [
            part for _, part in share_module.divided(size, (2, 2), [Lot(view, quads, throughput)])
        ]
        assert max(map(len, parts)) <= at_once
        assert len(parts) > len(whole) / at_once
        found = share_module.joined(parts)
        for f in fields(found):
            assert np.array_equal(getattr(found, f.name), getattr(whole, f.name)), f.name

    monkeypatch.setattr(map_rasterise, "SHARES_AT_ONCE", 7)
    lot = Lot(view, quads / size * [40, 30], throughput)
    few = [part for _, part in share_module.divided((40, 30), (2, 2), [lot])]
    assert max(map(len, few)) <= 7
    assert sum(map(len, few)) == len(
        rasterise((40, 30), (2, 2), view, quads / size * [40, 30], throughput)
    )


def test_lots_that_nobody_asks_for_are_left():
    """They are let go of when no thread is at them."""
    size = 300, 200
    quads = VIEW[None] * size * np.linspace(0.2, 1, 9)[:, None, None]
    lots = [(np.broadcast_to(VIEW, quads.shape), quads)] * 6

    parts = native_divide.divided(size, lots, 1 << 18, False)
    left = parts.gi_frame.f_locals["begun"]._left
    assert left.alive
    del parts
    assert not left.alive


def test_several_images_are_added_to_side_by_side():
    """By numbers of pixels, narrow and wide, and by places, by any number of threads."""
    random = np.random.default_rng(9)
    places = random.uniform(-1, 9, (50, 2))
    index = np.clip(places[:, 1].astype(int), 0, 4) * 8 + np.clip(places[:, 0].astype(int), 0, 7)
    expected = np.ones((3, 5, 8))
    weights = random.normal(size=(3, 50))
    for image, some in zip(expected, weights, strict=True):
        np.add.at(image.reshape(-1), index, some)

    def added():
        images = np.ones((3, 5, 8))
        where = index.astype(np.int32), index.astype(np.int64), places
        native_divide.add(*zip(images, where, weights, strict=True))
        return images

    assert all(np.array_equal(images, expected) for images in by_threads(added))
    native_divide.add((expected[:0, :0, 0], places, np.ones(50)))  # an image without pixels


def test_a_display_of_more_pixels_than_an_int32_counts():
    """The pixel's number is as large as it has to be."""
    size = 70_000, 70_000
    found = assert_same_shares(size, VIEW[None], VIEW[None] + 69_998.4)
    assert found.display_index.dtype == np.int64
    assert found.display_index.max() == 70_000**2 - 1


# --- near misses of rays ---


def some_parts(dice, n):
    """Triangles of all sizes, some without area, in patches and parts."""
    at = dice.uniform(-1, 1, (n, 1, 3))
    corners = at + dice.normal(size=(n, 3, 3)) * 10 ** dice.uniform(-3, -0.5, (n, 1, 1))
    is_flat = dice.random(n) < 0.05
    corners[is_flat, 2] = corners[is_flat, 1]
    corners[:3, 1] = corners[:3, 0]
    part = np.sort(dice.integers(0, 5, n))
    return ThinParts(corners, part * 3 + dice.integers(0, 3, n), part)


def some_bundles(dice, n, k, m, n_patches=15):
    """Rays that run side by side for some events, then part, leave or are nowhere."""
    way = np.cumsum(dice.normal(size=(n, 1, m + 1, 3)) * 0.7, axis=2)
    places = way + dice.normal(size=(n, k, m + 1, 3)) * 10 ** dice.uniform(-3, 0, (n, 1, 1, 1))
    met = np.broadcast_to(dice.integers(0, n_patches, (n, 1, m)), (n, k, m)).astype(np.int32)
    other = dice.random((n, k, m)) < 0.01
    met[other] = dice.integers(-1, n_patches, other.sum())
    ends = np.maximum.accumulate(met < 0, axis=2)
    met[ends] = -1
    # a ray that has left is nowhere from the next event on
    places[:, :, 2:][ends[:, :, :-1]] = np.nan
    rays = dice.permutation(n * k)  # bundles share no order with the tables
    order = np.argsort(rays)
    places, met = places.reshape(n * k, m + 1, 3)[order], met.reshape(n * k, m)[order]
    return places, met, rays.reshape(n, k)


@pytest.mark.parametrize("k", [1, 16, 25])
@pytest.mark.parametrize("n_triangles", [4, 300, 5000])
def test_same_bundles_pass_by(n_triangles, k):
    """Those that come near a patch that none of their rays met, by any number of threads."""
    dice = np.random.default_rng(n_triangles + k)
    parts = some_parts(dice, n_triangles)
    bundles = some_bundles(dice, 1500, k, 4, len(parts._unit_of_patch))
    with loading.off(), np.errstate(invalid="ignore"):
        expected = run_steps(parts.touch(*bundles))
    assert 0.004 < expected.mean() < 0.98
    for found in by_threads(lambda: run_steps(parts.touch(*bundles)), (1, 3)):
        assert np.array_equal(found, expected)


@settings(max_examples=100)
@given(
    st.lists(st.floats(), min_size=3 * 9, max_size=3 * 9),
    st.lists(st.floats(), min_size=18, max_size=18),
)
def test_no_bundle_breaks_it(corners, places):
    """Whatever floats places and corners are, and patches that are not there."""
    with np.errstate(all="ignore"):
        parts = ThinParts(
            np.array(corners).reshape(3, 3, 3), np.array([0, 1, 1]), np.array([0, 0, 1])
        )._of_kernel
    for met in ([[0, 1], [1, -1]], [[9, -5], [0, 1]]):
        bundles = np.array(places).reshape(2, 3, 3), np.array(met, np.int32), np.array([[0, 1]])
        assert len(run_steps(parts.touch(*bundles, 1.0))) == 1


# --- painting ---


def shares_of(dice, n, display_size=(40, 30), view_size=(64, 64), index_type=np.int32):
    """Shares at random places, some beside the viewer's image.

    Of any size and shape, points and squares among them.
    """
    a, b = dice.normal(size=(2, 2, n)) * 10 ** dice.uniform(-3, 1, n)
    covariance = np.stack([a[0] ** 2 + b[0] ** 2, a[0] * a[1] + b[0] * b[1], a[1] ** 2 + b[1] ** 2])
    covariance[:, ::7] = 0
    covariance[:, ::11] = of_square(2.0)
    area = np.where(dice.random(n) < 0.1, 0, dice.uniform(0, 1, n))
    return Shares(
        display_size,
        view_size,
        dice.integers(0, display_size[0] * display_size[1], n).astype(index_type),
        dice.uniform(-8, 72, (n, 2)),
        covariance.astype(np.float32),
        area,
        np.ones(n),
        dice.uniform(0, 1, n),
    )


def viewer_of(projection):
    axes = np.eye(3)[[0, 2, 1]]
    half = 0.05 if projection == "perspective" else 0.06
    return Viewer("v", projection, np.array([0, -1.0, 0]), axes, (-half, half, -half, half), 64, 64)


PICTURES = {
    "the viewer's own": None,
    "turned": rectangle([0.005, 0.01, 0.003], [0.6, 0.8, 0], [0, 0.1, 1], 0.09, 0.07),
    "small": rectangle([0.005, 0.01, 0.003], [1, 0, 0.3], [-0.3, 0, 1], 0.01, 0.02),
    "behind": rectangle([0, -2, 0], [1, 0, 0], [0, 0, 1], 0.1, 0.1),
    "up to the horizon": rectangle([0, 0, 0.02], [1, 0, 0], [0, 1, 0], 3.0, 3.0),
}


def painted(a_picture, viewer, shares):
    """Sums of a painting (3, H, W)."""
    painting = Painting(shares.display_size)
    filter_taps = find_filter_taps(a_picture.place, viewer, shares)
    painting.add(Pyramid(a_picture.image), filter_taps)
    return painting._total


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("place", PICTURES)
@pytest.mark.parametrize("shape", [(64, 64), (1, 7), (5, 1), (1, 1), (33, 50)])
def test_same_painting(shape, place, projection):
    """Of any picture that is flat, from any side, the sums are
    numpy's to single precision, 1e-6 of the weight.
    """
    dice = np.random.default_rng(12)
    a_picture = Picture("p", dice.random((*shape, 4)).astype(np.float32), PICTURES[place])
    viewer = viewer_of(projection)
    for index_type in (np.int32, np.int64):
        shares = shares_of(dice, 3000, index_type=index_type)
        for some in (shares, replace(shares, throughput=None)):
            with loading.off():
                expected = painted(a_picture, viewer, some)
            found = painted(a_picture, viewer, some)
            np.testing.assert_allclose(
                found, expected, rtol=0, atol=1e-6 * to_display(some, np.ones(3000)).max()
            )

    unseen = {
        "perspective": "behind",
        "orthographic": "up to the horizon",
    }  # which is edge-on there

    assert (expected.max() > 0.1) == (place != unseen[projection])


@pytest.mark.parametrize("shape", [(64, 64), (1, 7), (5, 1), (1, 1), (33, 50)])
def test_taps_that_are_kept_paint_the_same_bits(shape):
    """The first painting keeps them, the next ones use them; of another picture, too, whose rows
    lie the other way round in memory; wild shares have none.
    """
    dice = np.random.default_rng(16)
    image, other = dice.random((2, *shape, 4)).astype(np.float32)
    place = PicturePlace("p", shape[1], shape[0], PICTURES["turned"])
    viewer = viewer_of("perspective")
    shares = shares_of(dice, 20_000, (200, 100))
    shares.display_index[::9] = dice.choice([-1, 20_000, 2**31 - 1], len(shares.display_index[::9]))
    shares.view_xy[::17] = NAN
    filter_taps = find_filter_taps(place, viewer, shares)

    for pixels in (image, image, other, frozen(other[::-1].copy()[::-1])):
        kept, alone = Painting(shares.display_size), Painting(shares.display_size)
        kept.add(Pyramid(pixels), filter_taps, are_kept=True)
        alone.add(Pyramid(pixels), find_filter_taps(place, viewer, shares))
        assert alone._total.any()
        assert kept._total.tobytes() == alone._total.tobytes()
        assert 0 < filter_taps.n_bytes < INF


@pytest.mark.parametrize("shape", [(64, 48), (2, 2), (6, 9)])
def test_same_pixels(shape):
    """Halving, division by weights and decoding: numpy's, bit for bit."""
    dice = np.random.default_rng(17)
    image = dice.random((*shape, 4)).astype(np.float32)
    total, weight = dice.random((3, *shape)), dice.random(shape) - 0.5

    def all_of_them():
        halved = Pyramid(image).levels[1:]
        sums = Painting(shape[::-1])
        sums._total[:] = total
        return [*halved, sums.finished(np.maximum(weight, 0))]

    with loading.off():
        expected = all_of_them()
    for found, of_numpy in zip(all_of_them(), expected, strict=True):
        assert found[..., :3].tobytes() == of_numpy[..., :3].tobytes()


@pytest.mark.parametrize("place", PICTURES)
def test_no_share_breaks_the_painting(place):
    """Whatever is in one share, on which pixel it may be: other pixels are none the worse."""
    dice = np.random.default_rng(14)
    a_picture = Picture("p", dice.random((33, 50, 4)).astype(np.float32), PICTURES[place])
    shares = shares_of(dice, 4000)
    viewer = viewer_of("perspective")
    expected = painted(a_picture, viewer, shares)
    wild = [NAN, INF, -INF, 1e300, -1e300, 1e38, 1e-320, -1.0]
    which = np.arange(0, 4000, 5)

    for name in ("view_xy", "covariance", "area", "throughput"):
        values = getattr(shares, name).copy()
        rows = values.T if name == "covariance" else values
        with np.errstate(over="ignore"):
            rows[which] = dice.choice(wild, rows[which].shape)
        found = painted(a_picture, viewer, replace(shares, **{name: values}))
        is_met = np.zeros(40 * 30, bool)
        is_met[shares.display_index[which]] = True
        others = ~is_met.reshape(30, 40)
        assert others.any()
        assert np.array_equal(found[:, others], expected[:, others])

    index = shares.display_index.copy()
    index[which] = dice.choice([-1, 1200, 2**31 - 1, -(2**31)], len(which))
    left = replace(shares, area=np.where(np.isin(np.arange(4000), which), 0, shares.area))
    found = painted(a_picture, viewer, replace(shares, display_index=index))

    assert np.array_equal(found, painted(a_picture, viewer, left))


def shaken(mesh, by):
    """Vertices moved by up to a part of the mesh's size."""
    at = mesh.vertices + by * np.ptp(mesh.vertices) * np.random.default_rng(5).uniform(
        -1, 1, mesh.vertices.shape
    )
    return mean_normals(replace(mesh, vertices=at))


def with_twin_vertices(mesh):
    """Two neighbours in one place."""
    at = mesh.vertices.copy()
    a, b = mesh.triangles[7, :2]
    at[a] = at[b]
    return replace(mesh, vertices=at)


MESHES = {
    "ball": lambda: icosphere(0.025, 4),
    "ball, mean normals": lambda: mean_normals(icosphere(0.025, 4)),
    "torus, mean normals": lambda: mean_normals(torus(0.018, 0.007, 64, 32)),
    "ellipsoid of a hundred to a pole": lambda: mean_normals(uv_ellipsoid(0.025, 100, 50)),
    "barrel": lambda: barrel(0.02, 0.05, 0.003, 48, 24),
    "lathed": lambda: mean_normals(turned_vase()),
    "open ball": lambda: without_some(icosphere(0.025, 4)),
    "shaken ball": lambda: shaken(icosphere(0.025, 4), 0.002),
    "badly shaken ball": lambda: shaken(icosphere(0.025, 3), 0.05),
    "twin vertices": lambda: with_twin_vertices(icosphere(0.025, 3)),
}


@pytest.mark.parametrize("name", MESHES)
def test_same_curved_faces(name):
    """Of the same triangles.

    Points to 1e-10 of the mesh's size, normals to the rest when sweeps end, 1e-10.
    """
    mesh = MESHES[name]()
    with loading.off():
        expected = make_surface(mesh).curved
    found = make_surface(mesh).curved
    assert (found.row == expected.row).all()
    for curved_faces in (found, expected):
        assert len(curved_faces.coefficients)
    points, others = (faces.points_on(3) for faces in (found, expected))
    np.testing.assert_allclose(points, others, rtol=0, atol=1e-10 * np.ptp(mesh.vertices))
    np.testing.assert_allclose(found.vertex_normal, expected.vertex_normal, rtol=0, atol=2e-10)


@settings(max_examples=100)
@given(st.integers(0, 2**32), st.floats(), st.floats())
def test_no_vertex_breaks_the_fit(seed, one, other):
    """Whatever floats stand for places, normals and sizes: only the wanted results are written."""
    dice = np.random.default_rng(seed)
    n, n_pairs = 9, 40
    start = np.sort(dice.integers(0, n, n_pairs))
    end = dice.integers(0, n, n_pairs)
    first = np.searchsorted(start, np.arange(n + 1))
    places, normals, axis_x, axis_y = (
        spoilt(dice, dice.normal(size=(n, 3)), one) for _ in range(4)
    )
    size = spoilt(dice, dice.random(n), other)
    coefficients = spoilt(dice, dice.normal(size=(n, 14)), other)
    v = Vertices(
        places, normals, dice.random(n) < 0.8, np.empty((0, 3), np.int64), start, end, first
    )
    fit = native_fit.Fit(v, (axis_x, axis_y), size, dice.random(n) < 0.3)
    wanted = dice.random(n) < 0.5
    before = coefficients.copy()
    settled = normals.copy()
    fit.fit_fields(wanted, RIDGE, coefficients)
    run_steps(fit.settle_normal_steps(wanted, RIDGE, settled, 5, 1e-10))
    for values, others in ((coefficients, before), (settled, normals)):
        assert np.array_equal(values[~wanted], others[~wanted], equal_nan=True)

    assert np.array_equal(coefficients[:, :2], before[:, :2], equal_nan=True)
    corner = dice.integers(0, n, (6, 3))
    assert fit.find_offsets(coefficients, NODES, NODES, corner).shape == (12, 3, 6)


def landings_by_plan():
    plan = compile_plan(rig(bent_facets(bottle())), DEFAULT)
    return lambda: trace_all(plan, *rays_of(plan.rig))


def ends_by_plan():
    plan = compile_plan(rig(bottle()), DEFAULT)
    points, edges = some_edges(plan)
    return lambda: ends_of(plan, points, edges)


def shares_by_lots():
    size = 300, 200
    quads = VIEW[None] * size * np.linspace(0.2, 1, 9)[:, None, None]
    lots = [(np.broadcast_to(VIEW, quads.shape), quads)] * 6
    return lambda: [
        (n, list(part[:-1])) for n, part in native_divide.divided(size, lots, 1 << 18, False)
    ]


def painting_by_shares():
    dice = np.random.default_rng(13)
    a_picture = Picture("p", dice.random((64, 64, 4)).astype(np.float32), PICTURES["turned"])
    shares = shares_of(dice, 20_000, (200, 100))
    return lambda: painted(a_picture, viewer_of("perspective"), shares)


def fit_of_mesh():
    mesh = shaken(icosphere(0.025, 4), 0.001)
    return lambda: make_surface(mesh).curved


@pytest.mark.parametrize(
    "make", [landings_by_plan, ends_by_plan, shares_by_lots, painting_by_shares, fit_of_mesh]
)
def test_any_number_of_threads_gives_the_same_bits(make):
    """Landings, ends of branches, shares, paintings and curved faces."""
    one, *others = (bits(found) for found in by_threads(make(), (1, 2, 3, 16, 1000)))
    assert one
    assert all(other == one for other in others)


def test_the_environment_switches_it_off():
    """KIRIKO_KERNEL=off is numpy's way."""
    code = "from kiriko.core.native import loading; print(loading.library())"
    link = str(build_kernel.HERE.parent)
    told = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": link, loading.SWITCH: "off"},
        capture_output=True,
        text=True,
    )
    assert told.stdout.strip() == "None", told.stderr


SHARING = (
    *(
        curved,
        curved_hits,
        native_fit,
        loading,
        media,
        picture,
        plate,
        pyramid,
    ),
    *(
        layer_hits,
        quartics,
        paraboloids,
        cells_module,
        structures,
        fitted_faces,
        near_misses,
    ),
    *(ray_engine, pyramid, source_image, rays_module),
)
# constants that numpy's way has no need of
KERNELS_OWN = {
    *("BINS", "BUNDLES_EACH_TURN", "BY_HALVES", "COLUMNS_AT_ONCE", "FEW", "FREE", "HALF_TURN"),
    *("SHELL_SLACK", "MOST_SHELL_HITS", "MOST_DEPTH", "MOST_LEVELS"),
    *("MOST_TAPS", "MOST_THREADS", "MOST_WAITING", "N_STARTS", "RAYS_AT_ONCE", "ROUNDING"),
    *("LINE", "N_AT", "STRIPE", "SIDE_BY_SIDE"),
    *("EDGES_AT_ONCE", "WELL_BELOW"),
}


def kernels_numbers():
    """Every constant of the C, by name."""
    sources = "".join(
        path.read_text(encoding="utf-8") for path in build_kernel.SOURCES.glob("*.[ch]")
    )
    return dict(re.findall(r"^#define (\w+) (\S+)", sources, re.MULTILINE))


def numbers_of(module):
    """The constants of a module, and the fields of its records of knobs in capitals, by name."""
    records = [value for value in vars(module).values() if is_record(value)]
    fields_of = {f.name.upper(): getattr(r, f.name) for r in records for f in fields(r)}
    return vars(module) | fields_of


def is_record(value):
    return is_dataclass(value) and not isinstance(value, type)


@pytest.mark.parametrize("module", SHARING)
def test_one_number_for_one_name(module):
    """Every constant of the C that a module of core has by the same name, or as a knob of a
    record, is the same number there.
    """
    defined = kernels_numbers()
    known = numbers_of(module)
    shared = [name for name in defined if name in known]
    assert shared
    for name in shared:
        text = defined[name]
        assert known[name] == (float.fromhex(text) if text.startswith("0x") else float(text)), name


def test_no_number_of_the_kernel_is_its_alone():
    """But for those listed, each constant of the C is held to that of a module of core."""
    shared = {name for module in SHARING for name in numbers_of(module)}
    numbers = {name for name, text in kernels_numbers().items() if re.match(r"[(\d]", text)}
    assert numbers - shared == KERNELS_OWN


def test_structures_are_as_large_as_their_fields():
    """No field is padded on any platform: all are 8 bytes or pairs of 4."""
    for structure in STRUCTURES:
        assert ctypes.sizeof(structure) == sum(
            ctypes.sizeof(kind) for _, kind in structure._fields_
        )
