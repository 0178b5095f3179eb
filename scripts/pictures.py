"""The pictures of README and docs, rendered in Cycles: the gallery, the manual's first picture, the
listing's featured image, a glass ball with a pattern, warped and corrected, and the systems of
Add Rig > More. Started by `dev.py pictures`.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from demo import RIGS
from gallery import benches
from gallery.exhibits import EXHIBITS
from gallery.show import render
from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.systems import SYSTEMS
from kiriko.core.blender.preview.cycles_preview import render_preview
from kiriko.core.files import image_io
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import without_glass
from kiriko.operators import work

PIXELS, SAMPLES = 480, 128  # of a picture of the ball
GALLERY, GALLERY_SAMPLES = (640, 480), 40  # and the denoiser
HERO, HERO_SIZE = "goblet", (1200, 675)  # the gallery has its middle
FEATURED_SIZE = 1920, 1080  # as the extension site wants it
GALLERY_BYTES, HERO_BYTES, FEATURED_BYTES = 60_000, 120_000, 200_000
# text, size and upper left corner, px: left of the goblet
TITLE = ("Kiriko", 150, (110, 500)), ("Pictures inside glass,\nundistorted", 46, (116, 690))
CREAM = 255, 238, 214
SYSTEM_SIDE, SYSTEM_BYTES, GAP = 360, 30_000, 6  # px, bytes, px between its two pictures
SHOULDER = 0.6  # brighter light is compressed


def star_pattern(size: int = 1024) -> Floats:
    """Lines of cut glass (size, size, 3), linear: a triangular grid and its altitudes, in a square
    frame.
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
    """A dim room and a window on the left, to make the glass itself visible."""
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


def run_ball(folder: Path) -> None:
    """Write ball_warped.png, ball_corrected.png and ball_source.png."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    RIGS["ball"]()
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

    for name, source in (("warped", plain), ("corrected", solution.source)):
        seen = render_preview(
            scene, reading, source, size=(PIXELS, PIXELS), samples=SAMPLES, surroundings=True
        )
        image_io.write(folder / f"ball_{name}.png", seen[..., :3], "PNG8", overwrite=True)

    small = solution.source.reshape(512, 4, 512, 4, 3).mean(axis=(1, 3))
    image_io.write(folder / "ball_source.png", small, "PNG8", overwrite=True)


def developed(light: Floats) -> Image.Image:
    """Linear light (h, w, 3) as sRGB, with a soft shoulder in the highlights."""
    light = np.maximum(light, 0.0)
    room = 1 - SHOULDER
    soft = SHOULDER + room * np.tanh((light - SHOULDER) / room)
    light = np.where(light < SHOULDER, light, soft)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return Image.fromarray((255 * np.clip(encoded, 0, 1) + 0.5).astype(np.uint8))


def pack(image: Image.Image, path: Path, most: int) -> None:
    """Write a WebP in the best quality below a number of bytes."""
    for quality in range(92, 40, -4):
        image.save(path, quality=quality, method=6)
        if path.stat().st_size < most:
            break
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB, quality {quality}", flush=True)


def run_gallery(folder: Path, name: str, samples: int) -> None:
    """Write gallery/NAME.webp."""
    (folder / "gallery").mkdir(exist_ok=True)
    if name == HERO:
        image = run_hero(folder, samples)
    else:
        image = developed(render(EXHIBITS[name], GALLERY, samples))
    pack(image, folder / "gallery" / f"{name}.webp", GALLERY_BYTES)


def run_hero(folder: Path, samples: int) -> Image.Image:
    """Write hero.webp and the listing's featured.webp; the middle in the size of the gallery."""
    exhibit = EXHIBITS[HERO]
    width, height = FEATURED_SIZE
    middle = height * GALLERY[0] / GALLERY[1]
    look = exhibit.look._replace(width=exhibit.look.width * width / middle)
    image = developed(render(replace(exhibit, look=look), FEATURED_SIZE, samples))
    pack(image.resize(HERO_SIZE, Image.Resampling.LANCZOS), folder / "hero.webp", HERO_BYTES)
    listing = folder.parent / "listing"
    listing.mkdir(exist_ok=True)
    pack(titled(image), listing / "featured.webp", FEATURED_BYTES)
    left = (width - middle) / 2
    box = left, 0, left + middle, height
    return image.resize(GALLERY, Image.Resampling.LANCZOS, box)


def titled(image: Image.Image) -> Image.Image:
    """A copy with the extension's name."""
    image = image.copy()
    canvas = ImageDraw.Draw(image)
    for text, size, place in TITLE:
        font = ImageFont.load_default(size)
        canvas.text(place, text, CREAM, font, spacing=0.3 * size)
    return image


def run_system(folder: Path, kind: str, samples: int) -> None:
    """Write systems/KIND.webp: a system from outside, and as its viewer sees it."""
    both = Image.new("RGB", (2 * SYSTEM_SIDE + GAP, SYSTEM_SIDE), "white")
    for k, light in enumerate(benches.render(kind, SYSTEM_SIDE, samples)):
        both.paste(developed(light), (k * (SYSTEM_SIDE + GAP), 0))
    (folder / "systems").mkdir(exist_ok=True)
    pack(both, folder / "systems" / f"{kind.lower()}.webp", SYSTEM_BYTES)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"), metavar="FOLDER")
    parser.add_argument(
        "--samples",
        type=int,
        default=GALLERY_SAMPLES,
        metavar="N",
        help="of a pixel of the gallery",
    )
    which = [*EXHIBITS, "ball", *SYSTEMS]
    parser.add_argument(
        "--only",
        nargs="+",
        choices=which,
        default=which,
        metavar="NAME",
        help=f"{', '.join(which)}",
    )
    arguments = parser.parse_args()
    folder = arguments.out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name in EXHIBITS:
        if name in arguments.only:
            run_gallery(folder, name, arguments.samples)
    if "ball" in arguments.only:
        run_ball(folder)
    for kind in SYSTEMS:
        if kind in arguments.only:
            run_system(folder, kind, arguments.samples)


if __name__ == "__main__":
    main()
