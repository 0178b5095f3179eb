"""Objects with a surface, which can be parts of a rig, and Boolean tools, which cannot."""

from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from ...base.errors import RigError
from ...base.messages import Message, as_message

NO_SURFACE = Message("it has no surface")
NO_LENS = Message("it isn't a camera")
NO_PART = "NONE"  # the role of objects that have one, but cannot be parts
OUTLINES = {"BOUNDS", "WIRE"}  # display types of Boolean tools
SURFACELESS = {"ARMATURE", "CAMERA", "LATTICE", "LIGHT", "LIGHT_PROBE", "SPEAKER"}


def bodiless(thing: bpy.types.Object) -> str:
    """Clause on why an object can have no role; '' if it can have one."""
    if thing.type == "EMPTY":
        is_instance = thing.instance_type == "COLLECTION" and thing.instance_collection is not None
        return "" if is_instance else NO_SURFACE

    if thing.kiriko.role == "PROJECTOR":
        return "" if thing.type == "CAMERA" else NO_LENS
    return NO_SURFACE if thing.type in SURFACELESS else ""


def role_label(owner: bpy.types.Object) -> Message:
    """The label of an object's role."""
    return as_message(owner.kiriko.bl_rna.properties["role"].enum_items[owner.kiriko.role].name)


def check_body(thing: bpy.types.Object) -> None:
    """Raise RigError if an object with a role cannot have one."""
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
    """Whether a matrix (4, 4) has non-finite numbers, or numbers whose squares exceed single
    precision.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return not np.isfinite(np.square(np.array(matrix, np.float32))).all()


def on_no_place(name: str) -> Message:
    """The sentence on an object with such a matrix."""
    return Message(
        "The location, rotation or scale of '{name}' is invalid or too large. Reset it.",
        name=name,
    )


def tools_of(things: list[bpy.types.Object]) -> dict[bpy.types.Object, bpy.types.BooleanModifier]:
    """Objects serving others only as tools of a Boolean modifier, with the modifier of each. Wine
    that cuts its glass is not a tool: it is rendered, and not drawn as an outline.
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
    """Clause on why a Boolean tool cannot be glass."""
    return Message("a Boolean modifier of '{name}' uses it", name=modifier.id_data.name)


def shows_instances_alone(shown: bpy.types.Object) -> bool:
    """Whether the nodes of an evaluated object make nothing but instances."""
    has_nodes = any(m.type == "NODES" and m.show_viewport for m in shown.modifiers)
    return has_nodes and shown.type == "MESH" and not len(shown.data.polygons)


def members_of(thing: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects of an instanced collection, each once, including nested instances; none for other
    objects.
    """
    todo, seen = [thing], set()
    while todo:
        one = todo.pop()
        group = one.instance_collection if one.instance_type == "COLLECTION" else None
        new = (
            [] if group is None else [o for o in dict.fromkeys(group.all_objects) if o not in seen]
        )
        seen.update(new)
        todo += reversed(new)
        yield from new


def faceless(thing: bpy.types.Object) -> RigError:
    """The error on an object without a surface for its role."""
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
