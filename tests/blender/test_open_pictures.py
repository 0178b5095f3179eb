"""Open Pictures: files for all viewers, by the viewers' names."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from panel_layout import Layout
from small_rigs import pixels, small_rig

COLOURS = {"Kiriko Left Eye": (1.0, 0.0, 0.0), "Kiriko Right Eye": (0.0, 0.0, 1.0)}


@pytest.fixture
def folder(scene, tmp_path) -> Path:
    """A rig of two eyes, and a folder with an image of each eye's name."""
    small_rig()
    bpy.ops.kiriko.two_eyes()
    for name, colour in COLOURS.items():
        image = bpy.data.images.new("made", 8, 8)
        image.pixels.foreach_set(np.tile([*colour, 1.0], 64).astype(np.float32))
        image.filepath_raw = str(tmp_path / f"{name}.png")
        image.file_format = "PNG"
        image.save()
        bpy.data.images.remove(image)
    return tmp_path


def state() -> tuple:
    """What opening changes: the source, each viewer's image, the file's images."""
    ours = bpy.context.scene.kiriko
    own = [one.image for one in ours.viewers]
    return ours.picture_source, ours.picture_image, own, set(bpy.data.images)


@pytest.mark.parametrize("by", ["{viewer}.png", "Kiriko Left Eye.png", ""])
def test_each_viewer_has_the_image_of_its_name(folder, by):
    """By the mark, by the file of either, by the folder; the one who is off has none."""
    assert bpy.ops.kiriko.open_pictures(filepath=str(folder / by)) == {"FINISHED"}
    ours = bpy.context.scene.kiriko
    assert ours.picture_source == "IMAGE"
    assert ours.viewers[0].image is None
    found = {one.camera.name: pixels(one.image)[0, 0, :3] for one in list(ours.viewers)[1:]}
    assert found.keys() == COLOURS.keys()
    for name, colour in COLOURS.items():
        np.testing.assert_allclose(found[name], colour)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


@pytest.mark.parametrize("by", ["{viewer}.png", "Kiriko Left Eye.png", ""])
@pytest.mark.parametrize("is_broken", [False, True])
def test_one_that_is_missing_or_broken_changes_nothing(folder, by, is_broken):
    right = folder / "Kiriko Right Eye.png"
    right.unlink()
    if is_broken:
        right.write_text("no image")
    before = state()
    with pytest.raises(RuntimeError, match="the viewer 'Kiriko Right Eye'"):
        bpy.ops.kiriko.open_pictures(filepath=str(folder / by))
    assert state() == before


def test_a_file_that_is_nobody_s_is_refused(folder):
    before = state()
    for path, words in (
        (str(folder / "both.png"), "is a single file for 2 viewers: use {viewer}"),
        ("", "No file is chosen"),
    ):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.kiriko.open_pictures(filepath=path)
        assert state() == before


def test_the_panel_has_it_below_the_own_image(drawn, folder):
    bpy.context.scene.kiriko.picture_source = "IMAGE"
    shown: Layout = drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers")
    assert "kiriko.open_pictures" in shown.operators


def test_a_file_that_is_loaded_as_a_sequence_is_opened_beside_it(folder):
    """The sequence is another picture, and stays one."""
    sequence = bpy.data.images.load(str(folder / "Kiriko Left Eye.png"))
    sequence.source = "SEQUENCE"
    assert bpy.ops.kiriko.open_pictures(filepath=str(folder / "{viewer}.png")) == {"FINISHED"}
    assert sequence.source == "SEQUENCE"
    own = [one.image for one in bpy.context.scene.kiriko.viewers if one.image is not None]
    assert [image.source for image in own] == ["FILE", "FILE"]
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
