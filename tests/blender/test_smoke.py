"""What asks most of Blender and has no other test that the gate runs in every version."""

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import cube, inventory, new_object, pixels, primitive, small_rig

pytestmark = pytest.mark.every_blender

PANELS = (
    ("main_panel", "VIEW3D_PT_kiriko_main"),
    ("result_panel", "VIEW3D_PT_kiriko_result"),
    ("result_panel", "VIEW3D_PT_kiriko_details"),
    ("rig_panel", "VIEW3D_PT_kiriko_rig"),
    ("export_panel", "VIEW3D_PT_kiriko_export"),
    ("export_panel", "VIEW3D_PT_kiriko_more_exports"),
    ("export_panel", "VIEW3D_PT_kiriko_animation"),
    ("export_panel", "VIEW3D_PT_kiriko_report"),
    ("solve_panel", "VIEW3D_PT_kiriko_check"),
    ("solve_panel", "VIEW3D_PT_kiriko_advanced"),
    ("viewers_panel", "VIEW3D_PT_kiriko_viewers"),
    ("calibration_panel", "VIEW3D_PT_kiriko_calibration"),
    ("calibration_panel", "VIEW3D_PT_kiriko_expected"),
)


@pytest.fixture
def solved(scene) -> bpy.types.Scene:
    """A scene with a small rig and its source image."""
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    return scene


def source() -> np.ndarray:
    """The source image (h, w, 3), linear."""
    return pixels(bpy.context.scene.kiriko.result.source)[..., :3].copy()


def test_each_operator_can_be_called(scene):
    """Blender knows each operator, its tooltip and its properties."""
    for cls in loaded("operators").CLASSES:
        group, name = cls.bl_idname.split(".")
        told = getattr(getattr(bpy.ops, group), name).get_rna_type()
        assert told.description
        assert set(getattr(cls, "__annotations__", {})) <= set(told.properties.keys())


@pytest.mark.parametrize(("module", "name"), PANELS)
@pytest.mark.parametrize("is_solved", [False, True])
def test_panels_are_drawn(drawn, request, module, name, is_solved):
    """Each panel is drawn in an empty scene and beside a result: all it shows is in Blender."""
    if is_solved:
        request.getfixturevalue("solved")
    shown = drawn(module, name, bpy.data.objects.get("Cube"))
    assert not is_solved or shown.props + shown.texts + shown.operators + shown.labels


@pytest.mark.parametrize("is_given", [True, False])
def test_a_rig_is_added_and_removed(scene, is_given):
    """Around a given glass, or a ball: each part once. Remove Rig leaves the file as before."""
    if is_given:
        cube()
    before = inventory()
    assert bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32)) == {"FINISHED"}
    roles = sorted(thing.kiriko.role for thing in scene.objects if thing.kiriko.role != "NONE")
    assert set(roles) >= {"DISPLAY", "GLASS", "PICTURE", "PLATE"}
    assert scene.kiriko.viewer.type == "CAMERA"
    if is_given:
        assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
        assert inventory() == before


def test_add_rig_is_undone(scene):
    """One undo step takes back all of Add Rig."""
    cube()
    bpy.ops.ed.undo_push(message="before")
    names = {thing.name for thing in bpy.context.scene.objects}
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.ed.undo_push(message="Add Rig")
    bpy.ops.ed.undo()
    assert {thing.name for thing in bpy.context.scene.objects} == names


def test_numpy_and_the_kernel_agree(solved, kiriko, monkeypatch):
    """Blender's own numpy gives the source image of the kernel, to rounding."""
    before = source()
    monkeypatch.setenv("KIRIKO_KERNEL", "off")
    loaded("operators.work").forget()
    bpy.ops.kiriko.solve()
    assert np.abs(source() - before).max() < 1e-4


def test_solve_is_undone_and_redone(scene):
    """Undo takes the result back, redo brings the same pixels."""
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.ed.undo_push(message="rig")
    bpy.ops.kiriko.solve()
    before = source()
    bpy.ops.ed.undo_push(message="Solve")
    bpy.ops.ed.undo()
    assert bpy.context.scene.kiriko.result.source is None
    bpy.ops.ed.redo()
    assert np.array_equal(source(), before)


def test_pictures_in_several_colour_spaces_are_read(scene, tmp_path):
    """White is white in each of them; Blender converts one after the other, and goes on."""
    io = loaded("core.files.image_io")
    picture = loaded("core.blender.read.scene_picture")
    path = tmp_path / "white.png"
    io.write(path, np.ones((8, 8, 3)), "PNG8")
    for space in ("Linear Rec.2020", "ACEScg", "Non-Color", "sRGB", "Linear Rec.709"):
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name = space
        assert picture.read_pixels(image, "the picture")[..., :3] == pytest.approx(1.0, abs=1e-3)


def test_the_checklist_names_what_is_missing_and_then_nothing(look, scene, drawn):
    """An object with a role alone lacks its parts; a rig of Add Rig can be solved."""
    new_object(primitive("cube", size=0.1), "BLOCKER")
    look()
    assert "No glass" in " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    assert not bpy.ops.kiriko.solve.poll()
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    look()
    assert bpy.ops.kiriko.solve.poll()


def test_a_mesh_is_shaded_smooth(scene):
    """The checklist's button makes a ball's faces smooth."""
    mesh = primitive("uvsphere", u_segments=16, v_segments=8, radius=0.03)
    glass = new_object(mesh, "GLASS")
    assert bpy.ops.kiriko.shade_smooth(part=glass.name) == {"FINISHED"}
    assert all(face.use_smooth for face in glass.data.polygons)
