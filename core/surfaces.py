"""What is traced of a mesh: its surface, the shells it falls into, the solids they enclose."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .arrays import Bools, Floats, Ints
from .curved import CurvedFaces, grid
from .meshes import SAME_NORMAL, box_of, components, find_edges, find_joined, geometric_normals, volume_of
from .motion import Motion
from .rig import Mesh
from .steps import Pauses, finish
from .surface_fit import make_curved
from .vectors import dot, normalise

SAME_VOLUME = 1e-6  # of a shell: by less than this a shell is not larger than another in the same place
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]])  # and back
INWARD = 1e-3  # of a shell: by less than this it may stand out of another and be a cavity in it
LEAST_TURN = np.radians(0.25)  # a surface that turns by less over each triangle is as good as curved: 1e-3 display px


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

    corners (t, 3, 3) m; normals (t, 3) geometric, unit, to the front; curved faces over some triangles, or None;
    corner_normals (t, 3, 3) or None, used on the triangles that are flat with bent normals, is_bent (t,);
    patch (t,) label within this surface; n_open edges without a neighbour;
    n_contradicted smooth triangles that stay flat because their normals contradict their shape; n_doubted because their
    curved faces would be no nearer to what was meant
    """

    corners: Floats
    normals: Floats
    curved: CurvedFaces | None
    corner_normals: Floats | None
    is_bent: Bools
    patch: Ints
    n_open: int
    n_contradicted: int
    n_doubted: int

    def moved(self, motion: Motion) -> "Surface":
        """The same surface elsewhere."""
        return replace(
            self,
            corners=motion.points(self.corners),
            normals=motion.directions(self.normals),
            curved=None if self.curved is None else self.curved.moved(motion),
            corner_normals=None if self.corner_normals is None else motion.directions(self.corner_normals),
        )

    @property
    def n_curved(self) -> int:
        """Triangles with a curved face."""
        return 0 if self.curved is None else len(self.curved.coefficients)

    @cached_property
    def bounds(self) -> Floats:
        return box_of(self.corners)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume of the facets, m^3, positive for a solid."""
        return volume_of(self.corners)


def make_surface(mesh: Mesh) -> Surface:
    """Surface of a mesh."""
    return finish(making_surface(mesh))


def making_surface(mesh: Mesh, triangles: Ints | None = None, is_flipped: Bools | None = None) -> Pauses[Surface]:
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
    edges = find_edges(index)
    yield 0
    is_bent = np.zeros(len(index), bool)
    curved, n_contradicted, n_doubted = None, 0, 0
    by_corner = np.broadcast_to(normals[:, None], corners.shape)
    if corner_normals is not None and mesh.is_smooth is not None and mesh.is_smooth[chosen].any():
        is_smooth = mesh.is_smooth[chosen]
        with np.errstate(invalid="ignore", over="ignore"):
            corner_normals = normalise(corner_normals)
            is_usable = (np.einsum("tij,tj->ti", corner_normals, normals) > 0).all(axis=1)  # not so where one is NaN
        # a smooth-shaded face whose normals are its own is flat, and its own normal is the more exact one
        is_bent = is_smooth & is_usable & ~(np.abs(corner_normals - by_corner).max(axis=(1, 2)) <= SAME_NORMAL)
        by_corner = np.where(is_bent[:, None, None], corner_normals, by_corner)
        n_contradicted = int((is_smooth & ~is_usable).sum())
    is_joined = find_joined(by_corner, edges)
    if is_bent.any() and mesh.surface != "facets":
        turn = np.abs(by_corner - np.roll(by_corner, -1, axis=1)).max()
        # what rounding does to the slopes of faces through the vertices, against what bent normals miss
        slope = mesh.rounding / np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
        if turn > max(LEAST_TURN, np.sqrt(8 * slope)):
            given = mesh.vertices, index, by_corner, is_bent, edges, is_joined, normals, mesh.has_mean_normals
            curved, is_doubted = yield from make_curved(*given, is_automatic=mesh.surface == "automatic")
            if curved is not None:
                is_bent &= curved.row < 0
            n_doubted = int(is_doubted.sum())
            n_contradicted += int(is_bent.sum()) - n_doubted
    return Surface(
        corners,
        normals,
        curved,
        by_corner if is_bent.any() else None,
        is_bent,
        components(len(index), edges.first[is_joined], edges.second[is_joined]),
        edges.n_open,
        n_contradicted,
        n_doubted,
    )


def tessellate(mesh: Mesh, angle: float = np.radians(0.5), most: int = 1_000_000) -> Mesh:
    """The surface that is traced, in triangles so fine that it turns by less than an angle (radians) over each.

    Corner normals are those of the curved faces; flat triangles are parted, too, so that no edge meets the middle of
    another, and stay as drawn. The same mesh where nothing is curved.

    Parameters
    ----------
    most : triangles there may be at most
    """
    surface = make_surface(mesh)
    curved = surface.curved
    if curved is None:
        return mesh
    k = curved.parts(angle, max(1, int(np.sqrt(most / len(mesh.triangles)))))
    weights, parts = grid(k)
    points, normals = np.matmul(weights, surface.corners), np.empty((len(mesh.triangles), len(weights), 3))
    normals[:] = surface.normals[:, None]
    if surface.corner_normals is not None:
        bent = surface.is_bent
        normals[bent] = normalise(np.matmul(weights, surface.corner_normals[bent]))
    triangle = curved.triangle
    points[triangle] = curved.points_on(k)
    for i, weight in enumerate(weights):
        u, v = (np.full(len(triangle), w) for w in weight[1:])
        normals[triangle, i] = curved.normals(triangle, u, v)
    index, n_points = _shared_points(mesh.triangles, k)
    vertices = np.empty((max(n_points, len(mesh.vertices)), 3))
    vertices[: len(mesh.vertices)] = mesh.vertices
    vertices[index] = points
    return Mesh(
        vertices,
        index[:, parts].reshape(-1, 3),
        normals[:, parts].reshape(-1, 3, 3),
        np.repeat(surface.is_bent | (curved.row >= 0), k * k),
        surface="facets",
    )


def _shared_points(triangles: Ints, k: int) -> tuple[Ints, int]:
    """Indices (t, n) of the points of grid(k) on triangles (t, 3), the same for neighbours on their edge; how many."""
    steps = np.round(k * grid(k)[0]).astype(int)
    index = np.empty((len(triangles), len(steps)), np.int64)
    n = int(triangles.max()) + 1
    start, end = triangles, np.roll(triangles, -1, axis=1)
    key, edge = np.unique(np.minimum(start, end) * n + np.maximum(start, end), return_inverse=True)
    edge = edge.reshape(triangles.shape)
    n_inside = 0
    for i, step in enumerate(steps):
        corner, on_edge = np.flatnonzero(step == k), np.flatnonzero(step == 0)
        if len(corner):
            index[:, i] = triangles[:, corner[0]]
        elif len(on_edge):
            e = (on_edge[0] + 1) % 3  # the edge opposite the corner whose weight is 0
            along = np.where(start[:, e] < end[:, e], step[(e + 1) % 3], step[e])
            index[:, i] = n + edge[:, e] * (k - 1) + along - 1
        else:
            index[:, i] = n + len(key) * (k - 1) + n_inside * len(triangles) + np.arange(len(triangles))
            n_inside += 1
    return index, n + len(key) * (k - 1) + n_inside * len(triangles)


def holds(outer: Floats, inner: Floats) -> bool:
    """Is a shell of triangles (i, 3, 3) inside a closed one (o, 3, 3)? It may touch it, but not stand out of it."""
    low, high = box_of(inner)
    middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    centres = outer.mean(axis=1)
    size = np.linalg.norm(outer - centres[:, None], axis=2).max(axis=1)
    if (np.linalg.norm(centres - middle, axis=1) > radius + size).all():
        return bool(contains(outer, inner[0, :1])[0])  # they do not come near each other
    at = inner.reshape(-1, 3)
    found = at[[find(dot(at, way)) for way in OUTWARD for find in (np.argmin, np.argmax)]]
    return bool(contains(outer, found + INWARD * (middle - found)).all())


def split_shells(mesh: Mesh) -> list[tuple[Ints, Bools]]:
    """Connected shells of a mesh: triangle indices, and which of them must be turned so that all face one way.

    Of triangles between the same three vertices only the first counts: drawn twice it would not join its neighbours.
    """
    drawn = np.arange(len(mesh.triangles))
    edges = find_edges(mesh.triangles)
    if edges.n_open:
        drawn = np.sort(np.unique(np.sort(mesh.triangles, axis=1), axis=0, return_index=True)[1])
        edges = find_edges(mesh.triangles[drawn])
    n = len(drawn)
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
    return [(drawn[chosen], is_flipped[chosen]) for chosen in np.split(order, cuts)]


def solids_from_mesh(mesh: Mesh) -> list[Surface]:
    """Solids of a glass object, as by `making_solids`."""
    return finish(making_solids(mesh))


def making_solids(mesh: Mesh) -> Pauses[list[Surface]]:
    """Solids of a glass object: each outer shell with the cavities in it, all facing out of the glass.

    A closed shell inside one that is no cavity is a cavity, whichever way its faces were drawn. A shell with a
    boundary has no inside of its own: it stays as drawn.
    """
    shells = []  # their facets say which holds which: surfaces, which cost more, are made of whole solids only
    for chosen, is_flipped in split_shells(mesh):
        index = np.where(is_flipped[:, None], mesh.triangles[chosen, ::-1], mesh.triangles[chosen])
        corners = mesh.vertices[index]
        is_closed = find_edges(index).n_open == 0
        if is_closed and volume_of(corners) < 0:
            is_flipped = ~is_flipped
        shells.append((chosen, is_flipped, corners, is_closed))
        yield 0
    boxes = np.stack([box_of(corners) for *_, corners, _ in shells])
    volumes = np.array([abs(volume_of(corners)) for *_, corners, _ in shells])
    holders: list[list[int]] = [[]] * len(shells)
    depth = np.zeros(len(shells), np.int64)
    for i in np.argsort(volumes)[::-1]:  # those that hold others come first
        around = (boxes[:, 0] <= boxes[i, 0]).all(axis=1) & (boxes[:, 1] >= boxes[i, 1]).all(axis=1)
        around &= (1 - SAME_VOLUME) * volumes > volumes[i]  # a copy in the same place is not inside
        holders[i] = [j for j in np.flatnonzero(around) if shells[j][3] and holds(shells[j][2], shells[i][2])]
        depth[i] = max((depth[j] + 1 for j in holders[i]), default=0)
    members: dict[int, list[int]] = {i: [i] for i in np.flatnonzero(depth % 2 == 0)}
    for i in np.flatnonzero(depth % 2 == 1):
        for j in holders[i]:  # more than one where shells overlap
            if depth[j] == depth[i] - 1:
                members[j].append(i)
    solids = []
    for outer, group in members.items():
        chosen = np.concatenate([shells[i][0] for i in group])
        turned = np.concatenate([shells[i][1] ^ (i != outer) for i in group])
        solids.append((yield from making_surface(mesh, chosen, turned)))
    return solids
