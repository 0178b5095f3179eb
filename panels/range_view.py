"""Draws the visible range over 3D views: translucent, coloured by brightness, with a legend."""

from time import perf_counter
from typing import Any

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..core.arrays import Floats
from ..core.blender.objects import brightness_of, grid_of
from ..core.blender.viridis import viridis
from ..core.messages import Message
from ..core.words import percent
from ..operators.telling import in_words
from ..operators.visible_range import NAME
from .overlay.view_handlers import ViewHandlers

ALPHA = 0.45
PAUSE = 0.5  # s between two looks at all objects of a scene
LETTERS = 11.0  # px at a scale of 1
BAR = (160.0, 10.0)  # px at a scale of 1: length and height of the legend
CORNER = (80.0, 100.0)  # px at a scale of 1, from the lower left: above Blender's own box there

_found: dict[int, tuple[float, str]] = {}  # by scene: looked at next, the object's name
_batches: dict[int, tuple[Any, float]] = {}  # by session uid of the mesh: batch, most brightness


def shown(context: bpy.types.Context) -> bpy.types.Object | None:
    """The visible range of the scene, if this view shows it."""
    thing = looked_up(context.scene)
    is_shown = (
        thing is not None
        and context.space_data.overlay.show_overlays
        and thing.visible_get(viewport=context.space_data)
    )
    return thing if is_shown else None


def looked_up(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The visible range of a scene; all objects are looked at once in a while only."""
    due, name = _found.get(scene.session_uid, (0.0, ""))
    if perf_counter() >= due:
        found = grid_of(scene, NAME)
        name = "" if found is None else found.name
        _found[scene.session_uid] = perf_counter() + PAUSE, name
    return scene.objects.get(name) if name else None


def draw() -> None:
    """Called by Blender for each 3D view: the surface."""
    thing = shown(bpy.context)
    if thing is None:
        return

    batch, _ = _batch(thing.data)
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
    """Called by Blender for each 3D view: which colour is how bright."""
    context = bpy.context
    thing = shown(context)
    if thing is None:
        return

    _, most = _batch(thing.data)
    scale = context.preferences.system.ui_scale
    (x, y), (length, height) = (scale * np.array(pair) for pair in (CORNER, BAR))
    steps = np.linspace(0.0, 1.0, 17)
    points = [(x + length * s, y + h, 0.0) for s in steps for h in (0.0, height)]
    colours = _with_alpha(np.repeat(viridis(steps), 2, axis=0), 1.0)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    content = {"pos": points, "color": colours}
    batch_for_shader(shader, "TRI_STRIP", content).draw(shader)

    blf.size(0, LETTERS * scale)
    blf.color(0, 1.0, 1.0, 1.0, 0.9)
    for at, text in (
        ((x, y - 1.3 * LETTERS * scale), percent(0.0)),
        ((x + length, y - 1.3 * LETTERS * scale), percent(most)),
        ((x, y + height + 0.4 * LETTERS * scale), in_words(Message("Visible range: brightness"))),
    ):
        blf.position(0, *at, 0.0)
        blf.draw(0, text)


def _with_alpha(colours: Floats, alpha: float) -> NDArray[np.float32]:
    """Colours (n, 3) with an alpha (n, 4), as the graphics card takes them: it reads the bytes of
    numbers of another kind as they are.
    """
    return np.column_stack([colours, np.full(len(colours), alpha)]).astype(np.float32)


def _batch(mesh: bpy.types.Mesh) -> tuple[Any, float]:
    """The mesh on the graphics card, in the colours of its brightness, and the most of that."""
    if mesh.session_uid not in _batches:
        _batches.clear()  # the last one is enough
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        mesh.calc_loop_triangles()
        triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        bright = brightness_of(mesh)
        most = float(bright.max(initial=0.0))
        colours = _with_alpha(viridis(bright / max(most, 1e-30)), ALPHA)
        batch = batch_for_shader(
            gpu.shader.from_builtin("SMOOTH_COLOR"),
            "TRIS",
            {"pos": points.reshape(-1, 3), "color": colours},
            indices=triangles.reshape(-1, 3),
        )
        _batches[mesh.session_uid] = batch, most
    return _batches[mesh.session_uid]


_handlers = ViewHandlers(POST_VIEW=draw, POST_PIXEL=draw_legend)


def register() -> None:
    """Draw from now on."""
    _handlers.begin()


def unregister() -> None:
    """Draw no more."""
    _handlers.end()
    _batches.clear()
    _found.clear()
