"""Looking: which events turn a view or scroll, and change nothing that is worked on.

Blender asks modal operators before it asks its keymaps, so that an operator which lets an event
pass does not know what will become of it. So the user's own keymaps are asked here: an event passes
if all they make of it is another view.
"""

import re

import bpy

VIEWS = re.compile(
    r"view3d\.(rotate|move|zoom|dolly|smoothview|ndof_\w+"
    r"|view_(all|axis|camera|center_camera|center_lock|center_pick|orbit|pan|persportho|roll|selected))"
    r"|view2d\.\w+|image\.view_\w+"
)
# keymaps that see what is done in the main region of an editor;
# left and right button are gizmos', too, and edit
KEYMAPS = {
    "VIEW_3D": (
        "3D View",
        "3D View Generic",
        "Object Mode",
        "Object Non-modal",
        "Frames",
        "Screen",
        "Window",
    ),
    "IMAGE_EDITOR": ("Image", "Image Generic", "Frames", "Screen", "Window"),
}
POINTING = ("MIDDLEMOUSE", "WHEEL", "TRACKPAD", "MOUSEROTATE", "MOUSESMARTZOOM", "NDOF_MOTION")
KEYS = ("NUMPAD_", "HOME", "NDOF_BUTTON_")
SCROLLING = ("WHEEL", "TRACKPADPAN")
# a view turns smoothly by timers
ALWAYS = ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE", "TIMER")


def only_looks(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Does an event, wherever in the window it is meant for,
    change no more than the view of the scene?
    """
    if event.type.startswith(ALWAYS):
        return True

    area, region = under_mouse(context.window, event)
    if region is None:
        return False

    if region.type != "WINDOW" or area.type not in KEYMAPS:
        # with a modifier a wheel changes the number under it
        is_plain = not (event.ctrl or event.alt or event.shift or event.oskey)
        return event.type.startswith(SCROLLING) and is_plain

    if not event.type.startswith(POINTING + KEYS):
        return False
    if area.type == "VIEW_3D" and area.spaces.active.lock_camera:
        return False  # the camera goes where the view goes

    found = meant(context.window_manager, KEYMAPS[area.type], event)
    if "view3d.view_camera" in found and context.scene.camera is None:
        return False  # Blender would choose one

    return all(map(VIEWS.fullmatch, found)) and (bool(found) or event.type.startswith(POINTING))


def under_mouse(
    window: bpy.types.Window, event: bpy.types.Event
) -> tuple[bpy.types.Area | None, bpy.types.Region | None]:
    """The area and the region that an event of this window goes to.

    Regions may lie over the main one.
    """
    x, y = event.mouse_x, event.mouse_y
    for area in window.screen.areas:
        within = [r for r in area.regions if 0 <= x - r.x < r.width and 0 <= y - r.y < r.height]
        if within:
            return area, min(within, key=lambda region: region.type == "WINDOW")
    return None, None


def meant(
    manager: bpy.types.WindowManager, names: tuple[str, ...], event: bpy.types.Event
) -> set[str]:
    """The operators, if any, that these of the user's keymaps have for an event."""
    keymaps = (manager.keyconfigs.user.keymaps.get(name) for name in names)
    items = (keymap.keymap_items.match_event(event) for keymap in keymaps if keymap is not None)
    return {item.idname for item in items if item is not None}
