"""Glass as artists bring it: text and curves, objects that nodes scatter, wine in a glass, two
kinds of glass in one object, holes. The checklist tells no fault that is none, and those that are.
"""

import importlib
from collections.abc import Callable
from types import ModuleType

import bmesh
import bpy
import numpy as np
import pytest

from panel_layout import Layout, told
from small_rigs import SIDE, new_object, pixels, primitive, small_rig


def labels_of(entries: list, words: str) -> list[str]:
    """The labels of the buttons of the one entry that has these words, in their order."""
    (entry,) = (entry for entry in entries if words in entry.text)
    return [str(one.label) for one in entry.buttons]


def press(entries: list, words: str, label: str) -> None:
    """Press the button with this label of the one entry that has these words."""
    (entry,) = (entry for entry in entries if words in entry.text)
    (button,) = (one for one in entry.buttons if str(one.label) == label)
    verb = getattr(bpy.ops.kiriko, button.operator.split(".")[1])
    assert verb(**dict(button.properties)) == {"FINISHED"}


def glass_material(name: str, ior: float) -> bpy.types.Material:
    """A Principled material that refracts."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Transmission Weight"].default_value = 1.0
    inputs["IOR"].default_value = ior
    return material


def letters(extrude: float) -> bpy.types.Object:
    """A word, 0.1 m wide."""
    text = bpy.data.curves.new("word", "FONT")
    text.body, text.size, text.extrude = "Oo", 0.1, extrude
    return new_object(text, "GLASS")


def ring() -> bpy.types.Object:
    """A bevelled circle, 84 mm wide."""
    curve = bpy.data.curves.new("ring", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.012
    spline = curve.splines.new("BEZIER")
    spline.bezier_points.add(3)
    spline.use_cyclic_u = True
    for k, point in enumerate(spline.bezier_points):
        point.co = (0.03 * np.cos(k * np.pi / 2), 0.03 * np.sin(k * np.pi / 2), 0.0)
        point.handle_left_type = point.handle_right_type = "AUTO"
    return new_object(curve, "GLASS")


@pytest.mark.parametrize("is_undone", [False, True])
@pytest.mark.parametrize("make", [lambda: letters(0.01), ring])
def test_letters_and_curves_have_their_true_size(
    look: Callable[[], list],
    drawn: Callable[..., Layout],
    make: Callable[[], bpy.types.Object],
    is_undone: bool,
) -> None:
    """Blender's box of an evaluated curve has sides of 2 units, and that of a text no depth."""
    thing = make()
    thing.kiriko.use_ior = True
    name = thing.name
    if is_undone:
        bpy.context.view_layer.update()
        bpy.ops.ed.undo_push(message="Glass")
        thing.location.x = 0.001
        bpy.ops.ed.undo_push(message="Move")
        bpy.ops.ed.undo()
    texts = " ".join(told(look()))
    assert "flat" not in texts
    assert "Did you mean" not in texts
    shown = drawn("object", "OBJECT_PT_kiriko", bpy.data.objects[name], bpy.context.scene)
    assert "flat" not in " ".join(shown.texts)


def test_letters_without_depth_are_flat_and_large_ones_are_told(look: Callable[[], list]) -> None:
    """The mesh of a text tells both."""
    thing = letters(0.0)
    thing.kiriko.use_ior = True
    assert f"'{thing.name}' is flat. Glass needs a thickness." in told(look())
    thing.data.extrude, thing.scale = 0.01, (20.0, 20.0, 20.0)
    texts = " ".join(told(look()))
    assert "flat" not in texts
    assert "Did you mean" in texts


def scattered() -> bpy.types.Object:
    """A flat grid without a material that shows a cube of glass at each vertex, and itself not."""
    pearl = new_object(primitive("cube", size=0.2 * SIDE))
    pearl.data.materials.append(glass_material("Pearl", 1.5))
    pearl.location.x = 10.0
    grid = new_object(primitive("grid", x_segments=1, y_segments=1, size=0.5 * SIDE), "GLASS")
    scatter(grid, pearl)
    return grid


def scatter(thing: bpy.types.Object, shown: bpy.types.Object, as_instance: bool = False) -> None:
    """Have an object show another at each of its vertices, and itself not, by geometry nodes.

    as_instance : with the materials of the other's slots, too, not of its mesh alone
    """
    tree = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = [
        tree.nodes.new(kind)
        for kind in (
            "NodeGroupInput",
            "NodeGroupOutput",
            "GeometryNodeInstanceOnPoints",
            "GeometryNodeObjectInfo",
        )
    ]
    first, last, place, info = nodes
    info.inputs["Object"].default_value = shown
    info.inputs["As Instance"].default_value = as_instance
    tree.links.new(first.outputs[0], place.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    tree.links.new(place.outputs[0], last.inputs[0])
    thing.modifiers.new("scatter", "NODES").node_group = tree


def test_objects_that_nodes_scatter_are_no_fault_of_the_one_they_are_scattered_on(
    look: Callable[[], list], drawn: Callable[..., Layout]
) -> None:
    """The grid is flat and has no material, and is not seen: the cubes are."""
    grid = scattered()
    bpy.context.view_layer.update()
    texts = " ".join(told(look()))
    assert "flat" not in texts
    assert "isn't glass" not in texts
    shown = " ".join(drawn("object", "OBJECT_PT_kiriko", grid, bpy.context.scene).texts)
    assert "flat" not in shown
    assert "isn't glass" not in shown
    grid.modifiers[0].show_viewport = False  # then it is
    bpy.context.view_layer.update()
    texts = told(look())
    assert f"'{grid.name}' is flat. Glass needs a thickness." in texts
    assert f"The material of '{grid.name}' isn't glass." in texts


def test_wine_in_a_glass_is_told_and_taken(look: Callable[[], list]) -> None:
    """Without it the source image would be that of the empty glass; beside it, it is no matter."""
    small_rig()
    assert told(look()) == []
    wine = new_object(primitive("icosphere", subdivisions=2, radius=0.2 * SIDE))
    wine.name = "Wine"
    bpy.context.view_layer.update()
    assert told(look()) == []  # an opaque thing may be a stand
    wine.data.materials.append(glass_material("Wine", 1.34))
    sentence = "'Wine' is inside the glass but isn't in the rig yet."
    assert told(look()) == [sentence]
    wine.hide_render = True
    assert told(look()) == []
    wine.hide_render = False
    wine.location.x = SIDE
    bpy.context.view_layer.update()
    assert told(look()) == []
    wine.location.x = 0.6 * SIDE
    bpy.context.view_layer.update()
    assert bpy.context.scene.kiriko.result.summary
    press(look(), sentence, "Add 'Wine' to Rig")
    assert wine.kiriko.role == "GLASS"
    assert bpy.context.scene.kiriko.result.summary == ""  # of the light without it
    assert told(look()) == []


def test_nobody_is_to_press_solve_while_live_is_on(
    kiriko: ModuleType, scene: bpy.types.Scene, drawn: Callable[..., Layout]
) -> None:
    """It solves by itself."""
    small_rig()
    assert "Ready: press Solve." in drawn("main_panel", "VIEW3D_PT_kiriko_main").texts
    bpy.ops.kiriko.live()
    try:
        texts = drawn("main_panel", "VIEW3D_PT_kiriko_main").texts
        assert not any("press Solve" in text for text in texts)
    finally:
        kiriko.operators.live.stop()


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, -2, 2)])
def test_a_bowl_of_one_surface_gets_walls(
    look: Callable[[], list], scale: tuple[float, float, float]
) -> None:
    """Half a ball: walls of 3 % of its width, all of them glass, whatever its scale."""
    glass = small_rig()["GLASS"]
    bowl = primitive("icosphere", subdivisions=3, radius=0.5 * SIDE)
    shape = bmesh.new()
    shape.from_mesh(bowl)
    upper = [face for face in shape.faces if face.calc_center_median().z > 0]
    bmesh.ops.delete(shape, geom=upper, context="FACES")
    area = sum(face.calc_area() for face in shape.faces)
    shape.to_mesh(bowl)
    shape.free()
    bowl.polygons.foreach_set("use_smooth", [True] * len(bowl.polygons))
    glass.data, glass.scale = bowl, scale
    bpy.context.view_layer.update()
    assert labels_of(look(), "is not closed") == ["Fill Holes", "Thicken"]
    press(look(), "is not closed", "Thicken")
    assert told(look()) == []
    wall = glass.modifiers[0].thickness
    assert wall == pytest.approx(0.03 * SIDE, rel=0.02)
    shown = glass.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    shape = bmesh.new()
    shape.from_mesh(shown)
    assert not any(edge.is_boundary for edge in shape.edges)
    assert shape.calc_volume() == pytest.approx(area * wall, rel=0.05)
    shape.free()


def test_a_rig_of_which_nothing_is_left_is_removed(look: Callable[[], list]) -> None:
    """As after A and X: one line, and not one for each part, of which none can be made."""
    small_rig()
    bpy.ops.kiriko.solve()
    for thing in list(bpy.context.scene.objects):
        bpy.data.objects.remove(thing)
    press(look(), "All parts of the rig are gone.", "Remove Rig")
    assert "Kiriko Rig" not in bpy.data.collections


def wine_inside(scene: bpy.types.Scene) -> bpy.types.Object:
    """A ball of wine in the middle of the glass."""
    wine = new_object(primitive("icosphere", subdivisions=2, radius=0.2 * SIDE), "GLASS")
    wine.name = "Wine"
    wine.data.materials.append(glass_material("Wine", 1.34))
    return wine


def reaching_out(scene: bpy.types.Scene) -> None:
    wine_inside(scene).location.x = 0.5 * SIDE


def turned_in(scene: bpy.types.Scene) -> None:
    scene.objects["Cube"].data.flip_normals()


def overridden(scene: bpy.types.Scene) -> None:
    scene.objects["Cube"].kiriko.use_ior, scene.objects["Cube"].kiriko.ior = True, 1.7


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda scene: None, ""),
        (wine_inside, "'Wine' is inside other glass"),
        (reaching_out, "'Cube' and 'Wine' touch or overlap"),
        (turned_in, "normals of 'Cube' point inward"),
        (overridden, "the Override IOR of 'Cube' differs from its material"),
    ],
)
def test_glass_that_cycles_shows_otherwise_is_told_as_it_is_looked_at(
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    drawn: Callable[..., Layout],
    spoil: Callable[[bpy.types.Scene], object],
    reason: str,
) -> None:
    """What is seen would be taken for a fault of the source image. It is told in the panel, for as
    long as it is so, by what Live has read: the status bar cuts it off.
    """
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    glass.data.materials.append(glass_material("Glass", 1.49))
    spoil(scene)
    glass.data.update_tag()
    bpy.context.view_layer.update()
    assert seen_through(kiriko, drawn) == ""
    assert bpy.ops.kiriko.look_through() == {"FINISHED"}
    text = seen_through(kiriko, drawn)
    assert bool(text) == bool(reason)
    assert reason in text
    bpy.ops.kiriko.look_through()
    assert seen_through(kiriko, drawn) == ""


def seen_through(kiriko: ModuleType, drawn: Callable[..., Layout]) -> str:
    """The words in the panel on Cycles' glass, once Live has come to rest."""
    live = kiriko.operators.live
    while live.is_on() and live.tick() != live.live_follower.IDLE:
        pass
    texts = " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    words = "Cycles renders the glass differently"
    return texts[texts.index(words) :] if words in texts else ""


def test_the_words_on_glass_of_cycles_follow_it(
    kiriko: ModuleType, scene: bpy.types.Scene, drawn: Callable[..., Layout], monkeypatch
) -> None:
    """They come and go with the fault, and the glass is compared once as long as it is the same;
    the scene is read no more often than Live reads it.
    """
    read, compared = [], []
    follower = kiriko.operators.live_follower
    for module, name, calls in ((follower, "reasons", compared), (follower.work, "read", read)):
        own = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, c=calls, f=own: c.append(1) or f(*a))
    rig = small_rig()
    rig["GLASS"].kiriko.use_ior = False
    rig["GLASS"].data.materials.append(glass_material("Glass", 1.49))
    bpy.ops.kiriko.live()
    assert seen_through(kiriko, drawn) == ""
    assert not compared
    before = len(read)
    bpy.ops.kiriko.look_through()
    assert len(read) == before
    assert seen_through(kiriko, drawn) == ""
    assert len(compared) == 1
    rig["GLASS"].kiriko.use_ior, rig["GLASS"].kiriko.ior = True, 1.7
    assert "the Override IOR of 'Cube'" in seen_through(kiriko, drawn)
    assert len(compared) == 2
    rig["DISPLAY"].location.x += 1e-3
    bpy.context.view_layer.update()
    assert "the Override IOR of 'Cube'" in seen_through(kiriko, drawn)
    assert len(compared) == 2
    rig["GLASS"].kiriko.use_ior = False
    assert seen_through(kiriko, drawn) == ""
    bpy.ops.kiriko.look_through()
    kiriko.operators.live.stop()


def test_the_words_on_glass_of_cycles_come_with_the_first_picture(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """The final one of an ugly glass takes a minute, in which they would be missed."""
    rig = small_rig()
    rig["GLASS"].kiriko.use_ior = False
    rig["GLASS"].data.materials.append(glass_material("Glass", 1.49))
    overridden(scene)
    bpy.ops.kiriko.look_through()
    live = kiriko.operators.live
    while not live.followed().otherwise:
        assert live.tick() != live.live_follower.IDLE
    assert live.followed().n_pictures == 1
    assert live.followed().is_working
    bpy.ops.kiriko.look_through()


@pytest.mark.parametrize("is_family", [False, True])
def test_metaballs_are_made_glass(look: Callable[[], list], is_family: bool) -> None:
    """The one that has the surface of its family; the others have none, and are told nothing of."""
    for name, x in (("ball", 0.0), ("ball.001", 0.01))[: 1 + is_family]:
        balls = bpy.data.metaballs.new(name)
        balls.resolution = 0.01
        balls.elements.new().radius = 0.04
        thing = new_object(balls)
        thing.name, thing.location.x = name, x
        thing.select_set(True)
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    bpy.ops.kiriko.add_rig(**small)
    assert [str(one.text) for one in look()] == ["The material of 'ball' isn't glass."]
    press(look(), "'ball' isn't glass", "Make It Glass (Acrylic)")
    assert not look()
    bpy.ops.kiriko.solve()
    assert bpy.context.scene.objects["ball"].active_material.name == "Kiriko Glass"


def ball_turned(which: Callable[[bmesh.types.BMFace], bool], is_smooth: bool) -> bpy.types.Object:
    """A rig around a ball, some faces of which are flipped."""
    glass = small_rig()["GLASS"]
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=3, radius=SIDE / 2)
    bmesh.ops.reverse_faces(shape, faces=[face for face in shape.faces if which(face)])
    shape.to_mesh(glass.data)
    shape.free()
    glass.data.shade_smooth() if is_smooth else glass.data.shade_flat()
    return glass


@pytest.mark.parametrize("edge", [-0.4, 0.0, 0.4])
def test_flipped_faces_are_told_and_turned(look: Callable[[], list], edge: float) -> None:
    """A few at the front, a half, or all but a few. Smooth shading bends light wrongly there; once
    turned, they give the source image of a ball that was drawn so.
    """
    ball_turned(lambda face: False, is_smooth=True)
    assert not [one for one in look() if "flipped" in one.text]
    bpy.ops.kiriko.solve()
    wanted = pixels(bpy.context.scene.kiriko.result.source)

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    glass = ball_turned(lambda face: face.calc_center_median().y < edge * SIDE, is_smooth=True)
    bpy.ops.kiriko.solve()
    off = pixels(bpy.context.scene.kiriko.result.source)
    assert np.abs(off - wanted).max() > 0.1

    press(look(), "flipped faces", "Recalculate Normals")
    assert not [one for one in look() if "flipped" in one.text]
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    assert all(face.normal @ face.calc_center_median() > 0 for face in shape.faces)
    shape.free()
    bpy.ops.kiriko.solve()
    solved = pixels(bpy.context.scene.kiriko.result.source)
    assert np.allclose(solved, wanted, atol=1e-4)  # the vertices' order in a face is another


def test_sculpted_glass_is_waited_for(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """Blender's evaluated mesh is that of before until the mode is left: Solve is grey, and Live
    tells not to be up to date. What is sculpted beside the rig is no matter.
    """
    glass = small_rig()["GLASS"]
    other = new_object(primitive("cube", size=SIDE))
    bpy.ops.kiriko.live()
    live = kiriko.operators.live
    try:
        for thing, is_waited_for in ((other, False), (glass, True)):
            bpy.context.view_layer.objects.active = thing
            bpy.ops.object.mode_set(mode="SCULPT")
            assert bpy.ops.kiriko.solve.poll() != is_waited_for
            assert ("leave Sculpt Mode" in live.status()[0]) == is_waited_for
            bpy.ops.object.mode_set(mode="OBJECT")
            assert bpy.ops.kiriko.solve.poll()
            assert "sculpt" not in live.status()[0]
    finally:
        live.stop()


def test_losses_of_an_image_that_is_gone_are_not_told(look: Callable[[], list]) -> None:
    """Nor those that a deleted rig left behind."""
    rig = small_rig()
    rig["DISPLAY"].scale = (0.5, 0.5, 0.5)
    bpy.ops.kiriko.solve()
    assert any("missed the display" in text for text in told(look()))
    bpy.data.images.remove(bpy.context.scene.kiriko.result.source)
    assert told(look()) == []


@pytest.mark.parametrize("drawn_as", ["WIRE", "BOUNDS", "TEXTURED"])
def test_a_tool_that_cuts_glass_is_no_part_of_it(look: Callable[[], list], drawn_as: str) -> None:
    """As glass it would fill the hole that it makes. Wine that is cut out of its glass is one."""
    glass = small_rig()["GLASS"]
    tool = new_object(primitive("cube", size=0.02))
    tool.data.materials.append(glass_material("copied", 1.5))
    tool.display_type = drawn_as
    assert any("is inside the glass" in text for text in told(look()))
    cut = glass.modifiers.new("cut", "BOOLEAN")
    cut.object, cut.operation = tool, "DIFFERENCE"
    found = any("is inside the glass" in text for text in told(look()))
    assert found == (drawn_as == "TEXTURED")


def set_by_nodes(thing: bpy.types.Object, material: bpy.types.Material) -> None:
    """A modifier, "nodes", that sets a material on all faces."""
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    setter = tree.nodes.new("GeometryNodeSetMaterial")
    setter.inputs["Material"].default_value = material
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], setter.inputs["Geometry"])
    tree.links.new(setter.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    thing.modifiers.new("nodes", "NODES").node_group = tree
    bpy.context.view_layer.update()


def test_a_material_of_nodes_is_the_product_that_is_shown(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Not that of a slot, which is on no face; and one that is chosen goes into that material."""
    chosen = importlib.import_module(f"{kiriko.__name__}.core.blender.checks.chosen_product")
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    glass.data.materials.append(glass_material("slot", 1.6))
    catalogue = importlib.import_module(f"{kiriko.__name__}.core.rig.catalogue")
    set_by_nodes(glass, glass_material("set", catalogue.GLASSES["Water"].ior))
    assert chosen.glass_product(glass).name == "Water"
    glass.select_set(True)
    bpy.context.view_layer.objects.active = glass
    bpy.ops.kiriko.glass_preset(preset="Acrylic")
    assert not glass.kiriko.use_ior
    assert chosen.glass_product(glass).name == "Acrylic"


def test_make_it_glass_counts_though_nodes_set_another_material(
    look: Callable[[], list], capfd: pytest.CaptureFixture
) -> None:
    """By a modifier after these, which is gone with the rig; the index of light is that of the
    glass, whatever stands in a slot.
    """
    thing = new_object(primitive("cube", size=0.05))
    thing.data.materials.append(glass_material("slot", 1.6))
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    set_by_nodes(thing, bpy.data.materials.new("Stone"))
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))

    press(look(), "'thing' isn't glass", "Make It Glass (Acrylic)")
    assert "A new modifier assigns it." in capfd.readouterr().out
    assert not any("isn't glass" in text for text in told(look()))
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert "refract" not in bpy.context.scene.kiriko.result.notes

    trees = len(bpy.data.node_groups)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.remove_rig()
    assert [one.name for one in thing.modifiers] == ["nodes"]
    assert len(bpy.data.node_groups) == trees - 1
    assert [slot.material.name for slot in thing.material_slots] == ["slot"]


def test_glass_whose_modifiers_give_it_its_material_is_glass(look: Callable[[], list]) -> None:
    """Light follows a material that geometry nodes set: another in a slot would change nothing."""
    small_rig()
    (glass,) = (one for one in bpy.context.scene.objects if one.kiriko.role == "GLASS")
    glass.kiriko.use_ior = False
    assert any("isn't glass" in text for text in told(look()))
    set_by_nodes(glass, glass_material("set", 1.6))
    (setter,) = (one for one in bpy.data.node_groups["nodes"].nodes if "SET" in one.type)
    assert told(look()) == []
    with pytest.raises(RuntimeError, match="Select opaque glass"):
        bpy.ops.kiriko.make_glass(part=glass.name)

    inputs = setter.inputs["Material"].default_value.node_tree.nodes["Principled BSDF"].inputs
    inputs["Transmission Weight"].default_value = 0.0
    assert any("isn't glass" in text for text in told(look()))


@pytest.mark.usefixtures("no_remedies")
@pytest.mark.parametrize("way", ["wire", "no render", "collection"])
def test_tools_of_a_boolean_are_no_glass(scene: bpy.types.Scene, way: str) -> None:
    """All objects are selected, as by A: the tool that cuts the glass would fill the notch. Wine,
    which is cut out of the glass and rendered, is glass as well.
    """
    glass, tool, wine = (new_object(primitive("cube", size=side)) for side in (0.05, 0.02, 0.03))
    tool.location.z = wine.location.x = 0.025
    for thing in (tool, wine):
        cut = glass.modifiers.new("Cut", "BOOLEAN")
        cut.object = thing
        thing.select_set(True)
    glass.select_set(True)
    tool.display_type = "TEXTURED" if way == "no render" else "WIRE"
    tool.hide_render = way == "no render"
    if way == "collection":
        tools = bpy.data.collections.new("Tools")
        scene.collection.children.link(tools)
        tools.objects.link(tool)
        cut = glass.modifiers[0]
        cut.operand_type, cut.collection = "COLLECTION", tools
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    assert bpy.ops.kiriko.add_rig(**small) == {"FINISHED"}
    assert [thing.kiriko.role for thing in (glass, tool, wine)] == ["GLASS", "NONE", "GLASS"]


@pytest.mark.usefixtures("no_remedies")
@pytest.mark.parametrize("operation", ["DIFFERENCE", "UNION", "INTERSECT"])
def test_a_tool_that_is_left_out_is_told(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture, operation: str
) -> None:
    """By Add Rig, in the panel as well, with the modifier."""
    glass, tool = (new_object(primitive("cube", size=side)) for side in (0.05, 0.02))
    glass.name, tool.name = "Block", "Tool"
    tool.location.z, tool.display_type = 0.02, "WIRE"
    modifier = glass.modifiers.new("Cut", "BOOLEAN")
    modifier.object, modifier.operation = tool, operation
    for thing in (glass, tool):
        thing.select_set(True)
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    assert bpy.ops.kiriko.add_rig(**small) == {"FINISHED"}
    told = "Left out: 'Tool' (a Boolean modifier of 'Block' uses it)."
    assert told in capfd.readouterr().out
    assert told in scene.kiriko.result.summary
    assert [thing.kiriko.role for thing in (glass, tool)] == ["GLASS", "NONE"]


@pytest.mark.usefixtures("no_remedies")
@pytest.mark.parametrize("is_hidden", [False, True])
def test_a_ball_in_place_of_hidden_glass_is_told(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture, is_hidden: bool
) -> None:
    """H deselects the glass, which stays the active object; one that is only deselected is seen."""
    glass = new_object(primitive("cube", size=0.05))
    glass.name = "Block"
    bpy.context.view_layer.objects.active = glass
    glass.hide_set(is_hidden)
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    assert bpy.ops.kiriko.add_rig(**small) == {"FINISHED"}
    said = "'Block' is hidden in the viewport by its eye icon (H), so the rig is built around a"
    assert (said in capfd.readouterr().out) == is_hidden
    assert (said in scene.kiriko.result.summary) == is_hidden
