"""Solids of a mesh: its shells, the direction they face, and the cavities inside them."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints, stable_argsort, take
from ..base.steps import Steps, run_steps
from ..base.vectors import dot
from ..rig.rig import Mesh
from .inner_faces import without_inner
from .meshes import Edges, box_of, components, find_edges, volume_of
from .surfaces import Surface, surface_steps

# relative: shells whose volumes differ by less may be copies in the same place
SAME_VOLUME = 1e-6
# tested in both directions
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]])
# fraction of a shell's size: a cavity may stick out of the shell around it as far
OUTSTANDING = 1e-3


def contains(corners: Floats, points: Floats) -> Bools:
    """Whether each point (n, 3) is inside the closed surface of triangles (t, 3, 3), by the solid
    angle (winding number).
    """
    winding = np.empty(len(points))
    # a loop is enough: only viewers and one corner of each shell are tested
    for k, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        top = dot(a, np.cross(b, c))
        below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        winding[k] = np.arctan2(top, below).sum() / (2 * np.pi)

    return np.abs(winding) > 0.5


def holds(outer: Floats, inner: Floats) -> bool:
    """Whether a shell of triangles (i, 3, 3) is inside a closed one (o, 3, 3). It may touch it, but
    not stick out of it.
    """
    low, high = box_of(inner)
    middle = (low + high) / 2
    radius = np.linalg.norm(high - low) / 2
    centres = outer.mean(axis=1)
    size = np.linalg.norm(outer - centres[:, None], axis=2).max(axis=1)
    if (np.linalg.norm(centres - middle, axis=1) > radius + size).all():
        return bool(contains(outer, inner[0, :1])[0])  # too far apart to touch

    # its outermost points, moved slightly inward
    at = inner.reshape(-1, 3)
    found = at[
        [find(dot(at, direction)) for direction in OUTWARD for find in (np.argmin, np.argmax)]
    ]
    return bool(contains(outer, found + OUTSTANDING * (middle - found)).all())


def split_shells(mesh: Mesh) -> tuple[list[tuple[Ints, Bools]], Edges]:
    """Connected shells of a mesh: triangle indices, and a mask of triangles to flip so all face one
    way; and the edges of all its triangles.

    Duplicates of a triangle are dropped: they would not join its neighbours.
    """
    drawn = np.arange(len(mesh.triangles))
    edges = find_edges(mesh.triangles)
    if edges.n_open:
        drawn = np.sort(np.unique(np.sort(mesh.triangles, axis=1), axis=0, return_index=True)[1])
        edges = find_edges(mesh.triangles[drawn])

    n = len(drawn)
    is_flipped = np.zeros(n, bool)

    if edges.is_same_way.any():
        as_drawn, flipped = _joined_orientations(edges, n)
        is_flipped = as_drawn >= flipped

    label = components(n, edges.first, edges.second)
    order = stable_argsort(label)
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return [(drawn[chosen], is_flipped[chosen]) for chosen in np.split(order, cuts)], edges


def _joined_orientations(edges: Edges, n: int) -> tuple[Ints, Ints]:
    """Components of a graph with two nodes a triangle, as drawn (n,) and flipped (n,), joined to
    the nodes of neighbours facing the same way: the lowest node of each component.
    """
    other = np.where(edges.is_same_way, n, 0)
    a = np.r_[edges.first, edges.first + n]
    b = np.r_[edges.second + other, (edges.second + n + other) % (2 * n)]
    label = components(2 * n, a, b)
    return label[:n], label[n:]


def find_turned(triangles: Ints) -> Bools:
    """Mask of triangles (t, 3) that face the other way than most of their shell; none on a
    one-sided surface.
    """
    n = len(triangles)
    edges = find_edges(triangles)
    if not edges.is_same_way.any():
        return np.zeros(n, bool)
    as_drawn, flipped = _joined_orientations(edges, n)
    shell = np.minimum(as_drawn, flipped)
    is_other = as_drawn > flipped
    are_most = np.bincount(shell, np.where(is_other, 1, -1), n) > 0
    return (is_other ^ are_most[shell]) & (as_drawn != flipped)


def solids_from_mesh(mesh: Mesh) -> list[Surface]:
    """Solids of a glass object, as by `solid_steps`."""
    return run_steps(solid_steps(mesh))


def solid_steps(mesh: Mesh) -> Steps[list[Surface]]:
    """Solids of a glass object: each outer shell with its cavities, all facing out of the glass.

    A closed shell inside a solid one is a cavity, whichever way its faces were drawn. A shell with
    a boundary has no inside: it stays as drawn. Faces inside a solid are ignored.
    """
    # facets decide the nesting: surfaces cost more, and are made for whole solids only
    shells = []
    volumes = []
    edges_of = []  # shells as oriented, None if not found yet
    split, edges = split_shells(mesh)
    if edges.n_open:
        mesh = without_inner(mesh)
        split, edges = split_shells(mesh)
    yield 0
    for chosen, is_flipped in split:
        index = np.where(is_flipped[:, None], mesh.triangles[chosen, ::-1], mesh.triangles[chosen])
        corners = take(mesh.vertices, index)
        if len(split) > 1 or is_flipped.any():
            edges = find_edges(index)
        is_closed = edges.n_open == 0
        volumes.append(volume_of(corners))
        is_inside_out = is_closed and volumes[-1] < 0
        if is_inside_out:
            is_flipped = ~is_flipped
        edges_of.append(None if is_inside_out else edges)
        shells.append((chosen, is_flipped, corners, is_closed))
        yield 0

    boxes = np.stack([box_of(corners) for *_, corners, _ in shells])
    volumes = np.abs(volumes)
    holders: list[list[int]] = [[]] * len(shells)
    depth = np.zeros(len(shells), np.int64)

    for i in np.argsort(volumes)[::-1]:  # largest first: holders come before their cavities
        around = (boxes[:, 0] <= boxes[i, 0]).all(axis=1) & (boxes[:, 1] >= boxes[i, 1]).all(axis=1)
        around &= (1 - SAME_VOLUME) * volumes > volumes[i]  # a copy in the same place is not inside
        holders[i] = [
            j for j in np.flatnonzero(around) if shells[j][3] and holds(shells[j][2], shells[i][2])
        ]
        depth[i] = max((depth[j] + 1 for j in holders[i]), default=0)

    members: dict[int, list[int]] = {i: [i] for i in np.flatnonzero(depth % 2 == 0)}
    for i in np.flatnonzero(depth % 2 == 1):
        for j in holders[i]:  # several if shells overlap
            if depth[j] == depth[i] - 1:
                members[j].append(i)

    solids = []
    for outer, group in members.items():
        chosen = np.concatenate([shells[i][0] for i in group])
        flipped = np.concatenate([shells[i][1] ^ (i != outer) for i in group])
        edges = edges_of[outer] if len(group) == 1 else None
        solids.append((yield from surface_steps(mesh, chosen, flipped, edges)))

    return solids
