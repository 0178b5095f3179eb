"""The panels, drawn on a layout that checks its items and keeps them (fixture `drawn`)."""

import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import blf
import bpy
import pytest

from extension import loaded
from kiriko.core.base.words import percent, summary
from panel_layout import Layout
from small_rigs import cube, new_object, primitive, record_text, small_rig

OWN = {
    "IDEAL": [],
    "CROSSED": ["pitch", "height", "ior", "reflectance", "crossing_error", "fresnel", "phase"],
    "HOLES": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
    "RADIAL": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
}


@pytest.mark.parametrize("model", OWN)
def test_a_plate_shows_the_settings_of_its_model(drawn, model):
    """An ideal plate has none but the model; only crossed layers can be crossed wrong."""
    plate = small_rig()["PLATE"]
    plate.kiriko.plate.model = model
    shown = drawn("object", "OBJECT_PT_kiriko", plate)
    assert shown.props == ["role", "model", *OWN[model]]
    assert "kiriko.plate_preset" in shown.operators


ELEMENTS = {
    "HALF_MIRROR": ["reflectance", "absorption", "prefers", "polarising", "surface"],
    "RETROREFLECTOR": ["spread", "pitch"],
    "LENS": ["focal_length"],
    "POLARISER": ["angle", "extinction"],
    "WAVE_PLATE": ["retardance", "angle"],
    "SCREEN": ["resolution"],
}


@pytest.mark.parametrize("role", ELEMENTS)
def test_an_element_shows_its_own_settings(drawn, scene, role):
    """And no others."""
    thing = new_object(primitive("grid", x_segments=1, y_segments=1, size=0.1), role)
    assert drawn("object", "OBJECT_PT_kiriko", thing).props == ["role", *ELEMENTS[role]]


def test_glass_that_reflects_shows_which_path_it_prefers(drawn, scene):
    """Only with Use Reflection on; a display shows the axis of its light only if polarised."""
    for role, switch, name in (
        ("GLASS", "reflects", "prefers"),
        ("DISPLAY", "is_polarised", "angle"),
    ):
        thing = new_object(primitive("cube", size=0.1), role)
        assert name not in drawn("object", "OBJECT_PT_kiriko", thing).props
        setattr(thing.kiriko.element, switch, True)
        assert name in drawn("object", "OBJECT_PT_kiriko", thing).props


def test_a_picture_shows_what_is_solved(drawn, scene):
    """The name of the image, wherever it was chosen, beside buttons.

    The menu offers images, but not Kiriko's own.
    """
    picture = small_rig()["PICTURE"]
    shown = drawn("object", "OBJECT_PT_kiriko", picture)
    assert {"kiriko.fit_picture", "kiriko.fit_picture_size"} <= set(shown.operators)
    main = "main_panel", "VIEW3D_PT_kiriko_main"
    assert "Choose Your Picture" in drawn(*main).labels
    texture = next(
        n for n in picture.material_slots[0].material.node_tree.nodes if n.type == "TEX_IMAGE"
    )
    texture.image = bpy.data.images.new("mine", 8, 8)

    assert "mine" in drawn("object", "OBJECT_PT_kiriko", picture).texts
    assert "mine" in drawn(*main).labels
    texture.image = None
    assert "Choose Your Picture" in drawn("object", "OBJECT_PT_kiriko", picture).texts
    scene.kiriko.result.source = bpy.data.images.new("made", 8, 8)
    offered = drawn("object", "VIEW3D_MT_kiriko_images").labels

    assert {"mine", "Kiriko Lattice"} <= set(offered)
    assert "made" not in offered
    assert "Render Result" not in offered


def test_an_image_as_the_picture_that_is_not_chosen_is_missing(drawn, scene):
    """The list has no picture plane then, the checklist has the
    reason, and Solve and Live are grey with that reason.
    """
    small_rig()
    assert "Kiriko Picture" in drawn("rig_panel", "VIEW3D_PT_kiriko_rig").labels
    scene.kiriko.picture_source = "IMAGE"
    assert "Kiriko Picture" not in drawn("rig_panel", "VIEW3D_PT_kiriko_rig").labels
    shown = drawn("main_panel", "VIEW3D_PT_kiriko_main").texts

    assert "No picture: choose an image, or set Picture to Plane." in " ".join(shown)
    for operator in (bpy.ops.kiriko.solve, bpy.ops.kiriko.live):
        with pytest.raises(
            RuntimeError, match="No picture: choose an image, or set Picture to Plane"
        ):
            operator()

    scene.kiriko.picture_image = bpy.data.images.new("mine", 8, 8)
    assert "No picture" not in " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def why_grey() -> str:
    """The reason for which Solve and Live are grey, which is the same; Blender cuts a long one."""
    told = set()
    for operator in (bpy.ops.kiriko.solve, bpy.ops.kiriko.live):
        assert not operator.poll()
        with pytest.raises(RuntimeError) as error:
            operator()
        told.add(str(error.value).partition("poll() ")[2].strip())
    (reason,) = told
    return reason


def open_file(scene: bpy.types.Scene, path: Path) -> bpy.types.Image:
    """An image of a file as the picture, as Open Picture has it."""
    made = bpy.data.images.new("made", 8, 8)
    made.filepath_raw, made.file_format = str(path), "PNG"
    made.save()
    bpy.ops.kiriko.open_picture(filepath=str(path))
    return scene.objects["Kiriko Picture"].kiriko.image


def test_a_glass_shows_the_index_in_use(drawn, scene):
    """Its material's, with the name of that, or the default; while it is on the override alone."""
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False

    def reported() -> tuple[list[str], bool]:
        shown = drawn("object", "OBJECT_PT_kiriko", glass)
        return [text for text in shown.texts if re.match(r"1\.\d{4} ", text)], "ior" in shown.props

    assert reported() == (["1.4900 (default)"], False)
    bpy.ops.kiriko.make_glass()
    (material,) = [slot.material for slot in glass.material_slots]
    node = next(n for n in material.node_tree.nodes if "IOR" in n.inputs)
    node.inputs["IOR"].default_value = 1.5
    assert reported() == (["1.5000 from 'Kiriko Glass'"], False)
    bpy.ops.kiriko.solve()
    details = drawn("result_panel", "VIEW3D_PT_kiriko_details").texts
    assert "'Kiriko Glass'" in " ".join(details)
    assert "1.5000 from" in " ".join(details)
    glass.kiriko.use_ior = True
    assert reported() == ([], True)


@pytest.mark.parametrize("source", ["PLANE", "IMAGE"])
def test_solve_is_grey_while_the_pictures_file_is_missing(look, scene, tmp_path, source):
    """With the sentence of the checklist; once the file is there again it can be pressed."""
    small_rig()
    path = tmp_path / "mine.png"
    image = open_file(scene, path)
    scene.kiriko.picture_image, scene.kiriko.picture_source = image, source
    assert bpy.ops.kiriko.solve.poll()
    path.rename(tmp_path / "away.png")
    image.reload()
    reason = why_grey()
    assert f" cannot be read: {path} is missing" in reason
    assert [entry.text for entry in look() if entry.text.startswith(reason)]
    (tmp_path / "away.png").rename(path)
    image.reload()
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_solve_is_grey_while_the_picture_is_doubled(drawn, scene):
    """With the sentence of the checklist, until one of both is left out or hidden."""
    other = small_rig()["PICTURE"].copy()
    scene.collection.objects.link(other)
    shown = " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    assert why_grey() in shown
    other.hide_viewport = other.hide_render = True
    assert bpy.ops.kiriko.solve.poll()
    other.hide_viewport = other.hide_render = False
    bpy.ops.kiriko.leave_out(part=other.name)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


@pytest.mark.parametrize(
    "make",
    [
        lambda: bpy.data.cameras.new("thing"),
        lambda: bpy.data.lights.new("thing", "SUN"),
        lambda: bpy.data.armatures.new("thing"),
        lambda: bpy.data.lattices.new("thing"),
        lambda: None,
    ],
)
@pytest.mark.parametrize("role", ["GLASS", "DISPLAY", "PICTURE"])
def test_a_script_that_gives_a_camera_a_role_is_told(drawn, look, make, role):
    """The checklist says why it can be no part, with a button that takes the role back; Solve is
    grey for that reason.
    """
    small_rig()
    thing = new_object(make(), role)
    (entry, *others) = look()
    assert re.match(rf"'thing' has the role {role.title()}, but it has no surface", entry.text)
    assert not [other for other in others if "thing" in other.text]
    assert drawn("main_panel", "VIEW3D_PT_kiriko_main")
    assert why_grey() == entry.text
    (button,) = entry.buttons
    assert (button.operator, dict(button.properties)["part"]) == ("kiriko.leave_out", "thing")
    bpy.ops.kiriko.leave_out(part="thing")
    assert thing.kiriko.role == "NONE"
    assert bpy.ops.kiriko.solve.poll()


def test_a_rig_in_the_making_says_what_it_lacks(drawn):
    """Each part that is needed and not there is named."""
    new_object(primitive("cube", size=0.1), "BLOCKER")
    text = " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    for word in ("No glass", "No display", "No picture", "No viewer"):
        assert word in text
    assert "No plate" not in text


PANELS = (
    ("main_panel", "VIEW3D_PT_kiriko_main"),
    ("result_panel", "VIEW3D_PT_kiriko_result"),
    ("rig_panel", "VIEW3D_PT_kiriko_rig"),
    ("export_panel", "VIEW3D_PT_kiriko_export"),
    ("solve_panel", "VIEW3D_PT_kiriko_check"),
    ("viewers_panel", "VIEW3D_PT_kiriko_viewers"),
    ("export_panel", "VIEW3D_PT_kiriko_more_exports"),
    ("calibration_panel", "VIEW3D_PT_kiriko_calibration"),
    ("solve_panel", "VIEW3D_PT_kiriko_advanced"),
)


def test_before_there_is_a_rig_there_is_one_button(drawn, scene, monkeypatch):
    """One sentence and Add Rig; no other panel is there. A
    single object with a role, or a result, brings them all.
    """
    # on a busy machine a look may take so long that its answer is kept
    needed = loaded("operators.needed")
    monkeypatch.setattr(needed, "LONG", float("inf"))
    shown = drawn(*PANELS[0])
    assert shown.operators == ["kiriko.add_rig"] * 2 + ["kiriko.open_example"]
    assert shown.props == []
    assert "press Add Rig" in " ".join(shown.texts)

    def polled() -> list[bool]:
        return [
            not hasattr(getattr(bpy.types, name), "poll")
            or getattr(bpy.types, name).poll(bpy.context)
            for _, name in PANELS
        ]

    cube()
    assert polled() == [True] + [False] * (len(PANELS) - 1)
    holder = new_object(None)
    inside = bpy.data.collections.new("inside")
    holder.instance_type, holder.instance_collection = "COLLECTION", inside
    inside.objects.link(bpy.data.objects.new("within", bpy.data.meshes.new("m")))
    assert not any(polled()[1:])
    inside.objects[0].kiriko.role = "GLASS"
    assert all(polled())
    inside.objects[0].kiriko.role = "NONE"
    assert not any(polled()[1:])
    scene.kiriko.result.source = bpy.data.images.new("made", 8, 8)
    assert all(polled())


def test_buttons_stay_where_they_are(drawn):
    """Nothing in the first panel or in Result depends on the active object."""
    parts = small_rig()
    for module, name in PANELS[:2]:
        layouts = [drawn(module, name, active) for active in (None, *parts.values())]
        assert len({(*x.props, *x.operators, *x.texts) for x in layouts}) == 1


def test_a_list_selects_what_it_names(drawn):
    """Each part is named by a button, which selects it and makes it active.

    A hidden one has another button beside it, and is not selected before that is pressed.
    """
    parts = small_rig()
    shown = drawn("rig_panel", "VIEW3D_PT_kiriko_rig")
    assert shown.operators.count("kiriko.select_part") == 5  # with the viewer
    for thing in (*parts.values(), bpy.context.scene.kiriko.viewer):
        assert thing.name in shown.labels
        assert bpy.ops.kiriko.select_part(part=thing.name) == {"FINISHED"}
        assert bpy.context.selected_objects == [thing]
        assert bpy.context.view_layer.objects.active == thing

    assert "kiriko.show_part" not in shown.operators
    parts["PLATE"].hide_set(True)
    assert "kiriko.show_part" in drawn("rig_panel", "VIEW3D_PT_kiriko_rig").operators
    with pytest.raises(RuntimeError, match=r"'Kiriko Plate' is hidden: show it first\."):
        bpy.ops.kiriko.select_part(part="Kiriko Plate")
    bpy.ops.kiriko.show_part(part="Kiriko Plate")
    assert bpy.ops.kiriko.select_part(part="Kiriko Plate") == {"FINISHED"}
    with pytest.raises(RuntimeError, match="'nobody' isn't in the rig now"):
        bpy.ops.kiriko.select_part(part="nobody")


def test_a_coarse_image_is_called_one(drawn, scene):
    """With numbers of a result before, and with none: then there is no share of the
    picture either.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    words = "The source image isn't final: press Solve, or let Live finish."
    assert words not in " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts)
    assert not drawn("result_panel", "VIEW3D_PT_kiriko_result").faint
    result.is_coarse = True
    shown = drawn("result_panel", "VIEW3D_PT_kiriko_result")
    text = " ".join(shown.texts)
    assert words in text
    assert result.summary in text
    assert result.summary in " ".join(shown.faint)  # it is that of the image before
    assert words not in " ".join(shown.faint)
    result.summary = result.details = result.notes = ""
    assert " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts) == words

    assert bpy.ops.kiriko.live() == {"FINISHED"}
    coming = "Rough preview; still solving..."
    assert " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts) == coming
    entries = " ".join(drawn("main_panel", "VIEW3D_PT_kiriko_main").texts)
    assert "coarse" not in entries
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    assert " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts) == words


def test_the_result_tells_brightness_and_blur_of_mirrors(drawn, scene):
    """The numbers of the solve in one sentence, with their standard errors.

    Nothing of it with an ideal plate.
    """
    assert drawn("result_panel", "VIEW3D_PT_kiriko_result").texts == ["Not solved yet."]
    panel = "result_panel", "VIEW3D_PT_kiriko_details"
    plate = small_rig()["PLATE"].kiriko.plate
    bpy.ops.kiriko.solve()
    assert "Plate:" not in " ".join(drawn(*panel).texts)

    plate.model = "CROSSED"
    bpy.ops.kiriko.solve()
    found = json.loads(scene.kiriko.result.details)["plate"]
    assert 0 < found["least"] < found["brightness"] < found["most"] < 1

    text = " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts)
    assert text.startswith(scene.kiriko.result.summary)
    assert re.search(r" Map error: .* Solved in .* s$", text)
    text = " ".join(drawn(*panel).texts)
    assert re.search(r"Legibility: \d+ %", text)
    assert (
        f"Plate: {percent(found['brightness'])} (+- {percent(found['brightness_error'])}) of the"
        f" light, {percent(found['least'])} to {percent(found['most'])}; blur {found['blur']:.2g}"
        f" (+- {found['blur_error']:.1g}) viewer px"
    ) in text
    assert "Rays: " in text


def test_all_of_the_picture_is_accounted_for(drawn, scene):
    """Details tell the share that is shown as the sentence does, and each share that is lost."""
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    details = json.loads(result.details)
    assert details["picture_coverage"] + sum(details["misses"].values()) == pytest.approx(1)

    for share in (0.9958, 1 - 2e-5, 1 - 5.1e-7, 1 - 4.9e-7, 0.125000499, 5.2e-7, 0.0):
        misses = {"missed the plate": 1 - share}
        result.summary = summary(share, misses)
        new = {**details, "tessellation_error": 2e-4, "picture_coverage": share, "misses": misses}
        result.details = record_text(new)
        shown = drawn("result_panel", "VIEW3D_PT_kiriko_details").texts
        assert f"{percent(share)} of the picture is shown" in shown
        told = " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts)
        assert f"The display shows {percent(share)} of the picture" in told
        assert ("missed the plate" in told) == (round(1 - share, 6) > 0)
        assert "Mesh error: under 0.001 px" in told


def menu_verbs(drawn: Callable[..., Layout]) -> list[str]:
    """The operators of Object > Kiriko and of the menus in it."""
    first = drawn("menus", "VIEW3D_MT_kiriko")
    own = [menu for menu in first.menus if menu != "VIEW3D_MT_kiriko_rigs"]
    return [verb for menu in own for verb in drawn("menus", menu).operators] + first.operators


@pytest.mark.parametrize("version", ["menu", "entry"])
def test_each_verb_is_in_a_menu(drawn, kiriko, version):
    """Object > Kiriko has every operator but those that need a part's name, and File > Export one.

    Blender's search finds operators in menus.
    """
    if version == "entry":
        menus = loaded("panels.menus")
        small_rig()
        here = SimpleNamespace(layout=Layout())
        menus.draw_in_export(here, bpy.context)
        assert here.layout.operators == ["kiriko.export", "kiriko.export_maps"]
        for menu in (bpy.types.VIEW3D_MT_object, bpy.types.TOPBAR_MT_file_export):
            drawers = [f.__module__ for f in menu._dyn_ui_initialize()]
            assert menus.__name__ in drawers
        return

    classes = loaded("operators").CLASSES
    own = {
        "add_plate_material",
        "add_asset_library",
        "choose_picture",
        "choose_rig",
        "show_image",
    }  # elsewhere in menus
    parts = loaded("operators.part_verbs")
    named = {c.bl_idname for c in classes if issubclass(c, parts.NamesPart)}
    verbs = {c.bl_idname for c in classes} - named - {f"kiriko.{name}" for name in own}
    found = set(menu_verbs(drawn))
    assert verbs - found <= {"kiriko.rescale_scene", "kiriko.wipe"}
    assert "kiriko.make_glass" in found


@pytest.mark.parametrize(
    "text",
    [
        "The display shows 65 % of the picture; 1 % missed the plate, under 0.01 % missed it.",
        "'Cube' measures 2 m. Did you mean 20 mm or 200 mm? It has 42 sides, 0.5 px off.",
        "WWWWWWWW MMMMMMMMM WWWWWWWW and iiiiiiiiiiii llllllllllllll iiiiiiiiiii",
        "/a/very/long/path/without/any/space/in/it/that/goes/on/and/on/and/on/source.png",
        "ガラスの中の像は、「光線」が届かない所では失われます。『メッシュ』に穴があります。",
        "写真 photo.png を選んでください。Solve を押すと、表示装置の画像ができます。",
    ],
)
@pytest.mark.parametrize("width", [60.0, 130.0, 240.0])
def test_text_wraps_by_its_measured_width(kiriko, text, width):
    """No line is wider than it may be, none could take the next piece, and no letter is lost.

    Japanese breaks anywhere but before a mark that closes, or after one that opens. A number stays
    with its unit.
    """
    wrapping = loaded("operators.wrapping")
    lines = wrapping.wrapped(text, width)
    blf.size(0, wrapping.POINTS)
    assert all(blf.dimensions(0, line)[0] <= width for line in lines)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert not any(line[0] in "、。」』,.;" for line in lines)
    assert not any(line[-1] in "「『" for line in lines)
    for line, after in pairwise(lines):
        piece = wrapping.pieces(after)[0].rstrip()
        joint = " " if text.replace(" ", "").isascii() else ""
        assert not (line[-1].isdigit() and re.match(r"(%|mm?|px|s)\b|%", after))
        is_cut = text.isascii() and not set(piece.split()) <= set(text.split())
        assert is_cut or blf.dimensions(0, line + joint + piece)[0] > width


def test_lost_light_and_open_glass_are_warned_of(drawn, scene):
    """With the sign for errors, which other notes do not have.

    A result of an earlier version has no warnings.
    """
    rig = small_rig()
    glass = rig["GLASS"]
    towards = rig["PLATE"].matrix_world.translation
    faces = sorted((f for f in glass.data.polygons), key=lambda f: f.normal.dot(towards))
    faces = [tuple(face.vertices) for face in faces]
    corners = [tuple(vertex.co) for vertex in glass.data.vertices]
    glass.data = bpy.data.meshes.new("open\nglass")
    glass.data.from_pydata(corners, [], faces[:-1])
    glass.name = "open\nglass"
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    (warning,) = json.loads(result.details)["warnings"]

    assert "leaks through gaps in 'open glass'" in warning
    assert warning in result.notes.splitlines()
    result.notes += "\nA plain note."
    icons = drawn("result_panel", "VIEW3D_PT_kiriko_result").icons
    first = next(text for text in icons if text and warning.startswith(text))

    assert icons[first] == "ERROR"
    assert "A plain note." not in icons
    assert drawn("result_panel", "VIEW3D_PT_kiriko_details").icons["A plain note."] == "INFO"
    details = json.loads(result.details)
    del details["warnings"]
    result.details = record_text(details)

    assert drawn("result_panel", "VIEW3D_PT_kiriko_details").icons[first] == "INFO"


def test_what_was_simulated_is_told_until_the_next_result(drawn, scene, tmp_path):
    """The numbers of Simulate stay in the panel and in the
    file, and go with the source image they are of.
    """
    small_rig()["PLATE"].kiriko.plate.model = "CROSSED"
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.simulate(samples=4)
    told = scene.kiriko.result.seen_summary

    assert "of white" in told

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    scene = bpy.context.scene
    assert scene.kiriko.result.seen_summary == told
    assert told in " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_details", of=scene).texts)

    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.seen_summary == ""
    shown = drawn("result_panel", "VIEW3D_PT_kiriko_details", of=scene)
    assert "Kiriko Seen" not in " ".join(shown.texts)


def test_a_camera_shows_the_pixels_it_is_solved_with(drawn, scene):
    """Its own, or those of the render, as the viewer and as the active object.

    Its role may make it a projector.
    """
    small_rig()
    viewer = scene.kiriko.viewer
    for active in (viewer, None):
        shown = drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers", active)
        assert shown.props.count("resolution") == 1
    assert drawn("object", "OBJECT_PT_kiriko", viewer).props.count("resolution") == 1
    viewer.kiriko.use_resolution = False
    shown = drawn("object", "OBJECT_PT_kiriko", viewer)
    assert shown.props == ["use_resolution", "role"]
    assert shown.texts.count("Same as the render: 1920 x 1080 px") == 1


def test_what_has_no_surface_is_offered_no_role(drawn):
    """Light, armature, lattice and empty say why.

    One that has a role all the same can be set back.
    """
    data = (
        bpy.data.lights.new("l", "POINT"),
        bpy.data.armatures.new("a"),
        bpy.data.lattices.new("g"),
        None,
    )

    for block in data:
        thing = new_object(block)
        shown = drawn("object", "OBJECT_PT_kiriko", thing)
        assert "role" not in shown.props
        assert "t has no surface" in " ".join(shown.texts)
        thing.kiriko.role = "GLASS"
        shown = drawn("object", "OBJECT_PT_kiriko", thing)
        assert "role" in shown.props
        assert "Set its role to None" in " ".join(shown.texts)


def test_opaque_glass_has_a_button_that_makes_it_glass(drawn):
    """Until it refracts, or has an index of its own."""
    thing = cube()
    thing.kiriko.role = "GLASS"
    grey = bpy.data.materials.new("Grey")
    thing.data.materials.append(grey)

    assert "kiriko.make_glass" in drawn("object", "OBJECT_PT_kiriko", thing).operators
    thing.kiriko.use_ior = True
    assert "kiriko.make_glass" not in drawn("object", "OBJECT_PT_kiriko", thing).operators
    thing.kiriko.use_ior = False
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.make_glass()

    assert "kiriko.make_glass" not in drawn("object", "OBJECT_PT_kiriko", thing).operators
    assert thing.data.materials[0] == grey  # the mesh may be another object's, too


def test_the_menu_has_each_verb_once(drawn):
    """But Add Rig, of which there are two kinds."""
    small_rig()
    verbs = [v for v in menu_verbs(drawn) if v != "kiriko.add_rig"]
    assert sorted(verbs) == sorted(set(verbs))
