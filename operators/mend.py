"""Mend a part: the buttons of the checklist that change an object, its mesh or the scene's unit."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import isclose, radians

import bmesh
import bpy
import numpy as np
from mathutils import Vector

from ..core.base.arrays import Ints
from ..core.base.errors import MeshError, RigError
from ..core.base.messages import Message, joined, quoted
from ..core.bench.placement import REFERENCE_BENCH
from ..core.blender.bodies import has_no_place, has_open_ends
from ..core.blender.cuts import cut_polygons
from ..core.blender.doubles import doubled_polygons
from ..core.blender.eyes import keep_eyes_apart
from ..core.blender.facets import n_facets
from ..core.blender.faults import faults_of
from ..core.blender.flaps import take_flaps, take_scraps
from ..core.blender.inspect_scene import sides_of
from ..core.blender.read_mesh import column, mesh_of
from ..core.blender.resize import move_by, scale_by
from ..core.blender.rigs import active_rig, marked_key
from ..core.blender.units import length_of_unit, length_text
from ..core.blender.viewer import viewer_of
from ..core.glass.smoothed import FACTOR
from . import needed, telling, work
from .framing import corners
from .parts import NamesPart

JOINED = 1e-5  # of an object's size: vertices nearer than this are one after Weld
THICKNESS = 0.1  # of its width: a thickness that a flat glass gets
WALL = 0.03  # of its width: the walls of a vessel that is drawn as one surface
WELD = "Kiriko Weld"
MOST_NAMED = 3  # objects that show the same mesh
SHARP = radians(30)


class MendsPart(NamesPart):
    """Mix-in for an operator that mends an object: `mend` does it and returns the sentence.

    changes_light : or does it only show where the fault is?
    may_be_linked : does it mend an object of another file, too?
    """

    bl_options = {"REGISTER", "UNDO"}
    changes_light = True
    may_be_linked = False

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            thing = self.found(context)
            if not self.may_be_linked:
                _check_own(thing, thing)
            telling.report(self, "INFO", self.mend(context, thing))
            if self.changes_light:
                work.forget_report(context.scene)
            return {"FINISHED"}

        return {"CANCELLED"}


def _check_own(thing: bpy.types.Object, block: bpy.types.ID) -> None:
    """Refuse what another file holds of an object, under the name that the artist knows."""
    if not block.is_editable:
        raise RigError("'{name}' is linked from another file: mend it there.", name=thing.name)


class KIRIKO_OT_leave_out(MendsPart, bpy.types.Operator):
    """Make this object no part of the rig; it stays where it is"""

    bl_idname = "kiriko.leave_out"
    bl_label = "Leave Out"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        thing.kiriko.role = "NONE"
        return Message("'{name}' is no part of the rig now: its role is None.", name=thing.name)


class KIRIKO_OT_reset_scale(MendsPart, bpy.types.Operator):
    """Reset the scale where it is 0, and location, rotation and scale where they are no numbers"""

    bl_idname = "kiriko.reset_scale"
    bl_label = "Reset Scale"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        for name in ("location", "rotation_euler", "rotation_quaternion", "scale"):
            plain = thing.bl_rna.properties[name].default_array
            values = zip(getattr(thing, name), plain, strict=True)
            is_scale = name == "scale"
            fit = [
                new if has_no_place([[value]]) or (is_scale and not value) else value
                for value, new in values
            ]
            setattr(thing, name, fit)
        return Message("'{name}' has a place and a size again.", name=thing.name)


class KIRIKO_OT_thicken(MendsPart, bpy.types.Operator):
    """Give a flat object a thickness, or one of a single surface walls, by a Solidify modifier"""

    bl_idname = "kiriko.thicken"
    bl_label = "Thicken"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        if thing.type not in {"MESH", "CURVE", "SURFACE", "FONT"}:
            raise RigError("'{name}' can have no modifier: turn it into a mesh.", name=thing.name)
        normal, is_one_sided = _as_shown(context, thing)
        _check_faces(thing, normal)
        sides = sides_of(context.scene, thing) or tuple(thing.dimensions)
        is_flat = min(sides) == 0
        size = abs(thing.matrix_world.to_3x3().determinant()) ** (1 / 3)
        across = _scale_along(thing, normal) if is_flat else size or 1.0
        modifier = thing.modifiers.new("Solidify", "SOLIDIFY")
        modifier.thickness = (THICKNESS if is_flat else WALL) * max(sides) / across
        modifier.offset = 0.0
        if is_one_sided:  # else each wall had one side, too
            modifier.solidify_mode = "NON_MANIFOLD"
        thickness = length_text(
            context.scene, modifier.thickness * across * length_of_unit(context.scene)
        )
        return Message(
            "'{name}' is {thickness} thick now, by the modifier '{modifier}'.",
            name=thing.name,
            thickness=thickness,
            modifier=modifier.name,
        )


def _as_shown(context: bpy.types.Context, thing: bpy.types.Object) -> tuple[Vector | None, bool]:
    """The normal of an object's first face as modifiers make it, in its own space, None where they
    leave none; and whether its surface has one side only.
    """
    with mesh_of(thing.evaluated_get(context.evaluated_depsgraph_get())) as mesh:
        if not len(mesh.polygons):
            return None, False
        return mesh.polygons[0].normal.copy(), faults_of(mesh).is_one_sided


def _scale_along(thing: bpy.types.Object, normal: Vector) -> float:
    """How many times as far as in an object's own space planes with a normal are in the world."""
    axes = thing.matrix_world.to_3x3()
    if abs(axes.determinant()) == 0:
        return 1.0
    return 1 / (axes.inverted().transposed() @ normal).length


def _check_faces(thing: bpy.types.Object, has_faces: object) -> None:
    """MeshError where there is nothing to mend."""
    if not has_faces:
        raise MeshError(
            "'{name}' has no faces that can be mended: draw some, or apply the modifiers that make"
            " them.",
            name=thing.name,
        )


def _mesh_of(thing: bpy.types.Object) -> bpy.types.Mesh:
    """An object's mesh, to be changed; MeshError where it has none, as a curve, RigError where
    it is another file's.
    """
    if thing.type != "MESH":
        raise MeshError("'{name}' is no mesh: turn it into one.", name=thing.name)
    _check_own(thing, thing.data)
    return thing.data


class MendsMesh(MendsPart):
    """Mix-in for an operator that changes an object's own faces: `mend_mesh` does it and returns
    the sentence. Others may show the same mesh, as after Alt D, and are named.
    """

    def mend_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        raise NotImplementedError

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        mesh = _mesh_of(thing)
        _check_faces(thing, mesh.polygons)
        return _and_others(self.mend_mesh(thing, mesh), thing)


def _and_others(told: Message, thing: bpy.types.Object) -> Message:
    """A sentence on a change of an object's data, and one on other objects that show the same."""
    others = [one.name for one in bpy.data.objects if one.data == thing.data and one != thing]
    if not others:
        return told
    named = quoted(others[:MOST_NAMED])
    if len(others) > MOST_NAMED:
        named = Message("{n} other objects", n=len(others))
    return joined([told, Message("Also changed, having the same data: {others}.", others=named)])


class KIRIKO_OT_merge_flat(MendsPart, bpy.types.Operator):
    """Remove triangles without area: merge their vertices, or divide their faces another way"""

    bl_idname = "kiriko.merge_flat"
    bl_label = "Remove Flat Triangles"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        mesh = _mesh_of(thing)
        n_before = faults_of(mesh).n_flat
        if n_before:
            _merge(mesh)
            told = Message(
                "{n} of {all} triangles without area are gone from '{name}'.",
                n=n_before - faults_of(mesh).n_flat,
                all=n_before,
                name=thing.name,
            )
            return _and_others(told, thing)

        return _welded(context, thing)


def _welded(context: bpy.types.Context, thing: bpy.types.Object) -> Message:
    """Join vertices that modifiers make, by one after them all; returns the sentence on it."""
    _check_faces(thing, _as_shown(context, thing)[0])
    if not thing.modifiers:
        raise MeshError("'{name}' has no such faces any more: nothing is changed.", name=thing.name)
    modifier = thing.modifiers.new(WELD, "WELD")
    modifier.merge_threshold = _near(thing.data)
    return Message(
        "Modifiers make them: '{modifier}', the last one of '{name}', joins their vertices.",
        modifier=modifier.name,
        name=thing.name,
    )


def _near(mesh: bpy.types.Mesh) -> float:
    """Vertices of a mesh that are nearer than this are one, in the object's own units."""
    return JOINED * max((vertex.co.length for vertex in mesh.vertices), default=1.0)


@contextmanager
def _edited(mesh: bpy.types.Mesh) -> Iterator[bmesh.types.BMesh]:
    """A mesh as bmesh has it, to be changed; the mesh is changed at the end."""
    shape = bmesh.new()
    try:
        shape.from_mesh(mesh)
        yield shape
        shape.to_mesh(mesh)
    finally:
        shape.free()
    mesh.update()


def _merge(mesh: bpy.types.Mesh) -> None:
    """Take triangles without area out of a mesh: first those that are short, then those whose
    corners lie in a line, which a larger face is divided into.
    """
    distance = _near(mesh)
    with _edited(mesh) as shape:
        bmesh.ops.dissolve_degenerate(shape, dist=distance, edges=shape.edges[:])
        shape.to_mesh(mesh)
        is_flat = faults_of(mesh).is_flat
        if is_flat.any():
            shape.faces.ensure_lookup_table()
            faces = [shape.faces[k] for k in np.flatnonzero(is_flat)]
            bmesh.ops.triangulate(shape, faces=faces, ngon_method="EAR_CLIP", quad_method="BEAUTY")
            bmesh.ops.dissolve_degenerate(shape, dist=distance, edges=shape.edges[:])


class KIRIKO_OT_remove_doubles(MendsPart, bpy.types.Operator):
    """Remove faces that lie on others of the mesh, as Shift D leaves them where nothing is moved"""

    bl_idname = "kiriko.remove_doubles"
    bl_label = "Remove Double Faces"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        mesh = _mesh_of(thing)
        doubles = np.flatnonzero(doubled_polygons(mesh))
        if not len(doubles):
            return _welded(context, thing)

        with _edited(mesh) as shape:
            shape.faces.ensure_lookup_table()
            faces = [shape.faces[k] for k in doubles]
            bmesh.ops.delete(shape, geom=faces, context="FACES")
            _merge_open(shape, _near(mesh))
        told = Message("{n} double faces are gone from '{name}'.", n=len(doubles), name=thing.name)
        return _and_others(told, thing)


class KIRIKO_OT_remove_inner(MendsMesh, bpy.types.Operator):
    """Remove faces inside the glass, as booleans leave them, and walls between joined parts"""

    bl_idname = "kiriko.remove_inner"
    bl_label = "Remove Inner Faces"

    def mend_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        inner = np.flatnonzero(faults_of(mesh).is_inner)
        with _edited(mesh) as shape:
            shape.faces.ensure_lookup_table()
            faces = [shape.faces[k] for k in inner]
            bmesh.ops.delete(shape, geom=faces, context="FACES")
        return Message("{n} inner faces are gone from '{name}'.", n=len(inner), name=thing.name)


class KIRIKO_OT_fill_holes(MendsMesh, bpy.types.Operator):
    """Close holes with faces, the mouth of a vessel, too; loose faces go, and tubes get caps"""

    bl_idname = "kiriko.fill_holes"
    bl_label = "Fill Holes"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        if not has_open_ends(thing):
            return super().mend(context, thing)
        _check_own(thing, thing.data)
        thing.data.use_fill_caps = True
        return _and_others(Message("The ends of '{name}' have caps now.", name=thing.name), thing)

    def mend_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        n_before = faults_of(mesh).n_open
        with _edited(mesh) as shape:
            n_loose = take_flaps(shape)
            _merge_open(shape, _near(mesh))
            n_loose += take_scraps(shape)
            _fill(shape)

        n = faults_of(mesh).n_open
        told = [Message("All holes of '{name}' are closed.", name=thing.name)]
        if n:
            text = Message(
                "{n} of {all} open edges of '{name}' are closed; press Select for the others.",
                n=n_before - n,
                all=n_before,
                name=thing.name,
            )
            told = [text]
        if n_loose:
            s = "s" if n_loose > 1 else ""
            told.append(Message("Loose faces are gone: {n} face{s}.", n=n_loose, s=s))
        return joined(told)


def _fill(shape: bmesh.types.BMesh) -> None:
    """Fill holes with faces that look, shade and shine as those around them."""
    holes = [edge for edge in shape.edges if edge.is_boundary]
    made = bmesh.ops.holes_fill(shape, edges=holes, sides=0)["faces"]
    bmesh.ops.face_attribute_fill(shape, faces=made, use_normals=True, use_data=True)


def _merge_open(shape: bmesh.types.BMesh, distance: float) -> None:
    """Join vertices along open edges that are nearer than a distance."""
    ends = {vertex for edge in shape.edges if edge.is_boundary for vertex in edge.verts}
    bmesh.ops.remove_doubles(shape, verts=list(ends), dist=distance)


class KIRIKO_OT_turn_out(MendsMesh, bpy.types.Operator):
    """Turn faces of the mesh round that look into the glass, so that all look out of it"""

    bl_idname = "kiriko.turn_out"
    bl_label = "Turn Out"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        turning = [one for one in thing.modifiers if one.type == "SCREW" and one.show_viewport]
        is_profile = thing.type == "MESH" and thing.data.edges and not thing.data.polygons
        if not is_profile or len(turning) != 1:
            return super().mend(context, thing)
        (screw,) = turning  # all the faces are its own
        screw.use_normal_flip = not screw.use_normal_flip
        return self._done(thing)

    def mend_mesh(self, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> Message:
        if not _turn_out(mesh):
            mesh.flip_normals()
            mesh.update()
        return self._done(thing)

    def _done(self, thing: bpy.types.Object) -> Message:
        return Message("The faces of '{name}' look out now.", name=thing.name)


def _turn_out(mesh: bpy.types.Mesh) -> bool:
    """Have all faces look out of the glass, if some look the other way than those beside them; do
    they? Normals that the mesh was given, which are wrong there, are its own again.
    """
    chosen = np.flatnonzero(faults_of(mesh).is_turned)
    if not len(chosen):
        return False
    had_normals = _clear_normals(mesh)
    with _edited(mesh) as shape:
        shape.faces.ensure_lookup_table()
        bmesh.ops.reverse_faces(shape, faces=[shape.faces[k] for k in chosen])
    if faults_of(mesh).is_inside_out:
        mesh.flip_normals()
        mesh.update()
    if had_normals:
        _mark_sharp(mesh)
    return True


def _clear_normals(mesh: bpy.types.Mesh) -> bool:
    """Take custom normals from a mesh, and the sharp edges that come with them; had it any?"""
    if not mesh.has_custom_normals:
        return False
    with bpy.context.temp_override(mesh=mesh):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()
    mesh.edges.foreach_set("use_edge_sharp", [False] * len(mesh.edges))
    mesh.update()
    return True


def _mark_sharp(mesh: bpy.types.Mesh) -> None:
    """Mark edges at more than 30 degrees as sharp, too."""
    own = column(mesh.edges, "use_edge_sharp", 1, bool)
    mesh.set_sharp_from_angle(angle=SHARP)
    mesh.edges.foreach_set("use_edge_sharp", own | column(mesh.edges, "use_edge_sharp", 1, bool))
    mesh.update()


class KIRIKO_OT_shade_smooth(MendsPart, bpy.types.Operator):
    """Merge faces that touch, recalculate normals, and shade smooth below 30 degrees"""

    bl_idname = "kiriko.shade_smooth"
    bl_label = "Shade Smooth"

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        if thing.type in {"CURVE", "SURFACE"}:
            _check_own(thing, thing.data)
            for spline in thing.data.splines:
                spline.use_smooth = True
            told = Message("'{name}' is shaded smooth now.", name=thing.name)
            return _and_others(told, thing)
        mesh = _mesh_of(thing)
        _clear_normals(mesh)
        n_joined = _join(mesh)
        if faults_of(mesh).n_flat:
            _merge(mesh)
        is_turned = _turn_out(mesh)
        turning = [m for m in thing.modifiers if hasattr(m, "use_smooth_shade")]  # such as Screw
        _check_faces(thing, mesh.polygons or turning)
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
        _mark_sharp(mesh)
        for modifier in turning:
            modifier.use_smooth_shade = True
        told = Message("'{name}' is shaded smooth now, but for its sharp edges.", name=thing.name)
        if n_joined:
            text = Message("{n} vertices that lay in the same places are one each.", n=n_joined)
            told = joined([told, text])
        if is_turned:
            text = Message("The faces of '{name}' look out now.", name=thing.name)
            told = joined([told, text])
        n_left = _shown_facets(context, thing)
        if n_left:
            text = Message(
                "{n} faces that modifiers make are still flat: shade them smooth where they are"
                " made, or apply the modifiers first.",
                n=n_left,
            )
            told = joined([told, text])
        return _and_others(told, thing)


class KIRIKO_OT_smooth_glass(MendsPart, bpy.types.Operator):
    """Smooth bumps that scatter the picture, by a Smooth modifier, and shade the faces smooth"""

    bl_idname = "kiriko.smooth_glass"
    bl_label = "Smooth Glass"

    iterations: bpy.props.IntProperty(
        name="Iterations",
        description="Of the Smooth modifier: more make the glass smoother and smaller",
        default=10,
        min=1,
        options={"SKIP_SAVE"},
    )

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        mesh = _mesh_of(thing)
        _check_faces(thing, mesh.polygons)
        _clear_normals(mesh)
        _join(mesh)
        _turn_out(mesh)
        mesh.shade_smooth()
        modifier = thing.modifiers.new("Smooth", "SMOOTH")
        modifier.factor, modifier.iterations = FACTOR, self.iterations
        return _and_others(
            Message(
                "'{name}' is smoothed now, by the modifier '{modifier}'.",
                name=thing.name,
                modifier=modifier.name,
            ),
            thing,
        )


def _shown_facets(context: bpy.types.Context, thing: bpy.types.Object) -> int:
    """How many faces of an object look flat where a curve seems meant, as its modifiers make it."""
    with mesh_of(thing.evaluated_get(context.evaluated_depsgraph_get())) as mesh:
        return n_facets(mesh, faults_of(mesh).one) if len(mesh.polygons) else 0


def _join(mesh: bpy.types.Mesh) -> int:
    """Have faces that lie edge to edge share vertices, as in files that list triangle by triangle:
    else each would be flat, however it is shaded. Returns how many vertices went.
    """
    one = faults_of(mesh).one
    if (one == np.arange(len(one))).all():
        return 0
    n_before = len(mesh.vertices)
    with _edited(mesh) as shape:
        _merge_open(shape, _near(mesh))
    return n_before - len(mesh.vertices)


FAULTS = (
    ("OPEN", "Open Edges", "Edges with one face, or more than two"),
    ("FLAT", "Flat Faces", "Faces with triangles without area"),
    ("CUT", "Cut Faces", "Faces that other faces of the glass pass through"),
    ("DOUBLE", "Double Faces", "Faces that lie on others of the mesh"),
    ("INNER", "Inner Faces", "Faces inside the body that the others make"),
)


class KIRIKO_OT_select_faults(MendsPart, bpy.types.Operator):
    """Go to edit mode, with the faults of the mesh selected"""

    bl_idname = "kiriko.select_faults"
    bl_label = "Select Faults"
    changes_light = False

    kind: bpy.props.EnumProperty(
        name="Faults", description="The faults to select", items=FAULTS, options={"SKIP_SAVE"}
    )

    def mend(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        mesh = _mesh_of(thing)
        _check_faces(thing, mesh.polygons)
        bpy.ops.kiriko.select_part(part=self.part, library=self.library)
        is_open = self.kind == "OPEN"
        chosen = _found(mesh, self.kind)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_mode(type="EDGE" if is_open else "FACE")
        bpy.ops.mesh.reveal(select=False)
        bpy.ops.mesh.select_all(action="DESELECT")
        shape = bmesh.from_edit_mesh(mesh)
        members = shape.edges if is_open else shape.faces
        members.ensure_lookup_table()
        for k in chosen:
            members[k].select_set(True)
        shape.select_flush_mode()
        bmesh.update_edit_mesh(mesh)

        if is_open:
            return Message(
                "{n} open edges of '{name}' are selected: F fills, M merges.",
                n=len(chosen),
                name=thing.name,
            )
        if self.kind == "CUT":
            return Message(
                "{n} faces of '{name}' that cut each other are selected: move or smooth them.",
                n=len(chosen),
                name=thing.name,
            )
        if self.kind == "DOUBLE":
            return Message(
                "{n} faces of '{name}' that lie on others are selected: X deletes them.",
                n=len(chosen),
                name=thing.name,
            )
        if self.kind == "INNER":
            return Message(
                "{n} faces inside '{name}' are selected: X deletes them.",
                n=len(chosen),
                name=thing.name,
            )
        return Message(
            "{n} faces of '{name}' without area are selected.", n=len(chosen), name=thing.name
        )


def _found(mesh: bpy.types.Mesh, kind: str) -> Ints:
    """Numbers of a mesh's edges or polygons that have a fault."""
    if kind == "CUT":
        return np.flatnonzero(cut_polygons(mesh))
    if kind == "DOUBLE":
        return np.flatnonzero(doubled_polygons(mesh))
    faults = faults_of(mesh)
    found = {"OPEN": faults.is_open, "FLAT": faults.is_flat, "INNER": faults.is_inner}
    return np.flatnonzero(found[kind])


class KIRIKO_OT_rescale_scene(bpy.types.Operator):
    """Change the scene's unit; parts that Add Rig made keep sizes that can be built"""

    bl_idname = "kiriko.rescale_scene"
    bl_label = "Rescale Scene"
    bl_options = {"REGISTER", "UNDO"}

    factor: bpy.props.FloatProperty(
        name="Factor",
        description="Times as large as it was is the scene then",
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
            "A unit of the scene is {length} now (Scene > Units), and all is {factor} times as"
            " large.",
            length=length_text(context.scene, unit),
            factor=f"{self.factor:g}",
        )
        with telling.told(self):
            if _keep_bench(context, before, unit):
                text = joined([text, Message("The rig's own parts keep sizes that can be built.")])
            telling.report(self, "INFO", text)
        return {"FINISHED"}


def _keep_bench(context: bpy.types.Context, before: float, after: float) -> bool:
    """Move what Add Rig made, where the scene's unit (m) was changed, to the distances that it has
    from glass of the new size. Returns whether anything was moved.

    Distances and the plate grow with glass that is larger than `REFERENCE_BENCH.large_m`; the
    picture, the viewer's field, and a display without a plate are always as the glass is.
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
    # the display is the picture's mirror image in a plate; without one it stays at the glass
    middle = np.array(next(iter(pictures)).matrix_world.translation)
    if not plates:
        points = np.concatenate([corners(thing) for thing in glasses])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
    moved = [thing for thing in (*plates, *(parts.get("DISPLAY", ()) if plates else ()))]
    for thing in (*moved, viewer_of(scene)):
        if thing is None or marked_key(thing) != rig.kiriko.key:
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
        with suppress(RuntimeError):  # no light arrives: the checklist tells why
            bpy.ops.kiriko.fit_display()
    return True
