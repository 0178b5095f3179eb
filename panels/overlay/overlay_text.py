"""Labels and marks over the viewport: reasons for lost light, distances, ends of light paths."""

from collections.abc import Iterator

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader

from ...core.base.arrays import Floats
from ...core.base.messages import Message
from ...core.blender.data.units import length_of_unit, length_text
from ...operators.reporting import in_words
from ...operators.sketcher import SketchDrawing
from . import colours
from .label_layout import Sized, box_for, controls_of
from .pointer import parts_of, pointed_at
from .rig_shapes import Label, arrows_of, labels_of, marks_of

FONT = 0
CROSS_PX = 5  # half of a cross
DOT_PX = 3.5  # radius
ARROW_PX = 8, 2.5  # length of an arrowhead, and half its width
LEAST_PX = 40  # shorter dimension lines have no arrowheads
ROUND = np.stack(
    [f(np.linspace(0, 2 * np.pi, 16, endpoint=False)) for f in (np.cos, np.sin)], axis=1
)


def draw(context: bpy.types.Context, drawing: SketchDrawing, alpha: float) -> None:
    """Draw the marks of a drawing, then its labels."""
    scale = context.preferences.system.ui_scale
    arrows = [
        line
        for ends in arrows_of(drawing)
        if (line := _on_screen(context, ends)) is not None
        and np.linalg.norm(line[1] - line[0]) >= LEAST_PX * scale
    ]
    _fill(_arrowheads(arrows, scale), (*colours.DIMENSION, alpha))
    for has_arrived, colour in ((True, colours.ARRIVES), (False, colours.LOST)):
        ends = [m.place for m in marks_of(drawing) if m.has_arrived == has_arrived]
        places = [p for end in ends if (p := _on_screen(context, end[None])) is not None]
        shapes = [(_dot if has_arrived else _cross)(place[0], scale) for place in places]
        _fill(np.concatenate([np.empty((0, 3, 2)), *shapes]), (*colour, alpha))
    _draw_words(context, drawing, scale, alpha)


def _draw_words(
    context: bpy.types.Context, drawing: SketchDrawing, scale: float, alpha: float
) -> None:
    """Draw labels and part names without overlaps."""
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 5, *colours.SHADOW, 1.0)
    blf.shadow_offset(FONT, 0, 0)
    size = colours.TEXT_PX * scale
    blf.size(FONT, size)
    obstacles = controls_of(context)._replace(pictures=tuple(_picture_boxes(context, drawing)))
    taken: list[tuple[str, Floats]] = []

    for label in [*labels_of(drawing), *_names(context)]:
        place = _on_screen(context, label.place[None])
        if place is None:
            continue
        text = in_words(label.text)
        if label.length is not None:
            text = length_text(context.scene, length_now(context.scene, drawing, label.length))
        extent = np.array([blf.dimensions(FONT, text)[0], size])
        box = box_for(Sized(text, place[0], extent), taken, obstacles, scale)
        if box is None:
            continue
        taken.append((text, box))
        blf.color(FONT, *colours.lighter(label.colour), alpha)
        blf.position(FONT, *box[0], 0)
        blf.draw(FONT, text)
    blf.disable(FONT, blf.SHADOW)


def _picture_boxes(context: bpy.types.Context, drawing: SketchDrawing) -> Iterator[Floats]:
    """The bounding box (2, 2) px of the picture's outline."""
    lines = [line.points for line in drawing.sketch.lines if line.state == "picture"]
    if lines:
        ends = _on_screen(context, np.concatenate(lines) / drawing.metres)
        if ends is not None:
            yield np.stack([ends.min(axis=0), ends.max(axis=0)])


def _names(context: bpy.types.Context) -> Iterator[Label]:
    """Names of selected parts and of the part under the pointer, unless Blender shows them
    itself.
    """
    pointed = pointed_at(context.region)
    for thing in parts_of(context.scene):
        if (thing.select_get() or thing.name == pointed) and not thing.show_name:
            place = np.array(thing.matrix_world.translation)
            yield Label(place, Message("{reason}", reason=thing.name), None, colours.DIMENSION)


def length_now(scene: bpy.types.Scene, drawing: SketchDrawing, length: float) -> float:
    """A length of a drawing, m, in the scene's current unit, which may have changed since."""
    return length * length_of_unit(scene) / drawing.metres


def _on_screen(context: bpy.types.Context, places: Floats) -> Floats | None:
    """Positions (n, 2) px of points (n, 3) in the region; None if any is behind the view."""
    found = [
        location_3d_to_region_2d(context.region, context.region_data, place.tolist())
        for place in places
    ]
    return None if None in found else np.array(found, float)


def _arrowheads(lines: list[Floats], scale: float) -> Floats:
    """Triangles (2 n, 3, 2) at both ends of lines, px."""
    heads = []
    for start, end in lines:
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0]]) * ARROW_PX[1] * scale
        for tip, back in ((start, along), (end, -along)):
            base = tip + back * ARROW_PX[0] * scale
            heads.append([tip, base + across, base - across])
    return np.array(heads).reshape(-1, 3, 2)


def _dot(place: Floats, scale: float) -> Floats:
    """Triangles (n, 3, 2) of a disc, px."""
    rim = place + DOT_PX * scale * ROUND
    return np.stack([np.broadcast_to(place, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)


def _cross(place: Floats, scale: float) -> Floats:
    """Triangles (4, 3, 2) of two crossing bars, px."""
    bars = []
    for x, y in ((1.0, 1.0), (1.0, -1.0)):
        along = np.array([x, y]) * CROSS_PX * scale
        across = np.array([-y, x]) * scale
        a, b, c, d = (
            place + corner
            for corner in (-along - across, along - across, along + across, -along + across)
        )
        bars += [[a, b, c], [a, c, d]]
    return np.array(bars)


def _fill(triangles: Floats, colour: tuple[float, ...]) -> None:
    """Fill triangles (n, 3, 2), px, in a colour with its alpha."""
    if not len(triangles):
        return
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = np.pad(triangles.reshape(-1, 2), ((0, 0), (0, 1))).tolist()
    batch = batch_for_shader(shader, "TRIS", {"pos": corners})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("color", colour)
    batch.draw(shader)
    gpu.state.blend_set("NONE")
