"""The glass that Make It Glass gives to objects, which have their own materials back when their rig
is removed.
"""

import bpy

from .rig_record import keep
from .rigs import rig_of, rigs_of
from .stored_records import fields_of, text_of
from .viewport_look import draw_as_solid

GIVEN_MARK = "kiriko_given"  # on the material
SETTER = "GeometryNodeSetMaterial"


def has_place(thing: bpy.types.Object) -> bool:
    """Can an object be given a material? A linked mesh without slots has it by a modifier."""
    return hasattr(thing.data, "materials") and (
        bool(thing.material_slots) or thing.data.is_editable or thing.type == "MESH"
    )


def give(scene: bpy.types.Scene, thing: bpy.types.Object, glass: bpy.types.Material) -> list[str]:
    """Link a material to an object in place of those of its mesh, which may be others', too.

    Returns their names.
    """
    rig = rig_of(scene, thing)
    has_slots = bool(thing.material_slots)
    if not has_slots and thing.data.is_editable:
        thing.data.materials.append(None)

    kept, slots = [], []
    for slot in thing.material_slots:
        own = slot.material
        is_kept = own is not None and own.use_fake_user
        slots.append([slot.link, own.name if own else "", is_kept])
        if own is not None:
            keep(own)
            kept.append(own.name)
        slot.link = "OBJECT"
        slot.material = glass

    if rig is not None and not thing.kiriko.given:
        glass[GIVEN_MARK] = True
        thing.kiriko.given = _given(rig.kiriko.key, slots if has_slots else [])
    draw_as_solid(thing)
    return kept


def _given(key: str, slots: list[tuple[str, str, bool]]) -> str:
    """The record of an object that was made glass: key of its rig, and its slots before."""
    return text_of({"rig": key, "slots": slots})


def set_by_modifier(thing: bpy.types.Object, glass: bpy.types.Material) -> None:
    """Put a material on all faces that an object's modifiers make, by one after them all: geometry
    nodes may set another than that of its slots.
    """
    tree = bpy.data.node_groups.new(glass.name, "GeometryNodeTree")
    tree[GIVEN_MARK] = True
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    start, setter, end = map(tree.nodes.new, ("NodeGroupInput", SETTER, "NodeGroupOutput"))
    start.location.x, end.location.x = -200, 200
    setter.inputs["Material"].default_value = glass
    tree.links.new(start.outputs[0], setter.inputs["Geometry"])
    tree.links.new(setter.outputs[0], end.inputs[0])
    thing.modifiers.new(glass.name, "NODES").node_group = tree


def take_back(scene: bpy.types.Scene, key: str) -> None:
    """Give objects of a rig their own materials again, where they still have the glass."""
    keys = rigs_of(scene)
    given = set()
    for thing in scene.objects:
        given_before = fields_of(thing.kiriko.given)
        if given_before.get("rig") != key or not thing.is_editable:
            continue
        slots = given_before["slots"]
        heirs = keys(thing) - {key}
        if heirs:  # it is another rig's glass, too
            thing.kiriko.given = _given(min(heirs), slots)
            continue
        thing.kiriko.given = ""
        given |= _take_modifiers(thing)
        given |= {slot.material for slot in thing.material_slots if _is_given(slot.material)}
        _take_back(thing, slots)

    for material in given:
        if not material.users:
            bpy.data.materials.remove(material)


def _take_modifiers(thing: bpy.types.Object) -> set[bpy.types.Material]:
    """Take away the modifiers of `set_by_modifier`. Returns the glass that they set."""
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


def _take_back(thing: bpy.types.Object, slots: list[tuple[str, str, bool]]) -> None:
    before = dict(enumerate(slots))
    is_bare = not slots and all(_is_given(slot.material) for slot in thing.material_slots)
    for n, slot in enumerate(thing.material_slots):
        if not _is_given(slot.material):
            continue
        link, name, was_kept = before.get(n, ("DATA", "", False))
        own = bpy.data.materials.get(name)
        slot.material = own if link == "OBJECT" else None
        slot.link = link
        if slot.material is not None and slot.material == own:
            own.use_fake_user = was_kept
    materials = thing.data.materials
    if is_bare and list(materials) == [None] and thing.data.is_editable:
        materials.clear()
