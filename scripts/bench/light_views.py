"""Displays that keep the direction of light: a table of `dev.py light`.

*no glass*: views of a window with a picture behind it, and Cycles' renders of the picture by a row
of cameras: rms of linear light. *conflict*: rms of white between what two viewers 10 degrees apart
need of the same pixels, through a ball, by the number of views. *two viewers*: the same two with 45
views, as Cycles renders the preview (emission by direction): displacement of the lattice, of 1165
px, and the light of the other's picture. *overlap*: cross-talk and sharpness (MTF50, cycles a
pixel) for views that fade into each other. *quiltwright*: the public program interlaces the quilt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from math import radians

import bpy
import numpy as np

from known.registered import registered
from paper.lattice import shift_in_cycles

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402 - the operators have to be there first
from kiriko.core.blender.preview.cycles_preview import render_preview  # noqa: E402
from kiriko.core.files.quilt import LensSheet, interlaced, tile_of  # noqa: E402
from kiriko.core.lab.measure.viewer_errors import conflict_in_light, sharpness  # noqa: E402
from kiriko.core.rig.parts import OwnImage  # noqa: E402
from kiriko.core.rig.rig import Picture, Rig  # noqa: E402
from kiriko.core.rig.settings import Settings  # noqa: E402
from kiriko.core.rig.views import Views  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.core.solve.solution import Solution  # noqa: E402
from kiriko.core.solve.view_remarks import view_figures  # noqa: E402
from kiriko.operators import work  # noqa: E402

from .runner import MISSED, Row  # noqa: E402

MOST_RMS = 0.01  # of linear light: Cycles' samples and filter
MOST_PX = 0.25  # of 1165
MOST_CROSSTALK = 0.05
CONE = radians(80.0)  # all of the light through the ball
SIZE, AWAY, BEHIND = 0.1, 0.5, 0.03  # m, of the window, its cameras and the picture
N_VIEWS = (1, 8, 45, 100)


def row(what: str, found: float, most: float | None = None, form: str = ".4g") -> Row:
    """A row of the table; a figure without a mark is only told."""
    kept = "" if most is None else "kept" if found <= most else MISSED
    return {"what": what, "found": format(found, form), "kept": kept}


def plane(name: str, y: float, role: str) -> bpy.types.Object:
    """An upright square that faces the cameras, with a UV map."""
    mesh = bpy.data.meshes.new(name)
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    mesh.from_pydata([(SIZE / 2 * x, y, SIZE / 2 * z) for x, z in corners], [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new()
    uv.data.foreach_set("uv", np.ravel([(x / 2 + 0.5, z / 2 + 0.5) for x, z in corners]))
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.role = role
    return thing


def camera(x: float, pixels: int) -> bpy.types.Object:
    """A camera x to the right whose frame is the window."""
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.lens, data.shift_x = 1e3 * SIZE, 1e3 * AWAY, -x / SIZE
    thing = bpy.data.objects.new("camera", data)
    thing.location, thing.rotation_euler = (x, -AWAY, 0), (np.pi / 2, 0, 0)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.use_resolution, thing.kiriko.resolution = True, (pixels, pixels)
    return thing


def solved(rig: Rig, **settings: object) -> Solution:
    """The solution of a rig."""
    return run_steps(Session().solve(rig, Settings(**settings)))


def without_glass(pixels: int = 96) -> Iterator[Row]:
    """Three of five views of a window, each against Cycles' render of the picture alone."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.kiriko.only_through_glass = False
    window, picture = plane("Window", 0.0, "DISPLAY"), plane("Picture", BEHIND, "PICTURE")
    alone = plane("Alone", BEHIND, "NONE")  # a display in the picture's place
    y, x = np.mgrid[:256, :256] / 256
    waves = np.stack([np.sin(9 * x + 4 * y), np.cos(7 * y - 5 * x * y), np.sin(8 * x * y), x * 0])
    pixels_of = (0.5 + 0.4 * waves).transpose(1, 2, 0).astype(np.float32)
    pixels_of[..., 3] = 1
    image = bpy.data.images.new("waves", 256, 256, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    image.pixels.foreach_set(np.ascontiguousarray(pixels_of[::-1]).ravel())
    picture.kiriko.image = image
    window.kiriko.resolution = (pixels, pixels)
    ours = window.kiriko.views
    ours.use, ours.columns, ours.cone[0], ours.distance = True, 5, CONE, 1e3 * AWAY
    views = Views(5, 1, (CONE, 0.0), distance=AWAY)

    worst = 0.0
    for view in (0, 2, 3):
        scene.kiriko.viewer = camera(AWAY * np.tan(CONE / 2) * (view - 2) / 2, pixels)
        window.kiriko.role, alone.kiriko.role = "DISPLAY", "NONE"
        quilt = solved(work.read(bpy.context).rig, only_through_glass=False).source
        tile = tile_of(quilt, view, views.tiling((pixels, pixels)))
        window.kiriko.role, alone.kiriko.role = "NONE", "DISPLAY"
        reading = work.read(bpy.context)
        render = render_preview(scene, reading, pixels_of[..., :3], samples=256, fresnel=False)
        worst = max(worst, float(np.sqrt(((render[..., :3] - tile) ** 2).mean())))
    yield row("no glass: views against a row of cameras, rms", worst, MOST_RMS)


def turned(camera: bpy.types.Object, degrees: float) -> bpy.types.Object:
    """A copy of a camera on a circle around the vertical through the origin."""
    from mathutils import Matrix

    bpy.context.view_layer.update()
    other = camera.copy()
    other.matrix_world = Matrix.Rotation(np.radians(degrees), 4, "Z") @ camera.matrix_world
    bpy.context.scene.collection.objects.link(other)
    return other


def two_viewers(n: int, overlap: float = 0.0, pixels: int = 512) -> bpy.types.Scene:
    """A ball on the bench of the paper, a display of n views, and two viewers 10 degrees apart."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    sizes = {"field": 0.05, "picture_size": 0.03, "display_size": 0.05}
    bpy.ops.kiriko.add_rig(display_resolution=(512, 512), viewer_resolution=pixels, **sizes)
    scene = bpy.context.scene
    first = scene.kiriko.viewer
    scene.kiriko.viewer = turned(first, -5)
    bpy.context.view_layer.objects.active = turned(first, 5)
    bpy.ops.kiriko.add_viewer()
    display = next(thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")
    ours = display.kiriko.views
    ours.use, ours.columns, ours.cone[0], ours.overlap = n > 1, n, CONE, overlap
    return scene


def conflict() -> Iterator[Row]:
    """The conflict of two viewers by the number of views; it may not rise."""
    before = np.inf
    for n in N_VIEWS:
        two_viewers(n, pixels=256)
        solution = solved(work.read(bpy.context).rig)
        found = max(run_steps(conflict_in_light(solution))[0])
        yield row(f"conflict of two viewers, {n} views", found, before)
        before = found
        figures = view_figures(solution.channels)
        crosstalk = max((one.crosstalk for one in figures), default=0.5)
        yield row(f"cross-talk, {n} views", crosstalk, MOST_CROSSTALK if n >= 45 else None)


def in_cycles() -> Iterator[Row]:
    """Two viewers with 45 views, each by Cycles."""
    scene = two_viewers(45)
    rig = work.read(bpy.context).rig
    solution = solved(rig)
    own = [
        OwnImage(one.name, np.full((8, 8, 4), k, np.float32)) for k, one in enumerate(rig.viewers)
    ]
    for one in own:
        one.image[..., 3] = 1
    dark_and_white = solved(
        replace(rig, pictures=(Picture("own", own[0].image, own=tuple(own)),))
    ).source
    light = {}
    for number in range(2):
        scene.kiriko.viewer_shown = number
        reading = work.read(bpy.context)  # with the shown viewer first
        name = reading.rig.viewer.name
        channel = next(one for one in solution.channels if one.viewer.name == name)
        pair = channel.ideal(), channel.seen(solution.source)
        shift = shift_in_cycles(scene, reading, solution.source, *pair)
        found = shift.mean if shift.n_seen == 49 else np.inf
        yield row(f"two viewers, Cycles: displacement of {name}, px", found, MOST_PX)
        render = render_preview(scene, reading, dark_and_white, samples=4, fresnel=False)
        light[name] = float(render[..., :3].mean())
    share = light[own[0].name] / light[own[1].name]
    yield row("two viewers, Cycles: light of the other's picture", share, MOST_CROSSTALK)


def overlap() -> Iterator[Row]:
    """Cross-talk and sharpness by overlap, with views as far apart as the viewers."""
    for part in (0.0, 0.5, 1.0):
        two_viewers(8, part, pixels=256)
        rig = work.read(bpy.context).rig
        session = Session()
        solution = run_steps(session.solve(rig, Settings()))
        figures = view_figures(solution.channels)
        yield row(f"cross-talk, 8 views, overlap {part:g}", max(one.crosstalk for one in figures))
        sharp = run_steps(sharpness(session, rig, Settings()))
        yield row(f"MTF50, 8 views, overlap {part:g}", float(np.mean([x or 0 for x in sharp])))


def read_by_quiltwright() -> Iterator[Row]:
    """The interlaced image by the public program; left out where it is not installed."""
    if find_spec("quiltwright") is None:
        yield {"what": "quiltwright is not installed", "found": "", "kept": ""}
        return
    from quiltwright import quilt, weave

    tiling, size = (8, 6), (42, 56)
    shape = tiling[1] * size[1], tiling[0] * size[0], 3
    pixels = np.random.default_rng(0).random(shape).astype(np.float32)
    numbers = 52.5741, -7.19256, 0.565845, 324.0, 1536, 2048
    theirs = weave.weave_quilt(
        pixels, quilt.QuiltSpec(*tiling, shape[1], shape[0], 0.75), weave.Calibration(*numbers)
    )
    off = (interlaced(pixels, tiling, LensSheet(*numbers)) != theirs).mean()
    yield row("quiltwright: parts of pixels that differ, of 1536 x 2048 x 3", float(off), 0.0)


CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "views: no glass": without_glass,
    "views: conflict": conflict,
    "views: two viewers": in_cycles,
    "views: overlap": overlap,
    "views: quiltwright": read_by_quiltwright,
}
