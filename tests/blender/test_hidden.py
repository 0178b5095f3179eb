"""One rule for all ways to hide: a thing not shown in the
viewport and in renders is no part of the rig.
"""

import importlib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType

import bpy
import pytest

from panel_layout import Layout
from small_rigs import cube, new_object, pixels, primitive, small_rig

ROLES = ("GLASS", "PLATE", "DISPLAY", "PICTURE")


def own_collection(thing: bpy.types.Object, name: str = "drawer") -> bpy.types.LayerCollection:
    """A new collection with this object only, and one
    around it, as the view layer has the inner one.
    """
    outer = bpy.data.collections.new("cupboard")
    inner = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(outer)
    outer.children.link(inner)
    for old in thing.users_collection:
        old.objects.unlink(thing)
    inner.objects.link(thing)
    return bpy.context.view_layer.layer_collection.children[outer.name].children[name]


def by_eye(thing: bpy.types.Object) -> None:
    bpy.context.view_layer.update()
    thing.hide_set(True)


def by_monitor(thing: bpy.types.Object) -> None:
    thing.hide_viewport = True


def by_camera(thing: bpy.types.Object) -> None:
    thing.hide_render = True


def by_eye_of_collection(thing: bpy.types.Object) -> None:
    own_collection(thing).hide_viewport = True


def by_monitor_of_collection(thing: bpy.types.Object) -> None:
    own_collection(thing).collection.hide_viewport = True


def by_camera_of_collection(thing: bpy.types.Object) -> None:
    own_collection(thing).collection.hide_render = True


def by_exclusion(thing: bpy.types.Object) -> None:
    own_collection(thing).exclude = True


def by_collection_around(thing: bpy.types.Object) -> None:
    own_collection(thing)
    bpy.data.collections["cupboard"].hide_render = True


WAYS = {
    by_eye: " in the viewport by its eye icon (H)",
    by_monitor: " in the viewport by its monitor icon",
    by_camera: " in renders by its camera icon",
    by_eye_of_collection: " with its collection 'drawer' in the viewport",
    by_monitor_of_collection: " with its collection 'drawer' in the viewport",
    by_camera_of_collection: " with its collection 'drawer' in renders",
    by_exclusion: " with its collection 'drawer' in the viewport",
    by_collection_around: " with its collection 'cupboard' in renders",
}
every_way = pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)


@every_way
@pytest.mark.parametrize("role", ROLES)
def test_a_part_the_rig_needs(
    drawn: Callable[..., Layout],
    scene: bpy.types.Scene,
    role: str,
    way: Callable[[bpy.types.Object], None],
) -> None:
    """Panel, buttons and error say how it is hidden, and to show it."""
    part = small_rig()[role]
    assert bpy.ops.kiriko.solve.poll()
    way(part)
    otherwise = ", or set its role to None" if role == "PLATE" else ""
    told = f"The {role.lower()} '{part.name}' is hidden{WAYS[way]}: show it{otherwise}."
    assert drawn("rig_panel", "VIEW3D_PT_kiriko_rig").icons[part.name] == "HIDE_ON"
    assert told in " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    assert not bpy.ops.kiriko.solve.poll()

    # nodes might instance it: then the button is not grey, and the error says the same
    new_object(primitive("cube", size=1e-3)).modifiers.new("nodes", "NODES")
    with pytest.raises(RuntimeError) as error:
        bpy.ops.kiriko.solve()

    assert told in str(error.value)


def test_parts_that_were_met_answer_as_all_objects_do(
    kiriko: ModuleType, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a rig lacks is that of all objects, whatever became of those that were parts before;
    while it lacks nothing only these are looked at.
    """
    needed = importlib.import_module(f"{kiriko.__name__}.operators.needed")
    parts = small_rig()
    plate, glass = parts["PLATE"], parts["GLASS"]
    other = new_object(glass.data)

    def lacks() -> dict[str, str]:
        bpy.context.view_layer.update()
        found = needed.missing_by_role(scene)
        assert found == needed.missing_of(scene, needed.parts(scene))
        return found

    def is_met() -> bool:
        with monkeypatch.context() as patch:
            patch.setattr(needed, "parts", lambda scene: pytest.fail("all objects"))
            return not needed.missing_by_role(scene)

    assert not lacks()
    assert is_met()
    glass.kiriko.role = "NONE"
    assert lacks().keys() == {"GLASS"}
    other.kiriko.role = "GLASS"
    assert not lacks()
    other.name = "renamed"
    assert not lacks()
    assert is_met()
    scene.collection.objects.unlink(other)
    assert lacks().keys() == {"GLASS"}
    bpy.data.objects.remove(other)
    assert lacks().keys() == {"GLASS"}
    glass.kiriko.role = "GLASS"
    assert not lacks()
    plate.hide_render = True
    assert lacks().keys() == {"PLATE"}
    plate.kiriko.role = "NONE"
    assert not lacks()
    new_object(plate.data, "PLATE").hide_viewport = True
    assert lacks().keys() == {"PLATE"}


def test_an_object_is_not_taken_for_one_of_its_name(
    kiriko: ModuleType, scene: bpy.types.Scene, linked: Callable[..., bpy.types.ID]
) -> None:
    """A linked object in a collection that is not rendered is hidden, though a local one of the
    same name is rendered.
    """
    visibility = importlib.import_module(f"{kiriko.__name__}.core.blender.data.visibility")
    local = new_object(primitive("cube", size=1e-3))
    theirs = linked(local)
    assert theirs.name == local.name
    scene.collection.objects.link(theirs)
    own_collection(theirs).collection.hide_render = True
    shown = visibility.VisibleObjects(scene, bpy.context.view_layer)
    assert not shown.hidden_by(local)
    assert shown.hidden_by(theirs) == " with its collection 'drawer' in renders"


@every_way
def test_a_part_it_can_do_without(
    drawn: Callable[..., Layout], scene: bpy.types.Scene, way: Callable[[bpy.types.Object], None]
) -> None:
    """The rig is solved without it, and a note says so and how it is hidden."""
    small_rig()
    bpy.ops.kiriko.solve()
    before = scene.kiriko.result.summary, scene.kiriko.result.notes
    other = new_object(primitive("cube", size=0.02), "GLASS")
    other.location = 0.03, 0, 0
    way(other)
    bpy.ops.kiriko.solve()
    note = f"'{other.name}' is hidden{WAYS[way]} and ignored."

    assert scene.kiriko.result.summary == before[0]
    assert scene.kiriko.result.notes.splitlines() == [note, *before[1].splitlines()]
    icons = drawn("rig_panel", "VIEW3D_PT_kiriko_rig").icons
    assert icons["Cube"] != "HIDE_ON"
    assert icons[other.name] == "HIDE_ON"


@every_way
def test_an_instance_of_a_collection(
    drawn: Callable[..., Layout], scene: bpy.types.Scene, way: Callable[[bpy.types.Object], None]
) -> None:
    """The object that makes instances hides them, and shows them again.

    Where their source is hidden in the scene they are shown. The list selects what makes them.
    """
    parts = small_rig()
    glass = parts["GLASS"]
    own_collection(glass, "source")
    bpy.data.collections["cupboard"].name = "stock"
    bpy.context.view_layer.layer_collection.children["stock"].exclude = True
    maker = new_object(None)
    maker.instance_type = "COLLECTION"
    maker.instance_collection = bpy.data.collections["source"]
    bpy.ops.kiriko.solve()

    assert drawn("rig_panel", "VIEW3D_PT_kiriko_rig").icons[glass.name] != "HIDE_ON"
    bpy.ops.kiriko.select_part(part=glass.name)
    assert bpy.context.view_layer.objects.active == maker
    way(maker)
    assert drawn("rig_panel", "VIEW3D_PT_kiriko_rig").icons[glass.name] == "HIDE_ON"
    assert not bpy.ops.kiriko.solve.poll()

    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.kiriko.solve()

    bpy.ops.kiriko.show_part(part=glass.name)
    assert bpy.ops.kiriko.solve.poll()


@every_way
def test_show_switches_on_what_hides_it(
    scene: bpy.types.Scene, way: Callable[[bpy.types.Object], None]
) -> None:
    """And nothing else: other objects, and collections beside, stay as they are."""
    part = small_rig()["PLATE"]
    other = new_object(primitive("cube", size=0.02))
    other.hide_viewport = True
    shelf = bpy.data.collections.new("shelf")
    scene.collection.children.link(shelf)
    shelf.hide_render = True
    way(part)
    assert not bpy.ops.kiriko.solve.poll()
    assert bpy.ops.kiriko.show_part(part=part.name) == {"FINISHED"}
    assert bpy.ops.kiriko.solve.poll()
    assert part.visible_get()
    assert other.hide_viewport
    assert shelf.hide_render


def test_an_object_that_a_driver_hides_stays_as_it_is(scene: bpy.types.Scene) -> None:
    """What was switched on before is switched off again, and the reason is told."""
    part = small_rig()["PLATE"]
    by_monitor_of_collection(part)
    part.driver_add("hide_viewport").driver.expression = "1"
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match=r"'Kiriko Plate' stays hidden in the viewport"):
        bpy.ops.kiriko.show_part(part=part.name)
    assert bpy.data.collections["drawer"].hide_viewport


@pytest.mark.parametrize("symbol", ["hide_viewport", "hide_render"])
def test_an_object_that_its_keyframes_hide_stays_as_it_is(
    scene: bpy.types.Scene, symbol: str
) -> None:
    """They would hide it again with the next frame; in a frame in which they do not it is shown."""
    part = small_rig()["PLATE"]
    for frame, is_hidden in ((1, True), (5, False)):
        setattr(part, symbol, is_hidden)
        part.keyframe_insert(symbol, frame=frame)
    scene.frame_set(1)
    by_monitor_of_collection(part)
    with pytest.raises(RuntimeError, match=r"'Kiriko Plate' stays hidden .* animated or driven"):
        bpy.ops.kiriko.show_part(part=part.name)
    assert bpy.data.collections["drawer"].hide_viewport
    assert getattr(part, symbol)

    scene.frame_set(5)
    assert bpy.ops.kiriko.show_part(part=part.name) == {"FINISHED"}
    scene.frame_set(5)
    assert bpy.ops.kiriko.solve.poll()


@every_way
def test_add_rig(scene: bpy.types.Scene, way: Callable[[bpy.types.Object], None]) -> None:
    """Glass that is hidden though it is selected is refused, and nothing is made."""
    glass = new_object(primitive("cube", size=0.05))
    glass.select_set(True)
    way(glass)
    n_objects = len(bpy.data.objects)
    if glass not in bpy.context.selected_objects:
        return  # then it is not asked about

    with pytest.raises(
        RuntimeError,
        match=r"'thing' is hidden .*\. Show it, or deselect it\.",
    ):
        bpy.ops.kiriko.add_rig(viewer_resolution=64)

    assert len(bpy.data.objects) == n_objects


def nodes_that_instance(kind: str, source: bpy.types.Object) -> bpy.types.Object:
    """An object whose geometry nodes instance another one: as an object or by its collection, once
    or on a point, or on a point of instances.
    """
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    if "collection" in kind:
        info = tree.nodes.new("GeometryNodeCollectionInfo")
        info.inputs["Collection"].default_value = own_collection(source).collection
        shown = info.outputs["Instances"]
    else:
        info = tree.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = source, True
        shown = info.outputs["Geometry"]
    for _ in range(kind.count("point")):
        points = tree.nodes.new("GeometryNodePoints")
        points.inputs["Count"].default_value = 1
        maker = tree.nodes.new("GeometryNodeInstanceOnPoints")
        tree.links.new(points.outputs[0], maker.inputs["Points"])
        tree.links.new(shown, maker.inputs["Instance"])
        shown = maker.outputs[0]
    tree.links.new(shown, tree.nodes.new("NodeGroupOutput").inputs[0])
    host = new_object(bpy.data.meshes.new("empty"))
    host.modifiers.new("nodes", "NODES").node_group = tree
    return host


def is_rendered(scene: bpy.types.Scene, tmp_path: Path) -> bool:
    """Does Cycles show anything in the middle of the scene?"""
    camera = new_object(bpy.data.cameras.new("camera"))
    camera.location.z, camera.data.clip_start = 0.1, 1e-3
    scene.camera, scene.render.engine, scene.cycles.samples = camera, "CYCLES", 1
    scene.cycles.use_denoising, scene.render.film_transparent = False, True
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.filepath = str(tmp_path / "seen.png")
    bpy.ops.render.render(write_still=True)
    bpy.data.objects.remove(camera)
    return pixels(bpy.data.images.load(scene.render.filepath))[4, 4, 3] > 0.5


@pytest.mark.parametrize(
    "kind", ["object", "collection", "object on a point", "object on a point on a point"]
)
@pytest.mark.parametrize("hidden", [(), ("hide_render",), ("hide_render", "hide_viewport")])
def test_glass_that_nodes_instance_is_glass_where_cycles_shows_it(
    scene: bpy.types.Scene, tmp_path: Path, kind: str, hidden: tuple[str, ...]
) -> None:
    """Geometry nodes show an object that is hidden itself, as the sources of instances are, and of
    a collection only what is shown. Add Rig takes what Cycles shows, and only that.
    """
    source = cube()
    host = nodes_that_instance(kind, source)
    # the scene shows the instance alone
    if scene.collection in source.users_collection:
        scene.collection.objects.unlink(source)
    for group in scene.collection.children:
        scene.collection.children.unlink(group)
    for setting in hidden:
        setattr(source, setting, True)
    is_seen = is_rendered(scene, tmp_path)
    host.select_set(True)
    with nullcontext() if is_seen else pytest.raises(RuntimeError, match="has no faces"):
        bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    if is_seen:
        bpy.ops.kiriko.solve()
        assert scene.kiriko.result.coverage > 0.99
