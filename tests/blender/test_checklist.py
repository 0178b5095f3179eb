"""The checklist: each thing to do is told, and its button does it."""

import importlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from types import ModuleType, SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest

from panel_layout import Layout, told
from small_rigs import SIDE, cube, new_object, pixels, primitive, small_rig

# the main buttons of the first panel, above the checklist
MAIN = ["kiriko.solve", "kiriko.live", "kiriko.look_through", "kiriko.open_picture"]


def press(entries: list, words: str, n: int = 0) -> object:
    """Press a button of the one entry that has these words, by its properties as drawn."""
    (entry,) = (entry for entry in entries if words in entry.text)
    button = entry.buttons[n]
    group, verb = button.operator.split(".")
    assert getattr(getattr(bpy.ops, group), verb)(**dict(button.properties)) == {"FINISHED"}
    return button


def glass_of(mesh: bpy.types.Mesh) -> bpy.types.Object:
    """The glass of a small rig, with this mesh."""
    glass = small_rig()["GLASS"]
    glass.data = mesh
    return glass


def holed() -> bpy.types.Mesh:
    """A cube of five by five quads a side, without two quads that are no neighbours."""
    mesh = primitive("cube", size=SIDE)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=4, use_grid_fill=True)
    by_height = sorted(shape.faces, key=lambda face: face.calc_center_median()[:])
    start, far = by_height[0], by_height[-1]
    bmesh.ops.delete(shape, geom=[start, far], context="FACES_ONLY")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


@pytest.mark.parametrize("role", ["GLASS", "PICTURE"])
def test_a_shape_that_is_edited_is_not_called_ready(
    look: Callable[[], list], drawn: Callable[..., Layout], role: str
) -> None:
    """It is looked at as edit mode ends: open edges that are selected there are no less open."""
    thing = small_rig()[role]
    look()
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    texts = drawn("main_panel", "VIEW3D_PT_kiriko_main", thing).texts
    assert ("leave Edit Mode" in " ".join(texts)) == (role == "GLASS")
    assert ("Ready: press Solve." in texts) == (role == "PICTURE")
    bpy.ops.object.mode_set(mode="OBJECT")
    texts = drawn("main_panel", "VIEW3D_PT_kiriko_main", thing).texts
    assert texts == ["Ready: press Solve."]


def test_a_rig_with_nothing_to_do_is_ready(
    look: Callable[[], list], drawn: Callable[..., Layout]
) -> None:
    """One line, with the next button's name before there is a result."""
    small_rig()
    assert told(look()) == []
    assert drawn("main_panel", "VIEW3D_PT_kiriko_main").texts == ["Ready: press Solve."]
    bpy.ops.kiriko.solve()
    entries = look()
    assert all(entry.icon == "INFO" for entry in entries)
    assert not [text for text in told(entries) if "saved" in text]  # Export asks for a place


def test_opaque_glass_is_made_glass(look: Callable[[], list]) -> None:
    """By its own button, whatever is selected."""
    parts = small_rig()
    parts["GLASS"].kiriko.use_ior = False
    bpy.context.view_layer.objects.active = parts["PLATE"]
    press(look(), "The material of 'Cube' isn't glass.")
    assert parts["GLASS"].material_slots[0].material.name == "Kiriko Glass"
    assert told(look()) == []


def test_glass_of_two_metres_is_twenty_millimetres(look: Callable[[], list]) -> None:
    """Nothing moves: the scene's unit is another one."""
    glass = cube(2.0)
    glass.kiriko.role, glass.kiriko.use_ior = "GLASS", True
    bpy.context.view_layer.update()
    before = glass.matrix_world.copy()
    entries = look()
    assert "'Cube' measures 2 m. Did you mean 20 mm or 200 mm?" in told(entries)
    (entry,) = (entry for entry in entries if "Did you mean" in entry.text)
    assert [dict(button.properties)["factor"] for button in entry.buttons] == [0.01, 0.1]
    assert [str(button.label) for button in entry.buttons] == [
        "Scale Scene to 1/100",
        "Scale Scene to 1/10",
    ]
    press(entries, "Did you mean")
    units = bpy.context.scene.unit_settings
    assert units.scale_length == pytest.approx(0.01)
    assert units.length_unit == "MILLIMETERS"
    assert (glass.matrix_world, tuple(glass.scale)) == (before, (1, 1, 1))
    assert not [text for text in told(look()) if "Did you mean" in text]


@pytest.mark.parametrize(
    ("width", "meant"),
    [
        (0.51, [0.051]),
        (1, [0.01, 0.1]),
        (1.8, [0.018, 0.18]),
        (2, [0.02, 0.2]),
        (3, [0.03, 0.3]),
        (5, [0.05]),
        (30, [0.03, 0.3]),
        (99, [0.099]),
        (200, [0.2, 0.02]),
        (800, [0.08]),
        (3000, [0.03, 0.3]),
    ],
)
def test_the_width_that_was_meant(core: ModuleType, width: float, meant: list[float]) -> None:
    """Powers of ten that give 10 to 300 mm, the smallest first; millimetres taken for metres come
    before it. No proposal is over 500 mm, so that none asks again.
    """
    checklist = importlib.import_module(f"{core.__name__}.blender.checks.checklist")
    factors = checklist.meant_factors(width)
    assert [width * factor for factor in factors] == pytest.approx(meant)


def test_a_hidden_part_is_shown(look: Callable[[], list]) -> None:
    """One that the rig needs is a problem, another one is told."""
    parts = small_rig()
    parts["DISPLAY"].hide_viewport = True
    other = new_object(primitive("cube", size=0.01), "BLOCKER")
    other.hide_render = True
    entries = look()
    icons = {entry.text: entry.icon for entry in entries}
    assert icons == {
        "The display 'Kiriko Display' is hidden in the viewport by its monitor icon: show"
        " it.": "ERROR",
        "'thing' is hidden in renders by its camera icon and ignored.": "INFO",
    }
    press(entries, "The display")
    press(entries, "'thing'")
    assert told(look()) == []
    assert bpy.ops.kiriko.solve.poll()


OPEN = "'Cube' is not closed: 8 open edges (Select > All by Trait > Non Manifold)."


@pytest.mark.parametrize("is_split", [False, True])
def test_holes_are_filled_with_faces_that_look_out(
    look: Callable[[], list], is_split: bool
) -> None:
    """As many edges are told as the mesh that is edited has, though a modifier makes more of them;
    also where its squares share no vertices. The volume, whose sign is that of the faces, is that
    of the cube.
    """
    glass = glass_of(holed())
    glass.modifiers.new("finer", "SUBSURF").subdivision_type = "SIMPLE"
    if is_split:
        shape = bmesh.new()
        shape.from_mesh(glass.data)
        inner = [edge for edge in shape.edges if not edge.is_boundary]
        bmesh.ops.split_edges(shape, edges=inner)
        shape.to_mesh(glass.data)
        shape.free()
    assert told(look()) == [OPEN]
    press(look(), "not closed")
    assert told(look()) == []
    assert bpy.context.scene.kiriko.result.summary == ""  # of the light with gaps
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    assert shape.calc_volume(signed=True) == pytest.approx(SIDE**3, rel=1e-5)
    shape.free()


@pytest.mark.parametrize("n", [6, 1])
def test_faces_that_are_partly_twice_are_merged(look: Callable[[], list], n: int) -> None:
    """As by Shift D in edit mode where nothing is moved: a whole body twice is one, and is ready;
    a part of it leaves open edges, and is merged by distance.
    """
    mesh = primitive("cube", size=SIDE)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    shape.faces.ensure_lookup_table()
    bmesh.ops.duplicate(shape, geom=shape.faces[:n])
    shape.to_mesh(mesh)
    shape.free()
    glass_of(mesh)
    if n == 1:
        press(look(), "not closed: 4 open edges")
        assert len(mesh.polygons) == 6
    assert told(look()) == []


def test_edges_that_a_modifier_opens_are_not_in_the_mesh(look: Callable[[], list]) -> None:
    """Its own mesh is closed: the part is selected, and nothing filled."""
    glass = glass_of(primitive("cube", size=SIDE))
    glass.modifiers.new("m", "MASK").vertex_group = glass.vertex_groups.new(name="g").name
    glass.vertex_groups["g"].add(range(6), 1.0, "REPLACE")
    (entry,) = (entry for entry in look() if "not closed" in entry.text)
    verbs = [button.operator for button in entry.buttons]
    assert verbs == ["kiriko.select_part", "kiriko.thicken"]


def test_a_mesh_of_another_file_or_without_faces_is_not_mended(
    look: Callable[[], list], linked: Callable[..., bpy.types.ID]
) -> None:
    """Changed here the one would be as before once the file is opened again."""
    glass = glass_of(holed())
    glass.data = linked(glass.data)
    empty = new_object(bpy.data.meshes.new("empty"), "GLASS")
    for verb in ("fill_holes", "turn_out", "shade_smooth", "smooth_glass"):
        with pytest.raises(
            RuntimeError, match="'Cube' is linked from another file: change it there"
        ):
            getattr(bpy.ops.kiriko, verb)(part=glass.name)
        with pytest.raises(RuntimeError, match="'thing' has no faces of its own"):
            getattr(bpy.ops.kiriko, verb)(part=empty.name)


@pytest.mark.parametrize("kind", ["wall", "hanging"])
def test_faces_within_a_closed_body_are_no_gaps(look: Callable[[], list], kind: str) -> None:
    """A wall through a cube, or a face that hangs into it: the light is that of the body without
    it; the checklist names it and Blender's way to select it.
    """
    glass = glass_of(primitive("cube", size=SIDE))
    bpy.ops.kiriko.solve()
    plain = pixels(bpy.context.scene.kiriko.result.source)
    shape = bmesh.new()
    shape.from_mesh(glass.data)
    made = bmesh.ops.bisect_plane(
        shape,
        geom=[*shape.verts, *shape.edges, *shape.faces],
        plane_co=(0, 0.1 * SIDE, 0),
        plane_no=(0.1, 1, 0.2),
    )
    rim = [one for one in made["geom_cut"] if isinstance(one, bmesh.types.BMEdge)]
    if kind == "hanging":
        shape.faces.new([*rim[0].verts, shape.verts.new((0, 0, 0))])
    else:
        bmesh.ops.edgeloop_fill(shape, edges=rim)
    mesh = glass.data.copy()
    shape.to_mesh(mesh)
    shape.free()
    glass.data = mesh
    (entry,) = look()
    assert entry.text.startswith("'Cube' has 1 interior face.")
    assert "Interior Faces" in entry.text
    bpy.ops.kiriko.solve()
    result = bpy.context.scene.kiriko.result
    assert (result.notes, result.coverage > 0.999) == (entry.text, True)
    np.testing.assert_allclose(pixels(result.source), plain, atol=2e-3)


def test_open_edges_in_one_place_are_closed(look: Callable[[], list]) -> None:
    """As the solve joins them: faces that share no vertices are one surface."""
    mesh = primitive("cube", size=SIDE)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.split_edges(shape, edges=shape.edges[:])
    shape.to_mesh(mesh)
    shape.free()
    assert len(mesh.vertices) == 24
    glass_of(mesh)
    assert told(look()) == []


def lathe(n_around: int, n_up: int) -> bpy.types.Mesh:
    """A ball of rings of quads, closed at both poles, shaded flat."""
    return primitive("uvsphere", u_segments=n_around, v_segments=n_up, radius=SIDE / 2)


def test_a_curve_that_is_shaded_flat_is_told(look: Callable[[], list]) -> None:
    """A ball as Blender adds it. Its button has no face flat and no edge sharp, and then nothing
    is told; nor where the facets are wanted.
    """
    glass = glass_of(lathe(32, 16))
    assert told(look()) == ["'Cube' looks curved, but its 512 faces are flat."]
    glass.kiriko.surface = "FACETS"
    assert told(look()) == []
    glass.kiriko.surface = "AUTOMATIC"
    press(look(), "looks curved")
    assert told(look()) == []
    mesh = glass.data
    assert all(polygon.use_smooth for polygon in mesh.polygons)
    assert not any(edge.use_edge_sharp for edge in mesh.edges)


def test_sharp_edges_of_a_curve_stay_sharp(look: Callable[[], list]) -> None:
    """A plug of glass: its side becomes smooth, its flat ends keep their edges, and an edge that
    the artist has made sharp is so still.
    """
    mesh = primitive("cone", segments=500, radius1=0.02, radius2=0.02, depth=SIDE, cap_ends=True)
    up = [mesh.vertices[a].co.z != mesh.vertices[b].co.z for a, b in mesh.edge_keys]
    mesh.edges[up.index(True)].use_edge_sharp = True
    glass = glass_of(mesh)
    press(look(), "its 500 faces are flat")
    is_sharp = [edge.use_edge_sharp for edge in glass.data.edges]
    assert [k for k, one in enumerate(is_sharp) if one and up[k]] == [up.index(True)]
    assert sum(is_sharp) == 1001
    assert told(look()) == []


def cut_crystal() -> bpy.types.Mesh:
    """A cube whose sides are many coplanar quads, and whose edges are bevelled in eight steps."""
    mesh = primitive("cube", size=SIDE)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.bevel(shape, geom=shape.edges[:], offset=SIDE / 20, segments=8, affect="EDGES")
    large = [face for face in shape.faces if face.calc_area() > SIDE**2 / 2]
    bmesh.ops.subdivide_edges(
        shape, edges=[e for f in large for e in f.edges], cuts=9, use_grid_fill=True
    )
    shape.to_mesh(mesh)
    shape.free()
    return mesh


@pytest.mark.parametrize(
    "mesh",
    [
        lambda: lathe(16, 8),  # 128 facets at 22 degrees
        lambda: primitive("icosphere", subdivisions=3, radius=SIDE / 2),  # a ball of 320 facets
        lambda: primitive("cone", segments=32, radius1=0.02, radius2=0.02, depth=SIDE,
                          cap_ends=True),
        cut_crystal,
    ],
)  # fmt: skip
def test_cut_glass_is_left_alone(
    look: Callable[[], list], mesh: Callable[[], bpy.types.Mesh]
) -> None:
    """Few facets, facets at large angles, and flat sides however finely they are divided."""
    glass_of(mesh())
    assert told(look()) == []


def test_flat_glass_gets_a_thickness(look: Callable[[], list]) -> None:
    """By a modifier; one that is scaled to nothing is named with Blender's remedy."""
    glass = glass_of(primitive("grid", x_segments=2, y_segments=2, size=SIDE))
    press(look(), "'Cube' is flat")
    assert told(look()) == []
    assert min(glass.dimensions) == pytest.approx(0.1 * max(glass.dimensions), rel=1e-3)
    glass.scale[2] = 0
    press(look(), "'Cube' has a scale of zero. Use Object > Clear > Scale.")
    bpy.ops.object.scale_clear()
    assert told(look()) == []


def test_glass_whose_faces_look_inwards_is_turned(look: Callable[[], list]) -> None:
    """Closed glass needs no such thing: Kiriko finds its inside. Cycles does not: whoever looks
    through the viewer is told.
    """
    words = "The normals of 'Cube' point inward."
    mesh = primitive("cube", size=SIDE)
    mesh.flip_normals()
    glass_of(mesh)
    assert told(look()) == []
    bpy.ops.kiriko.look_through()
    press(look(), words)
    assert words not in told(look())
    bpy.ops.kiriko.look_through()

    mesh = holed()
    mesh.flip_normals()
    bpy.data.objects["Cube"].data = mesh
    press(look(), words)
    assert told(look()) == [OPEN]


@pytest.mark.parametrize("scale", [(1, 1, 2), (-1, 1, 1), (-1, -1, -0.5)])
def test_a_scale_that_does_no_harm_is_no_matter(
    look: Callable[[], list], scale: tuple[float, ...]
) -> None:
    """Uneven and negative ones are followed as they are."""
    small_rig()["GLASS"].scale = scale
    assert told(look()) == []


@pytest.mark.parametrize("setting", ["location", "rotation_euler", "scale"])
def test_a_part_whose_place_is_no_number_is_refused(look: Callable[[], list], setting: str) -> None:
    """As a script or a driver may leave it: the solve says what to reset."""
    glass = small_rig()["GLASS"]
    setattr(glass, setting, [nan, *getattr(glass, setting)[1:]])
    bpy.context.view_layer.update()
    assert look() == []
    with pytest.raises(RuntimeError, match="of 'Cube' is invalid or too large"):
        bpy.ops.kiriko.solve()


def test_two_pictures_are_one_too_many(look: Callable[[], list]) -> None:
    """Each may be left out, and stays where it is."""
    small_rig()
    other = new_object(primitive("grid", x_segments=1, y_segments=1, size=1), "PICTURE")
    entries = look()
    assert "2 objects have the role Picture" in " ".join(told(entries))
    (entry,) = (e for e in entries if "2 objects" in e.text)
    names = [dict(button.properties)["part"] for button in entry.buttons]
    press(entries, "2 objects", names.index(other.name))
    assert other.kiriko.role == "NONE"
    assert told(look()) == []


def test_a_rig_without_viewer_takes_a_camera(look: Callable[[], list]) -> None:
    """One that is in the scene."""
    small_rig()
    viewer = bpy.context.scene.kiriko.viewer
    bpy.context.scene.kiriko.viewer = bpy.context.scene.camera = None
    press(look(), "No viewer")
    assert bpy.context.scene.kiriko.viewer == viewer
    assert told(look()) == []


def test_a_picture_without_an_image_is_told(look: Callable[[], list]) -> None:
    """Nothing chosen, or a file that is not there: the button opens another."""
    picture = small_rig()["PICTURE"]
    texture = next(
        n for n in picture.material_slots[0].material.node_tree.nodes if n.type == "TEX_IMAGE"
    )
    image = bpy.data.images.new("gone", 8, 8)
    image.source, image.filepath = "FILE", "/nowhere/gone.png"
    for chosen, words in ((None, "shows no image"), (image, "gone.png")):
        picture.kiriko.image = None
        texture.image = chosen
        (entry,) = look()
        assert words in entry.text
        assert [button.operator for button in entry.buttons] == ["kiriko.open_picture"]


def test_a_rig_in_the_making_may_be_added(look: Callable[[], list]) -> None:
    """Glass by hand: Add Rig makes the rest; it is offered once, and only as long as it may run."""
    glass = cube()
    glass.kiriko.role, glass.kiriko.use_ior = "GLASS", True
    operators = [b.operator for entry in look() for b in entry.buttons]
    assert operators.count("kiriko.add_rig") == 1
    assert "kiriko.make_part" not in operators  # too little is there to tell where a part stands
    new_object(primitive("grid", x_segments=1, y_segments=1, size=1), "DISPLAY")
    operators = [b.operator for entry in look() for b in entry.buttons]
    assert "kiriko.add_rig" not in operators


def test_a_loss_has_its_remedy_s_place(core: ModuleType) -> None:
    """Operators that mend a loss add their buttons to the table; small losses are let be."""
    checklist = importlib.import_module(f"{core.__name__}.blender.checks.checklist")
    to_do = importlib.import_module(f"{core.__name__}.blender.checks.to_do")
    reason = "missed the plate"
    words, buttons = checklist.REMEDIES[reason]
    assert set(checklist.REMEDIES) >= {"missed the display", "missed the glass"}
    look = to_do.Inspection(misses={reason: 0.03, "missed the display": 1e-4}, is_solved=True)
    (entry,) = checklist.entries(look, str)
    assert entry.text == f"3 % of the picture {reason}: {words}."
    assert entry.buttons == buttons
    assert [button.operator for button in buttons] == [
        "kiriko.fit_plate",
        "kiriko.fit_picture_size",
    ]
    for _, fits in checklist.REMEDIES.values():
        for button in fits:
            getattr(bpy.ops.kiriko, button.operator.split(".")[1]).get_rna_type()


def test_a_loss_is_told_with_the_amounts_that_mend_it(
    look: Callable[[], list], kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a solve that somebody watches, in the scene's unit; the button makes the plate as much
    larger as was told, and then nothing is lost. After a script's solve no amounts were sought.
    """
    parts = small_rig(plate_size=0.03)
    bpy.ops.kiriko.solve()
    (entry,) = (e for e in look() if "missed the plate" in e.text)
    assert not re.search("[0-9] mm", entry.text)
    solve = importlib.import_module(f"{kiriko.__name__}.operators.solve")
    monkeypatch.setattr(solve.KIRIKO_OT_solve, "is_watched", True)
    remedies = importlib.import_module(f"{kiriko.__name__}.operators.remedies")
    monkeypatch.setattr(remedies, "SECONDS", inf)  # however slow the machine is
    units = bpy.context.scene.unit_settings
    units.system, units.length_unit = "METRIC", "MILLIMETERS"
    bpy.ops.kiriko.solve()
    entries = look()
    (entry,) = (e for e in entries if "missed the plate" in e.text)
    operators = [button.operator for button in entry.buttons]
    assert sorted(operators) == ["kiriko.fit_picture_size", "kiriko.fit_plate"]
    more = float(re.search(r"make the plate ([0-9.]+) mm larger", entry.text)[1])
    width = float(re.search(r"make the picture ([0-9.]+) mm wide", entry.text)[1])
    assert 0 < width < 30 < 30 + more < 100

    before = max(parts["PLATE"].dimensions)
    press(entries, "missed the plate", operators.index("kiriko.fit_plate"))
    bpy.context.view_layer.update()
    # the list's rays are 32 along a side
    assert 1e3 * (max(parts["PLATE"].dimensions) - before) == pytest.approx(more, rel=0.05)
    bpy.ops.kiriko.solve()
    press(look(), "missed the display: make the display")  # which was made for the small plate
    bpy.ops.kiriko.solve()
    assert not [text for text in told(look()) if "missed" in text]


def test_a_loss_that_nothing_near_by_mends_asks_to_turn_the_glass(core: ModuleType) -> None:
    """Remedies were sought, and only those that mend this loss are offered for it."""
    checklist = importlib.import_module(f"{core.__name__}.blender.checks.checklist")
    to_do = importlib.import_module(f"{core.__name__}.blender.checks.to_do")
    help = to_do.Help("kiriko.fit_plate", 0.02, 0.99)
    misses = {"missed the plate": 0.3, "missed the glass": 0.1}
    look = to_do.Inspection(misses=misses, helps=(help,))
    plate, glass = checklist.entries(look, lambda length: f"{1e3 * length:g} mm")
    assert plate.text == (
        "30 % of the picture missed the plate: make the plate 20 mm larger (99 % arrives)."
    )
    assert [button.operator for button in plate.buttons] == ["kiriko.fit_plate"]
    assert glass.text == "10 % of the picture missed the glass: rotate the glass."
    assert [button.operator for button in glass.buttons] == ["kiriko.turn_back"]


@pytest.mark.parametrize("state", ["is_stale", "is_coarse", "is_missing_numbers"])
def test_an_old_result_is_solved_again(core: ModuleType, state: str) -> None:
    """Its losses are not those of the scene as it is, and are not told; while Live follows, the
    final image comes by itself.
    """
    checklist = importlib.import_module(f"{core.__name__}.blender.checks.checklist")
    to_do = importlib.import_module(f"{core.__name__}.blender.checks.to_do")
    look = to_do.Inspection(misses={"missed the plate": 0.3}, **{state: True})
    (entry,) = checklist.entries(look, str)
    assert [button.operator for button in entry.buttons] == ["kiriko.solve"]
    assert checklist.entries(replace(look, is_followed=True), str) == []


def test_every_button_is_an_operator_with_its_properties(
    look: Callable[[], list], drawn: Callable[..., Layout]
) -> None:
    """The panel draws the sentences and all buttons of an unhappy rig."""
    glass = glass_of(holed())
    glass.kiriko.use_ior = False
    shown = drawn("main_panel", "VIEW3D_PT_kiriko_main")
    entries = look()
    assert len(entries) == 2
    shown = drawn("main_panel", "VIEW3D_PT_kiriko_main")
    assert shown.operators[:4] == MAIN
    assert shown.operators[4:] == [b.operator for entry in entries for b in entry.buttons]
    assert " ".join(["Before you solve:", *told(entries)]) == " ".join(shown.texts)
    for entry in entries:
        for button in entry.buttons:
            group, verb = button.operator.split(".")
            known = getattr(getattr(bpy.ops, group), verb).get_rna_type().properties
            assert set(dict(button.properties)) <= set(known.keys())


def test_advice_stands_below_what_comes_first(
    look: Callable[[], list],
    scene: bpy.types.Scene,
    drawn: Callable[..., Layout],
) -> None:
    """The line of the state stays the same one while only advice comes or goes."""

    def shown() -> tuple[str, str, list[str]]:
        layout = drawn("main_panel", "VIEW3D_PT_kiriko_main")
        assert layout.operators[:4] == MAIN
        first, *texts = layout.texts
        return first, " ".join(texts), layout.operators[4:]

    parts = small_rig(plate_size=0.03)
    look()
    assert shown() == ("Ready: press Solve.", "", [])

    parts["GLASS"].data = lathe(32, 16)
    look()
    first, texts, buttons = shown()
    assert (first, buttons) == ("Ready: press Solve.", ["kiriko.shade_smooth"])
    assert "looks curved" in texts
    press(look(), "looks curved")

    bpy.ops.kiriko.solve()
    look()
    first, texts, buttons = shown()
    assert first == "Ready."
    assert "missed the plate" in texts
    assert "kiriko.fit_plate" in buttons

    parts["DISPLAY"].hide_viewport = parts["DISPLAY"].hide_render = True
    look()
    first, texts, _ = shown()
    assert first == "Before you solve:"
    assert "is hidden" in texts.partition("missed the plate")[0]


def test_a_mesh_is_looked_at_once(
    look: Callable[[], list],
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """While nothing changes panels and further looks have its faults from the first one."""
    look_over = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    glass = glass_of(primitive("icosphere", subdivisions=7, radius=SIDE / 2))
    inspect_mesh, looked_at = look_over.inspect_mesh, []

    def counted(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> object:
        looked_at.append(thing)
        return inspect_mesh(thing, depsgraph)

    monkeypatch.setattr(look_over, "inspect_mesh", counted)
    look()
    assert looked_at.count(glass) == 1
    before = len(looked_at)
    for _ in range(3):
        look_over.found(SimpleNamespace(scene=scene))
        look()
    assert len(looked_at) == before

    glass.data.update()
    glass.data.update_tag()
    bpy.context.view_layer.update()
    look()
    assert looked_at[before:] == [glass]


@pytest.fixture
def in_window(
    kiriko: ModuleType, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> ModuleType:
    """Module operators.look_over, as where Blender has windows, and a timer looks."""
    module = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    app = SimpleNamespace(background=False, timers=bpy.app.timers)
    monkeypatch.setattr(module, "bpy", SimpleNamespace(app=app, context=bpy.context))
    monkeypatch.setattr(module, "RESTING", 0.0)
    return module


def test_a_new_rig_has_nothing_of_the_look_at_the_one_before(
    in_window: ModuleType, scene: bpy.types.Scene
) -> None:
    """Nor of one in between, when there was none: nothing is missing of it at the first redraw."""
    small_rig()
    in_window.found(bpy.context)
    bpy.ops.kiriko.remove_rig()
    in_window.tick()
    assert in_window._looked[scene.session_uid].entries
    bpy.data.objects["Cube"].select_set(True)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    assert not [entry.text for entry in in_window.found(bpy.context) if "No " in entry.text]


def test_a_button_that_comes_under_the_pointer_waits(
    in_window: ModuleType,
    scene: bpy.types.Scene,
    drawn: Callable[..., Layout],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a change of the checklist its buttons are grey for the time of a double click; the
    main buttons, which never move, are not.
    """
    cube().scale = (40, 40, 40)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))

    def grey() -> tuple[list[str], list[str]]:
        shown = drawn("main_panel", "VIEW3D_PT_kiriko_main")
        return tuple(
            [b for b in shown.operators if (b in shown.grey) == is_grey]
            for is_grey in (False, True)
        )

    def wait() -> None:
        clock = in_window.monotonic
        monkeypatch.setattr(in_window, "monotonic", lambda: clock() + 1.0)

    assert grey() == (MAIN, [])
    in_window.tick()
    usable, waiting = grey()
    assert usable == MAIN
    assert {"kiriko.make_glass", "kiriko.rescale_scene"} <= set(waiting)
    wait()
    assert not grey()[1]
    in_window.tick()
    assert not grey()[1]  # nothing has moved
    bpy.ops.kiriko.make_glass(part="Cube")
    in_window.inspect_again(scene)
    in_window.tick()
    usable, waiting = grey()
    assert usable == MAIN
    assert "kiriko.rescale_scene" in waiting
    wait()
    assert not grey()[1]


def test_a_shape_that_has_changed_is_not_called_ready_before_it_is_looked_at(
    look: Callable[[], list],
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    drawn: Callable[..., Layout],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A look at a shape waits until that is left alone; until then nobody knows."""
    look_over = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    glass = small_rig()["GLASS"]
    assert look() == []
    assert not look_over.is_looking(scene)
    glass.data.update()
    glass.data.update_tag()
    bpy.context.view_layer.update()
    assert look_over.is_looking(scene)
    with monkeypatch.context() as patch:
        patch.setattr(look_over, "found", lambda context: [])  # background looks as it is drawn
        texts = drawn("main_panel", "VIEW3D_PT_kiriko_main").texts
    assert texts == ["Checking the glass..."]

    monkeypatch.setattr(look_over, "RESTING", 0.0)
    look_over.inspect_again(scene)
    look_over.tick()
    assert look_over.is_looking(scene)  # it is too early
    monkeypatch.setattr(look_over, "QUIET", 0.0)
    monkeypatch.setattr(look_over, "SHARE", 0.0)
    for _ in range(9):  # a mesh a turn
        look_over.tick()
    assert not look_over.is_looking(scene)
    assert drawn("main_panel", "VIEW3D_PT_kiriko_main").texts == ["Ready: press Solve."]

    # a shape that is no part of a rig is nobody's to wait for
    other = new_object(primitive("cube", size=0.1))
    other.data.update_tag()
    bpy.context.view_layer.update()
    assert not look_over.is_looking(scene)


def test_a_look_that_fails_is_not_waited_for(
    look: Callable[[], list],
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """It is told, and tried again when something changes."""
    look_over = importlib.import_module(f"{kiriko.__name__}.operators.look_over")
    glass = small_rig()["GLASS"]
    assert look() == []
    glass.data.update_tag()
    bpy.context.view_layer.update()

    def fails(*_: object) -> None:
        raise ValueError("no such mesh")

    for name, value in (("inspect_mesh", fails), ("QUIET", 0.0), ("SHARE", 0.0), ("RESTING", 0.0)):
        monkeypatch.setattr(look_over, name, value)
    look_over.inspect_again(scene)
    assert look_over.is_looking(scene)
    look_over.tick()
    assert not look_over.is_looking(scene)
    assert "no such mesh" in "".join(capfd.readouterr())


@pytest.mark.parametrize("kind", ["IN_GLASS", "BEHIND_GLASS"])
@pytest.mark.parametrize("role", ["DISPLAY", "PICTURE", "PLATE", "VIEWER"])
def test_a_part_that_was_deleted_is_made_anew(
    scene: bpy.types.Scene, look: Callable[[], list], role: str, kind: str
) -> None:
    """It stands where Add Rig had it, all of the picture arrives, and Remove Rig takes it along."""
    if (role, kind) == ("PLATE", "BEHIND_GLASS"):
        return
    untouched = {block.name for block in bpy.data.objects}
    glass = cube()
    glass.kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(kind=kind, viewer_resolution=64, display_resolution=(64, 48))
    by_role = {thing.kiriko.role: thing for thing in scene.objects}
    by_role["VIEWER"] = scene.kiriko.viewer
    place = by_role[role].matrix_world.copy()
    bpy.ops.kiriko.solve()
    before = scene.kiriko.result.coverage
    assert before > 0.99
    bpy.data.objects.remove(by_role[role])
    assert not bpy.ops.kiriko.solve.poll()
    entries = [entry for entry in look() if entry.icon == "ERROR"]
    assert len(entries) == 1
    words = {"PLATE": "The rig's plate is missing: make a new one, or remove it from the rig."}
    assert entries[0].text.startswith(words.get(role, f"No {role.lower()}: "))
    press(entries, entries[0].text)

    made = scene.kiriko.viewer if role == "VIEWER" else scene.objects[f"Kiriko {role.title()}"]
    found, expected = (np.array(matrix) for matrix in (made.matrix_world, place))
    assert np.abs(found[:3, :3] - expected[:3, :3]).max() < 1e-5
    tolerance = 0.02 * SIDE if role == "PICTURE" else 1e-5
    assert np.abs(found[:3, 3] - expected[:3, 3]).max() < tolerance
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.coverage > 0.99
    assert not [entry for entry in look() if entry.icon == "ERROR"]
    bpy.ops.kiriko.remove_rig()
    assert {block.name for block in bpy.data.objects} == untouched | {glass.name}


def test_a_viewer_that_was_deleted_is_made_anew_beside_other_cameras(
    scene: bpy.types.Scene, look: Callable[[], list]
) -> None:
    """The camera of Blender's own scene looks elsewhere: it is offered, but not alone, nor first.
    Deleted by its key a viewer stays chosen, and is in no scene.
    """
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    rig = small_rig()
    rig["GLASS"].kiriko.use_ior = True
    viewer = scene.kiriko.viewer
    place = np.array(viewer.matrix_world)
    scene.collection.children[0].objects.unlink(viewer)
    (entry,) = look()
    assert entry.text == "No viewer: add a camera and make it the viewer."
    assert [str(button.label) for button in entry.buttons] == [
        "Make a Viewer",
        "Use 'Camera' as Viewer",
    ]

    press([entry], "No viewer")
    assert scene.kiriko.viewer not in (None, viewer, scene.camera)
    assert np.abs(np.array(scene.kiriko.viewer.matrix_world) - place).max() < 1e-5
    assert look() == []


def test_a_rig_may_go_on_without_its_plate(
    scene: bpy.types.Scene, look: Callable[[], list]
) -> None:
    """By the button; one whose role is None was put out of use, and is no matter."""
    rig = small_rig()
    rig["PLATE"].kiriko.role = "NONE"
    assert told(look()) == []
    rig["PLATE"].kiriko.role = "PLATE"
    bpy.data.objects.remove(rig["PLATE"])
    press(look(), "plate is missing", n=1)
    assert told(look()) == []


def test_glass_that_is_gone_may_be_another_object(
    scene: bpy.types.Scene, look: Callable[[], list]
) -> None:
    """The active one first, of those that have a body."""
    rig = small_rig()
    bpy.data.objects.remove(rig["GLASS"])
    new_object(primitive("cube", size=SIDE))
    ball = new_object(primitive("icosphere", subdivisions=2, radius=SIDE))
    new_object(primitive("grid", x_segments=2, y_segments=2, size=SIDE))
    ball.kiriko.use_ior = True
    bpy.context.view_layer.objects.active = ball
    bpy.context.view_layer.update()
    (entry,) = look()
    assert [str(button.label) for button in entry.buttons] == [
        "Add 'thing.001' to Rig",
        "Add 'thing' to Rig",
    ]
    press([entry], "No glass")
    assert ball.kiriko.role == "GLASS"
    assert not [text for text in told(look()) if "No " in text]


def seen_by(scene: bpy.types.Scene) -> dict[str, float]:
    """Shares of the picture that the viewers see of the last result."""
    viewers = json.loads(scene.kiriko.result.details)["viewers"]
    return {one["viewer"]: one["coverage"] for one in viewers}


@pytest.mark.parametrize("verb", ["two_eyes", "viewer_grid"])
def test_a_loss_of_any_viewer_is_told_and_mended_for_all(
    scene: bpy.types.Scene, look: Callable[[], list], verb: str
) -> None:
    """Also where the one that is shown loses nothing: Fit Display makes room for each of them."""
    small_rig()
    getattr(bpy.ops.kiriko, verb)()
    scene.kiriko.viewer_shown = len(scene.kiriko.viewers) // 2 if verb == "viewer_grid" else 1
    bpy.ops.kiriko.solve()
    assert min(seen_by(scene).values()) < 0.99
    if verb == "viewer_grid":
        assert scene.kiriko.result.coverage == 1  # the head in the middle is the viewer
        (text,) = told(look())
        assert re.match("'Kiriko Head.*': 3 % of the picture missed the display: make", text)
    press(look(), "of the picture missed the display")
    bpy.ops.kiriko.solve()
    assert told(look()) == []
    assert min(seen_by(scene).values()) > 0.999


def test_a_button_that_mends_two_losses_stands_once(kiriko: ModuleType) -> None:
    """Fit Picture makes the picture small enough for plate and display in one press."""
    checklist = importlib.import_module(f"{kiriko.__name__}.core.blender.checks.checklist")
    misses = {"missed the plate": 0.2, "missed the display": 0.1}
    for helps in (None, ()):
        look = checklist.Inspection(misses=misses, is_solved=True, helps=helps)
        found = checklist.entries(look, str)
        buttons = [button.operator for entry in found for button in entry.buttons]
        assert len(found) == 2
        assert len(set(buttons)) == len(buttons)
        assert {"kiriko.fit_plate", "kiriko.fit_display"} <= set(buttons) or helps is not None
