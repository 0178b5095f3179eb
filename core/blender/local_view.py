"""Local view: what a 3D view alone shows, while it does.

Blender answers whether a view shows an object by the last update, so that nothing is left out by
that answer.
"""

from collections.abc import Iterable

import bpy

from .screens import window_showing
from .visibility import is_visible


def widen(space: bpy.types.SpaceView3D) -> tuple[list[str], list[str]]:
    """Have a view in local view show all objects; returns the names of those it showed alone, and
    of all that it shows now: none for a view that is not in local view.
    """
    layer = _layer(space)
    things = [] if layer is None else list(layer.objects)
    own = [thing.name for thing in things if _shows(space, thing)]
    for thing in things:
        thing.local_view_set(space, True)
    return own, [thing.name for thing in things]


def narrow(space: bpy.types.SpaceView3D, names: Iterable[str], widened: Iterable[str]) -> None:
    """Have a view that is still in local view show the objects of these names alone; all, where
    none of them is left.

    One that leaves out any of those that it was widened to is another local view, which the artist
    has entered since: it stays.
    """
    layer = _layer(space)
    if layer is None:
        return
    kept, then = set(names), set(widened)
    for thing in layer.objects:
        # of a type that this view shows not at all Blender 4.2 tells nothing
        is_seen_else = getattr(space, f"show_object_viewport_{thing.type.lower()}", True)
        is_ours = thing.name in then and is_seen_else and is_visible(thing, layer)
        if is_ours and not _shows(space, thing):
            return
    if not kept.isdisjoint(layer.objects.keys()):
        for thing in layer.objects:
            thing.local_view_set(space, thing.name in kept)


def _shows(space: bpy.types.SpaceView3D, thing: bpy.types.Object) -> bool:
    """Does a view in local view show an object? Blender 4.2 says of none that it is in local view,
    but whether it is seen.
    """
    return thing.local_view_get(space) or thing.visible_get(viewport=space)


def _layer(space: bpy.types.SpaceView3D) -> bpy.types.ViewLayer | None:
    """The view layer of which a view in local view shows objects; None for one that is in none, or
    in no window.
    """
    window = None if space.local_view is None else window_showing(space)
    return None if window is None else window.view_layer
