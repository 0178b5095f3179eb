"""Trust in curved faces (Automatic): face by face or as a whole, and how far on irregular meshes.

On an irregular mesh a face may lie between the curved face and the facet as drawn. The facet misses
the curve; the curved face is off because vertices do not lie on the surface. The two errors are
independent: the squared gain, the difference of both faces, is the sum of both squared. The mean
with least-squares weights, 1 - (error of the curved face / gain)^2 for the curved one, has a
smaller error than the better of the two. Weights belong to vertices and vary linearly along edges,
so neighbours meet without a crack. On coarse regular meshes both errors have the same cause, and
jumps say less.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.steps import Steps
from ..base.vectors import normalise
from .agreement import AGREEMENT, ErrorEstimate
from .fitted_faces import Faces
from .grid_lines import line_steps
from .meshes import components
from .quartics import AT, AT_NODES, FROM_NODES, NODES
from .vertices import Vertices


@dataclass(frozen=True)
class TrustOptions:
    """Trust in a vertex (docs/decisions/04-automatic-surface.md).

    Parameters
    ----------
    squared_error : of a curved face, over the squared jumps of its normals, for vertices off at
        random: 6.8 to 8.8 on balls, ellipsoids and tori with noise of any size
    least : smaller weights become 0: they would remove less than a fifth of the error, and curve
        faces that are as good as drawn
    irregular : multiple of the gain, rms: faces with vertices further off smooth lines are
        irregular. 2 to 20 in the median on decimated and scanned meshes; 0.5 and less on
        Subdivision's, waves and clouds; 0.9 on coarse voxels around a thin torus
    chance : share of vertices accepted by chance alone: up to 0.14 with noise that spoils the gain,
        0.09 on scans and voxels. A piece with no larger share is not blended
    """

    squared_error: float = 7.3
    least: float = 0.36
    irregular: float = 2.0
    chance: float = 0.15


PART = TrustOptions()


def is_irregular(scatter: Floats, estimate: ErrorEstimate) -> Bools:
    """Mask of faces (p,) with vertices off smooth lines by scatter (p, 3), or on none."""
    return (scatter**2).mean(axis=1) > PART.irregular**2 * estimate.gain


def weights(n_vertices: int, vertex: Ints, estimate: ErrorEstimate, is_trusted: Bools) -> Floats:
    """Trust, 0..1, in the vertices (f,) of curved faces (p, 3).

    1 if all faces around are trusted, else from the jumps of the faces around.
    """
    error, gain = (
        np.bincount(vertex.ravel(), np.repeat(x, 3), n_vertices)
        for x in (estimate.error, estimate.gain)
    )
    weight = 1 - PART.squared_error * error / (gain + AGREEMENT.agree**2)
    weight[weight < PART.least] = 0.0
    is_whole = np.ones(n_vertices, bool)
    is_whole[vertex[~is_trusted]] = False
    return np.where(is_whole, 1.0, weight)


def blend_faces(v: Vertices, faces: Faces, given: Floats, weight: Floats) -> tuple[Vertices, Faces]:
    """Vertices and faces (p,) between curved, at weight (f,) 1, and facets with the given normals
    (f, 3).
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
    intended = faces.intended.copy()
    intended[some] = normalise(part * intended[some] + (1 - part) * facets)
    return replace(v, normal=normal), replace(faces, coefficients=coefficients, intended=intended)


class Trusted(NamedTuple):
    """Faces (n,) closer to the intended surface than their facets, and the trust, 0..1, in the
    vertices (f,).
    """

    is_curved: Bools
    weight: Floats


class FlatParts(NamedTuple):
    """Flat face (t,) of each triangle, and whether each curved face (n,) is exact (see
    subdivided.py).
    """

    flat_face: Ints
    is_exact: Bools


def trust_steps(
    v: Vertices, size: Floats, faces: Faces, estimate: ErrorEstimate, parts: FlatParts
) -> Steps[Trusted]:
    """Trusted faces (n,), and how far they are trusted.

    The parts of a flat face are trusted together. size (f,): of the vertices' fields
    """
    vertex = v.of_corner[faces.chosen]
    of_face = parts.flat_face[faces.chosen]
    is_near = estimate.trusted(vertex) | parts.is_exact
    weight = np.ones(len(v.at))
    if is_near.all():
        is_curved = _whole(~faces.is_swollen, of_face)
        return Trusted(is_curved, weight)

    yield 0
    lines = yield from line_steps(v, size)
    scatter = lines.scatter[vertex]
    is_near |= estimate.on_smooth_lines(scatter).trusted(vertex)
    piece = _pieces(vertex)
    if estimate.is_coarse.any() and not is_near.all():
        is_fine = estimate.on_lines(scatter, lines.phase[vertex]).trusted(vertex)

        # a mesh in one piece as a whole: regular in parts it may have kinks between them
        is_near |= ~np.isin(piece, piece[~is_fine])

    # partial trust if most of a piece is off smooth lines
    is_trusted = _whole(~faces.is_swollen & is_near, of_face)
    in_part = _more(is_irregular(scatter, estimate), piece, 0.5)
    if not in_part.any():
        return Trusted(is_trusted, weight)

    # the given normals are off as well there, and so are the facets'
    estimate = estimate._replace(gain=estimate.drawn_gain)
    is_near |= estimate.trusted(vertex)
    far = weights(len(v.at), vertex, estimate, _whole(~faces.is_swollen & is_near, of_face))

    # only if more vertices gain than by chance; exact faces stay whole
    far[vertex[parts.is_exact]] = 1.0
    in_part &= _more((far[vertex] > 0).mean(axis=1), piece, PART.chance)
    of_part = vertex[in_part]
    weight[of_part] = far[of_part]
    is_curved = _whole(~faces.is_swollen & (far[vertex] > 0).any(axis=1), of_face)
    return Trusted(np.where(in_part, is_curved, is_trusted), weight)


def _whole(which: Bools, of_face: Ints) -> Bools:
    """Mask (n,) of faces chosen together with all parts of their flat face (n,)."""
    return which & ~np.isin(of_face, of_face[~which])


def _more(counted: Floats | Bools, piece: Ints, share: float) -> Bools:
    """Mask of faces (n,) in pieces (n,) with more than a share counted."""
    return (np.bincount(piece, counted) > share * np.bincount(piece))[piece]


def _pieces(triangles: Ints) -> Ints:
    """Piece (t,) of each triangle (t, 3): triangles connected by vertices."""
    along = np.concatenate([triangles[:, :2], triangles[:, 1:]]).T
    return components(triangles.max(initial=-1) + 1, *along)[triangles[:, 0]]
