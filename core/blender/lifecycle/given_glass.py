"""Glass materials from Make It Glass. Removing the rig restores the objects' own materials."""

import bpy

from ..data.rigs import keep
from ..view.viewport_look import draw_as_solid

GIVEN_MARK = "kiriko_given"  # on the material
SETTER = "GeometryNodeSetMaterial"


def has_place(thing: bpy.types.Object) -> bool:
    """Whether an object can get a material; a linked mesh without slots gets it by a modifier."""
    return hasattr(thing.data, "materials") and (
        bool(thing.material_slots) or thing.data.is_editable or thing.type == "MESH"
    )


def give(thing: bpy.types.Object, glass: bpy.types.Material) -> list[str]:
    """Link a material to an object in place of its mesh's materials, which may have other users.

    Returns their names.
    """
    ours = thing.kiriko
    is_first = not ours.is_given
    ours.is_given = glass[GIVEN_MARK] = True
    if not thing.material_slots and thing.data.is_editable:
        thing.data.materials.append(None)
    else:
        for slot in thing.material_slots if is_first else ():
            before = ours.given.add()
            before.link, before.material = slot.link, slot.material

    names = []
    for slot in thing.material_slots:
        if slot.material is not None:
            names.append(slot.material.name)
            if not is_first:
                keep(slot.material)
        slot.link = "OBJECT"
        slot.material = glass
    draw_as_solid(thing)
    return names


def set_by_modifier(thing: bpy.types.Object, glass: bpy.types.Material) -> None:
    """Set a material on all faces of an object by a last modifier, since geometry nodes may
    override its slots.
    """
    tree = bpy.data.node_groups.new(glass.name, "GeometryNodeTree")
    tree[GIVEN_MARK] = True
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    start, setter, end = map(tree.nodes.new, ("NodeGroupInput", SETTER, "NodeGroupOutput"))
    start.location.x, end.location.x = -200, 200
    setter.inputs["Material"].default_value = glass
    tree.links.new(start.outputs[0], setter.inputs["Geometry"])
    tree.links.new(setter.outputs[0], end.inputs[0])
    thing.modifiers.new(glass.name, "NODES").node_group = tree


def take_back(thing: bpy.types.Object) -> None:
    """Restore an object's own materials if it still has the glass."""
    ours = thing.kiriko
    if not ours.is_given:
        return
    given = _take_modifiers(thing)
    is_bare = not len(ours.given) and all(_is_given(slot.material) for slot in thing.material_slots)
    for n, slot in enumerate(thing.material_slots):
        if not _is_given(slot.material):
            continue
        given.add(slot.material)
        before = ours.given[n] if n < len(ours.given) else None
        slot.material = before.material if before and before.link == "OBJECT" else None
        slot.link = before.link if before else "DATA"
    materials = thing.data.materials
    if is_bare and list(materials) == [None] and thing.data.is_editable:
        materials.clear()
    ours.property_unset("given")
    ours.property_unset("is_given")
    bpy.data.batch_remove([material for material in given if not material.users])


def _take_modifiers(thing: bpy.types.Object) -> set[bpy.types.Material]:
    """Remove the modifiers of `set_by_modifier`. Returns their glass."""
    given = set()
    for modifier in list(thing.modifiers):
        tree = modifier.node_group if modifier.type == "NODES" else None
        if tree is not None and GIVEN_MARK in tree:
            setters = [node for node in tree.nodes if node.bl_idname == SETTER]
            given |= {node.inputs["Material"].default_value for node in setters}
            thing.modifiers.remove(modifier)
            if not tree.users:
                bpy.data.node_groups.remove(tree)
    return set(filter(_is_given, given))


def _is_given(material: bpy.types.Material | None) -> bool:
    return material is not None and GIVEN_MARK in material
