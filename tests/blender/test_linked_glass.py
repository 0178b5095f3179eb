"""Glass of another file: its part in a rig stays when the file is opened again."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import pytest

from test_ugly_glass import glass_material


def suzanne() -> bpy.types.Object:
    """A monkey's head of glass, smooth."""
    bpy.ops.mesh.primitive_monkey_add(size=0.06)
    thing = bpy.context.object
    thing.data.materials.append(glass_material("Glass", 1.5))
    thing.modifiers.new("Subdivision", "SUBSURF").levels = 1
    return thing


def add_rig(thing: bpy.types.Object) -> None:
    """A small one, around an object."""
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    bpy.ops.kiriko.add_rig(viewer_resolution=16, display_resolution=(16, 16), picture_size=0.005)


def reopened(path: Path) -> bpy.types.Scene:
    """The scene after its file was saved and opened."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def glass_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """All that is glass in it."""
    return [thing for thing in scene.objects if thing.kiriko.role == "GLASS"]


@contextmanager
def unsaid() -> Iterator[None]:
    """No handler hears of a save within, as of Blender's auto-save."""
    listening = list(bpy.app.handlers.save_pre)
    bpy.app.handlers.save_pre.clear()
    try:
        yield
    finally:
        bpy.app.handlers.save_pre.extend(listening)


def written(path: Path, *blocks: bpy.types.ID) -> None:
    """Put datablocks into another file, and take them out of this one."""
    bpy.data.libraries.write(str(path), set(blocks))
    bpy.data.batch_remove(blocks)


def link_in_place(linked: Callable, own: bpy.types.Object) -> bpy.types.Object:
    """An object written to another file, and linked from there in its own place."""
    theirs = linked(own)
    bpy.data.objects.remove(own)
    bpy.context.scene.collection.objects.link(theirs)
    bpy.context.view_layer.update()
    return theirs


@pytest.fixture
def theirs(scene, linked) -> bpy.types.Object:
    """A linked glass in the scene."""
    return link_in_place(linked, suzanne())


def link_group(scene: bpy.types.Scene, path: Path) -> bpy.types.Collection:
    """A linked collection in the scene, with a glass that is linked with it."""
    group = bpy.data.collections.new("Group")
    own = suzanne()
    scene.collection.objects.unlink(own)
    group.objects.link(own)
    written(path, group, own)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.collections = ["Group"]
    (group,) = wanted.collections
    scene.collection.children.link(group)
    return group


def test_a_rig_around_linked_glass_has_it_in_the_next_session(theirs, tmp_path, capfd):
    """Twice: what Blender reads of the other file has no settings, each time anew. It finds no
    fault in the file.
    """
    add_rig(theirs)
    for _ in range(2):
        scene = reopened(tmp_path / "scene.blend")
        (glass,) = glass_of(scene)
        assert (glass.name, glass.override_library is None) == ("Suzanne", False)
        assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert "RNA_" not in capfd.readouterr().out
    bpy.ops.kiriko.remove_rig()
    assert glass.kiriko.role == "NONE"
    assert not glass.kiriko.taken_as
    assert [thing.name for thing in scene.objects] == ["Suzanne"]


@pytest.mark.parametrize("is_reopened", [False, True])
def test_linked_glass_keeps_its_role_when_its_file_is_read_again(
    theirs, tmp_path, is_reopened, capfd
):
    """By Reload, twice; by Relocate; and Blender finds no fault in what it writes then."""
    add_rig(theirs)
    scene = reopened(tmp_path / "scene.blend") if is_reopened else bpy.context.scene
    path = tmp_path / "Suzanne.blend"
    other = shutil.copy(path, tmp_path / "Other.blend")
    for _ in range(2):
        glass_of(scene)[0].override_library.reference.library.reload()
        assert [glass.name for glass in glass_of(scene)] == ["Suzanne"]

    for verb, file in (("reload", path), ("relocate", Path(other))):
        names = {"filepath": str(file), "directory": f"{file.parent}/", "filename": file.name}
        getattr(bpy.ops.wm, f"lib_{verb}")(library="Suzanne.blend", **names)
        (glass,) = glass_of(scene)
        assert glass.override_library.reference.library.filepath.endswith(file.name)
    (glass,) = glass_of(reopened(tmp_path / "scene.blend"))
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    out = capfd.readouterr()
    assert "RNA_" not in out.out + out.err


def test_linked_glass_keeps_its_role_in_an_auto_save(theirs, tmp_path):
    """Which tells no handler, and so is that of a session's end."""
    add_rig(theirs)
    for _ in range(3):
        with unsaid():
            scene = reopened(tmp_path / "auto.blend")
        assert [glass.name for glass in glass_of(scene)] == ["Suzanne"]


def test_glass_of_a_hierarchy_of_overrides_keeps_its_role_when_it_is_resynced(scene, tmp_path):
    """After opening, with no save between."""
    group = link_group(scene, tmp_path / "library.blend")
    (thing,) = scene.objects
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.make_override_library(collection=group.session_uid)
    add_rig(next(thing for thing in scene.objects if thing.library is None))
    for _ in range(2):
        scene = reopened(tmp_path / "scene.blend")
        (glass,) = glass_of(scene)
        assert glass.override_library.resync(scene)
        assert len(glass_of(scene)) == 1


def test_settings_of_an_override_are_saved(theirs, tmp_path):
    """Those within the groups of plate, picture and display, too."""
    own = theirs.override_create(remap_local_usages=True)
    own.kiriko.surface, own.kiriko.use_ior, own.kiriko.ior = "SMOOTH", True, 1.7
    own.kiriko.resolution = (7, 8)
    own.kiriko.plate.pitch = 2.0
    own.kiriko.picture.gamma = 1.5
    own.kiriko.display.black_level = 0.25
    own.kiriko.image = bpy.data.images.new("mine", 4, 4)
    for _ in range(2):
        (own,) = reopened(tmp_path / "scene.blend").objects
        ours = own.kiriko
        assert (ours.surface, ours.use_ior, ours.image.name) == ("SMOOTH", True, "mine")
        assert tuple(ours.resolution) == (7, 8)
        assert ours.ior == pytest.approx(1.7)
        assert (ours.plate.pitch, ours.picture.gamma) == (2.0, 1.5)
        assert ours.display.black_level == 0.25


def test_glass_in_a_linked_collection_is_refused(scene, tmp_path):
    """No override takes its place there. All is as it was."""
    group = link_group(scene, tmp_path / "library.blend")
    (thing,) = scene.objects
    with pytest.raises(RuntimeError, match="'Suzanne' is linked from another file"):
        add_rig(thing)
    assert list(scene.objects) == [thing] == list(bpy.data.objects)
    assert not bpy.data.collections.get("Kiriko Rig")

    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    assert bpy.ops.object.make_override_library(collection=group.session_uid) == {"FINISHED"}
    (own,) = (thing for thing in scene.objects if thing.library is None)
    add_rig(own)
    scene = reopened(tmp_path / "scene.blend")
    assert [one.kiriko.role for one in scene.objects if one.name == "Suzanne"] == ["GLASS"]


@pytest.mark.parametrize("is_local", [True, False])
def test_linked_glass_without_a_material_is_made_glass(
    scene, linked, tmp_path, look, capfd, is_local
):
    """Its mesh has no slot, and can get none in this file: a modifier of the object sets it. Remove
    Rig takes that away. The object may be one of this file.
    """
    bpy.ops.mesh.primitive_monkey_add(size=0.06)
    own = bpy.context.object
    if is_local:
        own.data = linked(own.data)
    else:
        own = link_in_place(linked, own)
    add_rig(own)
    (glass,) = glass_of(scene)
    assert "material" in " ".join(str(entry.text) for entry in look())
    bpy.ops.kiriko.make_glass(part=glass.name)
    assert "A new modifier assigns it." in capfd.readouterr().out
    assert not any("isn't glass" in str(entry.text) for entry in look())

    scene = reopened(tmp_path / "scene.blend")
    (glass,) = glass_of(scene)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert "isn't glass" not in scene.kiriko.result.notes
    bpy.ops.kiriko.remove_rig()
    assert not glass.modifiers


def test_an_override_that_was_made_glass_has_its_material_back(scene, linked, tmp_path):
    """Also when the rig is removed in another session."""
    own = suzanne()
    own.material_slots[0].material = bpy.data.materials.new("Matt")
    add_rig(link_in_place(linked, own))
    bpy.ops.kiriko.make_glass(part="Suzanne")
    (glass,) = glass_of(reopened(tmp_path / "a.blend"))
    assert [slot.material.name for slot in glass.material_slots] == ["Kiriko Glass"]
    bpy.ops.kiriko.remove_rig()
    assert [(slot.link, slot.material.name) for slot in glass.material_slots] == [("DATA", "Matt")]


def test_an_instance_of_glass_with_a_role_says_why_it_cannot_be_glass(scene):
    """The role of the object itself counts, and it may be in a rig of another file."""
    own = suzanne()
    own.kiriko.role = "GLASS"
    group = bpy.data.collections.new("Group")
    scene.collection.objects.unlink(own)
    group.objects.link(own)
    thing = bpy.data.objects.new("Instance", None)
    thing.instance_type, thing.instance_collection = "COLLECTION", group
    scene.collection.objects.link(thing)
    with pytest.raises(RuntimeError, match="'Instance' contains 'Suzanne', which has a role"):
        add_rig(thing)
    own.kiriko.role = "NONE"
    add_rig(thing)
    assert thing.kiriko.role == "GLASS"


def brought(scene: bpy.types.Scene, path: Path, *names: str) -> list[bpy.types.Object]:
    """Objects of another file, linked into the scene in this order, and selected alone."""
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.objects = list(names)
    for thing in wanted.objects:
        scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    bpy.ops.object.select_all(action="DESELECT")
    for thing in wanted.objects:
        thing.select_set(True)
    bpy.context.view_layer.objects.active = wanted.objects[0]
    return list(wanted.objects)


@pytest.mark.parametrize("is_one_first", [False, True])
@pytest.mark.parametrize("names", [("Whole", "Part"), ("Part", "Whole")])
def test_linked_glass_follows_linked_glass(scene, tmp_path, names, is_one_first):
    """Its parent, by a Boolean and by a constraint, whichever was made an override first."""
    whole, part = suzanne(), suzanne()
    whole.name, part.name = "Whole", "Part"
    part.parent, part.location.x = whole, 0.07
    part.matrix_parent_inverse.translation.z = 0.01
    whole.modifiers.new("Boolean", "BOOLEAN").object = part
    part.constraints.new("LIMIT_DISTANCE").target = whole
    written(tmp_path / "library.blend", whole, part)
    things = brought(scene, tmp_path / "library.blend", *names)
    before = {thing.name: thing.matrix_world.copy() for thing in things}
    if is_one_first:
        things[0].override_create(remap_local_usages=True).kiriko.surface = "SMOOTH"
    for thing in scene.objects:
        thing.select_set(True)
    bpy.context.view_layer.objects.active = scene.objects["Whole"]
    bpy.ops.kiriko.add_rig(viewer_resolution=16, display_resolution=(16, 16), picture_size=0.005)
    for _ in range(2):
        bpy.context.view_layer.update()
        found = {thing.name: thing for thing in glass_of(scene)}
        whole, part = found["Whole"], found["Part"]
        assert part.parent == whole
        assert whole.modifiers["Boolean"].object == part
        assert part.constraints[0].target == whole
        for name, thing in found.items():
            np.testing.assert_allclose(thing.matrix_world, before[name], atol=1e-6)
        scene = reopened(tmp_path / "scene.blend")


def test_remove_rig_leaves_no_glass_of_a_modifier(scene, linked):
    """Nor do its nodes stay. One that others have stays."""
    bpy.ops.mesh.primitive_monkey_add(size=0.06)
    own = bpy.context.object
    own.data = linked(own.data)
    add_rig(own)
    bpy.ops.kiriko.make_glass(part=own.name)
    bpy.ops.kiriko.remove_rig()
    assert not bpy.data.materials
    assert not bpy.data.node_groups
    add_rig(own)
    bpy.ops.kiriko.make_glass(part=own.name)
    bpy.data.objects.new("Other", bpy.data.meshes.new("Other")).data.materials.append(
        bpy.data.materials["Kiriko Glass"]
    )
    bpy.ops.kiriko.remove_rig()
    assert [material.name for material in bpy.data.materials] == ["Kiriko Glass"]
