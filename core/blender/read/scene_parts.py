"""Finds the parts of the rig among the scene's objects, by role."""

import functools
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...rig.rig import ROLES, Mesh
from ..data.bodies import check_body, has_no_place, on_no_place
from ..data.lost_data import find_lost, on_lost, placeholders_of, refuse_lost
from ..data.rigs import elsewhere
from ..data.visibility import VisibleObjects, is_source_hidden
from ..materials.texture import Texture
from .shapes import ShapeCache, used_materials

LeftOut = Callable[[bpy.types.Object], bool]


@dataclass(frozen=True, eq=False)
class WorldPart:
    """One mesh in the world with the object that has the role and the object it was drawn as.

    materials : the most used first
    matrix : (4, 4) of the object in the world, m
    frame : the scene's, for moving images
    metres : length of a Blender unit
    """

    owner: bpy.types.Object
    name: str
    mesh: Mesh
    drawn: bpy.types.Object | None = None
    materials: tuple[bpy.types.Material | None, ...] = ()
    texture: Texture | None = None
    n_dropped: int = 0
    matrix: Floats | None = None
    frame: int = 1
    metres: float = 1.0

    @property
    def role(self) -> str:
        return self.owner.kiriko.role


def role_owner(instance: bpy.types.DepsgraphObjectInstance) -> bpy.types.Object | None:
    """The original object with an instance's role: its own, else its collection's instancer or
    nodes' object.
    """
    own = instance.object.original
    if own.kiriko.role != "NONE":
        return own

    maker = instance.parent
    if not instance.is_instance or maker is None or instance.particle_system is not None:
        return None
    if maker.instance_type not in {"NONE", "COLLECTION"} or maker.original.kiriko.role == "NONE":
        return None  # objects instanced on another's vertices or faces are not part of it

    return maker.original


def part_name(instance: bpy.types.DepsgraphObjectInstance, counts: Counter[str]) -> str:
    """Name of a part: its object's, numbered for instances. Counts up."""
    own = instance.object.original
    # a curve, text or metaball shows its surface as an instance of itself
    is_itself = not instance.is_instance or (own.type != "MESH" and not counts[own.name])
    counts[own.name] += instance.is_instance
    return own.name if is_itself else f"{own.name} (instance {counts[own.name]})"


def read_part(
    instance: bpy.types.DepsgraphObjectInstance,
    owner: bpy.types.Object,
    name: str,
    to_metres: Floats,
    cache: ShapeCache,
) -> WorldPart:
    """Triangles, materials and texture of one instance; call it before the iterator moves on."""
    shown = instance.object
    shape = cache.shape(instance, owner)
    matrix = to_metres @ np.array(instance.matrix_world, dtype=float)
    if has_no_place(instance.matrix_world):
        text = on_no_place(owner.name)
        raise RigError(text.template, **text.values)
    mesh, n_dropped = shape.at(matrix, owner.kiriko.surface)

    return WorldPart(
        owner=owner,
        name=name,
        mesh=mesh,
        drawn=shown.original,
        materials=used_materials(shown, shape.slots),
        texture=shape.texture,
        n_dropped=n_dropped,
        matrix=matrix,
        metres=float(to_metres[0, 0]),
    )


def shown_parts(
    depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene, is_left_out: LeftOut | None = None
) -> Iterator[tuple[bpy.types.DepsgraphObjectInstance, bpy.types.Object]]:
    """Instances with a role visible in viewport and renders, with the objects of their roles.

    is_left_out : whether to skip an object; None skips inactive rigs
    """
    is_left_out = is_left_out or elsewhere(scene)
    shown = VisibleObjects(scene, depsgraph.view_layer)
    # cached, since one object may make thousands of instances
    is_hidden = functools.cache(lambda thing: bool(shown.hidden_by(thing)))

    for instance in depsgraph.object_instances:
        owner = role_owner(instance)
        if owner is None or not instance.show_self:
            continue

        own = instance.object.original
        top = (
            instance.parent.original
            if instance.is_instance and instance.parent is not None
            else own
        )
        if is_left_out(owner) or is_left_out(top):
            continue
        if not (is_source_hidden(instance) or is_hidden(top)):
            yield instance, owner


def read_parts(
    depsgraph: bpy.types.Depsgraph,
    scene: bpy.types.Scene,
    metres: float,
    cache: ShapeCache,
    needed: tuple[str, ...] = (),
    is_left_out: LeftOut | None = None,
) -> tuple[list[WorldPart], list[str]]:
    """All parts visible in viewport and renders, and notes on hidden ones.

    is_left_out : see `shown_parts`

    Raises RigError for an object with a role that cannot be a part, and if all parts of a needed
    role are hidden or missing from a library.
    """
    to_metres = np.diag([metres, metres, metres, 1.0])
    parts: list[WorldPart] = []
    found: set[bpy.types.Object] = set()
    counts: Counter[str] = Counter()
    is_left_out = is_left_out or elsewhere(scene)
    lost = find_lost()

    for instance, owner in shown_parts(depsgraph, scene, is_left_out):
        found.add(owner)
        refuse_lost(lost, [owner])
        check_body(owner)

        if instance.object.type == "MESH":
            part = read_part(instance, owner, part_name(instance, counts), to_metres, cache)
            parts.append(replace(part, frame=scene.frame_current))

    cache.end()
    parts = without_hollows(parts, found)
    hidden = unmet_parts(found, scene, depsgraph.view_layer, is_left_out)
    placeholders = placeholders_of(scene) if lost else []
    for role in needed:
        check_some_are_shown(role, parts, hidden)
    missing = {*needed} - {one.role for one in parts}
    needs_glass = scene.kiriko.only_through_glass and "GLASS" in missing
    if needs_glass or any(role.remedy for role in ROLES if role.name in missing):
        refuse_lost(lost, placeholders)

    notes = [text for text, _ in on_lost(lost, placeholders)]
    return parts, notes_on_parts(parts, found, hidden, scene) + notes


GLASS_REMEDY = Message("set the role of an object to Glass, or turn off Only Through Glass")


def parts_by_role(
    parts: list[WorldPart], glasses: Collection[bpy.types.Object] = ()
) -> dict[str, list[WorldPart]]:
    """Parts by the names of all roles; objects in `glasses` count as glass."""
    found: dict[str, list[WorldPart]] = {role.name: [] for role in ROLES}
    for part in parts:
        found["GLASS" if part.owner in glasses else part.role].append(part)
    return found


def without_hollows(parts: list[WorldPart], met: set[bpy.types.Object]) -> list[WorldPart]:
    """Parts with faces, and one empty part for each object without any, for the rig's check to
    report.

    Objects that only make instances, and metaballs whose family has the surface, do not count.
    """
    full = [part for part in parts if len(part.mesh.triangles)]
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int64))
    names = sorted(o.name for o in met - {part.owner for part in full} if o.type != "META")
    owners = {o.name: o for o in met}
    return full + [WorldPart(owners[name], name, empty) for name in names]


def unmet_parts(
    met: set[bpy.types.Object],
    scene: bpy.types.Scene,
    layer: bpy.types.ViewLayer,
    is_left_out: LeftOut,
) -> dict[bpy.types.Object, str]:
    """Objects of the scene with a role and without parts, each with the setting that hides it."""
    shown = VisibleObjects(scene, layer)
    return {
        o: shown.hidden_by(o)
        for o in scene.objects
        if o.kiriko.role != "NONE" and o not in met and not is_left_out(o)
    }


def check_some_are_shown(
    role: str, parts: list[WorldPart], unmet: dict[bpy.types.Object, str]
) -> None:
    """Raise RigError for the first object of a role whose objects are all hidden."""
    hidden = [(thing, by) for thing, by in unmet.items() if by and thing.kiriko.role == role]
    if hidden and not any(part.role == role for part in parts):
        raise RigError("{reason}.", reason=hidden_words(*hidden[0]))


def hidden_words(thing: bpy.types.Object, by: str) -> str:
    """Sentence without a full stop on a hidden object with a role, and the remedy."""
    can_do_without = thing.kiriko.role == "PLATE"
    return Message(
        "The {role} '{name}' is hidden{by}: show it{otherwise}",
        role=next(role.noun for role in ROLES if role.name == thing.kiriko.role),
        name=thing.name,
        by=by,
        otherwise=Message(", or set its role to None") if can_do_without else "",
    )


def notes_on_parts(
    parts: list[WorldPart],
    met: set[bpy.types.Object],
    unmet: dict[bpy.types.Object, str],
    scene: bpy.types.Scene,
) -> list[str]:
    """Notes on ignored parts: hidden objects, metaballs without a surface of their own, triangles
    without area.
    """
    notes = [
        Message(
            "'{name}' is hidden{by} and ignored.",
            name=o.name,
            by=by,
        )
        if by
        else Message(
            "'{name}' shows no surface and is ignored.",
            name=o.name,
        )
        for o, by in unmet.items()
    ]
    full = {part.owner for part in parts if len(part.mesh.triangles)}
    notes += [
        Message(
            "The metaball '{name}' belongs to another one's family. Give the role to the family's"
            " first metaball.",
            name=o.name,
        )
        for o in scene.objects
        if o in met - full and o.type == "META"
    ]
    notes += [
        Message(
            "Kiriko ignores {n} zero-area triangle{s} of '{name}'.",
            name=part.name,
            n=part.n_dropped,
            s="s" if part.n_dropped > 1 else "",
        )
        for part in parts
        if part.n_dropped
    ]

    return notes
