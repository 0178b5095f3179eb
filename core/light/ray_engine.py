"""Which triangle a ray meets first: a ray engine's answer, with the hit refined in float64.

The engine (float32) only says *which* triangle; where the ray
meets it is computed in float64 from the unmoved ray.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats, Ints
from ..glass.curved import CHUNK, EDGE, FINE, MOST_PARTS, STARTS, CurvedFaces
from ..glass.meshes import Frames, box_of, interpolate
from ..glass.motion import Motion
from ..glass.quartics import grid, product
from ..products import combine
from ..steps import Pauses, finish
from ..vectors import dot
from .engines import Engine, Found, make_engine
from .hits import Accept, Hits, slab

FEW_TRIANGLES = 32  # up to here all triangles are tested in float64 and no ray engine is built
MANY_TRIANGLES = 10_000  # from here on a curved face is searched from one place only
FLOAT32 = 2.0**-23  # spacing of float32 numbers just above 1
# cosine, and parts of a triangle's size: so a ray leaves the hull that has left the faces
STEEP = 0.5
NEAR = 0.1
# of an edge: where edges are straight the hull is no further in front than the faces are
PARTS_AT_EDGES = 4
BESIDE = 6  # rays shot beside one that was lost
# barycentric slack for a ray that met nothing: it runs
# along a face, whose plane it meets far beside
WIDER = 1e-6
PAIRS_AT_ONCE = 1 << 18  # of rays and triangles that are tested together: about 60 MB
# of rays and curved faces whose roots are found together: about 20 MB, and 0.05 s
CURVED_AT_ONCE = 1 << 13
# most ray-triangle pairs that may be tested in float64 in one call: a few seconds
RESCUE_TESTS = 20_000_000


"""Of hits of rays (indices): is it a true one, and is it one that cannot be?"""


@dataclass(frozen=True, eq=False)
class Asked:
    """Triangles that are asked for hits: n_whole whole ones of a
    layer, then the others in k parts each, cut alike.

    corners (p, 3, 3) in units of the layer's radius, from its centre; owner (p,): the layer's
    triangle; parts (k, 3, 3): barycentric corners of the parts in their triangle
    """

    corners: NDArray[np.float32]
    owner: Ints
    n_whole: int
    parts: Floats
    given: Any = None  # a ray engine that is there already

    @cached_property
    def engine(self) -> Engine:
        """The ray engine, made when it is first asked."""
        return make_engine(self.corners) if self.given is None else self.given


class Layer:
    """Triangles that are asked together for the first hit of each ray.

    Solids of one layer do not touch one another, so that hits at the same place are found in
    different layers. Its triangles are those it was made of; questions and answers are in the place
    it was moved to.
    """

    def __init__(self, corners: Floats, curved: CurvedFaces | None = None) -> None:
        self.motion: Motion | None = None
        self.corners = corners
        self.frames = Frames.of(corners)
        self.curved = curved
        self.n_triangles = len(corners)
        owner = np.arange(len(corners))
        n_whole = len(corners)
        parts = np.eye(3)[None]
        if curved is not None:
            # curved faces are hidden behind triangles that lie
            # just in front of them, several for each
            k = max(
                curved.parts(FINE, MOST_PARTS), PARTS_AT_EDGES if curved.has_straight_edges else 1
            )
            weights, of_one = grid(k)
            flat = np.flatnonzero(curved.row < 0)
            owner = np.concatenate([flat, np.repeat(curved.triangle, k * k)])
            parts = weights[of_one]
            n_whole = len(flat)
            corners = np.concatenate([corners[flat], curved.hull(k)])
        self.bounds = box_of(corners)
        self.centre = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(self.bounds[1] - self.centre)) or 1.0
        self.tolerance = 4 * FLOAT32 * self.radius
        self.asked = Asked(
            ((corners - self.centre) / self.radius).astype(np.float32), owner, n_whole, parts
        )

    def moved(self, motion: Motion) -> "Layer":
        """The same layer elsewhere: rays are taken to where it
        was made, so that its engine stays as it is.
        """
        other = copy(self)
        other.motion = motion
        return other

    def bent(self, curved: CurvedFaces | None) -> "Layer":
        """The same layer with slightly other curved faces; the triangles in the engine stay."""
        other = copy(self)
        other.curved = curved
        return other

    @property
    def has_engine(self) -> bool:
        """Few flat triangles need no ray engine."""
        return self.n_triangles > FEW_TRIANGLES or self.curved is not None

    def first_hits(self, *arguments: Any) -> Hits:
        """First true hits of rays, found at once; parameters as for `find_first_hits`."""
        return finish(self.find_first_hits(*arguments))

    def find_first_hits(
        self,
        origins: Floats,
        directions: Floats,
        is_inside: Bools,
        accept: Accept,
        leaves: Bools | None = None,
        within: Floats | None = None,
    ) -> Pauses[Hits]:
        """First true hits of rays; pauses as often as work may be stopped.

        Parameters
        ----------
        origins, directions : (n, 3) world, float64
        is_inside : (n,) the ray is inside a closed solid of this layer, so that a miss cannot be
        accept : which hits are true ones
        leaves : (n,) the ray is inside a solid, so that only hits from
            behind can be; None where not all are solids
        within : (n,) m, hits further away need not be found
        """
        if self.motion is None:
            return (
                yield from self._first_hits(origins, directions, is_inside, accept, leaves, within)
            )
        there = self.motion.back(origins, directions)
        hits = yield from self._first_hits(*there, is_inside, accept, leaves, within)
        turned = (
            None if column is None else self.motion.directions(column)
            for column in (hits.facing, hits.normal)
        )
        return replace(hits, **dict(zip(("facing", "normal"), turned, strict=True)))

    def _first_hits(
        self,
        origins: Floats,
        directions: Floats,
        is_inside: Bools,
        accept: Accept,
        leaves: Bools | None,
        within: Floats | None,
    ) -> Pauses[Hits]:
        within = np.full(len(origins), np.inf) if within is None else within
        hits = Hits.none(len(origins), self.curved)
        grown = self.bounds + np.array([[-self.tolerance], [self.tolerance]])
        enter, leave = slab(grown, origins, directions)
        rays = np.flatnonzero((enter <= np.minimum(leave, within)) & (leave >= 0) | is_inside)
        if not len(rays):
            return hits
        if not self.has_engine:
            for first in range(0, len(rays), CHUNK):
                self._test_all(
                    origins, directions, rays[first : first + CHUNK], accept, within, hits
                )
            return hits
        start = np.maximum(enter[rays], 0.0)
        lost = yield from self._ask_engine(
            origins, directions, rays, start, is_inside, accept, leaves, hits
        )
        if len(lost):
            yield from self._rescue(origins, directions, lost, accept, leaves, hits)
        return hits

    def _on_facets(self, k: Ints, origins: Floats, directions: Floats) -> Hits:
        """Where rays meet the planes of triangles k; not finite where they are parallel."""
        t = self.frames.distance(k, origins, directions)
        with np.errstate(invalid="ignore"):
            u, v = self.frames.barycentric(k, origins + t[..., None] * directions)
        return Hits(t, k, u, v, dot(directions, self.frames.normal[k]) < 0)

    def _on_curved(
        self,
        k: Ints,
        u: Floats,
        v: Floats,
        origins: Floats,
        directions: Floats,
        leaves: Bools | None,
        is_last: bool = False,
    ) -> tuple[Hits, Bools]:
        """Where rays meet curved faces, beginning at u, v of triangles k; and whether they do."""
        k, u, v, *others, is_met = self.curved.meet(
            k, u, v, origins, directions, leaves, self.tolerance, is_last
        )
        distance, enters, facing, normal = others
        return Hits(
            distance, k, u, v, enters, facing, normal if self.curved.has_given_normals else None
        ), is_met

    def _test_all(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        accept: Accept,
        within: Floats,
        hits: Hits,
    ) -> None:
        o = origins[rays]
        d = directions[rays]
        k = self.n_triangles
        frames = self.frames
        # distances and barycentric coordinates of all triangles at once, by products of matrices
        axes = np.concatenate([frames.normal, frames.axis_u, frames.axis_v])
        start = combine(axes, np.ascontiguousarray((o - self.centre).T))
        start -= dot(np.tile(frames.corner - self.centre, (3, 1)), axes)[:, None]
        slope = combine(axes, np.ascontiguousarray(d.T))
        with np.errstate(invalid="ignore", divide="ignore"):
            t = -start[:k] / slope[:k]
            u, v = (start[i : i + k] + t * slope[i : i + k] for i in (k, 2 * k))
            t[~(_is_within(u, v) & (t > -self.tolerance) & (t <= within[rays]))] = np.inf
        todo = np.arange(len(rays))
        while len(todo):
            nearest = (t if len(todo) == len(rays) else t[:, todo]).argmin(axis=0)
            meets = np.isfinite(t[nearest, todo])
            todo = todo[meets]
            nearest = nearest[meets]
            found = self._on_facets(nearest, o[todo], d[todo])
            is_true, _ = accept(rays[todo], found)
            hits.put(rays[todo[is_true]], found.at(is_true))
            todo = todo[~is_true]
            nearest = nearest[~is_true]
            t[nearest, todo] = np.inf

    def _shoot(self, origins: Floats, directions: Floats, start: Floats) -> tuple[Found, Floats]:
        """The triangles that the engine finds from `start` on,
        and its distance as the engine has it.
        """
        moved = (origins + start[:, None] * directions - self.centre) / self.radius
        found = self.asked.engine.shoot(moved.astype(np.float32), directions.astype(np.float32))
        return found, start + found.distance.astype(float) * self.radius

    def _only_leaves_hull(
        self, found: Found, directions: Floats, far: Floats, leaves: Bools
    ) -> Bools:
        """Do the triangles found tell that rays (n,) only come out
        of the hull, having left the faces just behind it?

        Such a ray is outside and has but a short way, a part of the triangle's size, to where it
        steeply leaves the hull. It can enter nothing on that way: the faces turn much less over a
        triangle than the ray is steep.
        """
        normal = found.normal.T
        area = np.sqrt(product(normal, normal))  # twice the area, in units of the engine
        is_steep = product(normal, directions.T) > STEEP * area
        is_near = (far / self.radius) ** 2 < NEAR**2 * area
        return ~leaves & is_steep & is_near & (found.triangle >= self.asked.n_whole)

    def _refine(
        self, found: Found, chosen: Bools, origins: Floats, directions: Floats, leaves: Bools | None
    ) -> tuple[Hits, Bools]:
        """Hits (n,) in float64 of the chosen ones that the
        engine found, of which some may come to nothing.
        """
        prim = found.triangle[chosen].astype(np.int64)
        k = self.asked.owner[prim]
        if self.curved is None:
            return self._on_facets(k, origins, directions), np.ones(len(k), bool)
        is_curved = self.curved.row[k] >= 0
        u, v = (column[chosen].astype(float) for column in (found.u, found.v))
        in_parts = np.flatnonzero(prim >= self.asked.n_whole)
        part = self.asked.parts[(prim[in_parts] - self.asked.n_whole) % len(self.asked.parts)]
        u[in_parts], v[in_parts] = interpolate(part, u[in_parts], v[in_parts])[:, 1:].T
        if is_curved.all():
            return self._on_curved(k, u, v, origins, directions, leaves)
        hits = Hits.none(len(k), self.curved)
        is_met = np.ones(len(k), bool)
        flat = np.flatnonzero(~is_curved)
        bent = np.flatnonzero(is_curved)
        hits.put(flat, self._on_facets(k[flat], origins[flat], directions[flat]))
        some, is_met[bent] = self._on_curved(
            k[bent], u[bent], v[bent], origins[bent], directions[bent], _of(leaves, bent)
        )
        hits.put(bent, some)
        return hits, is_met

    def _ask_engine(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        start: Floats,
        is_inside: Bools,
        accept: Accept,
        leaves: Bools | None,
        hits: Hits,
    ) -> Pauses[Ints]:
        """Put the hits that the engine finds; return the rays that must have hit something else."""
        lost = []
        # far rays begin a little before the box, near ones a little
        # ahead, so as not to meet the face they come from
        step = np.full(len(rays), 3 * FLOAT32 * self.radius)
        start = np.where(start > 0, start - 2 * self.tolerance, step)
        while len(rays):
            o = origins[rays]
            d = directions[rays]
            found, far = self._shoot(o, d, start)
            hit = found.triangle >= 0
            if not hit.all():
                lost.append(rays[~hit & is_inside[rays]])
            again = np.zeros(len(rays), bool)
            if self.curved is not None and leaves is not None:
                again = hit & self._only_leaves_hull(found, d, far, leaves[rays])
                hit &= ~again
            if not hit.all():
                o = o[hit]
                d = d[hit]
            asked = rays[hit]
            some, is_met = self._refine(found, hit, o, d, _of(leaves, asked))
            is_true, is_wrong = np.zeros((2, len(asked)), bool)
            is_true[is_met], is_wrong[is_met] = accept(asked[is_met], some.at(is_met))
            if is_true.all():
                hits.put(asked, some)
            else:
                hits.put(asked[is_true], some.at(is_true))
            lost.append(asked[is_wrong])
            again[hit] = ~is_true
            if self.curved is None:  # the true hit may lie a little further than the engine has it
                far[hit] = np.where(
                    np.isfinite(some.distance), np.fmax(some.distance, far[hit]), far[hit]
                )
            start = np.maximum(far + step, start + step)[again]
            # doubling: the loop ends once the ray has left the box
            rays = rays[again]
            step = 2 * step[again]
            yield 0
        return np.unique(np.concatenate(lost)) if lost else np.empty(0, np.int64)

    def _rescue(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        accept: Accept,
        leaves: Bools | None,
        hits: Hits,
    ) -> Pauses[None]:
        """Find in float64 hits that the engine missed: it loses some
        of the rays that are aimed at vertices and edges.

        Rays beside the lost one tell which triangles are near; only
        where none of those is met are all of them tested.
        """
        o = origins[rays]
        d = directions[rays]
        best = Hits.none(len(rays), self.curved)
        aside = np.cross(d, np.where(np.abs(d[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        upward = np.cross(d, aside)
        angle = 2 * np.pi * np.arange(BESIDE)[:, None, None] / BESIDE
        moved = o + 8 * FLOAT32 * self.radius * (np.cos(angle) * aside + np.sin(angle) * upward)
        yield from self._nearest_of_all(moved.reshape(-1, 3), o, d, rays, accept, best)
        is_found = best.triangle >= 0
        hits.put(rays[is_found], best.at(is_found))
        yield from self._test_in_float64(origins, directions, rays[~is_found], accept, leaves, hits)

    def _nearest_of_all(
        self,
        beside: Floats,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        accept: Accept,
        best: Hits,
    ) -> Pauses[None]:
        """Put into `best` the nearest true hit of rays among all
        triangles that rays beside them, m n of them, meet.
        """
        row = np.tile(np.arange(len(rays)), len(beside) // len(rays))
        step = np.full(len(row), 3 * FLOAT32 * self.radius)
        start = -2 * step
        while len(row):
            found, far = self._shoot(beside, directions[row], start)
            met = found.triangle >= 0
            beside, row, start, step, far = (x[met] for x in (beside, row, start, step, far))
            some, is_met = self._refine(found, met, origins[row], directions[row], None)
            self._keep_nearest(row, some, is_met & self._is_on_face(some), rays, accept, best)
            start = np.maximum(far, start) + step
            step = 2 * step
            yield 0

    def _is_on_face(self, hits: Hits) -> Bools:
        """Are hits within their faces? On curved ones that are met they are."""
        is_within = _is_within(hits.u, hits.v)
        return (
            is_within if self.curved is None else is_within | (self.curved.row[hits.triangle] >= 0)
        )

    def _keep_nearest(
        self, i: Ints, found: Hits, is_met: Bools, rays: Ints, accept: Accept, best: Hits
    ) -> None:
        """Put into `best`, which has a row for each of some rays,
        those found for its rows i where they are nearer.
        """
        good = np.flatnonzero(
            is_met & (found.distance > -self.tolerance) & (found.distance < best.distance[i])
        )
        good = good[accept(rays[i[good]], found.at(good))[0]]
        # nearest last, so that it is the one that stays
        good = good[np.argsort(-found.distance[good], kind="stable")]
        best.put(i[good], found.at(good))

    def _test_in_float64(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        accept: Accept,
        leaves: Bools | None,
        hits: Hits,
    ) -> Pauses[None]:
        """Test rays against every triangle, as far as the budget goes."""
        budget = max(1, RESCUE_TESTS // self.n_triangles)
        per_chunk = max(1, PAIRS_AT_ONCE // self.n_triangles)
        for first in range(0, min(len(rays), budget), per_chunk):
            some = rays[first : first + per_chunk]
            o = origins[some]
            d = directions[some]
            best = Hits.none(len(some), self.curved)
            flat = np.arange(self.n_triangles)
            if self.curved is not None:
                flat = flat[self.curved.row < 0]
                yield from self._test_curved(o, d, some, accept, _of(leaves, some), best)
            on_planes = self._on_facets(flat, o[:, None], d[:, None])
            i, k = np.nonzero(_is_within(on_planes.u, on_planes.v, WIDER))
            self._keep_nearest(
                i, self._on_facets(flat[k], o[i], d[i]), np.ones(len(i), bool), some, accept, best
            )
            is_found = best.triangle >= 0
            hits.put(some[is_found], best.at(is_found))
            yield 0

    def _test_curved(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        accept: Accept,
        leaves: Bools | None,
        best: Hits,
    ) -> Pauses[None]:
        """Put into `best` the nearest true hits of rays (n, 3), of
        numbers (n,), on all curved faces they may meet.
        """
        i, k = self.curved.may_meet(origins, directions)
        # a ray that grazes can meet a large face twice, but not a small one
        for u, v in STARTS if self.n_triangles < MANY_TRIANGLES else STARTS[:1]:
            for first in range(0, len(i), CURVED_AT_ONCE):
                j = i[first : first + CURVED_AT_ONCE]
                faces = k[first : first + CURVED_AT_ONCE]
                at = np.full(len(j), u), np.full(len(j), v)
                found, is_met = self._on_curved(
                    faces, *at, origins[j], directions[j], _of(leaves, j), is_last=True
                )
                self._keep_nearest(j, found, is_met, rays, accept, best)
                yield 0


def _is_within(u: Floats, v: Floats, slack: float = EDGE) -> Bools:
    return (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack)


def _of(leaves: Bools | None, rays: Ints) -> Bools | None:
    return None if leaves is None else leaves[rays]
