"""Shows a hidden object: switches on whatever hides it, and nothing else."""

from collections.abc import Iterator

import bpy

from ..base.errors import RigError
from ..base.messages import Message
from .visibility import Shown, ways_to

Switch = tuple[bpy.types.bpy_struct, str, str]  # its owner, its name, the words for it


def show(
    thing: bpy.types.Object, scene: bpy.types.Scene, layer: bpy.types.ViewLayer
) -> list[Message]:
    """Show an object in viewport and renders; returns what was switched on.

    Of several collections that hold it, those are opened in which the fewest are closed. An object
    that is shown only as an instance is shown by whatever makes the instance.

    Raises
    ------
    RigError : it stays hidden, since it is linked, animated or driven; everything is as it was
    """
    before: list[tuple[bpy.types.bpy_struct, str, bool]] = []
    words: list[Message] = []
    try:
        for shown in _to_show(thing, scene):
            for owner, name, text in [*_of_collections(shown, layer), *_of_object(shown)]:
                before.append((owner, name, True))
                setattr(owner, name, False)
                words.append(text)
            words += _open_eye(shown, layer, before)
            shown.update_tag(refresh={"TIME"})  # keyframes may hide it again

        layer.update()
        by = Shown(scene, layer).hidden_by(thing)
        if by:
            raise RigError(
                "'{name}' stays hidden{by}: it is linked from another file, animated or driven.",
                name=thing.name,
                by=by,
            )
    except BaseException:
        for owner, name, value in reversed(before):
            if name == "":
                owner.hide_set(value, view_layer=layer)
            else:
                setattr(owner, name, value)
        layer.update()
        raise

    return words


def _to_show(thing: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The object, and where it is in the scene as an instance alone also what makes that."""
    if thing.name not in scene.objects or scene.objects[thing.name] != thing:
        for maker in scene.objects:
            collection = maker.instance_collection
            if collection is not None and thing in set(collection.all_objects):
                yield from _to_show(maker, scene)
    yield thing


def _of_object(thing: bpy.types.Object) -> Iterator[Switch]:
    """The switches of its own that hide an object."""
    if thing.hide_viewport:
        yield thing, "hide_viewport", Message("its monitor symbol is on")
    if thing.hide_render:
        yield thing, "hide_render", Message("its camera symbol is on")


def _open_eye(
    thing: bpy.types.Object, layer: bpy.types.ViewLayer, before: list
) -> Iterator[Message]:
    """Open an object's eye, which it has in the view layer, once it is in there."""
    layer.update()
    if thing in set(layer.objects) and thing.hide_get(view_layer=layer):
        before.append((thing, "", True))
        thing.hide_set(False, view_layer=layer)
        yield Message("its eye symbol is on")


def _of_collections(thing: bpy.types.Object, layer: bpy.types.ViewLayer) -> list[Switch]:
    """The switches of collections that hide an object, along the way with the fewest."""
    ways = [list(_of_way(way)) for way in ways_to(thing, layer.layer_collection)]
    return min(ways, key=len, default=[])


def _of_way(way: tuple[bpy.types.LayerCollection, ...]) -> Iterator[Switch]:
    """The switches that hide what is in the last of a chain of collections."""
    for level in way:
        name = level.collection.name
        if level.exclude:
            yield (
                level,
                "exclude",
                Message("the collection '{name}' is in the view layer", name=name),
            )
        if level.hide_viewport:
            yield level, "hide_viewport", Message("the eye of '{name}' is on", name=name)
        if level.collection.hide_viewport:
            yield (
                level.collection,
                "hide_viewport",
                Message("the monitor symbol of '{name}' is on", name=name),
            )
        if level.collection.hide_render:
            yield (
                level.collection,
                "hide_render",
                Message("the camera symbol of '{name}' is on", name=name),
            )
