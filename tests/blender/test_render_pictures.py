"""Images for each viewer: rendered from another scene, and opened by a file name."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from extension import loaded
from small_rigs import inventory, pixels, small_rig

NAMES = ("Kiriko Viewer", "mine")
SIZES = {"Kiriko Viewer": (48, 40), "mine": (32, 64)}


@pytest.fixture
def rig(scene) -> dict[str, bpy.types.Object]:
    """A rig around a cube, of two viewers with pixels of their own; the objects by role."""
    parts = small_rig()
    thing = ours().viewer.copy()
    thing.name = "mine"
    thing.data = thing.data.copy()
    thing.location.x += 0.005
    thing.data.shift_x = -0.05
    scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.add_viewer()
    for name, size in SIZES.items():
        bpy.data.objects[name].kiriko.use_resolution = True
        bpy.data.objects[name].kiriko.resolution = size
    return parts


def ours() -> bpy.types.PropertyGroup:
    return bpy.context.scene.kiriko


def other_scene() -> bpy.types.Scene:
    """A scene in which a small white ball glows at the rig's middle, with settings of its own."""
    made = bpy.data.scenes.new("world")
    made.render.engine = "CYCLES"
    made.cycles.samples = 4
    made.view_settings.view_transform = "Standard"
    made.render.resolution_x, made.render.resolution_y = 17, 19
    made.render.resolution_percentage = 50
    made.render.use_border = True
    made.render.filepath = "//elsewhere"
    made.render.image_settings.file_format = "JPEG"
    material = bpy.data.materials.new("glow")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    glow, out = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial"))
    tree.links.new(glow.outputs[0], out.inputs["Surface"])
    mesh = bpy.data.meshes.new("ball")
    t = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rings = [0.004 * np.stack([np.cos(t), 0 * t, np.sin(t)], axis=1)]
    mesh.from_pydata(np.concatenate(rings).tolist(), [], [list(range(64))])
    mesh.materials.append(material)
    disc = bpy.data.objects.new("disc", mesh)
    made.collection.objects.link(disc)
    own = bpy.data.objects.new("own", bpy.data.cameras.new("own"))
    made.collection.objects.link(own)
    made.camera = own
    made.timeline_markers.new("cut", frame=1).camera = own
    return made


def state(scene: bpy.types.Scene) -> dict[str, Any]:
    """All settings of a scene's render, its camera, and what is in it."""
    form = scene.render.image_settings
    found = {
        f"{owner.bl_rna.identifier}.{p.identifier}": getattr(owner, p.identifier)
        for owner in (scene.render, form)
        for p in owner.bl_rna.properties
        if p.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"}
        and not p.is_readonly
        and not getattr(p, "is_array", False)
    }
    found["camera"] = scene.camera.name
    found["markers"] = [one.camera.name for one in scene.timeline_markers]
    found["objects"] = sorted(thing.name for thing in scene.objects)
    return found


def middle(image: bpy.types.Image) -> np.ndarray:
    """The middle of the light in an image, 0..1 to the right and up."""
    light = pixels(image)[::-1, :, 0]
    y, x = (np.indices(light.shape) + 0.5) / [[[light.shape[0]]], [[light.shape[1]]]]
    return np.array([(light * x).sum(), (light * y).sum()]) / light.sum()


def test_each_viewer_gets_a_render_from_its_own_place(kiriko, rig):
    """Of its own size; a small disc is where Blender's projection of its middle has it. The other
    scene is as it was, and the images are in the file.
    """
    other = other_scene()
    middle_of_rig = rig["PICTURE"].matrix_world.translation.copy()
    bpy.data.objects["disc"].location = middle_of_rig
    before, things = state(other), inventory()
    assert bpy.ops.kiriko.render_pictures() == {"FINISHED"}
    assert state(other) == before
    after = inventory()
    after["images"] = [name for name in after["images"] if name not in NAMES]
    assert after == things

    assert ours().picture_source == "IMAGE"
    images = {name: one.image for name, one in zip(NAMES, ours().viewers, strict=True)}
    for name, image in images.items():
        assert (image.name, tuple(image.size)) == (name, SIZES[name])
        assert image.packed_file is not None
        camera = bpy.data.objects[name]
        # its aspect is that of the viewer's pixels
        ours_render = bpy.context.scene.render
        ours_render.resolution_x, ours_render.resolution_y = SIZES[name]
        wanted = world_to_camera_view(bpy.context.scene, camera, middle_of_rig)
        off = (middle(image) - wanted[:2]) * SIZES[name]
        assert np.abs(off).max() < 0.15  # px: four samples a pixel

    assert np.abs(middle(images["mine"]) - middle(images["Kiriko Viewer"])).max() > 0.05
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_rendered_anew_the_images_before_go(kiriko, rig):
    other_scene()
    bpy.ops.kiriko.render_pictures(scene="world")
    n = len(bpy.data.images)
    bpy.ops.kiriko.render_pictures(scene="world")
    assert [one.image.name for one in ours().viewers] == list(NAMES)
    assert len(bpy.data.images) == n


def test_renders_that_nobody_uses_any_more_go_with_the_next_and_with_the_rig(kiriko, rig):
    """Of eyes that a grid replaced, and of viewers whose rig is removed. One that is used
    elsewhere, that has a fake user, or that the artist made, stays.
    """

    def images() -> set[bpy.types.Image]:
        return {one for one in bpy.data.images if one.type != "RENDER_RESULT"}

    bpy.ops.kiriko.remove_rig()
    bpy.data.objects.remove(bpy.data.objects["mine"])
    other_scene()
    before = images()
    small_rig()
    of_rig = images()
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.render_pictures()
    eyes = images() - of_rig
    assert {one.name for one in eyes} == {"Kiriko Left Eye", "Kiriko Right Eye"}
    bpy.ops.kiriko.viewer_grid()
    assert not any(one.users for one in eyes)
    bpy.ops.kiriko.render_pictures()
    heads = {one.image for one in ours().viewers if one.is_on}
    assert images() == of_rig | heads
    assert len(heads) == 3

    kept = list(heads)[:2]
    kept[0].use_fake_user = True
    bpy.data.materials.new("mine").use_nodes = True
    nodes = bpy.data.materials["mine"].node_tree.nodes
    nodes.new("ShaderNodeTexImage").image = kept[1]
    mine = bpy.data.images.new("mine", 4, 4)
    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
    assert images() == before | {*kept, mine}


def test_a_scene_that_is_not_clear_is_refused(kiriko, rig):
    """No other scene, one that is not there, one of two."""
    with pytest.raises(RuntimeError, match="There is no other scene"):
        bpy.ops.kiriko.render_pictures()
    other_scene()
    bpy.data.scenes.new("empty")
    words = "There are 2 other scenes: name the one to render"
    for name in ("", "nobody", bpy.context.scene.name):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.kiriko.render_pictures(scene=name)
    assert [one.image for one in ours().viewers] == [None, None]


def test_all_is_rendered_at_the_frame_of_the_viewers_scene(kiriko, rig):
    """A lens with keyframes is that which the viewer is solved for, and what moves in the other
    scene is where it is then, whatever frame that one is at; there it is left. The camera's data
    stay one, with their keyframes.
    """
    other = other_scene()
    middle_of_rig = rig["PICTURE"].matrix_world.translation.copy()
    disc = bpy.data.objects["disc"]
    for frame, x in ((1, 0.005), (9, 0.0)):
        disc.location = middle_of_rig
        disc.location.x += x
        disc.keyframe_insert("location", frame=frame)
    scene, camera = bpy.context.scene, bpy.data.objects["mine"]
    for frame, lens, shift in ((1, camera.data.lens, -0.05), (9, 1.3 * camera.data.lens, -0.12)):
        camera.data.lens, camera.data.shift_x = lens, shift
        for name in ("lens", "shift_x"):
            camera.data.keyframe_insert(name, frame=frame)
    scene.frame_set(9)
    other.frame_current, other.frame_subframe = 1, 0.25
    n = len(bpy.data.cameras), len(bpy.data.objects)
    assert bpy.ops.kiriko.render_pictures() == {"FINISHED"}
    assert (len(bpy.data.cameras), len(bpy.data.objects)) == n
    assert camera.data.animation_data.action is not None
    assert (other.frame_current, other.frame_subframe) == (1, 0.25)

    scene.render.resolution_x, scene.render.resolution_y = SIZES["mine"]
    wanted = world_to_camera_view(scene, camera, middle_of_rig)
    off = (middle(ours().viewers[1].image) - wanted[:2]) * SIZES["mine"]
    assert np.abs(off).max() < 0.15
    scene.frame_set(1)
    elsewhere = world_to_camera_view(scene, camera, middle_of_rig)
    assert np.abs(np.array((elsewhere - wanted)[:2]) * SIZES["mine"]).max() > 1


def test_no_words_are_burnt_into_what_viewers_see(kiriko, rig):
    """A scene may have stamps on its own renders."""
    other = other_scene()
    bpy.data.objects["disc"].location = rig["PICTURE"].matrix_world.translation
    found = []
    for other.render.use_stamp in (False, True):
        bpy.ops.kiriko.render_pictures()
        found.append(pixels(ours().viewers[0].image))
    np.testing.assert_array_equal(*found)
    assert other.render.use_stamp


def with_file_outputs(scene: bpy.types.Scene, folder: Path) -> list[bpy.types.Node]:
    """Compositing nodes of a scene that write files to a folder, one of them within a group."""
    if bpy.app.version < (5, 0):
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        out = tree.nodes.new("CompositorNodeComposite")
    else:
        tree = scene.compositing_node_group = bpy.data.node_groups.new("c", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        out = tree.nodes.new("NodeGroupOutput")
    render = tree.nodes.new("CompositorNodeRLayers")
    render.scene = scene
    tree.links.new(render.outputs[0], out.inputs[0])
    made = [tree.nodes.new("CompositorNodeOutputFile")]
    group = bpy.data.node_groups.new("g", "CompositorNodeTree")
    group.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    within = tree.nodes.new("CompositorNodeGroup")
    within.node_tree = group
    tree.links.new(render.outputs[0], within.inputs[0])
    made.append(group.nodes.new("CompositorNodeOutputFile"))
    inside = group.nodes.new("NodeGroupInput")
    for node, of, to in ((made[0], render, tree), (made[1], inside, group)):
        if bpy.app.version < (5, 0):
            node.base_path = str(folder)
        else:
            node.directory = str(folder)
            node.file_output_items.new("RGBA", "Image")
        to.links.new(of.outputs[0], node.inputs[0])
    return made


def test_nodes_that_write_files_are_mute_meanwhile(kiriko, rig, tmp_path):
    """Each viewer's render would overwrite what they wrote. By itself the scene goes on writing."""
    other = other_scene()
    folder = tmp_path / "written"
    nodes = with_file_outputs(other, folder)
    nodes[1].mute = False
    assert bpy.ops.kiriko.render_pictures() == {"FINISHED"}
    assert not folder.exists() or not list(folder.iterdir())
    assert [node.mute for node in nodes] == [False, False]
    bpy.ops.render.render(scene=other.name)
    assert list(folder.iterdir())


def test_a_scene_without_a_layer_to_render_is_told(kiriko, rig):
    """Blender 5.2 ends with a signal where such a scene is rendered."""
    other = other_scene()
    other.view_layers[0].use = False
    before, things = state(other), inventory()
    words = r"'Kiriko Viewer' \(no view layer is used for rendering\)"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.render_pictures()
    assert (state(other), inventory()) == (before, things)


def write(path: Path, level: float) -> None:
    image = bpy.data.images.new("made", 8, 8)
    image.pixels.foreach_set([level, level, level, 1.0] * 64)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def test_a_file_name_has_the_viewer_in_it(run, rig, tmp_path, capsys):
    """By the camera's name as it is, or as every disk takes it. A file that is missing, or the same
    for all, is told in a sentence, and nothing is changed or written.
    """
    for name, level in (("Kiriko_Viewer", 0.0), ("mine", 1.0)):
        write(tmp_path / f"render {name}.png", level)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    file = tmp_path / "render {viewer}.png"
    assert run("solve", "--out", out, "--viewers", "all", "--pictures", file) == 0
    for name, level in (("Kiriko_Viewer", 0.0), ("mine", 1.0)):
        ideal = pixels(bpy.data.images.load(str(out / f"ideal_{name}.png")))[..., :3]
        np.testing.assert_allclose(ideal, level, atol=1e-3)

    (tmp_path / "render mine.png").unlink()
    for wrong, words in (
        ("render.png", "is a single file for 2 viewers: use {viewer} in place of their names."),
        ("render {viewer}.png", "of the viewer 'mine' cannot be read: it is missing or broken."),
    ):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
        n = len(bpy.data.images)
        capsys.readouterr()
        assert run("solve", "--out", tmp_path / "no", "--pictures", tmp_path / wrong) == 1
        assert words in capsys.readouterr().err
        assert not (tmp_path / "no").exists()
        assert len(bpy.data.images) == n
        assert ours().picture_source == "PLANE"


def test_a_file_is_of_one_viewer(kiriko, rig, tmp_path):
    """Whose name it has as it is, though another's is like it where signs are not allowed: such
    a one has a number. The files of `solve --viewers` are named alike.
    """
    module = loaded("operators.viewer_images")
    for old, new in zip(NAMES, ("an eye", "an_eye"), strict=True):
        bpy.data.objects[old].name = new
    for n, name in enumerate(("an_eye", "an_eye_2")):
        write(tmp_path / f"{name}.png", n)
    for file in (tmp_path / "{viewer}.png", tmp_path):
        found = module.files_of(bpy.context.scene, str(file))
        assert {name: path.stem for name, path in found.items()} == {
            "an eye": "an_eye_2",
            "an_eye": "an_eye",
        }
    reports = loaded("operators.viewer_reports")
    files = reports.file_names(bpy.context.scene, ["an eye"])
    assert files["seen an eye"] == "seen_an_eye_2.png"
    (tmp_path / "an_eye_2.png").unlink()
    with pytest.raises(RuntimeError, match="of the viewer 'an eye' cannot be read"):
        bpy.ops.kiriko.open_pictures(filepath=str(tmp_path / "{viewer}.png"))
