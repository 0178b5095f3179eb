"""Turns Blender meshes into triangles in the world. Blender's float32 numbers are taken as exact."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .rig import Bools, Floats, Ints, Mesh

NO_AREA = 1e-12  # twice a triangle's area over its longest edge squared: below it float32 left nothing of its height
AFFINE = 1e-4  # a display is a flat rectangle when its UV map misses an affine one by less than this share of its size


def column(collection: Any, name: str, width: int, dtype: type) -> NDArray[Any]:
    """One property of every item of a Blender collection, (n, width), or (n,) for width 1."""
    flat = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, flat)
    return flat if width == 1 else flat.reshape(-1, width)


def turn(linear: Floats, vectors: Floats) -> Floats:
    """Vectors (n, 3) times a matrix (3, 3); not by BLAS, whose threads give other last bits on other machines."""
    return np.einsum("kj,ij->ik", linear, vectors)


def cofactors(matrix: Floats) -> Floats:
    """Cofactor matrix (3, 3): det(M) times the inverse transpose of M, which exists for a singular M, too."""
    a, b, c = matrix
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])


def world_normals(normals: Floats, linear: Floats) -> Floats:
    """Unit normals (n, 3) in the world of local ones, by the inverse transpose: outward stays outward."""
    turned = turn(cofactors(linear) * (-1.0 if np.linalg.det(linear) < 0 else 1.0), normals)
    length = np.sqrt(np.einsum("ij,ij->i", turned, turned))
    length[length == 0] = 1.0
    turned /= length[:, None]  # in place: a million triangles have three million corners
    return turned


def has_area(vertices: Floats, triangles: Ints) -> Bools:
    """Which triangles (t, 3) span a plane; those with corners that are not numbers count as such."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    with np.errstate(invalid="ignore", over="ignore"):
        twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        longest = np.maximum.reduce([np.einsum("ij,ij->i", e, e) for e in (b - a, c - b, a - c)])
        return ~(twice <= NO_AREA * longest) | ~np.isfinite(longest)


def uv_layer(mesh: bpy.types.Mesh, name: str) -> Any | None:
    """The UV map of this name, else the one used in renders, else None."""
    layers = mesh.uv_layers
    return layers.get(name) or next((layer for layer in layers if layer.active_render), None)


def read_mesh(
    mesh: bpy.types.Mesh, matrix: Floats, *, has_normals: bool = False, has_uv: bool = False, uv_map: str = ""
) -> tuple[Mesh, int]:
    """Triangles of a Blender mesh in the world.

    Parameters
    ----------
    mesh : an evaluated mesh
    matrix : (4, 4) float64, metres in the world from local coordinates. Where it mirrors (det < 0) the winding is
        turned, so that the front stays in front.
    has_normals, has_uv : are corner normals, is a UV map wanted
    uv_map : name of the UV map; the one used in renders when there is none of that name

    Returns
    -------
    the Mesh, and the number of triangles left out because they have no area
    """
    mesh.calc_loop_triangles()
    linear = matrix[:3, :3]
    with np.errstate(invalid="ignore", over="ignore"):  # vertices that are no numbers are for Mesh.check to name
        vertices = column(mesh.vertices, "co", 3, np.float32).astype(float)
        vertices = turn(linear, vertices) + matrix[:3, 3]
    found = mesh.loop_triangles
    triangles = column(found, "vertices", 3, np.int32).astype(np.int64)
    loops = column(found, "loops", 3, np.int32)
    if np.linalg.det(linear) < 0:
        triangles, loops = triangles[:, ::-1], loops[:, ::-1]
    keep = has_area(vertices, triangles)
    n_dropped = int(len(keep) - keep.sum())
    if n_dropped:
        triangles, loops = triangles[keep], loops[keep]
    normals = is_smooth = uv = None
    if has_normals:
        polygons = column(found, "polygon_index", 1, np.int32)[keep]
        is_smooth = column(mesh.polygons, "use_smooth", 1, np.bool_)[polygons]
        if is_smooth.any():
            normals = world_normals(column(mesh.corner_normals, "vector", 3, np.float32).astype(float), linear)
            normals = normals.take(loops, axis=0)
        else:
            is_smooth = None
    layer = uv_layer(mesh, uv_map) if has_uv else None
    if layer is not None:
        uv = column(layer.uv, "vector", 2, np.float32).astype(float)[loops]
    return Mesh(vertices, np.ascontiguousarray(triangles), normals, is_smooth, uv), n_dropped


def flat_size(mesh: Mesh) -> tuple[float, float] | None:
    """Width and height in m of the UV square on a flat rectangle; None where the UV map is bent, skewed or missing."""
    if mesh.uv is None or not len(mesh.triangles):
        return None
    if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.uv).all()):
        return None
    points, uv = mesh.corners.reshape(-1, 3), mesh.uv.reshape(-1, 2)
    origin, place = points.mean(axis=0), uv.mean(axis=0)
    axes, _, rank, _ = np.linalg.lstsq(uv - place, points - origin, rcond=None)
    width, height = np.linalg.norm(axes, axis=1)
    if rank < 2:
        return None
    missed = np.abs((uv - place) @ axes - (points - origin)).max()
    if missed > AFFINE * max(width, height) or abs(axes[0] @ axes[1]) > AFFINE * width * height:
        return None
    return float(width), float(height)
