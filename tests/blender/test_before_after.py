import importlib
from itertools import permutations
from types import ModuleType

import bpy
import numpy as np
import pytest
from mathutils import Vector

from extension import loaded
from small_rigs import small_rig
from test_looking_through import maximise, space, turned_away, view


@pytest.fixture
def compared(kiriko) -> ModuleType:
    return loaded("operators.compared")


def test_images_are_those_of_the_solution(scene, compared):
    """After is nearer to the ideal image than before, by far; nothing of the scene has changed."""
    small_rig()
    before = {(type(block), block.name) for block in bpy.data.user_map()}
    assert bpy.ops.kiriko.before_after() == {"FINISHED"}
    assert {(type(block), block.name) for block in bpy.data.user_map()} == before

    made = compared.found(scene).comparison
    error = {name: np.abs(getattr(made, name) - made.ideal).mean() for name in ("before", "after")}
    assert made.before.shape == made.after.shape == made.source.shape == (64, 64, 3)
    assert error["after"] < 0.6 * error["before"]


def test_corners_are_those_of_the_cameras_frame(scene, compared):
    """Each against Blender's own frame of a camera that has the pixels of the render."""
    small_rig()
    camera = scene.kiriko.viewer
    scene.render.resolution_x, scene.render.resolution_y = 96, 64
    camera.data.shift_x = 0.1
    camera.kiriko.use_resolution = False
    bpy.ops.kiriko.before_after()

    right_up, right_low, left_low, left_up = camera.data.view_frame(scene=scene)
    for found, expected in zip(
        compared.found(scene).corners, (left_up, right_up, right_low, left_low), strict=True
    ):
        assert (found / found.z - expected / expected.z).length < 1e-5 * Vector(expected).length


def test_comparison_is_saved_with_the_images_that_are_chosen(scene, compared, tmp_path):
    """Left and right half of the file are the two images to half a step of 8 bits."""
    small_rig()
    bpy.context.window_manager.kiriko.left = "IDEAL"
    bpy.context.window_manager.kiriko.right = "SOURCE"
    path = tmp_path / "both.png"
    try:
        bpy.ops.kiriko.save_comparison(filepath=str(path))
    finally:
        for name in ("left", "right"):
            bpy.context.window_manager.kiriko.property_unset(name)

    io = loaded("core.files.image_io")
    numbers, _ = io.read(path)
    made = compared.found(scene).comparison
    assert numbers.shape == (64, 64 + 8 + 64, 3)
    for part, image in ((numbers[:, :64], made.ideal), (numbers[:, -64:], made.source)):
        assert np.abs(part - io.encode(np.clip(image, 0, 1))).max() <= 0.5 / 255 + 1e-6


def test_file_that_is_there_is_kept(scene, tmp_path):
    small_rig()
    path = tmp_path / "both.png"
    path.write_text("mine")
    with pytest.raises(RuntimeError, match="already exists"):
        bpy.ops.kiriko.save_comparison(filepath=str(path))
    assert path.read_text() == "mine"


def test_remove_rig_leaves_the_comparison(scene):
    """And the view as it was, with the artist's own camera."""
    scene.camera = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
    scene.collection.objects.link(scene.camera)
    small_rig()
    scene.camera = bpy.data.objects["mine"]
    areas = bpy.context.window.screen.areas
    space = max((a for a in areas if a.type == "VIEW_3D"), key=lambda a: a.width).spaces.active

    def view() -> tuple:
        return space.region_3d.view_perspective, space.use_local_camera, space.camera

    before = view()
    bpy.ops.kiriko.before_after()
    assert view() != before
    bpy.ops.kiriko.remove_rig()
    assert not bpy.context.window_manager.kiriko.show_comparison
    assert view() == before


def test_another_file_begins_without_a_comparison(scene, compared):
    """The button is up, and nothing of the file before is held."""
    small_rig()
    bpy.ops.kiriko.before_after()
    manager = bpy.context.window_manager
    assert manager.kiriko.show_comparison
    uid = scene.session_uid
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not bpy.context.window_manager.kiriko.show_comparison
    assert uid not in compared._found


@pytest.mark.parametrize("is_scenes_camera", [True, False])
@pytest.mark.parametrize(
    "order",
    [
        *sorted({*permutations("CCLL"), tuple("CLLCLCCL")}),
        *map(tuple, ("LMLM", "MLML", "CMCM", "MCMC", "LMCLMC", "MCLMCL")),
    ],
)
def test_comparison_and_look_through_in_any_order(scene, compared, order, is_scenes_camera):
    """Each on and off, crossed or not, and the view maximised meanwhile (M): the view and the
    scene's settings are as before; while one of them is on, the view shows the viewer's camera.
    """
    small_rig()
    viewer = scene.kiriko.viewer
    if not is_scenes_camera:
        scene.camera = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
        scene.collection.objects.link(scene.camera)
    scene.render.engine = "BLENDER_WORKBENCH"
    turned_away()
    before = view()
    is_on = dict.fromkeys("CL", False)
    for button in order:
        if button == "M":
            maximise()
            continue
        if button == "L":
            bpy.ops.kiriko.look_through()
        elif is_on["C"]:
            compared.leave()
        else:
            bpy.ops.kiriko.before_after()
        is_on[button] = not is_on[button]
        if any(is_on.values()):
            assert space().region_3d.view_perspective == "CAMERA"
            assert (space().camera if space().use_local_camera else scene.camera) == viewer
        assert (scene.render.engine == "CYCLES") == is_on["L"]
        assert (space().shading.type == "RENDERED") == is_on["L"]
    assert view() == before
    assert all(len(screen.keys()) == 0 for screen in bpy.data.screens)


@pytest.mark.parametrize("looks", ["", "before", "after"])
def test_a_file_that_is_saved_meanwhile_has_the_artists_view(scene, tmp_path, looks):
    """And the view goes on after it, in the same way; looked through, too."""
    small_rig()
    scene.camera = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
    scene.collection.objects.link(scene.camera)
    turned_away()
    before = {**view(), "camera": None}
    if looks == "before":
        bpy.ops.kiriko.look_through()
    bpy.ops.kiriko.before_after()
    if looks == "after":
        bpy.ops.kiriko.look_through()
    shown = view()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert view() == shown
    bpy.ops.wm.open_mainfile(filepath=path)
    assert {**view(), "camera": None} == before
    assert not any(screen.keys() for screen in bpy.data.screens)


def test_a_view_that_the_artist_zooms_meanwhile_keeps_the_zoom(scene, compared):
    """It shows all of the image at first; a frame of before comes back where it is not touched."""
    small_rig()
    look = space().region_3d
    look.view_perspective = "CAMERA"
    look.view_camera_zoom, look.view_camera_offset = 33.0, (0.25, -0.5)
    before = view()
    bpy.ops.kiriko.before_after()
    framing = importlib.import_module(f"{compared.__package__}.framing")
    area = max(
        (a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width
    )
    core = importlib.import_module(f"{framing.framed.__module__}")
    zoom, offset = core.image_framed((64, 64), framing.window_of(area))
    assert look.view_camera_zoom == pytest.approx(zoom, rel=1e-6)
    assert look.view_camera_offset[:] == pytest.approx(offset, rel=1e-6)
    compared.leave()
    assert view() == before
    bpy.ops.kiriko.before_after()
    look.view_camera_zoom = 7.0
    compared.leave()
    assert view()["view_camera_zoom"] == 7.0


def test_add_rig_leaves_the_comparison(scene):
    """A second rig: the view has no camera of the first one's."""
    small_rig()
    turned_away()
    scene.camera = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
    scene.collection.objects.link(scene.camera)
    before = view()
    bpy.ops.kiriko.before_after()
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.04, location=(1, 0, 0))
    bpy.ops.kiriko.add_rig()
    assert not bpy.context.window_manager.kiriko.show_comparison
    assert view() == before
