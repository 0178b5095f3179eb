from types import ModuleType
from typing import Any

import bpy
import pytest

from extension import loaded
from small_rigs import new_object, small_rig
from test_remove_rig import differences, plain, snapshot


def space() -> bpy.types.SpaceView3D:
    """The 3D view of the window, which is there in background, too."""
    areas = bpy.context.window.screen.areas
    return max((a for a in areas if a.type == "VIEW_3D"), key=lambda a: a.width).spaces.active


def maximise() -> None:
    """Maximise that view, or put it back among the others, as Ctrl Space does."""
    window = bpy.context.window
    area = max((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width)
    with bpy.context.temp_override(window=window, screen=window.screen, area=area):
        bpy.ops.screen.screen_full_area()


def view() -> dict[str, Any]:
    """All settings of that 3D view that the button may change."""
    now = space()
    return {
        "shading": now.shading.type,
        "overlays": now.overlay.show_overlays,
        "has_world": now.shading.use_scene_world_render,
        "studio": now.shading.studiolight_intensity,
        "background": now.shading.studiolight_background_alpha,
        "is_local": now.use_local_camera,
        "camera": now.camera,
        **{
            name: plain_value(getattr(now.region_3d, name))
            for name in (
                "view_perspective",
                "view_location",
                "view_rotation",
                "view_distance",
                "view_camera_zoom",
                "view_camera_offset",
            )
        },
    }


def plain_value(value: Any) -> Any:
    return value if isinstance(value, str | float) else [*value]


def turned_away() -> None:
    """A view that the artist has turned, in Wireframe."""
    now = space()
    now.shading.type = "WIREFRAME"
    now.region_3d.view_perspective = "PERSP"
    now.region_3d.view_location, now.region_3d.view_distance = (1, 2, 3), 4.5
    now.region_3d.view_rotation = (0.5, 0.5, 0.5, 0.5)


def button() -> ModuleType:
    return loaded("operators.look_through")


def live() -> ModuleType:
    return loaded("operators.live")


@pytest.fixture
def rig(scene) -> dict[str, bpy.types.Object]:
    """A small rig in a scene with a camera of the artist's own."""
    scene.camera = new_object(bpy.data.cameras.new("Mine"))
    made = small_rig()
    scene.render.engine = "BLENDER_WORKBENCH"
    turned_away()
    return made


def test_there_and_back(scene, rig):
    """The view has the viewer's camera, Rendered in Cycles, and Live is on; the scene's camera
    stays. Pressed again every property of every datablock and of the view is as before.
    """
    before, seen = snapshot(), view()
    assert bpy.ops.kiriko.look_through() == {"FINISHED"}
    assert view()["camera"] == scene.kiriko.viewer
    assert view()["shading"] == "RENDERED"
    assert view()["view_perspective"] == "CAMERA"
    assert scene.camera.data.name == "Mine"
    assert scene.render.engine == "CYCLES"
    assert scene.cycles.use_preview_denoising
    assert scene.cycles.preview_denoising_start_sample == 1
    assert scene.cycles.preview_samples < 32
    assert live().is_on()

    bpy.ops.kiriko.look_through()
    assert not live().is_on()
    assert view() == seen
    assert differences(before, snapshot()) == []


def sun(scene: bpy.types.Scene) -> bpy.types.Object:
    return new_object(bpy.data.lights.new("Sun", "SUN"))


def grey(scene: bpy.types.Scene) -> None:
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):  # which has them always
        scene.world.use_nodes = True


def textured(scene: bpy.types.Scene) -> None:
    grey(scene)
    tree = scene.world.node_tree
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    sky = tree.nodes.new("ShaderNodeTexChecker")
    tree.links.new(sky.outputs[0], background.inputs["Color"])


def black(scene: bpy.types.Scene) -> None:
    grey(scene)
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0, 0, 0, 1)


def switched_off(scene: bpy.types.Scene) -> None:
    grey(scene)
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Strength"].default_value = 0


def hidden_sun(scene: bpy.types.Scene) -> None:
    sun(scene).hide_viewport = True


@pytest.mark.parametrize(
    ("make", "is_lit"),
    [
        (lambda scene: None, False),
        (black, False),
        (switched_off, False),
        (hidden_sun, False),
        (sun, True),
        (grey, True),
        (textured, True),
    ],
    ids=["no world", "black", "off", "hidden sun", "sun", "grey", "textured"],
)
def test_glass_in_the_dark_is_lit_faintly(scene, rig, make, is_lit):
    """By the view's own studio light, and in this view alone; a scene with light has its own."""
    space().shading.use_scene_world_render = True
    space().shading.studiolight_intensity = 1.5
    make(scene)
    bpy.context.view_layer.update()
    before, seen = snapshot(), view()
    bpy.ops.kiriko.look_through()
    assert view()["has_world"] == is_lit
    assert view()["studio"] == pytest.approx(1.5 if is_lit else 0.1)
    bpy.ops.kiriko.look_through()
    assert view() == seen
    assert differences(before, snapshot()) == []


def test_live_stays_on_where_it_was(scene, rig):
    """The button stops only what it began."""
    bpy.ops.kiriko.live()
    bpy.ops.kiriko.look_through()
    bpy.ops.kiriko.look_through()
    assert live().is_on()
    bpy.ops.kiriko.live()


def test_whatever_the_artist_changes_meanwhile_stays(scene, rig):
    """Samples, and a view that is turned away; the rest is put back."""
    bpy.ops.kiriko.look_through()
    scene.cycles.preview_samples = 77
    space().region_3d.view_perspective = "PERSP"
    space().region_3d.view_distance = 9.0
    bpy.ops.kiriko.look_through()
    assert scene.cycles.preview_samples == 77
    assert view()["view_distance"] == 9
    assert (view()["shading"], scene.render.engine) == ("WIREFRAME", "BLENDER_WORKBENCH")


def test_a_file_that_is_saved_meanwhile_has_the_artists_settings(scene, rig, tmp_path):
    """And the view goes on after it."""
    bpy.ops.kiriko.look_through()
    looking = view()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert view() == looking
    assert scene.render.engine == "CYCLES"
    bpy.ops.wm.open_mainfile(filepath=path)
    assert bpy.context.scene.render.engine == "BLENDER_WORKBENCH"
    assert bpy.context.scene.kiriko_scene.looking == ""
    assert (view()["shading"], view()["is_local"]) == ("WIREFRAME", False)


def test_a_view_that_stays_while_another_file_is_opened_is_put_back(scene, rig, tmp_path):
    """As where Blender is not to load the interface of files. A file that cannot be opened leaves
    all as it is.
    """
    seen = {**view(), "camera": None}
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.kiriko.look_through()
    looking = view()
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"no file of Blender's")
    with pytest.raises(RuntimeError):
        bpy.ops.wm.open_mainfile(filepath=str(broken), load_ui=False)
    assert view() == looking
    assert scene.render.engine == "CYCLES"
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    assert {**view(), "camera": None} == seen
    assert bpy.context.scene.render.engine == "BLENDER_WORKBENCH"


def test_a_file_that_was_saved_by_force_is_put_back_when_it_is_opened(scene, rig, tmp_path):
    """Such as an auto-save, which asks no add-on before."""
    seen = {**view(), "camera": None}
    bpy.ops.kiriko.look_through()
    path = str(tmp_path / "forced.blend")
    handlers = bpy.app.handlers.save_pre
    ours = next(f for f in handlers if f.__module__ == button().__name__)
    handlers.remove(ours)
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    handlers.append(ours)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert bpy.context.scene.render.engine == "BLENDER_WORKBENCH"
    assert bpy.context.scene.kiriko_scene.looking == ""
    assert {**view(), "camera": None} == seen


def test_a_viewer_that_is_deleted_meanwhile_keeps_nobody_there(scene, rig):
    """The button is the way back all the same."""
    seen = view()
    bpy.ops.kiriko.look_through()
    bpy.data.objects.remove(scene.kiriko.viewer)
    bpy.ops.kiriko.look_through()
    assert view() == seen
    assert scene.render.engine == "BLENDER_WORKBENCH"


def test_undo_to_before_takes_the_view_along(scene, rig):
    """Undo knows the scene and not the view, which follows; Live stops, too."""
    seen = {**view(), "camera": None}
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.kiriko.look_through()
    bpy.ops.ed.undo_push(message="Look Through Viewer")
    bpy.ops.ed.undo()
    button().follow()  # by a timer, which background has not
    assert {**view(), "camera": None} == seen
    assert bpy.context.scene.render.engine == "BLENDER_WORKBENCH"
    assert not live().is_on()


def test_remove_rig_leaves_the_view_first(scene, rig):
    """Nothing of it stays behind."""
    seen = view()
    bpy.ops.kiriko.look_through()
    bpy.ops.kiriko.remove_rig()
    assert view() == seen
    assert scene.render.engine == "BLENDER_WORKBENCH"


def test_without_a_viewer_the_button_is_grey(scene, rig):
    """And says why."""
    scene.kiriko.viewer = scene.camera = None
    with pytest.raises(RuntimeError, match="No viewer: add a camera"):
        bpy.ops.kiriko.look_through()


def test_a_plane_of_the_artists_is_no_part_of_what_is_seen(scene, rig):
    """It would stand before the light that makes the picture."""
    before = plain(rig["PICTURE"])
    rig["PICTURE"].visible_camera = True
    bpy.ops.kiriko.look_through()
    assert not rig["PICTURE"].visible_camera
    bpy.ops.kiriko.look_through()
    assert rig["PICTURE"].visible_camera
    rig["PICTURE"].visible_camera = False
    assert differences(before, plain(rig["PICTURE"])) == []


@pytest.mark.parametrize("is_saved", [False, True])
def test_things_that_are_renamed_meanwhile_are_put_back(scene, rig, is_saved, tmp_path):
    """Picture, viewer and the artist's camera, which stays the scene's; after a save, too."""
    rig["PICTURE"].visible_camera = True
    viewer, mine, seen = scene.kiriko.viewer, scene.camera, view()
    assert viewer.data.show_passepartout
    bpy.ops.kiriko.look_through()
    rig["PICTURE"].name, viewer.name, mine.name = "A", "B", "C"
    scene.kiriko.viewer = mine
    if is_saved:
        looking = view()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"), copy=True)
        assert view() == looking
        assert not rig["PICTURE"].visible_camera
        assert not viewer.data.show_passepartout

    bpy.ops.kiriko.look_through()
    assert rig["PICTURE"].visible_camera
    assert viewer.data.show_passepartout
    assert (view(), scene.camera) == (seen, mine)
    marked = [*bpy.data.objects, *bpy.data.cameras]
    assert not any("kiriko_looking" in thing for thing in marked)


@pytest.mark.parametrize("is_left_at_first", [True, False])
def test_the_view_follows_the_chosen_viewer(scene, rig, is_left_at_first):
    """Whichever is chosen, and the view is fitted to its image; Live goes on. In the end all is as
    before. A view that was given another camera stays.
    """
    choose_rig = loaded("operators.choose_rig")
    bpy.ops.kiriko.two_eyes()
    left, right = (one.camera for one in list(scene.kiriko.viewers)[1:])
    right.kiriko.use_resolution, right.kiriko.resolution = True, (64, 16)
    scene.kiriko.viewer_shown = 1 if is_left_at_first else 2
    choose_rig.follow_selection()
    before, seen = snapshot(), view()
    bpy.ops.kiriko.look_through()
    zooms = {}
    for number in (2, 1, 2, 0, 1 if is_left_at_first else 2):
        scene.kiriko.viewer_shown = number
        choose_rig.follow_selection()
        shown = right if number == 2 else left  # the first one is off
        assert view()["camera"] == shown
        assert view()["view_perspective"] == "CAMERA"
        assert view()["view_camera_zoom"] == zooms.setdefault(shown, view()["view_camera_zoom"])
        assert live().is_on()
    assert zooms[left] != zooms[right]
    bpy.ops.kiriko.look_through()
    assert view() == seen
    assert not live().is_on()
    assert differences(before, snapshot()) == []

    bpy.ops.kiriko.look_through()
    space().camera = scene.camera
    scene.kiriko.viewer_shown = 2 if is_left_at_first else 1
    choose_rig.follow_selection()
    assert view()["camera"] == scene.camera
