"""A scene whose unit is changed after Add Rig, because it was drawn without a size in mind."""

import bpy
import numpy as np
import pytest

from small_rigs import cube


def bench(scene: bpy.types.Scene) -> dict[str, float]:
    """Lengths, m, of a rig: distances from the picture, and sizes."""
    unit = scene.unit_settings.scale_length
    bpy.context.view_layer.update()
    parts = {thing.kiriko.role: thing for thing in scene.objects}
    parts["VIEWER"] = scene.kiriko.viewer
    middle = parts["PICTURE"].matrix_world.translation
    found = {
        f"{role} at": unit * (thing.matrix_world.translation - middle).length
        for role, thing in parts.items()
        if role in ("VIEWER", "PLATE", "DISPLAY")
    }
    found |= {
        f"{role} wide": unit * thing.dimensions.x
        for role, thing in parts.items()
        if role in ("PICTURE", "PLATE", "DISPLAY")
    }
    seen = 2 * np.tan(scene.kiriko.viewer.data.angle / 2) * found["VIEWER at"]
    return {
        **found,
        "field": seen,
        "eyes": unit * scene.kiriko.viewer.data.stereo.convergence_distance,
    }


@pytest.mark.parametrize("kind", ["IN_GLASS", "BEHIND_GLASS"])
@pytest.mark.parametrize("side", [2.0, 50.0])
def test_a_rig_of_a_rescaled_scene_can_be_built(scene, kind, side):
    """Its lengths are those of a rig that is added after the scene was rescaled."""
    options = {"kind": kind, "viewer_resolution": 64, "display_resolution": (64, 64)}
    factor = 0.02 / side
    glass = cube(side)
    glass.kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(**options)
    viewer = scene.kiriko.viewer
    assert bpy.ops.kiriko.rescale_scene(factor=factor) == {"FINISHED"}
    found = bench(scene)
    assert scene.kiriko.viewer == viewer
    bpy.ops.kiriko.solve()
    shown = scene.kiriko.result.summary

    bpy.ops.kiriko.remove_rig()
    glass.select_set(True)
    bpy.ops.kiriko.add_rig(**options)
    expected = bench(scene)
    # behind glass the picture is a little larger for a viewer who stands a little nearer
    assert found == pytest.approx(expected, rel=0.03 if kind == "IN_GLASS" else 0.15)
    assert found["VIEWER at"] == pytest.approx(1, rel=0.03)
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.summary == shown


def test_a_rig_in_real_sizes_only_changes_with_the_scene(scene):
    """Where glass is small before and after, every length is the same number of units."""
    cube(0.04)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    plate = next(thing for thing in scene.objects if thing.kiriko.role == "PLATE")
    plate["mine"] = 1
    before = bench(scene)
    bpy.ops.kiriko.rescale_scene(factor=1.0)
    assert bench(scene) == pytest.approx(before)
