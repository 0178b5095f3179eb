from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Matrix, Vector

from extension import loaded

SINGLE = 2e-6  # Blender computes frames and projections in float32, in a few steps

# one camera each: type, sensor fit, lens shift, pixel aspect, resolution, percentage
CAMERAS = {
    "perspective": ("PERSP", "AUTO", (0.0, 0.0), (1.0, 1.0), (96, 64), 100),
    "portrait": ("PERSP", "AUTO", (0.0, 0.0), (1.0, 1.0), (64, 96), 100),
    "vertical fit": ("PERSP", "VERTICAL", (0.1, -0.2), (1.0, 1.0), (96, 64), 100),
    "horizontal fit": ("PERSP", "HORIZONTAL", (0.1, -0.2), (1.0, 1.0), (64, 96), 100),
    "wide pixels": ("PERSP", "AUTO", (0.3, 0.1), (2.0, 1.0), (60, 64), 100),
    "tall pixels": ("PERSP", "AUTO", (-0.3, 0.1), (1.0, 1.5), (96, 80), 50),
    "orthographic": ("ORTHO", "AUTO", (0.0, 0.0), (1.0, 1.0), (96, 64), 100),
    "shifted orthographic": ("ORTHO", "VERTICAL", (0.2, -0.1), (1.0, 1.25), (96, 64), 50),
}


@pytest.fixture
def read(scene) -> Callable[[], Any]:
    module = loaded("core.blender.read.scene")
    return lambda: module.read(bpy.context, scene).rig.viewer


def add_camera(scene: bpy.types.Scene, kind: str = "perspective") -> bpy.types.Object:
    """The scene's camera, of one of the kinds above, somewhere and looking somewhere."""
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("lens"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    lens = camera.data
    lens.type, lens.sensor_fit, shift, aspect, size, percentage = CAMERAS[kind]
    lens.lens = 70.0
    lens.sensor_width = 36.0
    lens.sensor_height = 20.0
    lens.ortho_scale = 1.7
    lens.shift_x, lens.shift_y = shift
    render = scene.render
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = percentage
    camera.location = (3.0, 2.0, 4.0)
    camera.rotation_euler = (0.5, 0.1, 0.3)

    return camera


@pytest.mark.parametrize("kind", CAMERAS)
def test_window_is_the_view_frame(read, scene, kind):
    """The corners of the window are those of Blender's own view frame."""
    camera = add_camera(scene, kind)
    frame = np.array(camera.data.view_frame(scene=scene))
    if camera.data.type == "PERSP":
        frame = frame / -frame[:, 2:]
    viewer = read()
    left, right, bottom, top = viewer.window
    assert [left, right] == pytest.approx([frame[:, 0].min(), frame[:, 0].max()], abs=SINGLE)
    assert [bottom, top] == pytest.approx([frame[:, 1].min(), frame[:, 1].max()], abs=SINGLE)
    assert (viewer.width, viewer.height) == (
        scene.render.resolution_x * scene.render.resolution_percentage // 100,
        scene.render.resolution_y * scene.render.resolution_percentage // 100,
    )


@pytest.mark.parametrize("kind", CAMERAS)
def test_points_are_where_blender_sees_them(read, scene, kind):
    """Random points project to the viewer pixels that
    world_to_camera_view gives, and rays lead back through them.
    """
    camera = add_camera(scene, kind)
    viewer = read()
    rng = np.random.default_rng(7)
    local = rng.uniform((-0.5, -0.5, -9), (0.5, 0.5, -2), (50, 3))
    points = np.array([camera.matrix_world @ Vector(p) for p in local])
    seen = np.array([world_to_camera_view(scene, camera, Vector(p)) for p in points])
    wanted = np.stack([seen[:, 0] * viewer.width, (1 - seen[:, 1]) * viewer.height], axis=1)
    pixels = viewer.project(points)

    # float32 numbers of some 100 pixels, in several steps
    assert np.abs(pixels - wanted).max() < 1e-3
    origins, directions = viewer.rays(pixels)
    along = np.einsum("ij,ij->i", points - origins, directions)

    assert np.abs(origins + along[:, None] * directions - points).max() < 1e-12


def render_positions(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """World position that Cycles sees at each pixel's centre (h,
    w, 3), row 0 at the top: emitted by a big plane.
    """
    material = bpy.data.materials.new("position")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(
        tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], emission.inputs["Color"]
    )
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    plane = bpy.data.meshes.new("plane")

    # all coordinates positive, where light is; on x + y + z = 60, so that each of them tells
    plane.from_pydata(
        [(20 + x, 20 + y, 20 - x - y) for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))],
        [],
        [(0, 1, 2, 3)],
    )
    plane.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("plane", plane))
    render = scene.render
    render.engine, render.film_transparent = "CYCLES", False
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type = "BOX"
    render.filter_size = 0.01
    scene.cycles.filter_width = 0.01
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.image_settings.color_mode = "RGB"
    render.filepath = str(folder / "positions.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)

    return pixels.reshape(height, width, 4)[::-1, :, :3].astype(float)


def aim(camera: bpy.types.Object) -> None:
    """Put a camera before the plane of positions, looking at its middle, rolled a little."""
    place = Vector((30.0, 28.0, 31.0))
    target = Vector((20.0, 20.0, 20.0))
    turn = (target - place).to_track_quat("-Z", "Y").to_matrix() @ Euler(
        (0.02, 0.03, 0.2)
    ).to_matrix()
    camera.matrix_world = Matrix.LocRotScale(place, turn, (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    "case",
    [
        "perspective",
        "vertical fit",
        "tall pixels",
        "shifted orthographic",
        "odd percentage",
        "scaled",
        "mirrored",
    ],
)
def test_pixel_grid_of_cycles(read, scene, case, tmp_path):
    """A place that Cycles sees at the centre of pixel (i, j) projects there, to 0.01 px."""
    camera = add_camera(scene, case if case in CAMERAS else "perspective")
    aim(camera)
    if case == "odd percentage":
        scene.render.resolution_percentage = 37  # 35.52 x 23.68 pixels, cut to 35 x 23
    if case == "scaled":
        camera.scale = (3.0, 3.0, 3.0)
    if case == "mirrored":
        camera.scale = (-1.0, 1.0, 1.0)
    viewer = read()
    seen = render_positions(scene, tmp_path)

    assert seen.shape == (viewer.height, viewer.width, 3)
    assert seen.min() > 1  # the plane fills the image
    x, y = np.meshgrid(np.arange(viewer.width) + 0.5, np.arange(viewer.height) + 0.5)
    off = viewer.project(seen.reshape(-1, 3)) - np.stack([x.ravel(), y.ravel()], axis=1)

    # the filter spreads samples over 0.01 px, float32
    # positions and rays of Cycles add about as much
    assert np.abs(off).max() < 0.01


def test_scaled_parent_and_constraint(read, scene):
    """Parents and constraints move the viewer, an even scale changes nothing.

    Its axes are orthonormal to rounding.
    """
    camera = add_camera(scene)
    parent = bpy.data.objects.new("parent", None)
    target = bpy.data.objects.new("target", None)
    for thing in (parent, target):
        scene.collection.objects.link(thing)
    parent.scale = (2.0, 2.0, 2.0)
    parent.location = (1.0, 0.0, 0.0)
    target.location = (1.0, 4.0, 8.0)
    camera.parent = parent
    camera.location = (0.0, 0.0, 4.0)
    camera.constraints.new("TRACK_TO").target = target
    viewer = read()

    assert viewer.position == pytest.approx([1, 0, 8], abs=SINGLE)
    assert viewer.axes[2] == pytest.approx([0, 1, 0], abs=SINGLE)
    assert np.abs(viewer.axes @ viewer.axes.T - np.eye(3)).max() < 1e-15 * 4


def test_viewer_in_millimetres(read, scene):
    """Position and orthographic window are in metres, whatever the scene's unit.

    Perspective tangents do not change.
    """
    camera = add_camera(scene)
    plain = read()
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.001
    assert read().window == plain.window
    assert read().position == pytest.approx(plain.position * 1e-3)
    camera.data.type = "ORTHO"
    left, right, _, _ = read().window
    assert right - left == pytest.approx(1.7e-3)


def test_chosen_viewer_goes_before_the_camera(read, scene):
    """The scene's camera is the viewer only where no other is chosen."""
    add_camera(scene)
    other = add_camera(scene)
    other.name = "other"
    scene.camera = scene.objects["eye"]
    assert read().name == "eye"
    scene.kiriko.viewer = other
    assert read().name == "other"


def test_cameras_that_cannot_be_followed(read, scene, errors):
    """A panoramic, a sheared and a vanished camera are refused by name, with the reason.

    So is an object that is no camera.
    """
    camera = add_camera(scene)
    camera.data.type = "PANO"
    with pytest.raises(errors.RigError, match=r"'eye' is a panoramic"):
        read()
    camera.data.type = "PERSP"
    parent = bpy.data.objects.new("parent", None)
    scene.collection.objects.link(parent)
    camera.parent = parent
    parent.scale = (1.0, 3.0, 1.0)
    with pytest.raises(errors.RigError, match="'eye' is sheared"):
        read()
    parent.scale = (0.0, 0.0, 0.0)
    with pytest.raises(errors.RigError, match="'eye' is sheared or has no size"):
        read()
    scene.camera = parent
    with pytest.raises(errors.RigError, match="'parent' is not a camera"):
        read()


@pytest.mark.parametrize("way", ["disabled", "collection disabled", "excluded", "unlinked"])
def test_viewer_whose_place_is_stale(read, scene, errors, way):
    """A viewer that Blender does not keep in place is refused, but
    read where it is when it is the scene's camera.
    """
    camera = add_camera(scene)
    scene.camera, scene.kiriko.viewer = None, camera
    parent = bpy.data.objects.new("parent", None)
    drawer = bpy.data.collections.new("drawer")
    scene.collection.objects.link(parent)
    scene.collection.children.link(drawer)
    scene.collection.objects.unlink(camera)
    drawer.objects.link(camera)
    camera.parent = parent
    camera.location = (0.0, 0.0, 0.0)
    read()

    if way == "disabled":
        camera.hide_viewport = True
    elif way == "unlinked":
        drawer.objects.unlink(camera)
    elif way == "excluded":
        bpy.context.view_layer.layer_collection.children[0].exclude = True
    else:
        drawer.hide_viewport = True

    said = "is not in any scene" if way == "unlinked" else "is disabled or not in"
    with pytest.raises(errors.RigError, match=f"'eye' {said}"):
        read()
    scene.camera = camera
    if way == "unlinked":  # as the scene's camera that was deleted stays
        with pytest.raises(errors.RigError, match=f"'eye' {said}"):
            read()
        return
    parent.location.x = 7.0

    assert read().position[0] == 7.0


def test_viewer_hidden_by_its_eye(read, scene):
    """A viewer hidden by the eye in the outliner follows its parent all the same."""
    camera = add_camera(scene)
    scene.camera, scene.kiriko.viewer = None, camera
    read()
    camera.hide_set(True)
    camera.location.x = 7.0
    assert read().position[0] == 7.0


def test_depth_of_field_is_noted(scene):
    """A camera with depth of field is solved as a pinhole, and a note says so."""
    module = loaded("core.blender.read.scene")
    add_camera(scene).data.dof.use_dof = True
    assert "Kiriko ignores the depth of field of 'eye'." in module.read(bpy.context, scene).notes


@pytest.mark.parametrize("kind", CAMERAS)
def test_a_viewer_with_pixels_of_its_own(read, scene, kind):
    """Whatever the scene's render has, it is read as from
    a render of those pixels, which are square.
    """
    camera = add_camera(scene, kind)
    camera.kiriko.use_resolution = True
    camera.kiriko.resolution = (50, 70)
    viewer = read()
    camera.kiriko.use_resolution = False
    render = scene.render
    render.resolution_x = 50
    render.resolution_y = 70
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    plain = read()

    assert (viewer.width, viewer.height) == (plain.width, plain.height) == (50, 70)
    assert viewer.window == plain.window
