"""Triangles in the world as a Blender mesh."""

import bpy
import numpy as np
from mathutils import Matrix

from ..rig.rig import Mesh


def mesh_from_triangles(name: str, drawn: Mesh, metres: float) -> tuple[bpy.types.Mesh, Matrix]:
    """A Blender mesh of triangles in the world, with their
    corner normals; the inverse of `in_world`.

    Each triangle has vertices of its own, so that normals need
    no sharp edges to differ between neighbours.

    Parameters
    ----------
    metres : in a Blender unit

    Returns
    -------
    the mesh, about its own middle, where float32 is most
    exact; and the matrix that puts it in place
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
        normals = drawn.corner_normals.reshape(-1, 3)
        if bpy.app.version >= (4, 5):
            attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
            attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())
        else:
            mesh.normals_split_custom_set_from_vertices(normals.tolist())

    return mesh, Matrix.Translation((middle / metres).tolist())
