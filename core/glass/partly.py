"""Faces that are trusted in part: between the curved face and the facet as it is drawn.

The facet is off by the curve that it leaves out, the curved face by vertices that do not lie on the
surface. Neither error knows of the other, so that the square of the gain, by which the two faces
differ, is the sum of both squared. The mean of both faces with the weights of least squares,
1 - (error of the curved face / gain)^2 for the curved one, is then less off than the better one.
Weights belong to vertices and run evenly along edges, so that neighbours meet without a crack.

It goes for irregular meshes alone: on coarse regular ones both errors come of the same curve, and
the jumps tell less.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.vectors import normalise
from .agreement import AGREEMENT, Trial
from .fitted_faces import Faces
from .quartics import AT, AT_NODES, FROM_NODES, NODES
from .vertices import Vertices


@dataclass(frozen=True)
class PartKnobs:
    """How far a vertex is trusted (design.md, decision 3, "Automatic").

    Parameters
    ----------
    told : the square of a curved face's error, in those of the jumps of its normals, where vertices
        are off at random: 6.8 to 8.8 on balls, ellipsoids and tori with noise, whatever its size
    least : weights below count for nothing: they would take less than a fifth off the error, and
        make faces curved that are as good as drawn
    irregular : times the gain, rms: faces whose vertices are further off smooth lines are such. On
        decimated and scanned meshes it is 2 to 20 in the median, on Subdivision's, on waves and
        on clouds 0.5 and less, on coarse voxels around a thin torus 0.9
    """

    told: float = 7.3
    least: float = 0.36
    irregular: float = 2.0


PART = PartKnobs()


def is_irregular(scatter: Floats, trial: Trial) -> Bools:
    """Which faces (p,) have vertices that lie off smooth lines by scatter (p, 3), or on none."""
    return (scatter**2).mean(axis=1) > PART.irregular**2 * trial.gained


def weights(n_vertices: int, vertex: Ints, trial: Trial, is_trusted: Bools) -> Floats:
    """How far, 0..1, the vertices (f,) of curved faces (p, 3) are to be trusted.

    All the way where all faces around are, else as the jumps of the faces around tell.
    """
    unsure, gained = (
        np.bincount(vertex.ravel(), np.repeat(x, 3), n_vertices)
        for x in (trial.unsure, trial.gained)
    )
    weight = 1 - PART.told * unsure / (gained + AGREEMENT.agree**2)
    weight[weight < PART.least] = 0.0
    is_whole = np.ones(n_vertices, bool)
    is_whole[vertex[~is_trusted]] = False
    return np.where(is_whole, 1.0, weight)


def in_parts(v: Vertices, faces: Faces, given: Floats, weight: Floats) -> tuple[Vertices, Faces]:
    """Vertices and faces (p,) between curved, where weights (f,)
    are 1, and facets with the given normals (f, 3).
    """
    part = weight[:, None]
    normal = np.where(part < 1, normalise(part * v.normal + (1 - part) * given), v.normal)

    vertex = v.of_corner[faces.chosen]
    some = np.flatnonzero((weight[vertex] < 1).any(axis=1))
    by_corner = taken(part, vertex[some])
    offsets = np.matmul(NODES, by_corner) * np.matmul(AT_NODES, faces.coefficients[some])
    coefficients = faces.coefficients.copy()
    coefficients[some] = np.matmul(FROM_NODES, offsets)

    part = np.matmul(AT, by_corner)
    facets = normalise(np.matmul(AT, taken(given, vertex[some])))
    meant = faces.meant.copy()
    meant[some] = normalise(part * meant[some] + (1 - part) * facets)
    return replace(v, normal=normal), replace(faces, coefficients=coefficients, meant=meant)
