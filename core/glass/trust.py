"""Which curved faces Automatic trusts: face by face, or a mesh in one piece as a whole, and how far
where it is irregular.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Pauses
from .agreement import AGREEMENT, Trial
from .fitted_faces import Faces
from .grid_lines import look_along_lines
from .meshes import components
from .partly import is_irregular, weights
from .vertices import Vertices


class Doubts(NamedTuple):
    """How many smooth triangles are left flat because their curved faces would be no nearer to the
    surface meant, and how many of these because they are coarse, not uneven.
    """

    n: int = 0
    n_coarse: int = 0


class Trusted(NamedTuple):
    """Which faces (n,) are nearer to the surface meant than their facets; how far, 0..1, the
    vertices (f,) are to be trusted; and which faces (n,) are coarse, whatever became of them.
    """

    is_kept: Bools
    weight: Floats
    is_coarse: Bools

    @property
    def doubts(self) -> Doubts:
        return Doubts(int((~self.is_kept).sum()), int((~self.is_kept & self.is_coarse).sum()))


class Parts(NamedTuple):
    """The flat face (t,) that each triangle is a part of; of each curved face (n,) the whole shell,
    -1 where there is none, and whether it is known to be the surface meant (exact_limit.py).
    """

    flat_face: Ints
    shell: Ints
    is_known: Bools


def whole_shells(triangles: Ints, asked: Bools, faces: Faces) -> Ints:
    """The shell (n,) of each face, -1 in those in which triangles (t, 3) that were asked for (t,)
    have no face, or one that stands out.
    """
    shell = _pieces(triangles)
    is_missing = asked.copy()
    is_missing[faces.chosen[~faces.is_swollen]] = False
    of_face = shell[faces.chosen]
    return np.where(np.isin(of_face, shell[is_missing]), -1, of_face)


def how_far_trusted(
    v: Vertices, size: Floats, faces: Faces, trial: Trial, parts: Parts
) -> Pauses[Trusted]:
    """Which faces (n,) are to be trusted, and how far.

    All parts of a flat face, or none. size (f,) of the vertices' fields.
    """
    vertex = v.of_corner[faces.chosen]
    of_face = parts.flat_face[faces.chosen]
    is_near = trial.trusted(vertex) | parts.is_known
    weight = np.ones(len(v.at))
    if is_near.all():
        is_kept = _whole(~faces.is_swollen, of_face)
        return Trusted(is_kept, weight, np.zeros_like(is_kept))

    yield 0
    lines = yield from look_along_lines(v, size)
    scatter = lines.scatter[vertex]
    is_coarse = _are_coarse(scatter, trial)
    is_near |= trial.on_smooth_lines(scatter).trusted(vertex)

    whole = np.flatnonzero(parts.shell >= 0)
    off = lines.off_splines[vertex[whole]]
    is_near[whole] |= trial.at(whole).are_splines(off, parts.shell[whole])

    piece = _pieces(vertex)
    if trial.is_coarse.any() and not is_near.all():
        is_fine = trial.on_lines(scatter, lines.phase[vertex]).trusted(vertex)

        # for a mesh in one piece, as a whole: regular in parts it may have kinks between them
        is_near |= ~np.isin(piece, piece[~is_fine])

    # in part, where most of a piece is off smooth lines
    is_trusted = _whole(~faces.is_swollen & is_near, of_face)
    in_part = _more(is_irregular(scatter, trial), piece, 0.5)
    if not in_part.any():
        return Trusted(is_trusted, weight, is_coarse)

    # there given normals are off as well, and those of the facets with them
    trial = trial._replace(gained=trial.apart)
    is_near |= trial.trusted(vertex)
    far = weights(len(v.at), vertex, trial, _whole(~faces.is_swollen & is_near, of_face))

    far[vertex[parts.is_known]] = 1.0  # what is known stays whole
    of_part = vertex[in_part]
    weight[of_part] = far[of_part]
    is_kept = _whole(~faces.is_swollen & (far[vertex] > 0).any(axis=1), of_face)
    return Trusted(np.where(in_part, is_kept, is_trusted), weight, is_coarse)


def _are_coarse(scatter: Floats, trial: Trial) -> Bools:
    """Which faces (n,) turn far, or have their vertices, off by scatter (n, 3), on smooth lines:
    there normals jump for the size of the faces, not for noise.
    """
    is_regular = (scatter**2).mean(axis=1) <= AGREEMENT.scattered**2 * trial.gained
    return is_regular | (trial.turn > AGREEMENT.far)


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
