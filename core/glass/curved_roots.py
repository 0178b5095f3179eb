"""Roots of curved faces by Newton's method, followed from face to face.

A ray meets point(u, v) where the part of point(u, v) - origin across the ray is 0. A root beyond an
edge of its face lies on the neighbour, if anywhere: there Newton's method begins once more. Near a
turning point the matrix is singular: such rays do not converge, and count as no hit.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Bools, Floats, Ints
from .curved import FACES_AT_ONCE, CurvedFaces
from .quartics import cross, product, value_and_slopes


@dataclass(frozen=True)
class RootKnobs:
    """How roots are looked for; the kernel's curved.c has the same numbers.

    Tuned where rays graze and chords are short (tests/core/test_curved.py, "Silhouettes"), and
    for time by `dev.py curved`.

    Parameters
    ----------
    iterations : of Newton's method
    patience, hopeless : after so many it is given up for rays whose steps in u, v are still larger
    converged : step in u, v after which it ends: the rest is less than the step's square
    longest_step : in u, v
    aside : in u, v: a root is not looked for further than this beyond an edge, but on the next face
    walks : faces that a root may wander over
    last_walks : the same where all faces near the ray are asked anyway
    rings : of neighbours that are searched for the root on the right side
    starts : u, v from which a face is searched for a root
    searched_at_once : rays for which the faces around are searched together, 50 roots each
    course_step : of u, v along the ray's course over a face, by which its turn is measured
    """

    iterations: int = 12
    patience: int = 6
    hopeless: float = 0.05
    converged: float = 3e-6
    longest_step: float = 0.5
    aside: float = 0.6
    walks: int = 8
    last_walks: int = 2
    rings: int = 2
    starts: tuple[tuple[float, float], ...] = ((1 / 3, 1 / 3), (0.1, 0.1), (0.8, 0.1), (0.1, 0.8))
    searched_at_once: int = 1 << 8
    course_step: float = 1e-3


ROOTS = RootKnobs()


class Lines(NamedTuple):
    """Rays: origins (n, 3) m, and unit directions (n, 3)."""

    origins: Floats
    directions: Floats

    def at(self, i: Ints | Bools | slice) -> "Lines":
        """Some of the rays."""
        return Lines(self.origins[i], self.directions[i])


class Spots(NamedTuple):
    """Places u, v (n,) on the curved faces of triangles (n,)."""

    triangle: Ints
    u: Floats
    v: Floats

    def at(self, i: Ints | Bools | slice) -> "Spots":
        """Some of the places."""
        return Spots(self.triangle[i], self.u[i], self.v[i])


class Roots(NamedTuple):
    """Where n rays meet curved faces.

    triangle (n,), u (n,), v (n,); distance (n,) m; enters (n,) the ray comes from the front;
    facing (n, 3), normal to the face, and normal (n, 3), by which it refracts: neither is unit, and
    they may be one array; is_met (n,): whether there is a root at all
    """

    triangle: Ints
    u: Floats
    v: Floats
    distance: Floats
    enters: Bools
    facing: Floats
    normal: Floats
    is_met: Bools

    @property
    def spots(self) -> Spots:
        """The places on the faces."""
        return Spots(self.triangle, self.u, self.v)

    def put(self, rays: Ints, others: "Roots", chosen: Bools | Ints | slice = slice(None)) -> None:
        """Replace those of some rays by the chosen ones of others."""
        for mine, theirs in zip(self, others, strict=True):
            mine[rays] = theirs[chosen]


def follow(faces: CurvedFaces, spots: Spots, lines: Lines, walks: int) -> Roots:
    """Roots of whichever side, each followed over so many faces."""
    found = _newton(faces, spots._replace(triangle=spots.triangle.copy()), lines)
    is_done = found.is_met.copy()
    todo = np.arange(len(is_done))

    for walk in range(walks):
        if walk:
            others = _newton(faces, found.spots.at(todo), lines.at(todo))
            found.put(todo, others)
            is_done = others.is_met

        # distances from the edges
        u = found.u[todo]
        v = found.v[todo]
        outside = np.stack([v, 1 - u - v, u])
        least = np.minimum(np.minimum(outside[0], outside[1]), outside[2])
        row = faces.row[found.triangle[todo]]
        is_within = least >= -faces.slack(row)
        found.is_met[todo] = is_done & is_within

        # a root beyond an edge, or one that is looked for
        # far beyond it, may lie on the next face
        left = np.flatnonzero(~is_within & (is_done | (least <= -ROOTS.aside)))
        edge = outside[:, left].argmin(axis=0)
        row = row[left]
        following = faces.neighbour[row, edge]
        goes_on = following >= 0
        if not goes_on.any():
            break

        todo = todo[left[goes_on]]
        found.triangle[todo] = following[goes_on]
        found.u[todo], found.v[todo] = _step_over(
            faces, row[goes_on], edge[goes_on], found.u[todo], found.v[todo]
        )

    return found


def _step_over(
    faces: CurvedFaces, row: Ints, edge: Ints, u: Floats, v: Floats
) -> tuple[Floats, Floats]:
    """Places on the neighbours across edges next to where u, v left their faces."""
    along = np.choose(edge, [u, v, 1 - u - v])  # weight of the corner in which the edge ends
    along = np.clip(along, 0.0, 1.0)
    weights = np.zeros((len(row), 3))
    n = np.arange(len(row))
    theirs = faces.neighbour_edge[row, edge].astype(int)

    # it runs the other way there
    weights[n, theirs] = along
    weights[n, (theirs + 1) % 3] = 1 - along
    return weights[:, 1], weights[:, 2]


def _newton(faces: CurvedFaces, spots: Spots, lines: Lines) -> Roots:
    """Newton's method on the part of point(u, v) - origin across the ray.

    Steps and range are limited. `is_met` tells which rays have converged, on the face or beyond.
    """
    k = spots.triangle
    c = faces.terms(k)
    away = (np.take(faces.corners, k, axis=0)[:, 0] - lines.origins).T.copy()
    d = lines.directions.T.copy()
    u = spots.u.copy()
    v = spots.v.copy()
    size = np.empty(len(k))
    distance = np.empty(len(k))
    facing = np.empty((3, len(k)))

    def finish(rays: Ints | slice, terms: Floats) -> None:
        at, by_u, by_v = value_and_slopes(terms, u[rays], v[rays])
        at += away[:, rays]
        distance[rays] = product(d[:, rays], at)
        facing[:, rays] = cross(by_u, by_v)

    # near a turning point the matrix is singular: such
    # rays do not converge, and count as no hit
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # two steps of all rays: hardly any is done sooner
        for first in range(0, len(k), FACES_AT_ONCE):
            some = slice(first, first + FACES_AT_ONCE)
            terms = c[..., some]
            rest = away[:, some]
            along = d[:, some]
            x, y, _ = _step(terms, rest, along, u[some], v[some])
            u[some], v[some], size[some] = _step(terms, rest, along, x, y)
            finish(some, terms)

        # then of the others, until they have converged or are given up
        late = live = np.flatnonzero(_goes_on(u, v, size))
        for turn in range(2, ROOTS.iterations):
            if not len(live):
                break
            x, y, size[live] = _step(c[..., live], away[:, live], d[:, live], u[live], v[live])
            u[live] = x
            v[live] = y
            is_hopeful = turn < ROOTS.patience or size[live] < ROOTS.hopeless
            live = live[_goes_on(x, y, size[live]) & is_hopeful]

        if len(late):
            finish(late, c[..., late])

    return Roots(
        triangle=k,
        u=u,
        v=v,
        distance=distance,
        enters=product(d, facing) < 0,
        facing=facing.T,
        normal=faces.refracting(facing.T, k, u, v),
        is_met=size < ROOTS.converged,
    )


def _step(
    terms: Floats, away: Floats, directions: Floats, u: Floats, v: Floats
) -> tuple[Floats, Floats, Floats]:
    """The next u, v (n,) by Newton's method, and the step's size before it was limited."""
    at, by_u, by_v = value_and_slopes(terms, u, v)
    at += away

    # at + du by_u + dv by_v is along the ray: multiplied by the
    # ray and one of by_u and by_v, the other one is left
    across = cross(at, directions)
    inverse = 1.0 / product(directions, cross(by_u, by_v))
    du = product(across, by_v) * inverse
    dv = -product(across, by_u) * inverse
    size = np.maximum(np.abs(du), np.abs(dv))
    limit = np.fmin(ROOTS.longest_step / size, 1.0)

    # fmax and fmin put a number in the place of NaN
    return (
        np.fmin(np.fmax(u + limit * du, -1.0), 2.0),
        np.fmin(np.fmax(v + limit * dv, -1.0), 2.0),
        size,
    )


def _goes_on(u: Floats, v: Floats, size: Floats) -> Bools:
    """Are roots (n,) to be followed further, after a step of some size to u, v?"""
    is_near = np.minimum(np.minimum(u, v), 1.0 - u - v) > -ROOTS.aside
    return ~(size < ROOTS.converged) & is_near
