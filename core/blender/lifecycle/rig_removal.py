"""Removes a rig with everything made for it and its results, and undoes its changes. Objects in use
elsewhere stay.
"""

import bpy

from ...base.errors import RigError
from ..data.changes import put_back
from ..data.image import PACKED_MARK
from ..data.made_objects import OBJECT_MARK
from ..data.rigs import RIG_MARK, STORED_MARK, held_by, rigs, with_copies
from ..data.screens import spaces
from ..preview.viewer_render import remove_unused
from ..result.on_display import MATERIAL_MARK
from ..result.result_images import images_of
from ..view.viewport_look import be_opaque, draw_as_solid
from .given_glass import take_back

DATA = ("meshes", "cameras", "materials", "images")  # made by Add Rig, as are objects


def remove_rig(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[str]:
    """Remove a rig from a scene. Returns names of its objects that stay because they are in use."""
    refuse_shared(scene, rig)
    made = made_objects(scene, rig)
    going = _unused_elsewhere(scene, rig, [*made, *_made_data(rig, made)])
    stay = [thing for thing in made if thing not in going]

    for view in reversed(rig.kiriko.views):
        for space in spaces(view.screen):
            put_back(space, [(view.path, view.before, view.after)])
    for thing in _things(scene, rig):
        is_ours = thing.kiriko.taken_as or thing.kiriko.is_given
        others = (group for group in thing.users_collection if group != rig)
        if is_ours and not any(group.kiriko.is_rig for group in others):
            _let_go(thing)
    for thing in stay:
        if RIG_MARK in thing:
            del thing[RIG_MARK]
        thing.kiriko.role = "NONE"
    if scene.camera in going:
        scene.camera = None

    _empty(scene, rig, going)
    names = [thing.name for thing in stay]
    bpy.data.batch_remove([*going, rig])
    for material in bpy.data.materials:
        if material.kiriko.alpha_before and not _is_glass(material):
            be_opaque(material)
    remove_unused()
    return names


def _things(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """Objects of a rig; if it is the scene's only one, also objects no longer in its collection."""
    is_only = rigs(scene) == [rig]
    return list(dict.fromkeys([*held_by(rig), *(scene.objects if is_only else ())]))


def made_objects(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """Objects that Add Rig made for a rig, and objects that show its results in the scene."""
    things = _things(scene, rig)
    made = with_copies(thing for thing in things if RIG_MARK in thing)
    return [*made, *(thing for thing in things if OBJECT_MARK in thing)]


def _made_data(rig: bpy.types.Collection, objects: list[bpy.types.Object]) -> list[bpy.types.ID]:
    """Meshes, cameras, materials and images made for a rig and its results, used by its objects or
    by nothing.
    """
    materials = [slot.material for thing in objects for slot in thing.material_slots]
    materials = [material for material in materials if material is not None]
    images = _images_in(materials)
    used = {*(thing.data for thing in objects), *materials, *images}
    free = {
        kind: [
            one for one in getattr(bpy.data, kind) if one in used or one.users <= one.use_fake_user
        ]
        for kind in DATA
    }
    found = [
        *(block for blocks in free.values() for block in with_copies(blocks)),
        *(material for material in materials if MATERIAL_MARK in material),
        *(thing.data for thing in objects if OBJECT_MARK in thing),
        *(image for image in images if PACKED_MARK in image),
        *images_of(rig.kiriko.result),
    ]
    return list(dict.fromkeys(found))


def _images_in(materials: list[bpy.types.Material]) -> list[bpy.types.Image]:
    """Images of the texture nodes of materials."""
    return [
        node.image
        for material in materials
        if material.node_tree is not None
        for node in material.node_tree.nodes
        if node.type == "TEX_IMAGE" and node.image is not None
    ]


def _unused_elsewhere(
    scene: bpy.types.Scene, rig: bpy.types.Collection, blocks: list[bpy.types.ID]
) -> list[bpy.types.ID]:
    """The datablocks used only by the rig, the scene and each other. A fake user set by the artist
    keeps one.
    """
    groups = scene.collection.children_recursive
    here = {scene, rig, *(group for group in groups if not group.kiriko.is_rig)}
    users = bpy.data.user_map(subset=blocks)
    going = {block for block in blocks if not block.use_fake_user or STORED_MARK in block}

    while True:
        used = {block for block in going if _others(users[block], here | going)}
        used |= {b for b in going if isinstance(b, bpy.types.Object) and len(b.users_scene) > 1}
        if not used:
            return [block for block in blocks if block in going]
        going -= used


def _others(users: set[bpy.types.ID], own: set[bpy.types.ID]) -> set[bpy.types.ID]:
    """Users outside a set, except windows."""
    shown = bpy.types.Screen | bpy.types.WorkSpace | bpy.types.WindowManager
    return {user for user in users - own if not isinstance(user, shown)}


def refuse_shared(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Raise RigError if the rig is linked, or shown in another scene or by an instance, which would
    lose its parts.
    """
    if not rig.is_editable:
        raise RigError(
            "The rig '{rig}' is linked from another file. Unlink its collection, or make it local"
            " first.",
            rig=rig.name,
        )

    for other in bpy.data.scenes:
        if other != scene and rig in other.collection.children_recursive:
            raise _shared(rig, other)

    for thing in bpy.data.objects:
        group = thing.instance_collection
        if thing.users and group is not None and rig in (group, *group.children_recursive):
            raise RigError(
                "'{name}' is an instance of the rig's collection '{rig}'. Delete it first.",
                name=thing.name,
                rig=rig.name,
            )

    for thing in made_objects(scene, rig):
        others = [other for other in thing.users_scene if other != scene]
        if others:
            raise _shared(thing, others[0])


def _shared(block: bpy.types.ID, other: bpy.types.Scene) -> RigError:
    return RigError(
        "'{name}' is also in the scene '{other}'. Unlink it there first.",
        name=block.name,
        other=other.name,
    )


def _let_go(thing: bpy.types.Object) -> None:
    """Restore glass added by Add Rig, unless it was changed since."""
    ours = thing.kiriko
    if not thing.is_editable:
        return
    take_back(thing)
    draw_as_solid(thing)
    if ours.is_made_glass and ours.role == "GLASS":
        ours.property_unset("role")
    ours.property_unset("is_made_glass")
    ours.property_unset("taken_as")


def _is_glass(material: bpy.types.Material) -> bool:
    """Whether any glass has a material."""
    return any(
        thing.kiriko.role == "GLASS"
        and any(slot.material == material for slot in thing.material_slots)
        for thing in bpy.data.objects
    )


def _empty(scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]) -> None:
    """Remove a collection from a scene; remaining contents without another place move to its
    parent.
    """
    parents = [
        group
        for group in (scene.collection, *scene.collection.children_recursive)
        if rig in set(group.children)
    ]
    for parent in parents:
        for thing in rig.objects:
            if thing not in going and set(thing.users_collection) == {rig}:
                parent.objects.link(thing)
        for child in rig.children:
            if child.name not in parent.children:
                parent.children.link(child)
        parent.children.unlink(rig)
