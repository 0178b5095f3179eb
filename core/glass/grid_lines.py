"""How smoothly the vertices of a mesh are laid out along its lines, from edge to edge straight on.

Lines of a mesh that was drawn (a primitive, a lathe, a subdivided cage) run on smoothly, however
coarse it is. Those of a mesh that was remeshed, decimated or scanned do not, even where all
vertices lie on the surface.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from ..arrays import Floats, Ints, taken
from ..steps import Pauses
from ..vectors import dot, length_of
from .vertices import Vertices


@dataclass(frozen=True)
class LineKnobs:
    """Which edges make up a line (design.md, decision 3, "Automatic").

    Tuned by `dev.py irregular` on ellipsoids, tori and waves of 8 to 24 faces around, and on
    remeshed, decimated and noisy meshes.

    Parameters
    ----------
    bent : of an edge's length, in the tangent plane: by less the edge that goes on may differ from
        it, in direction and length together; where none does a line ends
    vertices : whose highest difference is looked at: it is 0 on curves of a lower degree, and 9 %
        of the sag on a circle of eight faces
    ends : so many of the smoothest lines that start at a vertex are smooth: two lines cross there,
        with four ends. The diagonals of quads need not be smooth, and one line alone is the circle
        of any lathe
    """

    bent: float = np.sqrt(0.7)
    vertices: int = 7
    ends: int = 3


LINES = LineKnobs()


def find_scatter(v: Vertices, size: Floats) -> Pauses[Floats]:
    """How far vertices (f,) lie off smooth lines, in units of
    size (f,); infinite where there are no lines.

    It is the highest difference along the line (rms 1 for vertices that are off by 1 at random).
    What is counted is off in any direction: sideways a remeshed mesh is off most.
    """
    across = _find_across(v)
    yield 0
    last = LINES.vertices - 1
    weights = np.array([comb(last, k) * (-1) ** k for k in range(last + 1)], float)
    weights /= np.linalg.norm(weights)

    # along the lines that start with each pair, all at once
    onward = across[_find_back(v)]
    pair = np.arange(len(v.start))
    is_line = np.ones(len(pair), bool)
    difference = weights[0] * taken(v.at, v.start) + weights[1] * taken(v.at, v.end)
    for weight in weights[2:]:
        pair = onward[pair]
        is_line &= pair >= 0
        difference += weight * taken(v.at, v.end[pair])

    # near a rim a line has no room one way, and counts for both
    off = np.where(is_line, length_of(difference), np.inf)
    off = np.where(is_line | (across < 0), off, off[across])
    yield 0

    scatter = np.full(len(v.at), np.inf)
    for some, pairs in v.by_valence(np.diff(v.first) >= LINES.ends):
        scatter[some] = np.partition(off[pairs], LINES.ends - 1, axis=1)[:, LINES.ends - 1]

    return scatter / size


def _find_across(v: Vertices) -> Ints:
    """The pair (p,) on the other side of its vertex that each goes on from, -1 where none is."""
    away = taken(v.at, v.end) - taken(v.at, v.start)
    normal = taken(v.normal, v.start)
    away -= dot(away, normal)[:, None] * normal

    across = np.full(len(v.start), -1)
    for _, pairs in v.by_valence(np.ones(len(v.at), bool)):
        out = away[pairs]
        both = np.matmul(out, out.transpose(0, 2, 1))
        squared = np.einsum("nii->ni", both)
        unlike = squared[:, :, None] + squared[:, None] + 2 * both  # the squared sum of two
        least = unlike.argmin(axis=2)
        is_on = np.take_along_axis(unlike, least[..., None], axis=2)[..., 0] < (
            LINES.bent**2 * squared
        )
        across[pairs] = np.where(is_on, np.take_along_axis(pairs, least, axis=1), -1)

    return across


def _find_back(v: Vertices) -> Ints:
    """The pair (p,) that runs the other way, of each."""
    # it has the same place among those that are sorted by their ends first
    by_end = np.argsort(v.end, kind="stable")
    back = np.empty_like(by_end)
    back[by_end[np.argsort(v.start[by_end], kind="stable")]] = by_end
    return back
