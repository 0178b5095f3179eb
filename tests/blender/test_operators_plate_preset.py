import re

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from small_rigs import new_object, primitive, small_rig

SINGLE = 1e-6  # of a metre: float32's rounding of places and sizes


def plane(size: float = 0.3, **options: object) -> bpy.types.Object:
    """The active object: a plane of the user's own with the role Plate, somewhere."""
    thing = new_object(primitive("grid", x_segments=2, y_segments=2, size=size / 2), "PLATE")
    thing.location = (0.1, 0.2, -0.3)
    thing.rotation_euler = (0.7, 0.1, 0.2)
    for name, value in options.items():
        setattr(thing, name, value)
    return activate(thing)


def activate(thing: bpy.types.Object) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    return thing


def world(thing: bpy.types.Object) -> np.ndarray:
    """Vertices (n, 3) as shown, in the world, Blender units."""
    bpy.context.view_layer.update()
    shown = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([shown.matrix_world @ vertex.co for vertex in shown.data.vertices])


def sides(thing: bpy.types.Object) -> list[float]:
    """Length and width of a rectangle: between its outermost vertices along its first edges."""
    points = world(thing)
    far = points[np.linalg.norm(points - points.mean(axis=0), axis=1).argsort()[-4:]]  # its corners
    apart = np.sort(np.linalg.norm(far - far[0], axis=1))[1:3]
    return apart.tolist()


def frame(thing: bpy.types.Object) -> np.ndarray:
    """Middle and normal of a plate."""
    points = world(thing)
    _, _, axes = np.linalg.svd(points - points.mean(axis=0))
    return np.concatenate([(points.min(axis=0) + points.max(axis=0)) / 2, np.abs(axes[2])])


@pytest.mark.parametrize(("preset", "side"), [("ASKA3D-200", 0.2), ("ASKA3D-488", 0.488)])
def test_a_plate_gets_the_size_of_the_product(scene, capfd, preset, side):
    """The plate of Add Rig is as large as the bought one, where it was; the report says so."""
    plate = activate(small_rig()["PLATE"])
    before = frame(plate)
    assert bpy.ops.kiriko.plate_preset(preset=preset) == {"FINISHED"}
    assert sides(plate) == pytest.approx([side, side], abs=SINGLE)
    assert frame(plate) == pytest.approx(before, abs=SINGLE)
    assert plate.kiriko.plate.model == "CROSSED"
    assert re.search(
        rf"Info: 'Kiriko Plate' is now {preset} \({side:g} m x {side:g} m\)",
        capfd.readouterr().out,
    )


@pytest.mark.parametrize(
    "way",
    ["scaled", "parent", "delta", "off centre", "upright", "askew", "modifier", "millimetres"],
)
def test_a_plane_of_the_users_own_gets_it_too(scene, way):
    """However it came to its size: place of its middle, rotation and mesh stay."""
    unit = 1.0
    thing = plane()
    if way == "scaled":
        thing.scale = (0.7, 1.9, 0.0)
    elif way == "parent":
        parent = new_object(None)
        parent.scale = (2.0, 2.0, 2.0)
        parent.rotation_euler = (0.3, 0.2, 0.1)
        parent.location = (1.0, 0.0, 0.5)
        thing.parent = parent
        thing.matrix_parent_inverse = Matrix.Translation((0.1, 0.0, 0.0))
    elif way == "delta":
        thing.delta_scale = (1.5, 0.5, 1.0)
        thing.delta_location = (0.0, 0.1, 0.0)
    elif way == "off centre":
        thing.data.transform(Matrix.Translation((0.15, 0.05, 0.0)))
    elif way == "upright":
        thing.data.transform(Matrix.Rotation(np.pi / 2, 4, "Y"))
    elif way == "askew":
        thing.data.transform(Matrix.Rotation(0.6, 4, "X") @ Matrix.Translation((0.0, 0.1, 0.0)))
    elif way == "modifier":
        thing.modifiers.new("again", "ARRAY").count = 2
    elif way == "millimetres":
        unit = 1000.0
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.001

    vertices = np.array([vertex.co for vertex in thing.data.vertices])
    before = frame(thing)
    turned = np.array(thing.rotation_euler)
    assert bpy.ops.kiriko.plate_preset(preset="ASKA3D-200") == {"FINISHED"}
    assert sides(thing) == pytest.approx([0.2 * unit] * 2, rel=1e-5)
    assert frame(thing) == pytest.approx(before, abs=2 * SINGLE)
    assert np.array_equal(thing.rotation_euler, turned)
    assert np.array_equal([vertex.co for vertex in thing.data.vertices], vertices)


def test_others_of_the_mesh_and_children_stay(scene):
    """An object of the same mesh keeps its size, a child its place and shape.

    The plate's grandchild, too.
    """
    thing = plane()
    other = new_object(None)
    other = bpy.data.objects.new("other", thing.data)
    scene.collection.objects.link(other)
    child = new_object(primitive("cube", size=0.1))
    grandchild = new_object(primitive("cube", size=0.1))
    child.parent = thing
    child.location = (0.3, 0.2, 0.1)
    child.rotation_euler = (0.4, 0.5, 0.6)
    grandchild.parent = child
    grandchild.location = (0.1, 0.0, 0.0)
    before = [world(part) for part in (other, child, grandchild)]
    bpy.ops.kiriko.plate_preset(preset="ASKA3D-200")
    for part, points in zip((other, child, grandchild), before, strict=True):
        assert np.abs(world(part) - points).max() < SINGLE


@pytest.mark.parametrize(
    ("way", "why"),
    [
        ("animated", "it is animated"),
        ("driven", "it is animated"),
        ("constraint", "a constraint or a driver holds it"),
        ("locked", "its transform is locked"),
        ("no width", "it has no size"),
        ("turned", "its mesh is rotated in the object and not square"),
        ("instance", "it is an instance"),
    ],
)
def test_what_holds_its_size_keeps_it_and_says_why(scene, capfd, way, why):
    """The mirrors are set, the size is not, and the report warns of it with the reason."""
    thing = plane()
    if way == "animated":
        thing.keyframe_insert("scale", frame=1)
    elif way == "driven":
        thing.driver_add("scale", 0).driver.expression = "1.0"
    elif way == "constraint":
        limit = thing.constraints.new("LIMIT_SCALE")
        limit.use_min_x = True
        limit.min_x = 1.0
        limit.use_transform_limit = False
    elif way == "locked":
        thing.lock_scale[0] = True
    elif way == "no width":
        thing.scale.x = 0.0
    elif way == "turned":
        thing.data.transform(Matrix.Rotation(0.6, 4, "X") @ Matrix.Diagonal((1.0, 2.0, 1.0, 1.0)))
    else:
        thing = plane()
        collection = bpy.data.collections.new("plates")
        collection.objects.link(thing)
        scene.collection.objects.unlink(thing)
        thing = activate(new_object(None, "PLATE"))
        thing.instance_type, thing.instance_collection = "COLLECTION", collection

    bpy.context.view_layer.update()
    before = (tuple(thing.scale), tuple(thing.location), tuple(map(tuple, thing.matrix_world)))
    assert bpy.ops.kiriko.plate_preset(preset="ASKA3D-200") == {"FINISHED"}
    bpy.context.view_layer.update()

    assert (
        tuple(thing.scale),
        tuple(thing.location),
        tuple(map(tuple, thing.matrix_world)),
    ) == before
    assert (
        f"is now ASKA3D-200, but could not be resized to 0.2 m x 0.2 m: {why}."
        in capfd.readouterr().out
    )
    assert thing.kiriko.plate.pitch == pytest.approx(0.3)
