"""Export Maps: the files, and Blender's own compositor as their reader."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from known.warp_readers import ramp
from map_uv import is_nearest, warped
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


def test_all_formats_are_written(scene: bpy.types.Scene, tmp_path: Path) -> None:
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


def test_map_uv_makes_the_source_image(scene: bpy.types.Scene, tmp_path: Path) -> None:
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
