"""Export Atlas: warp maps over a grid of heads, whole, in parts, and checked."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from small_rigs import small_rig

BOX = {"low": (-0.02, 0.0, 0.0), "high": (0.02, 0.0, 0.01)}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.npz")}


def test_atlas_is_written(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Maps and source images for each place of the head; the scene is as it was."""
    small_rig()
    viewer = scene.kiriko.viewer
    before = viewer.matrix_world.copy()
    target = tmp_path / "atlas"
    assert bpy.ops.kiriko.export_atlas(
        directory=str(target), images=True, tolerance=2.0, **BOX
    ) == {"FINISHED"}
    assert viewer.matrix_world == before
    assert scene.kiriko.result.source is None

    told = json.loads((target / "index.json").read_text(encoding="utf-8"))
    assert told["axes"]["right"][0] == pytest.approx(-0.02)
    assert told["axes"]["forward"][-1] == pytest.approx(0.01)
    assert len(told["maps"]) == len(told["images"]) >= 4
    names = {path.name for path in target.iterdir()}
    assert names == {"index.json", *told["maps"], *told["images"]}
    with np.load(target / told["maps"][0]) as arrays:
        assert arrays["st"].shape == (64, 64, 2)
        assert 0 < (arrays["coverage"] > 0).mean() < 1
    image = bpy.data.images.load(str(target / told["images"][0]))
    assert tuple(image.size) == (64, 64)


def test_lengths_are_in_the_scene_s_unit(scene: bpy.types.Scene, tmp_path: Path) -> None:
    small_rig()
    scene.unit_settings.scale_length = 0.5
    bpy.ops.kiriko.export_atlas(directory=str(tmp_path), tolerance=5.0, **BOX)
    told = json.loads((tmp_path / "index.json").read_text(encoding="utf-8"))
    assert told["axes"]["right"][0] == pytest.approx(-0.01)


def test_many_machines_make_the_same_maps(
    scene: bpy.types.Scene,
    tmp_path: Path,
    run: Callable[..., int],
    capsys: pytest.CaptureFixture,
) -> None:
    """Planned, made in parts and checked, it is the atlas that one run makes, bit for bit."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    one, parts = tmp_path / "one", tmp_path / "parts"
    box = "--right", -20, 20, "--up", 0, 10, "--tolerance", 3
    assert run("atlas", "--out", one, *box) == 0
    assert re.search(r"Wrote \d+ maps .* px off at most", capsys.readouterr().out)

    assert run("atlas", "--out", parts, *box, "--plan") == 0
    assert re.search(r"places of the head .*: about .* min and .* MB", capsys.readouterr().out)
    assert contents(parts) == {}
    assert run("atlas", "--out", parts, "--check", 2) == 1
    assert "lacks 4 of 4 places" in capsys.readouterr().err
    for some in ("3-4", "2", "1-2"):
        assert run("atlas", "--out", parts, "--places", some) == 0
    assert run("atlas", "--out", parts, "--check", 2) == 0
    assert contents(parts) == contents(one)


def test_mistakes_are_one_sentence(
    scene: bpy.types.Scene,
    tmp_path: Path,
    run: Callable[..., int],
    capsys: pytest.CaptureFixture,
) -> None:
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = "atlas", "--out", tmp_path / "out"
    for given, code, sentence in (
        ((), 1, "The head does not move"),
        (("--right", 20, -20), 1, "The head moves from 20 to -20 mm to the right"),
        (("--forward", 0, 1e6), 1, "or behind it"),
        (("--right", 0, 20, "--tolerance", 0), 1, "set one above 0"),
        (
            ("--right", 0, 20, "--most", 1),
            1,
            "1 places of the head are too few: the corners of its box are 2.",
        ),
        (("--places", "0"), 2, "--places"),
        (("--places", "5-3"), 2, "--places"),
        (("--places", "1"), 1, "has no index.json: plan the atlas first"),
        (("--plan", "--check", 2), 2, "not allowed with"),
    ):
        assert run(*out, *given) == code, given
        told = capsys.readouterr().err
        assert sentence in told
        assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()

    with pytest.raises(RuntimeError, match="has no folder"):
        bpy.ops.kiriko.export_atlas(**BOX)
