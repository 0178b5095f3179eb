"""The files of warp maps, read by judges that know the formats alone (known/warp_readers.py)."""

import json
import re

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError
from kiriko.core.files import image_io
from kiriko.core.lab.warp.map_files import (
    CHANNELS,
    FORMATS,
    MapOptions,
    description,
    earlier_files,
    maps_of,
    names_of,
    remove_earlier,
    write_maps,
)
from known.known_maps import asked_for, maps_by, straight, turned
from known.reference_rigs import ball_rig, cube_rig
from known.warp_readers import bilinear, data, drawn, obj, pgm, ramp, remapped, sampled
from known.work import drain, solve

ALL = MapOptions(formats=tuple(FORMATS), times=4, mesh_step=4.0)
SIZE = 40, 32  # of a display, px
PICTURE = 96, 48  # px


def written(folder, maps):
    names = names_of("", ALL)
    write_maps(folder, names, maps, "a map")
    return {name: folder / name for of_form in names.values() for name in of_form}


def warped_by_all(picture, files, size, times):
    """A picture as each reader warps it by its file."""
    exr, _ = image_io.read(files["warp.exr"])
    png, _ = image_io.read(files["warp.png"])
    npz = np.load(files["warp.npz"])
    return {
        "exr": sampled(picture, np.where(exr[..., 2:3] > 0, exr[..., :2], -9)),
        "png": sampled(picture, np.where(png[..., 2:3] > 0, png[..., :2], -9)),
        "npz": bilinear(picture, npz["map_x"].astype(float), npz["map_y"].astype(float)),
        "ffmpeg": remapped(picture, pgm(files["x.pgm"]), pgm(files["y.pgm"]), times),
        "obj": drawn(picture, *obj(files["warp.obj"]), size),
        "data": drawn(picture, *data(files["warp.data"]), size),
    }


# px of the picture: a reader of the nearest of 4 x 4 parts is off by less than an eighth, on the
# mean by nothing; 16 bits of 96 px are 0.0007 px
ALLOWED = {"exr": 1e-4, "png": 1e-3, "npz": 1e-4, "ffmpeg": 0.125, "obj": 1e-4, "data": 1e-4}


@pytest.mark.parametrize("way", [straight, turned])
def test_known_ways_come_out_of_each_file(tmp_path, way):
    """Identity, and a quarter turn, which no flip of rows, columns, s or t leaves as it is: the
    place that each reader fetches is the place that the way asks for.
    """
    files = written(tmp_path, maps_by(way, SIZE, PICTURE, ALL.times, 4))
    expected = asked_for(way, SIZE, PICTURE)
    inner = np.s_[2:-2, 2:-2]  # beside the outer half pixel, where readers differ
    for form, image in warped_by_all(ramp(*PICTURE), files, SIZE, ALL.times).items():
        off = np.abs(image[..., :2] - expected)[inner].max()
        assert off < ALLOWED[form], form


@pytest.mark.parametrize("make", [ball_rig, cube_rig])
def test_real_maps_make_the_source_image(tmp_path, make):
    """Each reader's image of the picture of places is Kiriko's own source image, but for the mean
    over a pixel and the facets of meshes.
    """
    options = {"levels": 3} if make is ball_rig else {}
    solution = solve(
        make(pixels=64, display_pixels=64, image=ramp(64, 64), **options), ghosts="strongest"
    )
    channel = solution.first
    maps = drain(maps_of(channel, ALL))
    files = written(tmp_path, maps)
    about = description(channel, maps, names_of("", ALL))
    places = maps.warp.st * [64, -64] + [0, 64]
    sure = (solution.display_coverage > 1 - 1e-9) & (maps.warp.multiplicity == 1)
    sure &= ((places > 3) & (places < 61)).all(axis=2)

    for form, image in warped_by_all(ramp(64, 64), files, (64, 64), ALL.times).items():
        off = np.abs(image[..., :2] - solution.source[..., :2]).max(axis=2)[sure]
        drawn = np.isfinite(off)
        # the regular grid leaves out cells at borders
        assert drawn.mean() > (0.75 if form == "data" else 0.97), form
        assert np.percentile(off[drawn], 95) < 0.15, form
    assert about["mesh"]["off_px"]["largest"] < 0.5
    assert about["folds"] == {"of_display": float((maps.warp.multiplicity > 1).mean()), "most": 1}


def test_nothing_is_nothing_in_each_file(tmp_path):
    """Where a map shows nothing, every reader shows nothing."""
    rig = ball_rig(3, pixels=48, display_pixels=48, image=ramp(64, 64))
    solution = solve(rig)
    maps = drain(maps_of(solution.first, ALL))
    files = written(tmp_path, maps)
    dark = ~maps.warp.is_there
    assert 0.2 < dark.mean() < 0.8
    images = warped_by_all(ramp(64, 64), files, (48, 48), ALL.times)
    for form in ("exr", "png", "npz", "obj", "data"):
        # a cell of about a pixel may reach half a pixel beyond
        near = np.isfinite(images[form][..., 0]) & dark
        assert near.sum() <= (0 if form in ("exr", "png", "npz") else 0.02 * dark.size), form


def test_exr_has_all_channels_in_single_precision(tmp_path):
    """R, G, B, A first, then the others by their names; half float would be 0.94 px off at 4K."""
    maps = maps_by(straight, SIZE, PICTURE, ALL.times, 4)
    files = written(tmp_path, maps)
    pixels, about = image_io.read(files["warp.exr"])
    oiio = image_io.openimageio()
    spec = oiio.ImageInput.open(str(files["warp.exr"])).spec()
    assert spec.channelnames[:4] == ("R", "G", "B", "A")
    assert set(spec.channelnames) == set(CHANNELS)
    assert str(spec.format) == "float"
    assert about["compression"] == "zip"
    assert np.array_equal(pixels[..., :2], maps.warp.st.astype(np.float32))
    assert not any("." in name for name in CHANNELS)


def test_command_is_for_these_maps():
    """Sizes are those of display and picture; players want even sizes for 4:2:0."""
    channel = solve(ball_rig(3, pixels=32, display_pixels=33)).first
    options = MapOptions(formats=("FFMPEG",), times=2)
    maps = drain(maps_of(channel, options))
    command = description(channel, maps, names_of("_a", options))["ffmpeg"]["command"]
    assert "-i x_a.pgm -i y_a.pgm" in command
    assert "scale=1024x1024:flags=bicubic" in command
    assert re.search(r"scale=33x33:flags=area:[^,]*,format=yuv444p\[v\]", command)
    assert maps.larger.size == (66, 66)
    assert maps.mesh is maps.view is None


@pytest.mark.parametrize("form", FORMATS)
def test_disk_that_is_full_is_one_sentence(tmp_path, form):
    """Each writer tells which file cannot be written, and why."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    maps = maps_by(turned, SIZE, PICTURE, ALL.times, 4)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(ImageError, match=r"^The file '.*' .*: check the disk.*\.$"):
            write_maps(tmp_path, names_of("", MapOptions(formats=(form,))), maps, "a map")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_earlier_maps_are_removed_and_nothing_else(tmp_path):
    """Files that maps.json tells of, and that a map can be called; those written anew stay."""
    ours = ["warp_650nm.exr", "view_Left-Eye_2.exr", "x.pgm", "warp.npz"]
    others = ["warp.blend", "xx.pgm", "notes.exr", "warp", "view.npz", "film.pgm"]
    beside = tmp_path / "beside"
    beside.mkdir()
    for path in (beside / "warp.exr", *(tmp_path / name for name in (*ours, *others))):
        path.write_text("kept")
    (tmp_path / "warp.obj").mkdir()
    files = {
        "EXR": [*ours[:2], *others, "beside/warp.exr", "../warp.exr", ".", "warp_gone.exr"],
        "FFMPEG": [ours[2]],
        "NPZ": [ours[3]],
        "OBJ": ["warp.obj"],
        "BLEND": ["warp.blend"],
    }
    assert earlier_files(tmp_path) == set()
    about = {"maps": [{"files": {form: names}} for form, names in files.items()]}
    (tmp_path / "maps.json").write_text(json.dumps(about))
    earlier = earlier_files(tmp_path)
    remove_earlier(tmp_path, earlier, ["Warp.npz"])
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*others, "warp.npz", "warp.obj", "beside", "maps.json"}
    assert (beside / "warp.exr").read_text() == "kept"


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", "7", '{"maps": 3}', '{"maps": [{"files": []}]}', '{"maps": [null]}']
)
def test_other_json_files_tell_of_no_maps(tmp_path, text):
    (tmp_path / "maps.json").write_text(text)
    assert earlier_files(tmp_path) == set()
