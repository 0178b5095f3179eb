"""InFloasion: the rig with half of its glass, mirrored, on the display."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.base.vectors import normalise
from kiriko.core.light.optics import reflect
from kiriko.core.rig.rig import Mesh, Rig

# m of air between the display and the half glass in front, so they do not coincide
GAP = 1e-6


def half_before(mesh: Mesh, point: Floats, normal: Floats) -> Mesh:
    """The part of a flat-faced convex solid on one side of a plane, closed by the cut.

    Parameters
    ----------
    point, normal : (3,) of the plane, m and unit; the part along the normal stays
    """
    height = (mesh.vertices - point) @ normal
    vertices = list(mesh.vertices)
    cuts: dict[tuple[int, int], int] = {}  # vertices on the plane, by the edge they cut

    def cut(a: int, b: int) -> int:
        a, b = min(a, b), max(a, b)
        if (a, b) not in cuts:
            cuts[a, b] = len(vertices)
            share = height[a] / (height[a] - height[b])
            vertices.append(mesh.vertices[a] + share * (mesh.vertices[b] - mesh.vertices[a]))
        return cuts[a, b]

    triangles = []
    for corners in mesh.triangles.tolist():
        kept = []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if height[a] > 0:
                kept.append(a)
            if (height[a] > 0) != (height[b] > 0):
                kept.append(cut(a, b))
        triangles += [[kept[0], kept[k], kept[k + 1]] for k in range(1, len(kept) - 1)]

    rim = np.array(list(cuts.values()), int)
    if len(rim):
        across = normalise(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]))
        around = np.array(vertices)[rim]
        around = around - around.mean(axis=0)
        order = rim[np.argsort(np.arctan2(around @ np.cross(normal, across), around @ across))][
            ::-1
        ]
        triangles += [[order[0], order[k], order[k + 1]] for k in range(1, len(order) - 1)]

    return Mesh(np.array(vertices), np.array(triangles, int).reshape(-1, 3))


def mirrored(mesh: Mesh, point: Floats, normal: Floats) -> Mesh:
    """The mirror image of a flat-faced solid in a plane, its faces outward again."""
    vertices = point + reflect(mesh.vertices - point, normal[None])
    return Mesh(vertices, mesh.triangles[:, ::-1].copy())


def face_of(mesh: Mesh) -> tuple[Floats, Floats]:
    """A point (3,) and the unit normal (3,) of a plane mesh."""
    a, b, c = mesh.corners[0]
    return a, normalise(np.cross(b - a, c - a))


def infloasion(rig: Rig) -> Rig:
    """The rig with the mirror image of the half of its glass on the plate's side, standing on the
    display.

    The aerial plane cuts the glass; its mirror image in the plate is the display. Light of a point
    of the display goes through the mirrored half as it does, by symmetry, through the half behind
    the plate, and meets again in the point's mirror image. The bending that is left is by the half
    on the viewer's side.
    """
    plate = face_of(rig.plates[0].mesh)
    display, front = face_of(rig.display.mesh)
    halves = [
        replace(
            glass,
            name=f"{glass.name} Half",
            mesh=half_before(mirrored(glass.mesh, *plate), display + GAP * front, front),
        )
        for glass in rig.glasses
    ]

    return replace(
        rig, glasses=(*rig.glasses, *(half for half in halves if len(half.mesh.triangles)))
    )
