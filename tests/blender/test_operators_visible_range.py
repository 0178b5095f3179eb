import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import inventory, small_rig

NAME = "Kiriko Visible Range"


def test_the_range_is_an_object_around_the_viewer(scene):
    parts = small_rig()
    bpy.ops.kiriko.visible_range()
    thing = bpy.data.objects[NAME]
    camera = scene.camera.matrix_world.translation
    points = [thing.matrix_world @ v.co for v in thing.data.vertices]
    centre = parts["PICTURE"].matrix_world.translation
    distance = (camera - centre).length

    assert [(p - centre).length for p in points] == pytest.approx(
        [distance] * len(points), rel=1e-4
    )

    # the viewer's own place is one of the grid's
    assert min((p - camera).length for p in points) < 1e-3 * distance
    brightness = np.empty(len(points), np.float32)
    thing.data.attributes["brightness"].data.foreach_get("value", brightness)

    assert 0.5 < brightness.max() <= 1
    assert thing.hide_render
    assert thing.kiriko.role == "NONE"


def test_it_is_made_anew_in_place(scene):
    small_rig()
    bpy.ops.kiriko.visible_range()
    before = inventory()
    whole = len(bpy.data.objects[NAME].data.polygons)
    bpy.ops.kiriko.visible_range(share=0.2)
    assert inventory() == before
    assert len(bpy.data.objects[NAME].data.polygons) > whole


def test_where_nothing_is_seen_nothing_is_made(scene):
    parts = small_rig()
    parts["DISPLAY"].scale = (0.05, 0.05, 0.05)
    before = inventory()
    with pytest.raises(RuntimeError, match="Nowhere within"):
        bpy.ops.kiriko.visible_range(share=1.0)
    assert inventory() == before


def test_it_is_removed_with_its_mesh(scene):
    """The scene is as it was before; then there is nothing to be removed."""
    small_rig()
    before = inventory()
    bpy.ops.kiriko.visible_range()
    assert inventory() != before
    assert bpy.ops.kiriko.remove_visible_range() == {"FINISHED"}
    assert inventory() == before
    with pytest.raises(RuntimeError, match="There is nothing to apply or remove"):
        bpy.ops.kiriko.remove_visible_range()


def test_colours_grow_brighter_and_end_at_the_scales_ends(kiriko):
    """Lightness grows along the whole scale, as the eye weighs its colours."""
    module = loaded("core.blender.result.conflict")
    colours = module.viridis(np.linspace(-0.5, 1.5, 41))
    assert np.allclose(colours[0], module.ANCHORS[0])
    assert np.allclose(colours[-1], module.ANCHORS[-1])
    luminance = colours**2.2 @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance[10:31]) > 0).all()
