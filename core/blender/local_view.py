"""Local view: what a 3D view alone shows, while it does.

Blender answers whether a view shows an object by the last update, so that nothing is left out by
that answer.
"""

from collections.abc import Iterable, Iterator

import bpy


def widen(space: bpy.types.SpaceView3D) -> list[str]:
    """Have a view in local view show all objects; returns the names of those it showed alone, none
    for a view that is not in local view.
    """
    things = list(_objects(space))
    # Blender 4.2 says of no object that it is in local view, but whether it is seen
    own = [
        thing.name
        for thing in things
        if thing.local_view_get(space) or thing.visible_get(viewport=space)
    ]
    for thing in things:
        thing.local_view_set(space, True)
    return own


def narrow(space: bpy.types.SpaceView3D, names: Iterable[str]) -> None:
    """Have a view that is still in local view show the objects of these names alone; all, where
    none of them is left.
    """
    kept = set(names)
    things = list(_objects(space))
    if not kept.isdisjoint(thing.name for thing in things):
        for thing in things:
            thing.local_view_set(space, thing.name in kept)


def _objects(space: bpy.types.SpaceView3D) -> Iterator[bpy.types.Object]:
    """All objects that a view in local view could show; none for one that is in no window."""
    if space.local_view is None:
        return
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            if any(area.spaces.active == space for area in window.screen.areas):
                yield from window.view_layer.objects
                return
