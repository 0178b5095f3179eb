"""Hits that a ray engine missed: it loses some of the rays that are aimed at vertices and edges.

Rays beside the lost one tell which triangles are near. Only where none of those is met every
triangle is tested in float64, as far as a budget goes.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FLOAT32, Bools, Floats, Ints
from ..glass.curved_hits import are_in_boxes, pass_by
from ..glass.curved_roots import ROOTS, Lines, Spots
from ..glass.meshes import spheres_of
from ..steps import Pauses
from .hits import Hits, Question, is_within

if TYPE_CHECKING:
    from .ray_engine import Layer


@dataclass(frozen=True)
class RescueKnobs:
    """How lost rays are looked for; numbers that decide a hit are the kernel's, too (kiriko.h).

    Parameters
    ----------
    beside : rays shot beside one that was lost
    wider : barycentric slack for a ray that met nothing: it runs along a face, whose plane it meets
        far beside; tuned by `dev.py judge`, at fifty digits
    many_triangles : from here on a curved face is searched from one place only: a ray that grazes
        can meet a large face twice, but not a small one
    most_tests : pairs of rays and triangles that may be tested in one call: a few seconds
    pairs_at_once : of rays and triangles that are looked over together: about 10 MB
    near_at_once : pairs of rays and faces near them whose hits are found together: about 20 MB, and
        0.05 s, so that Esc is heard
    """

    beside: int = 6
    wider: float = 1e-6
    many_triangles: int = 10_000
    most_tests: int = 20_000_000
    pairs_at_once: int = 1 << 18
    near_at_once: int = 1 << 13


RESCUE = RescueKnobs()


def count_starts(n_triangles: int) -> int:
    """From how many places each curved face of a layer of so many triangles is searched."""
    return len(ROOTS.starts) if n_triangles < RESCUE.many_triangles else 1


class _Nearest:
    """The nearest true hits, as far as they are found, of some rays of a question."""

    def __init__(self, layer: "Layer", question: Question, rays: Ints) -> None:
        self.rays = rays
        self.hits = Hits.none(len(rays), layer.curved)
        self._least = -layer.tolerance
        self._accept = question.accept

    def keep(self, i: Ints, found: Hits, is_met: Bools | None = None) -> None:
        """Keep hits found for rays of numbers i (n,) among these where they are nearer.

        Of faces at the same distance the first by number counts, whichever is found first.
        """
        mine = self.hits.distance[i]
        is_nearer = (found.distance > self._least) & (
            (found.distance < mine)
            | (found.distance == mine) & (found.triangle < self.hits.triangle[i])
        )
        good = np.flatnonzero(is_nearer if is_met is None else is_met & is_nearer)
        good = good[self._accept(self.rays[i[good]], found.at(good))[0]]
        # nearest last, so that it is the one that stays
        good = good[np.lexsort((-found.triangle[good], -found.distance[good]))]
        self.hits.put(i[good], found.at(good))

    def put_into(self, hits: Hits) -> Ints:
        """Put them among the hits of all rays; return the rays that have none."""
        is_found = self.hits.triangle >= 0
        hits.put(self.rays[is_found], self.hits.at(is_found))
        return self.rays[~is_found]


def rescue(layer: "Layer", question: Question, rays: Ints, hits: Hits) -> Pauses[None]:
    """Put hits that the engine missed, found in float64, for lost rays (n,)."""
    o, d = question.lines.at(rays)

    # rays in a ring around each, a few float32 steps aside
    aside = np.cross(d, np.where(np.abs(d[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    upward = np.cross(d, aside)
    angle = 2 * np.pi * np.arange(RESCUE.beside)[:, None, None] / RESCUE.beside
    moved = o + 8 * FLOAT32 * layer.radius * (np.cos(angle) * aside + np.sin(angle) * upward)

    nearest = _Nearest(layer, question, rays)
    yield from _ask_beside(layer, question, moved.reshape(-1, 3), nearest)
    left = nearest.put_into(hits)
    yield from ask_all_triangles(layer, question, left, hits)


def _ask_beside(
    layer: "Layer", question: Question, beside: Floats, nearest: _Nearest
) -> Pauses[None]:
    """Keep the nearest true hit of rays among all triangles
    that rays beside them (m n, 3), m of each, meet.
    """
    lines = question.lines.at(nearest.rays)
    row = np.tile(np.arange(len(nearest.rays)), len(beside) // len(nearest.rays))
    step = np.full(len(row), 3 * FLOAT32 * layer.radius)
    start = -2 * step

    while len(row):
        found, far = layer.shoot(Lines(beside, lines.directions[row]), start)
        met = found.triangle >= 0
        beside, row, start, step, far = (x[met] for x in (beside, row, start, step, far))

        some, is_met = layer.refine(found, met, lines.at(row), None)
        nearest.keep(row, some, is_met & layer.is_on_face(some))

        # doubling: the loop ends once the ray has left the box
        start = np.maximum(far, start) + step
        step = 2 * step
        yield 0


def ask_all_triangles(layer: "Layer", question: Question, rays: Ints, hits: Hits) -> Pauses[None]:
    """Test rays (n,) against every triangle, as far as the budget goes."""
    if not len(rays):
        return

    budget = max(1, RESCUE.most_tests // layer.n_triangles)
    per_chunk = max(1, RESCUE.pairs_at_once // layer.n_triangles)
    nearest = _Nearest(layer, question, rays[:budget])
    lines = question.lines.at(nearest.rays)
    spheres = spheres_of(layer.corners) if layer.curved is None else layer.curved.spheres
    yield 0
    near: list[tuple[Ints, Ints]] = []

    for first in range(0, len(nearest.rays), per_chunk):
        i, k = pass_by(spheres, lines.at(slice(first, first + per_chunk)))
        near.append((first + i, k))
        yield 0
        # those of several chunks are tested together
        is_last = first + per_chunk >= len(nearest.rays)
        if is_last or sum(len(i) for i, _ in near) >= RESCUE.near_at_once:
            i, k = (np.concatenate(column) for column in zip(*near, strict=True))
            yield from _test(layer, question, nearest, i, k)
            near = []

    nearest.put_into(hits)


def _test(layer: "Layer", question: Question, nearest: _Nearest, i: Ints, k: Ints) -> Pauses[None]:
    """Keep the nearest true hits of rays of numbers i (m,) among these on triangles k (m,)."""
    lines = question.lines.at(nearest.rays)
    if layer.curved is not None:
        is_curved = layer.curved.row[k] >= 0
        on_curved = i[is_curved], k[is_curved]
        i, k = i[~is_curved], k[~is_curved]
        yield from _test_curved(layer, question, nearest, *on_curved)

    for first in range(0, len(i), RESCUE.near_at_once):
        j = i[first : first + RESCUE.near_at_once]
        found = layer.on_facets(k[first : first + RESCUE.near_at_once], *lines.at(j))
        good = is_within(found.u, found.v, RESCUE.wider)
        nearest.keep(j[good], found.at(good))
        yield 0


def _test_curved(
    layer: "Layer", question: Question, nearest: _Nearest, i: Ints, k: Ints
) -> Pauses[None]:
    """Keep the nearest true hits of rays of numbers i (m,) among these on curved faces k (m,)."""
    lines = question.lines.at(nearest.rays)
    leaves = question.leaves_at(nearest.rays)
    holds = are_in_boxes(layer.curved, k, lines.at(i))
    i, k = i[holds], k[holds]

    for u, v in ROOTS.starts[: count_starts(layer.n_triangles)]:
        for first in range(0, len(i), RESCUE.near_at_once):
            j = i[first : first + RESCUE.near_at_once]
            faces = k[first : first + RESCUE.near_at_once]
            spots = Spots(faces, np.full(len(j), u), np.full(len(j), v))
            of_these = None if leaves is None else leaves[j]
            found, is_met = layer.on_curved(spots, lines.at(j), of_these, is_last=True)
            nearest.keep(j, found, is_met)
            yield 0
