"""First hits of rays in one layer, found by its ray engine or by testing each of a few triangles.

- A shell may intersect itself. Its glass is every region with a winding number of one or more. A
  ray inside counts the faces it enters and leaves, and exits the glass when it has left one more
  than it has entered.
- A ray engine loses some of the rays aimed at vertices and edges. Rays next to a lost one find
  nearby triangles. If none of them is hit, every triangle is tested in float64, within a budget.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.arrays import FLOAT32, Bools, Floats, Ints, take
from ..base.products import combine
from ..base.steps import Steps, run_steps
from ..base.vectors import dot
from ..glass.curved import FACES_AT_ONCE
from ..glass.curved_hits import ROOTS, RayLines, Spots, are_in_boxes, pass_by
from ..glass.meshes import spheres_of
from .engines import EngineHits
from .hits import Accept, Hits, LayerSearch, Question, is_within, slab
from .ray_engine import Layer


def first_hits(layer: Layer, origins: Floats, directions: Floats, *arguments: Any) -> Hits:
    """First true hits of rays, found at once; parameters as for `find_first_hits`."""
    return run_steps(find_first_hits(layer, RayLines(origins, directions), *arguments))


def find_first_hits(
    layer: Layer,
    lines: RayLines,
    is_inside: Bools,
    accept: Accept,
    leaves: Bools | None = None,
    search: LayerSearch | None = None,
) -> Steps[Hits]:
    """First true hits of rays, with pauses at which work can be stopped.

    Parameters
    ----------
    lines : origins and directions (n, 3) in the world, float64
    is_inside : (n,) the ray is inside a closed solid of this layer, so a miss is impossible
    accept : decides which hits are true
    leaves : (n,) the ray is inside a solid, so only back faces can be hit; None if not all parts
        are solids
    search : progress of earlier searches; None to find all hits now
    """
    search = search or LayerSearch(len(lines.origins))
    if layer.motion is not None:
        lines = RayLines(*layer.motion.back(*lines))
    question = Question(lines, accept, is_inside, leaves, search)
    hits = yield from _first_hits(layer, question)
    if layer.motion is None:
        return hits

    turned = {
        name: None if column is None else layer.motion.directions(column)
        for name, column in (("facing", hits.facing), ("normal", hits.normal))
    }
    return replace(hits, **turned)


def _first_hits(layer: Layer, question: Question) -> Steps[Hits]:
    lines = question.lines
    hits = Hits.none(len(lines.origins), layer.curved)
    grown = layer.bounds + np.array([[-layer.tolerance], [layer.tolerance]])
    enter, leave = slab(grown, *lines)
    may_hit = (enter <= np.minimum(leave, question.search.within)) & (leave >= 0)
    rays = np.flatnonzero(may_hit | question.is_inside)
    if not len(rays):
        return hits

    if not layer.has_engine:
        for first in range(0, len(rays), FACES_AT_ONCE):
            _test_all(layer, question, rays[first : first + FACES_AT_ONCE], hits)
        return hits

    yield from layer.engine_triangles.engine_steps()
    start = np.maximum(enter[rays], 0.0)
    lost = yield from _search_engine(layer, question, rays, start, hits)
    if len(lost):
        yield from find_missed_hits(layer, question, lost, hits)
    return hits


def _test_all(
    layer: Layer, question: Question, rays: Ints, hits: Hits, may_pass: bool = True
) -> None:
    """Set the first true hits of some rays on few flat triangles by testing all of them."""
    o, d = question.lines.at(rays)
    k = layer.n_triangles
    frames = layer.frames

    # distances and barycentric coordinates of all triangles at once, by matrix products
    axes = np.concatenate([frames.normal, frames.axis_u, frames.axis_v])
    start = combine(axes, np.ascontiguousarray((o - layer.centre).T))
    start -= dot(np.tile(frames.corner - layer.centre, (3, 1)), axes)[:, None]
    slope = combine(axes, np.ascontiguousarray(d.T))
    with np.errstate(invalid="ignore", divide="ignore"):
        t = -start[:k] / slope[:k]
        u, v = (start[i : i + k] + t * slope[i : i + k] for i in (k, 2 * k))
        # or a self-intersecting shell would seem to end too early
        within = np.where(question.is_inside[rays], np.inf, question.search.within[rays])
        is_met = is_within(u, v) & (t > -layer.tolerance) & (t <= within)
        t[~is_met] = np.inf

    passed = SelfIntersections(question.is_inside, layer.tolerance)
    todo = np.arange(len(rays))
    while len(todo):
        nearest = (t if len(todo) == len(rays) else t[:, todo]).argmin(axis=0)
        has_hit = np.isfinite(t[nearest, todo])
        todo, nearest = todo[has_hit], nearest[has_hit]
        found = layer.on_facets(nearest, o[todo], d[todo])
        is_true, is_wrong = question.accept(rays[todo], found)
        if may_pass:
            is_true, _ = passed.count(rays[todo], found, is_true, is_wrong)
        hits.put(rays[todo[is_true]], found.at(is_true))
        todo = todo[~is_true]
        t[nearest[~is_true], todo] = np.inf

    # unbalanced counts: not a self-intersection
    if len(lost := passed.some_of(rays[hits.triangle[rays] < 0])):
        _test_all(layer, question, lost, hits, may_pass=False)


def _search_engine(
    layer: Layer, question: Question, rays: Ints, start: Floats, hits: Hits
) -> Steps[Ints]:
    """Set the hits found by the engine; returns the rays that must have hit another face."""
    ended, passed = [], SelfIntersections(question.is_inside, layer.tolerance)
    # distant rays start just before the box, near ones just beyond the face they come from
    step = np.full(len(rays), 3 * FLOAT32 * layer.radius)
    start = np.where(start > 0, start - 2 * layer.tolerance, step)
    start, step = question.search.resume(rays, start, step)
    all_rays = rays
    while len(rays):
        lines = question.lines.at(rays)
        found, far = layer.shoot(lines, start)
        hit = found.triangle >= 0
        ended.append(rays[~hit])
        again = np.zeros(len(rays), bool)
        if layer.curved is not None and question.leaves is not None:
            only_leaves = layer.engine_triangles.are_left(
                found, lines.directions, far / layer.radius
            )
            again = hit & ~question.leaves[rays] & only_leaves
            hit &= ~again

        if len(hitting := rays[hit]):
            lines = lines if hit.all() else lines.at(hit)
            some, is_met = layer.refine(found, hit, lines, question.leaves_at(hitting))
            enter_again(layer, question, hitting, (found, hit, far), (some, is_met), passed)
            is_true, is_wrong = np.zeros((2, len(hitting)), bool)
            is_true[is_met], is_wrong[is_met] = question.accept(hitting[is_met], some.at(is_met))
            is_true, passes = passed.count(hitting, some, is_true, is_wrong)
            if passes is not None:
                step[hit] = np.where(passes, 3 * FLOAT32 * layer.radius, step[hit])
            hits.put(hitting[is_true], some.at(is_true))

            # the others continue; the true hit may lie slightly beyond the engine's distance
            again[hit] = ~is_true
            if layer.curved is None:
                is_there = np.isfinite(some.distance)
                far[hit] = np.where(is_there, np.fmax(some.distance, far[hit]), far[hit])

        # doubling: the loop ends once the ray has left the box
        start = np.maximum(far + step, start + step)[again]
        rays = rays[again]
        step = 2 * step[again]
        yield 0
        if not len(passed.some_of(rays)) and question.search.put_off(rays, start, step):
            break
    return question.search.lost(all_rays, passed.lost(ended))


class SelfIntersections:
    """The faces of self-intersecting shells passed by rays, in order."""

    def __init__(self, is_inside: Bools, tolerance: float) -> None:
        """For rays (n,), each inside a closed solid or not.

        tolerance : m, a closer face is the same as the one before
        """
        self._is_inside = is_inside
        self._tolerance = tolerance
        # per ray, allocated on demand: faces entered minus left, distance of the last face, and its
        # triangle, -1 if it was not a valid hit
        self._deeper: Ints | None = None
        self._distance: Floats | None = None
        self._triangle: Ints | None = None
        self._doubted: list[Ints] = []  # rays outside with an impossible hit

    def count(
        self, rays: Ints, hits: Hits, is_true: Bools, is_wrong: Bools
    ) -> tuple[Bools, Bools | None]:
        """Which hits (m,) of rays (m,) are true, considering the passed faces; and which are passed
        now, None for none.

        is_true, is_wrong : (m,) true or impossible if no shell intersects itself
        """
        if self._deeper is None and not is_wrong.any():
            return is_true, None

        is_inside = self._is_inside[rays]
        enters = is_wrong & is_inside
        self._doubted.append(rays[is_wrong & ~is_inside])
        if self._deeper is None:
            self._deeper = np.zeros(len(self._is_inside), np.int64)
            self._distance = np.full(len(self._is_inside), -np.inf)
            self._triangle = np.full(len(self._is_inside), -1)

        deeper, last = self._deeper[rays], self._triangle[rays]
        further = hits.distance - self._distance[rays]
        is_here = np.abs(further) <= self._tolerance

        # the same face may be hit behind several shell triangles, and rounding may swap two
        # coincident faces
        is_same = is_here & (hits.triangle == last)
        is_swapped = is_here & (last < 0) & (deeper == 1)
        leaves = is_true & (deeper > 0) & ~is_swapped

        passes = (enters | leaves) & (further > self._tolerance)
        self._deeper[rays[passes]] = (deeper + np.where(enters, 1, -1))[passes]
        self._distance[rays[passes]] = hits.distance[passes]
        self._triangle[rays[passes]] = np.where(enters, -1, hits.triangle)[passes]
        return is_true & ~leaves & ~is_same, passes

    def last(self, rays: Ints) -> Floats:
        """Distance, m, of the last face passed by each of rays (m,), -inf for none."""
        return np.full(len(rays), -np.inf) if self._distance is None else self._distance[rays]

    def some_of(self, rays: Ints) -> Ints:
        """The subset of rays (m,) that have passed a face."""
        return rays[:0] if self._distance is None else rays[np.isfinite(self._distance[rays])]

    def lost(self, ended: list[Ints]) -> Ints:
        """Rays that must have hit another face.

        Outside: rays with an impossible hit. Inside: rays that ended without a hit.
        """
        ended = np.concatenate([np.empty(0, np.int64), *ended])
        return np.concatenate([ended[self._is_inside[ended]], *self._doubted])


def enter_again(
    layer: Layer,
    question: Question,
    rays: Ints,
    shot: tuple[EngineHits, Bools, Floats],
    hits: tuple[Hits, Bools],
    passed: SelfIntersections,
) -> None:
    """Set hits of rays (m,) inside the glass that enter it again before they leave.

    shot : the engine's hits (n,), which m of them to use, and their distances (n,), m
    hits : hits on the layer (m,), and whether they exist (m,)
    """
    if layer.curved is None or question.leaves is None:
        return
    found, chosen, far = shot
    some, is_met = hits
    enters = dot(take(question.lines.directions, rays), take(found.normal, chosen)) < 0
    enters &= question.leaves[rays] & question.is_inside[rays]
    # the entered face lies behind the bounding shell, unless the ray leaves before it
    hitting = np.flatnonzero(enters & ~(is_met & (some.distance <= far[chosen])))
    if len(hitting):
        which = np.flatnonzero(chosen)[hitting]
        from_outside = np.zeros(len(hitting), bool)
        more, is_more = layer.refine(found, which, question.lines.at(rays[hitting]), from_outside)
        # before the exit, and beyond faces already passed
        t = more.distance
        is_more &= more.enters & (t > np.maximum(passed.last(rays[hitting]), 0.0) + layer.tolerance)
        is_more &= ~(is_met[hitting] & (some.distance[hitting] < t))
        some.put(hitting[is_more], more.at(is_more))
        is_met[hitting[is_more]] = True


@dataclass(frozen=True)
class MissedHitOptions:
    """Options of the search for missed hits; values that decide a hit are repeated in kiriko.h.

    Parameters
    ----------
    neighbours : rays shot next to a lost one
    wider : barycentric slack for a ray without a hit, which runs along a face and meets its plane
        far away; tuned by `dev.py judge` with fifty digits
    many_triangles : from this number on, curved faces are searched from one place only: a grazing
        ray can hit a large face twice, but not a small one
    most_tests : pairs of rays and triangles tested in one call: a few seconds
    pairs_at_once : pairs of rays and triangles culled together: about 10 MB
    near_at_once : pairs of rays and nearby faces tested together: about 20 MB and 0.05 s, so Esc is
        handled promptly
    """

    neighbours: int = 6
    wider: float = 1e-6
    many_triangles: int = 10_000
    most_tests: int = 20_000_000
    pairs_at_once: int = 1 << 18
    near_at_once: int = 1 << 13


MISSED_HITS = MissedHitOptions()


def count_starts(n_triangles: int) -> int:
    """Number of starting places on each curved face of a layer with so many triangles."""
    return len(ROOTS.starts) if n_triangles < MISSED_HITS.many_triangles else 1


class _Nearest:
    """The nearest true hits found so far for some rays of a question."""

    def __init__(self, layer: Layer, question: Question, rays: Ints) -> None:
        self.rays = rays
        self.hits = Hits.none(len(rays), layer.curved)
        self._least = -layer.tolerance
        self._accept = question.accept

    def keep(self, i: Ints, found: Hits, is_met: Bools | None = None) -> None:
        """Keep hits of rays i (n,) if they are nearer.

        Ties are resolved by the smaller triangle number, for a result independent of order.
        """
        mine = self.hits.distance[i]
        is_nearer = (found.distance > self._least) & (
            (found.distance < mine)
            | (found.distance == mine) & (found.triangle < self.hits.triangle[i])
        )
        good = np.flatnonzero(is_nearer if is_met is None else is_met & is_nearer)
        good = good[self._accept(self.rays[i[good]], found.at(good))[0]]
        # nearest last, so it overwrites the others
        good = good[np.lexsort((-found.triangle[good], -found.distance[good]))]
        self.hits.put(i[good], found.at(good))

    def put_into(self, hits: Hits) -> Ints:
        """Copy them to the hits of all rays; returns the rays without one."""
        is_found = self.hits.triangle >= 0
        hits.put(self.rays[is_found], self.hits.at(is_found))
        return self.rays[~is_found]


def find_missed_hits(layer: Layer, question: Question, rays: Ints, hits: Hits) -> Steps[None]:
    """Set hits missed by the engine, found in float64, for lost rays (n,)."""
    o, d = question.lines.at(rays)

    # a ring of rays around each, a few float32 steps away
    sideways = np.cross(d, np.where(np.abs(d[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    upwards = np.cross(d, sideways)
    angle = 2 * np.pi * np.arange(MISSED_HITS.neighbours)[:, None, None] / MISSED_HITS.neighbours
    moved = o + 8 * FLOAT32 * layer.radius * (np.cos(angle) * sideways + np.sin(angle) * upwards)

    nearest = _Nearest(layer, question, rays)
    yield from _search_neighbours(layer, question, moved.reshape(-1, 3), nearest)
    left = nearest.put_into(hits)
    yield from search_all_triangles(layer, question, left, hits)


def _search_neighbours(
    layer: Layer, question: Question, neighbours: Floats, nearest: _Nearest
) -> Steps[None]:
    """Keep the nearest true hit of rays among all triangles hit by their neighbours.

    neighbours : (m n, 3) origins, m for each ray
    """
    lines = question.lines.at(nearest.rays)
    row = np.tile(np.arange(len(nearest.rays)), len(neighbours) // len(nearest.rays))
    step = np.full(len(row), 3 * FLOAT32 * layer.radius)
    start = -2 * step

    while len(row):
        found, far = layer.shoot(RayLines(neighbours, lines.directions[row]), start)
        met = found.triangle >= 0
        neighbours, row, start, step, far = (x[met] for x in (neighbours, row, start, step, far))

        some, is_met = layer.refine(found, met, lines.at(row), None)
        nearest.keep(row, some, is_met & layer.is_on_face(some))

        # doubling: the loop ends once the ray has left the box
        start = np.maximum(far, start) + step
        step = 2 * step
        yield 0


def search_all_triangles(layer: Layer, question: Question, rays: Ints, hits: Hits) -> Steps[None]:
    """Test rays (n,) against every triangle, within the budget."""
    if not len(rays):
        return

    budget = max(1, MISSED_HITS.most_tests // layer.n_triangles)
    per_chunk = max(1, MISSED_HITS.pairs_at_once // layer.n_triangles)
    nearest = _Nearest(layer, question, rays[:budget])
    lines = question.lines.at(nearest.rays)
    spheres = spheres_of(layer.corners) if layer.curved is None else layer.curved.spheres
    yield 0
    near: list[tuple[Ints, Ints]] = []

    for first in range(0, len(nearest.rays), per_chunk):
        i, k = pass_by(spheres, lines.at(slice(first, first + per_chunk)))
        near.append((first + i, k))
        yield 0
        is_last = first + per_chunk >= len(nearest.rays)
        if is_last or sum(len(i) for i, _ in near) >= MISSED_HITS.near_at_once:
            i, k = (np.concatenate(column) for column in zip(*near, strict=True))
            yield from _test(layer, question, nearest, i, k)
            near = []

    nearest.put_into(hits)


def _test(layer: Layer, question: Question, nearest: _Nearest, i: Ints, k: Ints) -> Steps[None]:
    """Keep the nearest true hits of rays i (m,) on triangles k (m,)."""
    lines = question.lines.at(nearest.rays)
    if layer.curved is not None:
        is_curved = layer.curved.row[k] >= 0
        on_curved = i[is_curved], k[is_curved]
        i, k = i[~is_curved], k[~is_curved]
        yield from _test_curved(layer, question, nearest, *on_curved)

    for first in range(0, len(i), MISSED_HITS.near_at_once):
        j = i[first : first + MISSED_HITS.near_at_once]
        found = layer.on_facets(k[first : first + MISSED_HITS.near_at_once], *lines.at(j))
        good = is_within(found.u, found.v, MISSED_HITS.wider)
        nearest.keep(j[good], found.at(good))
        yield 0


def _test_curved(
    layer: Layer, question: Question, nearest: _Nearest, i: Ints, k: Ints
) -> Steps[None]:
    """Keep the nearest true hits of rays i (m,) on curved faces k (m,)."""
    lines = question.lines.at(nearest.rays)
    leaves = question.leaves_at(nearest.rays)
    holds = are_in_boxes(layer.curved, k, lines.at(i))
    i, k = i[holds], k[holds]

    for u, v in ROOTS.starts[: count_starts(layer.n_triangles)]:
        for first in range(0, len(i), MISSED_HITS.near_at_once):
            j = i[first : first + MISSED_HITS.near_at_once]
            faces = k[first : first + MISSED_HITS.near_at_once]
            spots = Spots(faces, np.full(len(j), u), np.full(len(j), v))
            of_these = None if leaves is None else leaves[j]
            found, is_met = layer.on_curved(spots, lines.at(j), of_these, is_last=True)
            nearest.keep(j, found, is_met)
            yield 0
