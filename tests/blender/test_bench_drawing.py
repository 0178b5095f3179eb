import math
import re
from xml.etree import ElementTree

import bpy
import pytest
from mathutils import Matrix

from extension import loaded
from small_rigs import small_rig


def test_both_sheets_are_written(scene, tmp_path):
    """Both are SVG files of the paper's size; the scene is as it was."""
    small_rig()
    assert bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "bench"), paper="A3") == {
        "FINISHED"
    }
    assert {path.name for path in tmp_path.iterdir()} == {"bench.svg", "bench_seen.svg"}

    for path in tmp_path.iterdir():
        top = ElementTree.parse(path).getroot()
        assert (top.get("width"), top.get("height")) == ("420mm", "297mm")
    assert "Kiriko Plate" in (tmp_path / "bench.svg").read_text()


def test_units_of_the_scene_change_no_drawing(scene, tmp_path):
    """Millimetres are those of the bench, whatever a Blender unit is."""
    small_rig()
    bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "a.svg"))
    scene.unit_settings.scale_length = 1e-3
    for thing in scene.objects:
        at = thing.matrix_world.copy()
        thing.matrix_world = Matrix.Scale(1e3, 4) @ at
        if thing.type == "CAMERA":  # which has no size
            thing.scale = (1, 1, 1)
    bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "b.svg"))
    a, b = (re.findall(r">([^<]+)</text>", (tmp_path / f"{x}.svg").read_text()) for x in "ab")
    assert a == b


def test_files_that_are_there_are_kept(scene, tmp_path):
    """Both or none: the second sheet alone is reason enough to refuse."""
    small_rig()
    taken = tmp_path / "bench_seen.svg"
    taken.write_text("mine")
    path = str(tmp_path / "bench.svg")

    with pytest.raises(RuntimeError, match=r"has bench_seen\.svg already"):
        bpy.ops.kiriko.bench_drawing(filepath=path)
    assert [p.name for p in tmp_path.iterdir()] == ["bench_seen.svg"]
    assert taken.read_text() == "mine"

    bpy.ops.kiriko.bench_drawing(filepath=path, overwrite=True)
    assert taken.read_text() != "mine"


def test_picture_that_is_seen_edge_on_is_one_sentence(scene, tmp_path):
    small_rig()
    picture = scene.objects["Kiriko Picture"]
    picture.matrix_world = picture.matrix_world @ Matrix.Rotation(math.pi / 2, 4, "Y")
    with pytest.raises(RuntimeError, match="'Kiriko Picture' is seen edge-on: turn it"):
        bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "bench.svg"))
    assert not list(tmp_path.iterdir())


def test_bent_picture_has_one_sheet(scene, tmp_path):
    """The lattice has no place on it, and the bench is drawn all the same."""
    small_rig()
    scene.objects["Kiriko Picture"].data.vertices[0].co.z += 0.01
    bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "bench.svg"))
    assert [path.name for path in tmp_path.iterdir()] == ["bench.svg"]


def test_rig_that_is_none_is_one_sentence(scene, tmp_path):
    small_rig()
    scene.objects["Kiriko Display"].scale = (0, 0, 0)
    with pytest.raises(RuntimeError, match=r"^Error: .*Kiriko Display.*\.$"):
        bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / "bench.svg"))
    assert not list(tmp_path.iterdir())


def test_command_draws_the_bench(scene, tmp_path, capsys):
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    run = loaded("operators.cli.command_line").run
    out = tmp_path / "out"
    assert run(["drawing", "--out", str(out), "--paper", "A3"]) == 0
    assert {path.name for path in out.iterdir()} == {"bench.svg", "bench_seen.svg"}
    assert run(["drawing", "--out", str(out)]) == 1
    assert "add --overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "written"),
    [("x.pdf", "x"), ("x.PDF", "x"), ("x.svg", "x"), ("x.v2", "x.v2"), ("a.pdf.svg", "a.pdf")],
)
def test_a_name_of_another_kind_gets_the_drawings_own_suffix(scene, tmp_path, name, written, capfd):
    """SVG is what is written, so that no file is called .pdf.svg; the report has its name."""
    small_rig()
    bpy.ops.kiriko.bench_drawing(filepath=str(tmp_path / name))
    assert {path.name for path in tmp_path.iterdir()} == {f"{written}.svg", f"{written}_seen.svg"}
    assert f"Wrote {written}.svg, " in capfd.readouterr().out
