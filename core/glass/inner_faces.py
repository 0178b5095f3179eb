"""Faces within a body, such as boolean leftovers, mirror seams and the walls of CAD cells.

Where more than two faces meet at an edge, their sides bound cells of space. A body is the union of
the cells that one outer cell surrounds, and a face between two of them bounds no body.
"""

from dataclasses import replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot
from ..rig.mesh import Mesh
from .meshes import components


def find_bodies(vertices: Floats, triangles: Ints) -> Ints:
    """The body (t,) on one side of each of triangles (t, 3), of vertices (v, 3) of any unit.

    A label that bodies share with no other; -1 for triangles within one. Triangles that no body is
    on one side of, as those of an open mesh, are each a part of their connected component. All have
    one label where no edge has more than two triangles.
    """
    if _edges_of(triangles)[-1].max(initial=0) <= 2:
        return np.zeros(len(triangles), np.int64)
    _, first, same = np.unique(
        np.sort(triangles, axis=1), axis=0, return_index=True, return_inverse=True
    )
    once = triangles[first]
    low, high, is_along, edge, counts = _edges_of(once)
    apex = np.roll(once, 1, axis=1).ravel()

    # around each edge, from its lower to its higher vertex, counterclockwise
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

    # the outer cell of a component alone has a negative volume
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
    """Of the sides (3 t,) of triangles (t, 3): lower and higher vertex, whether it runs from the
    one to the other, the number of its edge; and how many sides each edge has.
    """
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(start, end).astype(np.int64), np.maximum(start, end)
    key = low * (int(triangles.max(initial=0)) + 1) + high
    _, edge, counts = np.unique(key, return_inverse=True, return_counts=True)
    return low, high, start == low, edge, counts


def _angles(low: Floats, high: Floats, apex: Floats) -> Floats:
    """Angles (n,) around edges from `low` to `high` at which triangles stand whose third corners
    are `apex`, all (n, 3).
    """
    along = high - low
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    with np.errstate(invalid="ignore"):  # an edge without a length has no order around it
        beside = np.cross(along, across) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.arctan2(dot(apex - low, beside), dot(apex - low, across))


def _are_hollow(front: Ints, back: Ints, is_outer: Bools) -> Bools:
    """Which cells are cavities: none of their faces is one of the outer cell, and all of these look
    into the cavity where faces of the body look out of it.
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
    """A mesh without the triangles within its bodies, whose bodies have no vertex in common."""
    body = find_bodies(mesh.vertices, mesh.triangles)
    if not body.any():
        return mesh
    kept = body >= 0
    pairs = np.stack([mesh.triangles[kept].ravel(), np.repeat(body[kept], 3)], axis=1)
    found, index = np.unique(pairs, axis=0, return_inverse=True)
    of_triangles = ("corner_normals", "is_smooth", "uv", "polygon")
    columns = {name: getattr(mesh, name) for name in of_triangles}
    return replace(
        mesh,
        vertices=mesh.vertices[found[:, 0]],
        triangles=index.reshape(-1, 3),
        **{name: None if one is None else one[kept] for name, one in columns.items()},
    )
