"""How smoothly the vertices of a mesh are laid out along its lines, from edge to edge straight on.

Lines of a mesh that was drawn (a primitive, a lathe, a subdivided cage) run on smoothly, however
coarse it is. Those of a mesh that was remeshed, decimated or scanned do not, even where all
vertices lie on the surface.
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
    spokes : so many edges of an odd vertex, and more, make it a pole, through which a line goes on
        between the two of the other side. Five and seven meet in any irregular mesh, and a ball of
        56 triangles, seven around, is nearer to the one meant as drawn
    straight : rad, to the next edge: lines that bend by less are straight, and so not coarse. What
        they bend by is rounding: of float32, up to 1e-5 in edges of a hundredth of the size
    """

    bent: float = np.sqrt(0.7)
    vertices: int = 7
    ends: int = 3
    spokes: int = 9
    straight: float = 1e-3


LINES = LineKnobs()

# Of the three fourth differences of seven vertices the sixth, which is 0 on a smooth line
SMOOTH = ((1, -2, 1),)


class Lines(NamedTuple):
    """What lines tell of the vertices (f,) that they run through.

    scatter : how far vertices lie off smooth lines, in units of the size asked for; infinite where
        there are no lines
    phase : rad squared: by how much of a circle, an ellipse or a wave the lines go on from vertex
        to vertex, where they are coarsest
    """

    scatter: Floats
    phase: Floats


def look_along_lines(v: Vertices, size: Floats) -> Steps[Lines]:
    """How smooth and how coarse lines are, of sizes (f,).

    The scatter is the highest difference along the line (rms 1 for vertices that are off by 1 at
    random). What is counted is off in any direction: sideways a remeshed mesh is off most. The
    phase is the fourth difference over the second, in the middle: on an ellipse or a wave of n
    vertices both are of one direction, and (2 sin(pi / n))^2 apart whatever its axes. That of a
    straight line is 0, but for rounding.
    """
    across, poles = _find_across(v)
    yield 0

    # along the lines that start with each pair, all at once
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
            # what is one vertex nearer in the line that goes on from the end of the pair
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

    # a vertex in one place with all its neighbours has no line
    bend = length_of(differences[0])
    bends = length_of(differences[2])
    least = LINES.straight * take(size, v.start)
    phase = np.divide(bends, np.maximum(bend, least), out=np.zeros(len(least)), where=least > 0)
    off = np.where(is_line, off_lines(differences[1:], SMOOTH), np.inf)
    yield 0

    # near a rim a line has no room one way, and counts for both
    has_room = is_line | (across < 0)
    off, phase = (np.where(has_room, x, x[across]) for x in (off, phase))
    yield 0

    scatter = np.full(len(v.at), np.inf)
    coarsest = np.zeros(len(v.at))
    for some, pairs in v.by_valence(np.diff(v.first) >= LINES.ends):
        ends = off[pairs]
        scatter[some] = np.partition(ends, LINES.ends - 1, axis=1)[:, LINES.ends - 1]
        # on a regular mesh many are the same
        is_smooth = ends <= (1 + 1e-6) * scatter[some, None]
        coarsest[some] = np.where(is_smooth, phase[pairs], 0.0).max(axis=1)

    return Lines(scatter / size, coarsest)


def off_lines(differences: Floats, together: tuple[tuple[int, ...], ...]) -> Floats:
    """Root of the mean square (p,) of sums of fourth differences (3, p, 3), each of which is 1 for
    vertices that are off by 1 at random.
    """
    squared = np.zeros(differences.shape[1])
    for weights in together:
        norm = np.linalg.norm(np.convolve(weights, _weights(4)))
        found = np.tensordot(np.array(weights) / norm, differences, 1)
        squared += dot(found, found) / len(together)

    return np.sqrt(squared)


def _weights(order: int) -> Floats:
    """Of the places that a difference of some order is made of."""
    return np.array([comb(order, k) * (-1) ** k for k in range(order + 1)], float)


def _half_on(n: int) -> Floats:
    """Weights (n, n) of n values, odd, evenly around a circle, of what is half a circle on from
    each: between two of them, by the trigonometric polynomial through all. For ellipses that is
    exact, and the sum of the squares is 1: noise stays as it is.
    """
    steps = np.arange(n) - np.arange(n)[:, None]
    return (-1.0) ** (n // 2 + steps) / (n * np.cos(np.pi * steps / n))


def _find_across(v: Vertices) -> tuple[Ints, list[Ints]]:
    """The pair (p,) on the other side of its vertex that each goes on from, -1 where none is; and
    the spokes of poles with no edge on the other side: their pairs (n, m), in order around.
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
    """The pairs (k, m), in order around, of those of n vertices from each of which the middle of
    two runs on straighter than both. out (n, m, 3): their edges, in the planes of normals (n, 3).
    """
    first = out[:, :1]
    aside = np.cross(normal[:, None], first)
    order = np.argsort(np.arctan2(dot(out, aside), dot(out, first)), axis=1)
    out = np.take_along_axis(out, order[..., None], axis=1)
    half = out.shape[1] // 2
    one, other = (np.roll(out, -k, axis=1) for k in (half, half + 1))
    bent, by_one, by_other = (dot(out + on, out + on) for on in ((one + other) / 2, one, other))
    is_between = bent < np.minimum(np.minimum(by_one, by_other), LINES.bent**2 * dot(out, out))
    return np.take_along_axis(pairs, order, axis=1)[is_between.all(axis=1)]


def _find_back(v: Vertices) -> Ints:
    """The pair (p,) that runs the other way, of each."""
    # it has the same place among those that are sorted by their ends first
    by_end = np.argsort(v.end, kind="stable")
    back = np.empty_like(by_end)
    back[by_end[np.argsort(v.start[by_end], kind="stable")]] = by_end
    return back
