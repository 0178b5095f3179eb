import importlib
import re
from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from known.closed_forms import landing, through_ball
from small_rigs import SIDE, cube, inventory, new_object, primitive, small_rig

SINGLE = 1e-6  # m; Blender keeps positions in float32, here of up to 1 m


def world_corners(thing: bpy.types.Object) -> np.ndarray:
    """Vertices (n, 3) of an object in the world."""
    bpy.context.view_layer.update()
    return np.array([thing.matrix_world @ vertex.co for vertex in thing.data.vertices])


def normal_of(thing: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    return np.array(thing.matrix_world.to_3x3() @ thing.data.polygons[0].normal)


@pytest.mark.parametrize(("tilt", "azimuth"), [(45, 0), (30, 0), (60, 75), (45, -160)])
def test_display_is_the_mirror_image_of_the_picture(
    scene: bpy.types.Scene, tilt: float, azimuth: float
) -> None:
    """Each corner of the picture, mirrored at the plate's
    plane, is that corner of a display of the same size.
    """
    options = {
        "tilt": np.radians(tilt),
        "azimuth": np.radians(azimuth),
        "picture_size": 0.02,
        "display_size": 0.02,
    }
    rig = small_rig(**options)
    plate = world_corners(rig["PLATE"]).mean(axis=0)
    normal = normal_of(rig["PLATE"])
    picture = world_corners(rig["PICTURE"])
    mirrored = picture - 2 * ((picture - plate) @ normal)[:, None] * normal
    assert np.abs(mirrored - world_corners(rig["DISPLAY"])).max() < SINGLE


def test_parts_face_each_other(scene: bpy.types.Scene) -> None:
    """The picture faces the viewer, the display faces the plate, from below."""
    rig = small_rig()
    to_viewer = (
        scene.kiriko.viewer.matrix_world.translation - rig["PICTURE"].matrix_world.translation
    )
    to_plate = rig["PLATE"].matrix_world.translation - rig["DISPLAY"].matrix_world.translation
    assert normal_of(rig["PICTURE"]) @ np.array(to_viewer) == pytest.approx(1.0, abs=SINGLE)
    assert normal_of(rig["DISPLAY"]) @ np.array(to_plate) == pytest.approx(0.15, abs=SINGLE)
    assert to_plate.z > 0


def test_display_without_refraction_is_as_large_as_the_picture(scene: bpy.types.Scene) -> None:
    """With an index of 1 the light of the picture lands on its
    mirror image, so that is the size the display needs.
    """
    rig = small_rig(ior=1.0)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(
        1.01 * rig["PICTURE"].dimensions.x, rel=1e-4
    )
    assert "whole picture fits" in scene.kiriko.result.summary


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


def test_a_wide_display_takes_no_less_than_a_square_one(scene: bpy.types.Scene) -> None:
    """Near a ball's rim light lands far out: it is the shorter side that has a limit."""
    heights = []
    for pixels in ((64, 64), (128, 64)):
        for thing in list(bpy.data.objects):
            bpy.data.objects.remove(thing)
        bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=pixels, picture_size=0.046)
        display = next(thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")
        heights.append(display.dimensions.y)
        assert "shows 74 % of the picture" in scene.kiriko.result.summary
    square, wide = heights
    assert square * (1 - 1e-3) <= wide <= 0.46 * (1 + SINGLE)


def test_limit_of_the_display_is_kept_and_its_loss_reported(scene: bpy.types.Scene) -> None:
    """A display that may not be as large as needed is as large
    as allowed, and the summary says how much is lost.
    """
    rig = small_rig(max_display_size=0.025)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(0.025, rel=1e-5)
    assert "missed the display" in scene.kiriko.result.summary


def test_default_rig_is_the_reference_ball(scene: bpy.types.Scene) -> None:
    """With nothing selected it is the ball of docs: 25 mm, D =
    150 mm, 50 mm of field at 1 m, 25 mm of picture.
    """
    bpy.ops.kiriko.add_rig()
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    viewer = scene.kiriko.viewer
    assert len(rig["GLASS"].data.polygons) == 20480
    assert rig["GLASS"].dimensions.x == pytest.approx(0.05, abs=1e-4)
    assert rig["PICTURE"].dimensions.x == pytest.approx(0.025, abs=1e-4)
    assert tuple(rig["PLATE"].matrix_world.translation) == pytest.approx((0, 0.15, 0), abs=SINGLE)
    assert tuple(viewer.matrix_world.translation) == pytest.approx((0, -1, 0), abs=SINGLE)
    assert 2 * np.tan(viewer.data.angle / 2) == pytest.approx(0.05, abs=1e-4)
    assert viewer.data.display_size < 0.1  # as small as the rig: Home still frames it


def test_display_ends_where_the_light_of_the_corners_lands(
    scene: bpy.types.Scene, kiriko: ModuleType
) -> None:
    """By the closed form of a ball and a plate, the picture's
    corners land at the display's, a hundredth further in.
    """
    bpy.ops.kiriko.add_rig()
    rig = (
        importlib.import_module(f"{kiriko.__name__}.core.blender.read.scene")
        .read(bpy.context, scene)
        .rig
    )
    corners = rig.picture.mesh.vertices
    directions = corners - rig.viewer.position
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    leave = through_ball(
        np.broadcast_to(rig.viewer.position, corners.shape), directions, 0.025, 1.49
    )
    beyond = np.abs(landing(rig, *leave) - (960, 540))

    assert (rig.display.width, rig.display.height) == (1920, 1080)
    # the grid of rays has the corners; the picture is square, the display is wider than it need be
    assert beyond.max(axis=0) == pytest.approx(540 / 1.01, rel=2e-3)


@pytest.mark.parametrize(("radius", "ior"), [(0.004, 1.52), (0.025, None), (0.3, 1.6)])
def test_the_first_rig_is_perfect(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture, radius: float, ior: float | None
) -> None:
    """Around a ball of any size all the light of the picture
    arrives, which is no warning, and Solve finds the same.
    """
    if ior is not None:
        bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=radius)
        bpy.ops.object.shade_smooth()
        ours = bpy.context.object.kiriko
        ours.use_ior, ours.ior = True, ior
    options = {} if ior is None else {"display_resolution": (480, 270)}  # the default takes longer
    bpy.ops.kiriko.add_rig(**options)
    assert re.search("Info: The whole picture fits", capfd.readouterr().out)
    assert scene.kiriko.result.notes == ""
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.summary == "The display shows 100 % of the picture."


def test_add_rig_and_solve_tell_the_same_share(scene: bpy.types.Scene) -> None:
    """In one format, from rays over the picture and from cells
    of the view map: within a tenth of a per cent.
    """
    bpy.ops.kiriko.add_rig(picture_size=0.03, display_resolution=(480, 270))
    told = [scene.kiriko.result.summary]
    bpy.ops.kiriko.solve()
    told.append(scene.kiriko.result.summary)
    found = [
        re.search(
            r"shows ([\d.]+) % of the picture; ([\d.]+) % missed the"
            r" plate\.",
            text,
        )
        for text in told
    ]
    shares = np.array([numbers.groups() for numbers in found], float)

    assert 99 < shares[0, 0] < 100
    assert np.abs(shares[0] - shares[1]).max() <= 0.1 + 1e-9


def test_the_scenes_render_and_camera_stay(scene: bpy.types.Scene) -> None:
    """Add Rig leaves size and camera of the scene's render; the viewer has pixels of its own."""
    mine = new_object(bpy.data.cameras.new("mine"))
    scene.camera = mine
    scene.render.resolution_percentage = 50
    scene.render.pixel_aspect_x = 2.0
    small_rig(viewer_resolution=48)
    render = scene.render

    assert (render.resolution_x, render.resolution_y, render.resolution_percentage) == (
        1920,
        1080,
        50,
    )
    assert scene.camera == mine

    viewer = scene.kiriko.viewer
    assert (viewer.kiriko.use_resolution, *viewer.kiriko.resolution) == (True, 48, 48)


def test_a_viewer_without_pixels_of_its_own_has_those_of_the_render(scene: bpy.types.Scene) -> None:
    """Viewer Resolution 0; the display is sized for the viewer's
    frame, and the viewer becomes the scene's camera.
    """
    scene.render.resolution_x = 160
    scene.render.resolution_y = 90
    scene.render.resolution_percentage = 50
    small_rig(viewer_resolution=0)
    viewer = scene.kiriko.viewer
    assert not viewer.kiriko.use_resolution
    assert scene.camera == viewer
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.coverage > 0.999


def test_the_camera_that_blender_goes_on_showing_is_told(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture
) -> None:
    """Where the scene has a camera the report names it, and the remedy.

    Where it has none there is nothing to tell.
    """
    small_rig()
    assert "Numpad" not in capfd.readouterr().out
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.camera = new_object(bpy.data.cameras.new("mine"))
    small_rig()
    assert "Numpad 0 still shows 'thing'." in capfd.readouterr().out


def test_a_wide_display_says_why(scene: bpy.types.Scene) -> None:
    """It names a smaller display, which keeps its promise."""
    bpy.ops.kiriko.add_rig(picture_size=0.035, display_resolution=(480, 270))
    text = scene.kiriko.result.summary
    found = re.search(
        r"times as wide as the picture: .* set Display to ([\d.]+) m, for (\d+) %",
        text,
    )
    width = float(found.group(1))
    share = float(found.group(2))
    display = next(thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")

    assert width < 0.5 * display.dimensions.x
    display.scale *= width / display.dimensions.x
    bpy.ops.kiriko.solve()
    assert 100 * scene.kiriko.result.coverage == pytest.approx(share, abs=1.5)


def test_a_display_at_its_limit_says_so(scene: bpy.types.Scene) -> None:
    """With a remedy; a width that was given is the artist's own affair."""
    small_rig(max_display_size=0.025)
    assert (
        "lands outside the Display Limit of 0.025 m: make Picture smaller or raise Display Limit."
        in scene.kiriko.result.summary
    )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    small_rig(display_size=0.025)
    assert bpy.context.scene.kiriko.result.summary.endswith("missed the display.")


def in_collection(*things: bpy.types.Object) -> bpy.types.Object:
    """A selected instance of a collection of these objects, which are nowhere else.

    Turned and moved.
    """
    collection = bpy.data.collections.new("Glasses")
    for thing in things:
        collection.objects.link(thing)
        bpy.context.scene.collection.objects.unlink(thing)
    empty = new_object(None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location = (0.3, 0.1, 0.2)
    empty.rotation_euler = (0.0, 0.0, 0.3)
    empty.select_set(True)
    return empty


def test_a_collection_instance_is_the_glass(scene: bpy.types.Scene) -> None:
    """The rig stands around the instance's glass, which solves
    and is previewed as the same objects in the scene.
    """
    thing = cube()
    thing.kiriko.use_ior = True
    instance = in_collection(thing)
    instance.kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))

    assert (instance.kiriko.role, thing.kiriko.role) == ("GLASS", "NONE")
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    assert tuple(rig["PICTURE"].matrix_world.translation) == pytest.approx(
        (0.3, 0.1, 0.2), abs=1e-6
    )
    assert not [thing for thing in scene.objects if thing.name.startswith("Kiriko Ball")]

    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.coverage > 0.999
    assert bpy.ops.kiriko.preview(samples=1) == {"FINISHED"}
    width = rig["DISPLAY"].dimensions.x

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    cube(turn=0.3).kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    assert bpy.data.objects["Kiriko Display"].dimensions.x == pytest.approx(width, rel=1e-5)


def flat(kind: str) -> bpy.types.Object:
    """A selected object that is no body."""
    if kind == "plane":
        thing = new_object(primitive("grid", x_segments=3, y_segments=3, size=0.02))
        thing.rotation_euler = (0.4, 0.3, 0.2)
    elif kind == "text":
        thing = new_object(bpy.data.curves.new("text", "FONT"))
        thing.data.body = "Kiriko"
    else:
        thing = in_collection(flat("plane"))
    thing.select_set(True)
    return thing


@pytest.mark.parametrize("kind", ["plane", "text", "instance"])
def test_what_is_flat_is_refused_as_glass(scene: bpy.types.Scene, kind: str) -> None:
    """It is named, and the remedy.

    Nothing is made, no role is set. With a thickness it is glass.
    """
    thing = flat(kind)
    before = inventory()
    with pytest.raises(RuntimeError, match=f"'{thing.name}' is flat"):
        bpy.ops.kiriko.add_rig(viewer_resolution=64)
    assert inventory() == before
    assert thing.kiriko.role == "NONE"
    if kind == "plane":
        thing.modifiers.new("thick", "SOLIDIFY").thickness = 0.002
        assert bpy.ops.kiriko.add_rig(viewer_resolution=64) == {"FINISHED"}


@pytest.mark.parametrize("kind", ["camera", "light", "empty", "lattice", "armature"])
def test_what_has_no_surface_is_refused_as_glass(scene: bpy.types.Scene, kind: str) -> None:
    """It is named where nothing else is selected, and left aside where there is glass."""
    data = {
        "camera": lambda: bpy.data.cameras.new("c"),
        "light": lambda: bpy.data.lights.new("l", "SUN"),
        "lattice": lambda: bpy.data.lattices.new("g"),
        "armature": lambda: bpy.data.armatures.new("a"),
    }
    thing = new_object(data[kind]() if kind in data else None)
    thing.select_set(True)
    before = inventory()

    with pytest.raises(
        RuntimeError,
        match="'thing' cannot be glass: it has no surface",
    ):
        bpy.ops.kiriko.add_rig(viewer_resolution=64)

    assert inventory() == before
    glass = cube()
    assert bpy.ops.kiriko.add_rig(viewer_resolution=64) == {"FINISHED"}
    assert (thing.kiriko.role, glass.kiriko.role) == ("NONE", "GLASS")


def test_a_role_without_a_surface_is_refused_when_it_is_solved(scene: bpy.types.Scene) -> None:
    """A script may give a camera any role; the sentence says why it is none."""
    small_rig()
    scene.kiriko.viewer.kiriko.role = "GLASS"
    with pytest.raises(
        RuntimeError, match="'Kiriko Viewer' has the role Glass, but it has no surface"
    ):
        bpy.ops.kiriko.solve()


def test_opaque_glass_is_told_at_once(scene: bpy.types.Scene, capfd: pytest.CaptureFixture) -> None:
    """A grey material is a warning with a remedy; Make It Glass is that, and can be undone."""
    thing = cube()
    thing.data.materials.append(bpy.data.materials.new("Grey"))
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    assert re.search(
        "Warning: .* The material of 'Cube' isn't glass, .* press Make It Glass",
        capfd.readouterr().out,
    )
    assert "isn't glass" in scene.kiriko.result.notes

    bpy.context.view_layer.objects.active = thing
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.kiriko.make_glass()
    bpy.ops.ed.undo_push(message="Make It Glass")
    bpy.ops.kiriko.solve()

    assert "refract" not in bpy.context.scene.kiriko.result.notes
    bpy.ops.ed.undo()
    assert bpy.data.objects["Cube"].material_slots[0].material.name == "Grey"


def test_hidden_glass_is_refused(scene: bpy.types.Scene) -> None:
    """An object that renders do not show would not be followed: nothing is made around it."""
    thing = cube()
    thing.hide_render = True
    before = inventory()
    with pytest.raises(
        RuntimeError,
        match="'Cube' is hidden in renders by its camera icon",
    ):
        bpy.ops.kiriko.add_rig(viewer_resolution=64)
    assert inventory() == before


def test_redo_with_other_values_starts_from_before(scene: bpy.types.Scene) -> None:
    """As the box at the lower left does it: undo, then the operator again.

    There is one rig, the second.
    """
    cube()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.kiriko.add_rig(viewer_resolution=64, picture_size=0.02)
    bpy.ops.ed.undo_push(message="Add Rig")
    bpy.ops.ed.undo()
    bpy.data.objects["Cube"].select_set(True)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, picture_size=0.01)
    pictures = [thing for thing in bpy.context.scene.objects if thing.kiriko.role == "PICTURE"]
    assert [thing.dimensions.x for thing in pictures] == pytest.approx([0.01])


def test_an_open_body_is_glass(scene: bpy.types.Scene) -> None:
    """Half a ball without a lid is not flat: it is followed as drawn, and its rig is made."""
    mesh = bpy.data.meshes.new("bowl")
    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=32, v_segments=16, radius=0.03)
    bmesh.ops.delete(shape, geom=[v for v in shape.verts if v.co.z > 1e-3], context="VERTS")
    shape.to_mesh(mesh)
    shape.free()
    new_object(mesh).select_set(True)
    assert bpy.ops.kiriko.add_rig(viewer_resolution=64) == {"FINISHED"}


def test_rig_follows_the_unit_scale(scene: bpy.types.Scene) -> None:
    """In a scene of millimetres the same rig is a thousand times larger in Blender units."""
    scene.unit_settings.scale_length = 0.001
    bpy.ops.kiriko.add_rig()
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    assert rig["GLASS"].dimensions.x == pytest.approx(50, abs=0.1)
    assert rig["DISPLAY"].dimensions.x == pytest.approx(29.9 * 16 / 9, abs=0.9)
    assert rig["DISPLAY"].dimensions.y == pytest.approx(29.9, abs=0.5)
    assert tuple(rig["PLATE"].matrix_world.translation) == pytest.approx((0, 150, 0), abs=1e-3)


def test_large_glass_does_not_cut_the_plate(scene: bpy.types.Scene) -> None:
    """Around Blender's own cube of 2 m the rig grows with
    the glass, so that glass and plate stay apart.
    """
    cube(2.0)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    plate = world_corners(rig["PLATE"]).mean(axis=0)
    normal = normal_of(rig["PLATE"])
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


def test_failure_leaves_nothing_behind(scene: bpy.types.Scene) -> None:
    """A viewer inside the glass is refused in one sentence; objects and roles are as before."""
    glass = cube()
    before = inventory()
    with pytest.raises(RuntimeError, match="the viewer is inside the glass"):
        bpy.ops.kiriko.add_rig(viewer_distance=0.01)
    assert inventory() == before
    assert glass.kiriko.role == "NONE"
    assert scene.kiriko.viewer is None
    assert scene.camera is None


def test_a_picture_beside_the_glass_is_told_to_be_moved(scene: bpy.types.Scene) -> None:
    """Seen through the hole of a ring; nothing is said of the display's size then."""
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.04, minor_radius=0.005, rotation=(np.pi / 2, 0, 0)
    )
    bpy.ops.kiriko.add_rig(picture_size=0.03, viewer_resolution=64)
    text = scene.kiriko.result.summary
    assert "most of the picture is outside the glass" in text
    assert "times as wide" not in text


@pytest.mark.parametrize("side", [-1, 1], ids=["front", "back"])
def test_glass_without_a_side_is_told_of_its_gap(scene: bpy.types.Scene, side: int) -> None:
    """At Add Rig and at Solve; light that goes through the gap has no other fate beside it."""
    glass = cube()
    mesh = bmesh.new()
    mesh.from_mesh(glass.data)
    mesh.faces.ensure_lookup_table()
    bmesh.ops.delete(
        mesh, geom=[face for face in mesh.faces if face.normal.y * side > 0.9], context="FACES_ONLY"
    )
    mesh.to_mesh(glass.data)
    mesh.free()
    bpy.ops.kiriko.add_rig(viewer_resolution=64)

    assert scene.kiriko.result.summary.endswith(
        " wide, shows 0 % of the picture; 100 % went through gaps in the glass. Close the gaps in"
        " the glass."
    )

    if side > 0:  # where it lands is painted
        bpy.ops.kiriko.solve()
        text = (
            r"The display shows [01] % of the picture; (99|100) % went through gaps in the glass\."
        )
        assert re.fullmatch(text, scene.kiriko.result.summary)
        return
    with pytest.raises(
        RuntimeError, match="100 % of the picture's light leaks through gaps in 'Cube'"
    ):
        bpy.ops.kiriko.solve()


def test_make_it_glass_takes_back_what_was_told(scene: bpy.types.Scene) -> None:
    """The note on the material goes, others stay."""
    glass = cube()
    bpy.ops.kiriko.add_rig(viewer_resolution=64)
    result = scene.kiriko.result
    assert "press Make It Glass" in result.notes
    result.notes += "\nAnother one."
    bpy.context.view_layer.objects.active = glass
    bpy.ops.kiriko.make_glass()
    assert result.notes == "Another one."


# behind the glass


def behind(**options: object) -> dict[str, bpy.types.Object]:
    """A small rig without a plate, around a cube of 40 mm."""
    return small_rig(kind="BEHIND_GLASS", field=0.06, **options)


@pytest.mark.parametrize(
    ("azimuth", "look_down"), [(0, 0), (70, 20), (0, 50), (-120, 75), (30, 90)]
)
def test_a_display_behind_the_glass_is_where_the_viewer_looks(
    scene: bpy.types.Scene, azimuth: float, look_down: float
) -> None:
    """It stands upright behind the glass, or lies right under it, in the middle of the
    view, its front to the glass; the picture lies before it, and there is no plate.
    """
    rig = behind(azimuth=np.radians(azimuth), look_down=np.radians(look_down))
    assert "PLATE" not in rig
    glass = world_corners(rig["GLASS"])
    display = world_corners(rig["DISPLAY"])
    picture = world_corners(rig["PICTURE"])
    front = normal_of(rig["DISPLAY"])
    heights = (glass - display.mean(axis=0)) @ front

    if look_down < 45:
        assert abs(front[2]) < SINGLE
        assert heights.min() == pytest.approx(np.ptp(heights), rel=1e-3)  # as far as it is deep
    else:
        assert front == pytest.approx([0, 0, 1], abs=SINGLE)
        assert heights.min() == pytest.approx(0, abs=SINGLE)  # the glass lies on it

    viewer = np.array(scene.kiriko.viewer.matrix_world.translation)
    middle = glass.mean(axis=0)
    axis = (middle - viewer) / np.linalg.norm(middle - viewer)
    to_display = display.mean(axis=0) - viewer
    assert np.linalg.norm(np.cross(to_display, axis)) < 1e-5
    assert to_display @ axis > (middle - viewer) @ axis
    assert np.degrees(np.arcsin(-axis[2])) == pytest.approx(look_down, abs=1e-3)

    before = (picture - display.mean(axis=0)) @ front
    assert before == pytest.approx(0.01 * rig["PICTURE"].dimensions.x, abs=1e-5)
    assert np.abs(normal_of(rig["PICTURE"]) - front).max() < SINGLE
    assert (np.ptp(display, axis=0) >= np.ptp(picture, axis=0) - SINGLE).all()


@pytest.mark.parametrize("look_down", [0, 60])
def test_of_several_glasses_the_viewer_looks_through_the_active_one(
    scene: bpy.types.Scene, look_down: float
) -> None:
    """Not through the gap between them; all is in sight, and the display is behind all."""
    for x, y, height in ((-0.1, 0.0, 0.03), (0.1, 0.05, 0.05)):
        glass = new_object(primitive("cube", size=0.04))
        glass.location, glass.dimensions = (x, y, 0), (0.04, 0.04, height)
        glass.select_set(True)
    active, other = (thing for thing in scene.objects if thing.select_get())
    bpy.context.view_layer.objects.active = active
    bpy.context.view_layer.update()
    bpy.ops.kiriko.add_rig(
        kind="BEHIND_GLASS",
        look_down=np.radians(look_down),
        viewer_resolution=64,
        display_resolution=(64, 64),
    )
    (display,) = (thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")
    (picture,) = (thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    viewer = np.array(scene.kiriko.viewer.matrix_world.translation)
    middle = world_corners(active).mean(axis=0)
    axis = (middle - viewer) / np.linalg.norm(middle - viewer)
    to_display = world_corners(display).mean(axis=0) - viewer
    assert np.linalg.norm(np.cross(to_display, axis)) < 1e-5

    front = normal_of(display)
    for glass in (active, other):
        heights = (world_corners(glass) - world_corners(display).mean(axis=0)) @ front
        assert heights.min() > -SINGLE
        seen = [
            world_to_camera_view(scene, scene.kiriko.viewer, Vector(corner))[:2]
            for corner in world_corners(glass)
        ]
        # the field is that at the glass's middle: nearer corners are seen larger
        assert -0.05 < np.min(seen) < np.max(seen) < 1.05
    assert max(picture.dimensions) < max(active.dimensions)


@pytest.mark.parametrize("has_active", [False, True])
def test_without_an_active_glass_the_viewer_looks_through_the_one_in_the_middle(
    scene: bpy.types.Scene, has_active: bool
) -> None:
    """After a box selection the active object is none of the glasses, or there is none: the viewer
    looks through a glass all the same, and not through a gap between two.
    """
    other = new_object(primitive("cube", size=0.04))
    other.location.x = 0.5
    for x in (-0.1, 0.02, 0.1, 0.18):
        glass = new_object(primitive("cube", size=0.04))
        glass.location.x = x
        glass.select_set(True)
    other.select_set(False)
    bpy.context.view_layer.objects.active = other if has_active else None
    bpy.context.view_layer.update()
    bpy.ops.kiriko.add_rig(kind="BEHIND_GLASS", viewer_resolution=64, display_resolution=(64, 64))
    (picture,) = (thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    assert abs(world_corners(picture).mean(axis=0)[0] - 0.02) < 1e-5
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.coverage > 0.99


@pytest.mark.parametrize("look_down", [0, 60])
def test_a_rig_behind_the_glass_shows_its_picture(scene: bpy.types.Scene, look_down: float) -> None:
    """Add Rig and Solve: all of the picture, and no word of a plate that is missed."""
    behind(look_down=np.radians(look_down), picture_size=0.015)
    assert "missed the plate" not in scene.kiriko.result.summary
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    assert result.coverage > 0.99
    assert "ithout a plate" in result.summary
    assert "plate" not in result.notes
    assert not bpy.ops.kiriko.simulate.poll()
    with pytest.raises(RuntimeError, match="Nothing to simulate"):
        bpy.ops.kiriko.simulate()


def test_a_plate_that_is_there_is_told_before_a_rig_without_one(scene: bpy.types.Scene) -> None:
    """Light would have to go by it: the sentence names it, and nothing is made."""
    new_object(primitive("grid", size=0.1), "PLATE").name = "mine"
    before = inventory()
    with pytest.raises(
        RuntimeError, match="already has a plate \\('mine'\\): set its role to None"
    ):
        bpy.ops.kiriko.add_rig(kind="BEHIND_GLASS")
    assert inventory() == before


def test_automatic_lengths_are_a_checkbox(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """On while the length is 0; turned off, the length is the one that the rig got."""
    cube()
    options = {"viewer_resolution": 64, "display_resolution": (64, 64), "picture_size": 0.03}
    bpy.ops.kiriko.add_rig(**options)
    add_rig = importlib.import_module(f"{kiriko.__name__}.operators.add_rig")
    parts = {thing.kiriko.role: thing for thing in scene.objects}
    asked = bpy.context.window_manager.operator_properties_last("kiriko.add_rig")
    for name in ("distance", "plate_size", "display_size", "viewer_distance"):
        setattr(asked, name, 0.0)
        assert getattr(asked, f"auto_{name}")
        setattr(asked, f"auto_{name}", False)
        assert getattr(asked, name) > 0
        assert not getattr(asked, f"auto_{name}")

    between = parts["PLATE"].matrix_world.translation - parts["GLASS"].matrix_world.translation
    assert asked.distance == pytest.approx(between.length, rel=1e-5)
    assert asked.plate_size == pytest.approx(max(parts["PLATE"].dimensions), rel=1e-5)
    assert asked.display_size == pytest.approx(max(parts["DISPLAY"].dimensions), rel=1e-5)
    asked.auto_display_size = True
    assert asked.display_size == 0
    assert {name for _, names in add_rig.GROUPS for name in names} == {
        name
        for name in asked.bl_rna.properties.keys()  # noqa: SIM118
        if name not in {"rna_type", "kind", "scale"} and not name.startswith("auto_")
    }


def test_a_display_for_the_outermost_light_can_be_smaller_by_a_button(
    scene: bpy.types.Scene, look: Callable[[], list]
) -> None:
    """Of Suzanne's light the last 5 % spread over thrice the width: the checklist has the width
    that Add Rig's sentence names, takes it by one press, and is content.
    """
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 36))
    display = scene.objects["Kiriko Display"]
    wide = max(display.dimensions)

    def offered() -> list:
        return [one for one in look() if "kiriko.fit_display" in [b.operator for b in one.buttons]]

    (entry,) = offered()
    assert entry.can_wait
    (button,) = entry.buttons
    width = button.label.removeprefix("Resize to ")
    assert f"set Display to {width}, for " in scene.kiriko.result.summary
    bpy.ops.kiriko.fit_display(**dict(button.properties))
    assert max(display.dimensions) == pytest.approx(float(width.split()[0]), rel=0.05)
    assert max(display.dimensions) < 0.7 * wide
    assert scene.kiriko.result.summary == ""  # which told of the display before
    assert offered() == []


@pytest.mark.parametrize("button", ["add_rig", "best_place"])
def test_a_length_is_of_its_rig_alone(scene: bpy.types.Scene, button: str) -> None:
    """Blender keeps none for the next press, which may be for glass of another size. A drag ends
    before 0, at which a length is automatic and its field goes.
    """
    rna = getattr(bpy.ops.kiriko, button).get_rna_type()
    lengths = [one for one in rna.properties if one.type == "FLOAT" and one.unit == "LENGTH"]
    assert lengths
    for one in lengths:
        assert one.is_skip_save, one.identifier
        assert one.hard_min == 0 < one.soft_min, one.identifier


def test_a_viewer_that_would_be_inside_the_glass_is_told_by_its_distance(
    scene: bpy.types.Scene,
) -> None:
    """No camera is named that is not made; nothing is left of the attempt."""
    before = inventory()
    with pytest.raises(RuntimeError) as told:
        bpy.ops.kiriko.add_rig(viewer_distance=0.01)
    assert str(told.value).strip() == (
        "Error: At a Viewer Distance of 1 cm the viewer is inside the glass. Increase it."
    )
    assert inventory() == before


def test_each_button_says_which_rig_it_makes(kiriko: ModuleType) -> None:
    """Two buttons of one operator have two tooltips."""
    module = importlib.import_module(f"{kiriko.__name__}.operators.add_rig")
    with_plate, without = (
        module.KIRIKO_OT_add_rig.description(bpy.context, SimpleNamespace(kind=kind))
        for kind, *_ in module.KINDS
    )
    assert "with a mirror plate" in with_plate
    assert "without a plate" in without
