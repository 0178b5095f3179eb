"""Smoothing of a mesh, as by Blender's Smooth modifier, with smooth shading."""

from dataclasses import replace

import numpy as np

from ..base.arrays import Floats, Ints
from ..rig.mesh import Mesh

FACTOR = 0.5  # default of the modifier


def smoothed(mesh: Mesh, times: int) -> Mesh:
    """The mesh after some iterations, each moving a vertex by FACTOR to the mean midpoint of its
    edges.
    """
    sides = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    ends = np.concatenate([edges, edges[:, ::-1]])
    n = len(mesh.vertices)
    counts = np.maximum(np.bincount(ends[:, 0], minlength=n), 1)
    vertices = mesh.vertices
    for _ in range(times):
        mean = [np.bincount(ends[:, 0], vertices[ends[:, 1], k], n) / counts for k in range(3)]
        vertices = vertices + FACTOR / 2 * (np.stack(mean, axis=1) - vertices)
    return replace(
        mesh,
        vertices=vertices,
        corner_normals=vertex_normals(vertices, mesh.triangles)[mesh.triangles],
        is_smooth=np.ones(len(mesh.triangles), bool),
        has_mean_normals=True,
    )


def vertex_normals(vertices: Floats, triangles: Ints) -> Floats:
    """Unit normals (v, 3): means over the triangles (t, 3) around each vertex, weighted by their
    angles there, as in Blender.
    """
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = _unit(normal)
    found = np.zeros_like(vertices)
    for k in range(3):
        a, b = (_unit(corners[:, j % 3] - corners[:, k]) for j in (k + 1, k + 2))
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", a, b), -1, 1))
        for axis in range(3):
            found[:, axis] += np.bincount(
                triangles[:, k], angle * normal[:, axis], minlength=len(vertices)
            )
    return _unit(found)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
