"""Smoothness of a mesh along its lines of edges: how well its vertices lie on smooth curves.

Lines go straight on from edge to edge. On a modelled mesh (a primitive, a lathe, a subdivided cage)
they run smoothly, however coarse it is. On a remeshed, decimated or scanned mesh they do not, even
if all vertices lie on the surface.
"""

from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints, take
from ..base.steps import Steps
from ..base.vectors import dot, length_of
from .vertices import Vertices


@dataclass(frozen=True)
class LineOptions:
    """Edges that form a line (docs/decisions/04-automatic-surface.md).

    Tuned by `dev.py irregular` on ellipsoids, tori and waves of 8 to 24 faces around, and on
    remeshed, decimated and noisy meshes.

    Parameters
    ----------
    bent : fraction of an edge's length, in the tangent plane: largest difference, in direction and
        length together, of the edge that continues it; without one the line ends
    vertices : number used for the highest difference: it is 0 on curves of a lower degree, and 9 %
        of the sag on a circle of eight faces
    ends : number of smooth lines that must start at a smooth vertex: two lines cross there, with
        four ends. Diagonals of quads need not be smooth, and one line alone is the circle of any
        lathe
    spokes : smallest odd number of edges of a pole, where a line continues between the two opposite
        edges. Five and seven meet in any irregular mesh, and a ball of 56 triangles, seven around,
        is closer to the intended one as drawn
    straight : rad, to the next edge: lines with less bend are straight, so not coarse. Their bend
        is rounding: of float32, up to 1e-5 in edges of a hundredth of the size
    """

    bent: float = np.sqrt(0.7)
    vertices: int = 7
    ends: int = 3
    spokes: int = 9
    straight: float = 1e-3


LINES = LineOptions()

# combines three fourth differences of seven vertices into the sixth, which is 0 on a smooth line
SMOOTH = ((1, -2, 1),)


class Lines(NamedTuple):
    """Smoothness of the lines through vertices (f,).

    scatter : distance of the vertices from smooth lines, in units of the given size; infinite
        without lines
    phase : rad squared: squared step along a circle, an ellipse or a wave from vertex to vertex, on
        the coarsest line
    """

    scatter: Floats
    phase: Floats


def line_steps(v: Vertices, size: Floats) -> Steps[Lines]:
    """Smoothness and coarseness of the lines through vertices of sizes (f,), m.

    The scatter is the highest difference along the line (rms 1 for vertices off by 1 at random).
    All directions count: vertices of a remeshed mesh are off mostly sideways. The phase is the
    fourth difference over the second, in the middle: on an ellipse or a wave of n vertices both
    have one direction and the ratio (2 sin(pi / n))^2, for any axes. On a straight line it is 0,
    except for rounding.
    """
    across, poles = _find_across(v)
    yield 0

    n = LINES.vertices
    second, *fourths = (
        np.pad(_weights(order), (k, n - 1 - order - k))
        for order, k in ((2, 2), (4, 0), (4, 1), (4, 2))
    )
    back = _find_back(v)
    onward = across[back]
    to_poles = [(spokes, back[spokes], _half_on(spokes.shape[1])) for spokes in poles]
    at = take(v.at, v.start)
    is_line = np.ones(len(at), bool)
    differences = np.zeros((4, len(at), 3))
    for k, weights in enumerate(np.stack([second, *fourths], axis=1)):
        if k == 1:
            at = take(v.at, v.end)
        elif k:
            # the place one vertex nearer, on the line that continues at the end of the pair
            before, was_line = at, is_line
            at = take(before, onward)
            is_line = take(was_line, onward) & (onward >= 0)
            for spokes, ends, half_on in to_poles:
                at[ends] = np.matmul(half_on, before[spokes])
                is_line[ends] = was_line[spokes].all(axis=1)[:, None]
        for difference, weight in zip(differences, weights, strict=True):
            if weight:
                difference += weight * at
        yield 0

    # a vertex in the same place as all its neighbours has no line
    bend = length_of(differences[0])
    bends = length_of(differences[2])
    least = LINES.straight * take(size, v.start)
    phase = np.divide(bends, np.maximum(bend, least), out=np.zeros(len(least)), where=least > 0)
    off = np.where(is_line, off_lines(differences[1:], SMOOTH), np.inf)
    yield 0

    # near a rim a line does not fit on one side: the value of the other side counts for both
    fits = is_line | (across < 0)
    off, phase = (np.where(fits, x, x[across]) for x in (off, phase))
    yield 0

    scatter = np.full(len(v.at), np.inf)
    coarsest = np.zeros(len(v.at))
    for some, pairs in v.by_valence(np.diff(v.first) >= LINES.ends):
        ends = off[pairs]
        scatter[some] = np.partition(ends, LINES.ends - 1, axis=1)[:, LINES.ends - 1]
        # with a margin for ties, which are common on a regular mesh
        is_smooth = ends <= (1 + 1e-6) * scatter[some, None]
        coarsest[some] = np.where(is_smooth, phase[pairs], 0.0).max(axis=1)

    return Lines(scatter / size, coarsest)


def off_lines(differences: Floats, together: tuple[tuple[int, ...], ...]) -> Floats:
    """Root mean square (p,) of sums of fourth differences (3, p, 3), each 1 for vertices off by 1
    at random.
    """
    squared = np.zeros(differences.shape[1])
    for weights in together:
        norm = np.linalg.norm(np.convolve(weights, _weights(4)))
        found = np.tensordot(np.array(weights) / norm, differences, 1)
        squared += dot(found, found) / len(together)

    return np.sqrt(squared)


def _weights(order: int) -> Floats:
    """Weights of the places in a difference of some order."""
    return np.array([comb(order, k) * (-1) ** k for k in range(order + 1)], float)


def _half_on(n: int) -> Floats:
    """Weights (n, n) of n values, n odd, evenly around a circle, for the value half a circle on
    from each: between two of them, on the trigonometric polynomial through all.

    It is exact for ellipses, and the squared weights sum to 1: noise keeps its size.
    """
    steps = np.arange(n) - np.arange(n)[:, None]
    return (-1.0) ** (n // 2 + steps) / (n * np.cos(np.pi * steps / n))


def _find_across(v: Vertices) -> tuple[Ints, list[Ints]]:
    """Continuation (p,) of each pair across its vertex, -1 without one; and the spokes of poles
    without an edge opposite: their pairs (n, m), in order around.
    """
    away = take(v.at, v.end) - take(v.at, v.start)
    normal = take(v.normal, v.start)
    away -= dot(away, normal)[:, None] * normal

    across = np.full(len(v.start), -1)
    poles = []
    for some, pairs in v.by_valence(np.ones(len(v.at), bool)):
        out = away[pairs]
        both = np.matmul(out, out.transpose(0, 2, 1))
        squared = np.einsum("nii->ni", both)
        unlike = squared[:, :, None] + squared[:, None] + 2 * both  # the squared sum of two
        least = unlike.argmin(axis=2)
        is_on = np.take_along_axis(unlike, least[..., None], axis=2)[..., 0] < (
            LINES.bent**2 * squared
        )
        across[pairs] = np.where(is_on, np.take_along_axis(pairs, least, axis=1), -1)

        if pairs.shape[1] % 2 and pairs.shape[1] >= LINES.spokes:
            spokes = _find_spokes(out, v.normal[some], pairs)
            if len(spokes):
                across[spokes] = -1
                poles.append(spokes)

    return across, poles


def _find_spokes(out: Floats, normal: Floats, pairs: Ints) -> Ints:
    """Pairs (k, m), in order around, of the vertices among n whose every edge continues straighter
    between two opposite edges than along either.

    out (n, m, 3): the edges, in the planes of normals (n, 3)
    """
    first = out[:, :1]
    across = np.cross(normal[:, None], first)
    order = np.argsort(np.arctan2(dot(out, across), dot(out, first)), axis=1)
    out = np.take_along_axis(out, order[..., None], axis=1)
    half = out.shape[1] // 2
    one, other = (np.roll(out, -k, axis=1) for k in (half, half + 1))
    bent, by_one, by_other = (dot(out + on, out + on) for on in ((one + other) / 2, one, other))
    is_between = bent < np.minimum(np.minimum(by_one, by_other), LINES.bent**2 * dot(out, out))
    return np.take_along_axis(pairs, order, axis=1)[is_between.all(axis=1)]


def _find_back(v: Vertices) -> Ints:
    """The reverse (p,) of each pair."""
    # its rank by (start, end) is the pair's rank by (end, start)
    by_end = np.argsort(v.end, kind="stable")
    back = np.empty_like(by_end)
    back[by_end[np.argsort(v.start[by_end], kind="stable")]] = by_end
    return back
