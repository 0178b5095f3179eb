"""Lines in the scene, drawn in front of everything."""

import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...operators.sketcher import SketchDrawing
from . import colours
from .batches import made_once
from .rig_shapes import Strokes, contour_strokes, strokes_of

SHADER = "POLYLINE_UNIFORM_COLOR"


def draw(context: bpy.types.Context, drawing: SketchDrawing, alpha: float) -> None:
    """Draw the lines of a drawing, each over a shadow."""
    _draw_batches(context, made_once(drawing, "lines", _batches_of), alpha)


def draw_contours(context: bpy.types.Context, drawing: SketchDrawing, alpha: float) -> None:
    """Draw the outline of the glass, which may have the colour of its background."""
    _draw_batches(context, made_once(drawing, "contours", _batches_of_contours), alpha)


def _draw_batches(
    context: bpy.types.Context, batches: list[tuple[Strokes, object]], alpha: float
) -> None:
    """Draw strokes with their batches."""
    shader = gpu.shader.from_builtin(SHADER)
    scale = context.preferences.system.ui_scale
    region = context.region

    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("NONE")
    shader.bind()
    shader.uniform_float("viewportSize", (region.width, region.height))
    for strokes, batch in batches:
        if strokes.width >= colours.OUTLINE_PX:
            shader.uniform_float("lineWidth", (strokes.width + colours.SHADOW_PX) * scale)
            shader.uniform_float(
                "color", (*colours.SHADOW, colours.SHADOW_ALPHA * strokes.alpha * alpha)
            )
            batch.draw(shader)

        shader.uniform_float("lineWidth", strokes.width * scale)
        shader.uniform_float("color", (*strokes.colour, strokes.alpha * alpha))
        batch.draw(shader)
    gpu.state.blend_set("NONE")


def _batches_of(drawing: SketchDrawing) -> list[tuple[Strokes, object]]:
    """The strokes of a drawing, each with its batch."""
    return _with_batches(strokes_of(drawing))


def _batches_of_contours(drawing: SketchDrawing) -> list[tuple[Strokes, object]]:
    """The strokes of the glass's outline, each with its batch."""
    return _with_batches(contour_strokes(drawing))


def _with_batches(found: list[Strokes]) -> list[tuple[Strokes, object]]:
    shader = gpu.shader.from_builtin(SHADER)
    return [
        (
            strokes,
            batch_for_shader(shader, "LINES", {"pos": strokes.ends.reshape(-1, 3).tolist()}),
        )
        for strokes in found
    ]
