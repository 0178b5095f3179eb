"""Glass that is neither ball nor cube: solved, and what
Cycles shows agrees with the seen image of core.
"""

import bpy
import numpy as np
import pytest


def add_suzanne():
    """Suzanne, 60 mm, smooth, with a subdivision modifier; she looks at the viewer."""
    bpy.ops.mesh.primitive_monkey_add(size=0.06)
    suzanne = bpy.context.object
    bpy.ops.object.shade_smooth()
    modifier = suzanne.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 2
    return suzanne


def add_solid_suzanne():
    """Suzanne in one piece: as she comes, her eyes are open
    shells that cut her head, which Cycles cannot follow.
    """
    suzanne = add_suzanne()
    suzanne.modifiers.clear()
    remesh = suzanne.modifiers.new("Remesh", "REMESH")
    remesh.mode = "VOXEL"
    remesh.voxel_size = 0.002
    remesh.use_smooth_shade = True
    modifier = suzanne.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 1
    return suzanne


def add_bottle():
    """A hollow bottle: a profile, turned by a screw modifier,
    given walls of 3 mm by a solidify modifier.
    """
    profile = (
        np.array([(0, 0), (20, 0), (22, 2), (22, 40), (20, 46), (9, 56), (8, 60), (8, 72), (0, 72)])
        * 1e-3
    )
    mesh = bpy.data.meshes.new("Bottle")
    n = len(profile)
    mesh.from_pydata([(x, 0, z - 0.03) for x, z in profile], [(k, k + 1) for k in range(n - 1)], [])
    bottle = bpy.data.objects.new("Bottle", mesh)
    bpy.context.scene.collection.objects.link(bottle)
    screw = bottle.modifiers.new("Screw", "SCREW")
    screw.steps = screw.render_steps = 64
    screw.use_merge_vertices, screw.merge_threshold = True, 1e-5
    screw.use_normal_calculate = True
    screw.use_smooth_shade = False
    solid = bottle.modifiers.new("Solidify", "SOLIDIFY")
    solid.thickness = 0.003
    solid.offset = -1
    bpy.context.view_layer.objects.active = bottle
    bottle.select_set(True)

    return bottle


def totally_reflected(plan, origins, directions):
    """Which rays (n,) leave a face of the glass on the side that they came from?"""
    from kiriko.core.base.steps import run_steps
    from kiriko.core.light.trace import tracing

    steps = []
    run_steps(tracing(plan, origins, directions, steps=steps))
    found = np.zeros(len(origins), bool)
    last, came, normal = origins.copy(), directions.copy(), np.zeros_like(origins)

    for step in steps:
        for rays, goes in (
            (step.rays, step.place - last[step.rays]),
            (step.left, step.direction),
        ):
            sides = (normal[rays] * came[rays]).sum(axis=1) * (normal[rays] * goes).sum(axis=1)
            found[rays] |= sides < 0
        came[step.rays] = step.place - last[step.rays]
        last[step.rays] = step.place
        is_glass = plan.triangles.part[step.triangle] < len(plan.rig.glasses)
        normal[step.rays] = plan.triangles.normals[step.triangle] * is_glass[:, None]

    return found


@pytest.mark.parametrize("make", [add_solid_suzanne, add_bottle])
def test_solves_and_cycles_follows_the_same_light(scene, make):
    """Cycles as a map tracer lands each viewer pixel's middle where
    core does, to 0.1 display px for 99 % of the light that was refracted alone.

    On curved faces 90 %: there Cycles has flat triangles, as many as memory allows, and light meets
    up to a dozen of them, each a lever for the last one's error. With four times as many triangles
    the error is a quarter. Light that was totally reflected too, up to twenty times, agrees for
    half: the error of single precision grows with each bent facet.
    """
    from kiriko.core.blender.preview.cycles_preview import render_map
    from kiriko.core.blender.read import scene as blender_scene
    from kiriko.core.light.compile_plan import compile_plan
    from kiriko.core.light.trace import trace_all
    from kiriko.core.rig.settings import Settings

    glass = make()
    glass.kiriko.use_ior = True
    size = 0.6 * min(glass.dimensions.x, glass.dimensions.z)
    options = {"viewer_resolution": 96, "display_resolution": (256, 256), "picture_size": size}
    options["display_size"] = 10 * size  # light spreads so far

    assert bpy.ops.kiriko.add_rig(**options) == {"FINISHED"}
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert 0 < scene.kiriko.result.coverage <= 1
    assert np.isfinite(np.array(scene.kiriko.result.source.pixels)).all()

    x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
    for glass.kiriko.surface, share in (("FACETS", 0.99), ("SMOOTH", 0.9)):
        reading = blender_scene.read(bpy.context.evaluated_depsgraph_get(), scene)
        rig = reading.rig
        plan = compile_plan(rig, Settings(only_through_glass=False))
        rays = rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
        landings = trace_all(plan, *rays)
        is_refracted = ~totally_reflected(plan, *rays)
        found = render_map(scene, reading).reshape(-1, 3)
        cycles = np.stack([found[:, 0], 1 - found[:, 1]], axis=1) * 256
        both = (found[:, 2] > 0.5) & landings.has_arrived & (landings.n_events > 2)
        assert both.mean() > 0.05
        apart = np.linalg.norm(cycles - landings.xy, axis=1)
        assert np.median(apart[both]) < 0.01
        assert (apart[both & is_refracted] < 0.1).mean() > share
        if glass.kiriko.surface == "FACETS":
            assert np.median(apart[both & ~is_refracted]) < 0.1
        assert landings.has_arrived[found[:, 2] > 0.5].mean() > 0.99


@pytest.mark.parametrize("make", [add_suzanne, add_bottle])
def test_previews(kiriko, scene, make):
    """The operator renders the solved rig; where core sees the picture's dots there is light."""
    make().kiriko.use_ior = True
    sizes = {"picture_size": 0.035, "display_size": 0.1, "display_resolution": (512, 512)}
    assert bpy.ops.kiriko.add_rig(viewer_resolution=96, **sizes) == {"FINISHED"}
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert bpy.ops.kiriko.preview(samples=16) == {"FINISHED"}

    image = bpy.data.images["Kiriko Preview"]
    assert tuple(image.size) == (96, 96)
    shown = np.array(image.pixels).reshape(96, 96, 4)[::-1, :, 0]
    work = kiriko.operators.work
    steps = work.session().solve(work.read(bpy.context).rig, work.settings_of(scene))
    seen = kiriko.core.base.steps.run_steps(steps).seen()[..., 0]
    dots = seen > 0.5

    assert dots.sum() > 20
    # two to six surfaces, each takes 4 % of the light or more
    assert np.median(shown[dots] / seen[dots]) > 0.6


def test_the_map_of_suzanne_keeps_the_tolerance(scene):
    """Held to a ray through each pixel's middle, where it is not
    sampled, as tests/core/test_view_map.py holds others.

    Light that was totally reflected again and again makes speckles there, smaller than
    a cut pixel tells: the covered masks agree to 0.99, not to 0.999.
    """
    from kiriko.core.base.steps import run_steps
    from kiriko.core.blender.read import scene as blender_scene
    from kiriko.core.light.compile_plan import compile_plan
    from kiriko.core.light.trace import trace_all
    from kiriko.core.map.sampling import sample
    from kiriko.core.rig.settings import Settings
    from known.work import is_sampled

    add_suzanne().kiriko.use_ior = True
    assert bpy.ops.kiriko.add_rig(
        viewer_resolution=80, display_resolution=(512, 512), display_size=0.1
    ) == {"FINISHED"}

    rig = blender_scene.read(bpy.context.evaluated_depsgraph_get(), scene).rig
    plan = compile_plan(rig, Settings())
    found = run_steps(sample(plan))
    x, y = np.meshgrid(np.arange(80) + 0.5, np.arange(80) + 0.5)
    at = np.stack([x.ravel(), y.ravel()], axis=1)
    landings = trace_all(plan, *rig.viewer.rays(at))
    exact = np.where((landings.branch != 0)[:, None], landings.xy, np.nan)
    got = found.display_from_view(at)
    with np.errstate(invalid="ignore"):
        theirs, mine = (((xy >= 0) & (xy <= 512)).all(axis=1) for xy in (exact, got))

    assert theirs.sum() > 1000
    is_cut = ~is_sampled(found, at)
    assert is_cut[theirs].mean() > 0.9
    assert np.quantile(np.linalg.norm(got - exact, axis=1)[mine & theirs & is_cut], 0.999) <= 0.1
    assert (mine & theirs).sum() / (mine | theirs).sum() >= 0.99
