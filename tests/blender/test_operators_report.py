import csv
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import inventory, pixels, short_reports, small_rig

NAMES = ["eye_box.svg", "report.csv", "report.json", "report.svg"]
SECONDS = 0.5  # of brute force: a few samples a pixel


@pytest.fixture(autouse=True)
def quick(kiriko, monkeypatch):
    """The tests here are of the way to the files."""
    short_reports(kiriko, monkeypatch)


@pytest.fixture
def rig(scene) -> dict[str, bpy.types.Object]:
    """A rig that is not in the session yet."""
    loaded("operators.work").forget()
    return small_rig()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_report_writes_its_files_and_leaves_the_scene(rig, scene, tmp_path):
    """Four files, of which two agree on the rungs, and one has the curves of the eye box.

    Result, image and objects stay as they were, but for the costs.
    """
    bpy.ops.kiriko.solve()
    before = inventory()
    shown = pixels(scene.kiriko.result.source).copy()
    numbers = json.loads(scene.kiriko.result.details)

    assert not numbers["cost"]["is_measured"]
    assert bpy.ops.kiriko.report(directory=str(tmp_path / "new"), seconds=SECONDS) == {"FINISHED"}
    assert names(tmp_path / "new") == NAMES
    report = json.loads((tmp_path / "new" / "report.json").read_text())
    with (tmp_path / "new" / "report.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 1 + len(report["rungs"])
    ET.parse(tmp_path / "new" / "report.svg")
    ET.parse(tmp_path / "new" / "eye_box.svg")
    bpy.ops.kiriko.eye_box()
    box = loaded("operators.eye_box").box_of(bpy.data.objects["Kiriko Eye Box"])
    assert report["eye_box"]["ends_m"] == {name: box[name] for name in report["eye_box"]["ends_m"]}
    assert [one["way"] for one in report["eye_box"]["curves"]] == list(report["eye_box"]["ends_m"])
    bpy.ops.kiriko.remove_eye_box()

    assert report["display_px"] == [64, 64]
    assert report["tolerance_display_px"] == 0.1
    assert report["about"]["blender"] == bpy.app.version_string
    assert {"reading the scene", "plan", "tracing", "shares", "painting", "writing"} <= set(
        report["seconds_by_part"]
    )
    assert all(seconds is not None for seconds in report["seconds_by_part"].values())
    assert inventory() == before
    assert np.array_equal(shown, pixels(scene.kiriko.result.source))

    after = json.loads(scene.kiriko.result.details)
    assert after["cost"]["is_measured"]
    assert after["cost"]["half"]["tolerance"] == pytest.approx(0.05)
    for told in (after, numbers):
        told.pop("cost", None)
        told.pop("checksum")
    assert after == numbers


def test_a_report_needs_no_solve_before_and_its_costs_serve_the_next(rig, scene, tmp_path):
    """The measured ladder is kept with the scene: the next solve tells its costs by it.

    A re-paint keeps them.
    """
    assert bpy.ops.kiriko.report(directory=str(tmp_path), seconds=SECONDS) == {"FINISHED"}
    # Add Rig knows the legibility alone
    assert "cost" not in json.loads(scene.kiriko.result.details)
    bpy.ops.kiriko.solve()
    first = json.loads(scene.kiriko.result.details)
    assert first["cost"]["is_measured"]
    assert first["total_seconds"] == pytest.approx(sum(first["seconds"].values()))
    rig["PICTURE"].kiriko.image = bpy.data.images.new("white", 8, 8)
    bpy.ops.kiriko.solve()
    assert json.loads(scene.kiriko.result.details)["cost"] == first["cost"]


def test_unsolvable_rig_writes_nothing(rig, scene, tmp_path):
    """A plate that no ray reaches is one sentence.

    Not even the folder is left, and the last result stays.
    """
    bpy.ops.kiriko.solve()
    before = scene.kiriko.result.details
    rig["PLATE"].location.x += 10
    with pytest.raises(RuntimeError, match="no ray reaches the plate: move or enlarge it"):
        bpy.ops.kiriko.report(directory=str(tmp_path / "new"))
    assert names(tmp_path) == []
    assert scene.kiriko.result.details == before


def test_existing_report_is_replaced_only_when_told(rig, tmp_path):
    """One of the files is enough to refuse, before any work.

    The others are not written beside it.
    """
    (tmp_path / "report.svg").write_bytes(b"mine")
    with pytest.raises(RuntimeError, match=r"has report\.svg already"):
        bpy.ops.kiriko.report(directory=str(tmp_path))
    assert names(tmp_path) == ["report.svg"]
    assert (tmp_path / "report.svg").read_bytes() == b"mine"
    assert bpy.ops.kiriko.report(directory=str(tmp_path), seconds=SECONDS, overwrite=True) == {
        "FINISHED"
    }
    assert names(tmp_path) == NAMES
    assert (tmp_path / "report.svg").read_bytes().startswith(b"<svg")


def test_folder_that_cannot_be_written_is_one_sentence(rig, tmp_path):
    """A folder below a file, one beside a .blend never saved, and none at all."""
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.kiriko.report(directory=str(tmp_path / "file" / "below"))
    with pytest.raises(RuntimeError, match="never saved"):
        bpy.ops.kiriko.report()
    bpy.context.scene.kiriko.report_folder = ""
    with pytest.raises(RuntimeError, match="no folder"):
        bpy.ops.kiriko.report()
    assert names(tmp_path) == ["file"]


def test_command_writes_the_report_and_prints_the_table(run, rig, tmp_path, capsys):
    """Exit code 0; progress and table on stdout, nothing on stderr, the files in the folder."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    assert run("report", "--out", out, "--seconds", SECONDS) == 0
    told = capsys.readouterr()
    assert told.err == ""
    for word in ("%", "adaptive 0.1 px", "splat 1 spp", "splat 1024 spp", "not run", "Peak memory"):
        assert word in told.out
    assert names(out) == NAMES
    assert json.loads((out / "report.json").read_text())["about"]["file"] == "rig.blend"
    assert run("report", "--out", out) == 1
    assert "report.csv, report.json, report.svg, eye_box.svg already" in capsys.readouterr().err
    assert run("report", "--out", out, "--overwrite", "--seconds", 0) == 0


def test_command_eyes_writes_what_is_told_of_heads_and_eyes_alone(run, rig, tmp_path, capsys):
    """Of one viewer its eye box by the limit that is given; of two eyes both, as drawings, too. A
    picture in the viewer's pixels is told in a sentence.
    """
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    one, two, three = (tmp_path / name for name in ("one", "two", "three"))
    assert run("eyes", "--out", one, "--limit", 0.5) == 0
    assert names(one) == ["eye_box.svg", "eyes.json"]
    assert run("eyes", "--out", one) == 1
    assert "has eye_box.svg, eyes.json already" in capsys.readouterr().err
    narrow = json.loads((one / "eyes.json").read_text())["eye_box"]
    assert narrow["limit_arcmin"] == 0.5

    bpy.ops.kiriko.two_eyes()
    assert run("eyes", "--out", two) == 0
    assert names(two) == ["eye_box.svg", "eyes.json", "head_box.svg", "two_eyes.svg"]
    told = json.loads((two / "eyes.json").read_text())
    box = told["head_box"]
    assert box["n_viewers"] == 2
    assert box["size_m"][0] == pytest.approx(0.065, rel=1e-3)
    assert [curve["axis"] for curve in box["for_all"]["curves"]] == ["right"]
    assert box["for_middle"]["middle_largest_arcmin"] == pytest.approx(0, abs=1e-6)
    assert box["worse_at_middle_arcmin"] > 0
    ET.parse(two / "head_box.svg")
    assert told["eye_box"]["ends_m"]["left"] > narrow["ends_m"]["left"]
    ET.parse(two / "two_eyes.svg")
    seen = told["two_eyes"]["for_both"]
    # what the panel tells of a solve on its own pixels is that, but for these
    bpy.ops.kiriko.solve()
    panel = json.loads(bpy.context.scene.kiriko.result.details)["two_eyes"]
    assert (panel["left"], panel["right"]) == (told["two_eyes"]["left"], told["two_eyes"]["right"])
    depths = np.array(seen["depth_m"], float)
    assert np.nanmean(depths) == pytest.approx(panel["mean_depth_m"], rel=0.05)
    # and of each viewer, by the way that is chosen, too; an edge that is seen double is less sharp
    ways = told["disagreement"]
    assert list(ways) == ["sharp", "blended"]
    details = json.loads(bpy.context.scene.kiriko.result.details)["viewers"]
    for here, there in zip(ways["sharp"], details, strict=True):
        assert there == {key: here[key] for key in there}
    for sharp, blended in zip(ways["sharp"], ways["blended"], strict=True):
        assert 0 < blended["mtf50_per_px"] <= sharp["mtf50_per_px"] < 1

    bpy.context.scene.kiriko.picture_source = "IMAGE"
    bpy.context.scene.kiriko.picture_image = bpy.data.images["Kiriko Lattice"]
    bpy.context.scene.kiriko.viewers.clear()
    capsys.readouterr()
    assert run("eyes", "--out", three) == 1
    assert "in the viewer's pixels" in capsys.readouterr().err
    assert not three.exists()
    wrong = {
        "--limit=0": "Limit 0: set it above 0",
        "--limit=inf": "Limit inf: set it above 0",
        "--share=1.5": "Share 1.5: set it from 0 to 1",
        "--share=nan": "Share nan: set it from 0 to 1",
    }
    for option, why in wrong.items():
        assert run("eyes", "--out", three, option) == 2
        assert why in capsys.readouterr().err


@pytest.mark.parametrize("way", ["SHARP", "BLENDED", "own images"])
def test_several_viewers_are_told_by_the_same_numbers_everywhere(
    run, kiriko, rig, way, tmp_path, capsys
):
    """After a solve, in a report, by the verb that measures nothing; and in the same words."""
    words = loaded("operators.viewer_reports")
    scene = bpy.context.scene
    bpy.ops.kiriko.two_eyes()
    if way == "own images":
        scene.kiriko.picture_source = "IMAGE"
        for one in scene.kiriko.viewers:
            one.image = bpy.data.images["Kiriko Lattice"].copy()
    else:
        scene.kiriko.disagreement = way
    bpy.ops.kiriko.solve()
    details = json.loads(scene.kiriko.result.details)
    expected = {name: details[name] for name in ("viewers", "conflict")}
    assert expected["conflict"]["unit"] == ("px" if way == "SHARP" else "white")
    assert expected["conflict"]["largest"] > 0.01
    text = [str(line) for line in words.lines(scene, details)]
    assert any(line.startswith("Conflict at most") for line in text)

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    for verb, name in (("solve", "report"), ("report", "report"), ("eyes", "eyes")):
        capsys.readouterr()
        options = ("--seconds", 0) if verb == "report" else ()
        assert run(verb, "--out", tmp_path / verb, *options) == 0
        told = json.loads((tmp_path / verb / f"{name}.json").read_text())
        assert {key: told[key] for key in expected} == expected
        printed = capsys.readouterr().out
        assert [line for line in text if f"kiriko: {line}\n" not in printed] == []


def test_what_goes_wrong_beside_a_report_does_not_lose_it(
    run, kiriko, rig, tmp_path, monkeypatch, capfd
):
    """All else is there; the missing is told in sentences and in report.json, whether its error was
    foreseen or not. The verb that tells nothing else ends with the error.
    """
    module = loaded("operators.report")
    errors = loaded("core.base.errors")

    def no_eyes(*_: object, **__: object) -> None:
        raise errors.RigError("The eyes are shut: open them.")

    def no_edges(*_: object) -> None:
        raise ZeroDivisionError

    bpy.ops.kiriko.two_eyes()
    monkeypatch.setattr(module, "two_eyes", no_eyes)
    monkeypatch.setattr(module, "edge_sharpness", no_edges)
    out = tmp_path / "out"
    assert bpy.ops.kiriko.report(directory=str(out), seconds=0) == {"FINISHED"}
    assert names(out) == sorted([*NAMES, "head_box.svg"])
    report = json.loads((out / "report.json").read_text())
    why = {"two_eyes": "The eyes are shut: open them.", "disagreement": "ZeroDivisionError"}
    assert report["missing"] == why
    assert "eye_box" in report
    assert not {"two_eyes", "disagreement"} & {*report}
    told = capfd.readouterr().out
    assert (
        "Warning: Wrote report.csv, report.json, report.svg, eye_box.svg, head_box.svg to" in told
    )
    assert "The eyes are shut: open them. Disagreement failed (ZeroDivisionError: )" in told

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert run("report", "--out", tmp_path / "again", "--seconds", 0) == 0
    assert names(tmp_path / "again") == sorted([*NAMES, "head_box.svg"])
    told = capfd.readouterr().out
    assert "The eyes are shut" in told
    assert f"wrote {len(NAMES) + 1} files" in told
    assert run("eyes", "--out", tmp_path / "eyes") == 1
    assert not (tmp_path / "eyes").exists()


@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "soon"])
def test_a_budget_that_is_no_time_is_refused(run, seconds, tmp_path, capsys):
    """Exit code 2 and one sentence."""
    assert run("report", "--out", tmp_path / "out", f"--seconds={seconds}") == 2
    assert "--seconds" in capsys.readouterr().err


@pytest.mark.parametrize("look_down", [0, 60])
def test_a_rig_without_a_plate_has_its_report(scene, tmp_path, look_down):
    """The same files, that say nothing of a plate; one whose light misses the display is
    refused in a sentence that does not, either.
    """
    rig = small_rig(kind="BEHIND_GLASS", field=0.06, look_down=np.radians(look_down))
    assert "PLATE" not in rig
    assert bpy.ops.kiriko.report(directory=str(tmp_path), seconds=SECONDS) == {"FINISHED"}
    assert names(tmp_path) == NAMES
    report = json.loads((tmp_path / "report.json").read_text())
    assert "plate" not in report["about"]
    finest = min(
        (rung for rung in report["rungs"] if rung["method"] == "adaptive"),
        key=lambda rung: rung["setting"],
    )
    assert finest["map_rms_display_px"] < finest["setting"] == 0.1
    assert "plate" not in (tmp_path / "report.svg").read_text().lower()
    ET.parse(tmp_path / "report.svg")

    rig["DISPLAY"].location.x += 10
    with pytest.raises(RuntimeError, match="display") as told:
        bpy.ops.kiriko.report(directory=str(tmp_path / "new"))
    assert "plate" not in str(told.value)
    assert names(tmp_path) == NAMES


def test_a_plate_with_mirrors_is_told_by_its_angle(rig, scene, tmp_path):
    """Two more files: light by angle and path, as docs' table of the plate has it, and a
    diagram.
    """
    plate = rig["PLATE"].kiriko.plate
    plate.model = "CROSSED"
    plate.reflectance = 1.0
    plate.fresnel = False

    assert bpy.ops.kiriko.report(directory=str(tmp_path), seconds=0.0) == {"FINISHED"}
    assert names(tmp_path) == sorted([*NAMES, "plate.csv", "plate.svg"])
    ET.parse(tmp_path / "plate.svg")
    with (tmp_path / "plate.csv").open() as file:
        by_angle = {int(row["incidence_degrees"]): row for row in csv.DictReader(file)}

    for angle, imaged, stray, through in (
        (10, 0.041, 0.324, 0.635),
        (45, 0.863, 0.132, 0.005),
        (65, 0.472, 0.43, 0.098),
    ):
        row = {name: float(value) for name, value in by_angle[angle].items()}
        assert row["imaged"] == pytest.approx(imaged, abs=5e-4)
        assert row["stray_1"] + row["stray_2"] == pytest.approx(stray, abs=6e-4)
        assert row["through"] == pytest.approx(through, abs=5e-4)
