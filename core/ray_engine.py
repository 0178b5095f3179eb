"""Which triangle a ray meets first: Embree's answer, with the hit refined in float64.

Embree (float32) only says *which* triangle; where the ray meets it is computed in float64 from the unmoved ray.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .optics import dot
from .rig import Bools, Floats, Ints

FEW_TRIANGLES = 32  # up to here all triangles are tested in float64 and no ray engine is built
FLOAT32 = 2.0**-23  # spacing of float32 numbers just above 1
EDGE = 1e-10  # barycentric slack of the float64 test, so that a ray through an edge or vertex meets a face
BESIDE = 6  # rays shot beside one that was lost
RESCUE_TESTS = 20_000_000  # most ray-triangle pairs that may be tested in float64 in one call: a few seconds


@dataclass(frozen=True, eq=False)
class Frames:
    """Triangles as planes with barycentric axes: u = (p - corner) . axis_u, v likewise, p a point of the plane.

    corner, normal, axis_u, axis_v : (t, 3); the normal is not unit; NaN axes for a triangle without area
    """

    corner: Floats
    normal: Floats
    axis_u: Floats
    axis_v: Floats

    @classmethod
    def of(cls, corners: Floats) -> "Frames":
        """Frames of triangles with corners (t, 3, 3)."""
        e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(e1, e2)
        with np.errstate(invalid="ignore", divide="ignore"):
            area = 1.0 / dot(normal, normal)[:, None]
            return cls(corners[:, 0], normal, np.cross(e2, normal) * area, np.cross(normal, e1) * area)

    def distance(self, k: Ints | int, origins: Floats, directions: Floats) -> Floats:
        """Distance of rays (n, 3) to the *planes* of triangles k; not finite where they are parallel."""
        normal = self.normal[k]
        with np.errstate(invalid="ignore", divide="ignore"):
            return dot(self.corner[k] - origins, normal) / dot(directions, normal)

    def barycentric(self, k: Ints | int, points: Floats) -> tuple[Floats, Floats]:
        """Barycentric u, v of points (n, 3) in the planes of triangles k."""
        inside = points - self.corner[k]
        return dot(inside, self.axis_u[k]), dot(inside, self.axis_v[k])


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of n rays: distance (n,) m, inf for none; triangle (n,), -1 for none; barycentric u, v (n,)."""

    distance: Floats
    triangle: Ints
    u: Floats
    v: Floats

    @classmethod
    def none(cls, n: int) -> "Hits":
        """No hit for any of n rays."""
        return cls(np.full(n, np.inf), np.full(n, -1), np.zeros(n), np.zeros(n))

    def put(self, rays: Ints, distance: Floats, triangle: Ints, u: Floats, v: Floats) -> None:
        """Set the hits of some rays."""
        self.distance[rays], self.triangle[rays] = distance, triangle
        self.u[rays], self.v[rays] = u, v

    def at(self, rays: Ints | Bools) -> "Hits":
        """The hits of some rays."""
        return Hits(self.distance[rays], self.triangle[rays], self.u[rays], self.v[rays])


def slab(bounds: Floats, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Distances (n,) at which rays enter and leave an axis-aligned box (2, 3); enter > leave is a miss."""
    enter, leave = np.full(len(origins), -np.inf), np.full(len(origins), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):  # one axis at a time: three times as fast as reductions over rows of three
            inverse = 1.0 / directions[:, axis]
            low = (bounds[0, axis] - origins[:, axis]) * inverse
            high = (bounds[1, axis] - origins[:, axis]) * inverse
            # fmax and fmin pass over the NaN of a ray that runs within a face of the box
            enter = np.fmax(enter, np.fmin(low, high))
            leave = np.fmin(leave, np.fmax(low, high))
    return enter, leave


Accept = Callable[[Ints, Ints, Floats], tuple[Bools, Bools]]
"""Of hits (ray indices, triangle indices, distances): is it a true one, and is it one that cannot be?"""


class Layer:
    """Triangles that are asked together for the first hit of each ray.

    Solids of one layer do not touch one another, so that hits at the same place are found in different layers.
    """

    def __init__(self, corners: Floats) -> None:
        self.frames = Frames.of(corners)
        self.bounds = np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])
        self.centre = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(self.bounds[1] - self.centre)) or 1.0
        self.tolerance = 4 * FLOAT32 * self.radius
        self.n_triangles = len(corners)
        self._engine = None if self.has_engine is False else self._build(corners)

    @property
    def has_engine(self) -> bool:
        """Few triangles need no ray engine."""
        return self.n_triangles > FEW_TRIANGLES

    def _build(self, corners: Floats):
        from embreex import rtcore_scene  # late: a rig of few flat faces needs no ray engine
        from embreex.mesh_construction import TriangleMesh

        engine = rtcore_scene.EmbreeScene()
        TriangleMesh(engine, ((corners - self.centre) / self.radius).astype(np.float32))
        return engine

    def first_hits(self, origins: Floats, directions: Floats, is_inside: Bools, accept: Accept) -> Hits:
        """First true hits of rays.

        Parameters
        ----------
        origins, directions : (n, 3) world, float64
        is_inside : (n,) the ray is inside a solid of this layer, so that a miss cannot be
        accept : which hits are true ones
        """
        hits = Hits.none(len(origins))
        grown = self.bounds + np.array([[-self.tolerance], [self.tolerance]])
        enter, leave = slab(grown, origins, directions)
        rays = np.flatnonzero((enter <= leave) & (leave >= 0) | is_inside)
        if not len(rays):
            return hits
        if not self.has_engine:
            self._test_all(origins, directions, rays, accept, hits)
            return hits
        lost = self._ask_embree(origins, directions, rays, np.maximum(enter[rays], 0.0), is_inside, accept, hits)
        if len(lost):
            self._rescue(origins, directions, lost, accept, hits)
        return hits

    def _test_all(self, origins: Floats, directions: Floats, rays: Ints, accept: Accept, hits: Hits) -> None:
        origins, directions = origins[rays], directions[rays]
        best = np.full(len(rays), np.inf)
        for k in range(self.n_triangles):
            t = self.frames.distance(k, origins, directions)
            i = np.flatnonzero((t < best) & (t > -self.tolerance))
            u, v = self.frames.barycentric(k, origins[i] + t[i, None] * directions[i])
            is_hit = _is_within(u, v)
            i, u, v = i[is_hit], u[is_hit], v[is_hit]
            is_true, _ = accept(rays[i], np.full(len(i), k), t[i])
            i, u, v = i[is_true], u[is_true], v[is_true]
            best[i] = t[i]
            hits.put(rays[i], t[i], k, u, v)

    def _shoot(self, origins: Floats, directions: Floats, start: Floats) -> tuple[Ints, Floats]:
        """Triangle that Embree finds from `start` on (-1 for none), and its distance as Embree has it."""
        moved = (origins + start[:, None] * directions - self.centre) / self.radius
        found = self._engine.run(moved.astype(np.float32), directions.astype(np.float32), output=True)
        return found["primID"].astype(np.int64), start + found["tfar"].astype(float) * self.radius

    def _ask_embree(
        self,
        origins: Floats,
        directions: Floats,
        rays: Ints,
        start: Floats,
        is_inside: Bools,
        accept: Accept,
        hits: Hits,
    ) -> Ints:
        """Put the hits that Embree finds; return the rays that must have hit something else."""
        lost = []
        # far rays begin a little before the box, near ones a little ahead, so as not to meet the face they come from
        step = np.full(len(rays), 3 * FLOAT32 * self.radius)
        start = np.where(start > 0, start - 2 * self.tolerance, step)
        while len(rays):
            o, d = origins[rays], directions[rays]
            k, far = self._shoot(o, d, start)
            is_miss = k < 0
            if is_miss.any():
                lost.append(rays[is_miss & is_inside[rays]])
                rays, start, step, k, far, o, d = (x[~is_miss] for x in (rays, start, step, k, far, o, d))
            t = self.frames.distance(k, o, d)
            t = np.where(np.isfinite(t), t, far)
            is_true, is_wrong = accept(rays, k, t)
            some = slice(None) if is_true.all() else is_true
            hits.put(rays[some], t[some], k[some], *self.frames.barycentric(k[some], o[some] + t[some, None] * d[some]))
            lost.append(rays[is_wrong])
            again = ~is_true
            start = np.maximum(np.maximum(t, far) + step, start + step)[again]
            rays, step = rays[again], 2 * step[again]  # doubling: the loop ends once the ray has left the box
        return np.unique(np.concatenate(lost)) if lost else np.empty(0, np.int64)

    def _rescue(self, origins: Floats, directions: Floats, rays: Ints, accept: Accept, hits: Hits) -> None:
        """Find in float64 what Embree let through: it loses some of the rays that are aimed at vertices and edges.

        Rays beside the lost one tell which triangles are near; only where none of those is met are all of them tested.
        """
        o, d = origins[rays], directions[rays]
        best = Hits.none(len(rays))
        aside = np.cross(d, np.where(np.abs(d[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        upward = np.cross(d, aside)
        for turn in range(BESIDE):
            angle = 2 * np.pi * turn / BESIDE
            moved = o + 8 * FLOAT32 * self.radius * (np.cos(angle) * aside + np.sin(angle) * upward)
            self._nearest_of_all(moved, o, d, rays, accept, best)
        is_found = best.triangle >= 0
        some = best.at(is_found)
        hits.put(rays[is_found], some.distance, some.triangle, some.u, some.v)
        self._test_in_float64(origins, directions, rays[~is_found], accept, hits)

    def _nearest_of_all(
        self, beside: Floats, origins: Floats, directions: Floats, rays: Ints, accept: Accept, best: Hits
    ) -> None:
        """Put into `best` the nearest true hit of rays among all triangles that rays beside them meet."""
        live = np.arange(len(rays))
        step = np.full(len(rays), 3 * FLOAT32 * self.radius)
        start = -2 * step
        while len(live):
            o, d = origins[live], directions[live]
            k, far = self._shoot(beside[live], d, start)
            met = k >= 0
            live, start, step, k, far, o, d = (x[met] for x in (live, start, step, k, far, o, d))
            t = self.frames.distance(k, o, d)
            u, v = self.frames.barycentric(k, o + t[:, None] * d)
            good = np.flatnonzero(_is_within(u, v) & (t > -self.tolerance) & (t < best.distance[live]))
            good = good[accept(rays[live[good]], k[good], t[good])[0]]
            best.put(live[good], t[good], k[good], u[good], v[good])
            start = np.maximum(far, start) + step
            step = 2 * step

    def _test_in_float64(self, origins: Floats, directions: Floats, rays: Ints, accept: Accept, hits: Hits) -> None:
        """Test rays against every triangle, as far as the budget goes."""
        budget = max(1, RESCUE_TESTS // self.n_triangles)
        per_chunk = max(1, 2_000_000 // self.n_triangles)
        every = slice(None)
        for first in range(0, min(len(rays), budget), per_chunk):
            some = rays[first : first + per_chunk]
            o, d = origins[some, None], directions[some, None]
            t = self.frames.distance(every, o, d)
            u, v = self.frames.barycentric(every, o + t[..., None] * d)
            i, k = np.nonzero(_is_within(u, v) & (t > -self.tolerance))
            is_true, _ = accept(some[i], k, t[i, k])
            i, k = i[is_true], k[is_true]
            order = np.argsort(-t[i, k], kind="stable")  # nearest last, so that it is the one that stays
            i, k = i[order], k[order]
            hits.put(some[i], t[i, k], k, u[i, k], v[i, k])


def _is_within(u: Floats, v: Floats) -> Bools:
    return (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE)
