"""Buttons of the checklist that change an object, its mesh, or the scene's unit."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import isclose, radians

import bmesh
import bpy
import numpy as np

from ..core.base.errors import MeshError, RigError
from ..core.base.messages import Message, as_message
from ..core.bench.placement import REFERENCE_BENCH
from ..core.blender.checks.faults import counts_of
from ..core.blender.checks.inspect_scene import sides_of
from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.data.rigs import RIG_MARK, active_rig
from ..core.blender.data.units import length_of_unit, length_text
from ..core.blender.lifecycle.eyes import keep_eyes_apart
from ..core.blender.read.read_mesh import column
from ..core.blender.read.resize import move_by, scale_by
from ..core.glass.smoothed import FACTOR
from . import needed, reporting, work
from .framing import corners
from .part_verbs import NamesPart

JOINED = 1e-5  # of a mesh's size: closer vertices are merged
THICKNESS = 0.1  # of its width: thickness for flat glass
WALL = 0.03  # of its width: the walls of a vessel that is drawn as one surface
SHARP = radians(30)


class RepairsPart(NamesPart):
    """Mix-in for an operator that repairs an object: `repair` does it and returns the report.

    may_be_linked : whether it works on an object of another file as well
    """

    bl_options = {"REGISTER", "UNDO"}
    may_be_linked = False

    def repair(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            thing = self.found(context)
            if not self.may_be_linked:
                _check_own(thing, thing)
            reporting.report(self, "INFO", self.repair(context, thing))
            work.forget_report(context.scene)
            return {"FINISHED"}

        return {"CANCELLED"}


def _check_own(thing: bpy.types.Object, block: bpy.types.ID) -> None:
    """Refuse a linked object or mesh, under the name the artist sees."""
    if not block.is_editable:
        raise RigError(
            "'{name}' is linked from another file: change it there, or make it local.",
            name=thing.name,
        )


def _check_faces(thing: bpy.types.Object, has_faces: object) -> None:
    """Raise MeshError if there is nothing to repair."""
    if not has_faces:
        raise MeshError(
            "'{name}' has no faces of its own: apply the modifiers that make them.",
            name=thing.name,
        )


class KIRIKO_OT_leave_out(RepairsPart, bpy.types.Operator):
    """Take this object out of the rig; it stays in the scene"""

    bl_idname = "kiriko.leave_out"
    bl_label = "Leave Out"

    def repair(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        thing.kiriko.role = "NONE"
        return Message("'{name}' isn't in the rig now.", name=thing.name)


class KIRIKO_OT_thicken(RepairsPart, bpy.types.Operator):
    """Give a flat or open object thickness with a Solidify modifier"""

    bl_idname = "kiriko.thicken"
    bl_label = "Thicken"

    def repair(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        if thing.type not in {"MESH", "CURVE", "SURFACE", "FONT"}:
            raise RigError(
                "'{name}' isn't a mesh: convert it with Object > Convert > Mesh.", name=thing.name
            )
        sides = sides_of(context.scene, thing) or tuple(thing.dimensions)
        _check_faces(thing, max(sides))
        size = abs(thing.matrix_world.to_3x3().determinant()) ** (1 / 3) or 1.0
        modifier = thing.modifiers.new("Solidify", "SOLIDIFY")
        modifier.thickness = (WALL if min(sides) else THICKNESS) * max(sides) / size
        modifier.offset = 0.0
        return Message(
            "Added the modifier '{modifier}' to '{name}'.",
            name=thing.name,
            modifier=modifier.name,
        )


class RepairsMesh(RepairsPart):
    """Mix-in for an operator that changes an object's own faces with Blender's mesh operators.

    `repair_mesh` does it and returns the report.
    """

    def repair_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        raise NotImplementedError

    def repair(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        if thing.type != "MESH":
            raise MeshError(
                "'{name}' isn't a mesh: convert it with Object > Convert > Mesh.", name=thing.name
            )
        _check_own(thing, thing.data)
        _check_faces(thing, thing.data.polygons)
        return self.repair_mesh(thing, thing.data)

    def applied_to(self, thing: bpy.types.Object) -> Message:
        """The report that it was done to an object."""
        return Message(
            "Applied {button} to '{name}'.", button=as_message(self.bl_label), name=thing.name
        )


@contextmanager
def _edited(mesh: bpy.types.Mesh) -> Iterator[bmesh.types.BMesh]:
    """A mesh as bmesh; changes are written back at the end."""
    shape = bmesh.new()
    try:
        shape.from_mesh(mesh)
        yield shape
        shape.to_mesh(mesh)
    finally:
        shape.free()
    mesh.update()


def _merge(mesh: bpy.types.Mesh) -> None:
    """Merge vertices by distance, and dissolve degenerate faces."""
    distance = JOINED * float(np.ptp(column(mesh.vertices, "co", 3, np.float32), axis=0).max())
    with _edited(mesh) as shape:
        bmesh.ops.remove_doubles(shape, verts=shape.verts[:], dist=distance)
        bmesh.ops.dissolve_degenerate(shape, dist=distance, edges=shape.edges[:])


def _turn_out(mesh: bpy.types.Mesh) -> None:
    """Recalculate normals if any face is flipped; custom normals are cleared then."""
    had_normals = _clear_normals(mesh)
    counts = counts_of(mesh)
    if counts.n_turned or counts.is_inside_out:
        with _edited(mesh) as shape:
            bmesh.ops.recalc_face_normals(shape, faces=shape.faces[:])
    if had_normals:
        _mark_sharp(mesh)


def _clear_normals(mesh: bpy.types.Mesh) -> bool:
    """Remove custom normals and the sharp edges that come with them; returns whether there were
    any.
    """
    if not mesh.has_custom_normals:
        return False
    with bpy.context.temp_override(mesh=mesh):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()
    mesh.edges.foreach_set("use_edge_sharp", [False] * len(mesh.edges))
    mesh.update()
    return True


def _mark_sharp(mesh: bpy.types.Mesh) -> None:
    """Also mark edges above 30 degrees as sharp."""
    own = column(mesh.edges, "use_edge_sharp", 1, bool)
    mesh.set_sharp_from_angle(angle=SHARP)
    mesh.edges.foreach_set("use_edge_sharp", own | column(mesh.edges, "use_edge_sharp", 1, bool))
    mesh.update()


class KIRIKO_OT_fill_holes(RepairsMesh, bpy.types.Operator):
    """Merge by distance and fill all holes, including the mouth of a vessel"""

    bl_idname = "kiriko.fill_holes"
    bl_label = "Fill Holes"

    def repair_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        _merge(mesh)
        with _edited(mesh) as shape:
            holes = [edge for edge in shape.edges if edge.is_boundary]
            made = bmesh.ops.holes_fill(shape, edges=holes, sides=0)["faces"]
            bmesh.ops.face_attribute_fill(shape, faces=made, use_normals=True, use_data=True)
        n = counts_of(mesh).n_open
        if n:
            return Message("'{name}' still has {n} open edges.", n=n, name=thing.name)
        return self.applied_to(thing)


class KIRIKO_OT_turn_out(RepairsMesh, bpy.types.Operator):
    """Recalculate normals so that all faces point outward"""

    bl_idname = "kiriko.turn_out"
    bl_label = "Recalculate Normals"

    def repair_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        _turn_out(mesh)
        return self.applied_to(thing)


class KIRIKO_OT_shade_smooth(RepairsMesh, bpy.types.Operator):
    """Merge by distance, recalculate normals, and shade smooth below 30 degrees"""

    bl_idname = "kiriko.shade_smooth"
    bl_label = "Shade Smooth"

    def repair_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        _clear_normals(mesh)
        _merge(mesh)
        _turn_out(mesh)
        mesh.shade_smooth()
        _mark_sharp(mesh)
        return Message(
            "'{name}': merged, normals recalculated, and shaded smooth.", name=thing.name
        )


class KIRIKO_OT_smooth_glass(RepairsMesh, bpy.types.Operator):
    """Smooth bumps that scatter the picture with a Smooth modifier, and shade smooth"""

    bl_idname = "kiriko.smooth_glass"
    bl_label = "Smooth Glass"

    iterations: bpy.props.IntProperty(
        name="Iterations",
        description="Repeats of the Smooth modifier; more make the glass smoother and smaller",
        default=10,
        min=1,
        options={"SKIP_SAVE"},
    )

    def repair_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        _clear_normals(mesh)
        _merge(mesh)
        _turn_out(mesh)
        mesh.shade_smooth()
        modifier = thing.modifiers.new("Smooth", "SMOOTH")
        modifier.factor, modifier.iterations = FACTOR, self.iterations
        return Message(
            "Added the modifier '{modifier}' to '{name}'.",
            name=thing.name,
            modifier=modifier.name,
        )


class KIRIKO_OT_rescale_scene(bpy.types.Operator):
    """Change the scene's unit scale; Kiriko's parts alone move, if the glass's new size needs it"""

    bl_idname = "kiriko.rescale_scene"
    bl_label = "Rescale Scene"
    bl_options = {"REGISTER", "UNDO"}

    factor: bpy.props.FloatProperty(
        name="Factor",
        default=0.01,
        min=1e-6,
        max=1e6,
        precision=4,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [])

    def execute(self, context: bpy.types.Context) -> set[str]:
        units = context.scene.unit_settings
        before = length_of_unit(context.scene)
        unit = self.factor * before
        keep_eyes_apart(context.scene, before, unit)
        if units.system == "NONE":
            units.system = "METRIC"
        units.scale_length = unit
        if units.system == "METRIC":
            units.length_unit = "MILLIMETERS"
        work.forget_report(context.scene)
        text = Message(
            "One unit of the scene is now {length} (Scene > Units); everything is {factor} times"
            " as large.",
            length=length_text(context.scene, unit),
            factor=f"{self.factor:g}",
        )
        with reporting.errors_reported(self):
            _keep_bench(context, before, unit)
            reporting.report(self, "INFO", text)
        return {"FINISHED"}


def _keep_bench(context: bpy.types.Context, before: float, after: float) -> bool:
    """Move parts from Add Rig to suit the glass after a change of the scene's unit (m).

    Returns whether anything moved. Distances and the plate grow with glass above
    `REFERENCE_BENCH.large_m`; the picture, the viewer's field, and a display without a plate always
    follow the glass.
    """
    scene = context.scene
    rig = active_rig(scene)
    parts = needed.parts(scene)
    pictures, glasses = parts.get("PICTURE", ()), parts.get("GLASS", ())
    if rig is None or not rig.is_editable or not pictures or not glasses:
        return False
    width = max(max(sides_of(scene, thing, None), default=0.0) for thing in glasses)
    grown = [max(1.0, width * unit / REFERENCE_BENCH.large_m) for unit in (before, after)]
    factor = grown[1] / grown[0] * before / after
    if isclose(factor, 1.0, rel_tol=1e-6):
        return False

    plates = parts.get("PLATE", ())
    # The display is the picture's image in the plate; without a plate it stays at the glass.
    middle = np.array(next(iter(pictures)).matrix_world.translation)
    if not plates:
        points = np.concatenate([corners(thing) for thing in glasses])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
    moved = [thing for thing in (*plates, *(parts.get("DISPLAY", ()) if plates else ()))]
    for thing in (*moved, viewer_of(scene)):
        if thing is None or RIG_MARK not in thing:
            continue
        shift = (factor - 1) * (np.array(thing.matrix_world.translation) - middle)
        if thing in plates:
            scale_by(context, thing, factor, shift)
        else:
            move_by(context, thing, shift)
        if thing.type == "CAMERA":
            thing.data.lens *= factor
            thing.data.stereo.convergence_distance *= factor
    if plates:
        with suppress(RuntimeError):  # no light arrives; the checklist reports why
            bpy.ops.kiriko.fit_display()
    return True
