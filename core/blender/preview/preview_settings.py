"""Cycles settings for a preview: complete light paths with unchanged colours."""

from dataclasses import dataclass
from pathlib import Path

import bpy

from ...base.errors import RigError
from ...base.messages import Message
from ..data.camera_viewer import frame_of, viewer_of


@dataclass(frozen=True)
class Options:
    """Render options of a preview.

    Parameters
    ----------
    size : width and height of the whole frame in pixels; None for the viewer's
    percentage : of this size
    border : left, right, bottom, top of the part to render, 0..1 of the frame; None for all of it
    samples : per pixel
    fresnel : glass splits light as real glass does (noise); else it refracts or totally reflects
        all of it
    surroundings : include the world and objects without a role
    filter_width : None for the mean over each pixel's square; else pixels, of a Blackman-Harris
        filter
    """

    size: tuple[int, int] | None = None
    percentage: int = 100
    border: tuple[float, float, float, float] | None = None
    samples: int = 16
    fresnel: bool = True
    surroundings: bool = False
    filter_width: float | None = None


BOUNCES = 128  # Cycles' own limit is 1024; longer paths count as lost in the glass


def set_render(made: bpy.types.Scene, scene: bpy.types.Scene, options: Options, path: Path) -> None:
    """Have a temporary scene render the viewer's frame of the user's scene to a file."""
    render = made.render
    frame = frame_of(viewer_of(scene), scene.render)
    _use_cycles(render)

    render.resolution_x, render.resolution_y = options.size or (frame.width, frame.height)
    whole = 100 if options.size else frame.percentage
    render.resolution_percentage = max(1, whole * options.percentage // 100)
    render.pixel_aspect_x, render.pixel_aspect_y = frame.aspect_x, frame.aspect_y

    if options.border is not None:
        render.use_border = render.use_crop_to_border = True
        left, right, bottom, top = options.border
        render.border_min_x, render.border_max_x = left, right
        render.border_min_y, render.border_max_y = bottom, top

    render.use_compositing = render.use_sequencer = False
    render.use_motion_blur = False
    render.film_transparent = False
    render.use_simplify, render.use_persistent_data = False, False

    render.filepath = str(path)
    render.use_file_extension = False
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGBA", "32"
    render.image_settings.exr_codec = "ZIP"
    transforms = made.view_settings.bl_rna.properties["view_transform"].enum_items
    if "Standard" in {item.identifier for item in transforms}:
        made.view_settings.view_transform = "Standard"

    made.frame_current = scene.frame_current
    made.frame_subframe = scene.frame_subframe


def _use_cycles(render: bpy.types.RenderSettings) -> None:
    try:
        render.engine = "CYCLES"
    except TypeError:
        raise RigError(
            "{reason}.", reason=Message("Enable the add-on Cycles Render Engine")
        ) from None


def set_cycles(made: bpy.types.Scene, scene: bpy.types.Scene, options: Options) -> None:
    """Let every path reach the display, without clamping, guiding or blurring its colour."""
    cycles = made.cycles
    cycles.device = scene.cycles.device
    cycles.samples = options.samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.time_limit = 0.0

    for name in ("max", "diffuse", "glossy", "transmission"):
        setattr(cycles, f"{name}_bounces", BOUNCES)

    cycles.diffuse_bounces = 4
    cycles.transparent_max_bounces = BOUNCES  # a Ray Portal counts as a transparent bounce

    # no Russian roulette
    cycles.min_light_bounces = cycles.min_transparent_bounces = BOUNCES

    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.film_exposure = 1.0

    if options.filter_width is None:
        cycles.pixel_filter_type = "BOX"
    else:
        cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        cycles.filter_width = options.filter_width
