import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import cube, new_object, primitive, small_rig

SINGLE = 1e-6  # of 1: Blender keeps positions and colours in float32


def with_material(name: str, *others: bpy.types.Object) -> bpy.types.Material:
    """A new material on the mesh of the selected cube, and on others."""
    material = bpy.data.materials.new(name)
    for thing in (bpy.context.selected_objects[0], *others):
        thing.data.materials.append(material)
    return material


def test_parts_that_are_made_let_see_the_picture(scene):
    """Glass and plate are see-through in Solid, which takes
    the material's colour; the picture stands in front.
    """
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    rig = {thing.kiriko.role: thing for thing in scene.objects}
    alphas = {role: rig[role].active_material.diffuse_color[3] for role in ("GLASS", "PLATE")}
    assert max(alphas.values()) <= 0.5
    assert {thing.display_type for thing in rig.values()} == {"TEXTURED"}
    assert rig["PICTURE"].show_in_front
    assert not any(thing.show_name for thing in rig.values())


@pytest.mark.parametrize(("kind", "role"), [("IN_GLASS", "GLASS"), ("BEHIND_GLASS", "DISPLAY")])
def test_the_part_whose_product_is_chosen_next_is_selected(scene, kind, role):
    """Alone and active: without a plate the display, which most people replace by their phone."""
    glass = cube()
    bpy.ops.kiriko.add_rig(kind=kind, viewer_resolution=32, display_resolution=(32, 32))
    rig = loaded("core.blender.data.rigs").active_rig(scene)
    loaded("operators.add_rig")._show(bpy.context, rig, (glass,))
    assert bpy.context.view_layer.objects.active.kiriko.role == role
    assert [thing.kiriko.role for thing in bpy.context.selected_objects] == [role]


def test_an_ideal_plate_is_a_portal_in_cycles_and_tinted_in_eevee(scene):
    """Each engine finds an output of its own: EEVEE would draw a portal black."""
    tree = small_rig()["PLATE"].active_material.node_tree
    kinds = {
        engine: tree.get_output_node(engine).inputs["Surface"].links[0].from_node.bl_idname
        for engine in ("CYCLES", "EEVEE")
    }
    assert kinds == {"CYCLES": "ShaderNodeBsdfRayPortal", "EEVEE": "ShaderNodeMixShader"}


def test_glass_of_the_artist_is_seen_through_by_its_material(scene):
    """Its colour stays, its alpha is what the ball's is."""
    cube()
    material = with_material("Mine")
    material.diffuse_color = (0.1, 0.2, 0.3, 1.0)
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    assert tuple(material.diffuse_color) == pytest.approx((0.1, 0.2, 0.3, 0.3), abs=SINGLE)


def test_a_material_that_others_have_too_is_left(scene):
    """The glass is drawn by its edges instead, and the other thing as before."""
    glass = cube()
    other = new_object(primitive("cube", size=1.0))
    other.location.x = 3
    material = with_material("Shared", other)
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    assert material.diffuse_color[3] == 1
    assert (glass.display_type, other.display_type) == ("WIRE", "TEXTURED")


def test_glass_without_a_material_is_solid_once_it_is_made_glass(scene):
    """It has no colour to be see-through by, until Make It Glass gives it one."""
    glass = small_rig()["GLASS"]
    assert glass.display_type == "WIRE"
    bpy.context.view_layer.objects.active = glass
    bpy.ops.kiriko.make_glass()
    assert glass.display_type == "TEXTURED"
    assert glass.active_material.diffuse_color[3] <= 0.5


def shown(*parts: bpy.types.Object) -> list:
    """The images that are drawn over a view on these parts."""
    drawn = loaded("core.blender.view.shown_images")
    bpy.context.view_layer.update()
    return list(drawn.shown_images(bpy.context.scene, bpy.context.view_layer, list(parts)))


def test_the_picture_is_drawn_where_it_stands_with_the_image_it_shows(scene):
    """Each corner has its place in the image, also after the
    plane is moved and another image is chosen.
    """
    picture = small_rig()["PICTURE"]
    mine = bpy.data.images.new("Mine", 8, 8)
    picture.kiriko.image = mine
    picture.location.x, picture.rotation_euler.y = 0.01, 0.3
    picture.scale.x = 2
    (drawn,) = shown(picture)
    assert drawn.image == mine
    assert drawn.is_picture

    mesh = picture.data
    expected = {
        tuple(np.round(mesh.uv_layers[0].uv[loop.index].vector, 6)): np.array(
            picture.matrix_world @ mesh.vertices[loop.vertex_index].co
        )
        for loop in mesh.loops
    }
    assert {tuple(uv) for uv in np.round(drawn.uv, 6)} == set(expected)
    off = [
        np.abs(point - expected[tuple(uv)]).max()
        for point, uv in zip(drawn.points, np.round(drawn.uv, 6), strict=True)
    ]
    assert max(off) < SINGLE


def test_the_source_image_is_drawn_on_the_front_of_the_display(scene):
    """Nothing before there is one. Its corners run as Blender's
    fronts do, so that the back can be left out.
    """
    display = small_rig()["DISPLAY"]
    assert shown(display) == []
    bpy.ops.kiriko.solve()
    (drawn,) = shown(display)
    assert drawn.image == scene.kiriko.result.source
    assert not drawn.is_picture
    a, b, c = drawn.points[:3]
    assert np.cross(b - a, c - a) @ np.array(display.matrix_world.col[2].to_3d()) > 0


@pytest.mark.parametrize("is_perspective", [True, False])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_a_frame_holds_all_points_and_no_more(kiriko, is_perspective, size):
    """Random points, seen by Blender's projection, are within the
    part of the view that is free, and reach its sides; none is cut off.
    """
    framing = loaded("core.blender.view.view_framing")
    random = np.random.default_rng(3)
    points = size * random.normal(size=(40, 3)) + 5 * size
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    window = framing.Window(1000, 700, 50, 250, 10, 60, 50.0, is_perspective)
    found = framing.framed(points, axes, window)

    # a lens of 50 mm before 72 mm of the longer side
    seen = (points - found.centre) @ axes.T
    depth = found.distance - seen[:, 2] if is_perspective else np.full(40, found.distance)
    across = 0.5 + seen[:, :2] / depth[:, None] * 50 / 72 * 1000 / np.array([1000, 700])
    across = (across * [1000, 700] - [50, 10]) / [700, 630]
    assert (depth > found.clip_start).all()
    assert (depth < found.clip_end).all()
    assert (across > 0).all()
    assert (across < 1).all()
    assert np.ptp(across, axis=0).max() == pytest.approx(0.8, abs=0.05)

    # and the other way round: what is in sight is told of all, wherever they are
    everywhere = np.concatenate([points, 4 * (points - found.centre) + found.centre])
    seen = (everywhere - found.centre) @ axes.T
    depth = found.distance - seen[:, 2] if is_perspective else np.full(80, found.distance)
    across = 0.5 + seen[:, :2] / depth[:, None] * 50 / 72 * 1000 / np.array([1000, 700])
    across = (across * [1000, 700] - [50, 10]) / [700, 630]
    expected = ((across > 0) & (across < 1)).all(axis=1) & (depth > 0)
    assert np.array_equal(framing.in_sight(everywhere, axes, found, window), expected)
    assert expected[:40].all()
    assert not expected.all()


@pytest.mark.parametrize("image", [(512, 512), (1920, 1080), (300, 900)])
@pytest.mark.parametrize("size", [(1129, 725), (480, 900), (700, 260)])
def test_nothing_covers_the_image_of_a_camera_view(kiriko, size, image):
    """Where Blender draws the frame of a camera with that zoom and offset, it is in the middle of
    what is free, and fills nine tenths of it.
    """
    framing = loaded("core.blender.view.view_framing")
    left, right, bottom, top = 58, 220, 8, 54
    window = framing.Window(*size, left, right, bottom, top, 50.0, is_perspective=True)
    zoom, offset = framing.image_framed(image, window)

    # as BKE_screen_view3d_zoom_to_fac and BKE_camera_params_compute_viewplane have it
    factor = (zoom / 50 + np.sqrt(2)) ** 2 / 4
    size, image = np.array(size), np.array(image)
    half = factor * size.max() * image / image.max() / 2
    middle = size * (0.5 - 2 * factor * np.array(offset))
    low, high = np.array([left, bottom]), size - [right, top]
    assert middle == pytest.approx((low + high) / 2)
    assert (2 * half / (high - low)).max() == pytest.approx(0.9)


def test_what_is_made_far_from_the_bench_comes_into_sight(scene):
    """As eye box and visible range, around the viewer: else nothing but their legend was seen. The
    view keeps its direction, and its place where the object is in sight, or a camera is its eye.
    """
    framing = loaded("operators.framing")
    core = loaded("core.blender.view.view_framing")
    rig = small_rig()
    framing.frame_rig(bpy.context)
    area = framing.view_of(bpy.context)
    view = area.spaces.active.region_3d

    def stands() -> list[float]:
        return [*view.view_location, view.view_distance, *view.view_rotation]

    framed = stands()
    framing.bring_into_sight(bpy.context, rig["PLATE"])
    assert stands() == framed

    far = new_object(primitive("cube", size=0.1))
    far.location = rig["GLASS"].location
    far.location.y -= 1.0
    view.view_perspective = "CAMERA"
    camera = stands()
    framing.bring_into_sight(bpy.context, far)
    assert stands() == camera
    view.view_perspective = "PERSP"
    framing.bring_into_sight(bpy.context, far)
    assert stands() != framed
    assert stands()[4:] == framed[4:]

    axes = np.array(view.view_rotation.to_matrix()).T
    place = core.Framed(np.array(view.view_location), view.view_distance, 0.0, 1e6)
    for thing in (far, rig["GLASS"], rig["DISPLAY"]):
        assert core.in_sight(framing.corners(thing), axes, place, framing.window_of(area)).all()


def test_a_view_turns_only_where_it_hardly_sees_the_picture(kiriko):
    """Seen from the front it stays; from the side or from behind it
    turns to where the picture is well seen, upright.
    """
    framing = loaded("core.blender.view.view_framing")
    front = np.array([0.0, -1.0, 0.0])
    straight = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.array_equal(framing.turned(straight, front), straight)

    for turn in ([[0, 1, 0], [0, 0, 1], [1, 0, 0]], [[-1, 0, 0], [0, 0, 1], [0, 1, 0]]):
        found = framing.turned(np.array(turn, float), front)
        assert found @ found.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(found) == pytest.approx(1)
        assert found[2] @ front == pytest.approx(np.cos(np.radians(30)) * np.cos(np.radians(20)))
        assert found[0, 2] == 0
        assert found[1, 2] > 0
