"""Movies that Kiriko writes, decoded by a program that is not Blender: the ffmpeg of
imageio-ffmpeg, by film_reader.py.

The glass of a small rig turns. Its frames are painted once, as PNG files; each encoder makes its
movie of them, and each frame that is decoded is compared with the painted one.
"""

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from bench import farm_jobs
from environments import as_module, clean_environment, python_path
from kiriko.core.files import image_io

FRAMES = 12
RATE = 30, 1.001  # of the scene: fps and its base
SIZE = 256, 192  # less is too small for AV1
RATE_OFF = 0.01  # by which a container may round the rate, frames a second
MEAN_MARK = 1.5  # of 255, but for FFV1, which is lossless: a wrong range or gamma is off by more
HEADING = (
    "| codec: as ffmpeg names it | frames | frames a second | off, of 255: mean | largest"
    " | in order | kept |\n|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Row:
    """A movie as it was decoded.

    off : of 255, from the painted frames: mean and largest
    in_order : is each frame nearest to its own among the painted ones?
    """

    name: str
    n: int
    rate: float
    off: tuple[float, float]
    in_order: bool
    is_lossless: bool

    @property
    def is_kept(self) -> bool:
        is_near = self.off[1] == 0 if self.is_lossless else self.off[0] <= MEAN_MARK
        is_timed = abs(self.rate - RATE[0] / RATE[1]) <= RATE_OFF
        return self.n == FRAMES and is_timed and self.in_order and is_near

    def text(self) -> str:
        mean, largest = self.off
        return (
            f"| {self.name} | {self.n} | {self.rate:.2f} | {mean:.2f} | {largest:.0f}"
            f" | {'yes' if self.in_order else 'no'} | {'yes' if self.is_kept else 'NO'} |"
        )


def rows(readers: Path, folder: Path) -> Iterator[Row]:
    """A row for each encoder of this Blender; `readers` is the Python that has ffmpeg."""
    from kiriko.core.blender import movie  # Kiriko is registered by now

    farm_jobs.rig(folder, viewer=SIZE[0], display=SIZE)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = RATE
    codecs = movie.available()
    for codec in codecs:
        frames = ["--frames", f"1-{FRAMES}", "--name", f"{codec}_####"]
        farm_jobs.run_verb("solve", *frames, "--movie", codec, "--out", str(folder))

    run = [readers, *as_module("bench.film_reader"), folder]
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
    off = np.abs(frames[:n] - painted[:n])
    return Row(
        name=f"{label}: {found['codec']}",
        n=len(frames),
        rate=float(found["rate"]),
        off=(float(off.mean()), float(off.max())),
        in_order=bool((apart.argmin(axis=1) == np.arange(n)).all()),
        is_lossless=codec == "FFV1",
    )
