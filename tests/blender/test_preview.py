from types import ModuleType, SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from known import closed_forms
from small_rigs import cube, inventory, linear_lattice, new_object, pixels, primitive, small_rig
from test_ends_with_its_rig import Dialogue, in_window

# Cycles traces in float32 over 1.2 m of path: 2^-24 of that, over
# a display of 0.05 m, times the lever of the bending
SINGLE = 2e-5  # of the display's width: 0.01 px of 512


def solid(
    make: str, name: str = "Solid", at: tuple[float, ...] = (0, 0, 0), **sizes: float
) -> bpy.types.Object:
    """A selected glass object of a bmesh primitive, with a role and an index."""
    thing = new_object(primitive(make, **sizes), "GLASS")
    thing.name = name
    thing.location = at
    thing.kiriko.use_ior = True
    thing.select_set(True)
    return thing


def coarse_ball(radius: float = 0.025) -> bpy.types.Object:
    """A ball as Blender adds it: 32 x 16 faces, here smooth-shaded."""
    ball = solid("uvsphere", "Ball", u_segments=32, v_segments=16, radius=radius)
    ball.data.shade_smooth()
    return ball


def maps(core: ModuleType) -> tuple[np.ndarray, np.ndarray]:
    """Where each viewer pixel lands, u and v (h, w, 2): by
    Cycles, and by Kiriko; NaN where it does not.
    """
    scene = bpy.context.scene
    reading = core.blender.read.scene.read(bpy.context)
    by_cycles = core.blender.preview.cycles_preview.render_map(scene, reading)
    cycles = np.where(by_cycles[..., 2:] > 0.5, by_cycles[..., :2], np.nan)
    plan = core.light.compile_plan.compile_plan(
        reading.rig, core.rig.settings.Settings(only_through_glass=False)
    )
    viewer = reading.rig.viewer
    display = reading.rig.display
    x, y = np.meshgrid(np.arange(viewer.width) + 0.5, np.arange(viewer.height) + 0.5)
    landings = core.light.trace.trace_all(
        plan, *viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    )
    xy = landings.xy.reshape(viewer.height, viewer.width, 2) / (display.width, display.height)

    return cycles, np.stack([xy[..., 0], 1 - xy[..., 1]], axis=2)


def assert_agree(
    core: ModuleType, share: float = 0.5, tolerance: float = SINGLE, quantile: float = 0.995
) -> None:
    """Where a path arrives in Cycles (there those with total
    reflection do not), Kiriko lands on the same point.
    """
    cycles, ours = maps(core)
    both = np.isfinite(cycles).all(axis=2) & np.isfinite(ours).all(axis=2)
    assert both.mean() > share
    assert (np.isfinite(cycles) & ~np.isfinite(ours)).mean() < 0.01
    apart = np.abs(cycles - ours)[both].max(axis=1)
    # a pixel centre on a border between two branches may go either way in float32
    assert np.quantile(apart, quantile) < tolerance


def test_plain_picture_appears_in_mid_air(core, scene):
    """With no glass at all the viewer sees the display's pixels
    in the picture's place, upright and unmirrored.
    """
    rig = small_rig(picture_size=0.04, display_size=0.04, field=0.04)
    bpy.data.objects.remove(rig["GLASS"])
    reading = core.blender.read.scene.read(bpy.context)
    source = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    seen = core.blender.preview.cycles_preview.render_preview(scene, reading, source, samples=4)[
        ..., :3
    ]
    # viewer and display pixels coincide, so only samples on
    # their edges may take the neighbour's colour
    assert np.abs(seen - source).mean() < 1e-3


def test_map_without_glass_is_the_mirror_image(core, scene):
    """Cycles lands at the mirror image of the point on the
    aerial plane: u, v run with the viewer's image.
    """
    rig = small_rig(picture_size=0.04, display_size=0.04, field=0.04)
    bpy.data.objects.remove(rig["GLASS"])
    found = core.blender.preview.cycles_preview.render_map(
        scene, core.blender.read.scene.read(bpy.context)
    )
    middle = (np.arange(64) + 0.5) / 64
    assert np.abs(found[..., 0] - middle).max() < SINGLE
    assert np.abs(found[..., 1] - (1 - middle)[:, None]).max() < SINGLE
    assert (found[..., 2] == 1).all()


@pytest.mark.every_blender
def test_cycles_agrees_on_a_turned_cube(core):
    """Through flat faces, Cycles and Kiriko's tracer land on the same point."""
    small_rig(display_size=0.2)["GLASS"].rotation_euler.z = np.radians(15.8)
    assert_agree(core)


def test_the_preview_has_the_viewers_own_pixels(core, scene):
    """Cycles renders the frame that is solved, and a percentage
    of it, whatever shape the scene's render has.
    """
    small_rig(display_size=0.2)["GLASS"].rotation_euler.z = np.radians(15.8)
    scene.render.resolution_percentage, scene.render.pixel_aspect_x = 50, 2.0
    scene.kiriko.viewer.kiriko.resolution = (48, 32)
    assert_agree(core, share=0.4)
    reading = core.blender.read.scene.read(bpy.context)
    source = np.ones((64, 64, 3), np.float32)

    assert maps(core)[0].shape[:2] == (32, 48)
    half = core.blender.preview.cycles_preview.render_preview(
        scene, reading, source, percentage=50, samples=1
    )
    assert half.shape[:2] == (16, 24)
    scene.kiriko.viewer.kiriko.use_resolution = False
    reading = core.blender.read.scene.read(bpy.context)
    half = core.blender.preview.cycles_preview.render_preview(
        scene, reading, source, percentage=10, samples=1
    )

    assert half.shape[:2] == (54, 96)  # of the half of 1920 x 1080


def test_cycles_agrees_on_a_smooth_ball(core, scene):
    """Through smooth-shaded faces, too.

    Towards its rim a ball's lever on a normal's error grows without bound.
    """
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_size=0.3, display_resolution=(512, 512))
    assert_agree(core, share=0.4, tolerance=10 * SINGLE, quantile=0.99)


def test_cycles_shows_the_ball_that_a_coarse_one_stands_for(core, scene):
    """Cycles lands where the analytic ball does, to 0.01 display px.

    As drawn the same faces miss by ten times that.
    """
    ball = coarse_ball()
    bpy.ops.kiriko.add_rig(
        viewer_resolution=64, display_size=0.3, field=0.05, display_resolution=(512, 512)
    )
    viewer, display = (
        getattr(core.blender.read.scene.read(bpy.context).rig, part)
        for part in ("viewer", "display")
    )
    x, y = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    o, d = viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))

    missed = {}
    for ball.kiriko.surface in ("SMOOTH", "FACETS"):
        reading = core.blender.read.scene.read(bpy.context)
        found = core.blender.preview.cycles_preview.render_map(scene, reading).reshape(-1, 3)
        cycles = np.stack([found[:, 0], 1 - found[:, 1]], axis=1) * [display.width, display.height]
        exact = closed_forms.landing(reading.rig, *closed_forms.through_ball(o, d, 0.025, 1.49))
        both = (found[:, 2] > 0.5) & np.isfinite(exact).all(axis=1)
        assert both.mean() > 0.4
        missed[ball.kiriko.surface] = np.median(np.linalg.norm(cycles - exact, axis=1)[both])

    assert missed["SMOOTH"] < 0.01
    assert missed["FACETS"] > 10 * missed["SMOOTH"]


@pytest.mark.parametrize("way", ["inside out", "mirrored", "instance", "millimetres"])
def test_cycles_agrees_on_a_curved_surface(core, scene, way):
    """The fine triangles stand where the coarse ball stands and face out, however it was drawn."""
    millimetres = 1000 if way == "millimetres" else 1
    if way == "millimetres":
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.001
    ball = coarse_ball(0.025 * millimetres)
    bpy.ops.kiriko.add_rig(
        viewer_resolution=48,
        display_resolution=(512, 512),
        display_size=0.3 * millimetres,
        field=0.05 * millimetres,
    )

    if way == "inside out":
        ball.data.flip_normals()
    elif way == "mirrored":
        ball.scale = (1, -1.1, 0.9)
        ball.rotation_euler = (0.1, 0.2, 0.3)
    elif way == "instance":
        box = bpy.data.collections.new("box")
        box.objects.link(ball)
        for collection in ball.users_collection:
            if collection != box:
                collection.objects.unlink(ball)
        maker = new_object(None)
        maker.instance_type, maker.instance_collection = "COLLECTION", box
        maker.rotation_euler.z = 0.3
        maker.scale = (0.9, 1.0, 1.1)

    assert_agree(core, share=0.4, quantile=0.95)


def test_cycles_agrees_on_a_solid_within_another(core):
    """A solid wholly inside another has the ratio of the
    two indices in Cycles, and the tracers agree.
    """
    small_rig(display_size=0.2)
    inner = solid("cube", size=0.02)
    inner.kiriko.ior = 1.8
    inner.rotation_euler = (0.2, 0.1, 0.4)
    bpy.context.view_layer.update()
    found, notes = core.blender.read.nested_glass.interfaces(
        core.blender.read.scene.read(bpy.context).rig.glasses
    )

    assert sorted(interface.index for interface in found) == pytest.approx(
        [1.8 / 1.49, 1.49], rel=1e-6
    )
    assert notes == []

    assert_agree(core)


def test_solid_hidden_by_priority_is_left_out(core):
    """An inner solid of lower priority changes nothing: the outer one is the glass that
    is there.
    """
    small_rig(display_size=0.2)
    inner = solid("cube", size=0.02)
    inner.kiriko.ior, inner.kiriko.priority = 1.8, -1
    bpy.context.view_layer.update()
    found, _ = core.blender.read.nested_glass.interfaces(
        core.blender.read.scene.read(bpy.context).rig.glasses
    )
    assert sorted(interface.index or 0 for interface in found) == pytest.approx([0, 1.49], rel=1e-6)
    assert_agree(core)


def test_cycles_agrees_on_a_hollow_glass(core):
    """A shell inside a shell is a cavity; its faces are drawn to look into it."""
    glass = small_rig(display_size=0.2)["GLASS"]
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    hole = bmesh.ops.create_cube(shape, size=0.02, matrix=Matrix.Rotation(0.4, 4, (1, 1, 1)))
    bmesh.ops.reverse_faces(shape, faces=list({f for v in hole["verts"] for f in v.link_faces}))
    shape.to_mesh(glass.data)
    shape.free()
    assert_agree(core)


@pytest.mark.parametrize(("gap", "is_noted"), [(-0.01, True), (0.0, True), (0.001, False)])
def test_touching_solids_are_said_to_be_not_comparable(core, gap, is_noted):
    """Solids that overlap or share a face make a note that names both.

    A gap of a millimetre makes none.
    """
    small_rig()
    solid("cube", "Block", at=(0.05 + gap, 0, 0), size=0.05)
    bpy.context.view_layer.update()
    _, notes = core.blender.read.nested_glass.interfaces(
        core.blender.read.scene.read(bpy.context).rig.glasses
    )
    assert bool(notes) == is_noted
    assert all("differs from Kiriko" in note and "'Block' and 'Cube'" in note for note in notes)


def test_preview_shows_the_picture(scene, core):
    """The source image as Cycles shows it is closer to the
    ideal image than the plain picture as it shows that.
    """
    small_rig(display_resolution=(256, 256), viewer_resolution=128)
    bpy.ops.kiriko.solve()
    reading = core.blender.read.scene.read(bpy.context)
    lattice = linear_lattice()

    # of the picture on the viewer's image, px; each is the mean of 8 x 8 points
    width = 0.05 * 0.6 / 0.04 * 128
    at = ((np.arange(128 * 8) + 0.5) / 8 - (128 - width) / 2) / width * 1024
    inside = (at >= 0) & (at < 1024)
    fine = np.zeros((128 * 8, 128 * 8, 3))
    index = at[inside].astype(int)
    fine[np.ix_(inside, inside)] = lattice[np.ix_(index, index)]
    ideal = fine.reshape(128, 8, 128, 8, 3).mean(axis=(1, 3))

    errors = []
    for source in (scene.kiriko.result.source, lattice[2::4, 2::4]):
        seen = core.blender.preview.cycles_preview.render_preview(
            scene, reading, source, samples=16, fresnel=False
        )
        errors.append(np.abs(seen[..., :3] - ideal).mean())

    assert errors[0] < errors[1] / 3


def test_nothing_of_the_users_is_touched(scene):
    """After a preview the file holds one image more.

    Engine, samples, colours, materials and scene are as before.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    display = bpy.data.objects["Kiriko Display"]

    def state() -> tuple:
        render, cycles = scene.render, scene.cycles
        return (
            render.engine,
            render.filepath,
            render.use_border,
            render.image_settings.file_format,
            cycles.samples,
            cycles.max_bounces,
            cycles.transparent_max_bounces,
            scene.view_settings.view_transform,
            scene.camera,
            bpy.context.scene,
            bpy.context.window.scene,
            display.material_slots[0].material,
            display.users,
        )

    before = state()
    held = inventory()
    assert bpy.ops.kiriko.preview(samples=1) == {"FINISHED"}
    assert state() == before

    held["images"] = sorted([*held["images"], "Kiriko Preview"])
    assert inventory() == held
    bpy.ops.kiriko.preview(samples=1, border=(0, 0.5, 0.5, 1))
    assert inventory() == held
    assert tuple(bpy.data.images["Kiriko Preview"].size) == (32, 32)


@pytest.mark.parametrize("is_spoilt", [False, True])
def test_a_click_is_answered_before_the_scene_is_made(kiriko, scene, monkeypatch, is_spoilt):
    """The status bar tells of the preparation, which begins with the timer's first turn; a second
    click meanwhile begins nothing. The text goes, where there can be no preview, too.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    module = loaded("operators.preview")
    own = {"context": bpy.context, "data": bpy.data, "ops": bpy.ops}
    app = SimpleNamespace(background=False, is_job_running=bpy.app.is_job_running)
    monkeypatch.setattr(module, "bpy", SimpleNamespace(app=app, **own))
    values = {
        "samples": 1, "percentage": 100, "border": (1, 0, 0, 1) if is_spoilt else (0, 1, 0, 1),
        "reflections": False, "surroundings": False, "filepath": "", "overwrite": False,
    }  # fmt: skip
    dialogue = Dialogue(kiriko, "preview", "KIRIKO_OT_preview", **values)
    texts: list[str | None] = []
    timers = ["timer"]
    manager = SimpleNamespace(
        event_timer_add=lambda *_, **__: "timer",
        event_timer_remove=timers.remove,
        modal_handler_add=lambda _: None,
    )
    workspace = SimpleNamespace(status_text_set=texts.append)
    window = in_window(window_manager=manager, workspace=workspace)

    def scenes() -> list[str]:
        return [one.name for one in bpy.data.scenes]

    before = scenes()
    assert dialogue.it.invoke(window, None) == {"RUNNING_MODAL"}
    assert texts == ["Kiriko: preparing the preview ..."]
    assert dialogue.it.modal(window, SimpleNamespace(type="LEFTMOUSE")) == {"RUNNING_MODAL"}
    assert scenes() == before
    timer = SimpleNamespace(type="TIMER")
    if is_spoilt:
        assert dialogue.it.modal(window, timer) == {"CANCELLED"}
        assert "border is empty" in dialogue.reports[0]
    else:
        assert dialogue.it.modal(window, timer) == {"RUNNING_MODAL"}
        assert dialogue.it.modal(window, timer) == {"FINISHED"}
        assert scene.kiriko.result.preview.size[0] == 64
    assert texts[1:] == [None]
    assert timers == []
    assert scenes() == before


def test_preview_cut_short_is_cleaned_up_by_the_next(scene, core):
    """The leavings of a preview that never came to its end go with the next one."""
    small_rig()
    before = inventory()
    reading = core.blender.read.scene.read(bpy.context)
    core.blender.preview.cycles_preview.Preview(scene, reading, None)
    assert inventory() != before
    core.blender.preview.cycles_preview.render_map(scene, reading)
    assert inventory() == before


def test_surroundings_are_there_only_when_asked_for(scene, core):
    """An object without a role hides the glass when the
    surroundings are shown; Kiriko's own view leaves it out.
    """
    small_rig(display_size=0.2)
    wall = bpy.data.objects.new("wall", cube(0.2).data)
    wall.location.y = -0.5
    bpy.data.objects.remove(bpy.data.objects["Cube.001"])
    scene.collection.objects.link(wall)
    reading = core.blender.read.scene.read(bpy.context)
    white = np.ones((4, 4, 3))
    options = {"samples": 1, "fresnel": False}
    shown = [
        core.blender.preview.cycles_preview.render_preview(
            scene, reading, white, surroundings=s, **options
        )[..., :3].mean()
        for s in (False, True)
    ]

    assert shown[0] > 0.4
    assert shown[1] == 0


def test_a_preview_that_cannot_be_is_refused_before_the_render(scene, tmp_path):
    """An empty border, a path relative to no file, another
    suffix, a folder that is none: one sentence, no image.
    """
    small_rig(display_size=0.2)
    bpy.ops.kiriko.solve()
    bad = {
        "border is empty": {"border": (0.5, 0.5, 0, 1)},
        "never saved": {"filepath": "//x.png"},
        "neither .png nor .exr": {"filepath": str(tmp_path / "x.jpg")},
        "cannot be written": {"filepath": str(tmp_path / "nowhere" / "x.png")},
    }
    for words, options in bad.items():
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.kiriko.preview(samples=1, **options)

    assert "Kiriko Preview" not in bpy.data.images
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("is_upright", [False, True])
def test_a_plate_under_a_parent_of_uneven_scale_is_as_bright_in_cycles(core, scene, is_upright):
    """Its place is sheared; where its mesh stands upright on
    its own plane the mesh is. Mean luminance to 5 %.
    """
    parts = small_rig(display_size=0.1)
    if is_upright:
        turn = Matrix.Rotation(np.pi / 2, 4, "X")
        parts["PLATE"].data.transform(turn.inverted())
        parts["PLATE"].matrix_world = parts["PLATE"].matrix_world @ turn

    parent = new_object(None)
    parent.scale = (1.0, 1.0, 1.25)
    parts["PLATE"].parent = parent
    bpy.context.view_layer.update()
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.simulate(samples=16)
    seen = pixels(scene.kiriko.result.seen)[..., :3]
    reading = core.blender.read.scene.read(bpy.context)
    shown = core.blender.preview.cycles_preview.render_preview(
        scene, reading, scene.kiriko.result.source, samples=32
    )[..., :3]
    one, other = (image.mean(axis=(0, 1)) @ [0.2126, 0.7152, 0.0722] for image in (seen, shown))

    assert one > 0.02
    assert other == pytest.approx(one, rel=0.05)


@pytest.mark.parametrize("ior", [0.6, 1.0, 1.49, 100.0])
@pytest.mark.parametrize("is_behind", [False, True])
def test_light_is_refracted_or_totally_reflected_as_snell_says(
    core, scene, tmp_path, ior, is_behind
):
    """At one interface without reflections, seen from either side, for relative indices that nested
    glass has, too: what is seen is the sky beyond, white, or the ground on this side, black.
    """
    index = 1 / ior if is_behind else ior  # of what is beyond, over that of this side
    wall = new_object(primitive("grid", x_segments=1, y_segments=1, size=50.0))
    wall.rotation_euler.x = np.pi if is_behind else 0.0
    material = bpy.data.materials.new("Glass")
    core.blender.materials.shaders.be_glass(material, ior, False)
    wall.data.materials.append(material)

    world = scene.world = bpy.data.worlds.new("Sky beyond")
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    place, parts, sign = (
        nodes.new(f"ShaderNode{name}") for name in ("TexCoord", "SeparateXYZ", "Math")
    )
    sign.operation, sign.inputs[1].default_value = "LESS_THAN", 0.0
    link(place.outputs["Generated"], parts.inputs[0])
    link(parts.outputs["Z"], sign.inputs[0])
    link(sign.outputs[0], nodes["Background"].inputs["Color"])

    camera = scene.camera = new_object(bpy.data.cameras.new("Eye"))
    camera.location = 0.3, 0.1, 1.0  # not over the diagonal, along which the wall is cut
    half = 2 * index if index < 0.5 else 1.2
    camera.data.sensor_width, camera.data.lens = 72.0, 36.0 / np.tan(half)
    settings, n = scene.render, 64
    settings.engine, settings.resolution_x, settings.resolution_y = "CYCLES", n, n
    settings.resolution_percentage, settings.filepath = 100, str(tmp_path / "seen.exr")
    settings.image_settings.file_format = "OPEN_EXR"
    scene.cycles.samples, scene.cycles.pixel_filter_type = 1, "BLACKMAN_HARRIS"
    scene.cycles.filter_width, scene.cycles.use_denoising = 0.01, False
    bpy.ops.render.render(write_still=True)

    seen = pixels(bpy.data.images.load(settings.filepath))[..., 0]
    across = ((np.arange(n) + 0.5) / n - 0.5) * 2 * np.tan(half)
    squared = across**2 + across[:, None] ** 2
    sine = np.sqrt(squared / (1 + squared))
    is_clear = np.abs(sine - index) > 1e-4 * index
    np.testing.assert_array_equal((seen > 0.5)[is_clear], (sine < index)[is_clear])
    assert is_clear.mean() > 0.99
