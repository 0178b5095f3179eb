"""Which curved faces Automatic trusts: face by face, or a mesh in one piece as a whole, and how far
where it is irregular.

There faces may lie between the curved face and the facet as it is drawn. The facet is off by the
curve that it leaves out, the curved face by vertices that do not lie on the surface. Neither error
knows of the other, so that the square of the gain, by which the two faces differ, is the sum of
both squared. The mean of both faces with the weights of least squares, 1 - (error of the curved
face / gain)^2 for the curved one, is then less off than the better one. Weights belong to vertices
and run evenly along edges, so that neighbours meet without a crack. On coarse regular meshes both
errors come of the same curve, and the jumps tell less.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.steps import Steps
from ..base.vectors import normalise
from .agreement import AGREEMENT, Trial
from .fitted_faces import Faces
from .grid_lines import look_along_lines
from .meshes import components
from .quartics import AT, AT_NODES, FROM_NODES, NODES
from .vertices import Vertices


@dataclass(frozen=True)
class PartKnobs:
    """How far a vertex is trusted (design.md, decision 3, "Automatic").

    Parameters
    ----------
    squared_error : of a curved face, in squared errors of the jumps of its normals, if vertices are
        off at random: 6.8 to 8.8 on balls, ellipsoids and tori with noise, whatever its size
    least : weights below count for nothing: they would take less than a fifth off the error, and
        make faces curved that are as good as drawn
    irregular : times the gain, rms: faces whose vertices are further off smooth lines are such. On
        decimated and scanned meshes it is 2 to 20 in the median, on Subdivision's, on waves and
        on clouds 0.5 and less, on coarse voxels around a thin torus 0.9
    chance : share of vertices that seem to be worth it by chance alone, up to 0.14 with noise that
        spoils the gain, and 0.09 on scans and voxels: a piece in which no more are is not blended
    """

    squared_error: float = 7.3
    least: float = 0.36
    irregular: float = 2.0
    chance: float = 0.15


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
    weight = 1 - PART.squared_error * unsure / (gained + AGREEMENT.agree**2)
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
    by_corner = take(part, vertex[some])
    offsets = np.matmul(NODES, by_corner) * np.matmul(AT_NODES, faces.coefficients[some])
    coefficients = faces.coefficients.copy()
    coefficients[some] = np.matmul(FROM_NODES, offsets)

    part = np.matmul(AT, by_corner)
    facets = normalise(np.matmul(AT, take(given, vertex[some])))
    meant = faces.meant.copy()
    meant[some] = normalise(part * meant[some] + (1 - part) * facets)
    return replace(v, normal=normal), replace(faces, coefficients=coefficients, meant=meant)


class Trusted(NamedTuple):
    """Which faces (n,) are nearer to the surface meant than their facets, and how far, 0..1, the
    vertices (f,) are to be trusted.
    """

    is_kept: Bools
    weight: Floats


class FlatParts(NamedTuple):
    """The flat face (t,) that each triangle is part of, and whether each curved face (n,) is known
    to be the surface meant (subdivided.py).
    """

    flat_face: Ints
    is_known: Bools


def how_far_trusted(
    v: Vertices, size: Floats, faces: Faces, trial: Trial, parts: FlatParts
) -> Steps[Trusted]:
    """Which faces (n,) are to be trusted, and how far.

    All parts of a flat face, or none. size (f,) of the vertices' fields.
    """
    vertex = v.of_corner[faces.chosen]
    of_face = parts.flat_face[faces.chosen]
    is_near = trial.trusted(vertex) | parts.is_known
    weight = np.ones(len(v.at))
    if is_near.all():
        is_kept = _whole(~faces.is_swollen, of_face)
        return Trusted(is_kept, weight)

    yield 0
    lines = yield from look_along_lines(v, size)
    scatter = lines.scatter[vertex]
    is_near |= trial.on_smooth_lines(scatter).trusted(vertex)
    piece = _pieces(vertex)
    if trial.is_coarse.any() and not is_near.all():
        is_fine = trial.on_lines(scatter, lines.phase[vertex]).trusted(vertex)

        # for a mesh in one piece, as a whole: regular in parts it may have kinks between them
        is_near |= ~np.isin(piece, piece[~is_fine])

    # in part, where most of a piece is off smooth lines
    is_trusted = _whole(~faces.is_swollen & is_near, of_face)
    in_part = _more(is_irregular(scatter, trial), piece, 0.5)
    if not in_part.any():
        return Trusted(is_trusted, weight)

    # there given normals are off as well, and those of the facets with them
    trial = trial._replace(gained=trial.apart)
    is_near |= trial.trusted(vertex)
    far = weights(len(v.at), vertex, trial, _whole(~faces.is_swollen & is_near, of_face))

    # and more than chance would pick is worth it; what is known stays whole
    far[vertex[parts.is_known]] = 1.0
    in_part &= _more((far[vertex] > 0).mean(axis=1), piece, PART.chance)
    of_part = vertex[in_part]
    weight[of_part] = far[of_part]
    is_kept = _whole(~faces.is_swollen & (far[vertex] > 0).any(axis=1), of_face)
    return Trusted(np.where(in_part, is_kept, is_trusted), weight)


def _whole(which: Bools, of_face: Ints) -> Bools:
    """Those (n,) whose flat faces, of such numbers (n,), are chosen in all their parts."""
    return which & ~np.isin(of_face, of_face[~which])


def _more(counted: Floats | Bools, piece: Ints, share: float) -> Bools:
    """The faces (n,) of the pieces (n,) more of which than a share counts."""
    return (np.bincount(piece, counted) > share * np.bincount(piece))[piece]


def _pieces(triangles: Ints) -> Ints:
    """The piece (t,) of each triangle (t, 3), joined to others by its vertices."""
    along = np.concatenate([triangles[:, :2], triangles[:, 1:]]).T
    return components(triangles.max(initial=-1) + 1, *along)[triangles[:, 0]]
