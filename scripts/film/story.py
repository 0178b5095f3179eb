"""The film's story, played in Blender: a ball, a rig, a solve, and the wipe."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from film.record import RATE, Recorder
from manual import scenes
from manual.plays import IN_THE_GLASS, SOLVE
from manual.steps import Still, Until

PIXELS = 800
AT_WORK = 9  # frames of the solve
TIP, NOTCH = 0.92, 0.36  # radii of the star
SIDE, CORNERS = 0.98, 1.58  # of the frame: x of its sides, x + y of its cut corners


def star() -> bpy.types.Image:
    """A golden star on a blue grid in a frame of eight sides; transparent outside.

    Its corners would be visible next to the ball.
    """
    y, x = (np.mgrid[:PIXELS, :PIXELS] + 0.5) / PIXELS * 2 - 1
    y = -y
    radius, angle = np.hypot(x, y), np.arctan2(x, y)
    turn = 2 * np.pi / 5
    apart = np.abs((angle + turn / 2) % turn - turn / 2)
    # a side of the star runs from its tip to its notch
    notch = NOTCH * np.cos(turn / 2), NOTCH * np.sin(turn / 2)
    normal = np.array([notch[1], TIP - notch[0]]) / np.hypot(notch[1], TIP - notch[0])
    side = radius * (np.cos(apart) * normal[0] + np.sin(apart) * normal[1]) - TIP * normal[0]
    grid = np.minimum(np.abs((x * 3 + 0.5) % 1 - 0.5), np.abs((y * 3 + 0.5) % 1 - 0.5)) / 3
    far = np.sort(np.abs([x, y]), axis=0)
    frame = np.maximum(far[1], (far[0] + far[1]) * SIDE / CORNERS) - SIDE
    colour = np.zeros((PIXELS, PIXELS, 4), np.float32)
    colour[..., 3] = frame < 0
    for distance, of in (
        (grid - 0.008, (0.10, 0.30, 0.75)),
        (np.abs(frame + 0.025) - 0.025, (0.45, 0.70, 1.0)),
        (side, (1.0, 0.80, 0.25)),
        (side + 0.05, (0.95, 0.42, 0.08)),
    ):
        weight = np.clip(0.5 - distance * PIXELS / 2, 0, 1)[..., None]
        colour[..., :3] = (1 - weight) * colour[..., :3] + weight * np.array(of)
    image = bpy.data.images.new("star.png", PIXELS, PIXELS)
    image.pixels.foreach_set(colour[::-1].ravel())
    return image


def fill_window(player: Recorder) -> Iterator[float]:
    """Give the whole window to the 3D viewport, with Kiriko's tab at its side."""
    area = player.area("VIEW_3D")
    with bpy.context.temp_override(window=player.window, area=area, region=area.regions[-1]):
        bpy.ops.screen.screen_full_area(use_hide_panels=True)
    yield 1.0
    view = player.area("VIEW_3D").spaces.active
    view.show_region_ui = True
    view.show_region_toolbar = view.show_region_header = view.show_region_tool_header = False
    view.show_region_hud = False
    view.overlay.show_text = view.overlay.show_stats = False
    yield 1.0
    player.region("VIEW_3D", "UI").active_panel_category = "Kiriko"
    yield 1.0


def frame_of_view(player: Recorder) -> np.ndarray:
    """Corners of the viewer's image in the window, px: upper left, upper right, lower right, lower
    left.
    """
    area, region = player.area("VIEW_3D"), player.region("VIEW_3D", "WINDOW")
    with bpy.context.temp_override(window=player.window, area=area, region=region):
        corners = scenes.kiriko("operators.compared").frame_in_region(
            bpy.context, bpy.context.scene
        )
    return corners + np.array((region.x, region.y))


def story(player: Recorder) -> Iterator[float]:
    """All scenes, in the order of the work; scene 0 is the film's first."""
    bpy.context.preferences.system.use_region_overlap = False
    scenes.ball()
    scenes.nothing_else()
    yield from fill_window(player)
    area, region = player.area("VIEW_3D"), player.region("VIEW_3D", "WINDOW")
    with bpy.context.temp_override(window=player.window, area=area, region=region):
        bpy.ops.view3d.view_selected()
    yield from player.move(region.x + 0.55 * region.width, region.y + 0.35 * region.height)

    player.scene = 1
    yield from player.take(0.3)
    yield from player.click(IN_THE_GLASS, 8)
    yield from player.until(Until("has_rig", 900))
    picture = next(t for t in bpy.context.scene.objects if t.kiriko.role == "PICTURE")
    picture.kiriko.image = star()
    scenes.small_display()
    yield from wait(player, 3.0)
    yield from player.take(0.7)

    player.scene = 2
    yield from player.click(SOLVE, 6)
    first = len(player.frames)
    while not scenes.is_solved():
        yield 1.0  # frames in between would delay the work
        yield from player.take(1 / RATE)
    player.thin_out(first, AT_WORK)
    yield from wait(player, 1.0)
    player.area("VIEW_3D").spaces.active.show_region_ui = False
    yield 1.0
    yield from wipe(player)

    player.scene = 4
    bpy.ops.kiriko.before_after("INVOKE_DEFAULT")  # off
    yield 1.0
    area, region = player.area("VIEW_3D"), player.region("VIEW_3D", "WINDOW")
    with bpy.context.temp_override(window=player.window, area=area, region=region):
        bpy.ops.kiriko.look_through("INVOKE_DEFAULT")
    yield from player.until(Until("is_seen", 900))
    yield from player.still(Still(12.0))
    yield from player.take(1.8)
    player.write()


def wait(player: Recorder, seconds: float) -> Iterator[float]:
    """Wait for the end of Kiriko's work, and for a redraw."""
    yield 1.0
    yield from player.until(Until("is_quiet", 900))
    player.area("VIEW_3D").tag_redraw()
    yield seconds


def wipe(player: Recorder) -> Iterator[float]:
    """Drag the handle from before to after; the first scene is before alone."""
    player.scene = 3
    bpy.ops.kiriko.before_after("INVOKE_DEFAULT")
    yield from wait(player, 1.0)
    corners = frame_of_view(player)
    left, right = corners[:2, 0]
    middle = corners[:, 1].mean()
    ours = bpy.context.window_manager.kiriko
    place = lambda share: (left + share * (right - left), middle)  # noqa: E731

    ours.wipe = 1.0
    yield from wait(player, 1.0)
    player.scene = 0
    yield from player.take(1.2)
    player.scene = 3
    ours.wipe = 0.85
    yield from player.move(*place(0.85))
    yield from wait(player, 1.0)
    yield from player.take(0.3)
    yield from player.drag([(*place(0.2), 11), (*place(0.5), 5), (*place(0.03), 7)])
    yield from player.take(0.5)
