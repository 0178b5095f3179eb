"""Rigs that artists delete, duplicate, append, link and rename by Blender's own means."""

import importlib
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from small_rigs import cube, new_object, pixels, primitive
from test_remove_rig import differences, snapshot
from test_rigs import SMALL, add, choose, gem, two

pytestmark = pytest.mark.usefixtures("no_remedies")


def roles(kiriko: ModuleType) -> dict[str, list[str]]:
    """Names of the active rig's parts, by their roles."""
    rig = (
        importlib.import_module(f"{kiriko.__name__}.core.blender.read.scene").read(bpy.context).rig
    )
    fields = ("glasses", "plates", "displays", "pictures", "viewers")
    return {name: sorted(part.name for part in getattr(rig, name)) for name in fields}


def look(kiriko: ModuleType) -> None:
    """As the timer does it."""
    importlib.import_module(f"{kiriko.__name__}.operators.choose_rig").follow_selection()


def delete_alone(rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """As the outliner's Delete: its things go to where it was."""
    things = list(rig.objects)
    for thing in set(things) - set(bpy.context.scene.collection.objects):
        bpy.context.scene.collection.objects.link(thing)
    bpy.data.collections.remove(rig)
    return things


def duplicate(rig: bpy.types.Collection) -> bpy.types.Collection:
    """As the outliner's Duplicate Collection: its objects and their data are copied, too, and take
    the place of those that its settings point to.
    """
    copy = rig.copy()
    bpy.context.scene.collection.children.link(copy)
    for thing in rig.objects:
        twin = thing.copy()
        twin.data = thing.data.copy()
        copy.objects.unlink(thing)
        copy.objects.link(twin)
        if copy.kiriko.viewer == thing:
            copy.kiriko.viewer = twin
    return copy


def test_a_viewer_that_was_deleted_is_missing(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """Blender's Delete leaves it chosen, where nobody sees it: the rig says that it has none, even
    if it is the scene's camera. The viewer that is made then becomes the scene's camera.
    """
    needed = importlib.import_module(f"{kiriko.__name__}.operators.needed")
    rig = add(cube())
    viewer = scene.kiriko.viewer
    scene.camera = None
    assert needed.missing_parts(scene) == []
    rig.objects.unlink(viewer)
    assert scene.kiriko.viewer == viewer
    assert needed.missing_parts(scene) == [needed.NEEDED["VIEWER"]]
    with pytest.raises(RuntimeError, match="No viewer: add a camera"):
        bpy.ops.kiriko.solve()
    scene.camera = viewer
    assert needed.missing_parts(scene) == [needed.NEEDED["VIEWER"]]
    bpy.ops.kiriko.make_part(role="VIEWER")
    assert scene.camera == scene.kiriko.viewer
    assert scene.kiriko.viewer not in (None, viewer)
    assert needed.missing_parts(scene) == []

    # in a collection that an empty stands for it is in no scene, and seen
    apart = bpy.data.collections.new("apart")
    apart.objects.link(viewer)
    stand_in = bpy.data.objects.new("stand-in", None)
    stand_in.instance_type, stand_in.instance_collection = "COLLECTION", apart
    scene.collection.objects.link(stand_in)
    scene.camera, scene.kiriko.viewer = viewer, None
    assert needed.missing_parts(scene) == []


def test_a_rig_goes_on_without_its_collection(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """With the scene's own settings. Another one is refused as long as its parts have roles."""
    first = add(cube())
    before = roles(kiriko)
    things = delete_alone(first)
    look(kiriko)
    assert roles(kiriko) == before
    assert bpy.ops.kiriko.solve() == {"FINISHED"}

    with pytest.raises(RuntimeError, match="The scene already has a display"):
        add(gem())
    assert len(things) == 5


def test_what_a_dead_rig_changed_is_put_back(scene: bpy.types.Scene) -> None:
    """A material of two rigs' glass is put back with the last one that is there."""
    glass = bpy.data.materials.new("Glass")
    for thing in (cube(), gem()):
        thing.data.materials.append(glass)
    add(scene.objects["Cube"])
    delete_alone(add(scene.objects["Gem"]))
    bpy.context.view_layer.objects.active = scene.objects["Cube"]
    bpy.ops.kiriko.remove_rig()
    assert glass.diffuse_color[3] == 1


@pytest.mark.parametrize("is_named_anew", [False, True])
def test_a_duplicated_collection_is_a_rig_of_its_own(
    kiriko: ModuleType, scene: bpy.types.Scene, is_named_anew: bool
) -> None:
    """With its own copies of all parts, and the same settings; the first one is as it was."""
    first = add(cube())
    if is_named_anew:
        first.name = "Goblet"
    scene.kiriko.tolerance = 0.3
    bpy.ops.kiriko.solve()
    source = pixels(scene.kiriko.result.source)
    before = roles(kiriko)
    copy = duplicate(first)
    look(kiriko)

    assert roles(kiriko) == before
    assert np.array_equal(pixels(scene.kiriko.result.source), source)
    choose(copy)
    ours = scene.kiriko
    assert ours.tolerance == pytest.approx(0.3)
    assert ours.viewer in set(copy.objects)
    mine = roles(kiriko)
    assert all(names != before[role] for role, names in mine.items())
    bpy.ops.kiriko.solve()
    assert np.array_equal(pixels(ours.result.source), source)
    choose(first)
    assert np.array_equal(pixels(scene.kiriko.result.source), source)
    assert first.kiriko.result.source != copy.kiriko.result.source


@pytest.mark.parametrize("is_copy_first", [False, True])
def test_a_duplicate_and_its_rig_are_removed(
    kiriko: ModuleType, scene: bpy.types.Scene, is_copy_first: bool
) -> None:
    """In either order the scene is as before both, but for the copy of the artist's glass."""
    thing = cube()
    thing.select_set(False)
    scene.kiriko.tolerance = 0.2
    before = snapshot()
    rigs = [add(thing)]
    bpy.ops.kiriko.solve()
    rigs.append(duplicate(rigs[0]))
    look(kiriko)
    for rig in rigs[:: -1 if is_copy_first else 1]:
        choose(rig)
        other = next((one for one in rigs if one != rig), None)
        bpy.ops.kiriko.remove_rig()
        rigs.remove(rig)
        if rigs:
            assert {one.kiriko.role for one in other.objects} == {
                "NONE", "PLATE", "PICTURE", "DISPLAY", "GLASS"
            }  # fmt: skip
            look(kiriko)
            assert bpy.ops.kiriko.solve() == {"FINISHED"}
    thing.select_set(False)
    bpy.context.view_layer.objects.active = None
    copy = scene.objects["Cube.001"]
    assert copy.kiriko.role == "NONE"
    bpy.data.meshes.remove(copy.data)
    assert differences(before, snapshot()) == []


def test_a_ball_within_the_collection_is_duplicated_with_it(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Glass in the collection has its own copy in the other."""
    bpy.ops.kiriko.add_rig(
        viewer_resolution=32, display_resolution=(32, 32), picture_size=0.02, display_size=0.05
    )
    first = scene.collection.children[-1]
    copy = duplicate(first)
    look(kiriko)
    choose(copy)
    assert roles(kiriko)["glasses"] == ["Kiriko Ball.001"]
    choose(first)
    assert roles(kiriko)["glasses"] == ["Kiriko Ball"]


def press(entries: list, label: str) -> None:
    """Press the one button of the checklist with this label."""
    (button,) = (b for entry in entries for b in entry.buttons if str(b.label) == label)
    verb = getattr(bpy.ops.kiriko, button.operator.split(".")[1])
    assert verb(**dict(button.properties)) == {"FINISHED"}


@pytest.mark.parametrize("is_own_glass", [False, True])
def test_parts_that_were_duplicated_become_a_rig(
    kiriko: ModuleType, scene: bpy.types.Scene, is_own_glass: bool
) -> None:
    """Shift D of all parts puts copies into the same rig, twice: the checklist's button makes those
    that are selected a rig, and then the others, with glass of their own; all solve as the first.
    """
    to_do = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    if is_own_glass:
        first = add(cube())
    else:
        bpy.ops.kiriko.add_rig(**SMALL)
        first = scene.collection.children[-1]
    scene.kiriko.tolerance = 0.3
    bpy.ops.kiriko.solve()
    source = pixels(scene.kiriko.result.source)
    before = roles(kiriko)
    originals = list(scene.objects)
    sets = [duplicated(originals), duplicated(originals)]

    label = "Duplicate Rig"
    for copies in reversed(sets):
        choose(first)
        with pytest.raises(RuntimeError, match=r"\d (pictures|objects have the role Picture)"):
            bpy.ops.kiriko.solve()
        press(to_do.look_now(bpy.context), label)
        look(kiriko)
        assert scene.kiriko != first.kiriko
        assert scene.kiriko.tolerance == pytest.approx(0.3)
        mine = roles(kiriko)
        assert {name for names in mine.values() for name in names} == {one.name for one in copies}
        bpy.ops.kiriko.solve()
        assert np.array_equal(pixels(scene.kiriko.result.source), source)

    choose(first)
    assert roles(kiriko) == before
    assert not any(label in str(b.label) for e in to_do.look_now(bpy.context) for b in e.buttons)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert not bpy.ops.kiriko.part_copies.poll()


def moved(things: list[bpy.types.Object], along: float) -> list[bpy.types.Object]:
    """Objects that are moved as one, as by G after Shift D."""
    for thing in things:
        if thing.parent is None:
            thing.location.x += along
    bpy.context.view_layer.update()
    return things


@pytest.mark.parametrize("along", [0.0, 0.3])
def test_copies_of_the_artists_own_things_go_with_those_of_parts(
    kiriko: ModuleType, scene: bpy.types.Scene, along: float
) -> None:
    """A mirror and an empty in the rig's collection, a mirror and a viewer in no rig's; a second
    mirror of the first rig stays there, and so does the copy of a camera that no rig uses.
    """
    rig = add(cube())
    mirror, second, shared = (new_object(primitive("cube", size=0.01), "MIRROR") for _ in range(3))
    mirror.name, second.name, shared.name = "Mirror", "Mirror.001", "Wall"
    camera = new_object(bpy.data.cameras.new("Own"))
    camera.name, empty = "Own", new_object(None)
    for k, thing in enumerate((mirror, second, shared, camera, empty)):
        thing.location = (1.0 + k, 2.0, 3.0)
    for thing in (mirror, second, empty):
        scene.collection.objects.unlink(thing)
        rig.objects.link(thing)
    camera.matrix_world = scene.kiriko.viewer.matrix_world.copy()
    scene.kiriko.viewer = camera
    bpy.context.view_layer.update()
    other = new_object(bpy.data.cameras.new("Other"))
    other.name = "Other"
    before = set(scene.objects)

    copies = moved(duplicated([one for one in before if one != second]), along)
    copies = [one for one in copies if not one.name.startswith("Other")]
    for thing in copies:  # a little more by themselves
        if along and thing.kiriko.role in {"DISPLAY", "PLATE"}:
            thing.location.z -= 0.001 * len(thing.kiriko.role)
    assert bpy.ops.kiriko.part_copies() == {"FINISHED"}
    look(kiriko)
    new = scene.kiriko_scene.rig
    assert set(new.objects) == set(copies)
    assert set(rig.objects) <= before
    assert scene.kiriko.viewer in copies
    assert scene.kiriko.viewer.name.startswith("Own")
    choose(rig)
    assert scene.kiriko.viewer == camera


def test_parts_of_two_sets_are_not_mixed(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """The first set lacks viewer and plate, whose numbers the second one gets: that is selected,
    and becomes a rig as such; then the first one does.
    """
    rig = add(cube())
    scene.view_layers[0].update()
    things = list(scene.objects)
    is_lacked = lambda one: one.type == "CAMERA" or one.kiriko.role == "PLATE"  # noqa: E731
    sets = [
        moved(duplicated([one for one in things if not is_lacked(one)]), 0.3),
        moved(duplicated(things), -0.2),
    ]
    for copies in reversed(sets):
        choose(rig)
        assert bpy.ops.kiriko.part_copies() == {"FINISHED"}
        new = scene.kiriko_scene.rig
        assert set(new.objects) == set(copies)
    choose(rig)
    assert set(rig.objects) <= set(things)


def test_sets_in_one_place_are_told_by_the_selection(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Where nothing tells which of them belong together, it is said, and nothing is done."""
    rig = add(cube())
    things = list(scene.objects)
    few = duplicated([one for one in things if one.type != "CAMERA"])
    duplicated(things)
    bpy.ops.object.select_all(action="DESELECT")
    held = set(rig.objects)
    with pytest.raises(RuntimeError, match="Select only the copies of 'Cube', 'Kiriko Display'"):
        bpy.ops.kiriko.part_copies()
    assert set(rig.objects) == held
    assert len(scene.collection.children) == 1
    for thing in few:
        thing.select_set(True)
    assert bpy.ops.kiriko.part_copies() == {"FINISHED"}
    new = scene.kiriko_scene.rig
    assert set(new.objects) == set(few)


def test_a_copy_of_glass_for_something_else_is_not_taken(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """It was copied alone, and stands elsewhere: nothing tells that it is the new rig's glass, and
    the selection says that it is not. It is glass of both rigs then, as that around which they are.
    """
    rig = add(cube())
    moved(duplicated([scene.objects["Cube"]]), 0.7)
    copies = moved(duplicated([x for x in rig.objects if x.kiriko.role != "GLASS"]), 0.02)
    bpy.ops.object.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match="Select only the copies of 'Cube', 'Kiriko Display'"):
        bpy.ops.kiriko.part_copies()
    for thing in copies:
        thing.select_set(True)
    assert bpy.ops.kiriko.part_copies() == {"FINISHED"}
    look(kiriko)
    assert roles(kiriko)["glasses"] == ["Cube", "Cube.001"]
    new = scene.kiriko_scene.rig
    assert {thing for thing in new.objects if thing.kiriko.role != "GLASS"} == set(copies)


def test_copies_stay_in_each_scene_that_has_the_rig(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """The new rig is wherever the first one is, and has its settings there."""
    rig = add(cube())
    other = bpy.data.scenes.new("Other")
    group = bpy.data.collections.new("Bench")
    other.collection.children.link(group)
    group.children.link(rig)
    scene.kiriko.tolerance = 0.3
    copies = duplicated(list(rig.objects))
    assert set(copies) <= set(other.objects)
    assert bpy.ops.kiriko.part_copies() == {"FINISHED"}
    new = scene.kiriko_scene.rig
    assert set(copies) <= set(other.objects)
    assert set(group.children) == {rig, new}

    assert new.kiriko.tolerance == pytest.approx(0.3)
    assert new.kiriko.viewer in copies


def test_a_copy_of_the_glass_alone_makes_no_rig(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """The menu's verb is grey until display and picture have copies, too."""
    rig = add(cube())
    duplicated([scene.objects["Cube"]])
    assert not bpy.ops.kiriko.part_copies.poll()
    duplicated(list(rig.objects))
    assert bpy.ops.kiriko.part_copies.poll()


def duplicated(things: list[bpy.types.Object]) -> list[bpy.types.Object]:
    """Copies of objects, as by Shift D."""
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing in things)
    bpy.ops.object.duplicate()
    return list(bpy.context.selected_objects)


def test_a_full_copy_of_a_scene_has_images_of_its_own(scene: bpy.types.Scene) -> None:
    """Solved there, the first scene's result and display are as they were."""
    rig = add(cube())
    bpy.ops.kiriko.solve()
    source = scene.kiriko.result.source
    before = pixels(source)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    display = next(thing for thing in copy.objects if thing.kiriko.role == "DISPLAY")
    bpy.data.objects["Cube"].kiriko.ior = copy.objects["Cube.001"].kiriko.ior = 1.6
    copy.objects["Cube.001"].kiriko.use_ior = True
    bpy.ops.kiriko.solve()

    own = copy.kiriko.result.source
    assert own != source
    assert scene.kiriko.result.source == source
    assert np.array_equal(pixels(source), before)
    assert not np.array_equal(pixels(own), before)
    first = next(thing for thing in rig.objects if thing.kiriko.role == "DISPLAY")
    for thing, image in ((first, source), (display, own)):
        nodes = thing.active_material.node_tree.nodes
        assert [node.image for node in nodes if node.type == "TEX_IMAGE"] == [image]
    bpy.ops.kiriko.solve()
    assert len([one for one in bpy.data.images if "Source" in one.name]) == 2


def test_live_in_a_full_copy_writes_its_own_image(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Which takes pixels in place otherwise."""
    add(cube())
    bpy.ops.kiriko.solve()
    before = pixels(scene.kiriko.result.source)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    live = kiriko.operators.live
    live.start(copy)
    try:
        copy.objects["Cube.001"].kiriko.use_ior, copy.objects["Cube.001"].kiriko.ior = True, 1.6
        while live.tick() != live.live_follower.IDLE:
            pass
    finally:
        live.stop()
    assert np.array_equal(pixels(scene.kiriko.result.source), before)
    assert not np.array_equal(pixels(copy.kiriko.result.source), before)


def saved(scene: bpy.types.Scene, path: Path) -> None:
    """A file with a rig whose glass lies in its collection, with settings."""
    glass = cube()
    add(glass)
    scene.collection.objects.unlink(glass)
    scene.kiriko.tolerance, scene.kiriko.margin, scene.kiriko.ghosts = 0.3, 7, "STRONGEST"
    scene.kiriko.picture.gamma = 1.5
    bpy.ops.kiriko.solve()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def bring(path: Path, is_link: bool) -> bpy.types.Collection:
    """Append or link the rig's collection, as the file browser does."""
    with bpy.data.libraries.load(str(path), link=is_link) as (_, wanted):
        wanted.collections = ["Kiriko Rig"]
    (rig,) = wanted.collections
    bpy.context.scene.collection.children.link(rig)
    return rig


@pytest.mark.parametrize("has_another", [False, True])
@pytest.mark.parametrize("is_link", [False, True])
def test_a_rig_from_another_file_brings_viewer_and_settings(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path, is_link: bool, has_another: bool
) -> None:
    """Beside another rig, or alone. A linked display keeps its material, and the notes say so."""
    saved(scene, tmp_path / "rig.blend")
    scene = bpy.context.scene
    if has_another:
        other = add(gem())
    scene.kiriko.tolerance = 0.05
    rig = bring(tmp_path / "rig.blend", is_link)
    bpy.context.view_layer.update()
    look(kiriko)
    assert scene.kiriko.tolerance == pytest.approx(0.05 if has_another else 0.3)
    choose(rig)
    ours = scene.kiriko
    assert ours.viewer in set(rig.objects)
    assert (ours.tolerance, ours.margin, ours.ghosts) == (pytest.approx(0.3), 7, "STRONGEST")
    assert ours.picture.gamma == pytest.approx(1.5)
    assert roles(kiriko)["glasses"] == ["Cube"]
    assert pixels(ours.result.source).any()
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    if is_link:
        assert "is linked from another file. Give it the image" in ours.result.notes
        bpy.context.view_layer.objects.active = None
        with pytest.raises(RuntimeError, match="'Kiriko Rig' is linked from another file"):
            bpy.ops.kiriko.remove_rig()
        return
    bpy.context.view_layer.objects.active = None
    bpy.ops.kiriko.remove_rig()
    assert rig not in list(scene.collection.children)
    if has_another:
        assert list(scene.collection.children) == [other]
    assert scene.kiriko.tolerance == pytest.approx(0.05)


def test_an_overridden_rig_keeps_settings_and_result(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path
) -> None:
    """In this file, by Blender's own override; also those that its library has never set."""
    saved(scene, tmp_path / "rig.blend")
    scene = bpy.context.scene
    linked = bring(tmp_path / "rig.blend", is_link=True)
    linked.override_hierarchy_create(scene, bpy.context.view_layer)
    scene.collection.children.unlink(linked)
    assert (scene.kiriko.tolerance, scene.kiriko.margin) == (pytest.approx(0.3), 7)
    scene.kiriko.tolerance, scene.kiriko.calibration.offset = 0.2, "far"
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    before = pixels(scene.kiriko.result.source)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "here.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "here.blend"))
    ours = bpy.context.scene.kiriko
    assert ours.id_data.override_library
    assert (ours.tolerance, ours.calibration.offset) == (pytest.approx(0.2), "far")
    assert ours.viewer in set(ours.id_data.objects)
    assert np.array_equal(pixels(ours.result.source), before)


def test_a_linked_instance_of_a_rig_has_its_own_viewer(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path
) -> None:
    """Link makes an instance of the collection: the rig's camera counts, wherever the instance
    stands, not the one that the scene happens to have.
    """
    saved(scene, tmp_path / "rig.blend")
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_, wanted):
        wanted.collections = ["Kiriko Rig"]
    thing = bpy.data.objects.new("instance", None)
    thing.instance_type, thing.instance_collection = "COLLECTION", wanted.collections[0]
    scene.collection.objects.link(thing)
    for turn in (0.0, 0.7):
        thing.location, thing.rotation_euler = (turn, 2 * turn, 3 * turn), (turn, 0.1, turn)
        bpy.context.view_layer.update()
        assert bpy.ops.kiriko.solve() == {"FINISHED"}
        assert scene.kiriko.result.summary == "The display shows 100 % of the picture."


def test_a_rig_that_is_appended_twice_is_two(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path
) -> None:
    """Each with its own viewer, and solved beside the other."""
    saved(scene, tmp_path / "rig.blend")
    first = bring(tmp_path / "rig.blend", is_link=False)
    second = bring(tmp_path / "rig.blend", is_link=False)
    bpy.context.view_layer.update()
    look(kiriko)
    for rig, glass in ((first, "Cube"), (second, "Cube.001")):
        choose(rig)
        assert bpy.context.scene.kiriko.viewer in set(rig.objects)
        assert roles(kiriko)["glasses"] == [glass]


def test_a_renamed_object_is_no_other(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """A rig that was chosen by hand stays; another object of the old name is another. Also after
    the file was opened again, where objects have other numbers.
    """
    first, second = two()
    gem_ = scene.objects["Gem"]
    bpy.context.view_layer.objects.active = gem_
    look(kiriko)
    choose(first)
    gem_.name = "Diamond"
    look(kiriko)
    assert scene.kiriko == first.kiriko
    scene.objects["Cube"].name = "Gem"
    bpy.context.view_layer.objects.active = scene.objects["Gem"]
    look(kiriko)
    bpy.context.view_layer.objects.active = gem_
    look(kiriko)
    assert scene.kiriko == second.kiriko
    choose(first)
    gem_.name = "Ruby"
    look(kiriko)


def test_a_scene_of_another_file_is_left_alone(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path
) -> None:
    """Each button that would change it is grey, and says why."""
    saved(scene, tmp_path / "rig.blend")
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_, wanted):
        wanted.scenes = ["Scene"]
    (linked,) = wanted.scenes
    with bpy.context.temp_override(scene=linked, view_layer=linked.view_layers[0]):
        look(kiriko)
        for verb in ("remove_rig", "solve", "add_rig", "preview", "report", "live", "fit_plate",
                     "choose_rig", "visible_range", "simulate", "rescale_scene"):  # fmt: skip
            with pytest.raises(RuntimeError, match="The scene is linked: open"):
                getattr(bpy.ops.kiriko, verb)()
        assert bpy.ops.kiriko.export.poll()


def test_results_have_the_number_of_their_rig(scene: bpy.types.Scene) -> None:
    """Whichever is solved first; or its name, where the artist gave it one."""
    rigs = first, second = two()
    for rig, number in ((second, ".001"), (first, "")):
        choose(rig)
        bpy.ops.kiriko.solve()
        bpy.ops.kiriko.visible_range(share=0.01)
        assert scene.kiriko.result.source.name == f"Kiriko Source{number}"
        assert f"Kiriko Visible Range{number}" in rig.objects
    first.name = "Goblet"
    for rig in rigs:
        choose(rig)
        bpy.ops.kiriko.solve()
    assert {rig.kiriko.result.source.name for rig in rigs} == {
        "Kiriko Source Goblet", "Kiriko Source.001"
    }  # fmt: skip


def test_what_was_hidden_for_a_rig_is_shown_once_that_is_deleted(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Looked through, and deleted by hand meanwhile."""
    first, second = two()
    choose(first)
    bpy.ops.kiriko.look_through()
    others = [thing for thing in second.objects if thing.type != "CAMERA"]
    assert all(thing.hide_viewport for thing in others)
    engine = scene.render.engine
    for thing in list(first.objects):
        bpy.data.objects.remove(thing)
    bpy.data.collections.remove(first)
    look(kiriko)
    assert not any(thing.hide_viewport for thing in others)
    assert not scene.kiriko_scene.looking
    assert scene.render.engine != engine
    assert scene.kiriko == second.kiriko


def test_undo_reads_only_images_that_it_changed(
    kiriko: ModuleType, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Solved anew, and taken back: that rig's image is read anew, the other's is not."""
    image = importlib.import_module(f"{kiriko.__name__}.core.blender.data.image")
    made = importlib.import_module(f"{kiriko.__name__}.core.blender.result.result_images")
    first, second = two()
    for rig in (first, second):
        choose(rig)
        bpy.ops.kiriko.solve()
    bpy.ops.ed.undo_push(message="Solved")
    before = pixels(bpy.context.scene.kiriko.result.source)
    live = kiriko.operators.live
    live.start(bpy.context.scene)
    bpy.context.scene.objects["Gem"].kiriko.ior = 1.5
    while live.tick() != live.live_follower.IDLE:
        pass
    live.stop()
    bpy.ops.ed.undo_push(message="Live")
    assert not np.array_equal(pixels(bpy.context.scene.kiriko.result.source), before)

    read = []
    monkeypatch.setattr(
        made, "read_again", lambda one: read.append((one.name, image.read_again(one)))
    )
    for step, is_undo in ((bpy.ops.ed.undo, True), (bpy.ops.ed.redo, False)):
        read.clear()
        step()
        assert dict(read) == {"Kiriko Source": False, "Kiriko Source.001": True}
        now = pixels(bpy.context.scene.kiriko.result.source)
        assert np.array_equal(now, before) == is_undo
    bpy.context.scene.kiriko.margin = 3
    bpy.ops.ed.undo_push(message="Margin")
    read.clear()
    bpy.ops.ed.undo()
    assert dict(read) == {"Kiriko Source": False, "Kiriko Source.001": False}
