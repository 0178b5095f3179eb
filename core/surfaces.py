"""What is traced of a mesh: its surface, the shells it falls into, the solids they enclose."""

from dataclasses import dataclass

import numpy as np

from .meshes import SAME_NORMAL, components, find_edges, find_patches, geometric_normals
from .optics import dot
from .rig import Bools, Floats, Ints, Mesh


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
