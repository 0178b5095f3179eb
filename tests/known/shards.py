"""Convex bodies cut into shards by planes, as by a fracture.

Each shard is a closed mesh of its own, whose vertices are rounded to float32 as in Blender.
"""

from dataclasses import replace

import numpy as np

from kiriko.core.rig.rig import Mesh

SAME = 1e-9  # m: corners of a shard that are nearer to each other are one


def shards_of(mesh: Mesh, planes: list[tuple[np.ndarray, float]]) -> list[Mesh]:
    """The shards of a convex body, parted by planes of points p with normal . p = offset."""
    cells = [list(mesh.corners)]
    for normal, offset in planes:
        cells = [part for cell in cells for part in _halves(cell, normal, offset)]
    return [rounded(_mesh_of(cell)) for cell in cells]


def rounded(mesh: Mesh) -> Mesh:
    """The mesh with vertices that float32 can hold."""
    return replace(mesh, vertices=mesh.vertices.astype(np.float32).astype(float))


def _halves(cell: list[np.ndarray], normal: np.ndarray, offset: float) -> list[list[np.ndarray]]:
    """The parts of a convex body, given by its polygons (k, 3), on both sides of a plane."""
    parts = []
    for side in (1, -1):
        polygons, rim = [], []
        for polygon in cell:
            height = side * (polygon @ normal - offset)
            kept = []
            for i, j in zip(range(len(polygon)), np.roll(range(len(polygon)), -1), strict=True):
                if height[i] <= 0:
                    kept.append(polygon[i])
                if (height[i] <= 0) != (height[j] <= 0):
                    part = height[i] / (height[i] - height[j])
                    kept.append(polygon[i] + part * (polygon[j] - polygon[i]))
                    rim.append(kept[-1])
            if len(kept) > 2:
                polygons.append(np.array(kept))
        if rim:
            polygons.append(_around(np.array(rim), side * normal))
        if polygons:
            parts.append(polygons)
    return parts


def _around(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Points of a plane as the corners of a convex polygon that looks along the normal."""
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    off = points - points.mean(axis=0)
    points = points[np.argsort(np.arctan2(off @ np.cross(normal, across), off @ across))]
    return points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > SAME]


def _mesh_of(polygons: list[np.ndarray]) -> Mesh:
    """A closed mesh of convex polygons, with a vertex wherever corners meet."""
    corners = np.concatenate(polygons)
    is_same = np.linalg.norm(corners[:, None] - corners, axis=2) < SAME
    used, index = np.unique(is_same.argmax(axis=1), return_inverse=True)
    triangles, first = [], 0
    for polygon in polygons:
        triangles += [(first, first + i, first + i + 1) for i in range(1, len(polygon) - 1)]
        first += len(polygon)
    triangles = index.ravel()[np.array(triangles)]
    has_area = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return Mesh(corners[used], triangles[has_area])
