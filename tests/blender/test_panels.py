"""The panels, drawn on a layout that checks its items and keeps them (fixture `drawn`)."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import bpy
import pytest

from kiriko.core.words import percent, summary
from panel_layout import Layout
from small_rigs import cube, new_object, small_rig

OWN = {
    "IDEAL": [],
    "CROSSED": ["pitch", "height", "ior", "reflectance", "crossing_error", "fresnel", "phase"],
    "HOLES": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
    "RADIAL": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
}


@pytest.mark.parametrize("model", OWN)
def test_a_plate_shows_the_settings_of_its_model(drawn: Callable[..., Layout], model: str) -> None:
    """An ideal plate has none but the model; only crossed layers can be crossed wrong."""
    plate = small_rig()["PLATE"]
    plate.kiriko.plate.model = model
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig", plate)
    assert shown.props == [
        "role",
        "model",
        *OWN[model],
        "viewer",
        "use_resolution",
        "resolution",
        "picture_source",
    ]
    assert "kiriko.plate_preset" in shown.operators
    assert f"Plate: {plate.name}" in shown.texts


def test_other_roles_show_nothing_of_a_plate(drawn: Callable[..., Layout]) -> None:
    """Glass, display and picture have settings of their own, and no preset."""
    parts = small_rig()
    for role, own in {
        "GLASS": "priority",
        "DISPLAY": "resolution",
        "PICTURE": "Kiriko Lattice",
    }.items():
        shown = drawn("rig", "VIEW3D_PT_kiriko_rig", parts[role])
        assert own in shown.props + shown.texts
        assert "model" not in shown.props
        assert "kiriko.plate_preset" not in shown.operators


def test_a_picture_shows_what_is_solved(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """The name of the image, wherever it was chosen, beside buttons.

    The menu offers images, but not Kiriko's own.
    """
    picture = small_rig()["PICTURE"]
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig", picture)
    assert {"kiriko.open_picture", "kiriko.fit_picture"} <= set(shown.operators)
    texture = next(
        n for n in picture.material_slots[0].material.node_tree.nodes if n.type == "TEX_IMAGE"
    )
    texture.image = bpy.data.images.new("mine", 8, 8)

    assert "mine" in drawn("rig", "VIEW3D_PT_kiriko_rig", picture).texts
    texture.image = None
    assert "Choose Image" in drawn("rig", "VIEW3D_PT_kiriko_rig", picture).texts
    scene.kiriko.result.source = bpy.data.images.new("made", 8, 8)
    offered = drawn("rig", "VIEW3D_MT_kiriko_images").labels

    assert {"mine", "Kiriko Lattice"} <= set(offered)
    assert "made" not in offered
    assert "Render Result" not in offered


def test_an_image_as_the_picture_that_is_not_chosen_is_missing(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """The list has no picture plane then, the reason stands below
    it, and Solve and Live are grey with that reason.
    """
    small_rig()
    assert "Picture: Kiriko Picture" in drawn("rig", "VIEW3D_PT_kiriko_rig").texts
    scene.kiriko.picture_source = "IMAGE"
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig").texts

    assert "Picture: Kiriko Picture" not in shown
    assert "No picture: choose an image, or set Picture to Plane." in " ".join(shown)
    for operator in (bpy.ops.kiriko.solve, bpy.ops.kiriko.live):
        with pytest.raises(
            RuntimeError, match="No picture: choose an image, or set Picture to Plane"
        ):
            operator()

    scene.kiriko.picture_image = bpy.data.images.new("mine", 8, 8)
    assert "No picture" not in " ".join(drawn("rig", "VIEW3D_PT_kiriko_rig").texts)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_a_rig_in_the_making_says_what_it_lacks(drawn: Callable[..., Layout]) -> None:
    """Without any object each part that is needed is named."""
    text = " ".join(drawn("rig", "VIEW3D_PT_kiriko_rig").texts)
    for word in ("No glass", "No display", "No picture", "No viewer"):
        assert word in text
    assert "No plate" not in text


def test_a_coarse_image_is_called_one(drawn: Callable[..., Layout], scene: bpy.types.Scene) -> None:
    """With numbers of a result before, and with none: then there is no share of the
    picture either.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    words = "The source image is a coarse one: solve, or let Live finish."
    assert words not in " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)
    result.is_coarse = True
    text = " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)
    assert words in text
    assert result.summary in text
    result.summary = result.details = result.notes = ""
    assert " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts) == words


def test_the_result_tells_brightness_and_blur_of_mirrors(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """The numbers of the solve in one sentence, with their standard errors.

    Nothing of it with an ideal plate.
    """
    assert drawn("result", "VIEW3D_PT_kiriko_result").texts == ["Not solved yet."]
    plate = small_rig()["PLATE"].kiriko.plate
    bpy.ops.kiriko.solve()
    assert "Plate:" not in " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)

    plate.model = "CROSSED"
    bpy.ops.kiriko.solve()
    found = json.loads(scene.kiriko.result.details)["plate"]
    assert 0 < found["least"] < found["brightness"] < found["most"] < 1

    text = " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)
    assert scene.kiriko.result.summary in text
    assert (
        f"Plate: {percent(found['brightness'])} (+- {percent(found['brightness_error'])}) of the"
        f" light, {percent(found['least'])} to {percent(found['most'])}; blur {found['blur']:.2g}"
        f" (+- {found['blur_error']:.1g}) viewer px"
    ) in text
    assert "Rays: " in " ".join(drawn("result", "VIEW3D_PT_kiriko_details").texts)


def test_a_blur_that_is_not_known_is_not_told(kiriko: ModuleType) -> None:
    """Brightness alone; and a blur of nothing has no standard error."""
    words = importlib.import_module(f"{kiriko.__name__}.panels.result").plate_words
    found = {
        "brightness": 0.5,
        "brightness_error": 0.01,
        "least": 0.25,
        "most": 0.75,
        "blur": None,
        "blur_error": None,
    }
    assert words(found) == "Plate: 50 % (+- 1 %) of the light, 25 % to 75 %"
    assert words({**found, "blur": 0.0}).endswith("; blur 0 (+- 0) viewer px")


def test_the_bar_and_the_sentence_above_it_agree(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """A coverage that is not all does not read as all, in neither of them."""
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    details = json.loads(result.details)
    result.details = json.dumps(
        {**details, "tessellation_error": 2e-4, "picture_coverage": 1 - 2e-5}
    )
    assert "over 99.99 % of the picture" in drawn("result", "VIEW3D_PT_kiriko_result").texts
    assert "Tessellation: under 0.001 px" in drawn("result", "VIEW3D_PT_kiriko_details").texts


def test_the_same_number_stands_above_and_in_the_bar(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """Also where float32, in which Blender keeps a property, would round it to another one."""
    small_rig()
    bpy.ops.kiriko.solve()
    result = scene.kiriko.result
    details = json.loads(result.details)
    for share in (0.9958, 1 - 5.1e-7, 1 - 4.9e-7, 0.125000499, 5.2e-7, 0.0):
        result.coverage = share
        result.summary = summary(share, {})
        result.details = json.dumps({**details, "picture_coverage": share})
        texts = drawn("result", "VIEW3D_PT_kiriko_result").texts
        assert f"{percent(share)} of the picture" in texts
        assert f"The display shows {percent(share)} of the picture." in " ".join(texts)


def test_lost_light_and_open_glass_are_warned_of(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
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

    assert "goes through gaps in the glass 'open glass'" in warning
    assert warning in result.notes.splitlines()
    result.notes += "\nA plain note."
    icons = drawn("result", "VIEW3D_PT_kiriko_result").icons
    first = next(text for text in icons if warning.startswith(text))

    assert icons[first] == "ERROR"
    assert icons["A plain note."] == "INFO"
    details = json.loads(result.details)
    del details["warnings"]
    result.details = json.dumps(details)

    assert drawn("result", "VIEW3D_PT_kiriko_result").icons[first] == "INFO"


def test_what_was_simulated_is_told_until_the_next_result(
    drawn: Callable[..., Layout], scene: bpy.types.Scene, tmp_path: Path
) -> None:
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
    assert told in " ".join(drawn("result", "VIEW3D_PT_kiriko_result", of=scene).texts)

    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.seen_summary == ""
    assert "Kiriko Seen" not in " ".join(drawn("result", "VIEW3D_PT_kiriko_result", of=scene).texts)


def test_a_camera_shows_the_pixels_it_is_solved_with(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """Its own, or those of the render, as the viewer and as the active object.

    It is offered no role.
    """
    small_rig()
    viewer = scene.kiriko.viewer
    for active in (viewer, None):
        assert drawn("rig", "VIEW3D_PT_kiriko_rig", active).props.count("resolution") == 1
    viewer.kiriko.use_resolution = False
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig", viewer)
    assert "role" not in shown.props
    assert "resolution" not in shown.props
    assert shown.texts.count("As the render: 1920 x 1080 px") == 1


def test_the_camera_that_blender_shows_is_named_where_it_is_another(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """With a button that makes the viewer the scene's camera.

    Then only its frame is told, where that is another.
    """
    mine = new_object(bpy.data.cameras.new("mine"))
    scene.camera = mine
    small_rig()
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig")
    assert f"Numpad 0 shows '{mine.name}', not 'Kiriko Viewer'." in " ".join(shown.texts)
    assert "wm.context_set_id" in shown.operators
    bpy.ops.wm.context_set_id(data_path="scene.camera", value="Kiriko Viewer")
    assert scene.camera == scene.kiriko.viewer
    shown = " ".join(drawn("rig", "VIEW3D_PT_kiriko_rig").texts)
    assert "Numpad 0 shows it in the shape of the render, 1920 x 1080 px." in shown
    scene.render.resolution_x = 1080
    assert "Numpad" not in " ".join(drawn("rig", "VIEW3D_PT_kiriko_rig").texts)


def test_what_has_no_surface_is_offered_no_role(drawn: Callable[..., Layout]) -> None:
    """Light, armature, lattice and empty say why.

    One that has a role all the same can be set back.
    """
    data = (
        bpy.data.lights.new("l", "POINT"),
        bpy.data.armatures.new("a"),
        bpy.data.lattices.new("g"),
        None,
    )

    for block, word in zip(data, ("A light", "An armature", "A lattice", "An empty"), strict=True):
        thing = new_object(block)
        shown = drawn("rig", "VIEW3D_PT_kiriko_rig", thing)
        assert "role" not in shown.props
        assert f"{word} has no surface" in " ".join(shown.texts)
        thing.kiriko.role = "GLASS"
        shown = drawn("rig", "VIEW3D_PT_kiriko_rig", thing)
        assert "role" in shown.props
        assert "set the role to None" in " ".join(shown.texts)


def test_an_instance_may_have_a_role(drawn: Callable[..., Layout]) -> None:
    """An empty that shows a collection is as good as the objects in it."""
    thing = new_object(None)
    thing.instance_type = "COLLECTION"
    thing.instance_collection = bpy.data.collections.new("glasses")
    assert "role" in drawn("rig", "VIEW3D_PT_kiriko_rig", thing).props


def test_opaque_glass_has_a_button_that_makes_it_glass(drawn: Callable[..., Layout]) -> None:
    """Until it refracts, or has an index of its own."""
    thing = cube()
    thing.kiriko.role = "GLASS"
    grey = bpy.data.materials.new("Grey")
    thing.data.materials.append(grey)

    assert "kiriko.make_glass" in drawn("rig", "VIEW3D_PT_kiriko_rig", thing).operators
    thing.kiriko.use_ior = True
    assert "kiriko.make_glass" not in drawn("rig", "VIEW3D_PT_kiriko_rig", thing).operators
    thing.kiriko.use_ior = False
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.make_glass()

    assert "kiriko.make_glass" not in drawn("rig", "VIEW3D_PT_kiriko_rig", thing).operators
    assert thing.data.materials[0] == grey  # the mesh may be another object's, too
    assert grey.use_fake_user
