"""The parts of a preview's scene: copies in materials that obey Kiriko's laws, curved glass as a
fine mesh.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...base.errors import RigError
from ...bench.offset import part_motions
from ...glass.tessellate import tessellate
from ...rig.pupil import focus_of
from ...rig.rig import ROLES, Mesh, Rig
from ..data.camera_viewer import viewer_of
from ..data.made_objects import OBJECT_MARK, give_normals
from ..data.temporary import mark
from ..data.units import length_of_unit
from ..read.part_roles import InBlender, Studio, in_blender
from ..read.read_mesh import sharpen_creases
from ..read.scene import Reading, object_matrix
from ..read.scene_parts import part_name, shown_parts


def mesh_from_triangles(name: str, drawn: Mesh, metres: float) -> tuple[bpy.types.Mesh, Matrix]:
    """A Blender mesh of triangles in the world, with their corner normals; the inverse of
    `in_world`.

    Each triangle has vertices of its own: normals can then differ between neighbours without sharp
    edges.

    Parameters
    ----------
    metres : in a Blender unit

    Returns
    -------
    the mesh about its own centre, where float32 is most exact, and its matrix in the world
    """
    middle = drawn.bounds.mean(axis=0)
    n = len(drawn.triangles)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(3 * n)
    mesh.loops.add(3 * n)
    mesh.polygons.add(n)
    mesh.vertices.foreach_set("co", ((drawn.corners - middle) / metres).astype(np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", np.arange(3 * n, dtype=np.int32))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * n, 3, dtype=np.int32))
    is_smooth = np.zeros(n, bool) if drawn.is_smooth is None else drawn.is_smooth
    mesh.polygons.foreach_set("use_smooth", is_smooth)
    mesh.update(calc_edges=True)

    if drawn.corner_normals is not None:
        give_normals(mesh, drawn.corner_normals.reshape(-1, 3))
    return mesh, Matrix.Translation((middle / metres).tolist())


LEAST_SHEAR = 1e-6  # of an object's scale: less shear is rounding


class PreviewParts:
    """Fills a preview's scene.

    Parameters
    ----------
    made : the scene to fill
    reading : the rig, with its indices of refraction
    studio : common settings of the parts' looks

    Attributes
    ----------
    notes : reasons why the render is not comparable
    """

    def __init__(self, made: bpy.types.Scene, reading: Reading, studio: Studio) -> None:
        self.notes: list[str] = []
        self._made = made
        self._reading = reading
        self._studio = studio
        self._looks = {}

        for role in ROLES:
            if role.number is not None:
                looks, notes = in_blender(role.name).looks(reading.rig)
                self._looks[role.name] = looks
                self.notes += notes

        self._curved = _curved_meshes(reading.rig)
        self._offsets = {
            name: Matrix(object_matrix(motion.rotation, motion.shift, studio.metres).tolist())
            for name, motion in part_motions(reading.drawn, reading.rig).items()
        }
        self._copies: dict[tuple[object, ...], bpy.types.Mesh] = {}

    def add_parts(
        self, depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene
    ) -> set[bpy.types.Object]:
        """Put a copy of each part into the scene.

        Returns the user's objects replaced by copies, including their instancers.
        """
        replaced = set()
        counts: Counter[str] = Counter()

        for instance, owner in shown_parts(depsgraph, scene):
            if instance.object.type != "MESH":
                continue
            name = part_name(instance, counts)
            replaced |= {owner, instance.object.original}
            if instance.is_instance:
                replaced.add(instance.parent.original)
            self._add_part(name, instance, owner)

        return replaced

    def _add_part(
        self, name: str, instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object
    ) -> None:
        """Add a copy of a part, if it is visible in previews."""
        ours = in_blender(owner.kiriko.role)
        looks = self._looks[owner.kiriko.role]
        if ours.shade is None or (looks is not None and name not in looks):
            return

        look = None if looks is None else looks[name]

        if name in self._curved:
            mesh, matrix = self._tessellated(self._curved[name], ours.is_inside_out(look))
            mesh.materials.append(self._material(ours, owner, look))
        else:
            mesh, matrix = self._copied(name, instance, owner, look)

        thing = mark(bpy.data.objects.new(f"Kiriko Preview {name}", mesh))
        thing.matrix_world = matrix
        self._made.collection.objects.link(thing)

    def _material(self, ours: InBlender, owner: bpy.types.Object, look: Any) -> bpy.types.Material:
        """A new material with the look of a part."""
        name = f"Kiriko Preview {owner.kiriko.role.title()}"
        material = mark(bpy.data.materials.new(name))
        ours.shade(material, look, self._studio)
        return material

    def _tessellated(self, mesh: Mesh, is_inside_out: bool) -> tuple[bpy.types.Mesh, Matrix]:
        """A curved surface as fine triangles with outward normals, and its matrix."""
        if is_inside_out:
            normals = None if mesh.corner_normals is None else -mesh.corner_normals[:, ::-1]
            mesh = replace(mesh, triangles=mesh.triangles[:, ::-1], corner_normals=normals)
        made, matrix = mesh_from_triangles("Kiriko Preview Surface", mesh, self._studio.metres)
        return mark(made), matrix

    def _copied(
        self,
        name: str,
        instance: bpy.types.DepsgraphObjectInstance,
        owner: bpy.types.Object,
        look: Any,
    ) -> tuple[bpy.types.Mesh, Matrix]:
        """The evaluated mesh of an object in one material, shared by equal ones, and its matrix."""
        ours = owner.kiriko
        there = self._offsets.get(name, Matrix()) @ instance.matrix_world
        matrix, shear = _without_shear(there)
        key = instance.object.data.as_pointer(), ours.role, ours.surface, look, shear
        if key not in self._copies:
            role = in_blender(ours.role)
            material = self._material(role, owner, look)
            mesh = self._copies[key] = _copy(instance.object, ours.surface, material)
            if shear is not None:
                mesh.transform(Matrix(shear))
            if role.is_inside_out(look):
                mesh.flip_normals()  # Cycles separates inside from outside by the normals

        return self._copies[key], matrix

    def add_camera(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Put the viewer into the scene, as evaluated and calibrated."""
        viewer = viewer_of(scene)
        if viewer is None or viewer.type != "CAMERA":
            raise RigError(
                "The rig has no {noun}: {remedy}.",
                noun=ROLES[0].noun,
                remedy=ROLES[0].remedy,
            )

        evaluated = viewer.evaluated_get(depsgraph)
        camera = mark(evaluated.data.original.copy())
        camera.animation_data_clear()

        for name in ("lens", "ortho_scale", "shift_x", "shift_y", "sensor_width", "sensor_height"):
            # evaluated values, which may be animated or driven
            setattr(camera, name, getattr(evaluated.data, name))

        rigs = self._reading.drawn, self._reading.rig
        drawn, window = (np.ptp(rig.viewers[0].window[:2]) for rig in rigs)
        camera.lens = camera.lens * drawn / window
        camera.ortho_scale = camera.ortho_scale * window / drawn
        _set_pupil(camera, self._reading.rig, length_of_unit(scene))
        camera.clip_start = min(camera.clip_start, 1e-4)

        thing = mark(bpy.data.objects.new("Kiriko Preview Viewer", camera))
        thing.matrix_world = self._offsets.get(viewer.name, Matrix()) @ evaluated.matrix_world
        self._made.collection.objects.link(thing)
        self._made.camera = thing


def _set_pupil(camera: bpy.types.Camera, rig: Rig, metres: float) -> None:
    """Give a preview's camera the depth of field of the rig's first viewer."""
    viewer, dof = rig.viewers[0], camera.dof
    dof.use_dof = viewer.pupil > 0
    if dof.use_dof:
        dof.focus_object = None
        dof.focus_distance = focus_of(rig.place_of(viewer), viewer) / metres
        dof.aperture_fstop = 1e-3 * camera.lens * metres / viewer.pupil
        dof.aperture_blades, dof.aperture_ratio = 0, 1.0


def add_surroundings(
    made: bpy.types.Scene,
    scene: bpy.types.Scene,
    layer: bpy.types.ViewLayer,
    replaced: set[bpy.types.Object],
) -> None:
    """Put the world and the artist's remaining objects without a role into a temporary scene."""
    made.world = scene.world
    for thing in _seen_in_render(layer.layer_collection):
        if thing.kiriko.role == "NONE" and thing not in replaced and OBJECT_MARK not in thing:
            made.collection.objects.link(thing)


def _copy(shown: bpy.types.Object, surface: str, material: bpy.types.Material) -> bpy.types.Mesh:
    """The evaluated mesh of an object, in one material."""
    mesh = mark(bpy.data.meshes.new_from_object(shown))
    if surface != "FACETS":
        sharpen_creases(mesh, shown.original)
    mesh.materials.clear()
    mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", np.zeros(len(mesh.polygons), np.int32))
    return mesh


def _without_shear(matrix: Matrix) -> tuple[Matrix, tuple[tuple[float, ...], ...] | None]:
    """A matrix an object can have, with the same x axis, and the transform to apply to its mesh
    first, if any.

    Objects have a location, a rotation and a scale; parents with uneven scale add shear.
    """
    columns = np.array(matrix, float)[:3, :3]
    turned, upper = np.linalg.qr(columns)
    sign = np.where(np.diag(upper) < 0, -1.0, 1.0)
    turned = turned * sign
    upper = upper * sign[:, None]
    scale = np.diag(upper)
    if not (scale > 0).all() or np.abs(upper - np.diag(scale)).max() <= LEAST_SHEAR * scale.max():
        return matrix, None

    place = np.eye(4)
    shear = np.eye(4)
    place[:3, :3] = turned * scale
    place[:3, 3] = np.array(matrix, float)[:3, 3]
    shear[:3, :3] = upper / scale[:, None]

    return Matrix(place.tolist()), tuple(map(tuple, shear.tolist()))


def _curved_meshes(rig: Rig) -> dict[str, Mesh]:
    """Fine triangles of the curved parts, by name."""
    parts = {part.name: part.mesh for part in rig.curved_parts() if part.mesh.surface != "facets"}
    fine = {name: tessellate(mesh) for name, mesh in parts.items() if len(mesh.triangles)}
    return {name: mesh for name, mesh in fine.items() if mesh is not parts[name]}


def _seen_in_render(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    """Objects of a view layer that its scene would render, each once."""
    seen = set()
    todo = [layer]
    while todo:
        layer = todo.pop()
        if layer.exclude or layer.collection.hide_render:
            continue
        todo.extend(layer.children)
        for thing in layer.collection.objects:
            if thing not in seen and thing.type != "CAMERA":
                seen.add(thing)
                yield thing
