"""Animations: each frame is what a solve of it alone is, its file whole or absent."""

import importlib
import json
from collections.abc import Iterator
from itertools import pairwise, zip_longest
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import small_rig


@pytest.fixture
def frames(kiriko) -> ModuleType:
    return loaded("operators.frames")


@pytest.fixture
def work(kiriko) -> ModuleType:
    return loaded("operators.work")


@pytest.fixture
def parts(scene, tmp_path) -> dict[str, bpy.types.Object]:
    """A small rig whose glass turns, saved; the objects by role."""
    parts = small_rig()
    turning(parts["GLASS"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    return parts


def turning(thing: bpy.types.Object) -> None:
    for frame, turn in ((1, 0.0), (9, 0.4)):
        thing.rotation_euler.z = turn
        thing.keyframe_insert("rotation_euler", frame=frame)


def folder(tmp_path: Path) -> Path:
    return tmp_path / "out"


def contents(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir() if path.suffix != ".jsonl"}


def log(place: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (place / "frames.jsonl").read_text().splitlines()]


def keyed(owner: Any, path: str, values: tuple[Any, Any]) -> None:
    """Have a property go from one value at frame 1 to another at frame 3."""
    before, _, name = path.rpartition(".")
    thing = owner.path_resolve(before) if before else owner
    for frame, value in zip((1, 3), values, strict=True):
        setattr(thing, name, value)
        owner.keyframe_insert(path, frame=frame)


def bent(glass: bpy.types.Object) -> None:
    glass.shape_key_add(name="Basis")
    key = glass.shape_key_add(name="bent")
    for point in key.data:
        point.co.y *= 1.0 + 6.0 * point.co.x
    keyed(key, "value", (0.3, 1.0))


def tapered(glass: bpy.types.Object) -> None:
    taper = glass.modifiers.new("taper", "SIMPLE_DEFORM")
    taper.deform_method = "TAPER"
    keyed(glass, 'modifiers["taper"].factor', (0.05, 0.15))


MOVES = {
    "glass": lambda parts: turning(parts["GLASS"]),
    "camera": lambda parts: keyed(
        bpy.data.objects["Kiriko Viewer"], "location", ((0, -1, 0), (0.004, -1, 0))
    ),
    "shape": lambda parts: bent(parts["GLASS"]),
    "modifier": lambda parts: tapered(parts["GLASS"]),
    "ior": lambda parts: keyed(parts["GLASS"], "kiriko.ior", (1.42, 1.46)),
    "picture": lambda parts: keyed(parts["PICTURE"], "kiriko.picture.brightness", (0.3, 1.0)),
}


@pytest.mark.parametrize("kind", MOVES)
def test_each_frame_is_that_of_a_solve_by_itself(kind, scene, run, work, tmp_path):
    """Bit for bit, whatever moves; frames differ; of a picture alone nothing is traced again."""
    MOVES[kind](small_rig())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert run("solve", "--out", folder(tmp_path), "--frames", "1-3", "--format", "EXR_FLOAT") == 0

    core = work.__name__.partition(".operators")[0]
    image_io = importlib.import_module(f"{core}.core.files.image_io")
    steps = importlib.import_module(f"{core}.core.base.steps")
    session = importlib.import_module(f"{core}.core.solve.session")
    images = []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        reading = work.read(bpy.context)
        alone = steps.run_steps(session.Session().solve(reading.rig, work.settings_of(scene)))
        pixels, _ = image_io.read(folder(tmp_path) / f"source_{frame:04}.exr")
        assert np.array_equal(pixels, alone.source)
        images.append(pixels)

    assert not any(np.array_equal(a, b) for a, b in pairwise(images))
    did = [line["did"] for line in log(folder(tmp_path))]
    assert did == (["traced", "painted", "painted"] if kind == "picture" else ["traced"] * 3)


def test_files_are_named_as_blender_names_renders(scene, tmp_path):
    """By what Blender itself makes of the same path, with our suffix."""
    module = loaded("core.blender.data.scene_frames")
    for name in ("####", "a_##_b", "plain", "##.png", "a.b_###", "x#y##"):
        found = module.frame_files(scene, tmp_path, name, "PNG8", (1, 117, 12345, -3))
        scene.render.filepath = str(tmp_path / name.removesuffix(".png"))
        scene.render.image_settings.file_format = "PNG"
        for frame, path in found.items():
            assert str(path) == scene.render.frame_path(frame=frame)
    assert [s.name for s in bpy.data.scenes] == [scene.name]


def test_frames_that_are_there_stay_and_missing_ones_are_made(run, parts, tmp_path, capsys):
    """A run goes on where it was stopped; --overwrite makes all anew, the same bits; the scene is
    at its frame of before, and its result as it was.
    """
    scene = bpy.context.scene
    scene.frame_set(4, subframe=0.25)
    out = folder(tmp_path)
    assert run("solve", "--out", out, "--frames", "1-5:2", "--name", "f##") == 0
    made = contents(out)
    assert sorted(made) == ["f01.png", "f03.png", "f05.png"]
    lines = log(out)
    assert [(line["frame"], line["file"], line["error"]) for line in lines] == [
        (1, "f01.png", None),
        (3, "f03.png", None),
        (5, "f05.png", None),
    ]
    assert all(line["seconds"] > 0 and line["coverage"] > 0.5 for line in lines)
    assert "Wrote 3 frames" in capsys.readouterr().out
    assert (scene.frame_current, scene.frame_subframe) == (4, 0.25)
    assert scene.kiriko.result.source is None

    (out / "f03.png").unlink()
    (out / "f05.png").write_bytes(b"mine")
    assert run("solve", "--out", out, "--frames", "1,3,5", "--name", "f##") == 0
    assert "Wrote 1 frame to" in (told := capsys.readouterr().out)
    assert "Existing frames skipped: 2." in told
    assert contents(out) == {**made, "f05.png": b"mine"}
    assert run("solve", "--out", out, "--frames", "5", "--name", "f##", "--overwrite") == 0
    assert contents(out) == made


@pytest.mark.parametrize("change", ["glass", "picture", "tolerance", "nothing"])
def test_frames_of_an_earlier_scene_are_stale(run, parts, tmp_path, capsys, change):
    """Frames solved before glass, picture or settings were changed are named, and no movie is made
    of them; solved anew they are no longer stale.
    """
    scene, out = bpy.context.scene, folder(tmp_path)
    words = ("solve", "--out", out, "--frames", "1-3", "--movie", "H264")
    assert run("solve", "--out", out, "--frames", "1-3") == 0
    if change == "glass":
        parts["GLASS"].scale.x *= 1.1
    elif change == "picture":
        parts["PICTURE"].kiriko.picture.brightness = 0.5
    elif change == "tolerance":
        scene.kiriko.tolerance *= 2
    is_same = change == "nothing"
    assert run(*words) == (0 if is_same else 1)
    stale = "Frames from an earlier state of the scene: 3, starting with 1."
    assert (stale in capsys.readouterr().err) != is_same
    assert run("solve", "--out", out, "--frames", "1-3") == 0
    assert (stale in capsys.readouterr().out) != is_same

    if not is_same:
        assert run("solve", "--out", out, "--frames", "1-2", "--overwrite") == 0
        assert run(*words) == 1
        said = "Frames from an earlier state of the scene: 1, starting with 3."
        assert said in capsys.readouterr().err
        assert run(*words, "--overwrite") == 0


def test_the_scene_gives_range_and_step(run, parts, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.frame_step = 2, 8, 3
    assert run("solve", "--out", folder(tmp_path), "--frames", "scene") == 0
    assert sorted(contents(folder(tmp_path))) == [f"source_{n:04}.png" for n in (2, 5, 8)]


@pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="braces are characters like others")
def test_words_in_braces_are_read_by_the_scene(run, kiriko, parts, tmp_path, capsys):
    """By hand from the scene's settings, and as Blender itself names its render; the scene has its
    own path back, after an error too, and there is no undo step.
    """
    module = loaded("core.blender.data.scene_frames")
    scene = bpy.context.scene
    scene.name = "Show A"
    is_new = bpy.app.version >= (5, 0, 0)  # 4.5 knows no name of the scene, and no folder
    word, said = ("{scene_name}", "Show A") if is_new else ("{blend_name}", "rig")
    scene.render.fps, scene.render.resolution_x = 30, 640
    scene.render.filepath, scene.render.use_file_extension = "//mine/shot_", True
    before = scene.as_pointer(), [one.name for one in bpy.data.scenes]
    name = f"{word}_{{fps}}_{{resolution_x}}_{{blend_name}}_##"
    (path,) = module.frame_files(scene, tmp_path, name, "PNG8", (7,)).values()
    found = path.stem.split("_")
    assert (found[0], float(found[1]), *found[2:]) == (said, 30.0, "640", "rig", "07")

    with pytest.raises(Exception, match="know the template"):
        module.frame_files(scene, tmp_path, "{nothing}_#", "PNG8", (7,))
    in_folder = r"'.*/.*' is not a plain file name" if is_new else "know the template"
    with pytest.raises(Exception, match=in_folder):
        module.frame_files(scene, tmp_path, "{blend_dir}_#", "PNG8", (7,))
    assert scene.render.filepath == "//mine/shot_"
    assert scene.render.use_file_extension
    assert before == (scene.as_pointer(), [one.name for one in bpy.data.scenes])

    scene.render.filepath = str(tmp_path / name)
    scene.render.image_settings.file_format = "PNG"
    assert str(path) == scene.render.frame_path(frame=7)
    scene.kiriko.animation_path = f"//by {{fps}}/{word}/b_##"
    scene.render.filepath = str(tmp_path / f"by {{fps}}/{word}/b_##")
    named = Path(scene.render.frame_path(frame=1))
    assert bpy.ops.kiriko.solve_animation(frames="1") == {"FINISHED"}
    assert {one.name for one in named.parent.iterdir()} == {"b_01.png", "frames.jsonl"}
    (tmp_path / "{mine}").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "{mine}" / "rig.blend"))
    scene.kiriko.animation_path = "//a {fps}/b_##"
    assert bpy.ops.kiriko.solve_animation(frames="1") == {"FINISHED"}
    assert (tmp_path / "{mine}" / named.parent.parent.name.replace("by", "a") / "b_01.png").exists()
    scene.kiriko.animation_path = "//{nothing}/b_##"
    with pytest.raises(RuntimeError, match="know the template"):
        bpy.ops.kiriko.solve_animation(frames="1")

    out = folder(tmp_path)
    ask = ("--frames", "1-2", "--name", f"{word}_#", "--movie", "FFV1")
    assert run("solve", "--out", out, *ask) == 0
    assert sorted(contents(out)) == [f"{said}.mkv", f"{said}_1.png", f"{said}_2.png"]


@pytest.mark.parametrize(
    ("asked", "words", "code"),
    [
        (("--frames", "1-"), "is not a list of frames", 1),
        (("--frames", "9-1"), "is not a list of frames", 1),
        (("--frames", "1", "--preview"), "leave out --preview", 2),
        *(
            (("--frames", "1", "--movie", "FFV1", "--test-card", text), f"'{text}' is no time", 2)
            for text in ("nan", "-5", "1e300", "inf", "3601", "soon")
        ),
    ],
)
def test_frames_that_cannot_be_meant_are_refused_before_any_work(
    run, parts, tmp_path, capsys, asked, words, code
):
    assert run("solve", "--out", folder(tmp_path), *asked) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert line.endswith(".")
    assert not folder(tmp_path).exists()


def test_a_frame_that_cannot_be_solved_is_told_and_the_others_are_made(
    run, parts, tmp_path, capsys
):
    """Where all glass is hidden in one frame: its line has the error, and so has the command."""
    glass = parts["GLASS"]
    for frame in (1, 2, 3):
        glass.hide_viewport = glass.hide_render = frame == 2
        glass.keyframe_insert("hide_viewport", frame=frame)
        glass.keyframe_insert("hide_render", frame=frame)
    assert run("solve", "--out", folder(tmp_path), "--frames", "1-3") == 1
    told = capsys.readouterr().err
    assert "1 failed, first frame 2: " in told
    assert sorted(contents(folder(tmp_path))) == ["source_0001.png", "source_0003.png"]
    errors = [line["error"] for line in log(folder(tmp_path))]
    assert errors[0] is errors[2] is None
    assert errors[1].endswith(".")


@pytest.mark.parametrize("part", [None, "a/b", "字" * 90])
def test_a_log_that_cannot_be_written_is_told_before_any_frame(run, parts, tmp_path, capsys, part):
    """A folder in its place, a name with a folder that is not there, one that no disk takes."""
    out = folder(tmp_path)
    (out / "frames.jsonl").mkdir(parents=True)
    words = () if part is None else (f"--log={part}",)
    assert run("solve", "--out", out, "--frames", "1-2", *words) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert ".jsonl' cannot be written (" in line
    assert [path.name for path in out.iterdir()] == ["frames.jsonl"]


@pytest.mark.parametrize("way", ["deleted", "without placeholders", "--overwrite"])
def test_a_frame_of_a_killed_process_is_made_again(run, parts, tmp_path, capsys, way):
    """Its empty file is left out, and a sentence says what to do, by which all frames are there."""
    out = folder(tmp_path)
    out.mkdir()
    (out / "source_0002.png").touch()
    ask = ("solve", "--out", out, "--frames", "1-3")
    assert run(*ask, "--placeholders") == 0
    told = capsys.readouterr().out
    assert "Wrote 2 frames" in told
    assert "Claimed by another process: 1." in told
    assert [len(one) > 100 for _, one in sorted(contents(out).items())] == [True, False, True]

    if way == "deleted":
        (out / "source_0002.png").unlink()
    if way != "without placeholders":
        ask += ("--placeholders",)
    if way == "--overwrite":
        ask += (way,)
    assert run(*ask) == 0
    assert f"Wrote {3 if way == '--overwrite' else 1} frame" in capsys.readouterr().out
    assert [len(one) > 100 for one in contents(out).values()] == [True] * 3
    assert list(out.glob(".*")) == []


def test_two_runs_with_placeholders_share_the_frames(frames, kiriko, parts, tmp_path):
    """Each frame is made once, by one of them; none is half a file."""
    module = loaded("core.blender.data.scene_frames")
    files = module.frame_files(bpy.context.scene, tmp_path, "f#", "PNG8", range(1, 5))
    run = frames.Run(files, "PNG8", placeholders=True)
    one = frames.solved(bpy.context, run)
    while not files[1].exists():
        next(one)
    assert files[1].stat().st_size == 0

    other = frames.solved(bpy.context, run)
    told = None
    try:
        while True:
            next(other)
    except StopIteration as end:
        told = end.value
    assert (told.written, told.others, told.there) == (3, 1, 0)
    try:
        while True:
            next(one)
    except StopIteration as end:
        told = end.value
    assert (told.written, told.others, told.there) == (1, 0, 3)
    assert sorted(line["frame"] for line in log(tmp_path)) == [1, 2, 3, 4]
    assert all(path.stat().st_size > 100 for path in files.values())


def test_two_runs_that_write_the_same_frames_leave_whole_ones(frames, kiriko, parts, tmp_path):
    """Step by step by turns, without placeholders, into one folder: each frame is that of a run by
    itself, and nothing else is left there.
    """
    module = loaded("core.blender.data.scene_frames")
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    for place in (alone, shared):
        place.mkdir()

    def run_in(place: Path) -> Iterator[float]:
        files = module.frame_files(bpy.context.scene, place, "f#", "PNG8", range(1, 4))
        return frames.solved(bpy.context, frames.Run(files, "PNG8", overwrite=True))

    list(run_in(alone))
    for _ in zip_longest(run_in(shared), run_in(shared)):
        pass
    assert contents(shared) == contents(alone)
    assert {path.name for path in shared.iterdir()} == {path.name for path in alone.iterdir()}
    assert sorted(line["frame"] for line in log(shared)) == [1, 1, 2, 2, 3, 3]


def test_a_run_that_is_stopped_takes_its_placeholder_back(frames, kiriko, parts, tmp_path):
    """As by Esc: the frame of before is shown, no handler of ours is left; an empty file is
    no frame.
    """
    scene = bpy.context.scene
    scene.frame_set(7)
    handlers = {
        name: list(getattr(bpy.app.handlers, name))
        for name in ("frame_change_post", "depsgraph_update_post")
    }
    module = loaded("core.blender.data.scene_frames")
    files = module.frame_files(bpy.context.scene, tmp_path, "f#", "PNG8", (1, 2))
    steps = frames.solved(bpy.context, frames.Run(files, "PNG8", placeholders=True))
    for _ in range(3):
        next(steps)
    assert files[1].exists()
    steps.close()
    assert list(tmp_path.glob("f*")) == []
    assert scene.frame_current == 7
    assert handlers == {name: list(getattr(bpy.app.handlers, name)) for name in handlers}

    assert list(tmp_path.glob(".*")) == []

    files[1].touch()
    steps_of = loaded("core.base.steps")
    assert steps_of.run_steps(frames.solved(bpy.context, frames.Run(files, "PNG8"))).written == 2
    assert files[1].stat().st_size > 100
