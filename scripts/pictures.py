"""The README's pictures: the viewer's sight, warped and
corrected, in Cycles. Started by `dev.py pictures`.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

import kiriko
from bench.brought_glass import made
from demo import RIGS
from kiriko.core.base.steps import run_steps
from kiriko.core.blender.preview.cycles_preview import render_preview
from kiriko.core.files import image_io
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import without_glass
from kiriko.operators import work
from known.reference_rigs import glass_rig

PIXELS = 480
SAMPLES = 128


def star_pattern(size: int = 1024) -> np.ndarray:
    """Lines of cut glass (size, size, 3), linear: a triangular
    grid and its altitudes, in a square frame.
    """
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    y = -y
    radius = np.hypot(x, y)
    light = np.zeros((size, size))

    for k in range(6):
        angle = np.pi * k / 6
        step = 0.3 if k % 2 else 0.3 * 3**0.5 / 2 / 1.5
        across = (x * np.cos(angle) + y * np.sin(angle)) / step
        away = np.abs(across - np.rint(across)) * step
        line = np.clip((0.012 - away) * size / 3, 0, 1) * (0.55 if k % 2 else 1.0)
        light = np.maximum(light, line)

    to_edge = np.maximum(np.abs(x), np.abs(y))
    light = np.maximum(
        light * (to_edge < 0.93), np.clip((0.02 - np.abs(to_edge - 0.95)) * size / 3, 0, 1)
    )
    hue = np.clip(radius, 0, 1)[..., None]
    gold = np.array([1.0, 0.62, 0.18])
    cyan = np.array([0.15, 0.85, 0.9])
    blue = np.array([0.25, 0.3, 1.0])
    colour = np.where(
        hue < 0.5, gold + (cyan - gold) * hue * 2, cyan + (blue - cyan) * (hue * 2 - 1)
    )

    return (light[..., None] * colour).astype(np.float32)


def light_the_glass() -> None:
    """A dim room and a window at the left, so that the glass itself is seen."""
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("Room")
    scene.world.use_nodes = True
    dim = 0.012, 0.014, 0.02, 1
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = dim
    for x, size, power in ((-0.6, 0.4, 0.9), (0.7, 0.25, 0.35)):
        light = bpy.data.objects.new("Window", bpy.data.lights.new("Window", "AREA"))
        light.data.size, light.data.energy = size, power
        light.location = (x, -0.35, 0.35)
        light.rotation_euler = (0.9, 0, -0.9 if x < 0 else 0.9)
        scene.collection.objects.link(light)


def run(name: str, folder: Path) -> None:
    """Write NAME_warped.png, NAME_corrected.png and NAME_source.png."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    RIGS[name]()
    scene = bpy.context.scene
    pattern = star_pattern()
    picture = next(thing for thing in scene.objects if thing.kiriko.role == "PICTURE")
    image = bpy.data.images.new("Star", *pattern.shape[1::-1], float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.concatenate([pattern[::-1], np.ones((*pattern.shape[:2], 1), np.float32)], axis=2)
    image.pixels.foreach_set(rgba.ravel())
    picture.kiriko.image = image
    display = next(thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")
    display.kiriko.resolution = (2048, 2048)
    bpy.ops.kiriko.solve()
    reading = work.read(bpy.context)
    solution = run_steps(work.session().solve(reading.rig, work.settings_of(scene)))
    plain = run_steps(
        Session().solve(without_glass(reading.rig), Settings(only_through_glass=False))
    ).source
    light_the_glass()

    for what, source in (("warped", plain), ("corrected", solution.source)):
        seen = render_preview(
            scene, reading, source, size=(PIXELS, PIXELS), samples=SAMPLES, surroundings=True
        )
        image_io.write(folder / f"{name}_{what}.png", seen[..., :3], "PNG8", overwrite=True)

    small = solution.source.reshape(512, 4, 512, 4, 3).mean(axis=(1, 3))
    image_io.write(folder / f"{name}_source.png", small, "PNG8", overwrite=True)


def run_glare(folder: Path) -> None:
    """Write glare_seen.png and glare_suppressed.png: all
    that is seen of a vase, by Kiriko's own map.
    """
    pattern = np.concatenate([star_pattern(), np.ones((1024, 1024, 1), np.float32)], axis=2)
    mesh = replace(made("vase"), surface="automatic")
    a_rig = glass_rig(mesh, image=pattern, pixels=PIXELS)
    for what, weight in (("seen", 0.0), ("suppressed", 1.0)):
        solution = run_steps(Session().solve(a_rig, Settings(suppress_glare=weight)))
        image_io.write(
            folder / f"glare_{what}.png", solution.seen(beside=True), "PNG8", overwrite=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"))
    arguments = parser.parse_args()
    folder = arguments.out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name in RIGS:
        run(name, folder)
    run_glare(folder)
    kiriko.unregister()


if __name__ == "__main__":
    main()
