"""Glass as artists bring it, made by script for benches, as Blender evaluates it; random ones are in fuzz_shapes.py."""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import numpy as np
from fuzz_shapes import fitting, linked, mesh_of, shaken, smooth, turned
from mathutils import Matrix

from kiriko.core.blender_mesh import read_mesh
from kiriko.core.rig import Mesh

SIZE = 0.05  # m

WINE_GLASS = [
    (0.0, 0.0), (0.02, 0.0), (0.034, 0.002), (0.030, 0.004), (0.008, 0.010), (0.004, 0.03), (0.004, 0.07),
    (0.008, 0.09), (0.025, 0.105), (0.036, 0.13), (0.038, 0.15), (0.034, 0.18), (0.032, 0.20),
]  # fmt: skip
VASE = [(0.012, 0.0), (0.018, 0.012), (0.013, 0.028), (0.010, 0.040), (0.014, 0.050)]


def add(thing: bpy.types.Object, kind: str, **options: object) -> None:
    """A modifier with options."""
    modifier = thing.modifiers.new(kind.title(), kind)
    for name, value in options.items():
        setattr(modifier, name, value)


def wine_glass(levels: int = 2) -> bpy.types.Object:
    """Screw 32, Solidify 2 mm, Subdivision."""
    thing = turned(WINE_GLASS, 32)
    add(thing, "SOLIDIFY", thickness=0.002)
    add(thing, "SUBSURF", levels=levels, quality=6)
    return thing


def vase() -> bpy.types.Object:
    """Screw 32 and Solidify, without subdivision: 40 degrees and more from face to face."""
    thing = turned(VASE, 32)
    add(thing, "SOLIDIFY", thickness=0.002)
    return thing


def suzanne() -> bpy.types.Object:
    """The monkey's head, subdivided once."""
    bpy.ops.mesh.primitive_monkey_add()
    thing = bpy.context.object
    smooth(thing.data)
    add(thing, "SUBSURF", levels=1)
    return thing


def displaced() -> bpy.types.Object:
    """A ball with clouds on it."""
    thing = linked(smooth(mesh_of("icosphere", subdivisions=5, radius=0.5)), "Displaced")
    texture = bpy.data.textures.new("Clouds", "CLOUDS")
    texture.noise_scale = 0.5
    add(thing, "DISPLACE", texture=texture, strength=0.1)
    return thing


def scan() -> bpy.types.Object:
    """A noisy ball thinned out to 5 000 triangles, as a scanner sees it."""
    mesh = mesh_of("icosphere", subdivisions=6, radius=0.5)
    thing = linked(smooth(shaken(mesh, 2e-4, np.random.default_rng(1))), "Scan")
    add(thing, "DECIMATE", ratio=5000 / len(mesh.polygons))
    return thing


def remeshed_text() -> bpy.types.Object:
    """A text rebuilt of voxels, shaded smooth."""
    data = bpy.data.curves.new("Text", "FONT")
    data.body, data.extrude = "Ki", 0.15
    data.transform(Matrix.Rotation(math.pi / 2, 4, "X"))
    thing = linked(data, "Text")
    add(thing, "REMESH", mode="VOXEL", voxel_size=0.03, use_smooth_shade=True)
    return thing


GLASSES: dict[str, Callable[[], bpy.types.Object]] = {
    "ball": lambda: linked(smooth(mesh_of("icosphere", subdivisions=6, radius=0.5)), "Ball"),
    "wine glass": wine_glass,
    "vase": vase,
    "Suzanne": suzanne,
    "displaced ball": displaced,
    "scan": scan,
    "text, remeshed": remeshed_text,
}
BOWLS = {"wine glass": 0.14}  # m, the height that is looked at; others are looked at in their middle, SIZE across


def made(name: str) -> Mesh:
    """The mesh of a glass in the world, as it is evaluated; normals are those that Blender shows."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = GLASSES[name]()
    place = Matrix.Translation((0, 0, -BOWLS[name])) if name in BOWLS else Matrix.Scale(SIZE, 4) @ fitting(thing)
    bpy.context.view_layer.update()
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh, _ = read_mesh(evaluated.to_mesh(), np.array(place), has_normals=True)
    evaluated.to_mesh_clear()
    return mesh
