"""Triangles and what is hit: shells and solids, patches, and the ray engine with hits refined in float64.

Embree (float32) only says *which* triangle; where the ray meets it is computed in float64 from the unmoved ray.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .optics import dot, normalise
from .rig import Bools, Floats, Ints, Mesh

FEW_TRIANGLES = 32  # up to here all triangles are tested in float64 and no ray engine is built
SAME_NORMAL = 1e-5  # radians: corner normals closer than this join faces to one patch (float32 noise is 1e-7 to 1e-6)
FLOAT32 = 2.0**-23  # spacing of float32 numbers just above 1
EDGE = 1e-10  # barycentric slack of the float64 test, so that a ray through an edge or vertex meets a face
BESIDE = 6  # rays shot beside one that was lost
RESCUE_TESTS = 20_000_000  # most ray-triangle pairs that may be tested in float64 in one call: a few seconds


def components(n: int, a: Ints, b: Ints) -> Ints:
    """Smallest node label (n,) in each connected component of n nodes with edges a[i] - b[i]."""
    parent = np.arange(n)
    while len(a):
        low, high = np.minimum(a, b), np.maximum(a, b)
        parent[high] = low  # any one writer wins; the other edges come round again
        while True:
            jumped = parent[parent]
            if np.array_equal(jumped, parent):
                break
            parent = jumped
        a, b = parent[a], parent[b]
        differs = a != b
        a, b = a[differs], b[differs]
    return parent


@dataclass(frozen=True, eq=False)
class Edges:
    """Pairs of triangles that share an edge, and whether the mesh is closed and wound one way.

    first, second : (e,) triangle indices; corner_first, corner_second : (e,) corner at which the edge starts in each
    is_same_way : (e,) both run along the edge in the same direction, so one of them is wound the wrong way
    n_open : edges with one triangle or more than two
    """

    first: Ints
    second: Ints
    corner_first: Ints
    corner_second: Ints
    is_same_way: Bools
    n_open: int


def find_edges(triangles: Ints) -> Edges:
    """Match the edges of triangles (t, 3) by their vertex indices. Edges of more than two triangles join none."""
    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    begins = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    counts = np.diff(np.r_[begins, len(ordered)])
    pairs = begins[counts == 2]
    i, j = order[pairs], order[pairs + 1]
    return Edges(i // 3, j // 3, i % 3, j % 3, start[i] == start[j], int((counts != 2).sum()))


def geometric_normals(corners: Floats) -> Floats:
    """Unit normals (t, 3) of triangles with corners (t, 3, 3); zero for a triangle without area."""
    return normalise(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def edge_corners(values: Floats, edges: Edges) -> tuple[Floats, Floats]:
    """Values (t, 3, c) of the corners at both ends of each edge, (e, 2, c), in its first and its second triangle."""
    i, j = edges.corner_first, edges.corner_second
    next_i, next_j = (i + 1) % 3, (j + 1) % 3
    # the second triangle runs along the edge the other way, if both are wound alike
    start, end = np.where(edges.is_same_way, j, next_j), np.where(edges.is_same_way, next_j, j)
    first = np.stack([values[edges.first, i], values[edges.first, next_i]], axis=1)
    return first, np.stack([values[edges.second, start], values[edges.second, end]], axis=1)


def find_patches(normals: Floats, edges: Edges) -> Ints:
    """Label (t,) of the patch of each triangle: faces joined where the corner normals agree at both ends of an edge.

    normals : (t, 3, 3) unit normals at the corners (a flat triangle has its own three times).
    """
    first, second = edge_corners(normals, edges)
    joined = np.abs(first - second).max(axis=(1, 2)) < SAME_NORMAL
    return components(len(normals), edges.first[joined], edges.second[joined])


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


def interpolate(values: Floats, u: Floats, v: Floats) -> Floats:
    """Corner values (n, 3, c) at barycentric u, v (n,)."""
    return (1 - u - v)[:, None] * values[:, 0] + u[:, None] * values[:, 1] + v[:, None] * values[:, 2]


def contains(corners: Floats, points: Floats) -> Bools:
    """Is each point (n, 3) inside the closed surface of triangles (t, 3, 3)? By the solid angle (winding number)."""
    winding = np.empty(len(points))
    for k, point in enumerate(points):  # few points are ever asked for: viewers and one corner of each shell
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        top = dot(a, np.cross(b, c))
        below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        winding[k] = np.arctan2(top, below).sum() / (2 * np.pi)
    return np.abs(winding) > 0.5


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles ready to be traced.

    corners (t, 3, 3) m; normals (t, 3) geometric, unit, to the front; corner_normals (t, 3, 3) or None;
    is_smooth (t,); patch (t,) label within this surface; n_open edges without a neighbour
    """

    corners: Floats
    normals: Floats
    corner_normals: Floats | None
    is_smooth: Bools
    patch: Ints
    n_open: int

    @property
    def bounds(self) -> Floats:
        return np.stack([self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))])

    @property
    def volume(self) -> float:
        """Enclosed volume, m^3, positive for a solid."""
        a, b, c = np.moveaxis(self.corners - self.corners[0, 0], 1, 0)
        return float(dot(a, np.cross(b, c)).sum() / 6)


def make_surface(mesh: Mesh, triangles: Ints | None = None, is_flipped: Bools | None = None) -> Surface:
    """Surface of a mesh, or of some of its triangles (indices), some of them with the winding turned."""
    chosen = np.arange(len(mesh.triangles)) if triangles is None else triangles
    index = mesh.triangles[chosen]
    corner_normals = None if mesh.corner_normals is None else mesh.corner_normals[chosen]
    if is_flipped is not None and is_flipped.any():
        index = np.where(is_flipped[:, None], index[:, ::-1], index)
        if corner_normals is not None:
            corner_normals = np.where(is_flipped[:, None, None], -corner_normals[:, ::-1], corner_normals)
    corners = mesh.vertices[index]
    normals = geometric_normals(corners)
    is_smooth = np.zeros(len(index), bool)
    by_corner = np.repeat(normals[:, None], 3, axis=1)
    if corner_normals is not None and mesh.is_smooth is not None:
        # a smooth-shaded face whose normals are its own is flat, and its own normal is the more exact one
        is_smooth = mesh.is_smooth[chosen] & (np.abs(corner_normals - by_corner).max(axis=(1, 2)) > SAME_NORMAL)
        by_corner = np.where(is_smooth[:, None, None], corner_normals, by_corner)
    edges = find_edges(index)
    return Surface(
        corners,
        normals,
        corner_normals if is_smooth.any() else None,
        is_smooth,
        find_patches(by_corner, edges),
        edges.n_open,
    )


def split_shells(mesh: Mesh) -> list[tuple[Ints, Bools]]:
    """Connected shells of a mesh: triangle indices, and which of them must be turned so that all face one way."""
    edges = find_edges(mesh.triangles)
    n = len(mesh.triangles)
    is_flipped = np.zeros(n, bool)
    if edges.is_same_way.any():
        # two nodes a triangle, as drawn and turned: the component that holds the lowest node tells which to turn
        other = np.where(edges.is_same_way, n, 0)
        a = np.r_[edges.first, edges.first + n]
        b = np.r_[edges.second + other, (edges.second + n + other) % (2 * n)]
        label = components(2 * n, a, b)
        is_flipped = label[:n] >= label[n:]
    label = components(n, edges.first, edges.second)
    order = np.argsort(label, kind="stable")
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return [(chosen, is_flipped[chosen]) for chosen in np.split(order, cuts)]


def solids_from_mesh(mesh: Mesh) -> list[Surface]:
    """Solids of a glass object: each outer shell with the cavities in it, all facing out of the glass.

    A closed shell inside an odd number of others is a cavity, whichever way its faces were drawn. A shell with a
    boundary has no inside of its own: it stays as drawn.
    """
    shells = []
    for chosen, is_flipped in split_shells(mesh):
        surface = make_surface(mesh, chosen, is_flipped)
        if surface.n_open == 0 and surface.volume < 0:
            is_flipped = ~is_flipped
            surface = make_surface(mesh, chosen, is_flipped)
        shells.append((chosen, is_flipped, surface))
    if len(shells) == 1:
        return [shells[0][2]]
    boxes = np.stack([surface.bounds for *_, surface in shells])
    holders: list[list[int]] = []
    for i, (*_, inner) in enumerate(shells):
        around = (boxes[:, 0] <= boxes[i, 0]).all(axis=1) & (boxes[:, 1] >= boxes[i, 1]).all(axis=1)
        around[i] = False
        point = inner.corners[0, :1]
        holders.append([j for j in np.flatnonzero(around) if shells[j][2].n_open == 0
                        and contains(shells[j][2].corners, point)[0]])  # fmt: skip
    depth = np.array([len(h) for h in holders])
    members: dict[int, list[int]] = {i: [i] for i in np.flatnonzero(depth % 2 == 0)}
    for i in np.flatnonzero(depth % 2 == 1):
        owner = next(j for j in holders[i] if depth[j] == depth[i] - 1)
        members[owner].append(i)
    solids = []
    for group in members.values():
        chosen = np.concatenate([shells[i][0] for i in group])
        turned = np.concatenate([shells[i][1] ^ (depth[i] % 2 == 1) for i in group])
        solids.append(make_surface(mesh, chosen, turned))
    return solids


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
