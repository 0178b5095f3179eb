"""Glass as artists bring it: text and curves, objects that nodes scatter, wine in a glass, two
kinds of glass in one object, holes. The checklist tells no fault that is none, and those that are.
"""

import importlib
from collections.abc import Callable
from itertools import pairwise
from types import ModuleType

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

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
    assert "measures" not in texts
    shown = drawn("object", "VIEW3D_PT_kiriko_object", bpy.data.objects[name], bpy.context.scene)
    assert "flat" not in " ".join(shown.texts)


def test_letters_without_depth_are_flat_and_large_ones_are_told(look: Callable[[], list]) -> None:
    """The mesh of a text tells both."""
    thing = letters(0.0)
    thing.kiriko.use_ior = True
    assert f"'{thing.name}' is flat, and glass has to have a thickness." in told(look())
    thing.data.extrude, thing.scale = 0.01, (20.0, 20.0, 20.0)
    texts = " ".join(told(look()))
    assert "flat" not in texts
    assert f"'{thing.name}' measures" in texts


def test_faults_of_curves_that_nobody_can_mend_are_not_told(look: Callable[[], list]) -> None:
    """The poles of a surface are triangles without area; a curve is shaded smooth as a mesh is."""
    curve = ring()
    curve.kiriko.use_ior = True
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(radius=0.03)
    surface = bpy.context.active_object
    surface.kiriko.role, surface.kiriko.use_ior = "GLASS", True
    texts = " ".join(told(look()))
    assert "without area" not in texts
    assert "looks curved" not in texts
    for thing in (curve, surface):
        for spline in thing.data.splines:
            spline.use_smooth = False
        thing.data.update_tag()
        bpy.context.view_layer.update()
        press(look(), f"'{thing.name}' looks curved", "Shade Smooth")
        assert all(spline.use_smooth for spline in thing.data.splines)
        bpy.context.view_layer.update()
        assert "looks curved" not in " ".join(told(look()))


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
    assert "does not refract" not in texts
    shown = " ".join(drawn("object", "VIEW3D_PT_kiriko_object", grid, bpy.context.scene).texts)
    assert "flat" not in shown
    assert "does not refract" not in shown
    grid.modifiers[0].show_viewport = False  # then it is
    bpy.context.view_layer.update()
    texts = told(look())
    assert f"'{grid.name}' is flat, and glass has to have a thickness." in texts
    assert f"'{grid.name}' is no glass: its material does not refract." in texts


def without_faces(way: str) -> bpy.types.Object:
    """The glass of a small rig, which is not flat: no face is left of it."""
    glass = small_rig()["GLASS"]
    if way == "mesh":
        glass.data = bpy.data.meshes.new("empty")
    elif way == "boolean":
        far = new_object(primitive("cube", size=SIDE))
        far.location.x = 10.0
        cut = glass.modifiers.new("cut", "BOOLEAN")
        cut.operation, cut.object = "INTERSECT", far
    else:
        tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        last = tree.nodes.new("NodeGroupOutput")
        if way == "points":
            points = tree.nodes.new("GeometryNodePoints")
            tree.links.new(points.outputs[0], last.inputs[0])
        glass.modifiers.new("nodes", "NODES").node_group = tree
    bpy.context.view_layer.update()
    return glass


@pytest.mark.parametrize("way", ["mesh", "boolean", "nodes", "points"])
def test_glass_without_a_face_is_told(
    look: Callable[[], list], drawn: Callable[..., Layout], way: str
) -> None:
    """It is not flat, so that no thickness helps it, and the rig is not ready."""
    glass = without_faces(way)
    entries = look()
    words = f"'{glass.name}' has no faces: give it some, or set its role to None."
    assert labels_of(entries, words) == ["Select Part"]
    assert "flat" not in " ".join(told(entries))
    shown = drawn("object", "VIEW3D_PT_kiriko_object", glass, bpy.context.scene)
    assert "flat" not in " ".join(shown.texts)
    texts = drawn("checklist", "VIEW3D_PT_kiriko_checklist").texts
    assert not [text for text in texts if "Ready" in text]


def test_wine_in_a_glass_is_told_and_taken(look: Callable[[], list]) -> None:
    """Without it the source image would be that of the empty glass; beside it, it is no matter."""
    small_rig()
    assert told(look()) == []
    wine = new_object(primitive("icosphere", subdivisions=2, radius=0.2 * SIDE))
    wine.name = "Wine"
    bpy.context.view_layer.update()
    assert told(look()) == []  # an opaque thing may be a stand
    wine.data.materials.append(glass_material("Wine", 1.34))
    sentence = "'Wine' refracts within the glass, and is no part of the rig."
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
    press(look(), sentence, "Use 'Wine'")
    assert wine.kiriko.role == "GLASS"
    assert bpy.context.scene.kiriko.result.summary == ""  # of the light without it
    assert told(look()) == []


def test_an_object_of_two_kinds_of_glass_is_told(look: Callable[[], list]) -> None:
    """It counts as of one index, that of most of it: where all faces have one, none is told."""
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    for name, ior in (("Crown", 1.5), ("Flint", 1.7)):
        glass.data.materials.append(glass_material(name, ior))
    assert told(look()) == []
    glass.data.polygons[0].material_index = 1
    glass.data.update_tag()
    bpy.context.view_layer.update()
    sentence = (
        f"'{glass.name}' has 2 indices of refraction, and counts as of one: make a closed object"
        " of each."
    )
    assert told(look()) == [sentence]
    glass.material_slots[1].material = glass_material("Crown too", 1.5)
    assert told(look()) == []
    glass.material_slots[1].material = bpy.data.materials["Flint"]
    assert told(look()) == [sentence]
    glass.kiriko.use_ior = True
    assert told(look()) == []


@pytest.mark.parametrize("is_split", [False, True])
def test_holes_are_filled_with_faces_that_look_out(
    look: Callable[[], list], is_split: bool
) -> None:
    """Two holes, one of two squares; also where the squares share no vertices.

    The volume, whose sign is that of the faces, is that of the cube.
    """
    glass = small_rig()["GLASS"]
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=4, use_grid_fill=True)
    for face in shape.faces:
        face.smooth, face.material_index = True, 0
    by_height = sorted(shape.faces, key=lambda face: face.calc_center_median()[:])
    first = by_height[0]
    around = (face for edge in first.edges for face in edge.link_faces if face != first)
    beside = next(face for face in around if face.normal.dot(first.normal) > 0.9)
    bmesh.ops.delete(shape, geom=[first, beside, by_height[-1]], context="FACES_ONLY")
    if is_split:
        bmesh.ops.split_edges(shape, edges=[e for e in shape.edges if not e.is_boundary])
    shape.to_mesh(glass.data)
    shape.free()
    glass.data.update_tag()
    bpy.context.view_layer.update()
    assert bpy.context.scene.kiriko.result.summary
    assert labels_of(look(), "is not closed") == ["Select", "Fill Holes", "Thicken"]
    press(look(), "is not closed: 10 edges", "Fill Holes")
    assert told(look()) == []
    assert bpy.context.scene.kiriko.result.summary == ""  # it may have told of the gaps
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    assert all(face.smooth for face in shape.faces)
    assert len(shape.faces) in {6 * 25 - 1, 6 * 25}
    bmesh.ops.remove_doubles(shape, verts=shape.verts[:], dist=1e-6)
    assert shape.calc_volume(signed=True) == pytest.approx(SIDE**3, rel=1e-5)
    shape.free()


def test_nobody_is_to_press_solve_while_live_is_on(
    kiriko: ModuleType, scene: bpy.types.Scene, drawn: Callable[..., Layout]
) -> None:
    """It solves by itself."""
    small_rig()
    assert "Ready: press Solve." in drawn("checklist", "VIEW3D_PT_kiriko_checklist").texts
    bpy.ops.kiriko.live()
    try:
        assert "Ready." in drawn("checklist", "VIEW3D_PT_kiriko_checklist").texts
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
    assert labels_of(look(), "is not closed") == ["Select", "Thicken", "Fill Holes"]
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


def test_open_picture_stays_where_it_is(drawn: Callable[..., Layout]) -> None:
    """Solve stands below it, and is not to move away under the pointer as it is pressed."""
    small_rig()
    before = drawn("checklist", "VIEW3D_PT_kiriko_checklist")
    bpy.ops.kiriko.solve()
    after = drawn("checklist", "VIEW3D_PT_kiriko_checklist")
    assert "kiriko.open_picture" in before.operators
    assert "kiriko.open_picture" in after.operators


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
        (wine_inside, "for 'Wine' lies in other glass:"),
        (reaching_out, "is, for 'Cube' and 'Wine' touch or overlap, which Cycles cannot follow:"),
        (turned_in, "for the faces of 'Cube' look inward:"),
        (overridden, "for the Override IOR of 'Cube' is not that of its material:"),
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
    texts = " ".join(drawn("solve", "VIEW3D_PT_kiriko_solve").texts)
    return texts[texts.index("Cycles shows the glass") :] if "Cycles shows" in texts else ""


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


def test_an_override_is_compared_with_the_material_itself(
    kiriko: ModuleType, scene: bpy.types.Scene, drawn: Callable[..., Layout], linked: Callable
) -> None:
    """A linked material may have the name of one of this file, and another index."""
    glass = small_rig()["GLASS"]
    theirs = linked(glass_material("Glass", 1.7))
    own = bpy.data.materials["Glass", None]
    own.node_tree.nodes["Principled BSDF"].inputs["IOR"].default_value = 1.49
    glass.kiriko.use_ior = True
    for material, ior, is_told in ((theirs, 1.7, False), (theirs, 1.49, True), (own, 1.7, True)):
        glass.data.materials.clear()
        glass.data.materials.append(material)
        glass.kiriko.ior = ior
        bpy.context.view_layer.update()
        bpy.ops.kiriko.look_through()
        assert ("Override IOR" in seen_through(kiriko, drawn)) == is_told
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
    assert [str(one.text) for one in look()] == [
        "'ball' is no glass: its material does not refract."
    ]
    press(look(), "'ball' is no glass", "Make It Glass")
    assert not look()
    bpy.ops.kiriko.solve()
    assert bpy.context.scene.objects["ball"].active_material.name == "Kiriko Glass"


def ball_turned(which: Callable[[bmesh.types.BMFace], bool], is_smooth: bool) -> bpy.types.Object:
    """A rig around a ball, some faces of which are turned round."""
    glass = small_rig()["GLASS"]
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=3, radius=SIDE / 2)
    bmesh.ops.reverse_faces(shape, faces=[face for face in shape.faces if which(face)])
    shape.to_mesh(glass.data)
    shape.free()
    glass.data.shade_smooth() if is_smooth else glass.data.shade_flat()
    return glass


@pytest.mark.parametrize(
    "which",
    [
        lambda face: face.calc_center_median().y < -0.4 * SIDE,
        lambda face: face.calc_center_median().x > 0.0,
        lambda face: face.calc_center_median().y > -0.4 * SIDE,
    ],
    ids=["the front", "a half", "all but the front"],
)
def test_faces_that_are_turned_round_beside_others_are_told_and_turned(
    look: Callable[[], list], which: Callable[[bmesh.types.BMFace], bool]
) -> None:
    """Smooth shading bends light wrongly at them: turned out, they give the source image of a ball
    that was drawn so.
    """
    ball_turned(lambda face: False, is_smooth=True)
    assert not [one for one in look() if "turned round" in one.text]
    bpy.ops.kiriko.solve()
    wanted = pixels(bpy.context.scene.kiriko.result.source)

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    glass = ball_turned(which, is_smooth=True)
    bpy.ops.kiriko.solve()
    off = pixels(bpy.context.scene.kiriko.result.source)
    assert np.abs(off - wanted).max() > 0.1

    press(look(), "faces turned round beside others: light there is bent wrongly", "Turn Out")
    assert not [one for one in look() if "turned round" in one.text]
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    assert all(face.normal @ face.calc_center_median() > 0 for face in shape.faces)
    shape.free()
    bpy.ops.kiriko.solve()
    solved = pixels(bpy.context.scene.kiriko.result.source)
    assert np.allclose(solved, wanted, atol=1e-4)  # the vertices' order in a face is another


def test_flat_faces_that_are_turned_round_cost_no_light(look: Callable[[], list]) -> None:
    """Kiriko knows which way they look; Cycles and other programs do not, so it is advice."""
    glass = ball_turned(lambda face: face.index < 9, is_smooth=False)
    glass.kiriko.surface = "FACETS"
    words = "9 faces turned round beside others: Kiriko knows it, Cycles does not"
    (entry,) = (one for one in look() if words in one.text)
    assert entry.icon == "INFO"
    press(look(), words, "Turn Out")
    assert not [one for one in look() if "turned round" in one.text]


def test_faces_turned_round_by_a_modifier_are_told(look: Callable[[], list]) -> None:
    """There is nothing to turn in the mesh itself then."""
    glass = ball_turned(lambda face: False, is_smooth=True)
    group = bpy.data.node_groups.new("flip", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, end = (group.nodes.new(f"NodeGroup{way}") for way in ("Input", "Output"))
    flip, index = map(group.nodes.new, ("GeometryNodeFlipFaces", "GeometryNodeInputIndex"))
    group.links.new(index.outputs[0], flip.inputs["Selection"])  # all but the face 0
    group.links.new(begin.outputs[0], flip.inputs["Mesh"])
    group.links.new(flip.outputs[0], end.inputs[0])
    glass.modifiers.new("flip", "NODES").node_group = group
    assert labels_of(look(), "has 1 face turned round beside others") == ["Select Part"]


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
            assert ("leave sculpt mode" in live.status()[0]) == is_waited_for
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


REMOVERS = ("remove_doubles", "remove_inner")


def test_a_mesh_of_another_file_is_mended_there(look, linked):
    """Changed here it would be as before once the file is opened again."""
    glass = small_rig()["GLASS"]
    glass.data = linked(glass.data)
    glass.name = "Head"  # as the outliner and the checklist name it, whatever its mesh is called
    n_faces = len(glass.data.polygons)
    for mend in ("fill_holes", "turn_out", "merge_flat", "shade_smooth", *REMOVERS):
        with pytest.raises(RuntimeError, match="'Head' is linked from another file: mend it there"):
            getattr(bpy.ops.kiriko, mend)(part=glass.name)
    assert len(glass.data.polygons) == n_faces


@pytest.mark.parametrize("drawn_as", ["WIRE", "BOUNDS", "TEXTURED"])
def test_a_tool_that_cuts_glass_is_no_part_of_it(look: Callable[[], list], drawn_as: str) -> None:
    """As glass it would fill the hole that it makes. Wine that is cut out of its glass is one."""
    glass = small_rig()["GLASS"]
    tool = new_object(primitive("cube", size=0.02))
    tool.data.materials.append(glass_material("copied", 1.5))
    tool.display_type = drawn_as
    assert any("refracts within the glass" in text for text in told(look()))
    cut = glass.modifiers.new("cut", "BOOLEAN")
    cut.object, cut.operation = tool, "DIFFERENCE"
    found = any("refracts within the glass" in text for text in told(look()))
    assert found == (drawn_as == "TEXTURED")


def test_only_what_bends_light_is_looked_for_within_glass(kiriko, look, monkeypatch):
    """The boxes of thousands of other objects take seconds."""
    small_rig()
    mesh = primitive("cube", size=0.01)
    for _ in range(20):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("Other", mesh))
    asked = []
    module = importlib.import_module(f"{kiriko.__name__}.core.blender.inspect_scene")
    own = module.box_of
    monkeypatch.setattr(
        module, "box_of", lambda scene, thing: asked.append(thing) or own(scene, thing)
    )
    look()
    assert {thing.kiriko.role for thing in asked} == {"GLASS"}


def holed_cube() -> bpy.types.Mesh:
    """A cube without one of its faces, whose others look inwards."""
    mesh = primitive("cube", size=SIDE)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.faces.ensure_lookup_table()
    bmesh.ops.delete(shape, geom=[shape.faces[0]], context="FACES_ONLY")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


MENDS = ("fill_holes", "turn_out", "merge_flat", "shade_smooth", *REMOVERS)


def flattened() -> bpy.types.Mesh:
    """A cube without one face, and with a vertex that lies on another one."""
    mesh = holed_cube()
    mesh.vertices[0].co = mesh.vertices[1].co
    return mesh


@pytest.mark.parametrize("mend", MENDS)
@pytest.mark.parametrize(
    ("n", "others"), [(0, ""), (1, "'thing.001'"), (4, "4 other objects")], ids=str
)
def test_others_that_have_the_same_mesh_are_named(scene, capfd, mend, n, others):
    """A mend changes them, too, as edit mode would. What is told names objects, which the artist
    sees, and not the mesh.
    """
    mesh = flattened()
    mesh.name = "Mesh of all"
    if mend == "remove_doubles":
        duplicated(mesh)
    glass = new_object(mesh, "GLASS")
    for _ in range(n):
        new_object(mesh)
    assert getattr(bpy.ops.kiriko, mend)(part=glass.name) == {"FINISHED"}
    said = capfd.readouterr().out
    assert ("Also changed" in said) == bool(n)
    assert f"Also changed, having the same data: {others}." in said or not n
    assert "Mesh of all" not in said


@pytest.mark.parametrize("mend", [*MENDS, "thicken", "select_faults"])
def test_a_mesh_without_faces_is_not_mended(scene, mend):
    """Nothing would change, and a success would be told."""
    glass = new_object(bpy.data.meshes.new("empty"), "GLASS")
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="'thing' has no faces that can be mended"):
        getattr(bpy.ops.kiriko, mend)(part=glass.name)
    assert not glass.modifiers
    assert bpy.context.mode == "OBJECT"


def test_a_turned_profile_is_shaded_smooth(scene):
    """It has no faces of its own: the modifier's are smooth."""
    profile = bpy.data.meshes.new("profile")
    profile.from_pydata([(0.01, 0, 0), (0.02, 0, 0.03)], [(0, 1)], [])
    glass = new_object(profile, "GLASS")
    glass.modifiers.new("Screw", "SCREW").use_smooth_shade = False
    assert bpy.ops.kiriko.shade_smooth(part=glass.name) == {"FINISHED"}
    assert glass.modifiers[0].use_smooth_shade


@pytest.mark.parametrize("is_made", [False, True])
def test_faces_that_modifiers_make_flat_are_told(scene, capfd, is_made: bool) -> None:
    """Shade Smooth changes the object's own alone."""
    mesh = primitive("uvsphere", u_segments=32, v_segments=16, radius=0.03)
    glass = new_object(mesh, "GLASS")
    if is_made:
        tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        ball = tree.nodes.new("GeometryNodeMeshUVSphere")
        tree.links.new(ball.outputs["Mesh"], tree.nodes.new("NodeGroupOutput").inputs[0])
        glass.modifiers.new("nodes", "NODES").node_group = tree
    assert bpy.ops.kiriko.shade_smooth(part=glass.name) == {"FINISHED"}
    said = capfd.readouterr().out
    assert "is shaded smooth now" in said
    assert ("512 faces that modifiers make are still flat" in said) == is_made


def test_a_turned_profile_is_turned_out(look: Callable[[], list]) -> None:
    """It has no faces of its own: the modifier turns them round."""
    profile = bpy.data.meshes.new("profile")
    across, up = np.array([0.0, 0.03, 0.03, 0.01]), np.array([0.0, 0.0, 0.05, 0.05])
    points = np.stack([across, np.zeros(4), up], axis=1)
    profile.from_pydata(points.tolist(), list(pairwise(range(4))), [])
    glass = new_object(profile, "GLASS")
    glass.kiriko.use_ior = True
    screw = glass.modifiers.new("Screw", "SCREW")
    screw.use_merge_vertices, screw.merge_threshold = True, 1e-5

    words = "The faces of 'thing' look into the glass"
    press(look(), words, "Turn Out")
    bpy.context.view_layer.update()
    assert words not in " ".join(told(look()))
    assert "'thing' is not closed" in " ".join(told(look()))


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
    chosen = importlib.import_module(f"{kiriko.__name__}.core.blender.chosen_product")
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

    press(look(), "'thing' is no glass", "Make It Glass")
    assert "A modifier sets it, after 'nodes'," in capfd.readouterr().out
    assert not any("is no glass" in text for text in told(look()))
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
    assert any("is no glass" in text for text in told(look()))
    set_by_nodes(glass, glass_material("set", 1.6))
    (setter,) = (one for one in bpy.data.node_groups["nodes"].nodes if "SET" in one.type)
    assert told(look()) == []
    with pytest.raises(RuntimeError, match="Select glass whose material does not refract"):
        bpy.ops.kiriko.make_glass(part=glass.name)

    inputs = setter.inputs["Material"].default_value.node_tree.nodes["Principled BSDF"].inputs
    inputs["Transmission Weight"].default_value = 0.0
    assert any("is no glass" in text for text in told(look()))


def duplicated(mesh: bpy.types.Mesh, n: int | None = None, along: float = 0.0) -> bpy.types.Mesh:
    """A mesh with its first n faces twice, all by default, as by Shift D in edit mode."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.faces.ensure_lookup_table()
    copies = bmesh.ops.duplicate(shape, geom=shape.faces[:n])["geom"]
    for one in copies:
        if isinstance(one, bmesh.types.BMVert):
            one.co.x += along
    shape.to_mesh(mesh)
    shape.free()
    return mesh


@pytest.mark.parametrize("n", [None, 1, 4])
def test_faces_that_are_there_twice_are_told_and_removed(
    look: Callable[[], list], n: int | None
) -> None:
    """As a whole, where the mesh is closed still, or in part, where its edges count as open. What
    is left is the mesh of before.
    """
    mesh = duplicated(primitive("cube", size=0.05), n)
    thing = new_object(mesh, "GLASS")
    thing.kiriko.use_ior = True
    result = bpy.context.scene.kiriko.result
    result.summary = "As Add Rig told."
    words = f"'thing' has {n or 6} face{'s' if n != 1 else ''} twice"
    assert labels_of(look(), words) == ["Select", "Remove"]
    press(look(), words, "Select")
    assert result.summary
    shape = bmesh.from_edit_mesh(mesh)
    assert [face.select for face in shape.faces] == [False] * 6 + [True] * (n or 6)
    bpy.ops.object.mode_set(mode="OBJECT")

    press(look(), words, "Remove")
    assert not result.summary
    assert (len(mesh.vertices), len(mesh.edges), len(mesh.polygons)) == (8, 12, 6)
    assert not any(t in text for text in told(look()) for t in ("twice", "not closed"))


def test_a_body_and_its_inside_in_one_place_are_doubles(look: Callable[[], list]) -> None:
    """A copy whose faces look the other way; and no bodies that touch, as bricks do: each of these
    is glass.
    """
    mesh = duplicated(primitive("cube", size=0.05))
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.faces.ensure_lookup_table()
    bmesh.ops.reverse_faces(shape, faces=shape.faces[6:])
    shape.to_mesh(mesh)
    shape.free()
    thing = new_object(mesh, "GLASS")
    thing.kiriko.use_ior = True
    assert "twice" in " ".join(told(look()))

    thing.data = duplicated(primitive("cube", size=0.0625), along=0.0625)
    bpy.context.view_layer.update()
    assert "twice" not in " ".join(told(look()))


def test_a_body_twice_beside_another_is_a_double(look: Callable[[], list]) -> None:
    """Its copy looks inward, and a brick that is there once stands beside both."""
    mesh = duplicated(primitive("cube", size=0.05))
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.faces.ensure_lookup_table()
    bmesh.ops.reverse_faces(shape, faces=shape.faces[6:])
    bmesh.ops.create_cube(shape, size=0.01, matrix=Matrix.Translation((0.06, 0.0, 0.0)))
    shape.to_mesh(mesh)
    shape.free()
    thing = new_object(mesh, "GLASS")
    thing.kiriko.use_ior = True
    press(look(), "has 6 faces twice", "Remove")
    assert len(mesh.polygons) == 12
    assert not any(t in text for text in told(look()) for t in ("twice", "not closed"))


def test_fine_faces_far_from_the_origin_are_no_doubles(look: Callable[[], list]) -> None:
    """Around the poles their corners lie as near to each other there as numbers are rounded."""
    mesh = primitive("uvsphere", u_segments=256, v_segments=128, radius=0.02)
    mesh.transform(Matrix.Translation((30.0, 30.0, 0.0)))
    new_object(mesh, "GLASS").kiriko.use_ior = True
    assert told(look())
    assert "twice" not in " ".join(told(look()))


@pytest.mark.parametrize("mend", ["remove_doubles", "merge_flat"])
def test_where_nothing_is_left_to_mend_nothing_is_changed(mend: str) -> None:
    """As by a button of a list that is out of date: no modifier is made."""
    thing = new_object(primitive("cube", size=0.05), "GLASS")
    with pytest.raises(RuntimeError, match="has no such faces any more"):
        getattr(bpy.ops.kiriko, mend)(part=thing.name)
    assert not thing.modifiers


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_faces_without_area_are_no_doubles(look: Callable[[], list]) -> None:
    """As bevels of a narrow strip leave them: two in one place are told as what they are alone."""
    mesh = primitive("cube", size=0.0625)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    for _ in range(2):
        shape.faces.new([shape.verts.new((0.0, 0.0, 0.01 * min(k, 1))) for k in range(3)])
    shape.to_mesh(mesh)
    shape.free()
    thing = new_object(mesh, "GLASS")
    thing.kiriko.use_ior = True
    assert "'thing' has 2 triangles without area." in told(look())
    assert "twice" not in " ".join(told(look()))


@pytest.mark.parametrize(
    "turn",
    [Matrix.Scale(-1.0, 4, (1, 0, 0)), Matrix.Rotation(2 * np.pi * 5 / 24, 4, "Z")],
    ids=["mirrored", "turned"],
)
def test_a_copy_that_is_turned_onto_its_mesh_is_a_double(
    look: Callable[[], list], turn: Matrix
) -> None:
    """By rounding its vertices are not quite in the places of the others."""
    mesh = primitive("uvsphere", radius=0.05, u_segments=24, v_segments=12)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    copies = bmesh.ops.duplicate(shape, geom=shape.faces[:])["geom"]
    points = [one for one in copies if isinstance(one, bmesh.types.BMVert)]
    bmesh.ops.transform(shape, matrix=turn, verts=points)
    shape.to_mesh(mesh)
    shape.free()
    n = len(mesh.polygons) // 2
    thing = new_object(mesh, "GLASS")
    thing.kiriko.use_ior = True
    press(look(), f"has {n} faces twice", "Remove")
    assert len(mesh.polygons) == n
    assert not any(t in text for text in told(look()) for t in ("twice", "not closed"))


def test_doubles_of_modifiers_are_welded(look: Callable[[], list]) -> None:
    """A cube that is mirrored onto itself: nothing of its own mesh is there twice."""
    thing = new_object(primitive("cube", size=0.0625), "GLASS")
    thing.kiriko.use_ior = True
    mirror = thing.modifiers.new("Mirror", "MIRROR")
    mirror.use_mirror_merge = False
    bpy.context.view_layer.update()
    assert labels_of(look(), "has 6 faces twice") == ["Remove"]
    press(look(), "has 6 faces twice", "Remove")
    bpy.context.view_layer.update()
    assert not any(t in text for text in told(look()) for t in ("twice", "not closed"))


def klein_bottle(n: int = 32, m: int = 16) -> bpy.types.Mesh:
    """A tube, whose outline is an eight, around a circle, turned by half a turn meanwhile."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    sin, cos = np.sin(u / 2), np.cos(u / 2)
    out = 0.02 + 0.006 * (cos * np.sin(v) - sin * np.sin(2 * v))
    up = 0.006 * (sin * np.sin(v) + cos * np.sin(2 * v))
    points = np.stack([out * np.cos(u), out * np.sin(u), up], axis=-1).reshape(-1, 3)
    number = lambda i, j: (i % n) * m + (j if i < n else -j) % m  # noqa: E731
    faces = [
        (number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1))
        for i in range(n)
        for j in range(m)
    ]
    mesh = bpy.data.meshes.new("bottle")
    mesh.from_pydata(points.tolist(), [], faces)
    return mesh


def test_a_klein_bottle_has_no_inside(look: Callable[[], list]) -> None:
    """It is closed, and told all the same, beside a loose face, too; walls have an inside. So has
    any other shape, however its faces were drawn.
    """
    thing = new_object(klein_bottle(), "GLASS")
    thing.kiriko.use_ior = True
    words = "'thing' has no inside: its surface has one side only"
    assert not any("not closed" in text for text in told(look()))
    alone = thing.data
    thing.data = alone.copy()
    shape = bmesh.new()
    shape.from_mesh(alone)
    shape.faces.new([shape.verts.new((0.1, 0.01 * (k == 1), 0.01 * k)) for k in range(3)])
    shape.to_mesh(thing.data)
    shape.free()
    bpy.context.view_layer.update()
    assert labels_of(look(), words) == ["Select Part", "Thicken"]
    assert any("not closed" in text for text in told(look()))
    thing.data = alone
    bpy.context.view_layer.update()
    assert labels_of(look(), words) == ["Select Part", "Thicken"]
    press(look(), words, "Thicken")
    bpy.context.view_layer.update()
    assert words not in " ".join(told(look()))

    mesh = primitive("icosphere", subdivisions=2, radius=0.03)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.reverse_faces(shape, faces=list(shape.faces)[::3])
    shape.to_mesh(mesh)
    shape.free()
    thing.modifiers.clear()
    thing.data = mesh
    bpy.context.view_layer.update()
    assert words not in " ".join(told(look()))


def test_a_collection_of_opaque_things_is_no_glass(look: Callable[[], list]) -> None:
    """The default index is taken for it; its objects are in no rig, and get a material by hand."""
    group = bpy.data.collections.new("Stones")
    stone = bpy.data.objects.new("Stone", primitive("cube", size=0.03))
    group.objects.link(stone)
    shown = new_object(None, "GLASS")
    shown.name = "Shown"
    shown.instance_type, shown.instance_collection = "COLLECTION", group
    bpy.context.view_layer.update()
    words = "'Shown' is no glass: give the objects of its collection"
    assert labels_of(look(), words) == ["Select Part"]
    shown.kiriko.use_ior = True
    assert words not in " ".join(told(look()))
    shown.kiriko.use_ior = False
    stone.data.materials.append(glass_material("clear", 1.5))
    bpy.context.view_layer.update()
    assert words not in " ".join(told(look()))


def test_a_tube_gets_caps(look: Callable[[], list]) -> None:
    """A bevelled curve that is open at its ends is closed by its own caps, and stays solid."""
    curve = bpy.data.curves.new("tube", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.012
    spline = curve.splines.new("POLY")
    spline.points.add(3)
    for k, point in enumerate(spline.points):
        point.co = (0.02 * k, 0.005 * k * k, 0.0, 1.0)
    tube = new_object(curve, "GLASS")
    tube.kiriko.use_ior = True

    words = "'thing' is not closed"
    assert labels_of(look(), words) == ["Select Part", "Cap Ends", "Thicken"]
    press(look(), words, "Cap Ends")
    assert curve.use_fill_caps
    assert words not in " ".join(told(look()))

    # one without ends has nothing to cap
    curve.use_fill_caps, spline.use_cyclic_u = False, True
    assert words not in " ".join(told(look()))


@pytest.mark.parametrize("fill", ["FULL", "HALF", "FRONT", "BACK"])
@pytest.mark.parametrize("bevel", ["ROUND", "PROFILE", "closed", "open"])
def test_caps_are_offered_to_tubes_that_they_close(
    look: Callable[[], list], bevel: str, fill: str
) -> None:
    """No half of a tube, and none along an open outline, which caps would leave open."""
    curve = bpy.data.curves.new("tube", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.fill_mode = "3D", 0.012, fill
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[1].co.x = 0.05
    if bevel in {"closed", "open"}:
        outline = bpy.data.curves.new("outline", "CURVE")
        path = outline.splines.new("POLY")
        path.points.add(2)
        for point, place in zip(path.points, ((0.0, 0.0), (0.01, 0.0), (0.0, 0.01)), strict=True):
            point.co.xy = place
        path.use_cyclic_u = bevel == "closed"
        curve.bevel_mode, curve.bevel_object = "OBJECT", new_object(outline)
    else:
        curve.bevel_mode = bevel
    tube = new_object(curve, "GLASS")
    tube.kiriko.use_ior = True

    is_offered = "Cap Ends" in labels_of(look(), f"'{tube.name}' is not closed")
    curve.use_fill_caps = True
    curve.update_tag()
    bpy.context.view_layer.update()
    assert is_offered == (f"'{tube.name}' is not closed" not in " ".join(told(look())))


def test_loose_faces_go(kiriko: ModuleType, look: Callable[[], list]) -> None:
    """Two triangles, one on the other, hang on an edge of a closed cube, as after a cut:
    Fill Holes takes them away, and has no hole to fill.
    """
    mesh = primitive("cube", size=SIDE)
    glass = new_object(mesh, "GLASS")
    glass.kiriko.use_ior = True
    before = [tuple(vertex.co) for vertex in mesh.vertices]
    hang(mesh)
    assert set(labels_of(look(), "is not closed: 4 edges")) == {"Select", "Fill Holes", "Thicken"}
    press(look(), "is not closed", "Fill Holes")
    assert "is not closed" not in " ".join(told(look()))
    assert [tuple(vertex.co) for vertex in mesh.vertices] == before
    assert len(mesh.polygons) == 6

    # where one side of the cube is gone they are what is left of it
    flaps = importlib.import_module(f"{kiriko.__name__}.core.blender.flaps")
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.edges.ensure_lookup_table()
    bmesh.ops.delete(shape, geom=[shape.edges[0].link_faces[0]], context="FACES_ONLY")
    shape.to_mesh(mesh)
    hang(mesh)
    shape.clear()
    shape.from_mesh(mesh)
    assert flaps.take_flaps(shape) == 0
    shape.free()


def beside(mesh: bpy.types.Mesh, n: int, size: float) -> bpy.types.Mesh:
    """A mesh with loose squares beside it."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    for k in range(n):
        square = bmesh.ops.create_grid(shape, x_segments=1, y_segments=1, size=size / 2)["verts"]
        bmesh.ops.translate(shape, verts=square, vec=(0.0, 0.1 + 0.02 * k, 0.0))
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def test_loose_bits_of_a_scan_go(look: Callable[[], list]) -> None:
    """They hang on nothing; the holes are filled. Where they are more than scraps, nothing goes."""
    glass = new_object(beside(holed_cube(), 3, 0.004), "GLASS")
    glass.kiriko.use_ior = True
    press(look(), "is not closed", "Fill Holes")
    assert "is not closed" not in " ".join(told(look()))
    assert len(glass.data.polygons) == 6

    glass.data = beside(holed_cube(), 1, 0.1)
    n = len(glass.data.polygons)
    bpy.context.view_layer.update()
    press(look(), "is not closed", "Fill Holes")
    assert len(glass.data.polygons) >= n


def hang(mesh: bpy.types.Mesh) -> None:
    """Two triangles on an edge of a mesh, the second one on the first."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.edges.ensure_lookup_table()
    a, b = shape.edges[0].verts
    out = [shape.verts.new(k * (a.co + b.co)) for k in (0.7, 0.9)]
    shape.faces.new((a, b, out[0]))
    shape.faces.new((b, out[1], out[0]))
    shape.to_mesh(mesh)
    shape.free()


def test_loose_faces_of_a_boolean_go(kiriko: ModuleType, look: Callable[[], list]) -> None:
    """A cube that an open sheet cuts halfway through keeps the half in it, an eighth of a side:
    it is inside, and no gap. Remove leaves a closed cube of the same volume.
    """
    mesh = primitive("cube", size=SIDE)
    glass, sheet = new_object(mesh, "GLASS"), new_object(primitive("grid", size=0.5 * SIDE))
    glass.kiriko.use_ior = True
    sheet.location, sheet.rotation_euler = (0.5 * SIDE, 0.0, 0.2 * SIDE), (0.3, 0.2, 0.0)
    cut = glass.modifiers.new("Cut", "BOOLEAN")
    cut.object = sheet
    cut.solver = "FAST" if bpy.app.version < (5, 0, 0) else "FLOAT"
    with bpy.context.temp_override(object=glass):
        bpy.ops.object.modifier_apply(modifier="Cut")
    shape = bmesh.new()
    shape.from_mesh(mesh)
    assert sum(edge.is_boundary for edge in shape.edges) == 3
    assert "is not closed" not in " ".join(told(look()))
    press(look(), "inside", "Remove")
    assert "inside" not in " ".join(told(look()))
    shape.clear()
    shape.from_mesh(mesh)
    assert shape.calc_volume() == pytest.approx(SIDE**3, rel=1e-6)
    shape.free()


def bowl_on_base(angle: float, base: float) -> bpy.types.Mesh:
    """A bowl of one surface, with its rim at this polar angle, on a solid cylinder whose upper edge
    is the bowl's lower one.

    base : height of the cylinder, in radii of the bowl
    """
    n = 16
    rings = [
        [(np.sin(a), -np.cos(a)) for a in np.linspace(0.5, angle, 9)],
        [(np.sin(0.5), -np.cos(0.5) - base)],
    ]
    shape = bmesh.new()
    made = [
        [
            shape.verts.new((SIDE * r * np.cos(t), SIDE * r * np.sin(t), SIDE * z))
            for t in np.arange(n) * 2 * np.pi / n
        ]
        for r, z in [*rings[1], *rings[0]]
    ]
    for low, high in pairwise(made):
        for k in range(n):
            shape.faces.new((low[k - 1], low[k], high[k], high[k - 1]))
    shape.faces.new(made[1])
    shape.faces.new(made[0][::-1])
    mesh = bpy.data.meshes.new("bowl")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


@pytest.mark.parametrize("angle", [0.8, 1.57, 2.5])
@pytest.mark.parametrize("base", [0.2, 3.0])
def test_a_bowl_on_a_solid_base_is_not_loose(
    look: Callable[[], list], angle: float, base: float
) -> None:
    """Whether it is a tenth of the area or nearly all, Fill Holes closes its mouth."""
    mesh = bowl_on_base(angle, base)
    glass = new_object(mesh, "GLASS")
    glass.kiriko.use_ior = True
    n = len(mesh.polygons)
    press(look(), "is not closed", "Fill Holes")
    assert len(mesh.polygons) == n + 1


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


USES = {"DIFFERENCE": "it cuts", "UNION": "it is joined to", "INTERSECT": "it bounds"}


@pytest.mark.usefixtures("no_remedies")
@pytest.mark.parametrize("operation", USES)
def test_a_tool_that_is_left_out_is_told(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture, operation: str
) -> None:
    """By Add Rig, in the panel as well, with what it does to the glass."""
    glass, tool = (new_object(primitive("cube", size=side)) for side in (0.05, 0.02))
    glass.name, tool.name = "Block", "Tool"
    tool.location.z, tool.display_type = 0.02, "WIRE"
    modifier = glass.modifiers.new("Cut", "BOOLEAN")
    modifier.object, modifier.operation = tool, operation
    for thing in (glass, tool):
        thing.select_set(True)
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    assert bpy.ops.kiriko.add_rig(**small) == {"FINISHED"}
    told = f"Left out: 'Tool' ({USES[operation]} 'Block')."
    assert told in capfd.readouterr().out
    assert told in scene.kiriko.result.summary
    assert [thing.kiriko.role for thing in (glass, tool)] == ["GLASS", "NONE"]


@pytest.mark.usefixtures("no_remedies")
def test_bodies_that_cut_each_other_are_glass(scene: bpy.types.Scene) -> None:
    """Each is the other's tool, and none a mere tool; one that cuts a tool of glass is one."""
    first, second, third, last = (new_object(primitive("cube", size=0.02)) for _ in range(4))
    for k, (thing, tool) in enumerate(((first, second), (second, first), (second, third))):
        thing.modifiers.new("Cut", "BOOLEAN").object = tool
        thing.location.x = 0.015 * k
    third.modifiers.new("Cut", "BOOLEAN").object = last
    for thing in (first, second, third, last):
        thing.display_type = "WIRE"
        thing.select_set(True)
    small = {"viewer_resolution": 32, "display_resolution": (32, 32)}
    assert bpy.ops.kiriko.add_rig(**small) == {"FINISHED"}
    roles = [thing.kiriko.role for thing in (first, second, third, last)]
    assert roles == ["GLASS", "GLASS", "NONE", "NONE"]


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
    said = "'Block' is hidden by its eye symbol (H), and nothing is selected: the rig is around a"
    assert (said in capfd.readouterr().out) == is_hidden
    assert (said in scene.kiriko.result.summary) == is_hidden
