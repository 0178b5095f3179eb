"""Which triangle a ray meets first: a ray engine's answer, with the hit refined in float64.

The engine (float32) only says *which* triangle; where the ray meets it is computed in float64 from
the unmoved ray. Rays that it loses are looked for again in `rescue`.
"""

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import FLOAT32, Bools, Floats, Ints
from ..glass.curved import FACES_AT_ONCE, CurvedFaces
from ..glass.curved_hits import find_roots
from ..glass.curved_hull import Hull, making_hull
from ..glass.curved_roots import Lines, Spots
from ..glass.meshes import Frames, box_of
from ..glass.motion import Motion
from ..products import combine
from ..steps import Pauses, finish
from ..vectors import dot, normalise
from .asked import Asked
from .engines import Found
from .hits import Accept, Hits, Question, Search, is_within, slab
from .passed import Passed, enter_again
from .rescue import rescue

FEW_TRIANGLES = 32  # up to here all triangles are tested in float64 and no ray engine is built


class Layer:
    """Triangles that are asked together for the first hit of each ray.

    Solids of one layer do not touch one another, so that hits at the same place are found in
    different layers. Its triangles are those it was made of; questions and answers are in the place
    it was moved to.
    """

    def __init__(
        self, corners: Floats, curved: CurvedFaces | None = None, hull: Hull | None = None
    ) -> None:
        """A layer of triangles (t, 3, 3), m; the hull of its curved faces may be there already."""
        self.motion: Motion | None = None
        self.corners = corners
        self.frames = Frames.of(corners)
        self.curved = curved
        self.n_triangles = len(corners)

        # curved faces are hidden behind triangles just in front of them, several for each
        owner = np.arange(len(corners))
        n_whole = len(corners)
        places = np.empty((0, 3, 2), np.float32)
        if curved is not None:
            hull = hull or finish(making_hull(curved))
            flat = np.flatnonzero(curved.row < 0)
            owner = np.concatenate([flat, hull.triangle])
            places = hull.places
            n_whole = len(flat)
            corners = np.concatenate([corners[flat], hull.corners])

        # in units and from a place in which float32 loses least
        self.bounds = box_of(corners)
        self.centre = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(self.bounds[1] - self.centre)) or 1.0
        self.tolerance = 4 * FLOAT32 * self.radius
        self.asked = Asked(
            ((corners - self.centre) / self.radius).astype(np.float32), owner, n_whole, places
        )

    def moved(self, motion: Motion) -> "Layer":
        """The same layer elsewhere, with the same engine: rays are taken to where it was made."""
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
        search: Search | None = None,
    ) -> Pauses[Hits]:
        """First true hits of rays; pauses as often as work may be stopped.

        Parameters
        ----------
        origins, directions : (n, 3) world, float64
        is_inside : (n,) the ray is inside a closed solid of this layer, so that a miss cannot be
        accept : which hits are true ones
        leaves : (n,) the ray is inside a solid, so that only hits from
            behind can be; None where not all are solids
        search : how far the layer was searched before; None where all hits are to be found now
        """
        lines = Lines(origins, directions)
        if self.motion is not None:
            lines = Lines(*self.motion.back(origins, directions))
        search = search or Search(len(origins))
        question = Question(lines, accept, is_inside, leaves, search)
        hits = yield from self._first_hits(question)
        if self.motion is None:
            return hits

        turned = {
            name: None if column is None else self.motion.directions(column)
            for name, column in (("facing", hits.facing), ("normal", hits.normal))
        }
        return replace(hits, **turned)

    def _first_hits(self, question: Question) -> Pauses[Hits]:
        # rays that may meet the layer's box
        lines = question.lines
        hits = Hits.none(len(lines.origins), self.curved)
        grown = self.bounds + np.array([[-self.tolerance], [self.tolerance]])
        enter, leave = slab(grown, *lines)
        may_hit = (enter <= np.minimum(leave, question.search.within)) & (leave >= 0)
        rays = np.flatnonzero(may_hit | question.is_inside)
        if not len(rays):
            return hits

        if not self.has_engine:
            for first in range(0, len(rays), FACES_AT_ONCE):
                self._test_all(question, rays[first : first + FACES_AT_ONCE], hits)
            return hits

        yield from self.asked.making_engine()
        start = np.maximum(enter[rays], 0.0)
        lost = yield from self._ask_engine(question, rays, start, hits)
        if len(lost):
            yield from self._rescue(question, lost, hits)
        return hits

    def on_facets(self, k: Ints, origins: Floats, directions: Floats) -> Hits:
        """Where rays meet the planes of triangles k; not finite where they are parallel."""
        t = self.frames.distance(k, origins, directions)
        with np.errstate(invalid="ignore"):
            u, v = self.frames.barycentric(k, origins + t[..., None] * directions)
        slope = dot(directions, normalise(self.frames.normal[k]))
        return Hits(t, k, u, v, enters=slope < 0, cosine=np.abs(slope))

    def on_curved(
        self, spots: Spots, lines: Lines, leaves: Bools | None, is_last: bool = False
    ) -> tuple[Hits, Bools]:
        """Where rays meet curved faces, beginning at places on them; and whether they do."""
        found = find_roots(self.curved, spots, lines, leaves, self.tolerance, is_last)
        hits = Hits(
            *(found.distance, found.triangle, found.u, found.v, found.enters),
            cosine=np.abs(dot(lines.directions, normalise(found.facing))),
            facing=found.facing,
            normal=self.curved.given_normals(found.facing, *found.spots),
        )
        return hits, found.is_met

    def is_on_face(self, hits: Hits) -> Bools:
        """Are hits within their faces? On curved ones that are met they are."""
        is_flat_hit = is_within(hits.u, hits.v)
        if self.curved is None:
            return is_flat_hit
        return is_flat_hit | (self.curved.row[hits.triangle] >= 0)

    def _test_all(self, question: Question, rays: Ints, hits: Hits, may_pass: bool = True) -> None:
        """Put the first true hits of some rays on few flat triangles, each of which is tested."""
        o, d = question.lines.at(rays)
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
            # a shell that cuts itself would seem to end before it does
            within = np.where(question.is_inside[rays], np.inf, question.search.within[rays])
            is_met = is_within(u, v) & (t > -self.tolerance) & (t <= within)
            t[~is_met] = np.inf

        # the nearest of each ray, then the next one for those where it is no true one
        passed = Passed(question.is_inside, self.tolerance)
        todo = np.arange(len(rays))
        while len(todo):
            nearest = (t if len(todo) == len(rays) else t[:, todo]).argmin(axis=0)
            meets = np.isfinite(t[nearest, todo])
            todo, nearest = todo[meets], nearest[meets]
            found = self.on_facets(nearest, o[todo], d[todo])
            is_true, is_wrong = question.accept(rays[todo], found)
            if may_pass:
                is_true, _ = passed.count(rays[todo], found, is_true, is_wrong)
            hits.put(rays[todo[is_true]], found.at(is_true))
            todo = todo[~is_true]
            t[nearest[~is_true], todo] = np.inf

        # where the numbers of faces do not come out even no shell cuts itself
        if len(lost := passed.some_of(rays[hits.triangle[rays] < 0])):
            self._test_all(question, lost, hits, may_pass=False)

    def shoot(self, lines: Lines, start: Floats) -> tuple[Found, Floats]:
        """The triangles that the engine finds from `start` on,
        and its distance as the engine has it.
        """
        origins, directions = lines
        moved = (origins + start[:, None] * directions - self.centre) / self.radius
        found = self.asked.engine.shoot(moved.astype(np.float32), directions.astype(np.float32))
        return found, start + found.distance.astype(float) * self.radius

    def refine(
        self, found: Found, chosen: Bools, lines: Lines, leaves: Bools | None
    ) -> tuple[Hits, Bools]:
        """Hits (n,) in float64 of what the engine has found, some of which may come to nothing."""
        spots = self.asked.spots(found, chosen)
        k = spots.triangle
        if self.curved is None:
            return self.on_facets(k, *lines), np.ones(len(k), bool)

        is_curved = self.curved.row[k] >= 0
        if is_curved.all():
            return self.on_curved(spots, lines, leaves)

        hits = Hits.none(len(k), self.curved)
        is_met = np.ones(len(k), bool)
        flat = np.flatnonzero(~is_curved)
        bent = np.flatnonzero(is_curved)
        hits.put(flat, self.on_facets(k[flat], *lines.at(flat)))
        of_bent = None if leaves is None else leaves[bent]
        some, is_met[bent] = self.on_curved(spots.at(bent), lines.at(bent), of_bent)
        hits.put(bent, some)
        return hits, is_met

    def _ask_engine(
        self, question: Question, rays: Ints, start: Floats, hits: Hits
    ) -> Pauses[Ints]:
        """Put the hits that the engine finds; return the rays that must have hit something else."""
        ended, passed = [], Passed(question.is_inside, self.tolerance)
        # far rays begin a little before the box, near ones ahead, beyond the face they come from
        step = np.full(len(rays), 3 * FLOAT32 * self.radius)
        start = np.where(start > 0, start - 2 * self.tolerance, step)
        start, step = question.search.resume(rays, start, step)
        asked_of = rays
        while len(rays):
            # the triangles that the engine finds; a ray within a solid has to meet one
            lines = question.lines.at(rays)
            found, far = self.shoot(lines, start)
            hit = found.triangle >= 0
            ended.append(rays[~hit])
            again = np.zeros(len(rays), bool)
            if self.curved is not None and question.leaves is not None:
                only_leaves = self.asked.are_left(found, lines.directions, far / self.radius)
                again = hit & ~question.leaves[rays] & only_leaves
                hit &= ~again

            # where exactly, and is it a true hit?
            if len(asked := rays[hit]):
                lines = lines if hit.all() else lines.at(hit)
                some, is_met = self.refine(found, hit, lines, question.leaves_at(asked))
                enter_again(self, question, asked, (found, hit, far), (some, is_met), passed)
                is_true, is_wrong = np.zeros((2, len(asked)), bool)
                is_true[is_met], is_wrong[is_met] = question.accept(asked[is_met], some.at(is_met))
                is_true, passes = passed.count(asked, some, is_true, is_wrong)
                if passes is not None:
                    step[hit] = np.where(passes, 3 * FLOAT32 * self.radius, step[hit])
                hits.put(asked[is_true], some.at(is_true))

                # the others go on; the true hit may lie a little further than the engine has it
                again[hit] = ~is_true
                if self.curved is None:
                    is_there = np.isfinite(some.distance)
                    far[hit] = np.where(is_there, np.fmax(some.distance, far[hit]), far[hit])

            # doubling: the loop ends once the ray has left the box
            start = np.maximum(far + step, start + step)[again]
            rays = rays[again]
            step = 2 * step[again]
            yield 0
            if not len(passed.some_of(rays)) and question.search.put_off(rays, start, step):
                break
        return question.search.lost(asked_of, passed.lost(ended))

    def _rescue(self, question: Question, rays: Ints, hits: Hits) -> Pauses[None]:
        yield from rescue(self, question, rays, hits)
