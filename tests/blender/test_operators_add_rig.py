import bpy
import numpy as np
import pytest
from small_rigs import SIDE, cube, inventory, small_rig

SINGLE = 1e-6  # m; Blender keeps positions in float32, here of up to 1 m


def world_corners(thing: bpy.types.Object) -> np.ndarray:
    """Vertices (n, 3) of an object in the world."""
    bpy.context.view_layer.update()
    return np.array([thing.matrix_world @ vertex.co for vertex in thing.data.vertices])


def normal_of(thing: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    return np.array(thing.matrix_world.to_3x3() @ thing.data.polygons[0].normal)


@pytest.mark.parametrize(("tilt", "azimuth"), [(45, 0), (30, 0), (60, 75), (45, -160)])
def test_display_is_the_mirror_image_of_the_picture(scene: bpy.types.Scene, tilt: float, azimuth: float) -> None:
    """Each corner of the picture, mirrored at the plate's plane, is that corner of a display of the same size."""
    options = {"tilt": np.radians(tilt), "azimuth": np.radians(azimuth), "picture_size": 0.02, "display_size": 0.02}
    rig = small_rig(**options)
    plate, normal = world_corners(rig["PLATE"]).mean(axis=0), normal_of(rig["PLATE"])
    picture = world_corners(rig["PICTURE"])
    mirrored = picture - 2 * ((picture - plate) @ normal)[:, None] * normal
    assert np.abs(mirrored - world_corners(rig["DISPLAY"])).max() < SINGLE


def test_parts_face_each_other(scene: bpy.types.Scene) -> None:
    """The picture faces the viewer, the display faces the plate, from below."""
    rig = small_rig()
    to_viewer = scene.kiriko.viewer.matrix_world.translation - rig["PICTURE"].matrix_world.translation
    to_plate = rig["PLATE"].matrix_world.translation - rig["DISPLAY"].matrix_world.translation
    assert normal_of(rig["PICTURE"]) @ np.array(to_viewer) == pytest.approx(1.0, abs=SINGLE)
    assert normal_of(rig["DISPLAY"]) @ np.array(to_plate) == pytest.approx(0.15, abs=SINGLE)
    assert to_plate.z > 0


def test_display_without_refraction_is_as_large_as_the_picture(scene: bpy.types.Scene) -> None:
    """With an index of 1 the light of the picture lands on its mirror image, so that is the size the display needs."""
    rig = small_rig(ior=1.0)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(1.01 * rig["PICTURE"].dimensions.x, rel=1e-4)
    assert "all the light" in scene.kiriko.result.summary


def test_display_is_as_large_as_the_light_of_the_picture_needs(scene: bpy.types.Scene) -> None:
    """Solving covers the whole picture; with a display a tenth smaller it does not."""
    rig = small_rig()
    bpy.ops.kiriko.solve()
    whole = scene.kiriko.result.coverage
    rig["DISPLAY"].scale *= 0.9
    bpy.ops.kiriko.solve()
    assert whole > 0.999  # the picture's edge lies within a viewer pixel
    assert scene.kiriko.result.coverage < 0.97
    assert "missed the display" in scene.kiriko.result.summary


def test_limit_of_the_display_is_kept_and_its_loss_reported(scene: bpy.types.Scene) -> None:
    """A display that may not be as large as needed is as large as allowed, and the summary says what is lost."""
    rig = small_rig(max_display_size=0.025)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(0.025, rel=1e-5)
    assert "missed the display" in scene.kiriko.result.summary


def test_default_rig_is_the_reference_ball(scene: bpy.types.Scene) -> None:
    """With nothing selected it is the ball of docs: 25 mm, D = 150 mm, picture 30 mm, 50 mm of field at 1 m."""
    bpy.ops.kiriko.add_rig()
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    viewer = scene.kiriko.viewer
    assert len(rig["GLASS"].data.polygons) == 20480
    assert rig["GLASS"].dimensions.x == pytest.approx(0.05, abs=1e-4)
    assert rig["PICTURE"].dimensions.x == pytest.approx(0.03, abs=1e-4)
    assert tuple(rig["PLATE"].matrix_world.translation) == pytest.approx((0, 0.15, 0), abs=SINGLE)
    assert tuple(viewer.matrix_world.translation) == pytest.approx((0, -1, 0), abs=SINGLE)
    assert 2 * np.tan(viewer.data.angle / 2) == pytest.approx(0.05, abs=1e-4)
    # optics.md: the light of the picture's corner lands 30.2 mm from the display's centre
    assert rig["DISPLAY"].dimensions.x / 2 * np.sqrt(2) == pytest.approx(1.01 * 0.0302, abs=5e-4)


def test_rig_follows_the_unit_scale(scene: bpy.types.Scene) -> None:
    """In a scene of millimetres the same rig is a thousand times larger in Blender units."""
    scene.unit_settings.scale_length = 0.001
    bpy.ops.kiriko.add_rig()
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    assert rig["GLASS"].dimensions.x == pytest.approx(50, abs=0.1)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(43.2, abs=0.5)
    assert tuple(rig["PLATE"].matrix_world.translation) == pytest.approx((0, 150, 0), abs=1e-3)


def test_large_glass_does_not_cut_the_plate(scene: bpy.types.Scene) -> None:
    """Around Blender's own cube of 2 m the rig grows with the glass, so that glass and plate stay apart."""
    cube(2.0)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    plate, normal = world_corners(rig["PLATE"]).mean(axis=0), normal_of(rig["PLATE"])
    side = (world_corners(rig["GLASS"]) - plate) @ normal
    assert (side < 0).all() or (side > 0).all()


def test_selected_glass_is_left_alone_but_for_its_role(scene: bpy.types.Scene) -> None:
    """The glass keeps name, mesh, place and material slots; only its role is set."""
    glass = cube(turn=0.3)
    before = (glass.name, glass.data, glass.matrix_world.copy(), len(glass.material_slots))
    bpy.ops.kiriko.add_rig(viewer_resolution=64)
    assert (glass.name, glass.data, glass.matrix_world, len(glass.material_slots)) == before
    assert glass.kiriko.role == "GLASS"


def test_undo_removes_the_rig_and_redo_brings_it_back(scene: bpy.types.Scene) -> None:
    """After undo the file is as before; after redo the rig is there and solves."""
    cube(SIDE)
    bpy.ops.ed.undo_push(message="before")
    before = inventory()
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    bpy.ops.ed.undo_push(message="Add Rig")
    after = inventory()
    bpy.ops.ed.undo()
    assert inventory() == before
    assert bpy.data.objects["Cube"].kiriko.role == "NONE"
    bpy.ops.ed.redo()
    assert inventory() == after
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_second_rig_is_refused_and_changes_nothing(scene: bpy.types.Scene) -> None:
    """A scene with a display gets no second one; the sentence names it, and nothing is made."""
    small_rig()
    before = inventory()
    with pytest.raises(RuntimeError, match="has a display already \\('Kiriko Display'\\)"):
        bpy.ops.kiriko.add_rig()
    assert inventory() == before


def test_failure_leaves_nothing_behind(scene: bpy.types.Scene) -> None:
    """A viewer inside the glass is refused in one sentence; objects, roles and render size are as before."""
    glass = cube()
    size = scene.render.resolution_x, scene.render.resolution_y
    before = inventory()
    with pytest.raises(RuntimeError, match="inside the glass 'Cube'"):
        bpy.ops.kiriko.add_rig(viewer_distance=0.01)
    assert inventory() == before
    assert glass.kiriko.role == "NONE"
    assert scene.kiriko.viewer is None
    assert scene.camera is None
    assert (scene.render.resolution_x, scene.render.resolution_y) == size
