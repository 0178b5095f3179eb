import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from small_rigs import new_object, primitive, small_rig


@pytest.fixture
def read(scene):
    module = loaded("core.blender.read.scene")
    return lambda: module.read(bpy.context, scene).rig.plates


def test_a_plate_is_ideal_unless_told_otherwise(read):
    small_rig()
    (plate,) = read()
    assert plate.array is None


def test_a_preset_sets_the_mirrors(read):
    plate = small_rig()["PLATE"]
    bpy.context.view_layer.objects.active = plate
    bpy.ops.kiriko.plate_preset(preset="ASKA3D-200")
    (found,) = read()
    array = found.array
    assert array.layout == "crossed"
    assert array.pitch == pytest.approx(0.3e-3, rel=1e-6)
    assert array.height == pytest.approx(0.75e-3, rel=1e-6)
    assert (array.ior, array.reflectance) == pytest.approx((1.52, 0.87), rel=1e-6)


@pytest.mark.parametrize("model", ["CROSSED", "HOLES", "RADIAL"])
def test_mirrors_go_with_the_object(read, scene, model):
    plate = small_rig()["PLATE"]
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.01
    ours = plate.kiriko.plate
    ours.model = model
    ours.pitch = 2.0
    ours.height = 3.0
    ours.phase = (0.25, 0.5)
    ours.crossing_error = 0.01
    plate.matrix_world = (
        Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.3, 4, "X") @ Matrix.Scale(2, 4)
    )
    (found,) = read()

    assert found.array.layout == model.lower()
    assert found.array.pitch == pytest.approx(2e-3, rel=1e-6)
    assert found.array.height == pytest.approx(6e-3, rel=1e-6)
    assert found.array.phase == (0.25, 0.5)
    assert found.array.crossing_error == (pytest.approx(0.01) if model == "CROSSED" else 0.0)
    assert found.centre == pytest.approx(np.array([0.01, 0.02, 0.03]), rel=1e-6)
    assert np.cross(found.side, plate.matrix_world.col[0][:3]) == pytest.approx(
        np.zeros(3), abs=1e-7
    )


def test_only_a_plate_has_a_preset(scene):
    """In a rig with two, only the selected one."""
    rig = small_rig()
    new_object(primitive("grid", size=1.0), "PLATE")
    bpy.context.view_layer.objects.active = rig["GLASS"]
    with pytest.raises(RuntimeError, match="Select an object with the role plate"):
        bpy.ops.kiriko.plate_preset(preset="ASKA3D-488")


@pytest.mark.parametrize("metres", [1.0, 0.001])
def test_a_preset_sets_everything_whatever_the_unit(read, scene, metres):
    """No earlier setting is left.

    The pitch is in millimetres in a scene of any unit.
    """
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", metres
    plate = (
        small_rig()["PLATE"] if metres == 1 else new_object(primitive("grid", size=100), "PLATE")
    )
    bpy.context.view_layer.objects.active = plate
    ours = plate.kiriko.plate
    ours.model = "RADIAL"
    ours.pitch = 3.0
    ours.height = 1.0
    ours.ior = 1.7
    ours.reflectance = 0.2
    ours.crossing_error = 0.01
    ours.fresnel = False
    ours.phase = (0.3, -0.4)
    bpy.ops.kiriko.plate_preset(preset="ASKA3D-488")

    assert ours.pitch == pytest.approx(0.5, rel=1e-6)
    assert tuple(ours.phase) == (0.0, 0.0)
    if metres == 1:
        (found,) = read()
        array = found.array
        assert (array.layout, array.crossing_error, array.has_fresnel, array.phase) == (
            "crossed",
            0.0,
            True,
            (0, 0),
        )
        assert array.pitch == pytest.approx(0.5e-3, rel=1e-6)
        assert (array.height, array.ior, array.reflectance) == pytest.approx(
            (1.25e-3, 1.52, 0.87), rel=1e-6
        )


def test_a_plate_drawn_across_its_x_axis_has_its_mirrors_by_y(read):
    """Where the object's x axis stands upright on its faces its y axis is the side.

    Elsewhere x is.
    """
    plate = small_rig()["PLATE"]
    plate.kiriko.plate.model = "CROSSED"
    x, y = (np.array(plate.matrix_world.col[k][:3]) for k in (0, 1))
    (before,) = read()

    assert np.cross(before.side, x) == pytest.approx(np.zeros(3), abs=1e-6)
    turn = Matrix.Rotation(np.pi / 2, 4, "Y")  # x shows where z did
    plate.data.transform(turn.inverted())
    plate.matrix_world = plate.matrix_world @ turn
    bpy.context.view_layer.update()
    (found,) = read()

    assert np.cross(found.side, y) == pytest.approx(np.zeros(3), abs=1e-6)
    # it stands where it stood
    assert found.mesh.vertices == pytest.approx(before.mesh.vertices, abs=1e-6)


@pytest.mark.parametrize("is_on", [True, False])
def test_the_faces_reflect_as_their_switch_says(read, is_on):
    plate = small_rig()["PLATE"]
    plate.kiriko.plate.model, plate.kiriko.plate.fresnel = "HOLES", is_on
    (found,) = read()
    assert found.array.has_fresnel is is_on
