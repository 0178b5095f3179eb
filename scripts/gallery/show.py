"""Builds, solves and renders an exhibit of the gallery."""

from __future__ import annotations

import bpy

from gallery.exhibits import Exhibit
from gallery.room import aim, furnish
from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import run_steps
from kiriko.core.blender.data.image import image_from_pixels
from kiriko.core.blender.preview.cycles_preview import Preview
from kiriko.operators import work

FINE = 2  # viewer pixels of the solve for a pixel of the render
STRAIGHT = 0.6  # share of the light through a plate without a reflection
BOUNCES = 32
BRIGHTEST = 6.0  # of a path: brighter ones would be speckles


def part(role: str) -> bpy.types.Object:
    """The part of a role."""
    return next(thing for thing in bpy.context.scene.objects if thing.kiriko.role == role)


def build(exhibit: Exhibit, size: tuple[int, int]) -> None:
    """Make the glass, its rig and the room in a new scene, for a render of this size."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assemble(exhibit, (FINE * size[0], FINE * size[1]))
    exhibit.furnish()
    furnish(exhibit.look, exhibit.back)


def assemble(exhibit: Exhibit, size: tuple[int, int]) -> None:
    """Make the glass and its rig, whose viewer has this size."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    glass = exhibit.glass()
    glass.select_set(True)
    bpy.context.view_layer.objects.active = glass
    bpy.ops.kiriko.add_rig(viewer_resolution=0, **exhibit.rig)

    picture = part("PICTURE")
    picture.kiriko.image = image_from_pixels("Picture", exhibit.drawing())
    picture.location = exhibit.at
    bpy.context.view_layer.update()
    picture.dimensions = (*exhibit.size, 0.0)
    aim(scene.kiriko.viewer, exhibit.look)
    scene.kiriko.suppress_glare = 0.0 if exhibit.has_glare else 1.0
    bpy.context.view_layer.update()
    if exhibit.is_fitted:
        bpy.ops.kiriko.fit_display(move=True)


def pass_straight(share: float) -> None:
    """Have the plate of a preview also pass a share of the light behind it, as real plates do."""
    for material in bpy.data.materials:
        if not material.name.startswith("Kiriko Preview Plate"):
            continue
        tree = material.node_tree
        output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        image = output.inputs["Surface"].links[0].from_socket
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        clear.inputs["Color"].default_value = (share, share, share, 1.0)
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(image, both.inputs[0])
        tree.links.new(clear.outputs["BSDF"], both.inputs[1])
        tree.links.new(both.outputs["Shader"], output.inputs["Surface"])


def denoise(scene: bpy.types.Scene) -> None:
    """Let a preview trade exact light for little noise."""
    cycles = scene.cycles
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.sample_clamp_indirect = BRIGHTEST
    cycles.max_bounces = cycles.transmission_bounces = cycles.transparent_max_bounces = BOUNCES
    cycles.glossy_bounces = BOUNCES // 2
    cycles.min_light_bounces = 0
    cycles.use_adaptive_sampling, cycles.adaptive_threshold = True, 0.02


def render(exhibit: Exhibit, size: tuple[int, int], samples: int) -> Floats:
    """The room as the viewer sees it (h, w, 3), linear Rec.709."""
    build(exhibit, size)
    scene = bpy.context.scene
    reading = work.read(bpy.context)
    solution = run_steps(work.session().solve(reading.rig, work.settings_of(scene)))
    image = image_from_pixels("Source", solution.source * exhibit.light)
    with Preview(scene, reading, image, size=size, samples=samples, surroundings=True) as preview:
        pass_straight(STRAIGHT)
        denoise(preview.scene)
        return preview.render()[..., :3]
