import json

import bpy
import numpy as np
import pytest

from small_rigs import inventory, linear_lattice, pixels, small_rig

pytestmark = pytest.mark.every_blender


def numbers(scene: bpy.types.Scene) -> dict:
    return json.loads(scene.kiriko.result.details)


def test_source_is_the_picture_when_nothing_refracts(scene):
    """With an index of 1 a display as large as the picture shows
    the picture itself, upright and unmirrored.
    """
    small_rig(ior=1.0, picture_size=0.03, display_size=0.03, field=0.03)
    bpy.ops.kiriko.solve()
    shown = pixels(scene.kiriko.result.source)[..., :3]
    picture = linear_lattice()
    expected = picture.reshape(64, 16, 64, 16, 3).mean(axis=(1, 3))
    # dots are 4 px wide and lose some sharpness at their
    # edges; a mirrored one has another colour all over
    error = np.abs(shown - expected).mean()
    assert error < 0.004
    for turned in (expected[::-1], expected[:, ::-1]):
        assert error < 0.25 * np.abs(shown - turned).mean()


def test_result_says_what_was_read_and_done(scene):
    """After a solve the scene holds image, coverage, a
    sentence, and the index with the place it comes from.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    assert tuple(result.source.size) == (64, 64)
    assert result.source.packed_file is not None
    assert result.source.is_float
    assert 0.99 < result.coverage <= 1
    assert result.summary.startswith("The display shows")

    read = numbers(scene)["materials"][0]
    assert (read["object_name"], read["source"], round(read["ior"], 4)) == (
        "Cube",
        "override",
        1.49,
    )


def test_the_kernel_has_as_many_threads_as_a_render(scene, kiriko):
    """The threads of renders hold for solves, whose source image is the same for any number."""
    small_rig()
    sources = []
    for number in (1, 3):
        scene.render.threads_mode, scene.render.threads = "FIXED", number
        bpy.ops.kiriko.solve()
        assert kiriko.core.native.loading.n_threads() == number
        sources.append(pixels(scene.kiriko.result.source))
        scene.kiriko.tolerance += 1e-9  # another solve
    assert np.array_equal(*sources)


def test_source_is_saved_with_the_file(scene, tmp_path):
    """Every number of the source image is the same after saving and loading."""
    small_rig()
    bpy.ops.kiriko.solve()
    before = pixels(scene.kiriko.result.source).copy()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert np.array_equal(before, pixels(bpy.context.scene.kiriko.result.source))


def test_material_of_the_user_gives_way_and_is_kept(scene):
    """The display emits the source.

    The user's own material stays in the mesh and the file, and the notes name it.
    """
    display = small_rig()["DISPLAY"]
    mine = bpy.data.materials.new("Mine")
    display.data.materials[0] = mine
    bpy.ops.kiriko.solve()
    assert display.data.materials[0] == mine
    assert mine.use_fake_user
    assert display.material_slots[0].material != mine
    assert "'Mine'" in scene.kiriko.result.notes
    images = {
        n.image for n in display.material_slots[0].material.node_tree.nodes if n.type == "TEX_IMAGE"
    }
    assert images == {scene.kiriko.result.source}


def test_solving_again_leaves_no_litter(scene):
    """A second solve replaces image and material of the
    first, also when the display's resolution changes.
    """
    display = small_rig()["DISPLAY"]
    bpy.ops.kiriko.solve()
    before = inventory()
    bpy.ops.kiriko.solve()
    display.kiriko.resolution = (32, 32)
    bpy.ops.kiriko.solve()
    assert inventory() == before
    assert tuple(scene.kiriko.result.source.size) == (32, 32)


def test_failed_solve_leaves_everything_as_it_was(scene):
    """A plate that no ray reaches is one sentence; the earlier result and its image stay."""
    rig = small_rig()
    bpy.ops.kiriko.solve()
    before = inventory()
    shown = pixels(scene.kiriko.result.source).copy()
    summary = scene.kiriko.result.summary
    rig["PLATE"].location.x += 10
    with pytest.raises(RuntimeError, match="no ray reaches the plate: move or enlarge it"):
        bpy.ops.kiriko.solve()
    assert inventory() == before
    assert np.array_equal(shown, pixels(scene.kiriko.result.source))
    assert scene.kiriko.result.summary == summary


def test_what_of_the_material_is_not_followed_is_named_in_the_result(scene):
    """A rough glass solves as clear glass, and the result's notes say so."""
    glass = small_rig()["GLASS"]
    material = bpy.data.materials.new("Frosted")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    shader = material.node_tree.nodes.new("ShaderNodeBsdfGlass")
    shader.inputs["Roughness"].default_value = 0.2
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    glass.data.materials.clear()
    glass.data.materials.append(material)

    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    (note,) = (note for note in scene.kiriko.result.notes.splitlines() if "Frosted" in note)
    assert "Roughness 0.2" in note


def test_a_rig_without_a_plate_is_solved_straight(scene):
    """A display behind the glass, and no plate, of which the rig knows: the sentence says that
    there is none, and Only Through Plate changes nothing.
    """
    rig = small_rig()
    bpy.data.objects.remove(rig["PLATE"])
    with pytest.raises(RuntimeError, match="plate is missing: make a new one"):
        bpy.ops.kiriko.solve()
    bpy.ops.kiriko.go_without_plate()
    display = rig["DISPLAY"]
    display.matrix_world = rig["PICTURE"].matrix_world.copy()
    display.location.y += 0.06
    display.scale *= 3
    bpy.context.view_layer.update()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    assert result.summary.startswith("Without a plate, the display shows ")
    assert "missed the plate" not in result.summary
    assert result.coverage > 0.5

    before = pixels(result.source).copy()
    scene.kiriko.only_through_plate = False
    bpy.ops.kiriko.solve()
    assert np.array_equal(pixels(result.source), before)
