"""Draws visible range and eye box over 3D views: translucent, coloured, with legends."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..core.base.arrays import Floats
from ..core.base.messages import Message
from ..core.base.words import arcmin, percent
from ..core.blender.data.made_objects import values_of
from ..core.blender.result.conflict import viridis
from ..operators import outdated_surfaces as surfaces
from ..operators import watch
from ..operators.eye_box import DISPLACEMENT
from ..operators.outdated_surfaces import EYE_BOX, RANGE
from ..operators.reporting import in_words
from .overlay.view_handlers import ViewHandlers

ALPHA = 0.45
LETTERS = 11.0  # px at a scale of 1
BAR = (160.0, 10.0)  # px at a scale of 1: length and height of the legend
CORNER = (
    80.0,
    100.0,
)  # px at a scale of 1, from the lower left, above Blender's Adjust Last Operation


class DrawnSurface(NamedTuple):
    """A drawn surface: its name, the quantity of its colours, the heading of its legend, and the
    function that writes a value there.
    """

    name: str
    quantity: str
    heading: Message
    text: Callable[[float], str]


SURFACES = (
    DrawnSurface(
        RANGE,
        "brightness",
        Message("Visible range: brightness"),
        percent,
    ),
    DrawnSurface(
        EYE_BOX,
        DISPLACEMENT,
        Message("Eye box: the picture is off by"),
        arcmin,
    ),
)
STEP = 50.0  # px at a scale of 1, from one legend to the next

# by name: session uid of the mesh, batch, largest value
_batches: dict[str, tuple[int, Any, float]] = {}


def shown(context: bpy.types.Context) -> Iterator[tuple[DrawnSurface, bpy.types.Object]]:
    """The surfaces of the scene visible in this view."""
    for surface in SURFACES:
        thing = surfaces.looked_up(context.scene, surface.name)
        if (
            thing is not None
            and context.space_data.overlay.show_overlays
            and thing.visible_get(viewport=context.space_data)
        ):
            yield surface, thing


def draw() -> None:
    """Draw the surfaces. Blender calls it for every 3D view."""
    for surface, thing in shown(bpy.context):
        batch, _ = _batch(surface, thing.data)
        before = gpu.state.blend_get(), gpu.state.depth_test_get()
        try:
            gpu.state.blend_set("ALPHA")
            gpu.state.depth_test_set("LESS_EQUAL")
            with gpu.matrix.push_pop():
                gpu.matrix.multiply_matrix(thing.matrix_world)
                batch.draw(gpu.shader.from_builtin("SMOOTH_COLOR"))
        finally:
            gpu.state.blend_set(before[0])
            gpu.state.depth_test_set(before[1])


def draw_legend() -> None:
    """Draw the legends. Blender calls it for every 3D view."""
    context = bpy.context
    scale = context.preferences.system.ui_scale
    for n, (surface, thing) in enumerate(shown(context)):
        _, most = _batch(surface, thing.data)
        corner = CORNER[0], CORNER[1] + n * STEP
        (x, y), (length, height) = (scale * np.array(pair) for pair in (corner, BAR))
        steps = np.linspace(0.0, 1.0, 17)
        points = [(x + length * s, y + h, 0.0) for s in steps for h in (0.0, height)]
        colours = _with_alpha(np.repeat(viridis(steps), 2, axis=0), 1.0)
        shader = gpu.shader.from_builtin("SMOOTH_COLOR")
        content = {"pos": points, "color": colours}
        batch_for_shader(shader, "TRI_STRIP", content).draw(shader)

        blf.size(0, LETTERS * scale)
        blf.color(0, 1.0, 1.0, 1.0, 0.9)
        for at, text in (
            ((x, y - 1.3 * LETTERS * scale), surface.text(0.0)),
            ((x + length, y - 1.3 * LETTERS * scale), surface.text(most)),
            ((x, y + height + 0.4 * LETTERS * scale), heading_of(context.scene, surface)),
        ):
            blf.position(0, *at, 0.0)
            blf.draw(0, in_words(text))


def heading_of(scene: bpy.types.Scene, surface: DrawnSurface) -> Message:
    """The heading of a surface's legend."""
    if watch.is_reported_outdated(scene, surface.name):
        return Message("{heading} (outdated)", heading=surface.heading)
    return surface.heading


def _with_alpha(colours: Floats, alpha: float) -> NDArray[np.float32]:
    """Colours (n, 3) with an alpha, (n, 4) float32: a graphics card reads other types bytewise."""
    return np.column_stack([colours, np.full(len(colours), alpha)]).astype(np.float32)


def _batch(surface: DrawnSurface, mesh: bpy.types.Mesh) -> tuple[Any, float]:
    """The mesh as a batch, in the colours of its values, and the largest value."""
    uid, *cached = _batches.get(surface.name, (0,))
    if uid == mesh.session_uid:
        return tuple(cached)

    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    values = values_of(mesh, surface.quantity)
    most = float(values.max(initial=0.0))
    colours = _with_alpha(viridis(values / max(most, 1e-30)), ALPHA)
    batch = batch_for_shader(
        gpu.shader.from_builtin("SMOOTH_COLOR"),
        "TRIS",
        {"pos": points.reshape(-1, 3), "color": colours},
        indices=triangles.reshape(-1, 3),
    )
    _batches[surface.name] = mesh.session_uid, batch, most
    return batch, most


_handlers = ViewHandlers(POST_VIEW=draw, POST_PIXEL=draw_legend)


def register() -> None:
    """Add the draw handlers."""
    _handlers.begin()


def unregister() -> None:
    """Remove the draw handlers."""
    _handlers.end()
    _batches.clear()
    surfaces.forget()
