import importlib

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from small_rigs import small_rig


@pytest.fixture
def read(scene, kiriko):
    module = importlib.import_module(f"{kiriko.__name__}.core.blender_scene")
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
    ours.model, ours.pitch, ours.height, ours.phase, ours.crossing_error = model, 2.0, 3.0, (0.25, 0.5), 0.01
    plate.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.3, 4, "X") @ Matrix.Scale(2, 4)
    (found,) = read()
    assert found.array.layout == model.lower()
    assert found.array.pitch == pytest.approx(2e-3, rel=1e-6)
    assert found.array.height == pytest.approx(6e-3, rel=1e-6)
    assert found.array.phase == (0.25, 0.5)
    assert found.array.crossing_error == (pytest.approx(0.01) if model == "CROSSED" else 0.0)
    assert found.centre == pytest.approx(np.array([0.01, 0.02, 0.03]), rel=1e-6)
    assert np.cross(found.side, plate.matrix_world.col[0][:3]) == pytest.approx(np.zeros(3), abs=1e-7)


def test_only_a_plate_has_a_preset(scene):
    glass = small_rig()["GLASS"]
    bpy.context.view_layer.objects.active = glass
    with pytest.raises(RuntimeError, match="Select a plate"):
        bpy.ops.kiriko.plate_preset(preset="ASKA3D-488")
