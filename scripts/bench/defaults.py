"""Rigs of Add Rig at their default sizes, by the operators: `dev.py bench --defaults`.

Processor seconds of Solve; then, as parts of it: Solve with nothing changed, Before and After, and
Solve with another picture. The bench ends with 1 where one of them is above MOST.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from time import process_time

import bpy
import numpy as np

from fuzz.shapes import linked, mesh_of, smooth
from kiriko.core.base.steps import run_steps
from known.registered import registered

from . import brought_glass as glasses
from .runner import MISSED, Row

SIZE = 1024  # px, of the pictures


def lens() -> bpy.types.Object:
    """A biconvex lens, 6 cm across and 1.2 cm thick."""
    mesh = mesh_of("uvsphere", u_segments=96, v_segments=48, radius=0.03)
    mesh.transform(np.diag([1.0, 0.2, 1.0, 1.0]))
    return linked(smooth(mesh), "Lens")


def cube() -> bpy.types.Object:
    """A cube of 5 cm, turned a little."""
    thing = linked(mesh_of("cube", size=0.05), "Cube")
    thing.rotation_euler.z = 0.28
    return thing


def text() -> bpy.types.Object:
    """A bevelled word, 5 cm wide."""
    thing = glasses.text(**glasses.BEVEL)
    thing.matrix_world = glasses.place_of("text, bevelled", thing)
    return thing


def filled() -> bpy.types.Object:
    """The wine glass with wine."""
    wine = glasses.wine()
    wine.kiriko.role, wine.kiriko.use_ior = "GLASS", True
    wine.kiriko.ior = 1.34
    thing = glasses.wine_glass()
    thing.kiriko.priority = 1
    return thing


def add_rig(make: Callable[[], bpy.types.Object] | None, **options: str) -> None:
    """A new scene with Add Rig around a glass, or around its own ball."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if make is not None:
        thing = make()
        bpy.ops.object.select_all(action="DESELECT")
        thing.select_set(True)
        bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.add_rig(**options)


def choose(seed: int) -> None:
    """Make the picture coloured noise, coarse and fine."""
    random = np.random.default_rng(seed)
    pixels = np.ones((SIZE, SIZE, 4), np.float32)
    pixels[..., :3] = 0.5
    for octave in range(1, 8):
        n = 2**octave
        part = random.normal(0, 0.3 / octave, (n, n, 3)).astype(np.float32)
        pixels[..., :3] += part.repeat(SIZE // n, 0).repeat(SIZE // n, 1)
    image = bpy.data.images.new(f"picture {seed}", SIZE, SIZE)
    image.pixels.foreach_set(pixels.clip(0, 1).ravel())
    image.pack()
    bpy.ops.kiriko.choose_picture(image=image.name)


def timed(work: Callable[[], object]) -> float:
    """Processor seconds of a call."""
    started = process_time()
    work()
    return process_time() - started


BEHIND = {"kind": "BEHIND_GLASS"}
DEFAULTS = {
    "ball": (None, {}, ""),
    "cube": (cube, {}, ""),
    "goblet": (glasses.wine_glass, {}, ""),
    "goblet with wine": (filled, {}, ""),
    "text": (text, {}, ""),
    "lens before an iPhone 15": (lens, BEHIND, "iPhone 15"),
}
COLUMNS = {"CPU s": ".2f", "nothing": ".3f", "picture": ".3f", "compare": ".3f", "mark": "s"}
# of a solve, at most
MOST = {"nothing": 0.02, "picture": 0.1, "compare": 0.25}


def measure(name: str, case: tuple, arguments: argparse.Namespace) -> Iterator[Row]:
    """Solve, again with nothing changed, with another picture, and Before and After."""
    registered()
    from kiriko.operators import before_after, compared, work

    make, options, display = case
    add_rig(make, **options)
    if display:
        bpy.ops.kiriko.display_preset(preset=display)
    rounds = []
    for _ in range(arguments.rounds):
        work.forget()
        compared.forget()
        choose(0)
        row = {"CPU s": timed(bpy.ops.kiriko.solve)}
        row["nothing"] = timed(bpy.ops.kiriko.solve) / row["CPU s"]
        row["compare"] = (
            timed(lambda: run_steps(before_after.comparing(bpy.context))) / row["CPU s"]
        )
        choose(1)
        row["picture"] = timed(bpy.ops.kiriko.solve) / row["CPU s"]
        rounds.append(row)
    row: Row = {head: float(np.median([row[head] for row in rounds])) for head in rounds[0]}
    is_kept = all(row[head] <= most for head, most in MOST.items())
    yield row | {"mark": "kept" if is_kept else MISSED}
