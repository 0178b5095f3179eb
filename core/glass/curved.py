"""Curved faces over triangles: quartics in barycentric coordinates, and where rays meet them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..products import combine
from ..vectors import dot, normalise
from .motion import Motion
from .quartics import (
    AT_NODES,
    LOWER,
    N_TERMS,
    TO_BEZIER,
    by_term,
    cross,
    grid,
    monomials,
    product,
    table,
    tangents,
    value,
    value_and_slopes,
)

CHUNK = 1 << 12  # rays or faces worked on together: their arrays stay in the cache
ITERATIONS = 12  # of Newton's method
# after so many it is given up for rays whose steps in u, v are still larger
PATIENCE = 6
HOPELESS = 0.05
CONVERGED = 3e-6  # of a step in u, v: the rest after it is less than its square
EDGE = 1e-10  # barycentric slack, so that a ray through an edge or vertex meets a face
# u, v from which a face is searched for a root
STARTS = (1 / 3, 1 / 3), (0.1, 0.1), (0.8, 0.1), (0.1, 0.8)
SEARCHED_AT_ONCE = 1 << 8  # rays for which the faces around are searched together: 50 roots each
RINGS = 2  # of neighbours that are searched for the root on the right side
# in u, v: a root is not looked for further than this beyond an edge, but on the next face
ASIDE = 0.6
WALKS = 8  # faces a root may wander over
FINE = np.radians(3)  # the mesh that is asked for hits turns by less than this between neighbours
MOST_PARTS = 8  # parts of an edge in that mesh
MOST_OFFSET = 0.3  # of the longest edge: a curved face further from its facet than this is none
HIGHER = 1.5  # times the largest sag found at the middles of its edges: how far it stands in front


@dataclass(frozen=True, eq=False)
class CurvedFaces:
    """Curved faces over some of t triangles: point(u, v) =
    facet + sum of 14 terms u^a v^b times coefficients.

    corners (t, 3, 3) m; row (t,) of each triangle's curved face, -1 where it has none; coefficients
    (p, 14, 3) m, best stored term by term; neighbour (p, 3) the triangle across each edge (from
    corner e to e + 1) where the surface runs on, -1 elsewhere, and neighbour_edge (p, 3), its edge;
    vertex (p, 3) of the corners and vertex_normal (f, 3), the same for all faces around a vertex;
    normal_row (p,) and normal_terms (q, 14, 3): where normals of neighbours would not agree on
    their edges, or edges are straight, a face refracts by those of its vertices, interpolated, plus
    14 terms; -1 where by its own; jump (p,) rad: by how much normals of neighbours differed in the
    middles of edges, before they agreed, at most; bent_row (p,) and bent (q, 14, 3): coefficients
    that faces with a straight edge would have if it were not straight; degree: 4, or less to follow
    faces of a lower degree and see the difference; lowered_from: those of degree 4, None where
    these are
    """

    corners: Floats
    row: Ints
    coefficients: Floats
    neighbour: Ints
    neighbour_edge: Ints
    vertex: Ints
    vertex_normal: Floats
    normal_row: Ints
    normal_terms: Floats
    jump: Floats
    bent_row: Ints
    bent: Floats
    degree: int = 4
    lowered_from: "CurvedFaces | None" = None

    @classmethod
    def none(cls, corners: Floats) -> "CurvedFaces":
        """No curved face over any of the triangles (t, 3, 3)."""
        rows = np.full(0, -1)
        each = np.full((0, 3), -1)
        terms = np.empty((0, N_TERMS, 3))
        row = np.full(len(corners), -1)
        return cls(
            corners,
            row,
            terms,
            each,
            each,
            each,
            np.empty((0, 3)),
            rows,
            terms,
            np.empty(0),
            rows,
            terms,
        )

    @classmethod
    def join(cls, parts: "list[CurvedFaces | None]", corners: list[Floats]) -> "CurvedFaces | None":
        """The curved faces of several surfaces, of facets (t, 3, 3) each, in one numbering."""
        if all(part is None for part in parts):
            return None
        starts = np.cumsum([0, *(len(facets) for facets in corners)])
        row = []
        neighbour = []
        normal_row = []
        bent_row = []
        vertex = []
        n_faces = n_normals = n_bent = n_vertices = 0
        for part, facets, start in zip(parts, corners, starts, strict=False):
            if part is None:
                row.append(np.full(len(facets), -1, np.int32))
                continue
            row.append(np.where(part.row >= 0, part.row + n_faces, -1))
            neighbour.append(np.where(part.neighbour >= 0, part.neighbour + start, -1))
            normal_row.append(np.where(part.normal_row >= 0, part.normal_row + n_normals, -1))
            bent_row.append(np.where(part.bent_row >= 0, part.bent_row + n_bent, -1))
            vertex.append(part.vertex + n_vertices)
            n_faces = n_faces + len(part.coefficients)
            n_vertices = n_vertices + len(part.vertex_normal)
            n_normals = n_normals + len(part.normal_terms)
            n_bent = n_bent + len(part.bent)
        full = [part for part in parts if part is not None]
        others = ("neighbour_edge", "vertex_normal", "normal_terms", "jump", "bent")
        return cls(
            corners=np.concatenate(corners),
            row=np.concatenate(row),
            neighbour=np.concatenate(neighbour),
            normal_row=np.concatenate(normal_row),
            bent_row=np.concatenate(bent_row),
            vertex=np.concatenate(vertex),
            coefficients=by_term(np.concatenate([part.coefficients for part in full])),
            **{name: np.concatenate([getattr(part, name) for part in full]) for name in others},
        )

    def moved(self, motion: Motion) -> "CurvedFaces":
        """The same faces elsewhere."""
        vectors = ("coefficients", "bent", "vertex_normal", "normal_terms")
        turned = {name: motion.directions(getattr(self, name)) for name in vectors}
        whole = None if self.lowered_from is None else self.lowered_from.moved(motion)
        return replace(self, corners=motion.points(self.corners), lowered_from=whole, **turned)

    def lowered(self, degree: int) -> "CurvedFaces":
        """The faces of a lower degree through these, with their own
        normals, but for those held by a straight edge.
        """
        normal_row = np.where(self.bent_row >= 0, self.normal_row, -1)
        return replace(self, degree=degree, normal_row=normal_row, lowered_from=self.whole)

    @property
    def whole(self) -> "CurvedFaces":
        """The faces of degree 4 that these were lowered from, or these."""
        return self.lowered_from or self

    @property
    def triangle(self) -> Ints:
        """Triangle (p,) of each curved face."""
        return np.flatnonzero(self.row >= 0)

    @property
    def has_straight_edges(self) -> bool:
        """Is an edge of some face held straight?"""
        return len(self.bent) > 0

    @property
    def has_given_normals(self) -> bool:
        """Does some face refract by other normals than its own?"""
        return len(self.normal_terms) > 0

    def parts(self, angle: float, most: int) -> int:
        """Into how many parts edges have to be cut to turn by
        less than an angle (radians) each, but at most.
        """
        corners = self.corners[self.triangle]
        at_middles = monomials(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5]))
        middles = combine(at_middles, self._terms.reshape(N_TERMS, -1)).reshape(3, 3, -1)
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).T
        turn = 8 * np.linalg.norm(middles, axis=1) / edges  # of a parabola as high over its chord
        return int(np.clip(np.ceil(np.quantile(turn.max(axis=0), 0.999) / angle), 1, most))

    def points_on(self, k: int) -> Floats:
        """Points (p, n, 3), m, of all faces at those of grid(k)."""
        weights = grid(k)[0]
        terms = monomials(weights[:, 1], weights[:, 2])
        return np.matmul(weights, self.corners[self.triangle]) + np.matmul(terms, self.coefficients)

    def hull(self, k: int) -> Floats:
        """Triangles (p k^2, 3, 3), m, that lie just in front of all faces: k^2 for each.

        A ray that meets a face, however close to a silhouette, meets them, too. Next to
        straight edges, which they share with flat faces, they lie on the faces instead.
        """
        weights, parts = grid(k)
        n_faces = len(self.coefficients)
        points = np.empty((n_faces, len(weights), 3))
        sag = np.zeros(n_faces)
        fine = grid(2 * k)[0]
        terms = monomials(fine[:, 1], fine[:, 2])
        number = {tuple(steps): i for i, steps in enumerate(np.round(2 * k * fine).astype(int))}

        def among_fine(points: Floats) -> list[int]:
            return [number[tuple(steps)] for steps in np.round(2 * k * points).astype(int)]

        coarse = among_fine(weights)
        ends = [(weights[parts[:, e]], weights[parts[:, (e + 1) % 3]]) for e in range(3)]
        edges = [(among_fine(a), among_fine((a + b) / 2), among_fine(b)) for a, b in ends]
        triangle = self.triangle
        for first in range(0, n_faces, CHUNK):
            some = slice(first, first + CHUNK)
            at = np.matmul(terms, self.coefficients[some])
            for i, m, j in edges:
                missed = np.linalg.norm(at[:, m] - (at[:, i] + at[:, j]) / 2, axis=2).max(axis=1)
                sag[some] = np.maximum(sag[some], missed)
            points[some] = np.matmul(weights, self.corners[triangle[some]]) + at[:, coarse]
        lift = np.zeros(len(self.vertex_normal))
        np.maximum.at(lift, self.vertex.ravel(), np.repeat(HIGHER * sag, 3))
        lifted = lift[:, None] * self.vertex_normal
        is_held = np.zeros(len(lift), bool)
        on_edge = self.neighbour < 0
        is_held[self.vertex[on_edge]] = is_held[np.roll(self.vertex, -1, axis=1)[on_edge]] = True
        for first in range(0, n_faces, CHUNK):
            some = slice(first, first + CHUNK)
            raised = np.matmul(weights, lifted[self.vertex[some]])
            for corner in range(3):
                raised[is_held[self.vertex[some, corner]], weights[:, corner].argmax()] = 0.0
                # the edge that begins at this corner, where the
                # weight of the one after the next is 0
                along = weights[:, (corner + 2) % 3] == 0
                raised[np.ix_(on_edge[some, corner], along)] = 0.0
            points[some] += raised
        return points[:, parts].reshape(-1, 3, 3)

    @cached_property
    def _terms(self) -> Floats:
        return table(self.coefficients)

    @cached_property
    def _normal_terms(self) -> Floats:
        return table(self.normal_terms)

    def _load(self, k: Ints) -> Floats:
        """Coefficients (14, 3, n) of points relative to the first corner of triangles k."""
        c = np.take(self._terms, self.row[k], axis=1).reshape(N_TERMS, 3, -1)
        if self.degree != 4:
            c = combine(LOWER[self.degree], c.reshape(N_TERMS, -1)).reshape(c.shape)
        corners = np.take(self.corners, k, axis=0)
        c[:2] += (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
        return c

    def points(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Points (n, 3), m, of the curved faces of triangles k at u, v (n,)."""
        return self.corners[k, 0] + value(self._load(k), u, v).T

    def may_meet(self, origins: Floats, directions: Floats) -> tuple[Ints, Ints]:
        """Rays (n, 3) and curved faces, as indices of rays (m,) and
        of triangles (m,): those whose lines may meet.
        """
        centre, radius = self._spheres
        middle = self.corners[0, 0]  # from near here the squares lose nothing that matters
        o = origins - dot(origins - middle, directions)[:, None] * directions - middle
        away = centre - middle
        columns = np.ascontiguousarray(away.T)
        # distance of the centres from the lines, squared; by
        # products of matrices, many times as fast
        along = combine(directions, columns)
        apart = dot(away, away) + dot(o, o)[:, None] - 2 * combine(o, columns) - along * along
        i, k = np.nonzero(
            (apart <= (1 + 1e-6) * radius**2 + 1e-12 * dot(away, away).max()) & (self.row >= 0)
        )
        parts = [slice(first, first + CHUNK) for first in range(0, len(i), CHUNK)]
        holds = [self._is_in_box(k[some], origins[i[some]], directions[i[some]]) for some in parts]
        chosen = np.concatenate([np.zeros(0, bool), *holds])
        return i[chosen], k[chosen]

    def _is_in_box(self, k: Ints, origins: Floats, directions: Floats) -> Bools:
        """As seen along each ray, does the box around the Bezier
        points of the curved face of triangle k hold it?
        """
        c = self._load(k)
        away = (self.corners[k, 0] - origins).T
        holds = np.ones(len(k), bool)
        for axis in tangents(directions):
            a = axis.T
            seen = combine(TO_BEZIER, c[:, 0] * a[0] + c[:, 1] * a[1] + c[:, 2] * a[2])
            low = seen.min(axis=0)
            high = seen.max(axis=0)
            at = -(away * a).sum(axis=0)
            slack = 2 * EDGE * (high - low)
            holds &= (low - slack <= at) & (at <= high + slack)
        return holds

    @cached_property
    def _spheres(self) -> tuple[Floats, Floats]:
        """Centres (t, 3) and radii (t,) of spheres that hold the triangles and their
        curved faces.
        """
        centre = self.corners.mean(axis=1)
        radius = np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1)
        offset = np.linalg.norm(np.matmul(AT_NODES, self.coefficients), axis=2).max(axis=1)
        radius[self.triangle] += HIGHER * offset
        return centre, radius

    def normals(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Unit normals (n, 3) by which the curved faces of triangles k refract at u, v (n,)."""
        c = self._load(k)
        return normalise(self._bend(cross(*value_and_slopes(c, u, v)[1:]).T, k, u, v))

    def jumps(self, k: Ints) -> Floats:
        """Angles (n,), rad, by which normals of triangles k and
        their neighbours differed; 0 for flat ones.
        """
        row = self.row[k]
        return np.where(row >= 0, self.jump[row], 0.0)

    def _bend(self, normal: Floats, k: Ints, u: Floats, v: Floats) -> Floats:
        """Normals (n, 3), changed where a face refracts by others than its own.

        The very array where none does.
        """
        if not self.has_given_normals:
            return normal
        row = self.row[k]
        given = np.flatnonzero(self.normal_row[row] >= 0)
        if len(given):
            row = row[given]
            c = np.take(self._normal_terms, self.normal_row[row], axis=1).reshape(N_TERMS, 3, -1)
            at_corners = self.vertex_normal[self.vertex[row]]
            c[:2] += (at_corners[:, 1:] - at_corners[:, :1]).transpose(1, 2, 0)
            normal = normal.copy()
            normal[given] = at_corners[:, 0] + value(c, u[given], v[given]).T
        return normal

    def meet(
        self,
        k: Ints,
        u: Floats,
        v: Floats,
        origins: Floats,
        directions: Floats,
        leaves: Bools | None,
        least: float,
        is_last: bool = False,
    ) -> tuple[Ints, Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """Where rays meet the curved surface, beginning at u, v (n,) of triangles k.

        Parameters
        ----------
        leaves : (n,) do rays come from within, so that only hits from behind can be; None: from
            either side. Where a root is of the other side, the one before or after it is looked
            for; but not for rays that have just left the surface, whose root is nearer than
            `least`, m
        is_last : all faces near the ray are asked, so that those around need not be searched

        Returns
        -------
        triangle (n,), u (n,), v (n,), distance (n,) m; enters (n,) the ray comes from the front;
        normal (n, 3) of the face and the one (n, 3) by which it refracts, neither unit; is_met (n,)
        """
        walks = 2 if is_last else WALKS
        *found, is_met = self._roots(k, u, v, origins, directions, walks)
        if leaves is None:
            return *found, is_met

        def is_odd() -> Ints:
            return np.flatnonzero(is_met & (found[4] == leaves) & (leaves | (found[3] > least)))

        odd = is_odd()
        if len(odd):
            k, u, v = (x[odd] for x in found[:3])
            o = origins[odd]
            d = directions[odd]
            *other, is_other = self._roots(k, *self._across(k, u, v, d), o, d, walks)
            better = is_other & (other[4] != leaves[odd])
            for mine, theirs in zip(found, other, strict=True):
                mine[odd[better]] = theirs[better]
            odd = is_odd()
            # a ray that starts on the surface goes on to the next hit
            odd = odd[found[3][odd] > least]
        if not is_last:
            for first in range(0, len(odd), SEARCHED_AT_ONCE):
                self._search_around(
                    found, odd[first : first + SEARCHED_AT_ONCE], origins, directions, leaves
                )
        return *found, is_met

    def _search_around(
        self, found: list[np.ndarray], odd: Ints, origins: Floats, directions: Floats, leaves: Bools
    ) -> None:
        """Replace roots on the wrong side by the nearest on the
        right one, from many places on the faces around.
        """
        rings = [found[0][odd, None]]
        for _ in range(RINGS):
            row = self.row[rings[-1]]
            around = np.where((rings[-1] >= 0)[..., None], self.neighbour[row], -1)
            rings.append(around.reshape(len(odd), -1))
        faces = np.concatenate(rings, axis=1)
        i, j = np.nonzero(faces >= 0)
        k = np.tile(faces[i, j], len(STARTS))
        i = np.tile(i, len(STARTS))
        u, v = np.repeat(np.array(STARTS), len(k) // len(STARTS), axis=0).T
        rays = odd[i]
        *other, is_other = self._roots(k, u, v, origins[rays], directions[rays], WALKS)
        # light on its way in meets the front before the back it
        # was found to meet; within, the back is beyond
        beyond = (other[3] - found[3][rays]) * np.where(leaves[rays], 1.0, -1.0) > 0
        good = np.flatnonzero(is_other & (other[4] != leaves[rays]) & beyond)
        # nearest last, so that it is the one that stays
        good = good[np.argsort(-other[3][good], kind="stable")]
        for mine, theirs in zip(found, other, strict=True):
            mine[rays[good]] = theirs[good]

    def _across(self, k: Ints, u: Floats, v: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Places about as far beyond where rays touch the
        surface as u, v are before it, or the reverse.
        """
        c = self._load(k)
        d = directions.T

        def facing(u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
            _, by_u, by_v = value_and_slopes(c, u, v)
            return (d * cross(by_u, by_v)).sum(axis=0), by_u, by_v

        here, by_u, by_v = facing(u, v)
        # the ray along the face: d = a by_u + b by_v, without the part perpendicular to both
        uu = (by_u**2).sum(axis=0)
        uv = (by_u * by_v).sum(axis=0)
        vv = (by_v**2).sum(axis=0)
        du = (d * by_u).sum(axis=0)
        dv = (d * by_v).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            a = (vv * du - uv * dv) / (uu * vv - uv * uv)
            b = (uu * dv - uv * du) / (uu * vv - uv * uv)
            size = np.maximum(np.abs(a), np.abs(b))
            a, b = a / size, b / size
            step = 1e-3
            way = -2 * here * step / (facing(u + step * a, v + step * b)[0] - here)
        way = np.clip(np.nan_to_num(way), -1.0, 1.0)
        return u + way * np.nan_to_num(a), v + way * np.nan_to_num(b)

    def _roots(
        self, k: Ints, u: Floats, v: Floats, origins: Floats, directions: Floats, walks: int
    ) -> tuple[Ints, Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """As `meet`, for whichever side; a root is followed over that many faces."""
        k, is_met, todo = k.copy(), np.zeros(len(k), bool), np.arange(len(k))
        *columns, done = self._newton(k, u, v, origins, directions)
        u, v, distance, enters, facing, normal = columns
        for walk in range(walks):
            if walk:
                *others, done = self._newton(
                    k[todo], u[todo], v[todo], origins[todo], directions[todo]
                )
                for mine, theirs in zip(columns, others, strict=True):
                    mine[todo] = theirs
            # distances from the edges
            outside = np.stack([v[todo], 1 - u[todo] - v[todo], u[todo]])
            least = np.minimum(np.minimum(outside[0], outside[1]), outside[2])
            row = self.row[k[todo]]
            is_within = self._is_within(least, row)
            is_met[todo] = done & is_within
            # a root beyond an edge, or one that is looked for
            # far beyond it, may lie on the next face
            left = np.flatnonzero(~is_within & (done | (least <= -ASIDE)))
            edge = outside[:, left].argmin(axis=0)
            row = row[left]
            following = self.neighbour[row, edge]
            goes_on = following >= 0
            if not goes_on.any():
                break
            todo = todo[left[goes_on]]
            edge = edge[goes_on]
            row = row[goes_on]
            k[todo] = following[goes_on]
            u[todo], v[todo] = self._step_over(row, edge, u[todo], v[todo])
        return k, u, v, distance, enters, facing, normal, is_met

    def _is_within(self, least: Floats, row: Ints) -> Bools:
        return least >= -EDGE

    def _step_over(self, row: Ints, edge: Ints, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Places on the neighbours across edges next to where u, v left their faces."""
        along = np.choose(edge, [u, v, 1 - u - v])  # weight of the corner in which the edge ends
        along = np.clip(along, 0.0, 1.0)
        weights = np.zeros((len(row), 3))
        n = np.arange(len(row))
        theirs = self.neighbour_edge[row, edge].astype(int)
        # it runs the other way there
        weights[n, theirs], weights[n, (theirs + 1) % 3] = along, 1 - along
        return weights[:, 1], weights[:, 2]

    def _newton(
        self, k: Ints, u: Floats, v: Floats, origins: Floats, directions: Floats
    ) -> tuple[Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """Newton's method on the part of point(u, v) - origin across the ray.

        Steps and range are limited.
        """
        c = self._load(k)
        away = (np.take(self.corners, k, axis=0)[:, 0] - origins).T.copy()
        d = directions.T.copy()
        u = u.copy()
        v = v.copy()
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
            for first in range(0, len(k), CHUNK):
                some = slice(first, first + CHUNK)
                terms = c[..., some]
                rest = away[:, some]
                along = d[:, some]
                x, y, _ = _step(terms, rest, along, u[some], v[some])  # hardly any is done so soon
                u[some], v[some], size[some] = _step(terms, rest, along, x, y)
                finish(some, terms)
            late = live = np.flatnonzero(_goes_on(u, v, size))
            for turn in range(2, ITERATIONS):
                if not len(live):
                    break
                x, y, size[live] = _step(c[..., live], away[:, live], d[:, live], u[live], v[live])
                u[live], v[live] = x, y
                live = live[_goes_on(x, y, size[live]) & (turn < PATIENCE or size[live] < HOPELESS)]
            if len(late):
                finish(late, c[..., late])
        facing, enters = facing.T, product(d, facing) < 0
        return u, v, distance, enters, facing, self._bend(facing, k, u, v), size < CONVERGED


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
    limit = np.fmin(0.5 / size, 1.0)
    # fmax and fmin put a number in the place of NaN
    return (
        np.fmin(np.fmax(u + limit * du, -1.0), 2.0),
        np.fmin(np.fmax(v + limit * dv, -1.0), 2.0),
        size,
    )


def _goes_on(u: Floats, v: Floats, size: Floats) -> Bools:
    """Are roots (n,) to be followed further, after a step of some size to u, v?"""
    return ~(size < CONVERGED) & (np.minimum(np.minimum(u, v), 1.0 - u - v) > -ASIDE)
