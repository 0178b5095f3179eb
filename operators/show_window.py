"""Show Window: a window of Blender with the source image alone, an image pixel on a screen pixel.

A new window shows a text editor without text or headers. `panels/shown_pixels.py` draws the image
over its region: image editors would put its numbers through the colour management of the screen,
text editors leave them alone. Blender's own full-screen state of areas was rejected, since a screen
stays in the file when the window is closed. Which windows are ours is kept for the session alone,
by the ids of their screens: a file that is saved meanwhile opens with a normal image editor in
their place.
"""

import bpy
from bpy.app.handlers import persistent

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.data.rigs import rigs
from ..core.blender.result.result_images import images_of
from . import needed, telling, windows, work
from .windows import all_windows

FULL_SCREEN = "wm.window_fullscreen_toggle"
TICK = 0.1  # s between two looks at the result and the windows
EDITOR = "TEXT_EDITOR"
SAVED_AS = "IMAGE_EDITOR"
# switches of a text editor that show something beside its text
PARTS = ("show_region_header", "show_region_footer", "show_region_ui", "show_line_numbers")

_screens: set[int] = set()  # session uids of the screens of our windows
_seen: list[object] = []  # the result as it was looked at last
_keys: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []


def show_windows() -> list[bpy.types.Window]:
    """The show windows that are open: one, but where Blender made copies."""
    return [window for window in all_windows() if window.screen.session_uid in _screens]


def is_ours(window: bpy.types.Window | None) -> bool:
    """Is a window a show window?"""
    return window is not None and window.screen.session_uid in _screens


def shown_result(scene: bpy.types.Scene) -> bpy.types.PropertyGroup:
    """The result that show windows show of a scene: that of the rig that is chosen for them, else
    of the active one.
    """
    name = bpy.context.window_manager.kiriko.show_rig
    chosen = next((rig for rig in rigs(scene) if rig.name == name), None)
    return (scene if chosen is None else chosen).kiriko.result


def size_of(window: bpy.types.Window) -> tuple[int, int]:
    """Pixels of the screen that a show window has for its image."""
    region = next(region for region in _editor(window).regions if region.type == "WINDOW")
    return region.width, region.height


def key_of_full_screen(context: bpy.types.Context) -> str:
    """The keys that make a window full-screen in this user's keymap, '' where there are none."""
    found = context.window_manager.keyconfigs.find_item_from_operator(FULL_SCREEN)[1]
    return "" if found is None else found.to_string()


def _editor(window: bpy.types.Window) -> bpy.types.Area:
    return max(window.screen.areas, key=lambda area: area.width * area.height)


def _open(context: bpy.types.Context) -> None:
    """A new window that shows nothing but the main region of an editor."""
    before = {window.as_pointer() for window in all_windows()}
    bpy.ops.wm.window_new()
    window = next(one for one in all_windows() if one.as_pointer() not in before)

    try:
        _become_editor(window)
    except BaseException:
        close(window)
        raise

    _screens.add(window.screen.session_uid)
    _seen.clear()
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=TICK, persistent=True)


def _become_editor(window: bpy.types.Window) -> None:
    area = _editor(window)
    area.type = EDITOR
    space = area.spaces.active
    space.text = None
    for name in PARTS:
        setattr(space, name, False)


def close(window: bpy.types.Window) -> None:
    """Close a show window."""
    _screens.discard(window.screen.session_uid)
    with bpy.context.temp_override(window=window):
        bpy.ops.wm.window_close()


def tick() -> float | None:
    """Called by a timer as long as there is a show window: it follows the result."""
    windows = show_windows()
    if not windows:
        return None

    seen = [_look(window) for window in windows]
    if seen != _seen:
        _seen[:] = seen
        redraw()
    return TICK


def _look(window: bpy.types.Window) -> tuple[object, ...]:
    """What tells one state of a result from another; Live draws anew by itself."""
    result = shown_result(window.scene)
    image = result.source
    about = () if image is None else (image.session_uid, tuple(image.size))
    return (*about, result.solved_for, result.is_coarse, size_of(window))


def redraw() -> None:
    """Have the show windows drawn again."""
    for window in show_windows():
        for area in window.screen.areas:
            area.tag_redraw()


@persistent
def on_undo(*_: object) -> None:
    """An image may be another one under the same name."""
    redraw()


@persistent
def before_save(*_: object) -> None:
    """A file opens with a normal image editor in the place of a show window."""
    for window in show_windows():
        area = _editor(window)
        area.type = SAVED_AS
        area.spaces.active.image = shown_result(window.scene).source
        area.spaces.active.show_region_header = True


@persistent
def after_save(*_: object) -> None:
    """The show goes on."""
    for window in show_windows():
        _become_editor(window)


HANDLERS = (
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("save_pre", before_save),
    ("save_post", after_save),
    ("save_post_fail", after_save),
)


def register() -> None:
    """Follow undo, leave show windows out of files that are saved, and have keys for full screen:
    Blender's own keymap has none.
    """
    work.listen(HANDLERS)
    config = bpy.context.window_manager.keyconfigs.addon
    if config is not None:  # in the background there is none
        keymap = config.keymaps.new("Window")
        keys = keymap.keymap_items.new(FULL_SCREEN, "F11", "PRESS", alt=True)
        _keys.append((keymap, keys))


def unregister() -> None:
    """Close what is open, and forget it."""
    work.stop_listening(HANDLERS)
    while _keys:
        keymap, keys = _keys.pop()
        keymap.keymap_items.remove(keys)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    for window in show_windows():
        close(window)
    _screens.clear()


class KIRIKO_OT_show_window(bpy.types.Operator):
    """Open a window that shows only the source image"""

    bl_description = (
        "Open a window with the source image alone, one image pixel to one screen pixel, encoded as"
        " the exported file. Drag it to the display and make it full-screen there; it follows Live"
        " and playback"
    )
    bl_idname = "kiriko.show_window"
    bl_label = "Show Window"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = []
        if bpy.app.background:
            reasons.append(
                Message("Show Window needs Blender's window: start Blender without --background")
            )
        elif shown_result(context.scene).source is None:
            reasons.append(needed.UNSOLVED)
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.errors_reported(self):
            image = shown_result(context.scene).source
            for window in show_windows():
                if size_of(window) == tuple(image.size):
                    telling.report(
                        self, "INFO", Message("The show window is already open on its display.")
                    )
                    return {"FINISHED"}
                close(window)  # Blender raises new windows alone

            _open(context)
            return {"FINISHED"}
        return {"CANCELLED"}


NO_IMAGE = Message("No source image yet: solve first")


class KIRIKO_OT_show_image(bpy.types.Operator):
    """Show this image in the panel and in image editors"""

    bl_idname = "kiriko.show_image"
    bl_label = "Show Image"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(name="Image", description="Name of the image")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = images_of(context.scene.kiriko.result)
        return needed.can_run(cls, [] if found else [NO_IMAGE])

    def execute(self, context: bpy.types.Context) -> set[str]:
        result = context.scene.kiriko.result
        with telling.errors_reported(self):
            found = [image for image in images_of(result) if image.name == self.image]
            if not found:
                raise RigError(
                    "The result has no image '{image}': choose another one.",
                    image=self.image,
                )
            windows.show_image(found[0], result)
            return {"FINISHED"}
        return {"CANCELLED"}
