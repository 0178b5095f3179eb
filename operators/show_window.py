"""Show Window: a Blender window with only the source image, one image pixel to one screen pixel.

A new window shows a text editor without text or headers, and `panels/shown_pixels.py` draws the
image over its region. Image editors would apply the screen's colour management, text editors do
not. Blender's full-screen areas were rejected, because their screens stay in the file. Screen ids
of our windows are stored for the session only: a file saved in the meantime opens with a normal
image editor instead.
"""

import bpy
from bpy.app.handlers import persistent

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.data.rigs import rigs
from ..core.blender.result.result_images import images_of
from ..core.blender.result.write_result import quilt_in, sections_in
from ..core.rig.joined_display import Section
from . import needed, reporting, windows, work
from .windows import all_windows

FULL_SCREEN = "wm.window_fullscreen_toggle"
TICK = 0.1  # s between checks of the result and the windows
EDITOR = "TEXT_EDITOR"
SAVED_AS = "IMAGE_EDITOR"
# Settings of a text editor that show something besides its text.
PARTS = ("show_region_header", "show_region_footer", "show_region_ui", "show_line_numbers")

_screens: dict[int, str] = {}  # the part shown by session uids of the screens of our windows
_seen: list[object] = []  # the result as of the last check
_keys: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []


def show_windows() -> list[bpy.types.Window]:
    """Open show windows; more than one only if Blender made copies."""
    return [window for window in all_windows() if window.screen.session_uid in _screens]


def is_ours(window: bpy.types.Window | None) -> bool:
    """Whether a window is a show window."""
    return window is not None and window.screen.session_uid in _screens


def shown_result(scene: bpy.types.Scene) -> bpy.types.PropertyGroup:
    """Result shown of a scene: of the rig chosen for show windows, otherwise of the active one."""
    name = bpy.context.window_manager.kiriko.show_rig
    chosen = next((rig for rig in rigs(scene) if rig.name == name), None)
    return (scene if chosen is None else chosen).kiriko.result


def shown_section(window: bpy.types.Window, image: bpy.types.Image) -> Section:
    """The section of a result's image in a show window: of its display, or the first."""
    sections = sections_in(image)
    name = _screens.get(window.screen.session_uid, "")
    return next((one for one in sections if one.name == name), sections[0])


def size_of(window: bpy.types.Window) -> tuple[int, int]:
    """Screen pixels available to a show window's image."""
    region = next(region for region in _editor(window).regions if region.type == "WINDOW")
    return region.width, region.height


def key_of_full_screen(context: bpy.types.Context) -> str:
    """The user's keys for full screen; '' if there are none."""
    found = context.window_manager.keyconfigs.find_item_from_operator(FULL_SCREEN)[1]
    return "" if found is None else found.to_string()


def _editor(window: bpy.types.Window) -> bpy.types.Area:
    return max(window.screen.areas, key=lambda area: area.width * area.height)


def _open(context: bpy.types.Context, part: str) -> None:
    """A new window with nothing but the main region of an editor, for the image of a part."""
    before = {window.as_pointer() for window in all_windows()}
    bpy.ops.wm.window_new()
    window = next(one for one in all_windows() if one.as_pointer() not in before)

    try:
        _become_editor(window)
    except BaseException:
        close(window)
        raise

    _screens[window.screen.session_uid] = part
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
    _screens.pop(window.screen.session_uid, None)
    with bpy.context.temp_override(window=window):
        bpy.ops.wm.window_close()


def tick() -> float | None:
    """Timer callback while a show window is open: follows the result."""
    windows = show_windows()
    if not windows:
        return None

    seen = [_look(window) for window in windows]
    if seen != _seen:
        _seen[:] = seen
        redraw()
    return TICK


def _look(window: bpy.types.Window) -> tuple[object, ...]:
    """Identity of a result's state; Live redraws by itself."""
    result = shown_result(window.scene)
    image = result.source
    about = () if image is None else (image.session_uid, tuple(image.size))
    return (*about, result.solved_for, result.is_coarse, size_of(window))


def redraw() -> None:
    """Redraw the show windows."""
    for window in show_windows():
        for area in window.screen.areas:
            area.tag_redraw()


@persistent
def on_undo(*_: object) -> None:
    """Handle undo: another image may have the same name."""
    redraw()


@persistent
def before_save(*_: object) -> None:
    """Before saving, replace show windows by normal image editors in the file."""
    for window in show_windows():
        area = _editor(window)
        area.type = SAVED_AS
        area.spaces.active.image = shown_result(window.scene).source
        area.spaces.active.show_region_header = True


@persistent
def after_save(*_: object) -> None:
    """After saving, show again."""
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
    """Follow undo, keep show windows out of saved files, and add full-screen keys.

    Blender's own keymap has none.
    """
    work.listen(HANDLERS)
    config = bpy.context.window_manager.keyconfigs.addon
    if config is not None:  # none in background mode
        keymap = config.keymaps.new("Window")
        keys = keymap.keymap_items.new(FULL_SCREEN, "F11", "PRESS", alt=True)
        _keys.append((keymap, keys))


def unregister() -> None:
    """Close and forget the show windows."""
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
        "Open a window with only the source image, one image pixel per screen pixel, in the"
        " exported file's values. Drag it to the display and make it full-screen there; it follows"
        " Live and playback"
    )
    bl_idname = "kiriko.show_window"
    bl_label = "Show Window"
    bl_options = {"REGISTER"}

    part: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = []
        if bpy.app.background:
            reasons.append(
                Message("Show Window needs Blender's window: start Blender without --background")
            )
        elif shown_result(context.scene).source is None:
            reasons.append(needed.UNSOLVED)
        elif quilt_in(shown_result(context.scene).source) is not None:
            reasons.append(
                Message("The display has views: export the quilt, which the device's player shows")
            )
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            image = shown_result(context.scene).source
            for window in show_windows():
                shown = shown_section(window, image)
                if self.part not in {"", shown.name}:
                    continue
                if size_of(window) == (shown.width, shown.height):
                    reporting.report(
                        self, "INFO", Message("The show window is already open on its display.")
                    )
                    return {"FINISHED"}
                close(window)  # Blender raises only new windows

            _open(context, self.part)
            return {"FINISHED"}
        return {"CANCELLED"}


NO_IMAGE = Message("No source image yet: solve first")


class KIRIKO_OT_show_image(bpy.types.Operator):
    """Show this image in the panel and in image editors"""

    bl_idname = "kiriko.show_image"
    bl_label = "Show Image"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(
        name="Image",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = images_of(context.scene.kiriko.result)
        return needed.can_run(cls, [] if found else [NO_IMAGE])

    def execute(self, context: bpy.types.Context) -> set[str]:
        result = context.scene.kiriko.result
        with reporting.errors_reported(self):
            found = [image for image in images_of(result) if image.name == self.image]
            if not found:
                raise RigError(
                    "The result has no image '{image}': choose another one.",
                    image=self.image,
                )
            windows.show_image(found[0], result)
            return {"FINISHED"}
        return {"CANCELLED"}
