"""Visible objects, the settings that hide others, and `show`, which turns these off.

One rule for all ways to hide: an object is part of the rig only while it is visible in the viewport
and in renders. The outliner's eye, monitor and camera count, the object's own and those of its
collections, and so does exclusion from the view layer.
"""

from collections.abc import Iterator
from functools import cached_property

import bpy

from ...base.errors import RigError
from ...base.messages import Message

Switch = tuple[bpy.types.bpy_struct, str]  # owner, name
HIDES = "hide_viewport", "hide_render"  # switches of objects and collections
IN_VIEWPORT, IN_RENDERS = Message(" in the viewport"), Message(" in renders")
BY_EYE = Message(" in the viewport by its eye icon (H)")
BY_MONITOR = Message(" in the viewport by its monitor icon")
BY_CAMERA = Message(" in renders by its camera icon")


class VisibleObjects:
    """The objects that a scene shows in one of its view layers, as it is now."""

    def __init__(self, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> None:
        self._scene, self._layer = scene, layer

    def hidden_by(self, thing: bpy.types.Object) -> str:
        """Words after 'is hidden' for the setting that hides an object; '' if it is visible, or
        only the source of instances.

        Scenes may have thousands of objects: a visible one, the common case, needs one look-up
        only.
        """
        if not is_visible(thing, self._layer):
            if thing not in self._in_scene:
                return instance_hidden_by(thing)
            if thing.hide_viewport:
                return BY_MONITOR
            if thing in self._in_layer and thing.hide_get(view_layer=self._layer):
                return BY_EYE
            return self._by_collection(thing, ("exclude", "hide_viewport"), IN_VIEWPORT)

        by = instance_hidden_by(thing)
        if not by and not self._is_rendered(thing):
            return self._by_collection(thing, ("exclude", "hide_render"), IN_RENDERS)

        return by

    def _is_rendered(self, thing: bpy.types.Object) -> bool:
        """Whether a rendered collection holds an object. Only if another object has the same name,
        as linked ones may, Blender looks at all objects of all collections.
        """
        if any(group.objects.get(thing.name) == thing for group in self._rendered):
            return True
        return not self._rendered.isdisjoint(thing.users_collection)

    @cached_property
    def _in_scene(self) -> set[bpy.types.Object]:
        return set(self._scene.objects)

    @cached_property
    def _in_layer(self) -> set[bpy.types.Object]:
        return set(self._layer.objects)

    @cached_property
    def _rendered(self) -> set[bpy.types.Collection]:
        return set(open_collections(self._scene.collection, "hide_render"))

    def _by_collection(self, thing: bpy.types.Object, flags: tuple[str, ...], where: str) -> str:
        """The first collection above an object with one of these flags on."""
        for chain in chains_to(thing, self._layer.layer_collection):
            for layer in chain:
                if any(
                    getattr(layer, flag, False) or getattr(layer.collection, flag, False)
                    for flag in flags
                ):
                    return Message(
                        " with its collection '{collection}'{where}",
                        collection=layer.collection.name,
                        where=where,
                    )
        return where


def is_visible(thing: bpy.types.Object, layer: bpy.types.ViewLayer | None = None) -> bool:
    """Whether a view layer, by default the current one, shows an object.

    Called from a 3D viewport Blender would also apply its local view and type filter. These belong
    to one viewport, and a rig is the same in all of them.
    """
    # in a file dialogue the context returns None for all unknown names, such as this one
    with bpy.types.Context.temp_override(bpy.context, area=None):
        return thing.visible_get(view_layer=layer or bpy.context.view_layer)


def is_placed(camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether Blender keeps a camera's transform up to date.

    It always does for the scene's camera. Other cameras that are disabled or not in the view layer
    have an old transform in the depsgraph, or the origin, without a warning.
    """
    scene = depsgraph.scene
    layer = depsgraph.view_layer
    flag = "hide_viewport" if depsgraph.mode == "VIEWPORT" else "hide_render"
    is_in = not set(open_collections(scene.collection, flag)).isdisjoint(camera.users_collection)
    is_enabled = is_in and not getattr(camera, flag)
    if camera == scene.camera or (is_enabled and camera in set(layer.objects)):
        return True
    return not camera.users_scene and any(
        one.is_instance and one.object.original == camera for one in depsgraph.object_instances
    )


def instance_hidden_by(thing: bpy.types.Object) -> str:
    """Words for the setting that hides instances of an object, which is itself hidden or in no
    scene.
    """
    return BY_CAMERA if thing.hide_render else ""


def is_source_hidden(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Whether the source of an instance hides it in renders.

    Geometry nodes that instance an object ignore its settings. If they instance a collection, its
    objects' settings count.
    """
    source = instance.object.original
    if not source.hide_render:
        return False
    maker = instance.parent.original if instance.parent is not None else source
    if not instance.is_instance or not any(one.type == "NODES" for one in maker.modifiers):
        return True
    users = bpy.data.user_map(subset={source})[source]
    return not any(user == maker or isinstance(user, bpy.types.NodeTree) for user in users)


def open_collections(collection: bpy.types.Collection, flag: str) -> Iterator[bpy.types.Collection]:
    """A collection and those below it that are not switched off by a flag."""
    yield collection
    for child in collection.children:
        if not getattr(child, flag):
            yield from open_collections(child, flag)


def chains_to(
    thing: bpy.types.Object,
    layer: bpy.types.LayerCollection,
    above: tuple[bpy.types.LayerCollection, ...] = (),
) -> Iterator[tuple[bpy.types.LayerCollection, ...]]:
    """Chains of collections, from the outermost on, that hold an object."""
    chain = (*above, layer)
    if thing.name in layer.collection.objects:
        yield chain
    for child in layer.children:
        yield from chains_to(thing, child, chain)


def show(thing: bpy.types.Object, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> None:
    """Show an object in viewport and renders.

    If several collections hold it, the chain with the fewest hidden ones is opened. For an object
    visible only as an instance, the instancing object is shown.

    Raises
    ------
    RigError : it stays hidden because it is linked, animated or driven; everything is as before
    """
    opened: list[Switch] = []
    closed_eyes: list[bpy.types.Object] = []
    try:
        for shown in _to_show(thing, scene):
            for owner, name in [*_of_collections(shown, layer), *_closed(shown, *HIDES)]:
                opened.append((owner, name))
                setattr(owner, name, False)
            layer.update()
            if shown in set(layer.objects) and shown.hide_get(view_layer=layer):
                closed_eyes.append(shown)
                shown.hide_set(False, view_layer=layer)
            shown.update_tag(refresh={"TIME"})  # keyframes may hide it again

        layer.update()
        by = VisibleObjects(scene, layer).hidden_by(thing)
        if by:
            raise RigError(
                "'{name}' stays hidden{by} because it is linked, animated or driven.",
                name=thing.name,
                by=by,
            )
    except BaseException:
        for shown in closed_eyes:
            shown.hide_set(True, view_layer=layer)
        for owner, name in reversed(opened):
            setattr(owner, name, True)
        layer.update()
        raise


def _to_show(thing: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The object, preceded by its instancing objects if it is in the scene only as an instance."""
    if thing.name not in scene.objects or scene.objects[thing.name] != thing:
        for maker in scene.objects:
            collection = maker.instance_collection
            if collection is not None and thing in set(collection.all_objects):
                yield from _to_show(maker, scene)
    yield thing


def _of_collections(thing: bpy.types.Object, layer: bpy.types.ViewLayer) -> list[Switch]:
    """The switches of collections that hide an object, along the chain with the fewest."""
    chains = [
        [
            switch
            for level in chain
            for switch in (
                *_closed(level, "exclude", "hide_viewport"),
                *_closed(level.collection, *HIDES),
            )
        ]
        for chain in chains_to(thing, layer.layer_collection)
    ]
    return min(chains, key=len, default=[])


def _closed(owner: bpy.types.bpy_struct, *names: str) -> list[Switch]:
    """The switches of an owner that are on."""
    return [(owner, name) for name in names if getattr(owner, name)]
