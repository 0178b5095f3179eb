"""Vertices of a mesh as the code finds them; faces held to the limit of subdivision."""

import numpy as np

from kiriko.core.glass.meshes import find_edges, find_joined
from kiriko.core.glass.vertices import find_vertices


def vertices_and_edges(mesh):
    """The vertices of a mesh whose triangles are all smooth, and its edges."""
    edges = find_edges(mesh.triangles)
    joined = find_joined(mesh.corner_normals, edges)
    usable = np.ones(len(mesh.triangles), bool)
    v = find_vertices(mesh.vertices, mesh.triangles, mesh.corner_normals, usable, edges, joined)
    return v, edges


def off_limit(places, normals, finer):
    """How far nodes of faces are off the limit: places (k, 15, 3) m, normals (k, 15, 3).

    finer : the same limit by two more levels, whose vertices are a quarter of an edge apart as the
        nodes are
    """
    exact = np.empty_like(finer.vertices)
    exact[finer.triangles] = finer.corner_normals
    off, turned = [], []
    for place, normal in zip(places, normals, strict=True):
        away = np.linalg.norm(place[:, None] - finer.vertices, axis=2)
        off.append(away.min(axis=1))
        turned.append(np.abs(exact[away.argmin(axis=1)] - normal))
    return np.max(off), np.max(turned)
