"""Frames a second of a rig that stands still and a picture that moves:
`python3 scripts/dev.py frames`.

The picture is a movie of the display's own size, encoded by Blender; light is traced once, for the
first frame, which is not counted. Seconds are medians over the others, by part of the work;
*processor* has those of all threads, which other work on the machine does not stretch.
"""

import argparse
import importlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import bpy
import numpy as np

from known.registered import registered

SIZES = {"512": (512, 512), "1080p": (1920, 1080), "4K": (3840, 2160)}
AIMS = {"512": 25.0, "1080p": 10.0, "4K": 3.0}  # frames a second
N = 6  # frames, the first of which traces
# parts of the work: where they are looked up
PARTS = {
    "read": ("operators.work", "read"),
    "write": ("core.files.image_io", "write"),
    "encode": ("core.files.image_io", "quantised"),
    "check": ("core.files.image_io", "_is_whole"),
}


def clip(folder: Path, size: tuple[int, int], movie: Any, image_io: Any) -> Path:
    """A movie of noise over moving bars: neither flat, nor as wild as noise alone."""
    width, height = size
    random = np.random.default_rng(7)
    noise = random.normal(0.0, 0.02, (height, width, 3)).astype(np.float32)
    x = np.arange(width) / width
    files = []
    for n in range(N):
        bars = 0.4 + 0.3 * np.sin(12 * x + n)[None, :, None] * np.array([1.0, 0.7, 0.4])
        pixels = np.clip(bars + np.roll(noise, 3 * n, axis=1), 0, 1).astype(np.float32)
        files.append(image_io.write(folder / f"clip_{n:03}", pixels, "PNG8"))
    path = folder / "clip.mp4"
    movie.encode(path, files, "H264", size, bpy.context.scene)
    return path


def rig(size: tuple[int, int], picture: Path) -> None:
    """A ball that shows a movie on a display of a size."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=0.03)
    bpy.ops.object.shade_smooth()
    bpy.ops.kiriko.add_rig(display_resolution=size)
    bpy.ops.kiriko.open_picture(filepath=str(picture))


@contextmanager
def timed(kiriko: Any, spent: dict[str, list[float]]) -> Iterator[None]:
    """Note how long each call of a part takes."""

    def watched(function: Callable[..., Any], into: list[float]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*given, **named)
            finally:
                into.append(time.perf_counter() - began)

        return call

    kept = []
    for part, (place, name) in PARTS.items():
        module = importlib.import_module(f"{kiriko.__name__}.{place}")
        kept.append((module, name, getattr(module, name)))
        setattr(module, name, watched(getattr(module, name), spent.setdefault(part, [])))
    try:
        yield
    finally:
        for module, name, function in kept:
            setattr(module, name, function)


def measured(kiriko: Any, folder: Path, form: str) -> dict[str, float]:
    """Median seconds of a frame after the first, as a whole and by part."""
    frames = importlib.import_module(f"{kiriko.__name__}.operators.frames")
    names = importlib.import_module(f"{kiriko.__name__}.core.blender.frames")
    files = names.frame_files(bpy.context.scene, folder, f"{form}_####", form, range(1, N + 1))
    spent: dict[str, list[float]] = {}
    ends: list[tuple[float, float]] = []

    def now() -> tuple[float, float]:
        return time.perf_counter(), time.process_time()

    tally = frames.Tally()
    with timed(kiriko, spent):
        for _ in frames.solved(bpy.context, frames.Run(files, form, overwrite=True), tally):
            if len(ends) < tally.written:
                ends.append(now())
        ends.append(now())
    if tally.traced != 1 or tally.failed:
        sys.exit(f"{tally}: light was to be traced once, and nothing to fail")
    whole, of_processor = np.median(np.diff(ends, axis=0), axis=0)
    return {
        "frame": whole,
        "processor": of_processor,
        **{part: median(seconds[1:] or [0.0]) for part, seconds in spent.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="dev.py frames", description=__doc__)
    parser.add_argument("--size", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--form", nargs="+", default=["PNG8", "EXR_HALF"])
    arguments = parser.parse_args()
    kiriko = registered()
    part = {
        name: importlib.import_module(f"{kiriko.__name__}.core.{name}")
        for name in ("blender.movie", "files.image_io")
    }
    importlib.import_module(f"{kiriko.__name__}.operators.export").use_bundled_modules()

    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for size in arguments.size:
            folder = Path(scratch) / size
            folder.mkdir()
            rig(
                SIZES[size],
                clip(folder, SIZES[size], part["blender.movie"], part["files.image_io"]),
            )
            for form in arguments.form:
                rows.append((size, form, measured(kiriko, folder, form)))

    columns = ("frame", "processor", *PARTS)
    print(f"{'display':8} {'format':9} {'frames/s':>9} {'aim':>5}  seconds: " + " ".join(columns))
    for size, form, seconds in rows:
        parts = " ".join(f"{seconds[name]:.3f}" for name in columns)
        print(f"{size:8} {form:9} {1 / seconds['frame']:9.1f} {AIMS[size]:5g}  {parts}")


if __name__ == "__main__":
    main()
