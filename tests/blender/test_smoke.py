"""The parts of Kiriko that ask most of Blender: the tests that the gate runs in every version."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import addon_utils
import bpy
import numpy as np
import pytest

from panel_layout import Layout
from small_rigs import cube, inventory, linear_lattice, new_object, pixels, primitive, small_rig

EXTENSION = "bl_ext.user_default.kiriko"
WHITE = (1.0, 1.0, 1.0, 1.0)
PANELS = (
    ("checklist", "VIEW3D_PT_kiriko_checklist"),
    ("solve", "VIEW3D_PT_kiriko_solve"),
    ("result", "VIEW3D_PT_kiriko_result"),
    ("object", "VIEW3D_PT_kiriko_object"),
    ("rig", "VIEW3D_PT_kiriko_rig"),
    ("export", "VIEW3D_PT_kiriko_export"),
)
FORMATS = {"PNG8": 0.5 / 255, "PNG16": 0.5 / 65535, "EXR_HALF": 2.0**-11, "EXR_FLOAT": 0.0}


@pytest.fixture
def solved(scene: bpy.types.Scene) -> bpy.types.Scene:
    """A scene with a small rig and its source image."""
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    return scene


def source() -> np.ndarray:
    """The source image (h, w, 3), linear."""
    return pixels(bpy.context.scene.kiriko.result.source)[..., :3].copy()


# register


def test_registration_is_undone_and_done_again(blender: ModuleType) -> None:
    """Settings, operators and handlers go with the extension, and come back with it."""
    handlers = {name: len(getattr(bpy.app.handlers, name)) for name in ("load_post", "undo_post")}
    bpy.ops.preferences.addon_disable(module=EXTENSION)
    assert not hasattr(bpy.types.Scene, "kiriko")
    assert not hasattr(bpy.types, "KIRIKO_OT_solve")
    bpy.ops.preferences.addon_enable(module=EXTENSION)
    assert hasattr(bpy.types.Scene, "kiriko")
    assert {name: len(getattr(bpy.app.handlers, name)) for name in handlers} == handlers


def test_blender_has_no_complaint(blender: ModuleType) -> None:
    """The enabled extension breaks no policy of extensions."""
    assert addon_utils._extensions_warnings_get() == {}


def test_each_operator_can_be_called(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    """Blender knows each operator, its tooltip and its properties."""
    for cls in importlib.import_module(f"{kiriko.__name__}.operators").CLASSES:
        group, name = cls.bl_idname.split(".")
        told = getattr(getattr(bpy.ops, group), name).get_rna_type()
        assert told.description
        assert set(getattr(cls, "__annotations__", {})) <= set(told.properties.keys())


@pytest.mark.parametrize(("module", "name"), PANELS)
@pytest.mark.parametrize("is_solved", [False, True])
def test_panels_are_drawn(
    drawn: Callable[..., Layout],
    request: pytest.FixtureRequest,
    module: str,
    name: str,
    is_solved: bool,
) -> None:
    """Each panel is drawn in an empty scene and beside a result: all it shows is in Blender."""
    if is_solved:
        request.getfixturevalue("solved")
    shown = drawn(module, name, bpy.data.objects.get("Cube"))
    assert not is_solved or shown.props + shown.texts + shown.operators + shown.labels


# add rig


@pytest.mark.parametrize("is_given", [True, False])
def test_a_rig_is_added_and_removed(scene: bpy.types.Scene, is_given: bool) -> None:
    """Around a given glass, or a ball: each part once. Remove Rig leaves the file as before."""
    if is_given:
        cube()
    before = inventory()
    assert bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32)) == {"FINISHED"}
    roles = sorted(thing.kiriko.role for thing in scene.objects if thing.kiriko.role != "NONE")
    assert set(roles) >= {"DISPLAY", "GLASS", "PICTURE", "PLATE"}
    assert scene.kiriko.viewer.type == "CAMERA"
    if is_given:
        assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
        assert inventory() == before


def test_add_rig_is_undone(scene: bpy.types.Scene) -> None:
    """One undo step takes back all of Add Rig."""
    cube()
    bpy.ops.ed.undo_push(message="before")
    names = {thing.name for thing in bpy.context.scene.objects}
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.ed.undo_push(message="Add Rig")
    bpy.ops.ed.undo()
    assert {thing.name for thing in bpy.context.scene.objects} == names


def test_the_plate_material_comes_from_the_assets(scene: bpy.types.Scene) -> None:
    """The stored .blend can be read."""
    new_object(primitive("grid", x_segments=1, y_segments=1, size=1.0))
    assert bpy.ops.kiriko.add_plate_material() == {"FINISHED"}
    assert "Kiriko Plate" in bpy.data.materials


# solve


def test_the_source_is_the_picture_if_nothing_refracts(scene: bpy.types.Scene) -> None:
    """With an index of 1 a display as large as the picture shows the picture, upright."""
    small_rig(ior=1.0, picture_size=0.03, display_size=0.03, field=0.03)
    bpy.ops.kiriko.solve()
    expected = linear_lattice().reshape(64, 16, 64, 16, 3).mean(axis=(1, 3))
    error = np.abs(source() - expected).mean()
    assert error < 0.004
    for turned in (expected[::-1], expected[:, ::-1]):
        assert error < 0.25 * np.abs(source() - turned).mean()


def test_the_result_is_told_and_on_the_display(solved: bpy.types.Scene) -> None:
    """Summary, numbers and a packed image; the display's material shows it."""
    result = solved.kiriko.result
    assert result.summary.startswith("The display shows")
    assert json.loads(result.details)["rays"] > 0
    assert result.source.packed_file is not None
    (display,) = (thing for thing in solved.objects if thing.kiriko.role == "DISPLAY")
    tree = display.material_slots[0].material.node_tree
    assert result.source in [getattr(node, "image", None) for node in tree.nodes]


def test_numpy_and_the_kernel_agree(
    solved: bpy.types.Scene, kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blender's own numpy gives the source image of the kernel, to rounding."""
    before = source()
    monkeypatch.setenv("KIRIKO_KERNEL", "off")
    importlib.import_module(f"{kiriko.__name__}.operators.work").forget()
    bpy.ops.kiriko.solve()
    assert np.abs(source() - before).max() < 1e-4


def test_solving_again_leaves_no_litter(solved: bpy.types.Scene) -> None:
    """A second solve takes the place of the first."""
    before = inventory()
    solved.kiriko.margin += 1
    bpy.ops.kiriko.solve()
    assert inventory() == before


def test_a_solve_that_is_refused_changes_nothing(solved: bpy.types.Scene) -> None:
    """One sentence; result and image stay."""
    before = inventory(), source().tobytes(), solved.kiriko.result.summary
    (plate,) = (thing for thing in solved.objects if thing.kiriko.role == "PLATE")
    plate.location.x += 10
    with pytest.raises(RuntimeError, match="no ray reaches the plate"):
        bpy.ops.kiriko.solve()
    assert (inventory(), source().tobytes(), solved.kiriko.result.summary) == before


def test_solve_is_undone_and_redone(scene: bpy.types.Scene) -> None:
    """Undo takes the result back, redo brings the same pixels."""
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.ed.undo_push(message="rig")
    bpy.ops.kiriko.solve()
    before = source()
    bpy.ops.ed.undo_push(message="Solve")
    bpy.ops.ed.undo()
    assert bpy.context.scene.kiriko.result.source is None
    bpy.ops.ed.redo()
    assert np.array_equal(source(), before)


def test_the_result_is_saved_with_the_file(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """Pixels, summary and roles are the same after saving and loading."""
    before = source(), solved.kiriko.result.summary
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    loaded = bpy.context.scene
    assert np.array_equal(source(), before[0])
    assert loaded.kiriko.result.summary == before[1]
    assert {"GLASS", "PLATE"} <= {thing.kiriko.role for thing in loaded.objects}
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_live_follows_and_ends(solved: bpy.types.Scene, kiriko: ModuleType) -> None:
    """Glass that turns changes the image; after Live nothing of it is called any more."""
    live = importlib.import_module(f"{kiriko.__name__}.operators.live")
    before = source()
    bpy.ops.kiriko.live()
    bpy.data.objects["Cube"].rotation_euler.z = 0.1
    bpy.context.view_layer.update()
    assert any(live.tick() in {None, live.live_follower.IDLE} for _ in range(2000))
    assert not np.array_equal(source(), before)
    bpy.ops.kiriko.live()
    assert not bpy.app.timers.is_registered(live.tick)


# preview and simulation


def test_cycles_sees_the_picture(solved: bpy.types.Scene) -> None:
    """The preview is bright, finite, and leaves the scene's render settings as they were."""
    before = solved.render.engine, solved.render.resolution_x, inventory()
    assert bpy.ops.kiriko.preview(samples=1) == {"FINISHED"}
    shown = pixels(solved.kiriko.result.preview)[..., :3]
    assert np.isfinite(shown).all()
    assert shown.max() > 0.2
    assert (solved.render.engine, solved.render.resolution_x) == before[:2]
    assert inventory()["scenes"] == before[2]["scenes"]


def test_the_simulation_sees_the_picture(solved: bpy.types.Scene) -> None:
    """An ideal plate shows what the viewer wants to see."""
    assert bpy.ops.kiriko.simulate(samples=4) == {"FINISHED"}
    seen = pixels(solved.kiriko.result.seen)
    assert np.isfinite(seen).all()
    assert seen[..., :3].max() > 0.5


# files


@pytest.mark.parametrize("form", FORMATS)
def test_an_exported_file_is_the_source_image(
    solved: bpy.types.Scene, kiriko: ModuleType, tmp_path: Path, form: str
) -> None:
    """A file read back has the source image's numbers, to half a step of its format."""
    io = importlib.import_module(f"{kiriko.__name__}.core.files.image_io")
    solved.kiriko.export_format = form
    solved.kiriko.export_path = str(tmp_path / "source")
    assert bpy.ops.kiriko.export() == {"FINISHED"}
    (path,) = tmp_path.iterdir()
    expected = source().astype(float)
    expected = expected if form.startswith("EXR") else io.encode(expected)
    assert np.abs(io.read(path)[0] - expected).max() <= FORMATS[form] + 1e-7


def test_maps_are_exported(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """The folder has the warp map and its description."""
    assert bpy.ops.kiriko.export_maps(directory=str(tmp_path)) == {"FINISHED"}
    assert {"warp.exr", "maps.json"} <= {path.name for path in tmp_path.iterdir()}


def test_the_command_line_solves(
    run: Callable[..., int], scene: bpy.types.Scene, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Exit code 0, progress on stdout, files of the rig; a second run asks for --overwrite."""
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert run("solve", "--out", tmp_path / "out") == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "%" in told.out
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["resolution"] == [32, 32]
    assert run("solve", "--out", tmp_path / "out") == 1
    assert "already" in capsys.readouterr().err


def test_the_command_line_refuses_in_one_sentence(
    run: Callable[..., int], scene: bpy.types.Scene, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A file without a rig: exit code 1, one line, nothing written."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert run("solve", "--out", tmp_path / "out") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kiriko: ")
    assert not (tmp_path / "out").exists()


# reading


@pytest.mark.parametrize("kind", ["Glass", "Refraction", "Principled"])
def test_the_index_of_a_material_is_read(scene: bpy.types.Scene, kind: str) -> None:
    """Each shader of clear glass gives its own index."""
    glass = small_rig(viewer_resolution=32, display_resolution=(32, 32))["GLASS"]
    glass.kiriko.use_ior = False
    material = bpy.data.materials.new("Clear")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(f"ShaderNodeBsdf{kind}")
    shader.inputs["IOR"].default_value, shader.inputs["Roughness"].default_value = 1.6, 0.0
    shader.inputs["Base Color" if kind == "Principled" else "Color"].default_value = WHITE
    if kind == "Principled":
        shader.inputs["Transmission Weight"].default_value = 1.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    glass.data.materials.clear()
    glass.data.materials.append(material)

    bpy.ops.kiriko.solve()
    (read,) = json.loads(scene.kiriko.result.details)["materials"]
    assert read["ior"] == pytest.approx(1.6)
    assert read["source"] != "override"


@pytest.mark.parametrize("form", ["PNG8", "PNG16", "EXR_FLOAT", "generated"])
def test_a_picture_is_read_in_linear_light(
    scene: bpy.types.Scene, kiriko: ModuleType, tmp_path: Path, form: str
) -> None:
    """A picture of one colour, seen through glass of index 1, fills the display with it."""
    io = importlib.import_module(f"{kiriko.__name__}.core.files.image_io")
    colour = np.array([0.6, 0.3, 0.1])
    picture = small_rig(
        ior=1.0, viewer_resolution=32, display_resolution=(32, 32), display_size=0.01
    )["PICTURE"]
    encoded = colour if form.startswith("EXR") else io.encode(colour)
    if form == "generated":
        image = bpy.data.images.new("art", 8, 8)
        image.pixels.foreach_set(np.tile(np.append(encoded, 1.0), 64).astype(np.float32))
    else:
        path = tmp_path / f"art{io.FORMATS[form].suffix}"
        io.write(path, np.broadcast_to(colour, (8, 8, 3)).copy(), form)
        image = bpy.data.images.load(str(path))
    picture.kiriko.image = image
    bpy.ops.kiriko.solve()
    shown = source()[12:20, 12:20].reshape(-1, 3)
    assert np.abs(shown - colour).max() < 0.01


def test_pictures_in_several_colour_spaces_are_read(
    scene: bpy.types.Scene, kiriko: ModuleType, tmp_path: Path
) -> None:
    """White is white in each of them; Blender converts one after the other, and goes on."""
    io = importlib.import_module(f"{kiriko.__name__}.core.files.image_io")
    picture = importlib.import_module(f"{kiriko.__name__}.core.blender.picture")
    path = tmp_path / "white.png"
    io.write(path, np.ones((8, 8, 3)), "PNG8")
    for space in ("Linear Rec.2020", "ACEScg", "Non-Color", "sRGB", "Linear Rec.709"):
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name = space
        assert picture.read_pixels(image, "the picture")[..., :3] == pytest.approx(1.0, abs=1e-3)


# checklist


def test_the_checklist_names_what_is_missing_and_then_nothing(
    look: Callable[[], list], scene: bpy.types.Scene, drawn: Callable[..., Layout]
) -> None:
    """An object with a role alone lacks its parts; a rig of Add Rig can be solved."""
    new_object(primitive("cube", size=0.1), "BLOCKER")
    look()
    assert "No glass" in " ".join(drawn("checklist", "VIEW3D_PT_kiriko_checklist").texts)
    assert not bpy.ops.kiriko.solve.poll()
    small_rig(viewer_resolution=32, display_resolution=(32, 32))
    look()
    assert bpy.ops.kiriko.solve.poll()


def test_a_mesh_is_shaded_smooth(scene: bpy.types.Scene) -> None:
    """The checklist's button makes a ball's faces smooth."""
    mesh = primitive("uvsphere", u_segments=16, v_segments=8, radius=0.03)
    glass = new_object(mesh, "GLASS")
    assert bpy.ops.kiriko.shade_smooth(part=glass.name) == {"FINISHED"}
    assert all(face.use_smooth for face in glass.data.polygons)
