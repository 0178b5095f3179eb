"""Bicubic splines: the exact limit surface of a subdivided mesh where its quads form a grid.

The limit of a grid of quads is a bicubic spline, and Blender puts vertices on it. Lines of edges
are therefore cubic splines with knots two edges apart or more. Seven places along a line, with
knots next to the middle one, are on such a spline if one sum of their fourth differences is 0: d_-1
- 4 d_0 + d_1. The derivatives at all seven follow. Derivatives along a line are splines along the
crossing lines, which gives the mixed derivatives. Each quad is exactly the bicubic of these data at
its corners, for any cage.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.products import combine
from ..base.steps import Steps
from ..base.vectors import length_of, normalise
from .grid_lines import off_lines
from .meshes import Edges
from .quartics import AT
from .vertices import Vertices


@dataclass(frozen=True, eq=False)
class QuadLines:
    """Lines (n,), one for each pair of neighbours whose first vertex has four quads.

    pair : of vertices, the first two of the line
    left : line from the same vertex, a quarter turn counter-clockwise
    back : line from the same vertex in the opposite direction
    ahead : line from the next vertex, in the same direction
    reverse : line from the next vertex, back to this one
    face : (t,) line along which a triangle that is half a quad begins, at the corner off the
        diagonal
    corner : (t,) corner off the diagonal
    is_half : (t,) triangles that are half a quad

    Numbers of lines are -1 for none.
    """

    pair: Ints
    left: Ints
    back: Ints
    ahead: Ints
    reverse: Ints
    face: Ints
    corner: Ints
    is_half: Bools


def find_quad_lines(v: Vertices, edges: Edges, polygon: Ints) -> QuadLines:
    """Lines of a mesh with triangles in polygons (t,)."""
    n = len(v.at)
    keys = v.start * n + v.end
    order = np.argsort(keys)
    keys = keys[order]

    def find(start: Ints, end: Ints) -> Ints:
        return order[np.searchsorted(keys, start * n + end)]

    is_diagonal, is_half = _halves(edges, polygon)
    corner = (is_diagonal.argmax(axis=1) + 2) % 3

    # next pair around the vertex, past the diagonal of a quad; the last entry, -1, is for none
    at, to, last = (np.roll(v.of_corner[is_half], -k, axis=1).ravel() for k in range(3))
    pairs = find(at, to)
    follows = np.full(len(keys) + 1, -1)
    follows[pairs] = find(at, last)
    is_inner = np.zeros(len(follows), bool)
    is_inner[pairs] = is_diagonal[is_half].ravel()
    follows = np.where(is_inner[follows], follows[follows], follows)
    follows[is_inner] = -1

    # opposite pairs at vertices of four: the fourth follower is the first again
    across = follows[follows]
    pair = np.flatnonzero(across[across] == np.arange(len(across)))
    line = np.full(len(across), -1)
    line[pair] = np.arange(len(pair))
    back = find(v.end[pair], v.start[pair])
    apex, ahead = (v.of_corner[np.arange(len(corner)), (corner + k) % 3] for k in (0, 1))
    return QuadLines(
        pair=pair,
        left=line[follows[pair]],
        back=line[across[pair]],
        ahead=line[np.where(line[back] < 0, -1, across[back])],
        reverse=line[back],
        face=np.where(is_half, line[find(apex, ahead)], -1),
        corner=corner,
        is_half=is_half,
    )


def _halves(edges: Edges, polygon: Ints) -> tuple[Bools, Bools]:
    """Diagonals (t, 3) of polygons (t,) among edges, and triangles (t,) that are half a quad."""
    is_diagonal = np.zeros((len(polygon), 3), bool)
    # a triangle with a repeated vertex neighbours itself
    same = (polygon[edges.first] == polygon[edges.second]) & (edges.first != edges.second)
    for t, e in ((edges.first, edges.corner_first), (edges.second, edges.corner_second)):
        is_diagonal[t[same], e[same]] = True

    n_parts = np.bincount(polygon)[polygon]
    return is_diagonal, (n_parts == 2) & (is_diagonal.sum(axis=1) == 1)


# fraction of an edge: largest distance of vertices from splines. Blender's float32 leaves up to
# 3e-5 after three levels
ROUNDING = 3e-5
# smallest share of places on splines with neighbours off by CLEAR_RATIO times more: 0.07 and more
# on subdivided meshes, 0.013 and less on balls of fine quads
EVIDENT_SHARE = 0.03
CLEAR_RATIO = 10.0

# fourth differences (3,) of seven places, and their sum for `off_lines`
FOURTHS = np.array([np.roll([1.0, -4.0, 6.0, -4.0, 1.0, 0.0, 0.0], k) for k in range(3)])
NEXT_TO_KNOTS = ((1, -4, 1),)


def _derivative_weights() -> Floats:
    """Weights (4, 7) of seven places for the derivative none to three edges before the middle one,
    with knots next to the middle: the smallest exact weights, least sensitive to rounding.
    """
    t = np.arange(-3.0, 4)
    places = [t**0, t, t**2, t**3, np.maximum(t - 1, 0) ** 3, np.maximum(t + 1, 0) ** 3]
    slopes = [0 * t, t**0, 2 * t, 3 * t**2]
    slopes += [3 * np.maximum(t - 1, 0) ** 2, 3 * np.maximum(t + 1, 0) ** 2]
    return np.array(slopes)[:, 3::-1].T @ np.linalg.pinv(np.array(places)).T


DERIVATIVES = _derivative_weights()


def _blends() -> tuple[Floats, Floats, Floats]:
    """Weights (3, 15, 16), by the corner off the diagonal, from the data at a quad's corners to the
    place and its two derivatives at the nodes and corners of half of it.
    """
    t = np.stack([np.roll(AT, -k, axis=1)[:, 1:] for k in range(3)])[..., None, :]
    values = np.concatenate(
        [1 - 3 * t**2 + 2 * t**3, 3 * t**2 - 2 * t**3, t - 2 * t**2 + t**3, t**3 - t**2], axis=2
    )
    slopes = np.concatenate(
        [6 * t**2 - 6 * t, 6 * t - 6 * t**2, 1 - 4 * t + 3 * t**2, 3 * t**2 - 2 * t], axis=2
    )

    def product(u: Floats, v: Floats) -> Floats:
        return np.einsum("knu,knv->knuv", u[..., 0], v[..., 1]).reshape(3, len(AT), 16)

    return product(values, values), product(slopes, values), product(values, slopes)


PLACE, BY_U, BY_V = _blends()


@dataclass(frozen=True, eq=False)
class Splines:
    """Parts of a mesh on a spline surface.

    is_face : (t,) triangles on it
    normal : (f, 3) unit, of the vertices at their corners, NaN elsewhere
    at : (n, 3) m, start of each line
    along, mixed : (n, 3) m, its derivative there, and the derivative along it of the crossing
        line's
    """

    lines: QuadLines
    is_face: Bools
    normal: Floats
    at: Floats
    along: Floats
    mixed: Floats

    def faces(self, triangles: Ints) -> tuple[Floats, Floats]:
        """Places and unit normals (n, 15, 3) of triangles (n,) at nodes and corners."""
        data = _at_corners(self, triangles)
        corner = self.lines.corner[triangles]
        place, by_u, by_v = (np.matmul(blend[corner], data) for blend in (PLACE, BY_U, BY_V))
        return place, normalise(np.cross(by_u, by_v))


def _quad(lines: QuadLines, first: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Lines (n,) along the sides of quads, from corner to corner; -1 if unknown."""

    def step(of: Ints, which: Ints) -> Ints:
        return np.append(of, -1)[which]

    second = step(lines.reverse, first)
    for _ in range(3):
        second = step(lines.left, second)
    fourth = step(lines.reverse, step(lines.left, first))
    third = step(lines.reverse, step(lines.left, fourth))
    return first, second, third, fourth


def _at_corners(s: Splines, triangles: Ints) -> Floats:
    """Places and derivatives (n, 16, 3) at the corners of quads, in the order of the weights."""
    data = np.empty((len(triangles), 4, 4, 3))
    for k, line in enumerate(_quad(s.lines, s.lines.face[triangles])):
        left = s.along[s.lines.left[line]]
        along = s.along[line]
        u, v = (0, 1, 1, 0)[k], (0, 0, 1, 1)[k]
        data[:, u, v] = s.at[line]
        data[:, 2 + u, v] = (along, -left, -along, left)[k]
        data[:, u, 2 + v] = (left, along, -left, -along)[k]
        data[:, 2 + u, 2 + v] = (s.mixed[line], -s.mixed[line])[k % 2]

    return data.reshape(-1, 16, 3)


def spline_steps(v: Vertices, lines: QuadLines) -> Steps[Splines | None]:
    """Spline surface of a mesh with these lines; None without one."""
    if not len(lines.pair):
        return None

    start = v.start[lines.pair]
    at = take(v.at, start)
    end = take(v.at, v.end[lines.pair])
    steps = _steps(lines)
    ahead = [_at(end, step) for step in steps[:3]]
    places = np.stack([*(there[lines.back] for there in ahead[::-1]), at, *ahead])
    yield 0
    fourths = combine(FOURTHS, places.reshape(7, -1)).reshape(3, *at.shape)
    edge = length_of(places[4] - places[2]) / 2
    with np.errstate(invalid="ignore", divide="ignore"):  # vertices in one place
        off = off_lines(fourths, NEXT_TO_KNOTS) / (ROUNDING * edge)
    is_spline = _are_splines(off, lines, steps)
    yield 0
    if is_spline is None:
        return None

    # derivatives along each line, then of crossing derivatives along it, negative on the way back
    along = _derivatives(places, is_spline, lines, steps)
    yield 0
    across = along[lines.left]
    ahead = [_at(across, step) for step in steps[1:]]
    places = np.stack([*(-there[lines.back] for there in ahead[::-1]), across, *ahead])
    mixed = _derivatives(places, is_spline, lines, steps)
    mixed = np.where(np.isnan(mixed), -mixed[lines.left], mixed)
    yield 0

    is_whole = np.isfinite(along + along[lines.left] + mixed).all(axis=1)
    is_whole = np.append(is_whole, False)
    is_face = np.logical_and.reduce([is_whole[line] for line in _quad(lines, lines.face)])
    if not is_face.any():
        return None

    normal = np.full_like(v.normal, np.nan)
    is_corner = np.zeros(len(normal), bool)
    is_corner[v.of_corner[is_face]] = True
    some = np.flatnonzero(is_corner[start])
    normal[start[some]] = normalise(np.cross(along[some], along[lines.left[some]]))
    return Splines(lines, is_face, normal, at, along, mixed)


def _are_splines(off: Floats, lines: QuadLines, steps: list[Ints]) -> Bools | None:
    """Mask (n,) of lines with places around their start on a spline; off: their distance from it,
    over the rounding error. None if any fine, smooth surface would fit as well.

    The places around a vertex two edges on or back must be on a spline, too: on a wave, places
    around the middle of a slope come close. Those around the vertex between are off, unless all are
    near.
    """
    is_near = np.append(off <= 1, False)
    is_far = np.append(off > CLEAR_RATIO, False)
    two_on = is_near[steps[2]]
    is_spline = is_near[:-1] & (two_on | two_on[lines.back])
    n_evident = (is_spline & is_far[steps[1]]).sum()
    return is_spline if n_evident > EVIDENT_SHARE * is_spline.sum() else None


def _steps(lines: QuadLines) -> list[Ints]:
    """Lines (n,) that begin none to three vertices further on, -1 for none."""
    steps = [np.arange(len(lines.ahead))]
    for _ in range(3):
        steps.append(np.append(lines.ahead, -1)[steps[-1]])
    return steps


def _at(values: Floats, which: Ints) -> Floats:
    """Values (n, 3) of the given rows, NaN for -1."""
    return np.where(which[:, None] < 0, np.nan, values[which])


def _derivatives(places: Floats, is_spline: Bools, lines: QuadLines, steps: list[Ints]) -> Floats:
    """Derivative (n, 3) along each line at its start, from seven places (7, n, 3) on a spline
    around it, or around a vertex up to three further on or back; NaN without any.
    """
    by_places = combine(DERIVATIVES, places.reshape(7, -1)).reshape(4, -1, 3)
    by_places[:, ~is_spline] = np.nan
    found = by_places[0]
    for by_place, step in zip(by_places[1:], steps[1:], strict=True):
        ahead = _at(by_place, step)
        for by_line in (ahead, -ahead[lines.back]):
            found = np.where(np.isnan(found), by_line, found)

    return found
