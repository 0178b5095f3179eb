"""The show window as far as a Blender without windows has it; `dev.py shown` shows a real one."""

from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import pixels, small_rig


@pytest.fixture
def show(scene) -> ModuleType:
    return loaded("operators.show_window")


@pytest.fixture
def shown_pixels(scene) -> ModuleType:
    return loaded("panels.shown_pixels")


@pytest.mark.parametrize("gamma", [None, 1.8])
def test_numbers_are_those_of_the_exported_file(shown_pixels, kiriko, tmp_path, gamma):
    """Each pixel that is drawn has the three numbers of the 8-bit file, to the last bit."""
    image_io = loaded("core.files.image_io")
    pixels = np.random.default_rng(2).normal(0.5, 0.5, (48, 64, 4)).astype(np.float32)
    path = image_io.write(tmp_path / "a.png", pixels[..., :3], "PNG8", gamma=gamma)
    written, _ = image_io.read(path)
    drawn = shown_pixels.numbers_of(pixels, gamma)
    assert np.array_equal(np.rint(255 * drawn[::-1, :, :3]), np.rint(255 * written))
    assert (drawn[..., 3] == 1).all()


@pytest.mark.parametrize("region", [(1920, 1080), (1921, 1081), (640, 480), (3840, 2160)])
def test_pixels_lie_on_pixels(shown_pixels, region):
    """Whole numbers, in the middle to half a pixel, whether the window is larger or smaller."""
    x, y = shown_pixels.corner_of((1920, 1080), region)
    assert isinstance(x, int)
    assert isinstance(y, int)
    assert abs(region[0] - 1920 - 2 * x) <= 1
    assert abs(region[1] - 1080 - 2 * y) <= 1


def test_result_is_that_of_the_rig_that_is_chosen(show, scene):
    """Of two rigs the one that is named, whichever is active; the active one for any other name."""
    small_rig()
    bpy.ops.kiriko.solve()
    first = scene.kiriko.result.source
    (name,) = (group.name for group in bpy.data.collections if group.kiriko.is_rig)
    for thing in scene.objects:
        thing.select_set(False)
    bpy.context.view_layer.objects.active = None
    bpy.ops.kiriko.add_rig()
    assert scene.kiriko.result.source is None

    ours = bpy.context.window_manager.kiriko
    try:
        assert show.shown_result(scene).source is None
        ours.show_rig = name
        assert show.shown_result(scene).source == first
        ours.show_rig = "a rig that was removed"
        assert show.shown_result(scene).source is None
    finally:
        ours.show_rig = ""


def test_without_a_window_the_button_is_grey(show, scene):
    """In the background it is refused with a sentence, and nothing is opened."""
    small_rig()
    bpy.ops.kiriko.solve()
    with pytest.raises(RuntimeError, match="without --background"):
        bpy.ops.kiriko.show_window()
    assert show.show_windows() == []


def test_panel_tells_whether_the_window_fits(scene):
    """The same size is told as such; else both sizes and the keys are named."""
    panel = loaded("panels.export_panel")
    assert "1920 x 1080" in panel.words_on((1920, 1080), (1920, 1080), "F11")
    text = panel.words_on((1280, 720), (1920, 1080), "Alt F11")
    assert "1280 x 720" in text
    assert "1920 x 1080" in text
    assert text.endswith("press Alt F11.")


def test_undo_and_redo_show_the_result_of_that_time(show, scene, monkeypatch):
    """That of before the step, and of after it; windows are drawn anew each time."""
    small_rig()
    drawn = []
    monkeypatch.setattr(show, "redraw", lambda: drawn.append(True))
    images = []
    for turn in (0.0, 0.3):
        bpy.data.objects["Cube"].rotation_euler.z = turn
        bpy.ops.kiriko.solve()
        bpy.ops.ed.undo_push(message="solved")
        images.append(pixels(show.shown_result(bpy.context.scene).source))
    assert np.abs(images[0] - images[1]).max() > 0.1

    for step, image in ((bpy.ops.ed.undo, images[0]), (bpy.ops.ed.redo, images[1])):
        drawn.clear()
        step()
        assert np.array_equal(pixels(show.shown_result(bpy.context.scene).source), image)
        assert drawn
