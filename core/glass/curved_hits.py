"""Intersections of rays with curved faces, on the side of the surface each ray comes from.

A ray meets point(u, v) where the part of point(u, v) - origin across the ray is 0. Newton's method
starts at the ray engine's hit on the bounding shell. A root beyond an edge can only lie on the
neighbour: the search restarts there. Near a turning point the matrix is singular: such rays do not
converge, and count as misses. A root on the impossible side starts a search for the other root:
first along the ray's own course on the face, then from many places around.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.products import combine
from ..base.vectors import dot
from .curved import EDGE, FACES_AT_ONCE, CurvedFaces
from .quartics import TO_BEZIER, cross, product, tangents, value_and_slopes


@dataclass(frozen=True)
class RootOptions:
    """Options of the root search, tuned on grazing rays and short chords
    (tests/core/test_curved.py, "Silhouettes"), and for time. The kernel's curved.c has the same
    numbers.

    Parameters
    ----------
    iterations : of Newton's method
    patience, hopeless : after so many steps a ray is given up if its step in u, v is larger
    converged : last step in u, v: the remaining error is below its square
    longest_step : in u, v
    aside : in u, v: a root further beyond an edge is searched on the next face
    walks : most faces a search may visit
    last_walks : the same if all faces near the ray are tested anyway
    corner_turns : most faces searched around a corner, in each direction
    starts : u, v where the search of a face starts
    few_starts : number of starts for a ray without a root: most often there is none
    searched_at_once : rays in a batch of the search around, with 50 roots each
    course_step : step in u, v along the ray's course over a face, to measure its turn
    """

    iterations: int = 12
    patience: int = 6
    hopeless: float = 0.05
    converged: float = 3e-6
    longest_step: float = 0.5
    aside: float = 0.6
    walks: int = 8
    last_walks: int = 2
    corner_turns: int = 32
    starts: tuple[tuple[float, float], ...] = ((1 / 3, 1 / 3), (0.1, 0.1), (0.8, 0.1), (0.1, 0.8))
    few_starts: int = 2
    searched_at_once: int = 1 << 8
    course_step: float = 1e-3


ROOTS = RootOptions()


class RayLines(NamedTuple):
    """Rays: origins (n, 3) m, and unit directions (n, 3)."""

    origins: Floats
    directions: Floats

    def at(self, i: Ints | Bools | slice) -> "RayLines":
        if isinstance(i, slice):
            return RayLines(self.origins[i], self.directions[i])
        return RayLines(take(self.origins, i), take(self.directions, i))


class Spots(NamedTuple):
    """Places u, v (n,) on the curved faces of triangles (n,)."""

    triangle: Ints
    u: Floats
    v: Floats

    def at(self, i: Ints | Bools | slice) -> "Spots":
        return Spots(self.triangle[i], self.u[i], self.v[i])


class Roots(NamedTuple):
    """Roots of n rays on curved faces.

    triangle (n,), u (n,), v (n,); distance (n,) m; enters (n,): the ray comes from the front;
    facing (n, 3): normal to the face, not unit; is_met (n,): a root was found
    """

    triangle: Ints
    u: Floats
    v: Floats
    distance: Floats
    enters: Bools
    facing: Floats
    is_met: Bools

    @property
    def spots(self) -> Spots:
        return Spots(self.triangle, self.u, self.v)

    def put(self, rays: Ints, others: "Roots", chosen: Bools | Ints | slice = slice(None)) -> None:
        """Replace the roots of some rays by the chosen ones of `others`."""
        for mine, theirs in zip(self, others, strict=True):
            mine[rays] = theirs[chosen]


def follow(faces: CurvedFaces, spots: Spots, lines: RayLines, walks: int) -> Roots:
    """Roots on either side, each followed over at most `walks` faces."""
    n = max(len(spots.triangle), 1)
    some = [slice(first, first + FACES_AT_ONCE) for first in range(0, n, FACES_AT_ONCE)]
    parts = [_follow(faces, spots.at(part), lines.at(part), walks) for part in some]
    if len(parts) == 1:
        return parts[0]
    return Roots(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _follow(faces: CurvedFaces, spots: Spots, lines: RayLines, walks: int) -> Roots:
    # singular near a turning point: not converged, a miss
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        search = _NewtonSearch(faces, spots, lines)
        live = np.arange(len(search.k))
        is_active = _is_active(search.u, search.v, search.size, search.n_steps)
        while True:
            done = live[~is_active]
            if len(done):
                live = np.concatenate([live[is_active], search.step_over(done, walks)])
            if not len(live):
                return search.roots()
            is_active = search.step(live)


class _NewtonSearch:
    """Newton's method on the part of point(u, v) - origin across rays, face by face.

    Rays step together, whichever face each is on: a step of few takes nearly as long as one of
    many. Steps and range are limited.
    """

    def __init__(self, faces: CurvedFaces, spots: Spots, lines: RayLines) -> None:
        self.faces, self.lines = faces, lines
        self.k = k = spots.triangle.copy()
        self.c, self.away = _seen_from(faces, k, lines.origins)
        self.d = lines.directions.T.copy()
        self.u, self.v, self.size = spots.u.copy(), spots.v.copy(), np.ones(len(k))
        self.n_steps = np.zeros(len(k), np.int64)
        self.n_faces = np.ones(len(k), np.int64)

        # two steps of all rays: hardly any is done sooner
        for _ in range(2):
            self.u, self.v, self.size = _step(self.c, self.away, self.d, self.u, self.v)
            self.n_steps += 1

    def step(self, some: Ints) -> Bools:
        """Advance some rays (m,) by a step; returns a mask of rays to continue on their faces."""
        u, v, size = _step(
            self.c.take(some, axis=2),
            self.away.take(some, axis=1),
            self.d.take(some, axis=1),
            self.u[some],
            self.v[some],
        )
        n_steps = self.n_steps[some] + 1
        self.u[some], self.v[some], self.size[some], self.n_steps[some] = u, v, size, n_steps
        return _is_active(u, v, size, n_steps)

    def step_over(self, some: Ints, walks: int) -> Ints:
        """Move rays to the next face if their root is beyond an edge, or the search far beyond it.

        some: rays done with their faces; walks: most faces for a ray. Returns the moved rays.
        """
        u, v = self.u[some], self.v[some]
        outside = _outside(u, v)
        far = np.flatnonzero((self.size[some] < ROOTS.converged) | (outside <= -ROOTS.aside))
        row = self.faces.row[self.k[some[far]]]
        is_beyond = ~(outside[far] >= -self.faces.slack(row))
        is_beyond &= self.n_faces[some[far]] < walks
        if not is_beyond.any():
            return some[:0]

        left, row = far[is_beyond], row[is_beyond]
        u, v = u[left], v[left]
        edge = np.stack([v, 1 - u - v, u]).argmin(axis=0)
        following = self.faces.neighbour[row, edge]
        has_next = following >= 0
        on, following = some[left[has_next]], following[has_next]
        if len(on):
            row, edge, u, v = row[has_next], edge[has_next], u[has_next], v[has_next]
            self.k[on] = following
            self.u[on], self.v[on] = _step_over(self.faces, row, edge, u, v)
            origins = self.lines.origins.take(on, axis=0)
            self.c[..., on], self.away[:, on] = _seen_from(self.faces, following, origins)
            self.n_steps[on] = 0
            self.n_faces[on] += 1
        return on

    def roots(self) -> Roots:
        """The roots reached so far."""
        at, by_u, by_v = value_and_slopes(self.c, self.u, self.v)
        at += self.away
        facing = cross(by_u, by_v)
        is_within = _outside(self.u, self.v) >= -self.faces.slack(self.faces.row[self.k])
        return Roots(
            triangle=self.k,
            u=self.u,
            v=self.v,
            distance=product(self.d, at),
            enters=product(self.d, facing) < 0,
            facing=facing.T,
            is_met=is_within & (self.size < ROOTS.converged),
        )


def _outside(u: Floats, v: Floats) -> Floats:
    """Barycentric distance (n,) of places from the nearest edge; negative outside."""
    return np.minimum(np.minimum(v, 1 - u - v), u)


def _seen_from(faces: CurvedFaces, k: Ints, origins: Floats) -> tuple[Floats, Floats]:
    """Coefficients (14, 3, n) of the faces of triangles k (n,), and their first corners (3, n)
    relative to the rays' origins (n, 3).
    """
    return faces.terms(k), (faces.corners[k, 0] - origins).T.copy()


def _step_over(
    faces: CurvedFaces, row: Ints, edge: Ints, u: Floats, v: Floats
) -> tuple[Floats, Floats]:
    """Places on the neighbours, on the shared edges, next to where u, v left their faces."""
    along = np.choose(edge, [u, v, 1 - u - v])  # weight of the edge's second corner
    along = np.minimum(np.maximum(along, 0.0), 1.0)
    # the edge runs the other way there
    back = 1 - along
    theirs = faces.neighbour_edge[row, edge]
    return np.choose(theirs, [back, along, 0.0]), np.choose(theirs, [0.0, back, along])


def _step(
    terms: Floats, away: Floats, directions: Floats, u: Floats, v: Floats
) -> tuple[Floats, Floats, Floats]:
    """Next u, v (n,) by Newton's method, and the size of the step before it was limited."""
    at, by_u, by_v = value_and_slopes(terms, u, v)
    at += away

    # at + du by_u + dv by_v is along the ray: multiplied by the ray and by_u or by_v, one unknown
    # is left
    across = cross(at, directions)
    inverse = 1.0 / product(directions, cross(by_u, by_v))
    du = product(across, by_v) * inverse
    dv = -product(across, by_u) * inverse
    size = np.maximum(np.abs(du), np.abs(dv))
    limit = np.fmin(ROOTS.longest_step / size, 1.0)

    # fmax and fmin replace NaN by a number
    return (
        np.fmin(np.fmax(u + limit * du, -1.0), 2.0),
        np.fmin(np.fmax(v + limit * dv, -1.0), 2.0),
        size,
    )


def _is_active(u: Floats, v: Floats, size: Floats, n_steps: Ints) -> Bools:
    """Mask of roots (n,) to follow further on their faces; size: of the last of n_steps."""
    is_near = np.minimum(np.minimum(u, v), 1.0 - u - v) > -ROOTS.aside
    is_hopeful = (n_steps <= ROOTS.patience) | (size < ROOTS.hopeless)
    is_open = ~(size < ROOTS.converged) & is_near & is_hopeful & (n_steps < ROOTS.iterations)
    return is_open | (n_steps < 2)


def find_roots(
    faces: CurvedFaces,
    spots: Spots,
    lines: RayLines,
    leaves: Bools | None,
    least: float,
    is_last: bool = False,
) -> Roots:
    """Intersections of rays with the curved surface, starting at places (n,) on it.

    Parameters
    ----------
    leaves : (n,) the ray comes from inside and can hit from behind only; None: from either side.
        For a root on the other side, the root before or after it is searched, except for rays just
        leaving the surface, with a root nearer than `least`, m
    is_last : all faces near the ray are tested anyway: do not search around
    """
    walks = ROOTS.last_walks if is_last else ROOTS.walks
    found = follow(faces, spots, lines, walks)
    if leaves is None:
        return found

    def find_odd() -> Ints:
        """Rays with a root on the wrong side."""
        is_odd = found.is_met & (found.enters == leaves)
        return np.flatnonzero(is_odd & (leaves | (found.distance > least)))

    # first equally far beyond the point where the ray touches the surface
    lost = np.flatnonzero(~found.is_met)
    odd = find_odd()
    if len(odd):
        some = lines.at(odd)
        beyond = _reflected(faces, found.spots.at(odd), some.directions)
        others = follow(faces, beyond, some, walks)
        better = others.is_met & (others.enters != leaves[odd])
        found.put(odd[better], others, better)
        odd = find_odd()
        # a ray that starts on the surface goes on to the next hit
        odd = odd[found.distance[odd] > least]

    if not is_last and len(odd) + len(lost):
        # light on its way in meets a front before this back; inside, the back is further on; a
        # grazing ray without a root may still meet the surface, though most do not
        wrong = found.distance[odd]
        around = _Around(
            rays=np.append(odd, lost),
            near=np.append(found.triangle[odd], spots.triangle[lost]),
            least=np.append(np.where(leaves[odd], wrong, -np.inf), np.full(len(lost), least)),
            most=np.append(np.where(leaves[odd], np.inf, wrong), np.full(len(lost), np.inf)),
            n_starts=np.repeat([len(ROOTS.starts), ROOTS.few_starts], [len(odd), len(lost)]),
        )
        _search_around(faces, found, around, lines, leaves)

    return found


def pass_by(spheres: tuple[Floats, Floats], lines: RayLines) -> tuple[Ints, Ints]:
    """Pairs (m,) of a ray and a sphere its line enters, by number, for spheres with centres (t, 3)
    and radii (t,).
    """
    origins, directions = lines
    centre, radius = spheres
    middle = centre[0]  # an origin near the spheres keeps the squares accurate
    o = origins - middle
    o -= dot(o, directions)[:, None] * directions
    away = centre - middle
    columns = np.ascontiguousarray(away.T)

    # squared distances of the centres from the lines; products of matrices are many times as fast
    squares = dot(away, away)
    apart = combine(2 * o, columns)
    np.subtract(squares, apart, out=apart)
    apart += dot(o, o)[:, None]
    along = combine(directions, columns)
    along *= along
    apart -= along
    return np.nonzero(apart <= (1 + 1e-5) * radius**2 + 1e-12 * squares.max())


def are_in_boxes(faces: CurvedFaces, k: Ints, lines: RayLines) -> Bools:
    """Whether each ray passes through the box (n,) around the curved face of triangle k (n,)."""
    parts = [slice(first, first + FACES_AT_ONCE) for first in range(0, len(k), FACES_AT_ONCE)]
    holds = [_is_in_box(faces, k[some], lines.at(some)) for some in parts]
    return np.concatenate([np.zeros(0, bool), *holds])


def _is_in_box(faces: CurvedFaces, k: Ints, lines: RayLines) -> Bools:
    """One batch of `are_in_boxes`, with the box around the Bezier points, as seen along the ray.

    Always true for faces followed beyond their edges.
    """
    c = faces.terms(k)
    away = (faces.corners[k, 0] - lines.origins).T
    holds = np.ones(len(k), bool)

    for axis in tangents(lines.directions):
        a = axis.T
        seen = combine(TO_BEZIER, c[:, 0] * a[0] + c[:, 1] * a[1] + c[:, 2] * a[2])
        low = seen.min(axis=0)
        high = seen.max(axis=0)
        at = -(away * a).sum(axis=0)
        slack = 2 * EDGE * (high - low)
        holds &= (low - slack <= at) & (at <= high + slack)

    return holds | (np.asarray(faces.slack(faces.row[k])) > EDGE)


class _Around(NamedTuple):
    """Rays (n,) to search on triangles (n,) and around, between two distances (n,), m, with a
    number of starts (n,) on each face.
    """

    rays: Ints
    near: Ints
    least: Floats
    most: Floats
    n_starts: Ints


def _search_around(
    faces: CurvedFaces,
    found: Roots,
    around: _Around,
    lines: RayLines,
    leaves: Bools,
) -> None:
    """Store the nearest root of each ray on the right side of the faces around."""
    starts = np.array(ROOTS.starts)
    for first in range(0, len(around.rays), ROOTS.searched_at_once):
        some = _Around(*(column[first : first + ROOTS.searched_at_once] for column in around))
        near = _faces_around(faces, some.near)

        i, j = np.nonzero(near >= 0)
        k = near[i, j]
        holds = are_in_boxes(faces, k, lines.at(some.rays[i]))
        i, k = i[holds], k[holds]
        start, of_place = np.nonzero(np.arange(len(starts))[:, None] < some.n_starts[i])
        i, k = i[of_place], k[of_place]
        u, v = starts[start].T
        if not len(k):
            continue
        rays = some.rays[i]
        others = follow(faces, Spots(k, u, v), lines.at(rays), ROOTS.walks)
        is_between = (others.distance > some.least[i]) & (others.distance < some.most[i])
        good = np.flatnonzero(others.is_met & (others.enters != leaves[rays]) & is_between)

        # nearest last: it overwrites the others
        good = good[np.argsort(-others.distance[good], kind="stable")]
        found.put(rays[good], others, good)


def _faces_around(faces: CurvedFaces, triangles: Ints) -> Ints:
    """Triangles (n, m): the given ones (n,), then the curved ones around their corners; -1 for
    none.
    """
    n = len(triangles)
    first = np.tile(triangles, 3)
    corner = np.repeat(np.arange(3), n)
    is_open = np.ones(3 * n, bool)  # not yet once around
    sides = []
    for side in (1, 0):
        k, at = np.where(is_open, first, -1), corner  # number of the corner in face k
        turns = [np.full(3 * n, -1)]
        for _ in range(ROOTS.corner_turns):
            row, edge = faces.row[k], (at + 2 + side) % 3
            across = np.where(k >= 0, faces.neighbour[row, edge], -1)
            is_open &= across != first
            at = (faces.neighbour_edge[row, edge] + side) % 3
            k = np.where(is_open, across, -1)
            if (k < 0).all():
                break
            turns.append(k)
        sides.append(np.stack(turns, axis=1).reshape(3, n, -1))

    # corner by corner, first in one direction, then in the other
    around = np.concatenate(sides, axis=2).transpose(1, 0, 2).reshape(n, -1)
    return np.concatenate([triangles[:, None], around], axis=1)


def _reflected(faces: CurvedFaces, spots: Spots, directions: Floats) -> Spots:
    """Places about as far beyond the point where rays touch the surface as `spots` are before it,
    or the reverse.
    """
    k, u, v = spots
    c = faces.terms(k)
    d = directions.T

    def facing(u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        _, by_u, by_v = value_and_slopes(c, u, v)
        return (d * cross(by_u, by_v)).sum(axis=0), by_u, by_v

    # the ray's course on the face: d = a by_u + b by_v, without the part perpendicular to both
    here, by_u, by_v = facing(u, v)
    uu = (by_u**2).sum(axis=0)
    uv = (by_u * by_v).sum(axis=0)
    vv = (by_v**2).sum(axis=0)
    du = (d * by_u).sum(axis=0)
    dv = (d * by_v).sum(axis=0)

    with np.errstate(invalid="ignore", divide="ignore"):
        a = (vv * du - uv * dv) / (uu * vv - uv * uv)
        b = (uu * dv - uv * du) / (uu * vv - uv * uv)
        size = np.maximum(np.abs(a), np.abs(b))
        a = a / size
        b = b / size

        # twice the step to the place where the face is seen edge-on
        step = ROOTS.course_step
        length = -2 * here * step / (facing(u + step * a, v + step * b)[0] - here)

    length = np.clip(np.nan_to_num(length), -1.0, 1.0)
    return Spots(k, u + length * np.nan_to_num(a), v + length * np.nan_to_num(b))
