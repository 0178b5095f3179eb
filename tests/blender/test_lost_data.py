"""A file whose library is missing: the part that needs it is named, with the library."""

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import pytest

from small_rigs import cube, new_object, primitive, small_rig

LIBRARY = "lib.blend"
Parts = dict[str, bpy.types.Object]
Link = Callable[[str, bpy.types.ID], Any]


@pytest.fixture
def link(tmp_path: Path) -> Link:
    """Writes a datablock to a library, and links it from there."""

    def linked(kind: str, block: bpy.types.ID) -> bpy.types.ID:
        path, name = str(tmp_path / LIBRARY), block.name
        bpy.data.libraries.write(path, {block})
        with bpy.data.libraries.load(path, link=True) as (_, wanted):
            setattr(wanted, kind, [name])
        return getattr(wanted, kind)[0]

    return linked


def mesh_of_glass(parts: Parts, link: Link) -> str:
    parts["GLASS"].data = link("meshes", parts["GLASS"].data)
    return "Cube"


def nodes_of_glass(parts: Parts, link: Link) -> str:
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    start, end = map(tree.nodes.new, ("NodeGroupInput", "NodeGroupOutput"))
    tree.links.new(start.outputs[0], end.inputs[0])
    parts["GLASS"].modifiers.new("nodes", "NODES").node_group = link("node_groups", tree)
    return "Cube"


def parent_of_glass(parts: Parts, link: Link) -> str:
    parent = link("objects", bpy.data.objects.new("parent", None))
    bpy.context.scene.collection.objects.link(parent)
    parts["GLASS"].parent = parent
    return "Cube"


def material_of_display(parts: Parts, link: Link) -> str:
    mesh = parts["DISPLAY"].data
    mesh.materials.clear()
    mesh.materials.append(link("materials", bpy.data.materials.new("screen")))
    return "Kiriko Display"


def image_of_picture(parts: Parts, link: Link) -> str:
    image = bpy.data.images.new("photo", 8, 8)
    image.pack()
    (slot,) = parts["PICTURE"].material_slots
    for node in slot.material.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.image = link("images", image)
    return "Kiriko Picture"


def collection_of_glass(parts: Parts, link: Link) -> str:
    group = bpy.data.collections.new("group")
    group.objects.link(new_object(primitive("cube", size=0.01)))
    empty = new_object(None, "GLASS")
    empty.name, empty.instance_type = "Instance", "COLLECTION"
    empty.instance_collection = link("collections", group)
    return "Instance"


def camera_of_viewer(parts: Parts, link: Link) -> str:
    scene = bpy.context.scene
    camera = link("objects", new_object(bpy.data.cameras.new("lens")))
    scene.collection.objects.link(camera)
    scene.kiriko.viewer = scene.camera = camera
    return camera.name


def glass_with_its_role(parts: Parts, link: Link) -> str:
    glass = link("objects", parts["GLASS"])
    bpy.data.objects.remove(parts["GLASS"])
    bpy.context.scene.collection.objects.link(glass)
    return glass.name


def display_in_a_collection(parts: Parts, link: Link) -> str:
    group = bpy.data.collections.new("bench")
    group.objects.link(parts["DISPLAY"])
    theirs = link("collections", group)
    bpy.data.objects.remove(parts["DISPLAY"])
    bpy.data.collections.remove(group)
    bpy.context.scene.collection.children.link(theirs)
    return "bench"


KINDS = (
    mesh_of_glass,
    nodes_of_glass,
    parent_of_glass,
    material_of_display,
    image_of_picture,
    collection_of_glass,
    camera_of_viewer,
    glass_with_its_role,
    display_in_a_collection,
)


def reopened(tmp_path: Path) -> bpy.types.Scene:
    """The scene as it is opened without its library."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    (tmp_path / LIBRARY).unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    return bpy.context.scene


@pytest.mark.parametrize("lose", KINDS)
def test_a_part_that_a_library_lacks_is_named_with_the_file(
    kiriko: ModuleType,
    run: Callable[..., int],
    link: Link,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    lose: Callable[[Parts, Link], str],
) -> None:
    """Whatever it is that Blender did not find: the command line and the checklist name the part,
    and the library by its path.
    """
    name = lose(small_rig(), link)
    reopened(tmp_path)
    assert run("solve", "--out", tmp_path / "out") == 1
    told = capsys.readouterr().err
    assert f"'{name}' is missing from the library '{tmp_path / LIBRARY}'. Restore the file" in told
    look_over = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    entries = look_over.look_now(bpy.context)
    assert told.removeprefix("kiriko: ").strip() in [entry.text for entry in entries]
    (button,) = entries[0].buttons
    assert (button.operator, button.properties) == ("wm.lib_relocate", (("library", LIBRARY),))


def test_a_lost_thing_that_is_no_part_is_a_note(
    run: Callable[..., int], link: Link, tmp_path: Path
) -> None:
    """It may have been one, such as wine with a role of its own: the rig is solved without it, and
    the result says so. What others of the scene need is no matter.
    """
    small_rig()
    wine, chair = cube(), new_object(link("meshes", primitive("cube", size=0.1)))
    wine.name, chair.location = "Wine", (1, 1, 1)
    theirs = link("objects", wine)
    bpy.data.objects.remove(wine)
    bpy.context.scene.collection.objects.link(theirs)
    scene = reopened(tmp_path)
    assert run("solve", "--out", tmp_path / "out") == 0
    (note,) = [note for note in scene.kiriko.result.notes.splitlines() if "library" in note]
    assert note.startswith("'Wine' is missing from the library")
