"""Renders a system of Add Rig > More twice: from outside, with its light paths, and as its viewer
sees it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from gallery.show import denoise
from kiriko.core.base.arrays import Floats
from kiriko.core.base.vectors import normalise
from kiriko.core.blender.data.image import pixels_from_image
from kiriko.core.blender.preview.cycles_preview import Preview
from kiriko.core.blender.view.viewport_look import COLOURS, GLASS, PLATE
from kiriko.core.rig.rig import Rig
from kiriko.operators import work
from kiriko.operators.framing import corners

PATHS = 16
THICK = 5.0  # times a curve's own radius
FROM = 1.0, -0.7, 0.5  # direction to the camera outside
FROM_ELSEWHERE = {"CURVED_WALL": (0.3, -0.6, 1.0), "LED_CORNER": (0.25, -1.0, 0.25)}
FAR_PICTURE = {"EYEPIECE"}  # outside the frame
MARGIN = 1.1
MORE = 6  # times as many samples for the viewer's image, where light splits
FILLED = 0.75  # of the viewer's image by the picture
PALE = 0.9  # light of the surroundings
DARK = 0.5  # of the viewport's colours, in these surroundings


def render(kind: str, side: int, samples: int) -> tuple[Floats, Floats]:
    """Images (side, side, 3), linear Rec.709: from outside, and by the viewer."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kiriko.add_rig(kind=kind)
    scene = bpy.context.scene
    bpy.ops.kiriko.solve()
    reading = work.read(bpy.context)
    border, times = border_of(reading.rig)
    options = {"size": (round(times * side),) * 2, "border": border, "samples": MORE * samples}
    with Preview(scene, reading, scene.kiriko.result.source, **options) as preview:
        denoise(preview.scene)
        seen = preview.render()[..., :3]
    seen = seen / max(float(np.quantile(seen.max(axis=2), 0.97)), 1e-3)  # half mirrors are dim
    bpy.ops.kiriko.draw_light_paths(count=PATHS)
    be_shown(scene)
    look_from_outside(kind, scene)
    return rendered(scene, side, samples), seen


def border_of(rig: Rig) -> tuple[tuple[float, float, float, float], float]:
    """The square around the picture in the viewer's image, 0..1: left, right, bottom, top; and how
    many times it fits into the image.
    """
    eye = rig.viewer
    place = eye.project(rig.picture_place.mesh.vertices) / (eye.width, eye.height)
    place = np.stack([place[:, 0], 1 - place[:, 1]], axis=1)
    low, high = place.min(axis=0), place.max(axis=0)
    half = min(float((high - low).max()) / 2 / FILLED, 0.5)
    x, y = np.clip((low + high) / 2, half, 1 - half)
    return (x - half, x + half, y - half, y + half), 0.5 / half


def be_shown(scene: bpy.types.Scene) -> None:
    """Give parts the colours of the viewport, and the scene pale surroundings."""
    for thing in scene.objects:
        role = thing.kiriko.role
        if role == "PICTURE":
            thing.visible_camera = True
        elif thing.type == "CURVE":
            thing.data.bevel_depth *= THICK
        elif role in COLOURS or role in {"GLASS", "PLATE"}:
            colour = {"GLASS": (0.7, 0.85, 1.0, GLASS), "PLATE": PLATE, **COLOURS}[role]
            be_pale(thing.material_slots[0].material, colour)
    world = scene.world = bpy.data.worlds.new("Pale")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (PALE, PALE, PALE, 1)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 1.0, (0.5, 0.4, 0.0)
    scene.collection.objects.link(sun)


def be_pale(material: bpy.types.Material, colour: tuple[float, float, float, float]) -> None:
    """Turn a material into a diffuse colour, see-through below an alpha of 1."""
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    mix = tree.nodes.new("ShaderNodeMixShader")
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    matt = tree.nodes.new("ShaderNodeBsdfDiffuse")
    mix.inputs[0].default_value = colour[3]
    matt.inputs["Color"].default_value = (*(DARK * c for c in colour[:3]), 1.0)
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(matt.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


def look_from_outside(kind: str, scene: bpy.types.Scene) -> None:
    """Make a camera that sees all parts the scene's."""
    away = {"PICTURE"} if kind in FAR_PICTURE else set()
    parts = [o for o in scene.objects if o.type == "MESH" and o.kiriko.role not in away]
    points = np.concatenate([corners(part) for part in parts])
    back = normalise(np.array(FROM_ELSEWHERE.get(kind, FROM)))
    right = normalise(np.cross([0.0, 0.0, 1.0], back))
    axes = np.stack([right, np.cross(back, right), back])
    low, high = (f(points @ axes.T, axis=0) for f in (np.min, np.max))
    size = float((high - low).max())
    camera = bpy.data.cameras.new("Outside")
    camera.type, camera.ortho_scale = "ORTHO", MARGIN * float((high - low)[:2].max())
    camera.clip_start, camera.clip_end = 0.01 * size, 100 * size
    matrix = np.eye(4)
    matrix[:3, :3] = axes.T
    matrix[:3, 3] = ((low + high) / 2) @ axes + 20 * size * back
    scene.camera = bpy.data.objects.new("Outside", camera)
    scene.camera.matrix_world = Matrix(matrix.tolist())
    scene.collection.objects.link(scene.camera)


def rendered(scene: bpy.types.Scene, side: int, samples: int) -> Floats:
    """A render (side, side, 3) of the scene, linear."""
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = samples, True
    scene.cycles.transparent_max_bounces = 64
    render.resolution_x = render.resolution_y = side
    render.resolution_percentage = 100
    with tempfile.TemporaryDirectory() as folder:
        render.filepath = str(Path(folder) / "outside.exr")
        render.image_settings.file_format = "OPEN_EXR"
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath)
        return pixels_from_image(image)[..., :3]
