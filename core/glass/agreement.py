"""Normals that agree where curved faces meet, and whether the faces are to be trusted."""

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Floats, Ints, taken
from ..vectors import length_of, normalise
from .curved import FACES_AT_ONCE
from .meshes import Edges
from .quartics import AT, AT_NODES, INWARD, N_NODES, N_ON_EDGES, NODES

# radians: normals that differ by less move landings by
# 1e-3 px; those of fine meshes do, 1e-7 and less
AGREE = 1e-6
# of a face's gain over its facet: where normals of noisy balls jump by 0.25 of it, it gains nothing
TRUSTED = 0.2


@dataclass(frozen=True, eq=False)
class Beside:
    """The faces across the edges of p curved faces.

    row (t,) of each triangle's curved face, -1 where it has none; triangle (p, 3) where the surface
    runs on curved, -1 elsewhere, and its edge (p, 3); is_drawn (p, 3): where it runs on as drawn
    """

    row: Ints
    triangle: Ints
    edge: Ints
    is_drawn: Bools

    @classmethod
    def of(cls, chosen: Ints, n_triangles: int, edges: Edges, is_joined: Bools) -> "Beside":
        """Of the chosen triangles (p,), of n."""
        row = np.full(n_triangles, -1, np.int32)
        row[chosen] = np.arange(len(chosen))
        triangle = np.full((len(chosen), 3), -1, np.int32)
        edge = np.zeros((len(chosen), 3), np.int8)
        is_drawn = np.zeros((len(chosen), 3), bool)
        f, s, i, j = (
            x[is_joined]
            for x in (edges.first, edges.second, edges.corner_first, edges.corner_second)
        )
        both = (row[f] >= 0) & (row[s] >= 0)
        triangle[row[f[both]], i[both]], edge[row[f[both]], i[both]] = s[both], j[both]
        triangle[row[s[both]], j[both]], edge[row[s[both]], j[both]] = f[both], i[both]
        for here, e in ((f, i), (s, j)):
            ends = ~both & (row[here] >= 0)
            is_drawn[row[here[ends]], e[ends]] = True
        return cls(row, triangle, edge, is_drawn)


def agree(own: Floats, at_corners: Floats, area: Floats, beside: Beside) -> tuple[Floats, Floats]:
    """Normals (p, 12, 3) at the nodes that neighbours agree on,
    and about how far they are off, rad, at the first 9.

    On an edge it is the mean of both sides, and a facet's own where it runs on as drawn; inside it
    is the face's own, changed as the edges are. Both sides interpolate the same numbers along an
    edge, so that they agree all along. A wrong height turns the normal by itself over the distance
    to the edge: each side weighs by its area squared. Sides that weigh the same are off by as much
    as they differ; the less one of them weighs the less it matters.

    Parameters
    ----------
    own : (p, 15, 3) of the faces; at_corners : (p, 3, 3) of the vertices; area (p,)
    """
    squared = area**2
    agreed = own[:, :N_NODES].copy()
    jump = np.zeros((len(own), N_ON_EDGES))
    for k in range(0, len(own), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        corners = at_corners[some]
        facets = np.matmul(NODES[:N_ON_EDGES], corners)
        change = np.zeros_like(own[some])
        change[:, N_NODES:] = corners - own[some, N_NODES:]
        for edge in range(3):
            nodes = slice(3 * edge, 3 * edge + 3)
            mine = own[some, nodes]
            found = agreed[some, nodes]
            triangle = beside.triangle[some, edge]
            is_drawn = beside.is_drawn[some, edge]
            other = beside.row[triangle]
            # it runs the other way there
            first = other * len(AT) + 3 * beside.edge[some, edge]
            theirs = taken(own.reshape(-1, 3), first[:, None] + [2, 1, 0])
            both = squared[some] + squared[other]
            my_part = squared[some] / both
            their_part = squared[other] / both
            found[:] = normalise(my_part[:, None, None] * mine + their_part[:, None, None] * theirs)
            jump[some, nodes] = (
                length_of(mine - theirs) * 2 * np.sqrt(my_part * their_part)[:, None]
            )

            alone = np.flatnonzero(triangle < 0)
            found[alone] = mine[alone]
            jump[k + alone, nodes] = 0.0
            found[is_drawn] = facets[is_drawn, nodes]
            change[:, nodes] = found - mine
        # others keep their own normals
        differ = np.flatnonzero(np.abs(change).max(axis=(1, 2)) > AGREE / 10)
        agreed[k + differ, N_ON_EDGES:] += np.matmul(INWARD, change[differ])
    return agreed, jump


def trusted(
    corners: Floats,
    coefficients: Floats,
    at_corners: Floats,
    vertex: Ints,
    agreed: Floats,
    jump: Floats,
) -> Bools:
    """Which curved faces (p,) are nearer to the surface meant than
    their facets, as far as the fit can tell by itself.

    The jump of normals between neighbours is about their error. The gain of a face is the angle by
    which its normals differ from the facet's, and by which its height turns them. Jumps have to be
    small beside gains: around each vertex of the face, on the whole, or around one vertex and in
    the face itself, so that a spoilt face takes few with it.

    Parameters
    ----------
    corners : (p, 3, 3) m; coefficients : (p, 14, 3) m; at_corners : (p,
        3, 3) unit normals of the vertices (p, 3)
    agreed, jump : of `agree`
    """
    away = agreed - normalise(np.matmul(NODES, at_corners))
    turned = np.einsum("nkc,nkc->n", away, away) / N_NODES
    # a ray that meets the face later, by its height, finds it turned by so much more
    height = length_of(np.matmul(AT_NODES, coefficients)).max(axis=1)
    along, turn = (length_of(np.roll(x, -1, axis=1) - x).max(axis=1) for x in (corners, at_corners))
    unsure = (jump**2).mean(axis=1)
    gained = (np.sqrt(turned) + height * turn / along) ** 2

    def is_believed(unsure: Floats, gained: Floats) -> Bools:
        return unsure <= TRUSTED**2 * gained + AGREE**2

    is_fine = is_believed(
        *(np.bincount(vertex.ravel(), np.repeat(x, 3)) for x in (unsure, gained))
    )[vertex]
    return is_fine.all(axis=1) | (is_fine.any(axis=1) & is_believed(unsure, gained))
