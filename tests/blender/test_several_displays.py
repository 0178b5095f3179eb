"""Several displays, and screens with projectors: each has its own part of the source image, in the
viewport, in Cycles and in files.
"""

import json
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from small_rigs import new_object, pixels, primitive, small_rig
from test_preview import assert_agree


def halves(display: bpy.types.Object) -> tuple[bpy.types.Object, bpy.types.Object]:
    """Cut a display into a left and a right half of its pixels."""
    other = display.copy()
    other.data = display.data.copy()
    for collection in display.users_collection:
        collection.objects.link(other)
    width = 2 * max(vertex.co.x for vertex in display.data.vertices)
    for thing, name, side in ((display, "Left", -1), (other, "Right", 1)):
        thing.name = name
        squeeze = Matrix.Translation((side * width / 4, 0, 0)) @ Matrix.Diagonal((0.5, 1, 1, 1))
        thing.data.transform(squeeze)
        thing.kiriko.resolution = thing.kiriko.resolution[0] // 2, thing.kiriko.resolution[1]
    return display, other


def sections(result: bpy.types.PropertyGroup) -> dict[str, np.ndarray]:
    """The parts (h, w, 3) of a result's image, by name."""
    image = result.source
    shown = pixels(image)[..., :3]
    of = loaded("core.blender.result.write_result").sections_in(image)
    return {section.name: section.of(shown) for section in of}


def test_two_halves_show_what_the_whole_display_shows(core: ModuleType, scene, tmp_path: Path):
    """Side by side their images are that of one display; Cycles finds the same landings; each is
    a file, and an animation's frames too.
    """
    rig = small_rig()
    bpy.ops.kiriko.solve()
    whole = pixels(scene.kiriko.result.source)[..., :3]
    halves(rig["DISPLAY"])
    bpy.context.view_layer.update()
    bpy.ops.kiriko.solve()

    found = sections(scene.kiriko.result)
    assert list(found) == ["Left", "Right"]
    both = np.concatenate(list(found.values()), axis=1)
    inner = [*range(30), *range(34, 64)]
    assert np.abs(both - whole)[:, inner].max() < 0.02
    assert "Parts of the picture by display: 'Left' 5" in scene.kiriko.result.notes
    assert_agree(core, tolerance=2e-4)

    scene.kiriko.export_path = str(tmp_path / "source.png")
    bpy.ops.kiriko.export()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["source_Left.png", "source_Right.png"]
    numbers, _ = core.files.image_io.read(tmp_path / "source_Right.png")
    assert np.abs(numbers - core.files.image_io.encode(found["Right"])).max() < 0.51 / 255

    scene.frame_end = scene.frame_start
    scene.kiriko.animation_path = str(tmp_path / "frames" / "f_####")
    bpy.ops.kiriko.solve_animation()
    files = {str(p.relative_to(tmp_path / "frames")) for p in (tmp_path / "frames").rglob("*.png")}
    assert files == {"f_0001.png", "Right/f_0001.png"}


def test_each_display_shows_its_own_section(core: ModuleType, scene):
    """The viewer's image in Cycles of both halves is the one of the whole display; drawn over
    viewports, the UV of each is within its section.
    """
    rig = small_rig()
    left, right = halves(rig["DISPLAY"])
    bpy.ops.kiriko.solve()
    reading = core.blender.read.scene.read(bpy.context)
    rendered = core.blender.preview.cycles_preview.render_preview(
        scene, reading, scene.kiriko.result.source, samples=64, fresnel=False
    )
    session = loaded("operators.work").session()
    solution = core.base.steps.run_steps(
        session.solve(reading.rig, loaded("operators.work").settings_of(scene))
    )
    seen = solution.seen(past_glass=True)
    assert np.abs(rendered[..., :3] - seen).mean() < 0.01

    shown = loaded("core.blender.view.shown_images").shown_images
    low, high = (one.uv[:, 1] for one in shown(scene, bpy.context.view_layer, [right, left]))
    assert high.min() > low.max()


def test_a_projector_sees_what_the_screen_shows(core: ModuleType, scene, tmp_path: Path):
    """Its image is Cycles' render of the screen, which emits the wanted image, from its place: also
    from behind the screen, and by way of glass.
    """
    rig = small_rig(picture_size=0.02)
    display = rig["DISPLAY"]
    display.kiriko.role = "SCREEN"
    display.kiriko.resolution = 256, 256
    lens = bpy.data.cameras.new("Projector")
    projector = new_object(lens)
    projector.name, projector.kiriko.role = "Projector", "PROJECTOR"
    projector.kiriko.use_resolution, projector.kiriko.resolution = True, (64, 48)
    back = display.matrix_world @ Matrix.Translation((0.02, 0.01, -0.3))
    projector.matrix_world = back @ Matrix.Rotation(np.pi, 4, "Y")
    lens.angle = 0.15
    bpy.context.view_layer.update()
    bpy.ops.kiriko.solve()

    found = sections(scene.kiriko.result)
    assert list(found) == ["Projector"]
    image = found["Projector"]
    assert image.shape == (48, 64, 3)
    assert image.max() > 0.5

    reading = core.blender.read.scene.read(bpy.context)
    source = scene.kiriko.result.source
    viewer = scene.kiriko.viewer
    scene.kiriko.viewer = projector
    bpy.context.view_layer.update()
    seen = core.blender.preview.cycles_preview.render_preview(
        scene, reading, source, samples=64, fresnel=False
    )
    scene.kiriko.viewer = viewer
    assert np.abs(seen[..., :3] - image).mean() < 0.01

    scene.kiriko.export_path = str(tmp_path / "source.png")
    bpy.ops.kiriko.export()
    numbers, _ = core.files.image_io.read(tmp_path / "source.png")
    assert np.abs(numbers - core.files.image_io.encode(image)).max() < 0.51 / 255

    projector.kiriko.role = "GLASS"
    with pytest.raises(RuntimeError, match="'Projector' has the role Glass, but it has no surface"):
        bpy.ops.kiriko.solve()
    projector.kiriko.role = "NONE"
    with pytest.raises(RuntimeError, match="has screens but no projector"):
        bpy.ops.kiriko.solve()
    thing = new_object(primitive("cube", size=0.01), "PROJECTOR")
    with pytest.raises(RuntimeError, match=f"'{thing.name}' has the role Projector, but it isn't"):
        bpy.ops.kiriko.solve()


def test_the_command_line_writes_a_file_for_each_display(scene, run, tmp_path: Path):
    """With its name; existing ones are refused before anything is solved."""
    halves(small_rig()["DISPLAY"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    assert run("solve", "--out", out) == 0
    names = {path.name for path in out.iterdir()}
    for image in ("source_{}.png", "source_{}.exr"):
        assert {image.format(name) for name in ("Left", "Right")} <= names
    assert {"seen.png", "ideal.png", "report.json"} <= names
    assert "source.png" not in names
    assert run("solve", "--out", out) == 1
    assert run("maps", "--out", tmp_path / "maps", "--formats", "npz") == 0
    about = json.loads((tmp_path / "maps" / "maps.json").read_text())
    assert [one["name"] for one in about["sections"]] == ["Left", "Right"]


def test_a_moved_projector_or_screen_makes_the_result_old(scene):
    """And so does its resolution, or a screen's."""
    rig = small_rig()
    screen = rig["DISPLAY"]
    screen.kiriko.role = "SCREEN"
    projector = new_object(bpy.data.cameras.new("Projector"), "PROJECTOR")
    projector.kiriko.use_resolution, projector.kiriko.resolution = True, (64, 48)
    projector.matrix_world = screen.matrix_world @ Matrix.Translation((0.02, 0.01, 0.3))
    bpy.context.view_layer.update()
    has_changed = loaded("operators.watch").has_changed
    for change in (
        lambda: setattr(projector, "location", projector.location * 1.1),
        lambda: setattr(projector.kiriko, "resolution", (32, 24)),
        lambda: setattr(projector.data, "lens", 30.0),
        lambda: setattr(screen.kiriko, "resolution", (32, 32)),
        lambda: setattr(screen, "location", screen.location * 1.01),
    ):
        bpy.ops.kiriko.solve()
        assert not has_changed(bpy.context)
        change()
        bpy.context.view_layer.update()
        assert has_changed(bpy.context)
