"""A new rig in Blender: reads the bench, chooses the glass for the viewer, and makes the objects,
all or none.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.messages import Message, joined, quoted
from ...bench.placement import Proposal
from ...glass.meshes import box_of
from ...rig.rig import ROLES, ConstantIndex, Glass, Rig
from ..data.bodies import bodiless, faceless, role_label, tools_of, use_of
from ..data.made_objects import Workbench, ball_mesh
from ..data.overridden import overridden, take_away
from ..data.rigs import RIG, is_copy, mark_made, rigs_of
from ..data.units import length_of_unit
from ..data.visibility import VisibleObjects
from ..read.elements import DEFAULT_IOR
from ..read.part_roles import in_blender
from ..read.read_mesh import in_world, read_local
from ..read.scene_parts import WorldPart, parts_by_role, read_parts
from ..read.shapes import ShapeCache
from ..view.viewport_look import be_seen_as_glass, see_through
from .rig_objects import in_units, make_display, make_picture, make_plate, make_viewer


def bounds_of(parts: Sequence[WorldPart | Glass]) -> Floats:
    """Bounds (2, 3) of parts, world, m."""
    return box_of(np.concatenate([part.mesh.bounds for part in parts]))


def looked_through(parts: list[WorldPart], active: bpy.types.Object | None) -> list[WorldPart]:
    """The glass for the viewer: the active object's, else the glass nearest to the common centre,
    as after a box selection.
    """
    owners = {part.owner for part in parts}
    if active not in owners:
        middle = bounds_of(parts).mean(axis=0)
        nearest = min(
            parts, key=lambda part: np.linalg.norm(bounds_of([part]).mean(axis=0) - middle)
        )
        active = nearest.owner
    return [part for part in parts if part.owner == active]


BALL = Message("Kiriko Ball")
BALL_RADIUS = 0.025  # m
MOST_NAMED = 3  # tools named in a message


@dataclass(frozen=True, eq=False)
class RigSite:
    """The surroundings of a new rig.

    glasses : objects to become glass; none: a ball is made
    rig : all glass, and the existing plates, mirrors and blockers
    bounds : (2, 3) of those glasses, world, m
    aim : (2, 3) of the active one, or of the one nearest to their common centre
    opaque : glasses without a refractive material
    """

    glasses: tuple[bpy.types.Object, ...]
    rig: Rig
    bounds: Floats
    aim: Floats
    opaque: tuple[bpy.types.Object, ...]


def glass_among(things: list[bpy.types.Object]) -> tuple[bpy.types.Object, ...]:
    """The selected objects fit as glass, without Boolean tools.

    Raises RigError if objects are selected and none can be glass.
    """
    reasons = {thing: bodiless(thing) for thing in things}
    for thing, modifier in tools_of(things).items():
        reasons[thing] = use_of(modifier)
    for thing in things:
        if thing.kiriko.role not in {"NONE", "GLASS"}:
            reasons[thing] = Message("it has the role {role}", role=role_label(thing))

    found = tuple(thing for thing, why in reasons.items() if not why)
    if things and not found:
        thing, why = next(iter(reasons.items()))
        raise RigError(
            "'{name}' cannot be glass: {why}. Select your glass, or select nothing to add a ball.",
            name=thing.name,
            why=why,
        )

    return found


def on_left_out(
    things: list[bpy.types.Object], active: bpy.types.Object | None, shown: VisibleObjects
) -> list[Message]:
    """Sentences on objects that a new rig leaves out and the artist may miss: Boolean tools and, if
    nothing is selected, a hidden active object.
    """
    tools = [
        Message("'{name}' ({why})", name=tool.name, why=use_of(modifier))
        for tool, modifier in tools_of(things).items()
    ]
    if len(tools) > MOST_NAMED:
        tools = [*tools[:MOST_NAMED], Message("{n} others", n=len(tools) - MOST_NAMED)]
    if tools:
        return [Message("Left out: {tools}.", tools=joined(tools, ", "))]

    may_be = active is not None and active.kiriko.role in {"NONE", "GLASS"} and not bodiless(active)
    if may_be and not things and (by := shown.hidden_by(active)):
        text = Message(
            "'{name}' is hidden{by}, so the rig is built around a ball.",
            name=active.name,
            by=by,
        )
        return [text]
    return []


def read_bench(
    context: bpy.types.Context, scene: bpy.types.Scene, glasses: tuple[bpy.types.Object, ...]
) -> RigSite:
    """Read the bench without other rigs and with these objects as glass; nothing is changed.

    Raises
    ------
    RigError : one of them encloses nothing, or is hidden
    """
    metres = length_of_unit(scene)
    cache = ShapeCache()

    with _as_glass(glasses):
        context.view_layer.update()
        depsgraph, holders = context.evaluated_depsgraph_get(), rigs_of(scene)
        is_out = lambda thing: thing not in glasses and bool(holders(thing))  # noqa: E731
        parts, _ = read_parts(depsgraph, scene, metres, cache, is_left_out=is_out)

    by_role = parts_by_role(parts, glasses)

    solids = [part for part in by_role["GLASS"] if len(part.mesh.triangles)]
    read = [in_blender("GLASS").read(part, cache) for part in solids]
    found = [glass for glass, _, _ in read]
    opaque = {m.object_name for _, _, materials in read for m in materials if m.source == "default"}

    if glasses:
        chosen = [part for part in solids if part.owner in glasses]
        _check_bodies(glasses, chosen, VisibleObjects(scene, context.view_layer))
    else:
        found.append(_ball(scene, metres))
        chosen = found[-1:]

    bounds = aim = bounds_of(chosen)
    if glasses:
        aim = bounds_of(looked_through(chosen, context.view_layer.objects.active))
    others = {
        role.field: tuple(
            in_blender(role.name).read(part, cache).part for part in by_role[role.name]
        )
        for role in ROLES
        if role.kind is not None and not role.is_made and role.name != "GLASS"
    }
    rig = Rig(viewers=(), glasses=tuple(found), displays=(), **others)
    not_refracting = tuple(thing for thing in glasses if thing.name in opaque)
    return RigSite(glasses, rig, bounds, aim, not_refracting)


@contextmanager
def _as_glass(things: tuple[bpy.types.Object, ...]) -> Iterator[None]:
    """Objects have the role Glass within the context, and their own afterwards."""
    before = [(thing.kiriko, thing.kiriko.role) for thing in things]
    try:
        for ours, _ in before:
            ours.role = "GLASS"
        yield
    finally:
        for ours, role in before:
            ours.role = role


def _check_bodies(
    things: tuple[bpy.types.Object, ...], parts: list[WorldPart], shown: VisibleObjects
) -> None:
    """Raise RigError for objects unfit as glass. The parts are those with faces."""
    met = {part.owner for part in parts}
    for thing in things:
        if by := shown.hidden_by(thing):
            raise RigError(
                "'{name}' is hidden{by}. Show it, or deselect it.",
                name=thing.name,
                by=by,
            )
        # one metaball has the surface of its whole family
        if thing not in met and (thing.type != "META" or not met):
            raise faceless(thing)

    for part in parts:
        name = (
            quoted([part.owner.name])
            if part.name == part.owner.name
            else Message("'{part}' of '{name}'", part=part.name, name=part.owner.name)
        )
        part.mesh.check(Message("The glass {glass}", glass=name))

        if part.mesh.is_flat:
            raise RigError(
                "{owner} is flat: add a Solidify modifier.",
                owner=name,
            )


def _ball_frame(scene: bpy.types.Scene) -> Floats:
    """The frame of a new ball, at the 3D cursor, Blender units."""
    at = np.eye(4)
    at[:3, 3] = scene.cursor.location
    return at


def _ball(scene: bpy.types.Scene, metres: float) -> Glass:
    """The ball for a rig without selected glass, as it will be read."""
    mesh = ball_mesh(BALL, BALL_RADIUS / metres)
    try:
        local = read_local(mesh, has_normals=True)
    finally:
        bpy.data.meshes.remove(mesh)
    world = np.diag([metres, metres, metres, 1.0]) @ _ball_frame(scene)
    return Glass(BALL, in_world(local, world)[0], ConstantIndex(DEFAULT_IOR))


def make_rig(
    scene: bpy.types.Scene,
    bench: RigSite,
    proposal: Proposal,
    viewer_resolution: tuple[int, int] | None,
    display_resolution: tuple[int, int],
) -> tuple[bpy.types.Collection, tuple[bpy.types.Object, ...]]:
    """Make the proposal's objects, and give the glasses their role, in overrides of linked ones.

    Returns the rig, now the active one, and the glasses.

    Parameters
    ----------
    viewer_resolution : None for the scene's render resolution
    """
    has_plate = proposal.placement.plate is not None
    with new_collection(scene, has_plate) as made, ExitStack() as undo:
        own = overridden(scene, bench.glasses)
        undo.callback(take_away, set(own) - set(bench.glasses))
        rig = made.collection
        for thing in own:
            _remember(undo, thing)
        for thing in own:
            _take_in(scene, thing, rig)
            see_through(thing, own)
        glasses = own or (_make_ball(scene, made),)
        _make_parts(scene, made, proposal, display_resolution)
        _make_viewer(scene, made, proposal, viewer_resolution)
        undo.pop_all()
    return rig, glasses


@contextmanager
def new_collection(scene: bpy.types.Scene, has_plate: bool) -> Iterator[Workbench]:
    """A new rig, active, to be filled within the context; removed again after an error."""
    with ExitStack() as undo:
        undo.callback(setattr, scene, "camera", scene.camera)
        undo.callback(setattr, scene.kiriko_scene, "rig", scene.kiriko_scene.rig)
        made = Workbench(scene, RIG)
        undo.callback(made.clear)
        rig = scene.kiriko_scene.rig = made.collection
        rig.kiriko.is_rig, rig.kiriko.has_plate = True, has_plate
        yield made
        mark_made(made.made)
        undo.pop_all()


def _remember(undo: ExitStack, thing: bpy.types.Object) -> None:
    """Restore a glass, its materials and its collections if making the rig fails."""
    ours = thing.kiriko
    for name in ("role", "taken_as", "is_made_glass", "is_drawn_by_edges"):
        undo.callback(setattr, ours, name, getattr(ours, name))
    undo.callback(setattr, thing, "display_type", thing.display_type)
    for material in {slot.material for slot in thing.material_slots} - {None}:
        undo.callback(setattr, material, "diffuse_color", tuple(material.diffuse_color))
        undo.callback(setattr, material.kiriko, "alpha_before", material.kiriko.alpha_before)
    for group in thing.users_collection:
        if group.is_editable:
            undo.callback(_link, group, thing)


def _link(group: bpy.types.Collection, thing: bpy.types.Object) -> None:
    if thing not in set(group.objects):
        group.objects.link(thing)


def _take_in(scene: bpy.types.Scene, thing: bpy.types.Object, rig: bpy.types.Collection) -> None:
    """Add an artist's object to the rig as glass. A copy of glass leaves the original's rig."""
    for other in rigs_of(scene)(thing) if is_copy(scene, thing) else ():
        other.objects.unlink(thing)
    rig.objects.link(thing)
    ours = thing.kiriko
    ours.taken_as = thing.name
    if ours.role != "GLASS":
        ours.role, ours.is_made_glass = "GLASS", True


def _make_ball(scene: bpy.types.Scene, made: Workbench) -> bpy.types.Object:
    ball = made.ball(BALL, _ball_frame(scene), BALL_RADIUS / length_of_unit(scene))
    ball.data.materials.append(
        made.material("Kiriko Glass", lambda m: be_seen_as_glass(m, DEFAULT_IOR))
    )
    ball.kiriko.role = "GLASS"
    return ball


def _make_parts(
    scene: bpy.types.Scene, made: Workbench, proposal: Proposal, pixels: tuple[int, int]
) -> None:
    """Plate, if the rig has one, picture and display."""
    metres = length_of_unit(scene)
    where = proposal.placement
    if where.plate is not None:
        make_plate(made, in_units(where.plate, metres), proposal.plate / metres)
    make_picture(made, in_units(where.picture, metres), proposal.picture / metres)
    make_display(made, in_units(where.display, metres), proposal.display / metres, pixels)


def _make_viewer(
    scene: bpy.types.Scene, made: Workbench, proposal: Proposal, resolution: tuple[int, int] | None
) -> None:
    """The viewer's camera, which becomes the scene's only if there is none."""
    metres = length_of_unit(scene)
    frame = in_units(proposal.placement.viewer, metres)
    viewer = make_viewer(made, frame, proposal.viewer_distance, proposal.field, metres)
    if resolution is not None:
        viewer.kiriko.use_resolution, viewer.kiriko.resolution = True, resolution

    scene.kiriko.viewer = viewer
    scene.camera = scene.camera or viewer
