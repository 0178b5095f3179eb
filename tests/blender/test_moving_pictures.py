"""Image sequences as pictures: each frame of the scene has its own, by the image user's rule."""

import itertools
import json
import re
import shutil
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import small_rig
from test_scene_pictures import SIZE, add_plane, new_material, render, texture_material

FRAMES = 4  # of the sequences here


@pytest.fixture
def moving(kiriko) -> ModuleType:
    return loaded("core.blender.data.moving")


def grey(frame: int) -> int:
    """Of 255, in all of a frame."""
    return 40 * frame


def sequence(place: Path, first: int = 1) -> bpy.types.Image:
    """An image sequence; the datablock is that of its second file."""
    for n in range(FRAMES):
        image = bpy.data.images.new("frame", *SIZE)
        pixels = np.full((SIZE[0] * SIZE[1], 4), grey(n + 1) / 255, np.float32)
        pixels[:, 3] = 1.0
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw = str(place / f"clip_{first + n:03}.png")
        image.file_format = "PNG"
        image.save()
        bpy.data.images.remove(image)
    image = bpy.data.images.load(str(place / f"clip_{first + 1:03}.png"))
    image.source, image.alpha_mode = "SEQUENCE", "NONE"
    return image


def movie(place: Path) -> Path:
    """A lossless movie of the frames of a sequence."""
    module = loaded("core.blender.data.movie")
    bpy.data.images.remove(sequence(place))
    files = [place / f"clip_{k:03}.png" for k in range(1, FRAMES + 1)]
    path = place / "clip.mkv"
    module.encode(path, files, "FFV1", SIZE, bpy.context.scene)
    return path


def solved_frames(place: Path, frames: str) -> tuple[list[dict[str, Any]], list[int]]:
    """Lines of the log of frames that are solved, and their greatest grey, of 255."""
    command = loaded("operators.cli.command_line")
    image_io = loaded("core.files.image_io")
    bpy.ops.wm.save_as_mainfile(filepath=str(place / "rig.blend"))
    out = place / "out"
    assert command.run(["solve", "--out", str(out), "--frames", frames]) == 0
    log = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    pixels = [image_io.read(out / line["file"])[0] for line in log]
    return log, [round(float(frame.max()) * 255) for frame in pixels]


def user_of(plane: bpy.types.Object) -> bpy.types.ImageUser:
    nodes = plane.data.materials[0].node_tree.nodes
    return next(node for node in nodes if node.type == "TEX_IMAGE").image_user


def test_the_rule_is_that_of_blender(scene, moving, tmp_path):
    """Frame numbers and files of sequences are those of Blender's evaluated image user."""
    image = sequence(tmp_path)
    material, tree, _ = new_material()
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, user = image, node.image_user
    add_plane(material)
    user.use_auto_refresh = True
    choices = itertools.product(
        (1, 5, 12), (-2, 1, 4), (-1, 0, 3), (False, True), (-4, 0, 1, 3, 40)
    )
    for duration, start, offset, is_cyclic, frame in choices:
        user.frame_duration, user.frame_start = duration, start
        user.frame_offset, user.use_cyclic = offset, is_cyclic
        scene.frame_set(frame)
        shown = material.evaluated_get(bpy.context.evaluated_depsgraph_get())
        theirs = shown.node_tree.nodes[node.name].image_user
        number = moving.timing_of(user).number(frame)
        assert number == theirs.frame_current, (duration, start, offset, is_cyclic, frame)
        if number >= 0:
            file = image.filepath_from_user(image_user=theirs)
            assert moving.file_of(image, number) == Path(file)


@pytest.mark.parametrize("is_cyclic", [False, True])
def test_a_frame_of_the_scene_has_the_picture_that_cycles_shows(read, scene, tmp_path, is_cyclic):
    """Whether Auto Refresh is on or off; the image of the file stays as it was."""
    image = sequence(tmp_path)
    plane = add_plane(texture_material(image))
    user = user_of(plane)
    user.frame_duration, user.use_cyclic, user.use_auto_refresh = FRAMES, is_cyclic, is_cyclic
    for frame in (1, 3, 6):
        scene.frame_set(frame)
        pixels = read().rig.picture.image
        assert np.ptp(pixels[..., :3]) == 0
        shown = render(scene, tmp_path)
        assert np.abs(pixels[..., :3] - shown).max() < 1e-5
        bpy.data.objects.remove(scene.camera)
    assert not image.is_dirty
    assert image.source == "SEQUENCE"
    assert [i.name for i in bpy.data.images if i.name.startswith("clip")] == [image.name]


def test_a_frame_without_a_file_is_told_with_its_place(read, scene, tmp_path):
    errors = loaded("core.base.errors")
    add_plane(texture_material(sequence(tmp_path)))
    scene.frame_set(9)
    with pytest.raises(errors.ImageError, match=r"^Frame 9 of .*clip_009\.png is missing"):
        read()
    scene.frame_set(2)
    read()


def test_a_result_is_stale_at_another_frame_and_not_at_the_same(scene, tmp_path):
    watch = loaded("operators.watch")
    parts = small_rig()
    parts["PICTURE"].kiriko.image = sequence(tmp_path)
    scene.frame_set(2)
    bpy.ops.kiriko.solve()
    assert not watch.has_changed(bpy.context)
    scene.frame_set(3)
    assert watch.has_changed(bpy.context)
    scene.frame_set(2)
    assert not watch.has_changed(bpy.context)


def test_frames_of_a_sequence_trace_light_once(scene, tmp_path):
    """The rig stands still: frames after the first are painted; each is as light as its picture."""
    parts = small_rig()
    parts["PICTURE"].kiriko.image = sequence(tmp_path)
    log, greys = solved_frames(tmp_path, "1-4")
    assert [line["did"] for line in log] == ["traced"] + ["painted"] * 3
    assert greys == [grey(frame) for frame in range(1, 5)]


def test_a_rig_shows_each_frame_of_a_movie_and_holds_its_last(scene, tmp_path, capfd):
    """In any order; the frames after its end say so, and no others, and the run at its end, which
    the buttons do, too; the image stays as it was.
    """
    path = movie(tmp_path)
    small_rig()
    bpy.ops.kiriko.open_picture(filepath=str(path))
    image = bpy.data.images[path.name]
    log, greys = solved_frames(tmp_path, "3,1,2,4,6,5")
    asked = [line["frame"] for line in log]
    assert sorted(asked) == [1, 2, 3, 4, 5, 6]
    assert greys == [grey(min(frame, FRAMES)) for frame in asked]
    assert [line["did"] for line in log] == ["traced"] + ["painted"] * 5
    for line in log:
        told = [note for note in line["notes"] if "'clip.mkv' has only 4 frames" in note]
        assert bool(told) == (line["frame"] > FRAMES), line
    assert image.source == "MOVIE"
    assert [i.name for i in bpy.data.images if i.name.startswith("clip")] == [image.name]

    over = "The movie 'clip.mkv' ends early: from frame 5 on its last frame is shown."
    assert over in capfd.readouterr().out

    ours = scene.kiriko
    ours.animation_anew, ours.movie_codec = True, "FFV1"
    ours.movie_path = "//out/made"
    to_movie = partial(bpy.ops.kiriko.export_movie, overwrite=True)
    for press in (bpy.ops.kiriko.solve_animation, to_movie):
        assert press(frames="3-6") == {"FINISHED"}
        (level, told) = re.findall("(Info|Warning): (Wrote .*)", capfd.readouterr().out)[-1]
        assert level == "Warning"
        assert over in told
    assert press(frames="1-4") == {"FINISHED"}
    told = capfd.readouterr().out
    assert "Info: Wrote" in told
    assert "ends early" not in told


@pytest.mark.parametrize("is_movie", [False, True])
def test_the_checklist_changes_nothing_to_look_at_a_picture_that_moves(scene, tmp_path, is_movie):
    """It looks while panels are drawn, where Blender refuses to change data, and after each
    change, which a copy of an image would be; a file that is gone is told all the same.
    """
    look_over = loaded("operators.look_over")
    small_rig()
    file = movie(tmp_path) if is_movie else None
    image = sequence(tmp_path) if file is None else bpy.data.images.load(str(file))
    file = file or tmp_path / "clip_003.png"
    plane = next(thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    plane.data.materials.clear()
    plane.data.materials.append(texture_material(image))
    plane.kiriko.image = None
    user_of(plane).frame_duration = FRAMES
    scene.frame_set(3)

    def reported() -> list[str]:
        return [str(entry.text) for entry in look_over.found(bpy.context)]

    numbers = sorted(one.session_uid for one in bpy.data.images)
    newest = bpy.data.images.new("newest", 1, 1)
    assert not [text for text in reported() if "cannot be read" in text]
    after = bpy.data.images.new("next", 1, 1)
    # each datablock that is made gets the next number
    assert after.session_uid == newest.session_uid + 1
    bpy.data.images.remove(after)
    bpy.data.images.remove(newest)
    assert sorted(one.session_uid for one in bpy.data.images) == numbers

    file.unlink()
    image.reload()
    (text,) = (text for text in reported() if "Frame 3 of the image" in text)
    assert str(file) in text


def test_a_movie_whose_file_is_another_by_now_shows_the_new_one(scene, tmp_path):
    """With all that Live and a run of frames keep, too: the new pictures, and the new end is told.
    Blender's image still has the number of frames of the old one.
    """
    work, module, encoder = (
        loaded(name)
        for name in ("operators.work", "core.blender.read.shapes", "core.blender.data.movie")
    )
    chosen = loaded("operators.chosen")
    path = movie(tmp_path)
    small_rig()
    bpy.ops.kiriko.open_picture(filepath=str(path))
    kept = module.ShapeCache()
    kept.reel = module.Reel()

    def shown(frame: int) -> tuple[int, list[str]]:
        scene.frame_set(frame)
        reading = work.read(bpy.context, kept)
        ended = [note for note in map(str, reading.notes) if "its last one" in note]
        return round(encoded(float(reading.rig.picture.image[..., 0].max())) * 255), ended

    assert [shown(frame) for frame in (3, 2)] == [(grey(3), []), (grey(2), [])]
    before = chosen.chosen_settings(scene)
    files = [tmp_path / f"clip_{k:03}.png" for k in (4, 3)]
    encoder.encode(tmp_path / "new.mkv", files, "FFV1", SIZE, scene)
    (tmp_path / "new.mkv").replace(path)
    assert chosen.chosen_settings(scene) != before
    assert shown(2) == (grey(3), [])
    assert shown(1) == (grey(4), [])
    light, ended = shown(4)
    assert light == grey(3)
    (note,) = ended
    assert "has only 2 frames; its last one is shown at frame 4" in note
    kept.reel.close()


def encoded(light: float) -> float:
    """sRGB. Source: IEC 61966-2-1."""
    return 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055


def chosen(*names: str) -> list[dict[str, str]]:
    """The files that are selected in the file browser, as it hands them to an operator."""
    return [{"name": name} for name in names]


def test_files_that_are_selected_together_are_a_sequence(scene, read, tmp_path):
    """Whichever is the last one clicked, or none, and at whatever number they begin: the first is
    shown at frame 1, the last from its own on. Opened again they are the same image.
    """
    picture = small_rig()["PICTURE"]
    bpy.data.images.remove(sequence(tmp_path, first=99))
    names = [f"clip_{99 + n:03}.png" for n in range(FRAMES)]
    known = len(bpy.data.images)
    for clicked in (names[2], names[0], ""):
        path, files = f"{tmp_path}/{clicked}", chosen(*reversed(names))
        assert bpy.ops.kiriko.open_picture(filepath=path, files=files) == {"FINISHED"}
    assert len(bpy.data.images) == known + 1
    assert picture.kiriko.image.source == "SEQUENCE"
    for frame, shown in ((1, 1), (3, 3), (FRAMES, FRAMES), (40, FRAMES)):
        scene.frame_set(frame)
        pixels = read().rig.picture.image
        linear = ((grey(shown) / 255 + 0.055) / 1.055) ** 2.4
        assert pixels[..., :3] == pytest.approx(linear, abs=1e-3)

    for clicked in (names[1], ""):  # alone it stands still
        path = f"{tmp_path}/{clicked}"
        assert bpy.ops.kiriko.open_picture(filepath=path, files=chosen(names[1])) == {"FINISHED"}
        assert picture.kiriko.image.source == "FILE"


def test_a_numbered_file_opens_its_sequence_if_detection_is_on(scene, tmp_path, capfd):
    """The consecutive files around it, whichever is chosen; without detection, as in scripts by
    default, and if nothing is next to it, it is one image.
    """
    picture = small_rig()["PICTURE"]
    bpy.data.images.remove(sequence(tmp_path, first=7))
    path = str(tmp_path / "clip_008.png")
    for is_on, source in ((True, "SEQUENCE"), (False, "FILE")):
        bpy.ops.kiriko.open_picture(filepath=path, detect_sequences=is_on)
        assert picture.kiriko.image.source == source
    assert f"{FRAMES} frames" in capfd.readouterr().out
    bpy.ops.kiriko.open_picture(filepath=path, files=chosen("clip_008.png"), detect_sequences=True)
    assert Path(picture.kiriko.image.filepath).name == "clip_007.png"

    shutil.copy(path, tmp_path / "alone_3.png")
    bpy.ops.kiriko.open_picture(filepath=str(tmp_path / "alone_3.png"), detect_sequences=True)
    assert picture.kiriko.image.source == "FILE"


def test_the_file_browser_shows_thumbnails(kiriko):
    """`display_type` by the numbers of Blender's own."""
    browser = bpy.types.FileSelectParams.bl_rna.properties["display_type"].enum_items
    own = bpy.ops.kiriko.open_picture.get_rna_type().properties["display_type"]
    assert own.default == "THUMBNAIL"
    assert own.enum_items["THUMBNAIL"].value == browser["THUMBNAIL"].value


@pytest.mark.parametrize(
    "names",
    [
        ("a_1.png", "a_3.png"),
        ("a_1.png", "b_2.png"),
        ("a_1.png", "a_2.jpg"),
        ("a_1.png", "a_01.png"),
        ("a_1.png", "a.png"),
        ("a.png", "b.png"),
    ],
)
def test_files_that_are_no_sequence_are_refused(scene, tmp_path, names):
    """A gap, other names, another format, one number twice, none: and the picture stays."""
    picture = small_rig()["PICTURE"]
    before = picture.kiriko.image
    with pytest.raises(RuntimeError, match="The 2 chosen files are not a sequence"):
        bpy.ops.kiriko.open_picture(filepath=str(tmp_path / names[0]), files=chosen(*names))
    assert picture.kiriko.image == before
