"""Makes assets/: the plate's materials as an asset library, each with a render of a mid-air image
as its preview.

Runs in the oldest supported Blender, whose files all later ones open:
`PYTHONPATH=.dev/link .dev/bpy-4.2.23/bin/python scripts/make_assets.py`
"""

from __future__ import annotations

import sys
import tempfile
import tomllib
import uuid
from pathlib import Path

import bpy
import numpy as np

from kiriko.core.bench.placement import place
from kiriko.core.blender.data.image import image_from_pixels, pixels_from_image
from kiriko.core.blender.data.made_objects import Workbench
from kiriko.core.blender.materials import shaders
from kiriko.core.blender.materials.plate_material import be_mirror_array
from kiriko.core.rig.rig import MirrorArray

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "assets"
CATALOGUE = "Kiriko"
CATALOGUE_ID = str(uuid.uuid5(uuid.NAMESPACE_URL, "kiriko/plates"))  # the same each time
# of the materials' previews
PIXELS = 128
SAMPLES = 256
FIELD = 0.34  # m

MATERIALS = {
    "Kiriko Plate": (
        MirrorArray(),
        "Micro-mirror array plate of two crossed layers, as ASKA3D-488: forms a mid-air image,"
        " with its stray light",
        ("MMAP", "ASKA3D"),
    ),
    "Kiriko Plate DCRA": (
        MirrorArray("holes", pitch=0.1e-3, height=0.25e-3),
        "Dihedral corner reflector array, square holes in one layer: forms a mid-air image, with"
        " its stray light",
        ("DCRA",),
    ),
    "Kiriko Plate Radial": (
        MirrorArray("radial", pitch=0.1e-3, height=0.25e-3),
        "Dihedral corner reflectors turned round the object's origin: an image that is seen from"
        " all sides",
        ("DCRA", "radial"),
    ),
}


def emblem(size: int = 256) -> np.ndarray:
    """The display's image (size, size, 3), linear: a ring and four corners of different colours on
    black.
    """
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    light = np.zeros((size, size, 3))
    radius = np.hypot(x, y)
    turn = np.arctan2(y, x)
    hue = 0.5 + 0.5 * np.cos(turn[..., None] - 2 * np.pi / 3 * np.arange(3))
    light += ((radius > 0.5) & (radius < 0.75))[..., None] * hue
    light += (radius < 0.2)[..., None] * np.array([1.0, 0.9, 0.6])
    corner = (np.abs(x) > 0.78) & (np.abs(y) > 0.78)
    red, blue = (np.where(a < 0, 0.9, 0.1)[corner, None] for a in (x, y))
    light[corner] = red * [1, 0, 0] + blue * [0, 0, 1]
    return light.astype(np.float32)


def stage(material: bpy.types.Material) -> bpy.types.Scene:
    """A display below a plate at 45 degrees, in the material, and a camera 1 m in front of the
    mid-air image.
    """
    scene = bpy.data.scenes.new("Stage")
    bench = Workbench(scene, "Stage")
    at = place((0.0, 0.0, 0.0), 0.15, np.pi / 4, 1.0)
    plate = bench.rectangle("Plate", at.plate, 0.488, 0.488)
    plate.data.materials.append(material)
    display = bench.rectangle("Display", at.display, 0.1, 0.1)
    image = bench.keep(image_from_pixels("Emblem", emblem()))
    display.data.materials.append(bench.material("Display", lambda m: shaders.show_image(m, image)))
    scene.camera = bench.camera("Camera", at.viewer, 1.0, FIELD)
    scene.world = bench.keep(bpy.data.worlds.new("Dim"))
    scene.world.color = (0.01, 0.01, 0.012)
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x = PIXELS
    render.resolution_y = PIXELS
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, False
    scene.view_settings.view_transform = "Standard"

    return scene


def rendered(scene: bpy.types.Scene) -> np.ndarray:
    """The scene's picture (h, w, 4), encoded 0..1, row 0 at the top."""
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.png")
        scene.render.image_settings.color_mode = "RGB"
        bpy.ops.render.render(scene=scene.name, write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = pixels_from_image(image)
        bpy.data.images.remove(image)
    return pixels


def asset(name: str) -> bpy.types.Material:
    """One of the materials, marked as an asset, with its picture."""
    array, description, tags = MATERIALS[name]
    material = bpy.data.materials.new(name)
    be_mirror_array(material, array)
    material["kiriko_plate"] = array.layout  # so Add > Kiriko > Plate Material finds it
    material.asset_mark()
    material.asset_data.description = f"{description}. For a flat mesh, in Cycles"
    material.asset_data.author = "Kiriko developers"
    material.asset_data.license = "CC0-1.0"
    material.asset_data.catalog_id = CATALOGUE_ID
    for tag in ("Kiriko", "mid-air image", *tags):
        material.asset_data.tags.new(tag)
    picture = rendered(stage(material))
    preview = material.preview_ensure()
    preview.image_size = PIXELS, PIXELS
    preview.image_pixels_float.foreach_set(picture[::-1].ravel())

    return material


def main() -> None:
    oldest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))[
        "blender_version_min"
    ]
    if not bpy.app.version_string.startswith(oldest.rpartition(".")[0]):
        sys.exit(
            f"Assets are saved by Blender {oldest}, the oldest that has to open them; this is"
            f" {bpy.app.version_string}."
        )

    bpy.ops.wm.read_factory_settings(use_empty=True)
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / "kiriko_plate.blend"
    bpy.data.libraries.write(
        str(path), {asset(name) for name in MATERIALS}, fake_user=True, compress=True
    )
    catalogue = f"VERSION 1\n\n{CATALOGUE_ID}:{CATALOGUE}:{CATALOGUE}\n"
    (FOLDER / "blender_assets.cats.txt").write_text(catalogue, encoding="utf-8")
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
