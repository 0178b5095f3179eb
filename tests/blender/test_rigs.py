"""Several rigs in a scene: each has its own parts, settings, result and image."""

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from panel_layout import Layout
from small_rigs import cube, new_object, pixels, primitive, show_scene
from test_remove_rig import differences, snapshot

SMALL = {
    "viewer_resolution": 32,
    "display_resolution": (32, 32),
    "field": 0.04,
    "picture_size": 0.03,
    "plate_size": 0.3,
}


def add(glass: bpy.types.Object) -> bpy.types.Collection:
    """A rig around a glass, which is selected and active."""
    for thing in bpy.context.selected_objects:
        thing.select_set(False)
    glass.select_set(True)
    bpy.context.view_layer.objects.active = glass
    bpy.ops.kiriko.add_rig(**SMALL)
    return bpy.context.scene.collection.children[-1]


def gem() -> bpy.types.Object:
    """A lump of another glass, beside the first."""
    thing = bpy.data.objects.new("Gem", primitive("icosphere", subdivisions=1, radius=0.03))
    thing.location.x = 0.12
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.use_ior, thing.kiriko.ior = True, 1.7
    return thing


def two() -> tuple[bpy.types.Collection, bpy.types.Collection]:
    """A cube and a gem, each with a rig."""
    return add(cube()), add(gem())


def choose(rig: bpy.types.Collection) -> None:
    assert bpy.ops.kiriko.choose_rig(rig=rig.name) == {"FINISHED"}


def state(scene: bpy.types.Scene) -> dict[str, Any]:
    """The settings and the result that the panel shows."""
    ours = scene.kiriko
    result = ours.result
    names = ("tolerance", "margin", "picture_source", "viewer", "export_path")
    return {
        **{name: getattr(ours, name) for name in names},
        **{name: getattr(result, name) for name in ("source", "summary", "solved_for", "notes")},
        "offset": ours.calibration.offset,
    }


def test_each_rig_keeps_its_settings_and_its_result(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Solved in turn, each as alone in its scene, with its own image on its own display."""
    kiriko.operators.work.forget()  # glass of tests before, moved, would be right to rounding alone
    first = add(cube())
    bpy.ops.kiriko.solve()
    alone = pixels(scene.kiriko.result.source)
    before = state(scene)

    second = add(gem())
    assert [first.name, second.name] == ["Kiriko Rig", "Kiriko Rig.001"]
    assert scene.kiriko.result.source is None
    scene.kiriko.tolerance, scene.kiriko.calibration.offset = 0.3, "[]"
    bpy.ops.kiriko.solve()
    after = state(scene)
    assert after["source"] != before["source"]

    choose(first)
    assert state(scene) == before
    bpy.ops.kiriko.solve()
    assert np.array_equal(pixels(scene.kiriko.result.source), alone)
    choose(second)
    assert state(scene) == after
    for rig, source in ((first, "Kiriko Source"), (second, "Kiriko Source.001")):
        display = next(thing for thing in rig.objects if thing.kiriko.role == "DISPLAY")
        nodes = display.active_material.node_tree.nodes
        assert source in [node.image.name for node in nodes if node.type == "TEX_IMAGE"]


def test_a_result_is_stale_only_where_its_own_rig_has_changed(
    kiriko: ModuleType, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gem is moved: the cube's result is still of the scene as it is."""
    watch = importlib.import_module(f"{kiriko.__name__}.operators.watch")
    for name in ("QUIET", "SHARE"):
        monkeypatch.setattr(watch, name, 0.0)
    monkeypatch.setattr(watch.chosen, "POLLING", 0.0)
    first, second = two()
    for rig in (first, second):
        choose(rig)
        bpy.ops.kiriko.solve()
    scene.objects["Gem"].location.x += 0.01

    assert watch.has_changed(bpy.context)
    watch.check_result()
    assert watch.is_reported_changed(scene)
    choose(first)
    assert not watch.has_changed(bpy.context)
    watch.check_result()
    assert not watch.is_reported_changed(scene)
    choose(second)
    assert watch.is_reported_changed(scene)  # at once, without another look
    choose(first)
    scene.objects["Cube"].rotation_euler.z = 0.1
    assert watch.has_changed(bpy.context)


@pytest.mark.parametrize("is_solved", [False, True])
def test_a_removed_rig_leaves_the_other_as_it_was(scene: bpy.types.Scene, is_solved: bool) -> None:
    """All properties of all datablocks, with all results of both."""
    cube()
    gem()
    first = add(scene.objects["Cube"])
    scene.kiriko.tolerance = 0.2
    bpy.ops.kiriko.solve()
    scene.objects["Cube"].select_set(False)
    before = snapshot()

    second = add(scene.objects["Gem"])
    scene.kiriko.margin = 3
    if is_solved:
        for rig in (second, first, second):
            choose(rig)
            bpy.ops.kiriko.solve()
        bpy.ops.kiriko.preview(samples=1)
        bpy.ops.kiriko.visible_range(share=0.01)
    scene.objects["Gem"].select_set(False)
    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
    if is_solved:  # of the cube, which was solved again meanwhile
        passing = ("Source", "Scene", "collections")
        before = {k: v for k, v in before.items() if not any(word in k for word in passing)}
        assert [d for d in differences(before, snapshot()) if d.split("/")[1] in before] == []
        assert (scene.kiriko.tolerance, scene.kiriko.margin) == (pytest.approx(0.2), 0)
    else:
        scene.kiriko_scene.rig = first  # which is the active one anyway
        assert differences(before, snapshot()) == []
    assert scene.kiriko == first.kiriko


@pytest.mark.parametrize("order", [("Cube", "Gem"), ("Gem", "Cube")])
def test_without_both_the_scene_is_as_it_was(
    scene: bpy.types.Scene, order: tuple[str, str]
) -> None:
    """In whichever order they go; glass of both in one material, and results of both."""
    glass = bpy.data.materials.new("Glass")
    for thing in (cube(), gem()):
        thing.data.materials.append(glass)
        thing.select_set(False)
    scene.kiriko.tolerance = 0.2
    before = snapshot()
    for name in ("Cube", "Gem"):
        add(scene.objects[name])
        bpy.ops.kiriko.solve()

    for name, other in (order, order[::-1]):
        is_last = len(scene.collection.children) == 1
        bpy.context.view_layer.objects.active = scene.objects[name]
        assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
        assert is_last or bpy.ops.kiriko.solve() == {"FINISHED"}
        assert is_last or scene.objects[other].kiriko.role == "GLASS"
        scene.objects[name].select_set(False)
    bpy.context.view_layer.objects.active = None
    assert differences(before, snapshot()) == []


def test_a_material_of_both_is_put_back_with_the_last(scene: bpy.types.Scene) -> None:
    """It lets see through as long as there is a rig whose glass has it."""
    glass = bpy.data.materials.new("Glass")
    first, other = cube(), gem()
    first.data.materials.append(glass)
    add(first)
    alpha = glass.diffuse_color[3]
    assert alpha < 1
    other.data.materials.append(glass)
    add(other)
    for thing, after in ((first, alpha), (other, 1)):
        bpy.context.view_layer.objects.active = thing
        bpy.ops.kiriko.remove_rig()
        assert glass.diffuse_color[3] == after


def test_a_saved_file_has_both(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Settings, results and images, and which one was active."""
    first, _ = two()
    scene.kiriko.tolerance = 0.3
    bpy.ops.kiriko.solve()
    choose(first)
    bpy.ops.kiriko.solve()
    summary = scene.kiriko.result.summary
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "two.blend"))

    scene = bpy.context.scene
    assert scene.kiriko.result.summary == summary
    assert scene.kiriko.result.source.name == "Kiriko Source"
    assert scene.kiriko.viewer.name == "Kiriko Viewer"
    choose(bpy.data.collections["Kiriko Rig.001"])
    assert scene.kiriko.tolerance == pytest.approx(0.3)
    assert scene.kiriko.result.source.name == "Kiriko Source.001"
    assert pixels(scene.kiriko.result.source).any()
    assert scene.kiriko.viewer.name == "Kiriko Viewer.001"


def test_undo_never_mixes_rigs(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """Whatever is selected, changed and undone, a setting is that of its own rig. The selection
    is followed between undo steps, as the timer does it.
    """
    look = importlib.import_module(f"{kiriko.__name__}.operators.choose_rig").follow_selection

    def select(name: str) -> None:
        bpy.context.view_layer.objects.active = bpy.context.scene.objects[name]
        bpy.ops.ed.undo_push(message="Select")
        look()

    def change(value: float) -> None:
        bpy.context.scene.kiriko.tolerance = value
        bpy.ops.ed.undo_push(message="Tolerance")

    def tolerances() -> dict[str, float]:
        return {rig.name: round(rig.kiriko.tolerance, 5) for rig in bpy.data.collections}

    two()
    look()
    bpy.ops.ed.undo_push(message="Two")
    states = [tolerances()]
    for name, value in (("Cube", 0.2), ("Gem", 0.3), ("Cube", 0.4), ("Gem", 0.5)):
        select(name)
        states.append(tolerances())
        change(value)
        states.append(tolerances())
    assert states[-1] == {"Kiriko Rig": 0.4, "Kiriko Rig.001": 0.5}

    for before in reversed(states[:-1]):
        bpy.ops.ed.undo()
        look()
        assert tolerances() == before
    for after in states[1:]:
        bpy.ops.ed.redo()
        look()
        assert tolerances() == after


def test_the_rig_of_the_active_object_is_followed(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """One that is chosen stays until something else is selected; what is in no rig changes
    nothing, nor makes the file one that has changed.
    """
    module = importlib.import_module(f"{kiriko.__name__}.operators.choose_rig")
    first, second = two()
    mine = bpy.data.objects.new("Mine", None)
    scene.collection.objects.link(mine)

    def looked(thing: bpy.types.Object) -> bpy.types.Collection | None:
        bpy.context.view_layer.objects.active = thing
        return module.follow(scene, thing)

    assert looked(scene.objects["Gem"]) is None
    for thing in (*first.objects, scene.objects["Cube"]):
        assert looked(thing) == first
    choose(first)
    assert looked(scene.objects["Cube"]) is None
    choose(second)
    assert looked(scene.objects["Cube"]) is None
    assert looked(mine) is None
    assert looked(scene.objects["Cube"]) == first
    assert module.follow(scene, None) is None


def test_a_deleted_collection_takes_its_settings(scene: bpy.types.Scene) -> None:
    """Deleted by hand with all it has, the other one is active, with its own settings; then the
    scene without any.
    """
    scene.kiriko.tolerance = 0.2
    first, second = two()
    assert scene.kiriko.tolerance == pytest.approx(0.1)
    choose(first)
    scene.kiriko.tolerance = 0.3
    bpy.data.batch_remove([*first.objects, first])
    assert scene.kiriko == second.kiriko
    assert scene.kiriko.tolerance == pytest.approx(0.1)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    bpy.ops.kiriko.remove_rig()
    assert scene.kiriko.tolerance == pytest.approx(0.2)


def test_a_copied_scene_has_rigs_of_its_own(scene: bpy.types.Scene) -> None:
    """As New Scene > Full Copy makes it: what is set in one stays there."""
    first, _ = two()
    scene.name = "Scene"
    scene.kiriko.tolerance = 0.3
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    assert copy != scene
    assert copy.kiriko.tolerance == pytest.approx(0.3)
    assert copy.kiriko.viewer in set(copy.objects)
    copied = copy.collection.children[0]
    choose(copied)
    assert copy.kiriko.viewer in set(copied.objects)
    copy.kiriko.tolerance = 0.7
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    show_scene(scene)
    assert scene.kiriko.result.source is None
    assert scene.kiriko.tolerance == pytest.approx(0.3)
    choose(first)
    assert scene.kiriko.tolerance == pytest.approx(0.1)


def test_parts_in_no_rig_are_in_all(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """A mirror that stands there; one that is moved into a rig's collection is in that alone."""
    read = importlib.import_module(f"{kiriko.__name__}.core.blender.read.scene").read
    first, second = two()
    mirror = new_object(primitive("grid", size=0.02), "MIRROR")
    mirror.name = "Mirror"
    mirror.location = (0, 0, 5)
    for rig in (first, second):
        choose(rig)
        assert "Mirror" in [part.name for part in read(bpy.context).rig.mirrors]
    scene.collection.objects.unlink(mirror)
    first.objects.link(mirror)
    assert not read(bpy.context).rig.mirrors


def test_another_rigs_parts_are_not_in_the_preview(scene: bpy.types.Scene) -> None:
    """The gem's plate is put before the cube's viewer: Cycles sees what it saw without it."""
    add(cube())
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.preview(samples=4)
    alone = pixels(scene.kiriko.result.preview)
    second = add(gem())
    plate = next(thing for thing in second.objects if thing.kiriko.role == "PLATE")
    viewer = scene.objects["Kiriko Viewer"]
    plate.matrix_world = viewer.matrix_world @ Matrix.Translation((0, 0, -0.1))
    choose(bpy.data.collections["Kiriko Rig"])
    bpy.ops.kiriko.preview(samples=4)
    assert np.array_equal(pixels(scene.kiriko.result.preview), alone)


def test_glass_of_a_rig_gets_no_second_one(scene: bpy.types.Scene) -> None:
    """By a second press, say; nothing is changed."""
    add(cube())
    before = snapshot()
    with pytest.raises(RuntimeError, match="'Cube' is already in the rig 'Kiriko Rig'"):
        add(scene.objects["Cube"])
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("role", ["GLASS", "NONE"])
@pytest.mark.parametrize("fails", [False, True])
def test_a_copy_of_a_rigs_glass_gets_a_rig_of_its_own(
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
    role: str,
    fails: bool,
) -> None:
    """The first rig, whose marks the copy had, is as it was: with it, and after it is removed."""
    read = importlib.import_module(f"{kiriko.__name__}.core.blender.read.scene").read
    has_changed = importlib.import_module(f"{kiriko.__name__}.operators.watch").has_changed
    first = add(cube())
    bpy.ops.kiriko.solve()
    copy = scene.objects["Cube"].copy()
    scene.collection.objects.link(copy)
    copy.location.x, copy.kiriko.role = 0.2, role
    if fails:
        module = importlib.import_module(f"{kiriko.__name__}.core.blender.lifecycle.new_rig")
        monkeypatch.setattr(module, "_make_viewer", None)
        scene.objects["Cube"].select_set(False)
        before = snapshot()
        with pytest.raises(RuntimeError):
            add(copy)
        copy.select_set(False)
        assert differences(before, snapshot()) == []
        return

    second = add(copy)
    assert [part.name for part in read(bpy.context).rig.glasses] == ["Cube.001"]
    for is_there in (True, False):
        choose(first)
        assert [part.name for part in read(bpy.context).rig.glasses] == ["Cube"]
        assert not has_changed(bpy.context)
        if is_there:
            choose(second)
            bpy.ops.kiriko.remove_rig()
    ours = copy.kiriko
    assert (ours.role, ours.taken_as, ours.is_made_glass) == ("NONE", "", False)


def test_a_part_in_no_rig_is_told_before_a_second_one(scene: bpy.types.Scene) -> None:
    """Each rig would have it: a display beside its own."""
    add(cube())
    new_object(primitive("grid", size=0.02), "DISPLAY").name = "Mine"
    before = snapshot()
    with pytest.raises(RuntimeError, match="'Mine'\\): move it into its rig's collection first"):
        add(gem())
    before = {k: v for k, v in before.items() if "Scene" not in k}
    assert len(bpy.data.collections) == 1


def test_an_unknown_rig_is_refused_with_those_that_are_there(scene: bpy.types.Scene) -> None:
    two()
    words = "no rig 'Other', only 'Kiriko Rig', 'Kiriko Rig.001'"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.choose_rig(rig="Other")


def test_thousands_of_objects_beside_two_rigs_do_not_hold_up_panels(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Whose parts they are is asked of those alone that have a role."""
    needed = importlib.import_module(f"{kiriko.__name__}.operators.needed")
    rigs = importlib.import_module(f"{kiriko.__name__}.core.blender.data.rigs")
    two()
    for n in range(2000):
        scene.collection.objects.link(bpy.data.objects.new(f"thing {n}", None))
    asked = []
    is_elsewhere = rigs.elsewhere(scene)
    needed.parts(scene, lambda thing: (asked.append(thing), is_elsewhere(thing))[1])
    assert len(asked) == 8


def test_a_failed_rig_leaves_the_other_active(
    scene: bpy.types.Scene, kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is another than before, however late it fails."""
    add(cube())
    bpy.ops.kiriko.solve()
    thing = gem()
    before = snapshot()
    module = importlib.import_module(f"{kiriko.__name__}.core.blender.lifecycle.new_rig")

    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(module, "_make_viewer", fail)
    with pytest.raises(RuntimeError):
        add(thing)
    thing.select_set(False)
    assert differences(before, snapshot()) == []


def test_the_panel_names_the_rig_and_offers_others(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """One alone is named; of two one is chosen by a menu."""
    add(cube())
    assert "VIEW3D_MT_kiriko_rigs" not in str(drawn("main_panel", "VIEW3D_PT_kiriko_main").__dict__)
    add(gem())
    drawn("main_panel", "VIEW3D_PT_kiriko_main")
    menu = drawn("rig_panel", "VIEW3D_MT_kiriko_rigs")
    assert menu is not None


def test_live_goes_on_with_the_active_rig(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """Wherever in its work it is when another one is chosen, nothing of the first gets there."""
    live = kiriko.operators.live
    first, second = two()
    choose(first)
    bpy.ops.kiriko.solve()
    before = pixels(scene.kiriko.result.source)
    choose(second)
    live.start(scene)
    try:
        scene.kiriko.ghosts = "STRONGEST"
        for _ in range(3):
            live.tick()
        choose(first)
        assert np.array_equal(pixels(scene.kiriko.result.source), before)
        while live.tick() != live.live_follower.IDLE:
            pass
        assert np.abs(pixels(scene.kiriko.result.source) - before).max() < 1e-6
        choose(second)
        assert scene.kiriko.ghosts == "STRONGEST"
        while live.tick() != live.live_follower.IDLE:
            pass
        assert scene.kiriko.result.source.name == "Kiriko Source.001"
        assert "of the picture" in scene.kiriko.result.summary
    finally:
        live.stop()


def test_others_are_hidden_while_one_looks_through_the_viewer(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """And shown again; the rig that is looked through stays, until one is chosen by hand."""
    look = importlib.import_module(f"{kiriko.__name__}.operators.choose_rig").follow_selection
    first, second = two()
    others = [*second.objects, scene.objects["Gem"]]
    others = [thing for thing in others if thing.type != "CAMERA"]
    choose(first)
    before = snapshot()
    bpy.ops.kiriko.look_through()
    assert all(thing.hide_viewport for thing in others)
    assert not any(thing.hide_viewport for thing in first.objects)
    bpy.context.view_layer.objects.active = scene.objects["Gem"]
    look()
    assert scene.kiriko.viewer in set(first.objects)
    bpy.ops.kiriko.look_through()
    assert differences(before, snapshot()) == []

    bpy.ops.kiriko.look_through()
    choose(second)
    assert not scene.kiriko_scene.looking
    assert not any(thing.hide_viewport for thing in others)


def test_the_rig_that_is_looked_through_is_the_one_to_remove(scene: bpy.types.Scene) -> None:
    """The panel goes on showing it, whatever is selected meanwhile."""
    first, second = two()
    choose(first)
    bpy.ops.kiriko.look_through()
    bpy.context.view_layer.objects.active = scene.objects["Gem"]
    bpy.ops.kiriko.remove_rig()
    assert list(scene.collection.children) == [second]
    assert scene.objects["Gem"].kiriko.role == "GLASS"


def test_each_rig_has_its_own_visible_range(scene: bpy.types.Scene) -> None:
    """In its collection; removed with its button it leaves the other's."""
    first, second = two()
    for rig in (first, second):
        choose(rig)
        bpy.ops.kiriko.visible_range(share=0.01)
    choose(first)
    bpy.ops.kiriko.remove_visible_range()
    assert not bpy.ops.kiriko.remove_visible_range.poll()
    assert [thing.name for thing in second.objects if "Range" in thing.name] == [
        "Kiriko Visible Range.001"
    ]


def test_each_display_is_drawn_with_its_own_image(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Over the view, in which both rigs are seen, whichever is active."""
    module = importlib.import_module(f"{kiriko.__name__}.core.blender.view.shown_images")
    first, second = two()
    sources = {}
    for rig in (first, second):
        choose(rig)
        bpy.ops.kiriko.solve()
        sources[rig.name] = scene.kiriko.result.source
    for rig in (first, second):
        displays = [thing for thing in rig.objects if thing.kiriko.role == "DISPLAY"]
        (shown,) = module.shown_images(scene, bpy.context.view_layer, displays)
        assert shown.image == sources[rig.name]
