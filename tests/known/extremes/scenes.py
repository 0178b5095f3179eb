"""The extreme cases that need Blender: scenes in other
units, and parts placed by float32 object matrices.
"""

import importlib
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from kiriko.core.rig.rig import Mesh, Rig

from .. import closed_forms
from ..registered import registered
from .bench import AT_ORIGIN, differs
from .cases import (
    Floats,
    N,
    Rows,
    ball_rig,
    case,
    furthest,
    layers,
    limit,
    on,
    slab_rig,
    tells,
    within,
)

UNITS = {
    "mm": ("METRIC", 0.001),
    "cm": ("METRIC", 0.01),
    "inches": ("IMPERIAL", 0.0254),
    "km": ("METRIC", 1000.0),
}


def package() -> str:
    """The name under which Kiriko is registered; registers the checkout where it is not."""
    if not hasattr(bpy.types, "KIRIKO_OT_solve"):
        registered()
    return bpy.types.KIRIKO_OT_solve.__module__.removesuffix(".operators.solve")


def core(name: str) -> ModuleType:
    return importlib.import_module(f"{package()}.core.{name}")


def place(thing: bpy.types.Object, centre: Floats, turn: Floats, metres: float) -> None:
    """Put an object where it belongs, m."""
    thing.matrix_world = Matrix(
        core("blender.read.scene").object_matrix(turn, centre, metres).tolist()
    )


def draw(mesh: Mesh, role: str, metres: float, centre: Floats, turn: Floats) -> bpy.types.Object:
    """A part as an object of Blender, its mesh in the axes `turn` (3, 3) around a centre."""
    drawn = bpy.data.meshes.new(role)
    drawn.from_pydata(
        ((mesh.vertices - centre) @ turn / metres).tolist(), [], mesh.triangles.tolist()
    )

    if mesh.is_smooth is not None and mesh.is_smooth.all():
        drawn.shade_smooth()
    else:
        drawn.shade_flat()

    if mesh.uv is not None:
        drawn.uv_layers.new().data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
    thing = bpy.data.objects.new(role, drawn)
    place(thing, centre, turn, metres)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.role = role

    return thing


def read(
    a_rig: Rig, system: str, metres: float, turn: Floats | None = None, far: float = 0.0
) -> Any:
    """The rig drawn in a new file in some unit, as Kiriko reads it.

    turn (3, 3): the axes of the objects, around the middle of each; far: m,
    of the whole from the origin
    """
    package()  # the objects' settings are its own
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    viewer = a_rig.viewer
    scene.unit_settings.system, scene.unit_settings.scale_length = system, metres
    aside = far * np.array([0.3137, -0.7091, 0.4173])

    parts = {
        "GLASS": a_rig.glasses[0],
        "PLATE": a_rig.plates[0],
        "DISPLAY": a_rig.displays[0],
        "PICTURE": a_rig.picture,
    }
    for role, part in parts.items():
        mesh = replace(part.mesh, vertices=part.mesh.vertices + aside)
        centre = np.zeros(3) if turn is None else mesh.vertices.mean(axis=0)
        thing = draw(mesh, role, metres, centre, np.eye(3) if turn is None else turn)
        if role == "GLASS":
            thing.kiriko.use_ior, thing.kiriko.ior = True, N
        elif role == "DISPLAY":
            thing.kiriko.resolution = part.width, part.height
        elif role == "PICTURE":
            blank = bpy.data.images.new("blank", *part.image.shape[1::-1], float_buffer=True)
            blank.colorspace_settings.name = "Non-Color"
            blank.pixels.foreach_set(np.ascontiguousarray(part.image[::-1], np.float32).ravel())
            thing.kiriko.image = blank

    lens = bpy.data.cameras.new("viewer")
    lens.angle = 2 * np.arctan(viewer.window[1])
    camera = bpy.data.objects.new("viewer", lens)
    scene.collection.objects.link(camera)
    right, up, forward = viewer.axes
    place(camera, viewer.position + aside, np.stack([right, up, -forward], axis=1), metres)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = viewer.width, viewer.height
    bpy.context.view_layer.update()

    return core("blender.read.scene").read(bpy.context, scene).rig


def through_slab(o: Floats, d: Floats) -> tuple[Floats, Floats]:
    return on(o, d, layers((-0.01, N), (0.01, 1.0)))


def through_ball(o: Floats, d: Floats) -> tuple[Floats, Floats]:
    return closed_forms.through_ball(o, d, 0.025, N)


def landing_error(
    a_rig: Rig, found_rig: Any, through: Callable[..., tuple[Floats, Floats]] = through_slab
) -> float:
    """Greatest distance, display px, of landings in what was
    read from those by formulas in what was meant.

    Each by its own viewer's rays, so that it does not matter where the rig was drawn.
    """
    x, y = np.meshgrid(
        np.linspace(0.3, a_rig.viewer.width - 0.4, 33),
        np.linspace(0.2, a_rig.viewer.height - 0.3, 33),
    )
    at = np.stack([x.ravel(), y.ravel()], axis=1)
    plan = core("light.compile_plan").compile_plan(found_rig, core("rig.settings").Settings())
    found = core("light.trace").trace_all(plan, *found_rig.viewer.rays(at))
    o, d = a_rig.viewer.rays(at)
    return furthest(a_rig, found, through(o, d))


def solved(a_rig: Any) -> Any:
    return core("base.steps").run_steps(
        core("solve.session").Session().solve(a_rig, core("rig.settings").Settings())
    )


@case("scale", "scenes in mm, cm, inches and km")
def units(quick: bool) -> Rows:
    slab = slab_rig(pixels=256)
    pixels = 32 if quick else 128
    ball = ball_rig(True, pixels=pixels, display_pixels=pixels)
    here = solved(read(ball, "METRIC", 1.0))
    yield within("landing, slab, scene in m", landing_error(slab, read(slab, "METRIC", 1.0)), 5e-4)

    for name, unit in UNITS.items():
        yield within(
            f"landing, slab, scene in {name}", landing_error(slab, read(slab, *unit)), 5e-4
        )
        places, colours = differs(here, solved(read(ball, *unit)))
        yield within(
            f"source image's places, ball, {name} against m: float32 rounds otherwise", places, 5e-4
        )
        yield within("its colours", colours, 1e-3, "")

    places, colours = differs(here, solved(read(ball, "METRIC", 2.0**-10)))
    yield within("source image's places, unit of 2^-10 m: float32 rounds alike", places, 1e-6)
    yield within("its colours", colours, 1e-6, "")


@case("scale", "float32 object matrices")
def matrices(quick: bool) -> Rows:
    turn = np.linalg.qr([[0.3, 0.8, 0.5], [-0.7, 0.4, 0.2], [0.1, -0.6, 0.9]])[0]
    turn *= np.sign(np.linalg.det(turn))
    ball = ball_rig(False, pixels=64 if quick else 256)
    for far, bound in ((0.0, 5e-3), (1.0, 5e-3), (100.0, 0.2)):
        found_rig = read(ball, "METRIC", 1.0, turn, far)
        error = landing_error(ball, found_rig, through_ball)
        told = tells(solved(found_rig), "Blender rounds coordinates")
        measured = f"landing, ball, parts drawn in other axes, {far:g} m from the origin"
        if far < 100:
            yield within(measured, np.inf if told else error, bound)
        else:
            yield limit(measured, error, bound, "px", AT_ORIGIN, told)
