"""Kiriko's movies, decoded by a program other than Blender: the ffmpeg of imageio-ffmpeg, by
readers.py.

The glass of a small rig rotates. Its frames are painted once, as PNG files. Each encoder makes a
movie of them, and each decoded frame is compared with the painted one.
"""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from bench import farm_jobs
from environments import as_module, clean_environment, python_path
from kiriko.core.files import image_io

from .runner import Row, proof

FRAMES = 12
RATE = 30, 1.001  # of the scene: fps and its base
SIZE = 256, 192  # less is too small for AV1
RATE_OFF = 0.01  # rounding of the rate by a container, frames per second
MEAN_MARK = 1.5  # of 255, but for FFV1, which is lossless: a wrong range or gamma is off by more


def rows(readers: Path, folder: Path) -> Iterator[Row]:
    """A row for each encoder of this Blender; `readers` is the Python with ffmpeg."""
    from kiriko.core.blender.data import movie  # Kiriko is registered by now

    farm_jobs.rig(folder, viewer=SIZE[0], display=SIZE)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = RATE
    codecs = movie.available()
    for codec in codecs:
        frames = ["--frames", f"1-{FRAMES}", "--name", f"{codec}_####"]
        farm_jobs.run_verb("solve", *frames, "--movie", codec, "--out", str(folder))

    run = [readers, *as_module("bench.readers"), folder]
    subprocess.run(run, env=clean_environment(PYTHONPATH=python_path()), check=True)
    for codec in codecs:
        painted = [
            np.rint(255 * image_io.read(path)[0]) for path in sorted(folder.glob(f"{codec}_*.png"))
        ]
        yield _row(movie.CODECS[codec].label, codec, np.load(folder / f"{codec}.npz"), painted)


def _row(label: str, codec: str, found: Any, painted: list[NDArray[np.float32]]) -> Row:
    frames = found["frames"].astype(np.float32)
    n = min(len(frames), len(painted))
    apart = np.array([[np.abs(a - b).mean() for b in painted] for a in frames[:n]])
    in_order = bool((apart.argmin(axis=1) == np.arange(n)).all())
    off = np.abs(frames[:n] - painted[:n])
    is_near = not off.any() if codec == "FFV1" else off.mean() <= MEAN_MARK
    rate = float(found["rate"])
    is_timed = abs(rate - RATE[0] / RATE[1]) <= RATE_OFF
    return proof(
        f"{label}: {found['codec']}",
        f"{len(frames)} frames, {rate:.2f} a second, {'' if in_order else 'not '}in order, of 255"
        f" {off.mean():.2f} off on the mean, {off.max():.0f} at most",
        len(frames) == FRAMES and is_timed and in_order and is_near,
    )
