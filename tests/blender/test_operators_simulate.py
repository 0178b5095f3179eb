import bpy
import numpy as np
import pytest
from small_rigs import inventory, pixels, small_rig


def test_an_ideal_plate_shows_the_picture_and_no_stray_light(scene, kiriko):
    small_rig()
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.simulate(samples=4)
    seen = pixels(bpy.data.images["Kiriko Seen"])
    assert seen.shape[:2] == (64, 64)
    assert seen[..., :3].max() > 0.5
    assert np.isfinite(seen).all()


def test_mirrors_dim_the_picture(scene, kiriko):
    parts = small_rig()
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.simulate(samples=9)
    bright = pixels(bpy.data.images["Kiriko Seen"])[..., :3].mean()
    parts["PLATE"].kiriko.plate.model = "CROSSED"
    bpy.ops.kiriko.simulate(samples=9)
    dim = pixels(bpy.data.images["Kiriko Seen"])[..., :3].mean()
    # 0.863 images at 45 degrees, two mirrors of 0.87 and two faces
    assert dim / bright == pytest.approx(0.59, abs=0.03)
    assert len([image for image in bpy.data.images if image.name.startswith("Kiriko Seen")]) == 1


def test_without_a_source_image_there_is_nothing_to_see(scene):
    small_rig()
    before = inventory()
    with pytest.raises(RuntimeError, match="solve first"):
        bpy.ops.kiriko.simulate()
    assert inventory() == before


def test_another_display_wants_another_solve(scene):
    parts = small_rig()
    bpy.ops.kiriko.solve()
    parts["DISPLAY"].kiriko.resolution = (32, 32)
    before = inventory()
    with pytest.raises(RuntimeError, match="solve again"):
        bpy.ops.kiriko.simulate()
    assert inventory() == before
