"""Export Atlas: warp maps over a grid of heads, whole, in parts, and checked."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from extension import loaded
from known.kiriko_zip import kiriko_zip
from small_rigs import small_rig

BOX = {"low": (-0.02, 0.0, 0.0), "high": (0.02, 0.0, 0.01)}

MISSED = 0.003  # px, by the corners of the box of the small rig


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.npz")}


def test_atlas_is_written(scene, tmp_path):
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


def test_lengths_are_in_the_scene_s_unit(scene, tmp_path):
    small_rig()
    scene.unit_settings.scale_length = 0.5
    bpy.ops.kiriko.export_atlas(directory=str(tmp_path), tolerance=5.0, **BOX)
    told = json.loads((tmp_path / "index.json").read_text(encoding="utf-8"))
    assert told["axes"]["right"][0] == pytest.approx(-0.01)


def test_many_machines_make_the_same_maps(scene, tmp_path, run, capsys):
    """Planned, made in parts and checked, it is the atlas that one run makes, bit for bit."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    one, parts = tmp_path / "one", tmp_path / "parts"
    box = "--right", -20, 20, "--up", 0, 10, "--tolerance", 3
    assert run("atlas", "--out", one, *box) == 0
    assert re.search(r"Wrote \d+ maps .* px at most", capsys.readouterr().out)

    assert run("atlas", "--out", parts, *box, "--plan") == 0
    assert re.search(r"head positions .*: about .* min and .* MB", capsys.readouterr().out)
    assert contents(parts) == {}
    assert run("atlas", "--out", parts, "--check", 2) == 1
    assert "4 of 4 maps are missing" in capsys.readouterr().err
    for some in ("3-4", "2", "1-2"):
        assert run("atlas", "--out", parts, "--places", some) == 0
    assert run("atlas", "--out", parts, "--check", 2) == 0
    assert contents(parts) == contents(one)


def index(folder: Path) -> dict:
    """The index of an atlas, but for the time that its maps took."""
    told = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    return {**told, "planned": {**told["planned"], "seconds_a_map": None}}


def test_tasks_of_a_job_make_the_atlas_of_one_run(scene, tmp_path, run, capsys):
    """Task by task, as the bundle has them, some twice: the same files and the same index, where
    the check has the grid halved and where it has not.
    """
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    zipped = kiriko_zip(tmp_path / "kiriko-9.zip")
    halvings = []
    for tolerance in (3, MISSED):
        one, job = tmp_path / f"one {tolerance}", tmp_path / f"job {tolerance}"
        parts = job / "source"
        box = "--right", -20, 20, "--up", 0, 10
        for folder in (one, parts):  # planned too coarsely for the second tolerance
            assert run("atlas", "--out", folder, *box, "--tolerance", 3, "--plan") == 0
            told = json.loads((folder / "index.json").read_text(encoding="utf-8"))
            text = json.dumps({**told, "tolerance_px": tolerance})
            (folder / "index.json").write_text(text, encoding="utf-8")

        box = *box, "--tolerance", tolerance
        assert run("atlas", "--out", one, *box) == 0
        assert run("atlas", "--out", job, *box, "--job", 3, "--zip", zipped) == 0
        assert capsys.readouterr().err == ""
        for words in tasks_of(job, 3):
            assert run(*words) == 0, words
        assert contents(parts) == contents(one)
        assert index(parts) == index(one)
        halvings.append(index(one)["halvings"])
    assert halvings[0] == [0, 0, 0]
    assert sum(halvings[1]) >= 1


def tasks_of(job: Path, shares: int) -> Iterator[list[str]]:
    """The verbs of a job's tasks, each twice, as a scheduler fills in the parameters."""
    made = json.loads((job / "template.json").read_text(encoding="utf-8"))
    for step in made["steps"]:
        words = step["script"]["actions"]["onRun"]["args"]
        words = words[words.index("atlas") :]
        for share in (*range(1, shares + 1), 1) if "parameterSpace" in step else (1, 1):
            filled = {
                "{{Param.OutDir}}": str(job / "source"),
                "{{Task.Param.Share}}": str(share),
                "{{Param.Shares}}": str(shares),
            }
            yield [_filled_in(word, filled) for word in words]


def _filled_in(word: str, values: dict[str, str]) -> str:
    return re.sub(r"\{\{.*?\}\}", lambda found: values[found[0]], word)


def test_dialogue_writes_a_job_of_the_same_atlas(scene, tmp_path):
    """As a Job, in the command line's mm; wheels of a checkout may be missing, which is told."""
    extension = loaded("core.lab.farm.extension")
    small_rig()
    scene.unit_settings.scale_length = 0.5
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    target = tmp_path / "job"
    names = [name.removeprefix("./") for name in extension.manifest()["wheels"]]
    asked = {"directory": str(target), "job": True, "shares": 4, "images": True, **BOX}
    if not all((extension.ROOT / name).exists() for name in names):
        with pytest.raises(RuntimeError, match="cannot be packed for the farm"):
            bpy.ops.kiriko.export_atlas(**asked)
        assert not target.exists()
        return
    bpy.ops.kiriko.export_atlas(**asked)
    made = json.loads((target / "template.json").read_text(encoding="utf-8"))
    words = made["steps"][0]["script"]["actions"]["onRun"]["args"]
    words = words[words.index("atlas") :]
    numbers = [float(word) for word in (*words[2:4], *words[5:7])]
    assert words[1:8:3] == ["--right", "--forward", "--tolerance"]
    assert numbers == pytest.approx([-10, 10, 0, 5])
    assert words[-4:-2] == ["--images", "--plan"]
    assert not (target / "source").exists()


def test_mistakes_are_one_sentence(scene, tmp_path, run, capsys):
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = "atlas", "--out", tmp_path / "out"
    for given, code, sentence in (
        ((), 1, "The head does not move"),
        (("--right", 20, -20), 1, "range from 20 to -20 mm"),
        (("--forward", 0, 1e6), 1, "or behind it"),
        (("--right", 0, 20, "--tolerance", 0), 1, "set it above 0"),
        (("--right", 0, 20, "--most", 1), 1, "1 head positions are too few. Set 2 or more"),
        (("--places", "0"), 2, "--places"),
        (("--places", "5-3"), 2, "--places"),
        (("--places", "1"), 1, "has no index.json. Plan the atlas first"),
        (("--plan", "--check", 2), 2, "not allowed with"),
        (("--share", "3/2"), 2, "--share"),
        (("--share", "two"), 2, "--share"),
        (("--share", "1/2"), 1, "has no index.json. Plan the atlas first"),
        (("--halve",), 1, "has no index.json. Plan the atlas first"),
        (("--job", 2), 1, "The head does not move"),
        (("--job", 0), 2, "--job"),
        (("--forward", 0, 1e6, "--job", 2), 1, "or behind it"),
        (("--right", 0, 20, "--tolerance", 0, "--job", 2), 1, "set it above 0"),
        (("--right", 0, 20, "--most", 1, "--job", 2), 1, "Set 2 or more"),
        (("--right", 0, 20, "--job", 2000), 1, "Tasks 2000: set it from 1 to 1024"),
    ):
        assert run(*out, *given) == code, given
        told = capsys.readouterr().err
        assert sentence in told
        assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()

    with pytest.raises(RuntimeError, match="has no folder"):
        bpy.ops.kiriko.export_atlas(**BOX)


@pytest.mark.parametrize("name", ["orthographic", "own pixels", "two pictures"])
def test_a_job_is_refused_as_its_first_task_would_be(scene, tmp_path, run, capsys, name):
    """In the same sentence, by the command and by the button, and nothing is written."""
    parts = small_rig()
    ours = scene.kiriko
    if name == "orthographic":
        ours.viewer.data.type = "ORTHO"
    elif name == "own pixels":
        ours.picture_source, ours.picture_image = "IMAGE", bpy.data.images.new("own", 64, 64)
    else:
        scene.collection.objects.link(parts["PICTURE"].copy())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = "atlas", "--out", tmp_path / "out", "--right", -20, 20
    told = []
    for way in (("--plan",), ("--job", 2)):
        assert run(*out, *way) == 1
        told.append(capsys.readouterr().err)
    assert told[0] == told[1]
    sentence = re.escape(told[0].partition(": ")[2].strip())
    if name == "two pictures":  # the grey button says it in the checklist's words
        sentence = "2 objects have the role Picture"
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.kiriko.export_atlas(directory=str(tmp_path / "out"), job=True, **BOX)
    assert not (tmp_path / "out").exists()
