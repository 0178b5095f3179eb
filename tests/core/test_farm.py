import dataclasses
import itertools
import json
import tomllib
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError, RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.files import image_io
from kiriko.core.lab.farm import extension
from kiriko.core.lab.farm import job as join
from kiriko.core.lab.farm.job import AtlasJob, Job, TaskChoice, parameter_values

FRAMES = Job("Kiriko 金魚 bowl", "金魚 bowl.blend", "0.1.0", frames="1-12", chunk=5)
RIGS = tuple(TaskChoice(name, name.lower()) for name in ("Rig", "Rig.001"))
VALUES = tuple(TaskChoice(value, value) for value in ("1.45", "1.5", "1.55"))


def words(step: dict) -> list[str]:
    return step["script"]["actions"]["onRun"]["args"]


def test_tasks_are_chunks_of_frames_and_all_is_relative() -> None:
    """Frames are one chunked parameter, the join waits for them, and every path is relative to the
    bundle; names with spaces and Japanese are parameters' values, which no shell reads.
    """
    made = FRAMES.template
    assert made["extensions"] == ["TASK_CHUNKING"]
    solve, joined = made["steps"]
    (frame,) = solve["parameterSpace"]["taskParameterDefinitions"]
    assert frame["type"] == "CHUNK[INT]"
    assert joined["dependencies"] == [{"dependsOn": "Solve"}]
    assert "--frames={{Task.Param.Frame}}" in words(solve)
    assert "--frames={{Param.Frames}}" in words(joined)

    values = {one["name"]: one["value"] for one in parameter_values(made)["parameterValues"]}
    assert values["Frames"] == "1-12"
    assert values["ChunkSize"] == 5
    assert values["BlendFile"] == "金魚 bowl.blend"
    paths = [one["default"] for one in made["parameterDefinitions"] if one["type"] == "PATH"]
    assert not [path for path in paths if Path(path).is_absolute() or ".." in path]
    assert json.loads(json.dumps(made)) == made


def test_rigs_and_values_are_tasks_with_folders_of_their_own() -> None:
    """Each value goes with its folder, all are combined, and the join looks into every folder."""
    job = Job("job", "a.blend", "0.1.0", rigs=RIGS, path="kiriko.tolerance", values=VALUES)
    solve, joined = job.template["steps"]
    space = solve["parameterSpace"]
    assert space["combination"] == "(Rig,RigFolder)*(Value,ValueFolder)"
    assert "extensions" not in job.template
    assert (
        words(solve)[-1] == "{{Param.OutDir}}/{{Task.Param.RigFolder}}/{{Task.Param.ValueFolder}}"
    )
    assert job.folders == tuple(f"{a.folder}/{b.folder}" for a in RIGS for b in VALUES)
    assert words(joined)[-6:] == list(job.folders)


def test_viewers_are_tasks_of_one_alone() -> None:
    """With frames each viewer has them all, in a folder of its own."""
    viewers = (TaskChoice("Left", "Left"), TaskChoice("Eye/2", "Eye_2"))
    job = dataclasses.replace(FRAMES, viewers=viewers)
    job.check()
    solve, joined = job.template["steps"]
    assert solve["parameterSpace"]["combination"] == "(Viewer,ViewerFolder)*Frame"
    assert "--only-viewer={{Task.Param.Viewer}}" in words(solve)
    assert words(solve)[-1] == "{{Param.OutDir}}/{{Task.Param.ViewerFolder}}"
    assert job.folders == ("Left", "Eye_2")
    assert words(joined)[-2:] == ["Left", "Eye_2"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frames": ""}, "only one task"),
        ({"chunk": 0}, "has no frames"),
        ({"frames": "x"}, "not a list of frames"),
        ({"frames": "5-1"}, "not a list of frames"),
        ({"frames": ",".join(str(n * n) for n in range(1, 300))}, "characters, more than"),
        ({"values": VALUES}, "both a property and its values"),
        ({"path": "kiriko.tolerance"}, r"both a property and its values"),
        ({"blend": "{{a}}.blend"}, "double braces"),
        (
            {"path": "a", "values": tuple(TaskChoice(str(n), str(n)) for n in range(1025))},
            "1025 values",
        ),
    ],
)
def test_jobs_that_no_scheduler_takes_are_refused(change: dict, said: str) -> None:
    """Each with its sentence."""
    with pytest.raises(RigError, match=said):
        Job(**{**vars(FRAMES), **change}).check()
    FRAMES.check()


def test_names_that_begin_with_a_dash_are_no_options() -> None:
    """Each stands in one word with its option."""
    job = dataclasses.replace(FRAMES, rigs=RIGS, viewers=(TaskChoice("-x", "x"),))
    solve, _ = job.template["steps"]
    assert "--rig={{Task.Param.Rig}}" in words(solve)
    assert "--only-viewer={{Task.Param.Viewer}}" in words(solve)


def test_the_plan_of_an_atlas_may_overwrite_where_the_job_may() -> None:
    for overwrite in (False, True):
        plan, *others = dataclasses.replace(ATLAS, overwrite=overwrite).template["steps"]
        assert ("--overwrite" in words(plan)) == overwrite
        assert not [step for step in others if "--overwrite" in words(step)]


ATLAS = AtlasJob("Kiriko 金魚", "金魚.blend", "0.1.0", ("--right", "-30", "30"), shares=8)


def test_atlas_is_planned_shared_halved_and_joined() -> None:
    """A step waits for the one before; the shares are as many as the parameter says, which whoever
    submits the job may change, and every task is told which atlas it is of.
    """
    made = ATLAS.template
    steps = made["steps"]
    assert [one["name"] for one in steps] == ["Plan", "Places 1", "Halve 1", "Places 2", "Join"]
    for before, one in itertools.pairwise(steps):
        assert one["dependencies"] == [{"dependsOn": before["name"]}]
    values = {one["name"]: one["value"] for one in parameter_values(made)["parameterValues"]}
    assert values["Shares"] == 8
    assert "extensions" not in made

    how = {one["name"]: words(one)[words(one).index("atlas") :] for one in steps}
    asked = ["atlas", "--right", "-30", "30"]
    end = ["--out", "{{Param.OutDir}}"]
    assert how["Plan"] == [*asked, "--plan", *end]
    assert how["Halve 1"] == [*asked, "--halve", *end]
    assert how["Join"] == [*asked, *end]
    for one in (steps[1], steps[3]):
        (share,) = one["parameterSpace"]["taskParameterDefinitions"]
        assert share["range"] == "1-{{Param.Shares}}"
        assert words(one)[-3] == "--share={{Task.Param.Share}}/{{Param.Shares}}"
    assert json.loads(json.dumps(made)) == made


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"shares": 0}, "Tasks 0: set it from 1 to 1024"),
        ({"shares": 1025}, "Tasks 1025: set it from 1 to 1024"),
        ({"name": "{{a}}"}, "double braces"),
    ],
)
def test_atlas_jobs_that_no_scheduler_takes_are_refused(change: dict, said: str) -> None:
    """Each with its sentence."""
    with pytest.raises(RigError, match=said):
        dataclasses.replace(ATLAS, **change).check()
    ATLAS.check()


@pytest.fixture
def images(tmp_path: Path) -> list[Path]:
    """Three frames, whole and alike."""
    pixels = np.random.default_rng(1).random((24, 32, 3), np.float32)
    paths = [tmp_path / f"source_{n:04}.png" for n in (1, 2, 3)]
    for path in paths:
        image_io.write(path, pixels, "PNG8")
    return paths


def test_join_sees_what_is_missing_cut_or_of_another_size(images: list[Path]) -> None:
    """Whole images give their size; a missing, an empty, a cut and a smaller one are named."""
    assert run_steps(join.check(images)) == (32, 24)

    whole = images[1].read_bytes()
    images[1].write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ImageError, match=r"source_0002\.png"):
        run_steps(join.check(images))
    images[1].write_bytes(b"")
    with pytest.raises(ImageError, match=r"1 of 3 images are missing .*source_0002\.png"):
        run_steps(join.check(images))
    images[1].unlink()
    with pytest.raises(ImageError, match="1 of 3 images are missing"):
        run_steps(join.check(images))
    image_io.write(images[1], np.zeros((8, 8, 3), np.float32), "PNG8")
    with pytest.raises(ImageError, match="8 x 8 pixels, but the first of its job has 32 x 24"):
        run_steps(join.check(images))


def test_logs_are_one_in_the_order_of_frames(tmp_path: Path) -> None:
    """A line for each frame: the one that wrote it, not the one that failed, nor a cut one."""

    def line(frame: int, **rest: object) -> str:
        return json.dumps({"frame": frame, **rest})

    for part, lines in (
        ("6-7", [line(6, error=None), line(7, error="no display")]),
        ("1,3-5:2", [line(1, error=None), line(3, error=None), line(5, error=None)[:-4]]),
        ("7", [line(7, seconds=2, error=None)]),
        ("8", ['{"frame": Infinity}', '{"frame": []}', "[7]", "[" * 100_000]),
    ):
        (tmp_path / join.log_of(part)).write_text("\n".join(lines))
    assert all(set(path.name) - set(':?*"<>|') == set(path.name) for path in tmp_path.iterdir())

    assert join.join_logs(tmp_path) == 4
    assert [path.name for path in tmp_path.iterdir()] == [join.LOG]
    found = [json.loads(text) for text in (tmp_path / join.LOG).read_text().splitlines()]
    assert [one["frame"] for one in found] == [1, 3, 6, 7]
    assert found[-1]["seconds"] == 2
    assert join.join_logs(tmp_path) == 4  # once more changes nothing


def installed(folder: Path) -> Path:
    """A folder as Blender has an installed extension, with a wheel and what it left behind."""
    about = 'id = "kiriko"\nversion = "1.2.3"\nwheels = ["./wheels/a.whl", "./wheels/b.whl"]\n'
    about += '[build.generated]\nplatforms = ["linux-x64"]\nwheels = ["./wheels/a.whl"]\n'
    for name in ("__init__.py", "core/x.py", "core/__pycache__/x.pyc", "wheels/a.whl", ".hidden"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    (folder / "blender_manifest.toml").write_text(about)
    return folder


def test_packed_extension_is_what_was_installed(tmp_path: Path) -> None:
    """All its files and the platform's wheels, none of Python's leavings; twice the same bytes."""
    root = installed(tmp_path / "kiriko")
    for name in ("one.zip", "two.zip"):
        extension.pack(tmp_path / name, root)
    with ZipFile(tmp_path / "one.zip") as archive:
        names = {"__init__.py", "core/x.py", "wheels/a.whl", "blender_manifest.toml"}
        assert set(archive.namelist()) == names
        assert tomllib.loads(archive.read("blender_manifest.toml").decode())["version"] == "1.2.3"
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()

    (root / "wheels" / "a.whl").unlink()
    with pytest.raises(ImageError, match=r"'wheels/a\.whl' is missing"):
        extension.files_of(root)


def test_a_checkout_packs_what_its_zips_have() -> None:
    """Nothing that only development needs, and all rooms."""
    try:
        names = extension.files_of()
    except ImageError:
        pytest.skip("the wheels were not fetched: run 'python3 scripts/dev.py build'")
    tops = {name.partition("/")[0] for name in names}
    assert not tops & {"tests", "scripts", "docs", "dist", "out", ".git", "CHANGELOG.md"}
    assert {"core", "operators", "panels", "languages", "farm", "assets", "wheels"} <= tops
