"""Kiriko's files as other programs read them: `dev.py farm`.

Warp maps are read by the programs themselves: Blender's Map UV, OpenCV's remap, and ffmpeg with
Kiriko's printed command. An independent reader of STMaps and a rasteriser for meshes follow their
documentation. The picture's colours are its coordinates, so each pixel shows which position a
reader fetched.

*identity*, *quarter turn*: known maps, largest error in picture px; the turn catches each flip.
*ball*: the map of the reference ball, against the coordinates in Kiriko's own source image of this
picture, median and 99 %, picture px. A source image has the mean over each pixel, a reader the
middle, so they differ by at least a hundredth. *drawn*: fraction of the pixels painted by Kiriko
that the reader paints, too. *image*: RMSE against Kiriko's own source image of the lattice, linear
values.

farm_movies.py then decodes movies by ffmpeg, and farm_jobs.py runs jobs by openjd-cli and by two
processes.
"""

import argparse
import json
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from environments import as_module, clean_environment, python_path
from kiriko.core.base.steps import run_steps
from kiriko.core.files import image_io
from kiriko.core.lab.warp.map_files import (
    FORMATS,
    TIMES,
    ChannelMaps,
    MapOptions,
    ffmpeg_command,
    maps_of,
    names_of,
    write_maps,
)
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known import map_uv
from known.known_maps import asked_for, maps_by, straight, turned
from known.reference_rigs import ball_rig, lattice_image
from known.warp_readers import data, drawn, obj, ramp, sampled

from . import farm_jobs, farm_movies
from .runner import Bench, Row, option, proof, run

Image = NDArray[np.floating]
PIXELS = 256  # of display, viewer and picture
# px of the picture, within the readers' own precision
EXACT = 1e-3
# ffmpeg's own scaler preserves colours, here coordinates, to a thousandth of white
OF_WHITE = {"png": 1 / 65535, "16 bit": 1.5e-3, "as printed": 1 / 64}
BALL_MARK = 0.1  # median
NEAREST = 0.5  # the error of a reader of the nearest pixel
DRAWN = 0.9  # of the pixels; a regular grid leaves out cells at borders


def read_by_all(
    folder: Path, maps: ChannelMaps, picture: Image, readers: Path
) -> Iterator[tuple[str, Image]]:
    """Images (H, W, 3) that readers make of a picture (h, w, 3) with the map files."""
    width, height = maps.warp.size
    options = MapOptions(formats=tuple(FORMATS), times=maps.times)
    names = names_of("", options)
    write_maps(folder, names, maps, "a map")
    command = ffmpeg_command(names["FFMPEG"], (width, height), maps.warp.to_size, maps.times)
    about = {"display": {"size": [width, height]}, "maps": [{"ffmpeg": {}}]}
    about["maps"][0]["ffmpeg"] = {"command": command, "times": maps.times}
    (folder / "maps.json").write_text(json.dumps(about))
    np.save(folder / "picture.npy", picture.astype(np.float32))
    run = [readers, *as_module("bench.readers"), folder]
    subprocess.run(run, env=clean_environment(PYTHONPATH=python_path()), check=True)

    if maps.times == TIMES[0]:  # the others differ for ffmpeg alone
        opaque = np.dstack([picture, np.ones(picture.shape[:2], np.float32)])
        found = map_uv.warped(opaque, folder / "warp.exr", folder)
        coverage = maps.warp.coverage[..., None]
        lit = np.divide(
            found[..., :3], coverage, out=np.zeros_like(found[..., :3]), where=coverage > 0
        )
        yield f"warp.exr: Map UV of Blender {bpy.app.version_string.split()[0]}", lit
        for name, form in (("warp.exr: bilinear, as Nuke's STMap", "exr"), ("warp.png", "png")):
            st, _ = image_io.read(folder / f"warp.{form}")
            yield name, sampled(picture, np.where(st[..., 2:3] > 0, st[..., :2], -9))
        yield "warp.npz: OpenCV's remap", np.load(folder / "opencv.npy")
        for name, read in (("warp.obj", obj), ("warp.data", data)):
            triangles = read(folder / name)
            yield f"{name}: rasteriser", drawn(picture, *triangles, (width, height))

    times = maps.times
    yield f"pgm: ffmpeg, {times} x, 16 bit", np.load(folder / f"ffmpeg_{times}.npy")
    yield f"pgm: ffmpeg, {times} x, as printed", np.load(folder / f"film_{times}.npy")


def off_known(image: Image, expected: Image) -> float:
    """The largest position error, without the outer two pixels, where readers differ."""
    off = np.abs(image[..., :2] - expected)[2:-2, 2:-2]
    return float(np.nan_to_num(off, nan=np.inf).max())


def off_ball(image: Image, source: Image, sure: Image) -> tuple[tuple[float, float], float]:
    """Median and 99 % of the errors of places, where a pixel is drawn, and how many are."""
    off = np.abs(image[..., :2] - source[..., :2]).max(axis=2)[sure]
    is_drawn = np.isfinite(off) & (image[..., :2].max(axis=2)[sure] > 1)
    median, most = np.percentile(off[is_drawn], [50, 99])
    return (float(median), float(most)), float(is_drawn.mean())


def mark_of(name: str, pixels: int) -> tuple[float, float]:
    """The marks of a reader for known maps and for the ball, picture px."""
    mark = next((pixels * part for form, part in OF_WHITE.items() if form in name), EXACT)
    times = re.search(r"(\d) x", name)
    is_nearest = times or ("Map UV" in name and map_uv.is_nearest())
    nearest = NEAREST / int(times[1] if times else 1) if is_nearest else 0.0
    return max(mark, EXACT), max(BALL_MARK, nearest + mark)


def maps(readers: Path, pixels: int) -> Iterator[Row]:
    """The table's rows."""
    places = ramp(pixels, pixels)
    lattice = lattice_image(pixels)
    rig = ball_rig(pixels=pixels, display_pixels=pixels, image=places)
    settings = Settings(ghosts="strongest")
    session = Session()
    solution = run_steps(session.solve(rig, settings))
    own = solution.source
    pictures = (rig.picture_place.showing(lattice),)
    painted = run_steps(session.solve(replace(rig, pictures=pictures), settings))

    for times in TIMES:
        options = MapOptions(formats=tuple(FORMATS), times=times)
        ball = run_steps(maps_of(solution.first, options))
        at = ball.warp.st * [pixels, -pixels] + [0, pixels]
        sure = (solution.display_coverage > 1 - 1e-6) & (ball.warp.multiplicity > 0)
        sure &= ((at > 2) & (at < pixels - 2)).all(axis=2)
        known = [maps_by(way, (pixels, pixels), (pixels, pixels), times, 8) for way in WAYS]
        picture = places[..., :3]
        jobs = [(known[0], picture), (known[1], picture), (ball, picture), (ball, lattice[..., :3])]
        found = []
        for maps, shown in jobs:
            with tempfile.TemporaryDirectory() as folder:
                found.append(dict(read_by_all(Path(folder), maps, shown, readers)))

        size = (pixels, pixels)
        for name in found[0]:
            mark, ball_mark = mark_of(name, pixels)
            of_ball, part = off_ball(found[2][name], own, sure)
            image = (found[3][name] - painted.source)[sure]
            identity = off_known(found[0][name], asked_for(straight, size, size))
            turn = off_known(found[1][name], asked_for(turned, size, size))
            yield proof(
                name,
                f"identity {identity:.1e}, turn {turn:.1e}, ball {of_ball[0]:.3f},"
                f" {of_ball[1]:.2f}, drawn {part:.1%}, image {np.sqrt(np.nanmean(image**2)):.4f}",
                max(identity, turn) <= mark and of_ball[0] <= ball_mark and part > DRAWN,
            )


WAYS = straight, turned
CASES = {
    "maps": lambda readers, _: maps(readers, PIXELS),
    "movies": farm_movies.rows,
    "jobs": farm_jobs.proofs,
}


def measure(_: str, prove: Callable, arguments: argparse.Namespace) -> Iterator[Row]:
    """The proofs of a part, in an empty folder."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        yield from prove(arguments.readers, Path(folder))


if __name__ == "__main__":
    columns = {"what": "", "kept": "s", "found": ""}
    readers = option("--readers", type=Path, required=True, help=argparse.SUPPRESS)
    run(__doc__, "bench.farm", Bench(CASES, columns, measure), readers)
