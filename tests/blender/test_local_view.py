"""A 3D view in local view, as by the key /, shows some objects alone; the rig stays whole."""

import bpy
import pytest

from extension import loaded
from small_rigs import new_object, primitive, small_rig
from test_looking_through import space


def in_local_view(*things: bpy.types.Object) -> dict:
    """Have the window's 3D view show these objects alone; returns the context of that view."""
    bpy.context.view_layer.update()
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing in things)
    area = next(area for area in bpy.context.screen.areas if area.spaces.active == space())
    region = next(region for region in area.regions if region.type == "WINDOW")
    context = {"area": area, "region": region}
    with bpy.context.temp_override(**context):
        bpy.ops.view3d.localview(frame_selected=False)
    assert seen() == set(things)
    return context


def seen() -> set[bpy.types.Object]:
    """The objects that the window's 3D view shows."""
    bpy.context.view_layer.update()
    return {t for t in bpy.context.view_layer.objects if t.visible_get(viewport=space())}


@pytest.mark.usefixtures("no_remedies")
def test_a_rig_is_solved_from_a_view_that_shows_its_glass_alone(scene):
    """Local view hides nothing from the rig: buttons are active and the picture arrives."""
    glass = small_rig()["GLASS"]
    with bpy.context.temp_override(**in_local_view(glass)):
        assert bpy.ops.kiriko.solve.poll()
        assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert scene.kiriko.result.coverage > 0.9


def test_types_that_a_view_hides_are_parts(scene):
    """The filter of types in a view's header is of that view alone, too."""
    small_rig()
    view = in_local_view(*scene.objects)
    space().show_object_viewport_mesh = False
    try:
        with bpy.context.temp_override(**view):
            assert bpy.ops.kiriko.solve.poll()
    finally:
        space().show_object_viewport_mesh = True


def test_parts_are_told_in_a_file_dialogue(scene):
    """Blender's context there answers None to all names that it does not know, and the dialogue of
    Export Atlas asks for the display.
    """
    display = small_rig()["DISPLAY"]
    needed = loaded("operators.needed")
    area = bpy.context.screen.areas[0]
    before = area.type
    area.type = "FILE_BROWSER"
    try:
        with bpy.context.temp_override(area=area):
            assert bpy.context.temp_override is None
            assert needed.parts(scene)["DISPLAY"] == {display: ""}
    finally:
        area.type = before


@pytest.mark.usefixtures("no_remedies")
def test_a_new_rig_is_seen_in_local_view(scene):
    """Add Rig shows all that it made in the view that shows the glass alone, and nothing else."""
    glass, other = (new_object(primitive("cube", size=side)) for side in (0.03, 0.01))
    with bpy.context.temp_override(**in_local_view(glass)):
        assert bpy.ops.kiriko.add_rig() == {"FINISHED"}
    assert seen() == set(scene.objects) - {other}


def test_the_viewer_looks_at_all_of_the_rig(scene, tmp_path):
    """Look Through Viewer shows the display in a view that showed the glass alone, after a save,
    too; then that view shows the glass alone again.
    """
    glass = small_rig()["GLASS"]
    with bpy.context.temp_override(**in_local_view(glass)):
        bpy.ops.kiriko.look_through()
        assert seen() == set(scene.objects)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
        assert seen() == set(scene.objects)
        bpy.ops.kiriko.look_through()
        assert seen() == {glass}


@pytest.mark.parametrize("is_filtered", [False, True])
def test_a_local_view_that_was_entered_meanwhile_stays(scene, is_filtered):
    """The artist leaves the view of the glass, and enters one of glass and display, while looking
    through the viewer: that one stays. An object made meanwhile, which no local view shows, and
    types that a view hides, are no sign of another one.
    """
    parts = small_rig()
    glass, display = parts["GLASS"], parts["DISPLAY"]
    view = in_local_view(glass)
    with bpy.context.temp_override(**view):
        bpy.ops.kiriko.look_through()
        bpy.ops.view3d.localview(frame_selected=False)
    in_local_view(glass, display)
    with bpy.context.temp_override(**view):
        bpy.ops.kiriko.look_through()
        assert seen() == {glass, display}
        bpy.ops.view3d.localview(frame_selected=False)

    view = in_local_view(glass)
    space().show_object_viewport_camera = not is_filtered
    with bpy.context.temp_override(**view):
        bpy.ops.kiriko.look_through()
        new_object(primitive("cube", size=0.01))
        bpy.ops.kiriko.look_through()
    space().show_object_viewport_camera = True
    assert seen() == {glass}
