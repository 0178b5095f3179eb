"""The surface that Subdivision goes towards, in float64, without Blender: closed meshes alone.

Rules of Catmull and Clark; places and normals on the limit by the masks of Halstead, Kass and
DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces" (1993).
"""

from dataclasses import dataclass

import numpy as np

from kiriko.core.rig.rig import Mesh

# radius and height, m, of a body that ends on its axis
LATHE = 1e-3 * np.array([(0, -18), (11, -15), (19, -7), (21, 2), (15, 11), (8, 14), (0, 18)])


@dataclass(frozen=True, eq=False)
class Cage:
    """A closed mesh by its loops: vertices (v, 3) m, the vertex (l,) that each starts at and the
    loop (l,) that follows it around its face, counter-clockwise from the front.
    """

    vertices: np.ndarray
    start: np.ndarray
    after: np.ndarray

    @classmethod
    def of(cls, vertices, sizes, start):
        """Of faces with so many corners each (f,), one after the other."""
        first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        after = np.arange(len(start)) + 1
        after[first + np.asarray(sizes) - 1] = first
        return cls(np.asarray(vertices, float), np.asarray(start), after)

    @property
    def before(self):
        """The loop (l,) that comes before each around its face."""
        before = np.empty_like(self.after)
        before[self.after] = np.arange(len(before))
        return before

    @property
    def twin(self):
        """The loop (l,) that runs the other way along the same edge."""
        n = len(self.vertices)
        end = self.start[self.after]
        order = np.argsort(self.start * n + end)
        twin = np.empty_like(order)
        twin[np.argsort(end * n + self.start)] = order
        assert (self.start[twin] == end).all(), "a mesh with open edges has no limit here"
        return twin


def divided(cage):
    """Each face in as many quads as it has corners."""
    v, start, after = cage.vertices, cage.start, cage.after
    twin = cage.twin
    n = len(v)

    # faces by their loops
    face = _face_of(after)
    of_face = _mean(v[start], face)
    edge = np.minimum(np.arange(len(start)), twin)
    of_edge, edge = np.unique(edge, return_inverse=True)
    ends = v[start[of_edge]] + v[start[after[of_edge]]]
    at_edge = (ends + of_face[face[of_edge]] + of_face[face[twin[of_edge]]]) / 4

    valence = np.bincount(start, minlength=n)[:, None]
    around = _mean(of_face[face], start, n)
    middles = _mean((v[start] + v[start[after]]) / 2, start, n)
    at_vertex = (around + 2 * middles + (valence - 3) * v) / valence

    quads = np.stack(
        [start, n + edge, n + len(at_edge) + face, n + edge[cage.before]], axis=1
    ).ravel()
    places = np.concatenate([at_vertex, at_edge, of_face])
    return Cage.of(places, np.full(len(start), 4), quads)


def limit(cage):
    """Where the vertices (v, 3) of a cage of quads go, m, and the unit normals (v, 3) there."""
    v, start, after = cage.vertices, cage.start, cage.after
    around = cage.twin[cage.before]
    places, normals = np.empty((2, *v.shape))
    first = np.empty(len(v), int)
    first[start] = np.arange(len(start))
    valences = np.bincount(start, minlength=len(v))

    for n in np.unique(valences):
        some = np.flatnonzero(valences == n)
        loops = [first[some]]
        for _ in range(n - 1):
            loops.append(around[loops[-1]])
        loops = np.stack(loops, axis=1)
        edges = v[start[after[loops]]]
        corners = v[start[after[after[loops]]]]
        own = v[some]
        places[some] = (n * n * own + 4 * edges.sum(axis=1) + corners.sum(axis=1)) / (n * (n + 5))

        turn = 2 * np.pi / n
        k = turn * np.arange(n)[:, None]
        of_edges = 1 + np.cos(turn) + np.cos(turn / 2) * np.sqrt(2 * (9 + np.cos(turn)))
        along, across = (
            (of_edges * wave(k) * edges + (wave(k) + wave(k + turn)) * corners).sum(axis=1)
            for wave in (np.cos, np.sin)
        )
        normals[some] = np.cross(along, across)

    return places, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def limit_mesh(cage, levels):
    """The limit as a mesh, with its own normals, divided so many times."""
    for _ in range(levels):
        cage = divided(cage)
    places, normals = limit(cage)
    quads = cage.start.reshape(-1, 4)
    triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    polygon = np.arange(len(triangles)) // 2
    return Mesh(
        places, triangles, normals[triangles], np.ones(len(triangles), bool), polygon=polygon
    )


def ring_cage(profile, n):
    """A profile of (radius, height) (m, 2), turned in n steps to a ring around the y axis."""
    a = 2 * np.pi * np.arange(n)[:, None] / n
    radius, height = profile.T
    grid = np.stack([radius * np.cos(a), height + 0 * a, -radius * np.sin(a)], axis=-1)
    index = np.arange(grid[..., 0].size).reshape(n, -1)
    on, up = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    quads = np.stack([index, on, np.roll(on, -1, axis=1), up], axis=-1)
    return Cage.of(grid.reshape(-1, 3), np.full(index.size, 4), quads.ravel())


def lathe_cage(profile, n):
    """A closed cage around the y axis, whose ends are fans of triangles around poles."""
    ring = ring_cage(profile[1:-1], n)
    m = len(profile) - 2
    quads = ring.start.reshape(n, m, 4)[:, :-1].reshape(-1, 4)
    index = np.arange(n * m).reshape(n, m)
    on = np.roll(index, -1, axis=0)
    below, above = np.full(n, n * m), np.full(n, n * m + 1)
    fans = [
        np.stack([below, on[:, 0], index[:, 0]], axis=1),
        np.stack([above, index[:, -1], on[:, -1]], axis=1),
    ]
    poles = [[0, profile[0, 1], 0], [0, profile[-1, 1], 0]]
    return Cage.of(
        np.concatenate([ring.vertices, poles]),
        np.repeat([4, 3], [len(quads), 2 * n]),
        np.concatenate([quads.ravel(), *(fan.ravel() for fan in fans)]),
    )


def uneven_profile(seed, points):
    """A profile of so many points around a place 20 mm beside the axis, uneven at random."""
    random = np.random.default_rng(seed)
    a = 2 * np.pi * (np.arange(points) + random.uniform(-0.25, 0.25, points)) / points
    a += random.uniform(0, 2 * np.pi)
    far = random.uniform(0.7, 1.2, points)
    wide, high = random.uniform(4, 10), random.uniform(3, 8)
    return 1e-3 * np.stack([20 + wide * far * np.cos(a), high * far * np.sin(a)], axis=1)


def _face_of(after):
    """The face (l,) of each loop; loops of a face follow each other."""
    begins = np.ones(len(after), bool)
    begins[1:] = after[:-1] != np.arange(1, len(after))
    return np.cumsum(begins) - 1


def _mean(values, group, n=None):
    """Means (n, 3) of values (k, 3) by their group (k,)."""
    n = group.max() + 1 if n is None else n
    sums = np.stack([np.bincount(group, x, n) for x in values.T], axis=1)
    return sums / np.bincount(group, minlength=n)[:, None]
