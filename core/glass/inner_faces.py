"""Faces inside a body (boolean leftovers, mirror seams, walls of CAD cells), found and removed.

If more than two faces meet at an edge, their sides bound cells of space. A body is the union of the
cells inside one outer cell; a face between two of its cells bounds no body.
"""

from dataclasses import replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot
from ..rig.mesh import Mesh
from .meshes import components


def find_bodies(vertices: Floats, triangles: Ints) -> Ints:
    """Label (t,) of the body on one side of each of triangles (t, 3), with vertices (v, 3) in any
    unit.

    Each body has its own label; triangles inside one have -1. Triangles next to no body, as in an
    open mesh, have one label for each connected component. If no edge has more than two triangles
    all labels are the same.
    """
    if _edges_of(triangles)[-1].max(initial=0) <= 2:
        return np.zeros(len(triangles), np.int64)
    _, first, same = np.unique(
        np.sort(triangles, axis=1), axis=0, return_index=True, return_inverse=True
    )
    once = triangles[first]
    low, high, is_along, edge, counts = _edges_of(once)
    apex = np.roll(once, 1, axis=1).ravel()

    # around each edge, counterclockwise about its direction from lower to higher vertex
    is_shared = counts[edge] > 2
    angle = np.zeros(len(edge))
    angle[is_shared] = _angles(*(vertices[at[is_shared]] for at in (low, high, apex)))
    order = np.lexsort([angle, edge])
    begins = np.cumsum(counts) - counts
    is_last = np.r_[np.diff(edge[order]) > 0, True]
    following = np.where(is_last, order[np.repeat(begins, counts)], np.roll(order, -1))

    # the sides of triangle k are 2 k, its front, and 2 k + 1
    ahead = 2 * (np.arange(len(edge)) // 3) + ~is_along
    cell = components(2 * len(once), ahead[order], ahead[following] ^ 1)
    front, back = cell.reshape(-1, 2).T

    # only the outer cell of a component has a negative volume
    a, b, c = np.moveaxis(vertices[once] - vertices[once[0, 0]], 1, 0)
    volume = np.bincount(back, dot(a, np.cross(b, c)), len(cell))
    volume -= np.bincount(front, dot(a, np.cross(b, c)), len(cell))
    component = components(len(cell), front, back)
    lowest = np.full(len(cell), np.inf)
    np.minimum.at(lowest, component[cell], volume[cell])
    is_outer = volume <= lowest[component]
    is_air = is_outer | _are_hollow(front, back, is_outer)

    is_inner = ~is_air[front] & ~is_air[back]
    body = components(len(cell), front[is_inner], back[is_inner])
    label = body[np.where(is_air[front], back, front)]
    label = np.where(is_air[front] & is_air[back], len(cell) + component[front], label)
    return np.where(is_inner, -1, label)[same.reshape(-1)]


def _edges_of(triangles: Ints) -> tuple[Ints, Ints, Bools, Ints, Ints]:
    """Sides (3 t,) of triangles (t, 3): lower and higher vertex, whether it runs from lower to
    higher, index of its edge; and the number of sides of each edge.
    """
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(start, end).astype(np.int64), np.maximum(start, end)
    key = low * (int(triangles.max(initial=0)) + 1) + high
    _, edge, counts = np.unique(key, return_inverse=True, return_counts=True)
    return low, high, start == low, edge, counts


def _angles(low: Floats, high: Floats, apex: Floats) -> Floats:
    """Angles (n,), rad, around edges from `low` to `high` of triangles with third corners `apex`,
    all (n, 3).
    """
    along = high - low
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    with np.errstate(invalid="ignore"):  # an edge of length 0 has no order around it
        third_axis = np.cross(along, across) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.arctan2(dot(apex - low, third_axis), dot(apex - low, across))


def _are_hollow(front: Ints, back: Ints, is_outer: Bools) -> Bools:
    """Mask of cells that are cavities: they share no face with the outer cell, and all their faces
    look into them if the body's faces look outward (or the reverse).
    """
    n = len(is_outer)
    looks_in = np.bincount(front, minlength=n)
    looks_out = np.bincount(back, minlength=n)
    is_surface = is_outer[front] != is_outer[back]
    touches = np.zeros(n, bool)
    touches[front[is_surface]] = touches[back[is_surface]] = True
    are_out = np.count_nonzero(is_outer[front[is_surface]]) * 2 > np.count_nonzero(is_surface)
    return ~is_outer & ~touches & ((looks_out if are_out else looks_in) == 0)


def without_inner(mesh: Mesh) -> Mesh:
    """The mesh without triangles inside its bodies, and with no vertex shared by two bodies."""
    body = find_bodies(mesh.vertices, mesh.triangles)
    if not body.any():
        return mesh
    is_surface = body >= 0
    pairs = np.stack([mesh.triangles[is_surface].ravel(), np.repeat(body[is_surface], 3)], axis=1)
    found, index = np.unique(pairs, axis=0, return_inverse=True)
    of_triangles = ("corner_normals", "is_smooth", "uv", "polygon")
    columns = {name: getattr(mesh, name) for name in of_triangles}
    return replace(
        mesh,
        vertices=mesh.vertices[found[:, 0]],
        triangles=index.reshape(-1, 3),
        **{name: None if one is None else one[is_surface] for name, one in columns.items()},
    )
