"""Export Maps: the files, and Blender's own compositor as their reader."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from known.map_uv import is_nearest, warped
from known.warp_readers import ramp
from small_rigs import pixels, small_rig

ALL = {"EXR", "FFMPEG", "OBJ", "DATA", "NPZ", "PNG"}
NAMES = {
    "warp.exr", "view.exr", "x.pgm", "y.pgm", "warp.obj", "warp.data", "warp.npz", "warp.png",
    "maps.json",
}  # fmt: skip


def places(stmap: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Places (h, w, 2) of an STMap in a picture, px from the upper left."""
    return np.stack([stmap[..., 0] * size[0], (1 - stmap[..., 1]) * size[1]], axis=2)


def numbers_of(path: Path) -> np.ndarray:
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    return pixels(image)


def cauchy(a: float, b: float) -> Any:
    """An index n = a + b / wavelength^2, as of glass that disperses."""
    module = loaded("core.rig.parts")

    @dataclass(frozen=True)
    class Cauchy(module.Index):
        a: float
        b: float

        def at(self, wavelength: float) -> float:
            return self.a + self.b / wavelength**2

    return Cauchy(a, b)


def test_glass_that_disperses_has_a_map_for_each_colour(scene, run, tmp_path, monkeypatch):
    """By the button and the command line, for each of two viewers: each map is that of glass whose
    index is the same for all light, and is the one of that colour.
    """
    glass = small_rig()["GLASS"]
    first = scene.kiriko.viewer or scene.camera
    second = first.copy()
    second.name, second.location.x = "Second", first.location.x + 0.02
    scene.collection.objects.link(second)
    for camera in (first, second):
        scene.kiriko.viewers.add().camera = camera
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    index = cauchy(1.3, 1e-13)
    alone = {}
    for nm in (611, 549, 464):
        glass.kiriko.ior = index.at(nm * 1e-9)
        folder = tmp_path / str(nm)
        bpy.ops.kiriko.export_maps(directory=str(folder), formats={"NPZ"})
        alone[nm] = {path.stem: np.load(path) for path in folder.glob("*.npz")}
        assert alone[nm].keys() == {"warp_Kiriko_Viewer", "warp_Second"}

    work = loaded("operators.work")
    read = work.read

    def dispersing(*arguments: Any) -> Any:
        reading = read(*arguments)
        glasses = tuple(replace(one, ior=index) for one in reading.rig.glasses)
        return replace(reading, rig=replace(reading.rig, glasses=glasses))

    monkeypatch.setattr(work, "read", dispersing)
    button, line = tmp_path / "button", tmp_path / "line"
    bpy.ops.kiriko.export_maps(directory=str(button), formats={"NPZ"})
    assert run("maps", "--formats", "npz", "--out", line) == 0
    for folder in (button, line):
        about = json.loads((folder / "maps.json").read_text())["maps"]
        assert len(list(folder.glob("*.npz"))) == len(about) == 6
        for one in about:
            nm = round(one["wavelength_nm"])
            assert one["index"]["Cube"] == pytest.approx(index.at(nm * 1e-9), abs=1e-12)
            (name,) = one["files"]["NPZ"]
            found, wanted = np.load(folder / name), alone[nm][name.removesuffix(f"_{nm}nm.npz")]
            for key in ("map_x", "map_y", "coverage"):
                assert np.allclose(found[key], wanted[key], atol=0.001)  # ior is float32
    maps = [np.load(path)["map_x"] for path in sorted(button.glob("warp_Second*.npz"))]
    assert not np.allclose(maps[0], maps[-1], atol=0.2)


@pytest.mark.every_blender
def test_all_formats_are_written(scene, tmp_path):
    """All files and their description; the scene is as it was, without a source image."""
    small_rig()
    assert bpy.ops.kiriko.export_maps(directory=str(tmp_path / "maps"), formats=ALL) == {"FINISHED"}
    assert {path.name for path in (tmp_path / "maps").iterdir()} == NAMES
    assert scene.kiriko.result.source is None

    about = json.loads((tmp_path / "maps" / "maps.json").read_text())
    (one,) = about["maps"]
    assert about["display"]["size"] == [64, 64]
    assert about["picture"] == {
        "name": "Kiriko Picture",
        "size": [1024, 1024],
        "is_on": "a plane",
    }
    assert {name for names in one["files"].values() for name in names} == NAMES - {"maps.json"}
    assert one["index"] == {"Cube": pytest.approx(1.49)}
    assert one["ffmpeg"]["command"].startswith("ffmpeg -i PICTURE -i x.pgm -i y.pgm ")
    assert 0.2 < one["coverage"] <= 1

    stmap = numbers_of(tmp_path / "maps" / "warp.exr")
    assert stmap.shape == (64, 64, 4)
    assert stmap[..., 2].mean() == pytest.approx(one["picture_on_display"], rel=1e-5)
    assert (stmap[..., 3] == 1).all()
    of_png = numbers_of(tmp_path / "maps" / "warp.png")
    there = stmap[..., 2] > 0
    assert np.abs(of_png - stmap)[there][:, :3].max() < 1 / 65535
    assert not of_png[~there][:, :3].any()


def test_map_uv_makes_the_source_image(scene, tmp_path):
    """Blender's compositor, given the picture and the map, shows the places that the map says, to
    1e-3 px; and these are those of Kiriko's own source image.
    """
    objects = small_rig()
    bpy.ops.kiriko.export_maps(directory=str(tmp_path))
    stmap = numbers_of(tmp_path / "warp.exr")
    picture = ramp(1024, 1024)
    found = warped(picture, tmp_path / "warp.exr", tmp_path)

    xy = places(stmap, (1024, 1024))
    sure = stmap[..., 2] > 1 - 1e-6
    sure &= ((xy > 1) & (xy < 1023)).all(axis=2)
    assert sure.sum() > 1000
    if is_nearest():
        xy = np.floor(xy) + 0.5
        near = np.abs(places(stmap, (1024, 1024)) - np.rint(places(stmap, (1024, 1024))))
        sure &= (near > 1e-3).all(axis=2)
    assert np.abs(found[..., :2] - xy)[sure].max() < 1e-3

    # a file by Kiriko's own hand: a pixel shows the mean of what its light asks for
    image = bpy.data.images.new("ramp", 1024, 1024, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set((picture[::-1] / [1024, 1024, 1, 1]).astype(np.float32).ravel())
    objects["PICTURE"].kiriko.image = image
    bpy.ops.kiriko.solve()
    source = pixels(scene.kiriko.result.source)[..., :2] * 1024
    off = np.abs(source - places(stmap, (1024, 1024)))[sure]
    assert np.median(off) < 0.05 * 1024 / 64


def test_files_that_are_there_are_kept(scene, tmp_path):
    """All or none: one that is taken is reason enough to refuse, before any work."""
    small_rig()
    taken = tmp_path / "view.exr"
    taken.write_text("mine")
    with pytest.raises(RuntimeError, match=r"has view\.exr already: choose another or turn on"):
        bpy.ops.kiriko.export_maps(directory=str(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["view.exr"]
    assert taken.read_text() == "mine"

    bpy.ops.kiriko.export_maps(directory=str(tmp_path), formats={"NPZ"})
    assert {path.name for path in tmp_path.iterdir()} == {"view.exr", "warp.npz", "maps.json"}
    beside = tmp_path / "mine.npz"
    beside.write_text("mine")
    bpy.ops.kiriko.export_maps(directory=str(tmp_path), overwrite=True)
    # what maps.json told of before is of another rig now
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"view.exr", "warp.exr", "maps.json", "mine.npz"}
    assert taken.read_bytes()[:4] == bytes([0x76, 0x2F, 0x31, 0x01])  # OpenEXR's first bytes


def test_picture_that_ffmpeg_has_no_room_for_is_one_sentence(scene, tmp_path):
    """It comes before any work, and leaves no folder."""
    small_rig()["PICTURE"].kiriko.image = bpy.data.images.new("Wide", 16384, 1)
    with pytest.raises(RuntimeError, match=r"has 16384 x 1 pixels.* allow 16383: set a"):
        bpy.ops.kiriko.export_maps(directory=str(tmp_path / "m"), formats={"FFMPEG"}, times="4")
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"directory": ""}, "The maps have no folder: choose one."),
        ({"formats": set()}, "No map format is selected. Select one or more."),
    ],
)
def test_nothing_to_write_is_one_sentence(scene, tmp_path, given, sentence):
    small_rig()
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.kiriko.export_maps(**{"directory": str(tmp_path / "new"), **given})
    assert not (tmp_path / "new").exists()


def export_maps_told(folder: Path, formats: set[str], capfd: pytest.CaptureFixture) -> str:
    """What Export Maps prints."""
    capfd.readouterr()
    assert bpy.ops.kiriko.export_maps(directory=str(folder), formats=formats) == {"FINISHED"}
    return capfd.readouterr().out


def test_maps_that_memory_does_not_hold_are_refused(scene, tmp_path, monkeypatch):
    """Before any work, with a remedy."""
    small_rig()
    options = loaded("core.lab.warp.map_files")
    monkeypatch.setattr(options, "BYTES", 1e15)
    with pytest.raises(RuntimeError, match=r"Exporting maps needs about .* GB of memory"):
        bpy.ops.kiriko.export_maps(directory=str(tmp_path), formats={"NPZ"})
    assert not list(tmp_path.iterdir())


def test_without_openimageio_all_but_exr_is_written(scene, tmp_path, monkeypatch, capfd):
    """The PNG has the same numbers, to the last."""
    small_rig()
    both = {"PNG", "NPZ"}
    bpy.ops.kiriko.export_maps(directory=str(tmp_path / "with"), formats=both)
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with pytest.raises(RuntimeError, match=r"has no OpenImageIO.*: choose other formats, or"):
        bpy.ops.kiriko.export_maps(directory=str(tmp_path / "without"))
    told = export_maps_told(tmp_path / "without", both | {"EXR"}, capfd)
    assert "This Blender can't write .exr: OpenImageIO is missing." in told
    assert not (tmp_path / "without" / "warp.exr").exists()
    one, other = (numbers_of(tmp_path / name / "warp.png") for name in ("with", "without"))
    assert np.abs(one - other)[..., :3].max() == 0


def test_command_writes_maps_and_prints_the_one_for_ffmpeg(scene, tmp_path, capsys):
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    run = loaded("operators.cli.command_line").run
    out = ["--out", str(tmp_path / "out")]
    given = ["--formats", "ffmpeg", "data", "--times", "4", "--overscan", "5", "--mesh-step", "4"]
    assert run(["maps", *out, *given]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "kiriko: ffmpeg -i PICTURE -i x.pgm" in told.out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"x.pgm", "y.pgm", "warp.data", "maps.json"}
    about = json.loads((tmp_path / "out" / "maps.json").read_text())
    assert about["overscan_percent"] == 5
    assert about["maps"][0]["mesh"]["nodes"] == [17, 17]
    assert (tmp_path / "out" / "x.pgm").read_bytes().startswith(b"P5\n256 256\n65535\n")

    assert run(["maps", *out, "--formats", "data"]) == 1
    assert "add --overwrite" in capsys.readouterr().err
    assert run(["maps", *out, "--overscan", "-1"]) == 1
    assert "Overscan -1 %: set it from 0 to 100." in capsys.readouterr().err
    assert run(["maps", *out, "--formats", "gif"]) == 2
