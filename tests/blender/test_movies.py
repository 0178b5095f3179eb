"""Movies of frames, by Blender's encoder, decoded again frame by frame."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import small_rig

SIZE = (256, 192)  # less is too small for AV1
# of 255: by how much numbers may differ after the codec, the largest; 0: it is lossless
ROUNDING = {"H264": 5, "H265": 5, "AV1": 6, "PRORES": 3, "FFV1": 0}


@pytest.fixture
def movie(scene) -> ModuleType:
    loaded("operators.export").use_bundled_modules()
    return loaded("core.blender.data.movie")


@pytest.fixture
def core(kiriko) -> Callable[[str], ModuleType]:
    return lambda name: loaded(f"core.{name}")


def numbers(n: int) -> np.ndarray:
    """A frame (h, w, 3) uint8: a ramp of greys, and a grey field that tells which frame it is."""
    width, height = SIZE
    frame = np.repeat(np.rint(np.linspace(0, 255, width))[None, :, None], height, axis=0)
    frame = np.repeat(frame, 3, axis=2)
    frame[:32] = 20 + 4 * n
    return frame.astype(np.uint8)


def written(place: Path, n: int, image_io: ModuleType) -> list[Path]:
    """Files of frames, whose numbers are those of `numbers`."""
    codes = np.arange(256) / 255
    light = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    light = light.astype(np.float32)
    return [
        image_io.write(place / f"frame_{k:03}", light[numbers(k)], "PNG8") for k in range(1, n + 1)
    ]


def decoded(path: Path, moving: ModuleType, n: int) -> list[np.ndarray]:
    """Encoded numbers (h, w, 3), times 255, of a movie's frames, as Blender reads them."""
    image = bpy.data.images.load(str(path), check_existing=False)
    reel = moving.Reel()
    found = []
    for k in range(1, n + 1):
        shown = reel.at(image, k, "test")
        width, height = shown.size
        pixels = np.empty(width * height * 4, np.float32)
        shown.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, 4)[::-1, :, :3].astype(float)
        if shown.is_float:  # linear then
            pixels = np.where(
                pixels <= 0.0031308,
                12.92 * pixels,
                1.055 * np.maximum(pixels, 0) ** (1 / 2.4) - 0.055,
            )
        found.append(255 * pixels)
    reel.close()
    bpy.data.images.remove(image)
    return found


@pytest.mark.parametrize("name", ROUNDING)
def test_each_frame_comes_back_in_its_own_numbers(movie, core, scene, tmp_path, name):
    """5 frames; whatever view transform the scene has, none is in the movie; nothing is left."""
    if name not in movie.available():
        pytest.skip("this Blender has no such encoder")
    scene.view_settings.exposure = 2.0
    files = written(tmp_path, 5, core("files.image_io"))
    before = [b.name for b in bpy.data.scenes]
    path = tmp_path / f"clip{movie.CODECS[name].suffix}"
    movie.encode(path, files, name, SIZE, scene)
    assert movie.n_frames(path) == 5
    for k, frame in enumerate(decoded(path, core("blender.data.moving"), 5), 1):
        off = np.abs(frame - numbers(k))
        assert off[8:24].max() <= max(ROUNDING[name], 0.01), k
        assert off[40:].max() <= max(ROUNDING[name], 0.01), k
    assert [b.name for b in bpy.data.scenes] == before


@pytest.mark.parametrize(("name", "rounding"), [("PRORES", 8), ("FFV1", 0)])
def test_each_pixel_keeps_its_colour(movie, core, scene, tmp_path, name, rounding):
    """Columns of red and of blue, one pixel wide: a codec that
    halves the colours' resolution is off by a hundred.
    """
    if name not in movie.available():
        pytest.skip("this Blender has no such encoder")
    light = np.zeros((*SIZE[::-1], 3), np.float32)
    light[:, ::2, 0] = light[:, 1::2, 2] = 0.5
    frame = core("files.image_io").write(tmp_path / "frame", light, "PNG8")
    path = tmp_path / f"clip{movie.CODECS[name].suffix}"
    movie.encode(path, [frame], name, SIZE, scene)
    off = np.abs(decoded(path, core("blender.data.moving"), 1)[0] - np.where(light > 0, 188, 0))
    assert off.max() <= max(rounding, 0.01)


def test_two_seconds_at_the_rate_of_the_scene_are_two_seconds(movie, core, scene, tmp_path):
    """Frame by frame, lossless; Blender's own reader tells the rate."""
    scene.render.fps, scene.render.fps_base = 30, 1.001
    files = written(tmp_path, 60, core("files.image_io"))
    path = tmp_path / "clip.mkv"
    movie.encode(path, files, "FFV1", SIZE, scene)
    for k, frame in enumerate(decoded(path, core("blender.data.moving"), 60), 1):
        assert np.abs(frame - numbers(k)).max() < 0.01
    clip = bpy.data.movieclips.load(str(path))
    assert (clip.fps, clip.frame_duration) == (pytest.approx(30 / 1.001, abs=1e-3), 60)
    bpy.data.movieclips.remove(clip)


@pytest.mark.parametrize(("rate", "base"), [(12, 1.0), (30, 1.001)])
def test_a_film_can_give_the_scene_its_rate_and_range(
    movie, core, scene, tmp_path, capfd, rate, base
):
    """Open Picture says that a film of another rate plays too fast; one button makes rate and range
    the film's, also of a film that begins later.
    """
    small_rig()
    assert not bpy.ops.kiriko.use_film.poll()
    scene.render.fps, scene.render.fps_base = rate, base
    path = tmp_path / "film.mkv"
    movie.encode(path, written(tmp_path, 5, core("files.image_io")), "FFV1", SIZE, scene)
    scene.render.fps, scene.render.fps_base = 24, 1.0
    clips = len(bpy.data.movieclips)
    bpy.ops.kiriko.open_picture(filepath=str(path))
    assert f"runs at {rate / base:.4g} fps, the scene at 24." in capfd.readouterr().out

    assert bpy.ops.kiriko.use_film() == {"FINISHED"}
    assert scene.render.fps / scene.render.fps_base == pytest.approx(rate / base, rel=1e-4)
    assert (scene.frame_start, scene.frame_end) == (1, 5)
    bpy.ops.kiriko.open_picture(filepath=str(path))
    assert " fps, the scene at" not in capfd.readouterr().out
    plane = core("blender.read.plane")
    picture = next(thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    image, timing = plane.film_of(picture)
    plane.set_shown_timing(picture, image, replace(timing, frame_start=11))
    assert bpy.ops.kiriko.use_film() == {"FINISHED"}
    assert (scene.frame_start, scene.frame_end) == (11, 15)
    assert len(bpy.data.movieclips) == clips


@pytest.mark.parametrize("name", ["{fps}.mkv", "take #1.mkv", "#.mkv"])
def test_signs_in_its_path_are_its_own(movie, core, scene, tmp_path, name):
    """Blender from 4.5 on reads braces as templates, of the frame rate or of nothing, and in any
    version # as digits of a frame.
    """
    files = written(tmp_path, 2, core("files.image_io"))
    place = tmp_path / "{a #"
    place.mkdir()
    movie.encode(place / name, files, "FFV1", SIZE, scene)
    assert movie.n_frames(place / name) == 2
    assert [path.name for path in place.iterdir()] == [name]


@pytest.mark.parametrize("name", ROUNDING)
def test_every_codec_has_the_card_and_then_the_frames(movie, core, scene, tmp_path, name):
    """The lattice is that of the card, as near as the codec keeps single pixels; words stand over
    it, and the first frame after it has its own numbers.
    """
    if name not in movie.available():
        pytest.skip("this Blender has no such encoder")
    files = written(tmp_path, 2, core("files.image_io"))
    plain = core("image.test_card").card(*SIZE)
    file = core("files.image_io").write(tmp_path / "card", plain, "PNG8")
    path = tmp_path / f"clip{movie.CODECS[name].suffix}"
    movie.encode(path, files, name, SIZE, scene, movie.Card(file, 3, ("Display", "256 x 192")))
    assert movie.n_frames(path) == 5
    frames = decoded(path, core("blender.data.moving"), 5)
    wanted = 255 * core("files.image_io").read(file)[0]
    for frame in frames[:3]:
        off = np.abs(frame - wanted)
        assert max(off[:48].mean(), off[144:].mean()) < (1 if ROUNDING[name] else 0.01)
        assert off[60:132].max() > 100  # the words
    for k in (1, 2):
        off = np.abs(frames[2 + k] - numbers(k))
        assert off[8:24].max() <= max(ROUNDING[name], 0.01), k


def test_a_codec_that_cannot_be_is_refused_with_those_that_can(movie, core, monkeypatch):
    """One that this Blender lacks; odd sides; no encoder at all."""
    errors = core("base.errors")
    movie.check("FFV1", (641, 481))
    with pytest.raises(errors.ImageError, match=r"odd size 641 x 480.*FFV1"):
        movie.check("H264", (641, 480))
    monkeypatch.setattr(movie, "available", lambda: ("H264", "FFV1"))
    with pytest.raises(errors.ImageError, match=r"cannot encode ProRes: choose H\.264, FFV1\.$"):
        movie.check("PRORES", (640, 480))
    monkeypatch.setattr(movie, "available", lambda: ())
    with pytest.raises(errors.ImageError, match=r"cannot encode H\.264: use Blender from"):
        movie.check("H264", (640, 480))


def test_the_command_line_makes_a_movie_of_what_is_there_and_of_what_is_not(
    run, core, movie, scene, tmp_path, capsys
):
    """Of frames that move; the movie's frames are the files; one that is there is not replaced."""
    parts = small_rig()
    for frame, brightness in ((1, 0.2), (4, 1.0)):
        parts["PICTURE"].kiriko.picture.brightness = brightness
        parts["PICTURE"].keyframe_insert("kiriko.picture.brightness", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    assert run("solve", "--out", out, "--frames", "2", "--name", "f_##") == 0
    made = (out / "f_02.png").read_bytes()
    asked = ("solve", "--out", out, "--frames", "1-4", "--name", "f_##", "--movie", "FFV1")
    assert run(*asked, "--test-card", "0.125") == 0
    assert (out / "f_02.png").read_bytes() == made
    files = [out / f"f_{k:02}.png" for k in range(1, 5)]
    frames = decoded(out / "f.mkv", core("blender.data.moving"), 7)
    for file, frame in zip(files, frames[3:], strict=True):
        pixels, _ = core("files.image_io").read(file)
        assert np.abs(frame - 255 * pixels).max() < 0.01
    assert run(*asked) == 1
    assert "f.mkv already" in capsys.readouterr().err
    assert not list(out.glob(".*"))


def test_a_movie_is_refused_where_its_frames_do_not_fit(run, core, movie, scene, tmp_path, capsys):
    """Frames in linear light, and a frame of another size that was there; no movie is left."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    asked = ("solve", "--out", out, "--frames", "1-2", "--movie", "FFV1")
    assert run(*asked, "--format", "EXR_HALF") == 1
    assert "Choose PNG or TIFF" in capsys.readouterr().err
    out.mkdir()
    core("files.image_io").write(out / "source_0001", np.zeros((8, 8, 3)), "PNG8")
    assert run(*asked) == 1
    assert "has 8 x 8 pixels, the display 64 x 64" in capsys.readouterr().err
    assert not list(out.glob("*.mkv"))


def test_a_movie_of_png_files_needs_no_openimageio(run, core, movie, scene, tmp_path, monkeypatch):
    """The Python of Debian's Blender has none: Blender itself reads the frames' sizes."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert bpy.ops.kiriko.solve_animation(frames="1-2") == {"FINISHED"}

    def opened(path: Path) -> None:
        raise core("base.errors").ImageError("There is no OpenImageIO.")

    monkeypatch.setattr(core("files.image_io"), "_opened", opened)
    scene.kiriko.movie_codec = "FFV1"
    assert bpy.ops.kiriko.export_movie(frames="1-2") == {"FINISHED"}
    assert movie.n_frames(tmp_path / "source.mkv") == 2


@pytest.mark.parametrize("name", ROUNDING)
def test_a_disk_that_fills_up_while_blender_encodes_is_told(movie, core, scene, tmp_path, name):
    """The system takes no more than a few bytes of the file: whatever Blender says of it, that is
    one sentence, and nothing is left in Blender.
    """
    if name not in movie.available():
        pytest.skip("this Blender has no such encoder")
    resource = pytest.importorskip("resource")
    files = written(tmp_path, 3, core("files.image_io"))
    scenes = len(bpy.data.scenes)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, before[1]))
    try:
        with pytest.raises(core("base.errors").ImageError, match=r"movie '.*Check the disk"):
            movie.encode(tmp_path / f"clip{movie.CODECS[name].suffix}", files, name, SIZE, scene)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(bpy.data.scenes) == scenes


def test_solve_animation_writes_what_the_panel_says(scene, tmp_path):
    """Its path, format, the scene's range; the movie of it. Neither changes the scene."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 3, 2
    scene.frame_set(7)
    ours = scene.kiriko
    ours.animation_path, ours.export_format = "//film/a_###.exr", "PNG16"
    assert bpy.ops.kiriko.solve_animation() == {"FINISHED"}
    place = tmp_path / "film"
    assert sorted(p.name for p in place.iterdir()) == ["a_001.png", "a_003.png", "frames.jsonl"]
    (place / "a_003.png").unlink()
    ours.movie_path, ours.movie_codec = "//film", "FFV1"
    assert bpy.ops.kiriko.export_movie() == {"FINISHED"}
    movie = loaded("core.blender.data.movie")
    assert movie.n_frames(tmp_path / "film.mkv") == 2
    assert (place / "a_003.png").exists()
    ours.animation_anew = True  # which is of frames alone
    with pytest.raises(RuntimeError, match=r"film\.mkv already"):
        bpy.ops.kiriko.export_movie()
    ours.animation_anew = False
    before = (place / "a_001.png").stat().st_mtime_ns
    assert bpy.ops.kiriko.export_movie(overwrite=True) == {"FINISHED"}
    assert (place / "a_001.png").stat().st_mtime_ns == before
    assert scene.frame_current == 7
    assert ours.result.source is None
    shutil.rmtree(place)
    with pytest.raises(RuntimeError, match="is not a list of frames"):
        bpy.ops.kiriko.solve_animation(frames="a")
    assert not place.exists()
