import json
import re
import shutil
from collections.abc import Callable
from math import pi
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from known.kiriko_zip import kiriko_zip
from long_work import full_disk
from small_rigs import small_rig

NAME = "金魚 の bowl.blend"


@pytest.fixture
def zipped(tmp_path) -> Path:
    """A zip as Kiriko's: the bundle copies it as it is."""
    return kiriko_zip(tmp_path / "kiriko-9.zip")


@pytest.fixture
def saved(scene, tmp_path) -> Path:
    """A small rig, saved; the folder for the bundle beside it."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / NAME))
    return tmp_path / "a job"


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def test_bundle_has_all_that_tasks_need(run, saved, zipped, capsys):
    """A copy of the file that reads the same image by its new place, the bootstrap, the zip, and
    the template; a second job is refused before anything is replaced.
    """
    picture = bpy.data.images.new("picture", 8, 8)
    picture.filepath_raw = str(saved.parent / "絵 1.png")
    picture.file_format = "PNG"
    picture.save()
    picture.filepath = "//絵 1.png"
    picture.use_fake_user = True

    arguments = ("job", "--frames", "1-12", "--chunk", 5, "--zip", zipped, "--out", saved)
    assert run(*arguments) == 0
    assert capsys.readouterr().err == ""
    made = read(saved / "template.json")
    files = {path.relative_to(saved).as_posix() for path in saved.rglob("*") if path.is_file()}
    assert files == {
        NAME,
        "template.json",
        "parameter_values.json",
        "asset_references.json",
        "kiriko/kiriko_bootstrap.py",
        "kiriko/kiriko_frames.js",
        "kiriko/kiriko-9.zip",
    }
    assert made["name"] == "Kiriko 金魚 の bowl"
    listed = read(saved / "asset_references.json")["assetReferences"]["inputs"]["filenames"]
    assert [Path(path).name for path in listed] == ["絵 1.png"]

    before = (saved / "template.json").read_bytes()
    assert run(*arguments[:2], "3", *arguments[3:]) == 1
    assert "already" in capsys.readouterr().err
    assert (saved / "template.json").read_bytes() == before
    bpy.ops.wm.open_mainfile(filepath=str(saved / NAME))
    assert Path(bpy.path.abspath(bpy.data.images["picture"].filepath)).resolve() == (
        saved.parent / "絵 1.png"
    )


def test_a_job_never_replaces_the_open_file(saved, zipped):
    """Its dialogue begins in the file's own folder; Overwrite is about jobs."""
    file = saved.parent / NAME
    before = file.read_bytes()
    there = sorted(path.name for path in saved.parent.iterdir())
    bpy.context.scene.kiriko.tolerance = 0.7  # that is not saved
    with pytest.raises(RuntimeError, match="would replace the file itself"):
        bpy.ops.kiriko.export_job(directory=str(saved.parent), frames="1-2", overwrite=True)
    assert file.read_bytes() == before
    assert sorted(path.name for path in saved.parent.iterdir()) == there


def test_rigs_and_values_become_tasks(run, saved, zipped, capsys):
    """Names that folders cannot have get folders that they can."""
    (group,) = (one for one in bpy.data.collections if one.kiriko.is_rig)
    group.name = "rig / 一"
    values = ("--vary", "kiriko.tolerance", "--values", "0.1", "0.2")
    assert run("job", "--rig", "all", *values, "--zip", zipped, "--out", saved) == 0
    (solve, join) = read(saved / "template.json")["steps"]
    ranges = {
        one["name"]: one["range"] for one in solve["parameterSpace"]["taskParameterDefinitions"]
    }
    assert ranges["Rig"] == ["rig / 一"]
    assert "/" not in ranges["RigFolder"][0]
    assert ranges["Value"] == ["0.1", "0.2"]
    assert len(set(join["script"]["actions"]["onRun"]["args"][-2:])) == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "only one task"),
        (("--frames", "nine"), "not a list of frames"),
        (("--frames", "1-3", "--rig", "none such"), "no rig 'none such'"),
        (("--frames", "1-3", "--chunk", "0"), "has no frames"),
        (("--values", "1", "2"), "both a property and its values"),
        (("--frames", "1-3", "--vary", "kiriko.tolerance"), "both a property and its values"),
        (("--vary", "kiriko.nope", "--values", "1"), "The property 'kiriko.nope' doesn't exist"),
        (
            ("--vary", "kiriko.tolerance", "--values", "0.1", "b"),
            "'kiriko.tolerance' can't be 'b'",
        ),
        (("--vary", "kiriko.tolerance", "--values", "nan"), "'kiriko.tolerance' can't be 'nan'"),
        (("--vary", "kiriko.tolerance", "--values", "0.1", "-1e9"), "can't be -1000000000.0"),
        (("--frames", "1-3", "--name", "a/"), "'a/' is not a plain file name"),
        (("--frames", "1-3", "--name", "a\\b"), "is not a plain file name"),
        (("--frames", "1-3", "--name", "a" * 300), "cannot hold a file of this name"),
        (
            ("--frames", "9999,10000", "--name", "金" * 82 + "a####"),
            "cannot hold a file of this name",
        ),
    ],
)
def test_bad_jobs_are_one_sentence(run, saved, zipped, capsys, words, said):
    """And leave no folder behind."""
    assert run("job", *words, "--zip", zipped, "--out", saved) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not saved.exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("missing", "There is no zip"),
        (None, "not a zip of Kiriko"),
        (('id = "kiriko"', 'id = "another"'), "not a zip of Kiriko"),
        (('\nversion = "', '\nversion = "99'), "Name the zip of"),
    ],
)
def test_a_zip_that_no_worker_could_use_is_refused(run, saved, capsys, change, said):
    """None, a text by such a name, another extension, another version."""
    path = saved.parent / "bad.zip"
    if change is None:
        path.write_text("no zip")
    elif change != "missing":
        kiriko_zip(path, *change)
    assert run("job", "--frames", "1-3", "--zip", path, "--out", saved) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert "bad.zip" in line
    assert not saved.exists()


def test_a_job_that_is_replaced_leaves_no_zip_of_another_version(run, saved, zipped):
    """Those of this one may be for other platforms, and what is no Kiriko is not ours."""
    assert run("job", "--frames", "1-3", "--zip", zipped, "--out", saved) == 0
    kiriko = saved / "kiriko"
    (kiriko / "mine.zip").write_text("no zip")
    kiriko_zip(kiriko / "windows.zip")
    kiriko_zip(kiriko / "old.zip", '\nversion = "', '\nversion = "99')
    other = kiriko_zip(saved.parent / "kiriko-10.zip")
    assert run("job", "--frames", "1-3", "--zip", other, "--overwrite", "--out", saved) == 0
    left = sorted(path.name for path in kiriko.glob("*.zip"))
    assert left == sorted(["kiriko-10.zip", "mine.zip", "windows.zip", zipped.name])
    assert not [path for path in saved.rglob("*") if path.name.startswith(".kiriko")]
    assert not list(saved.glob("*.blend1"))


def test_results_of_an_earlier_job_are_not_taken_for_the_next_ones(run, saved, zipped, capsys):
    """Tasks leave images that are there: the job is refused, and all stays as it was."""
    job = ("job", "--frames", "1-2", "--zip", zipped, "--out", saved, "--overwrite")
    assert run(*job) == 0
    before = (saved / NAME).read_bytes()
    (saved / "source").mkdir()
    assert run(*job) == 0  # an empty folder has no results
    before = (saved / NAME).read_bytes()
    assert run("solve", "--frames=1-2", "--out", saved / "source") == 0
    bpy.context.scene.kiriko.tolerance = 0.7
    capsys.readouterr()
    assert run(*job) == 1
    assert "has results of an earlier job" in capsys.readouterr().err
    assert (saved / NAME).read_bytes() == before


def test_a_full_disk_leaves_no_part_of_a_job(run, saved, zipped, capsys, monkeypatch):
    """Of a compressed file that it could not write Blender says that it is saved."""
    monkeypatch.setattr(bpy.context.preferences.filepaths, "use_file_compression", True)
    bpy.ops.wm.save_as_mainfile(filepath=str(saved.parent / NAME), compress=True)
    with full_disk(50_000):
        assert run("job", "--frames", "1-3", "--zip", zipped, "--out", saved) == 1
    assert re.search(f"{NAME}.* cannot be written", capsys.readouterr().err)
    assert not saved.exists()


def test_all_files_that_tasks_read_are_listed_once(run, saved, zipped):
    """Every frame of a sequence, every tile; one file that two images read once."""
    for name in ("s_0001", "s_0002", "s_0010", "s_0002b", "u.1001", "u.1002", "still"):
        picture = bpy.data.images.new(name, 4, 4)
        picture.filepath_raw = str(saved.parent / f"{name}.png")
        picture.file_format = "PNG"
        picture.save()
        bpy.data.images.remove(picture)
    for name, source in (
        ("s_0001", "SEQUENCE"),
        ("u.1001", "TILED"),
        ("still", "FILE"),
        ("still", "FILE"),
    ):
        picture = bpy.data.images.load(str(saved.parent / f"{name}.png"))
        picture.source = source
        picture.use_fake_user = True
        if source == "TILED":
            picture.filepath = str(saved.parent / "u.<UDIM>.png")
    assert run("job", "--frames", "1-3", "--zip", zipped, "--out", saved) == 0
    listed = read(saved / "asset_references.json")["assetReferences"]["inputs"]["filenames"]
    names = ["s_0001.png", "s_0002.png", "s_0010.png", "still.png", "u.1001.png", "u.1002.png"]
    assert listed == [str(saved.parent / name) for name in names]


def test_button_writes_the_same(scene, saved):
    """The scene's range where no frames are given; the wheels of a checkout may be missing, which
    is told.
    """
    extension = loaded("core.lab.farm.extension")
    scene.frame_start, scene.frame_end, scene.frame_step = 3, 9, 2
    names = [name.removeprefix("./") for name in extension.manifest()["wheels"]]
    if not all((extension.ROOT / name).exists() for name in names):
        with pytest.raises(RuntimeError, match="cannot be packed for the farm"):
            bpy.ops.kiriko.export_job(directory=str(saved))
        assert not saved.exists()
        return
    bpy.ops.kiriko.export_job(directory=str(saved))
    (values,) = read(saved / "parameter_values.json").values()
    assert {one["name"]: one["value"] for one in values}["Frames"] == "3-9:2"


def test_viewers_become_tasks_that_solve_for_one_alone(run, saved, zipped, capsys):
    """The image of a task is that of the file where this viewer is the only one."""
    scene = bpy.context.scene
    first = scene.kiriko.viewer or scene.camera
    second = first.copy()
    second.name, second.location.x = "Second", first.location.x + 0.02
    scene.collection.objects.link(second)
    for camera in (first, second):
        scene.kiriko.viewers.add().camera = camera
    assert run("job", "--viewers", "all", "--zip", zipped, "--out", saved) == 0
    solve = read(saved / "template.json")["steps"][0]
    ranges = {
        one["name"]: one["range"] for one in solve["parameterSpace"]["taskParameterDefinitions"]
    }
    assert ranges["Viewer"] == [first.name, "Second"]
    assert run("job", "--viewers", "None such", "--zip", zipped, "--out", saved / "b") == 1
    assert "no viewer 'None such'" in capsys.readouterr().err
    assert run("job", "--viewers", "all", "--rig", "all", "--out", saved / "b") == 1
    assert "a single rig" in capsys.readouterr().err

    both, task, alone = (saved.parent / name for name in ("both", "task", "alone"))
    assert run("solve", "--out", both) == 0
    assert run("solve", "--only-viewer", "Second", "--out", task) == 0
    scene.kiriko.viewers.clear()
    scene.kiriko.viewer = second
    assert run("solve", "--out", alone) == 0
    images = [(folder / "source.png").read_bytes() for folder in (both, task, alone)]
    assert images[1] == images[2]
    assert images[0] != images[1]


def verb(bundle: Path, step: dict, **values: str) -> list[str]:
    """The verb of a task, as a scheduler fills in its parameters."""
    words = step["script"]["actions"]["onRun"]["args"]
    filled = {"Param.OutDir": str(bundle / "source")}
    filled |= {f"Task.Param.{name}": value for name, value in values.items()}
    words = words[next(k for k, word in enumerate(words) if word in {"solve", "join"}) :]
    return [re.sub(r"\{\{(.*?)\}\}", lambda found: filled[found[1]], word) for word in words]


@pytest.mark.parametrize("text", ["-x", "--out", "-h", "--set", "-"])
def test_values_may_begin_with_a_dash(run, saved, zipped, capsys, text):
    """Of a property that is text, in a job's task and by themselves."""
    path = "kiriko.export_path"
    vary = ("--vary", path, f"--values={text}")
    assert run("job", *vary, "--zip", zipped, "--out", saved) == 0
    solve, _ = read(saved / "template.json")["steps"]
    (value, folder) = (
        one["range"][0] for one in solve["parameterSpace"]["taskParameterDefinitions"]
    )
    assert value == text
    assert run(*verb(saved, solve, Value=value, ValueFolder=folder)) == 0
    assert f"'{path}' is now {text}" in capsys.readouterr().out
    assert bpy.context.scene.kiriko.export_path == text


def sentence_of_solve(run: Callable[..., int], out: Path, capsys: pytest.CaptureFixture) -> str:
    capsys.readouterr()
    assert run("solve", "--out", out) == 1
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("kiriko: ")


def test_a_rig_that_no_task_could_solve_is_refused(run, saved, zipped, capsys):
    """With Solve's own sentence, by the rig's name where there are several; one that is whole at
    another frame of the job, or with one of its values, is good enough. The scene stays as it is.
    """
    scene = bpy.context.scene
    display = next(one for one in scene.objects if one.kiriko.role == "DISPLAY")
    display.kiriko.role = "NONE"
    said = sentence_of_solve(run, saved, capsys)
    assert "has no display" in said
    job = ("job", "--zip", zipped, "--out", saved)
    for words, start in (
        (("--frames", "1-12"), ""),
        (("--vary", "kiriko.tolerance", "--values", "0.1", "0.2"), ""),
        (("--rig", "all", "--frames", "1-12"), "Rig 'Kiriko Rig': "),
    ):
        assert run(*job, *words) == 1
        assert capsys.readouterr().err == f"kiriko: {start}{said}\n"
        assert not saved.exists()

    display.kiriko.role = "DISPLAY"
    for frame in range(1, 13):
        display.hide_viewport = frame != 7
        display.keyframe_insert("hide_viewport", frame=frame)
    scene.frame_set(3, subframe=0.5)
    said = sentence_of_solve(run, saved, capsys)
    assert run(*job, "--frames", "1-6") == 1
    assert capsys.readouterr().err == f"kiriko: {said}\n"
    assert (scene.frame_current, scene.frame_subframe) == (3, 0.5)
    assert run(*job, "--frames", "1-12") == 0
    assert (scene.frame_current, scene.frame_subframe) == (3, 0.5)


def test_a_rig_that_stays_dark_is_refused(run, saved, zipped, capsys):
    """With Solve's own sentence, where no frame and no value has light, and by the viewer's name
    where it is solved for alone. One frame with light is enough.
    """
    scene = bpy.context.scene
    job = ("job", "--zip", zipped, "--out", saved)
    first = scene.kiriko.viewer or scene.camera
    away = first.copy()
    away.name, away.matrix_world = "Away", first.matrix_world @ Matrix.Rotation(pi, 4, "X")
    scene.collection.objects.link(away)
    for camera in (first, away):
        scene.kiriko.viewers.add().camera = camera
    scene.kiriko.viewers[0].is_on = False
    alone = sentence_of_solve(run, saved, capsys)
    scene.kiriko.viewers[0].is_on = True
    assert run(*job, "--viewers", "Away") == 1
    assert capsys.readouterr().err == f"kiriko: Viewer 'Away': {alone}\n"
    assert run(*job, "--viewers", first.name, "--frames", "1-2") == 0
    shutil.rmtree(saved)
    scene.kiriko.viewers.clear()
    scene.kiriko.viewer = first

    glass = bpy.data.objects["Cube"]
    for frame in range(1, 5):
        glass.location.x = 50.0 * (frame != 4)
        glass.keyframe_insert("location", frame=frame)
    scene.frame_set(1)
    said = sentence_of_solve(run, saved, capsys)
    assert "stays dark: no ray from the viewer hits the glass" in said
    vary = ("--vary", "kiriko.tolerance", "--values", "0.1", "0.2")
    for words in (("--frames", "1-3"), vary, (*vary, "--frames", "1-2")):
        assert run(*job, *words) == 1
        assert capsys.readouterr().err == f"kiriko: {said}\n"
        assert not saved.exists()
    assert run(*job, "--frames", "1-4") == 0


def test_an_index_that_the_material_has_is_told_to_have_no_effect(run, saved, zipped, capsys):
    """Where Override IOR is off, unless that is set, too, whichever comes first."""
    glass = bpy.data.objects["Cube"]
    glass.kiriko.use_ior = False
    bpy.ops.wm.save_mainfile()
    path, switch = (f'objects["Cube"].kiriko.{name}' for name in ("ior", "use_ior"))
    told = (
        f"kiriko: '{path}' has no effect while '{switch}' is off: set '{switch}' to true as well\n"
    )
    assert run("solve", "--set", path, "1.9", "--out", saved / "a") == 0
    assert told in capsys.readouterr().out
    job = ("job", "--vary", path, "--values", "1.4", "1.9", "--zip", zipped, "--out")
    assert run(*job, saved / "b") == 0
    assert told in capsys.readouterr().out
    for k, words in enumerate(((path, "1.9", switch, "true"), (switch, "true", path, "1.9"))):
        glass.kiriko.use_ior = False
        given = ("--set", *words[:2], "--set", *words[2:])
        assert run("solve", *given, "--out", saved / f"c{k}") == 0
        assert "no effect" not in capsys.readouterr().out
    plain, *others = ((saved / name / "source.png").read_bytes() for name in ("a", "c0", "c1"))
    assert others[0] == others[1] != plain
    assert run(*job, saved / "d") == 0
    assert "no effect" not in capsys.readouterr().out


def test_values_beyond_a_property_s_range_are_refused(run, saved, capsys):
    """Which Blender would cut without a word; the ends of the range are no error."""
    ours = bpy.context.scene.kiriko
    known = ours.bl_rna.properties
    float_, whole = known["tolerance"], known["max_events"]
    for path, text in (
        ("kiriko.tolerance", f"{float_.hard_min * 0.99}"),
        ("kiriko.tolerance", "-1e9"),
        ("kiriko.max_events", f"{whole.hard_min - 1}"),
        ("kiriko.max_events", f"{2**31}"),
        ('objects["Cube"].name', "x" * 300),
    ):
        before = repr(ours.path_resolve("tolerance")), ours.max_events
        assert run("solve", "--set", path, text, "--out", saved) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert path in line
        assert ": use " in line
        assert (repr(ours.tolerance), ours.max_events) == before
    lowest = repr(np.float32(float_.hard_min)).removeprefix("np.float32(").rstrip(")")
    assert run("solve", "--set", "kiriko.tolerance", lowest, "--set", "kiriko.max_events",
               whole.hard_min, "--frames", "x", "--out", saved) == 1  # fmt: skip
    assert "is not a list of frames" in capsys.readouterr().err


def test_values_are_set_before_the_work(run, saved, capsys):
    """By their paths in the scene or the file; what cannot be set is refused with its name."""
    wanted = ("--set", 'objects["Cube"].kiriko.ior', "1.6", "--set", "kiriko.tolerance", "0.5")
    assert run("solve", *wanted, "--out", saved) == 0
    assert "'kiriko.tolerance' is now 0.5" in capsys.readouterr().out
    assert bpy.data.objects["Cube"].kiriko.ior == pytest.approx(1.6)
    assert read(saved / "report.json")["tolerance"] == pytest.approx(0.5)

    for path, text in (
        ("kiriko.nothing", "1"),
        ('objects["None such"].kiriko.ior', "1"),
        ("kiriko.tolerance", "much"),
        ("kiriko.ghosts", "MANY"),
    ):
        assert run("solve", "--set", path, text, "--out", saved, "--overwrite") == 1
        assert path in capsys.readouterr().err


def test_join_checks_all_frames(run, saved, capsys):
    """Two tasks and their join are as one run; without one of the images it fails by its name."""
    one = saved.parent / "one"
    assert run("solve", "--frames=1-3", "--out", one) == 0
    for part in ("1-2", "3"):
        assert run("solve", f"--frames={part}", f"--log={part}", "--out", saved) == 0
    assert run("join", "--frames=1-3", "--out", saved) == 0
    assert "all 3 images" in capsys.readouterr().out
    assert {path.name for path in saved.iterdir()} == {path.name for path in one.iterdir()}
    for path in one.glob("*.png"):
        assert path.read_bytes() == (saved / path.name).read_bytes()
    frames = [json.loads(line)["frame"] for line in (saved / "frames.jsonl").open()]
    assert frames == [1, 2, 3]

    (saved / "source_0002.png").unlink()
    assert run("join", "--frames=1-3", "--out", saved) == 1
    assert "source_0002.png" in capsys.readouterr().err
