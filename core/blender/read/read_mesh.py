"""Converts Blender meshes to triangles in the world. Their float32 numbers count as exact."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints
from ...base.products import turn
from ...glass.weld import welded
from ...rig.rig import Mesh, SurfaceChoice

# twice a triangle's area over its longest edge squared: float32 cannot resolve a smaller height
NO_AREA = 1e-12

# of a mesh's size: copies of a vertex, rounded to float32 once or twice, differ by less
COPIED = 4 * 2.0**-23

SAME_FLOAT32_NORMAL = 1e-6  # normals with a smaller difference are equal in float32


@contextmanager
def mesh_of(shown: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """The mesh of an evaluated object with its modifiers; freed at the end."""
    try:
        yield shown.to_mesh()
    finally:
        shown.to_mesh_clear()


def column(collection: Any, name: str, width: int, dtype: type) -> NDArray[Any]:
    """One property of every item of a Blender collection, (n, width), or (n,) for width 1."""
    flat = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, flat)
    return flat if width == 1 else flat.reshape(-1, width)


def cofactors(matrix: Floats) -> Floats:
    """Cofactor matrix (3, 3): det(M) times the inverse transpose of M; it also exists for a
    singular M.
    """
    a, b, c = matrix
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])


def world_normals(normals: Floats, linear: Floats) -> Floats:
    """Unit normals (n, 3) in the world from local ones, by the inverse transpose, which keeps
    outward normals outward.
    """
    turned = turn(cofactors(linear) * (-1.0 if np.linalg.det(linear) < 0 else 1.0), normals)
    length = np.sqrt(np.einsum("ij,ij->i", turned, turned))
    length[length == 0] = 1.0
    turned /= length[:, None]  # in place, since a million triangles have three million corners
    return turned


def has_area(vertices: Floats, triangles: Ints) -> Bools:
    """Mask of the triangles (t, 3) that span a plane, including any with non-finite corners."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    with np.errstate(invalid="ignore", over="ignore"):
        twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        longest = np.maximum.reduce([np.einsum("ij,ij->i", e, e) for e in (b - a, c - b, a - c)])
        return ~(twice <= NO_AREA * longest) | ~np.isfinite(longest)


def used_slots(mesh: bpy.types.Mesh) -> tuple[int, ...]:
    """Material slots on the faces of a mesh, the most used first."""
    counts = np.bincount(column(mesh.polygons, "material_index", 1, np.int32))
    return tuple(int(k) for k in np.argsort(-counts, kind="stable") if counts[k])


def uv_layer(mesh: bpy.types.Mesh, name: str) -> Any | None:
    """The UV map of this name, else the one used in renders, else None."""
    layers = mesh.uv_layers
    return layers.get(name) or next((layer for layer in layers if layer.active_render), None)


def has_means(mesh: bpy.types.Mesh) -> bool:
    """Whether a Blender mesh's corner normals are means over the faces around each vertex, not
    custom ones.

    Blender stores custom normals equal to its own means to 1e-4 as zeros. Up to 4.5 a subdivision
    modifier without custom normals passes others on as zeros, too.
    """
    if not mesh.has_custom_normals:
        return True

    if bpy.app.version < (4, 5):  # these values are not visible
        means = column(mesh.vertex_normals, "vector", 3, np.float32)
        means = means[column(mesh.loops, "vertex_index", 1, np.int32)]
        return bool(
            (
                np.abs(column(mesh.corner_normals, "vector", 3, np.float32) - means)
                < SAME_FLOAT32_NORMAL
            ).all()
        )

    given = mesh.attributes["custom_normal"]
    return given.data_type == "INT16_2D" and not column(given.data, "value", 2, np.int32).any()


def sharpen_creases(mesh: bpy.types.Mesh, drawn: bpy.types.Object) -> None:
    """Mark fully creased edges as sharp in the evaluated mesh of an object with a subdivision
    modifier that uses creases.

    The limit surface has a sharp edge there, while Blender's mean normals cross it. Custom normals
    stay.
    """
    is_followed = any(
        m.type in {"SUBSURF", "MULTIRES"} and m.show_viewport and m.use_creases
        for m in drawn.modifiers
    )
    creases = mesh.attributes.get("crease_edge")
    if is_followed and creases is not None and has_means(mesh):
        is_creased = column(creases.data, "value", 1, np.float32) >= 1
        mesh.edges.foreach_set(
            "use_edge_sharp", column(mesh.edges, "use_edge_sharp", 1, np.bool_) | is_creased
        )
        mesh.update()


def has_open_edges(mesh: bpy.types.Mesh) -> bool:
    """Whether a Blender mesh has an edge with one face only."""
    return bool((np.bincount(column(mesh.loops, "edge_index", 1, np.int32)) == 1).any())


@dataclass(frozen=True, eq=False)
class LocalMesh:
    """A Blender mesh as read, before its transform to the world.

    vertices : (v, 3) float64, in the mesh's own units
    triangles, loops : (t, 3) int, corners as vertices, welded at coincident open edges, and as
        loops
    is_smooth : (t,) bool; None if normals are not wanted or no triangle is smooth
    normals : (l, 3) float64, of loops; None with is_smooth
    uv : (t, 3, 2) float64 or None
    """

    vertices: Floats
    triangles: Ints
    loops: NDArray[np.int32]
    is_smooth: Bools | None
    normals: Floats | None
    has_mean_normals: bool
    uv: Floats | None

    def welded(self) -> "LocalMesh":
        """The same mesh, with vertices welded at coincident open edges."""
        size = float(np.abs(self.vertices).max(initial=0.0))
        triangles = welded(self.vertices, self.triangles, COPIED * size)

        # drop triangles collapsed to lines and points
        keep = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        return replace(
            self,
            triangles=triangles[keep],
            loops=self.loops[keep],
            is_smooth=None if self.is_smooth is None else self.is_smooth[keep],
            uv=None if self.uv is None else self.uv[keep],
        )


def read_local(
    mesh: bpy.types.Mesh, *, has_normals: bool = False, has_uv: bool = False, uv_map: str = ""
) -> LocalMesh:
    """Triangles of an evaluated Blender mesh in its own coordinates.

    Parameters
    ----------
    has_normals, has_uv : read corner normals, read a UV map
    uv_map : name of the UV map; the one used in renders if there is none of this name
    """
    mesh.calc_loop_triangles()
    found = mesh.loop_triangles
    loops = column(found, "loops", 3, np.int32)
    normals = is_smooth = uv = None
    has_mean_normals = False

    if has_normals:
        is_smooth = column(mesh.polygons, "use_smooth", 1, np.bool_)[
            column(found, "polygon_index", 1, np.int32)
        ]
        if is_smooth.any():
            normals = column(mesh.corner_normals, "vector", 3, np.float32).astype(float)
            has_mean_normals = has_means(mesh)
        else:
            is_smooth = None

    layer = uv_layer(mesh, uv_map) if has_uv else None
    if layer is not None:
        uv = column(layer.uv, "vector", 2, np.float32).astype(float)[loops]
    with np.errstate(invalid="ignore"):  # Mesh.check reports non-finite vertices
        vertices = column(mesh.vertices, "co", 3, np.float32).astype(float)

    triangles = column(found, "vertices", 3, np.int32).astype(np.int64)
    local = LocalMesh(
        vertices=vertices,
        triangles=triangles,
        loops=loops,
        is_smooth=is_smooth,
        normals=normals,
        has_mean_normals=has_mean_normals,
        uv=uv,
    )
    return local.welded() if has_open_edges(mesh) and np.isfinite(vertices).all() else local


def polygons_of(loops: NDArray[np.int32]) -> Ints:
    """The polygon (t,) of each triangle, by its loops (t, 3): the triangles of a polygon are
    consecutive, and each shares loops with the one before.
    """
    shared = loops[1:, :, None] == loops[:-1, None]
    return np.cumsum(np.r_[False, ~shared.any(axis=(1, 2))][: len(loops)])


def in_world(
    local: LocalMesh, matrix: Floats, surface: SurfaceChoice = "smooth"
) -> tuple[Mesh, int]:
    """A mesh as read, in the world.

    Parameters
    ----------
    matrix : (4, 4) float64, metres in the world from local coordinates. If it mirrors (det < 0),
        the winding is flipped, so that the front stays in front.
    surface : the surface of smooth-shaded faces

    Returns
    -------
    the Mesh, and the number of dropped triangles without area
    """
    linear = matrix[:3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = turn(linear, local.vertices) + matrix[:3, 3]
        size = float(np.abs(local.vertices).max(initial=0.0))
        rounding = 2.0**-24 * size * float(np.linalg.norm(linear, axis=0).max())

    triangles = local.triangles
    loops = local.loops
    uv = local.uv

    if np.linalg.det(linear) < 0:
        triangles = triangles[:, ::-1]
        loops = loops[:, ::-1]
        uv = None if uv is None else uv[:, ::-1].copy()

    keep = has_area(vertices, triangles)
    n_dropped = int(len(keep) - keep.sum())
    is_smooth = local.is_smooth
    normals = None

    if n_dropped:
        triangles = triangles[keep]
        loops = loops[keep]
        uv = None if uv is None else uv[keep]
        is_smooth = None if is_smooth is None or not is_smooth[keep].any() else is_smooth[keep]

    if is_smooth is not None:
        normals = world_normals(local.normals, linear).take(loops, axis=0)

    # polygons show which edges were drawn, and where to find normals
    has_mean_normals = local.has_mean_normals and is_smooth is not None
    polygon = polygons_of(loops) if has_mean_normals else None
    triangles = np.ascontiguousarray(triangles)
    return Mesh(
        vertices=vertices,
        triangles=triangles,
        corner_normals=normals,
        is_smooth=is_smooth,
        uv=uv,
        surface=surface,
        has_mean_normals=has_mean_normals,
        rounding=rounding,
        polygon=polygon,
    ), n_dropped
