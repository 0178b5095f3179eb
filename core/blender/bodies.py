"""Which objects have a surface, so that they can be a part of a rig?"""

import bpy

from ..messages import Message

EMPTY = Message("an empty has no surface")
OUTLINES = {"BOUNDS", "WIRE"}  # as tools of modifiers are drawn
SURFACELESS = {
    "ARMATURE": Message("an armature has no surface"),
    "CAMERA": Message("a camera has no surface"),
    "LATTICE": Message("a lattice has no surface"),
    "LIGHT": Message("a light has no surface"),
    "LIGHT_PROBE": Message("a light probe has no surface"),
    "SPEAKER": Message("a speaker has no surface"),
}


def bodiless(thing: bpy.types.Object) -> str:
    """Why an object can have no role, as the end of a sentence; '' where it can."""
    if thing.type == "EMPTY":
        is_instance = thing.instance_type == "COLLECTION" and thing.instance_collection is not None
        return "" if is_instance else EMPTY

    return SURFACELESS.get(thing.type, "")


def tools_of(things: list[bpy.types.Object]) -> dict[bpy.types.Object, bpy.types.Object]:
    """Objects that are no bodies of their own, but cut or complete others among these by a Boolean
    modifier, and what each one cuts. Wine that is cut out of its glass is a body: it is rendered,
    and no mere outline in the viewport.
    """
    found = {}
    for whole in things:
        for modifier in whole.modifiers:
            if modifier.type != "BOOLEAN" or not modifier.show_viewport:
                continue
            is_one = modifier.operand_type == "OBJECT"
            group = modifier.collection
            tools = [modifier.object] if is_one else (group.all_objects if group else [])
            found.update({tool: whole for tool in tools if tool in things})
    return {
        tool: whole
        for tool, whole in found.items()
        if tool.kiriko.role == "NONE" and (tool.hide_render or tool.display_type in OUTLINES)
    }


def shows_instances_alone(shown: bpy.types.Object) -> bool:
    """Does an evaluated object show nothing but instances of others, by its nodes?"""
    has_nodes = any(m.type == "NODES" and m.show_viewport for m in shown.modifiers)
    return has_nodes and shown.type == "MESH" and not len(shown.data.polygons)
