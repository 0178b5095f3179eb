"""Areas and 3D views of a screen, also while one is maximised: Blender moves it to a temporary
screen of the same workspace and leaves an empty area in its place.
"""

from typing import Any

import bpy

GAP = "EMPTY"  # type of the area left in place of a maximised one


def place_of(area: bpy.types.Area) -> tuple[bpy.types.Screen, int]:
    """The screen of an area while nothing is maximised, and its number there."""
    screens = sorted(bpy.data.screens, key=_has_gap, reverse=True)
    return next((s, areas_of(s).index(area)) for s in screens if area in areas_of(s))


def areas_of(screen: bpy.types.Screen) -> list[bpy.types.Area]:
    """The areas of a screen, including a maximised one in its place."""
    together = [w.screens for w in bpy.data.workspaces if screen.name in w.screens]
    full = [s for screens in together for s in screens if s.show_fullscreen and not _has_gap(s)]
    return [full[0].areas[0] if full and area.type == GAP else area for area in screen.areas]


def _has_gap(screen: bpy.types.Screen) -> bool:
    return any(area.type == GAP for area in screen.areas)


def spaces(screen: str) -> list[Any]:
    """The 3D views of a screen, by its name."""
    areas = areas_of(bpy.data.screens[screen]) if screen in bpy.data.screens else ()
    return [space for area in areas for space in area.spaces if space.type == "VIEW_3D"]


def window_showing(space: Any) -> bpy.types.Window | None:
    """The window that shows a 3D view now, if any."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            if any(area.spaces.active == space for area in window.screen.areas):
                return window
    return None
