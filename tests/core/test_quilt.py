"""Quilts as files: names that players read, calibrations of devices, interlaced images."""

import json
from math import hypot
from pathlib import Path

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError
from kiriko.core.files.quilt import LensSheet, interlaced, quilt_name, read_lens_sheet, tile_of

PORTRAIT = {
    "pitch": {"value": 52.5741},
    "slope": {"value": -7.19256},
    "center": {"value": 0.565845},
    "DPI": {"value": 324.0},
    "screenW": {"value": 60.0},
    "screenH": {"value": 80.0},
    "invView": {"value": 1.0},
    "flipImageX": {"value": 0.0},
}


def quilt_of(tiling, size=(15, 20), seed=0):
    """A quilt of noise."""
    width, height = tiling[0] * size[0], tiling[1] * size[1]
    return np.random.default_rng(seed).random((height, width, 3)).astype(np.float32)


def written(folder, **changes):
    path = folder / "visual.json"
    path.write_text(json.dumps(PORTRAIT | changes), encoding="utf-8")
    return path


@pytest.mark.parametrize("slope", [-7.2, 5.0, 1.3])
@pytest.mark.parametrize(("is_inverted", "is_bgr"), [(True, False), (False, True)])
def test_each_part_of_a_pixel_is_under_its_lens(slope, is_inverted, is_bgr):
    """Brute force, part by part: the distance, across the lenses, of its place on the panel from
    the lens that begins at the lower left corner, in lenses; its fraction is the view.
    """
    tiling = 4, 3
    sheet = LensSheet(61.0, slope, 0.3, 250.0, 24, 18, is_inverted, is_bgr=is_bgr)
    quilt = quilt_of(tiling, (6, 9))
    found = interlaced(quilt, tiling, sheet)
    for row in range(18):
        for column in range(24):
            for colour in range(3):
                part = 2 - colour if is_bgr else colour
                x, y = (column + 0.5 + part / 3) / 250, (18 - row - 0.5) / 250  # inches
                across = (abs(slope) * x + np.sign(slope) * y) / hypot(1, slope)
                fraction = (61.0 * across - 0.3) % 1
                view = int(12 * (1 - fraction if is_inverted else fraction))
                tile = tile_of(quilt, view, tiling)
                wanted = tile[(2 * row + 1) * 9 // 36, (2 * column + 1) * 6 // 48, colour]
                assert found[row, column, colour] == wanted


@pytest.mark.parametrize("seed", range(4))
def test_quiltwright_weaves_the_same_image(tmp_path, seed):
    """The public program quiltwright reads the name, the calibration and the tiles of a quilt, and
    interlaces it: every part of every pixel is the same.
    """
    weave = pytest.importorskip("quiltwright.weave")
    spec = pytest.importorskip("quiltwright.quilt").QuiltSpec
    random = np.random.default_rng(seed)
    slope = {"value": float(random.choice([-1, 1]) * random.uniform(2, 9))}
    path = written(tmp_path, slope=slope, flipImageX={"value": float(seed % 2)})
    tiling = 8, 6
    quilt = quilt_of(tiling, seed=seed)
    theirs = weave.weave_quilt(
        quilt, spec(*tiling, quilt.shape[1], quilt.shape[0], 0.75), weave.Calibration.load(path)
    )
    assert (interlaced(quilt, tiling, read_lens_sheet(path)) == theirs).all()

    name = quilt_name(Path("ball_qs1x1a1.png"), tiling, 0.75)
    assert name.name == spec(8, 6, 1, 1, 0.75).filename("ball") == "ball_qs8x6a0.75.png"


def test_a_calibration_that_is_missing_or_broken(tmp_path):
    """One sentence each."""
    with pytest.raises(ImageError, match="cannot be read"):
        read_lens_sheet(tmp_path / "none.json")
    for match, change in {
        "not the calibration": {"pitch": "none"},
        "pitch 0": {"pitch": 0.0},
        "covers": {"screenW": 0},
        "in cells": {"subpixelCells": [{"ROffsetX": 0.1}]},
    }.items():
        with pytest.raises(ImageError, match=match):
            read_lens_sheet(written(tmp_path, **change))
    (tmp_path / "list.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(ImageError, match="not the calibration"):
        read_lens_sheet(tmp_path / "list.json")
