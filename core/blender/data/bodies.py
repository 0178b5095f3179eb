"""Which objects have a surface, so that they can be a part of a rig?"""

from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from ...base.errors import RigError
from ...base.messages import Message, as_message

NO_SURFACE = Message("it has no surface")
NO_PART = "NONE"  # as the role of objects that have one, and can have none
OUTLINES = {"BOUNDS", "WIRE"}  # as tools of modifiers are drawn
SURFACELESS = {"ARMATURE", "CAMERA", "LATTICE", "LIGHT", "LIGHT_PROBE", "SPEAKER"}


def bodiless(thing: bpy.types.Object) -> str:
    """Why an object can have no role, as the end of a sentence; '' where it can."""
    if thing.type == "EMPTY":
        is_instance = thing.instance_type == "COLLECTION" and thing.instance_collection is not None
        return "" if is_instance else NO_SURFACE

    return NO_SURFACE if thing.type in SURFACELESS else ""


def role_label(owner: bpy.types.Object) -> Message:
    """The word the user sees for an object's role."""
    return as_message(owner.kiriko.bl_rna.properties["role"].enum_items[owner.kiriko.role].name)


def check_body(thing: bpy.types.Object) -> None:
    """Raise RigError where an object has a role, and can have none."""
    if why := bodiless(thing):
        raise RigError(
            "'{name}' has the role {role}, but {why}. Set its role to None.",
            name=thing.name,
            role=role_label(thing),
            why=why,
        )


def no_part(thing: bpy.types.Object) -> str:
    """The sentence on such an object."""
    try:
        check_body(thing)
    except RigError as error:
        return error.message
    return ""


def has_no_place(matrix: Sequence[Sequence[float]]) -> bool:
    """Has a matrix (4, 4) numbers that are none, or whose squares Blender's single precision cannot
    hold, so that an object has no place or size by it?
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return not np.isfinite(np.square(np.array(matrix, np.float32))).all()


def on_no_place(name: str) -> Message:
    """The sentence on such an object."""
    return Message(
        "The location, rotation or scale of '{name}' is invalid or too large. Reset it.",
        name=name,
    )


def tools_of(things: list[bpy.types.Object]) -> dict[bpy.types.Object, bpy.types.BooleanModifier]:
    """Objects that are no bodies of their own, but cut or complete others among these by a Boolean
    modifier, and the modifier of each. Wine that is cut out of its glass is a body: it is rendered,
    and no mere outline in the viewport.
    """
    used: dict[bpy.types.Object, bpy.types.BooleanModifier] = {}
    for modifier in (one for whole in things for one in whole.modifiers):
        if modifier.type != "BOOLEAN" or not modifier.show_viewport:
            continue
        group = modifier.collection
        is_one = modifier.operand_type == "OBJECT"
        for tool in [modifier.object] if is_one else (group.all_objects if group else []):
            is_tool = tool in things and tool.kiriko.role == "NONE"
            if is_tool and (tool.hide_render or tool.display_type in OUTLINES):
                used.setdefault(tool, modifier)
    return used


def use_of(modifier: bpy.types.BooleanModifier) -> Message:
    """Why a tool of a Boolean modifier is no glass, as the end of a sentence."""
    return Message("a Boolean modifier of '{name}' uses it", name=modifier.id_data.name)


def shows_instances_alone(shown: bpy.types.Object) -> bool:
    """Does an evaluated object show nothing but instances of others, by its nodes?"""
    has_nodes = any(m.type == "NODES" and m.show_viewport for m in shown.modifiers)
    return has_nodes and shown.type == "MESH" and not len(shown.data.polygons)


def members_of(thing: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that an instance of a collection shows, once each, those of instances within it,
    too; none of other objects.
    """
    todo, met = [thing], set()
    while todo:
        one = todo.pop()
        group = one.instance_collection if one.instance_type == "COLLECTION" else None
        new = [] if group is None else [o for o in dict.fromkeys(group.all_objects) if o not in met]
        met.update(new)
        todo += reversed(new)
        yield from new


def faceless(thing: bpy.types.Object) -> RigError:
    """The error that an object shows nothing which could be glass by its role."""
    for member in members_of(thing):
        if member.kiriko.role != "NONE":
            return RigError(
                "'{name}' contains '{member}', which has a role. Set that role to None first, in"
                " its own file if it is linked.",
                name=thing.name,
                member=member.name,
            )
    return RigError(
        "'{name}' has no faces. Add some, or deselect it.",
        name=thing.name,
    )
