"""Makes objects: the parts of a new rig, all or none, and surfaces that show a result."""

from collections.abc import Callable

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ...base.arrays import Bools, Floats, Ints
from ...rig.rig import Mesh
from .rigs import active_rig, elsewhere, name_for
from .translation_context import data_name

OBJECT_MARK = "kiriko_object"  # on objects that Kiriko made and may replace


class Workbench:
    """A collection, new by default, and the objects made in it. Frames (4, 4) and lengths are in
    Blender units.
    """

    def __init__(
        self, scene: bpy.types.Scene, name: str, collection: bpy.types.Collection | None = None
    ) -> None:
        self.made: list[bpy.types.ID] = []
        if collection is not None:
            self.collection = collection
            return
        self.collection = self.keep(bpy.data.collections.new(data_name(name)))
        scene.collection.children.link(self.collection)

    def keep(self, block: bpy.types.ID) -> bpy.types.ID:
        """Record a datablock as made here."""
        self.made.append(block)
        return block

    def clear(self) -> None:
        """Remove everything made so far."""
        bpy.data.batch_remove(self.made)

    def _object(self, name: str, data: bpy.types.ID, frame: Floats) -> bpy.types.Object:
        thing = self.keep(bpy.data.objects.new(data_name(name), data))
        thing.matrix_world = Matrix(np.asarray(frame).tolist())
        self.collection.objects.link(thing)
        return thing

    def rectangle(self, name: str, frame: Floats, width: float, height: float) -> bpy.types.Object:
        """A plane facing along the frame's third axis, with UV from its lower left to its upper
        right corner.
        """
        mesh = self.keep(bpy.data.meshes.new(data_name(name)))
        x, y = width / 2, height / 2
        mesh.from_pydata(
            [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)], [], [(0, 1, 2, 3)]
        )
        mesh.uv_layers.new(name="UVMap").data.foreach_set(
            "uv", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]
        )

        return self._object(name, mesh, frame)

    def ball(self, name: str, frame: Floats, radius: float) -> bpy.types.Object:
        """A smooth-shaded icosphere of 20480 triangles."""
        return self._object(name, self.keep(ball_mesh(data_name(name), radius)), frame)

    def drawn(self, name: str, drawn: Mesh, frame: Floats, metres: float) -> bpy.types.Object:
        """An object of a mesh in the world, with its normals and UV map.

        frame : (4, 4) of the object in the world, m, a rotation and a shift
        metres : in a Blender unit
        """
        mesh = self.keep(bpy.data.meshes.new(data_name(name)))
        points, index = np.unique(drawn.vertices, axis=0, return_inverse=True)
        points = (points - frame[:3, 3]) @ frame[:3, :3] / metres
        n = len(drawn.triangles)
        polygon = np.arange(n) if drawn.polygon is None else drawn.polygon
        is_first = np.r_[True, polygon[1:] != polygon[:-1]]
        # a polygon is a fan: all corners of its first triangle, the last one of each other
        loops = np.flatnonzero(np.stack([is_first, is_first, np.ones(n, bool)], axis=1))
        starts = np.searchsorted(loops, 3 * np.flatnonzero(is_first))
        mesh.vertices.add(len(points))
        mesh.loops.add(len(loops))
        mesh.polygons.add(len(starts))
        mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
        corners = index.ravel()[drawn.triangles.ravel()[loops]]
        mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
        mesh.polygons.foreach_set("loop_start", starts.astype(np.int32))
        is_smooth = np.zeros(n, bool) if drawn.is_smooth is None else drawn.is_smooth
        mesh.polygons.foreach_set("use_smooth", is_smooth[is_first])
        if drawn.uv is not None:
            uv = drawn.uv.reshape(-1, 2)[loops]
            mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uv.astype(np.float32).ravel())
        mesh.update(calc_edges=True)
        if drawn.corner_normals is not None and not drawn.has_mean_normals:
            give_normals(mesh, drawn.corner_normals.reshape(-1, 3)[loops])

        place = frame.copy()
        place[:3, 3] /= metres
        return self._object(name, mesh, place)

    def camera(self, name: str, frame: Floats, distance: float, field: float) -> bpy.types.Object:
        """A perspective camera that frames a square of width `field` at a distance, where its eyes
        converge. It is drawn half as large.
        """
        camera = self.keep(bpy.data.cameras.new(data_name(name)))
        camera.sensor_fit = "AUTO"
        camera.angle = 2 * np.arctan(field / (2 * distance))
        camera.clip_start = 1e-3 * distance
        camera.clip_end = 1e3 * distance
        camera.display_size = 0.5 * field
        camera.stereo.convergence_distance = distance
        return self._object(name, camera, frame)

    def material(
        self, name: str, build: Callable[[bpy.types.Material], None]
    ) -> bpy.types.Material:
        """A material with nodes made by `build`."""
        material = self.keep(bpy.data.materials.new(data_name(name)))
        build(material)
        return material


def ball_mesh(name: str, radius: float) -> bpy.types.Mesh:
    """A smooth-shaded icosphere of 20480 triangles."""
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=6, radius=radius)
    mesh = bpy.data.meshes.new(name)
    shape.to_mesh(mesh)
    shape.free()
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    mesh.update()
    return mesh


def give_normals(mesh: bpy.types.Mesh, normals: Floats) -> None:
    """Give the corners (n) of a mesh normals (n, 3); before Blender 4.5 rounded to 16 bit."""
    if bpy.app.version >= (4, 5):
        attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())
    else:
        mesh.normals_split_custom_set(normals.tolist())


def find_made(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """The object that Kiriko made by this name for the active rig; None if there is none."""
    is_elsewhere = elsewhere(scene)
    things = (thing for thing in scene.objects if thing.get(OBJECT_MARK) == name)
    return next((thing for thing in things if not is_elsewhere(thing)), None)


def values_of(mesh: bpy.types.Mesh, quantity: str) -> Floats:
    """Values (n,) at the points, as stored by `surface_object`."""
    found = np.zeros(len(mesh.vertices), np.float32)
    attribute = mesh.attributes.get(quantity)
    if attribute is not None and len(attribute.data) == len(found):
        attribute.data.foreach_get("value", found)
    return found


def shown_quads(is_shown: Bools) -> Ints:
    """The squares (k, 4) of a grid with all corners visible, as numbers of its points.

    is_shown : (m, n)
    """
    index = np.arange(is_shown.size).reshape(is_shown.shape)
    quads = np.stack(
        [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1
    ).reshape(-1, 4)
    return quads[is_shown.ravel()[quads].all(axis=1)]


def surface_object(
    scene: bpy.types.Scene, name: str, positions: Floats, faces: Ints, values: dict[str, Floats]
) -> bpy.types.Object:
    """An object of faces in the world, only for the viewport; replaces the previous one.

    Parameters
    ----------
    name : identifies it; the object's name also has the number of its rig
    positions : (n, 3) world, Blender units; unused ones are dropped
    faces : (m, 3) or (m, 4)
    values : one quantity (n,) by its name, stored as a point attribute, and as grey in one with a
        capital, the largest as white
    """
    # used points, about their centre
    used, corners = np.unique(faces, return_inverse=True)
    points = positions[used]
    centre = points.mean(axis=0)
    ((quantity, numbers),) = values.items()
    shown = numbers[used].astype(np.float32)
    grey = np.repeat((shown / max(shown.max(), 1e-30))[:, None], 4, axis=1)
    grey[:, 3] = 1.0
    own_name = name_for(scene, name)
    mesh = bpy.data.meshes.new(own_name)

    try:
        mesh.from_pydata((points - centre).tolist(), [], corners.reshape(faces.shape).tolist())
        mesh.attributes.new(quantity, "FLOAT", "POINT").data.foreach_set("value", shown)
        colours = mesh.color_attributes.new(quantity.capitalize(), "FLOAT_COLOR", "POINT")
        colours.data.foreach_set("color", grey.ravel())
        mesh.color_attributes.active_color = colours
        mesh.update()
    except BaseException:
        bpy.data.meshes.remove(mesh)
        raise

    # the previous object gets the new mesh
    thing = find_made(scene, name)
    if thing is None:
        thing = bpy.data.objects.new(own_name, mesh)
        thing[OBJECT_MARK] = name
        # panels/range_view.py draws it translucent
        thing.hide_render, thing.display_type = True, "BOUNDS"
        (active_rig(scene) or scene.collection).objects.link(thing)
    else:
        old, thing.data = thing.data, mesh
        if old.users == 0:
            bpy.data.meshes.remove(old)
        mesh.name = own_name

    thing.matrix_world = Matrix.Translation(centre)
    return thing
