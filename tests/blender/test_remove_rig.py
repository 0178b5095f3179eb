from typing import Any

import bpy
import pytest

from small_rigs import cube, inventory, new_object, primitive, small_rig

KINDS = (
    "scenes",
    "collections",
    "objects",
    "meshes",
    "cameras",
    "lights",
    "materials",
    "images",
    "node_groups",
    "worlds",
)
# of the session or of memory, not of the file
PASSING = {"rna_type", "session_uid", "users", "original", "depsgraph", "preview", "storage_type"}
PASSING |= {"tag", "pixels", "uv_sculpt"}  # megabytes; and 4.2 crashes at the last
MANY = 300  # items of a collection that are looked at one by one
SMALL = {"viewer_resolution": 32, "display_resolution": (32, 32)}


def plain(thing: Any, depth: int = 0) -> Any:
    """All properties of a datablock, of the structures in it and so on; others by their names."""
    found = {}
    for name, kind in thing.bl_rna.properties.items():
        if name in PASSING or name.startswith("is_"):
            continue
        try:
            value = getattr(thing, name)
        except (AttributeError, RuntimeError):  # such as those of a mode that is not on
            continue
        if kind.type == "POINTER":
            if isinstance(value, bpy.types.ID) and not getattr(value, "is_embedded_data", False):
                found[name] = value.name_full
            elif value is not None and depth < 5:
                found[name] = plain(value, depth + 1)
        elif kind.type == "COLLECTION":
            found[name] = [
                item.name_full if isinstance(item, bpy.types.ID) else plain(item, depth + 1)
                for item in list(value)[: MANY if depth < 5 else 0]
            ]
        elif getattr(kind, "is_array", False):
            found[name] = str([*value])
        else:
            found[name] = str(value)
    return found


def snapshot() -> dict[str, dict[str, Any]]:
    """Every property of all that a file holds."""
    bpy.context.view_layer.update()
    return {
        f"{kind} {block.name_full}": plain(block)
        for kind in KINDS
        for block in getattr(bpy.data, kind)
        if block.name != "Render Result"
    }


def differences(before: Any, after: Any, path: str = "") -> list[str]:
    """Where two snapshots differ, and how."""
    if isinstance(before, dict) and isinstance(after, dict):
        keys = sorted({*before, *after})
        return [d for k in keys for d in differences(before.get(k), after.get(k), f"{path}/{k}")]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = enumerate(zip(before, after, strict=True))
        return [d for k, (a, b) in pairs for d in differences(a, b, f"{path}[{k}]")]
    return [] if before == after else [f"{path}: {str(before)[:60]} -> {str(after)[:60]}"]


def nothing_there() -> None:
    """An empty scene."""


def suzanne() -> None:
    """A subdivided monkey with a material, selected."""
    bpy.ops.mesh.primitive_monkey_add(size=0.08)
    monkey = bpy.context.active_object
    monkey.modifiers.new("Subdivision", "SUBSURF")
    monkey.data.materials.append(bpy.data.materials.new("Mine"))


def in_millimetres() -> None:
    """A cube of 50 units that are millimetres."""
    bpy.context.scene.unit_settings.scale_length = 1e-3
    cube(50.0)


def with_a_camera() -> None:
    """A cube, and a camera that is the scene's and Kiriko's."""
    cube()
    camera = new_object(bpy.data.cameras.new("Mine"))
    bpy.context.scene.camera = bpy.context.scene.kiriko.viewer = camera


@pytest.mark.parametrize(
    "made", [nothing_there, cube, suzanne, in_millimetres, with_a_camera], ids=lambda f: f.__name__
)
def test_the_scene_is_as_before_the_rig(scene: bpy.types.Scene, made: Any) -> None:
    """Every property of every datablock; for a cube after a solve and a preview, too."""
    made()
    before = snapshot()
    bpy.ops.kiriko.add_rig(**SMALL)
    assert differences(before, snapshot())
    if made is cube:
        bpy.ops.kiriko.solve()
        bpy.ops.kiriko.preview(samples=1)

    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
    assert differences(before, snapshot()) == []


def test_a_seen_image_and_a_visible_range_go_too(scene: bpy.types.Scene) -> None:
    """The last simulation, and the dome, are results of the rig."""
    cube()
    before = inventory()
    bpy.ops.kiriko.add_rig(**SMALL, field=0.04)
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.simulate()
    bpy.ops.kiriko.visible_range()
    assert inventory() != before
    bpy.ops.kiriko.remove_rig()
    assert inventory() == before


def test_whatever_the_artist_did_since_stays(scene: bpy.types.Scene) -> None:
    """Settings, things in the rig's collection, an image as picture, renamed glass."""
    rig = small_rig()
    glass = rig["GLASS"]
    glass.name, glass.display_type = "Renamed", "BOUNDS"
    mine = bpy.data.images.new("Mine", 8, 8)
    rig["PICTURE"].kiriko.image = mine
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    rig["PLATE"].users_collection[0].objects.link(lamp)
    rig["PLATE"].name = "Other name"
    bpy.ops.kiriko.remove_rig()
    assert (glass.display_type, glass.kiriko.role) == ("BOUNDS", "NONE")
    assert [thing.name for thing in scene.collection.objects] == ["Renamed", "Lamp"]
    assert inventory()["images"] == ["Mine"]
    assert inventory()["collections"] == []
    assert glass.kiriko.use_ior  # set before


def test_things_that_are_used_elsewhere_stay(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture
) -> None:
    """A copy, a mesh and a material on another thing, and the parent
    of one, which the report names; it has no role any more.
    """
    rig = small_rig()
    copy = rig["DISPLAY"].copy()
    scene.collection.objects.link(copy)
    other = new_object(primitive("cube", size=1.0))
    other.data.materials.append(rig["PLATE"].active_material)
    other.parent = rig["PICTURE"]
    bpy.ops.kiriko.remove_rig()
    assert "'Kiriko Picture' stays, because other things use it." in capfd.readouterr().out
    assert {thing.name for thing in scene.objects} == {
        "Cube",
        "Kiriko Picture",
        copy.name,
        other.name,
    }
    assert copy.data.name == "Kiriko Display"
    assert other.active_material.name == "Kiriko Ideal Plate"
    assert scene.objects["Kiriko Picture"].kiriko.role == "NONE"


def test_undo_brings_the_rig_back(scene: bpy.types.Scene) -> None:
    """All parts with their roles, and the result."""
    small_rig()
    bpy.ops.kiriko.solve()
    before = snapshot()
    bpy.ops.ed.undo_push(message="rig")
    bpy.ops.kiriko.remove_rig()
    bpy.ops.ed.undo_push(message="Remove Rig")
    bpy.ops.ed.undo()
    # Blender 4.2 rounds the pixels a metre of an image that it loads anew
    assert [d for d in differences(before, snapshot()) if "/resolution" not in d] == []
    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}


def test_there_is_a_way_to_add_another_rig(scene: bpy.types.Scene) -> None:
    """Removed and added anew the rig solves as before."""
    small_rig()
    bpy.ops.kiriko.remove_rig()
    with pytest.raises(RuntimeError, match="The scene has no rig that Add Rig made"):
        bpy.ops.kiriko.remove_rig()
    scene.objects["Cube"].select_set(True)
    bpy.ops.kiriko.add_rig(**SMALL)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
