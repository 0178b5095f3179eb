"""Normals that agree where curved faces meet, and whether the faces are to be trusted."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.steps import Steps
from ..base.vectors import length_of, normalise
from ..native import loading
from . import native_fit
from .curved import FACES_AT_ONCE
from .meshes import Edges
from .quartics import AT, AT_NODES, INWARD, N_NODES, N_ON_EDGES, NODES


@dataclass(frozen=True)
class AgreementKnobs:
    """When normals of neighbours agree, and faces are trusted for it (design.md, decision 3).

    agree : rad: normals that differ by less move landings by 1e-3 px; those of fine regular meshes
        do, by 1e-7 and less
    trusted : part of a face's gain over its facet that its normals may jump by. Tuned by
        `dev.py irregular` on noisy balls and tori: where normals jump by 0.25 of it, it gains
        nothing
    scattered : part of it by which the vertices of coarse faces may lie off smooth lines: there
        jumps only tell that faces are coarse, and do no harm up to the gain. On coarse ellipsoids
        and tori it is 0.11 and less, 0.14 on a torus whose quads are sheared, on nine in ten faces
        of remeshed and decimated ones 0.35 and more; at 0.15 a lentil of 8 faces around gets worse
    coarse : jumps of coarse faces, in parts of the gain, over the square of the turn, or of the
        part of a circle or an ellipse that an edge spans, rad, as lines tell it: on balls and tori
        0.3 to 1.5, and 8 by the turn in the shoulder of a bottle, whose lines are smooth as well
    by_lines : jumps that are trusted at most where lines are coarse and faces turn little, as in
        the flat parts of ellipsoids: at 0.8 and more single ones of 6 to 12 faces get worse
    fine : rad: where faces turn by less, and lines run on smoothly, jumps may come of the curves
        that these are made of: where two of Subdivision's meet, jump and gain fall alike. Those of
        a vase of 32 steps, 0.2 and more, must not be trusted in one of its walls alone
    smooth : part of the gain by which the vertices of fine faces may lie off such lines. On tori
        whose noise spoils the gain it is 0.1 and more on most faces
    on_smooth : jumps that are trusted on them: at 0.5 faces beside a bottle's shoulder get worse
    """

    agree: float = 1e-6
    trusted: float = 0.2
    scattered: float = 0.14
    coarse: float = 4.0
    by_lines: float = 0.7
    fine: float = 0.15
    smooth: float = 0.06
    on_smooth: float = 0.4


AGREEMENT = AgreementKnobs()
LEAST_CHANGE = AGREEMENT.agree / 10  # of normals on edges: less changes none inside


class Agreed(NamedTuple):
    """Normals (p, 12, 3) at the nodes that neighbours agree on,
    and about how far they are off, jump (p, 9), rad, at the nodes on edges.
    """

    normals: Floats
    jump: Floats


@dataclass(frozen=True, eq=False)
class FaceNeighbours:
    """The faces across the edges of p curved faces.

    row (t,) of each triangle's curved face, -1 where it has none; triangle (p, 3) where the surface
    runs on curved, -1 elsewhere, and its edge (p, 3); is_drawn (p, 3): where it runs on as drawn
    """

    row: Ints
    triangle: Ints
    edge: Ints
    is_drawn: Bools

    @classmethod
    def of(cls, chosen: Ints, n_triangles: int, edges: Edges, is_joined: Bools) -> "FaceNeighbours":
        """Of the chosen triangles (p,), of n."""
        row = np.full(n_triangles, -1, np.int32)
        row[chosen] = np.arange(len(chosen))
        triangle = np.full((len(chosen), 3), -1, np.int32)
        edge = np.zeros((len(chosen), 3), np.int8)
        is_drawn = np.zeros((len(chosen), 3), bool)

        # both sides of each joined edge
        f, s, i, j = (
            x[is_joined]
            for x in (edges.first, edges.second, edges.corner_first, edges.corner_second)
        )
        both = (row[f] >= 0) & (row[s] >= 0)

        for here, e, there, other in ((f, i, s, j), (s, j, f, i)):
            triangle[row[here[both]], e[both]] = there[both]
            edge[row[here[both]], e[both]] = other[both]

        for here, e in ((f, i), (s, j)):
            ends = ~both & (row[here] >= 0)
            is_drawn[row[here[ends]], e[ends]] = True

        return cls(row, triangle, edge, is_drawn)


def agreeing(
    own: Floats, at_corners: Floats, area: Floats, beside: FaceNeighbours
) -> Steps[Agreed]:
    """Normals that neighbours agree on.

    On an edge it is the mean of both sides, and a facet's own where it runs on as drawn; inside it
    is the face's own, changed as the edges are. Both sides interpolate the same numbers along an
    edge, so that they agree all along. A wrong height turns the normal by itself over the distance
    to the edge: each side weighs by its area squared. Sides that weigh the same are off by as much
    as they differ; the less one of them weighs the less it matters.

    Parameters
    ----------
    own : (p, 15, 3) of the faces; at_corners : (p, 3, 3) of the vertices; area (p,)
    """
    if loading.library() is not None:
        found = Agreed(np.empty((len(own), N_NODES, 3)), np.empty((len(own), N_ON_EDGES)))
        weights = NODES[:N_ON_EDGES], INWARD
        across = beside.row, beside.triangle, beside.edge, beside.is_drawn
        for k in range(0, len(own), FACES_AT_ONCE):
            some = slice(k, k + FACES_AT_ONCE)
            native_fit.agree((own, at_corners, area), across, weights, LEAST_CHANGE, some, found)
            yield 0
        return found

    squared = area**2
    agreed = own[:, :N_NODES].copy()
    jump = np.zeros((len(own), N_ON_EDGES))

    for k in range(0, len(own), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        corners = at_corners[some]
        change = np.zeros_like(own[some])
        change[:, N_NODES:] = corners - own[some, N_NODES:]

        for edge in range(3):
            nodes = slice(3 * edge, 3 * edge + 3)
            mine = own[some, nodes]
            found = agreed[some, nodes]
            triangle = beside.triangle[some, edge]
            is_drawn = beside.is_drawn[some, edge]

            # the face across the edge, whose area counts, too
            other = beside.row[triangle]
            # it runs the other way there
            first = other * len(AT) + 3 * beside.edge[some, edge]
            theirs = take(own.reshape(-1, 3), first[:, None] + [2, 1, 0])

            # a mean, in which each weighs by its area squared
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
            facets = np.matmul(NODES[:N_ON_EDGES], corners[is_drawn])
            found[is_drawn] = facets[:, nodes]
            change[:, nodes] = found - mine

        # others keep their own normals
        differ = np.flatnonzero(np.abs(change).max(axis=(1, 2)) > LEAST_CHANGE)
        agreed[k + differ, N_ON_EDGES:] += np.matmul(INWARD, change[differ])
        yield 0

    return Agreed(agreed, jump)


class Trial(NamedTuple):
    """What curved faces (p,) stand to lose and to gain over their facets, rad squared.

    unsure : by how much their normals may be wrong; gained : by how much those of the facet are,
        apart : or would be between the given ones; turn : rad, by how much the normals at their
        corners differ
    """

    unsure: Floats
    gained: Floats
    apart: Floats
    turn: Floats

    @property
    def is_coarse(self) -> Bools:
        """Faces that turn so far that their jumps may come of it alone."""
        return AGREEMENT.coarse * self.turn**2 > AGREEMENT.trusted

    def at(self, which: Ints) -> "Trial":
        return Trial(*(x[which] for x in self))

    def on_lines(self, scatter: Floats, phase: Floats) -> "Trial":
        """The same where the vertices at their corners lie off smooth lines by scatter (p, 3), and
        lines go on by phase (p, 3), rad squared, from vertex to vertex.
        """
        by_turn = AGREEMENT.coarse * self.turn**2
        by_lines = np.minimum(AGREEMENT.coarse * phase.mean(axis=1), AGREEMENT.by_lines)
        part = np.minimum(np.maximum(by_turn, by_lines), 1.0)
        return self._trusting(scatter, AGREEMENT.scattered, np.maximum(part, AGREEMENT.trusted))

    def on_smooth_lines(self, scatter: Floats) -> "Trial":
        """The same where the vertices at the corners of fine faces lie off smooth lines by scatter
        (p, 3).
        """
        part = np.where(self.turn < AGREEMENT.fine, AGREEMENT.on_smooth, AGREEMENT.trusted)
        return self._trusting(scatter, AGREEMENT.smooth, part)

    def _trusting(self, scatter: Floats, scattered: float, part: Floats) -> "Trial":
        """The same where scatter and jumps are believed up to so much of the gain."""
        # in a scale on which as much as may be believed of each is what is trusted
        by_scatter = (scatter**2).mean(axis=1) * (AGREEMENT.trusted / scattered) ** 2
        by_jump = self.unsure * (AGREEMENT.trusted / part) ** 2
        return self._replace(unsure=np.minimum(self.unsure, np.maximum(by_scatter, by_jump)))

    def trusted(self, vertex: Ints) -> Bools:
        """Which faces, of vertices (p, 3), are nearer to the surface meant than their facets.

        What is unsure has to be small beside the gain: around each vertex of the face, on the
        whole, or around one vertex and in the face itself, so that a spoilt face takes few with it.
        """

        def is_believed(unsure: Floats, gained: Floats) -> Bools:
            return unsure <= AGREEMENT.trusted**2 * gained + AGREEMENT.agree**2

        both = self.unsure, self.gained
        is_fine = is_believed(*(np.bincount(vertex.ravel(), np.repeat(x, 3)) for x in both))[vertex]
        return is_fine.all(axis=1) | (is_fine.any(axis=1) & is_believed(*both))


def on_trial(
    corners: Floats, coefficients: Floats, at_corners: Floats, given: Floats, agreed: Agreed
) -> Steps[Trial]:
    """Curved faces on trial, as far as the fit can tell by itself.

    The jump of normals between neighbours is about their error. The gain of a face is the angle by
    which its normals differ from the facet's, and by which its height turns them. As drawn it has
    what is between the given ones, which are off where faces around a vertex are uneven.

    Parameters
    ----------
    corners : (p, 3, 3) m; coefficients : (p, 14, 3) m; at_corners : (p, 3, 3) unit normals, and
        given (p, 3, 3) those of the facets
    agreed : normals that neighbours agree on
    """
    gained, apart, turn = np.empty((3, len(corners)))
    for k in range(0, len(corners), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        ends = corners[some], at_corners[some]
        turned, turned_as_drawn = (
            np.einsum("nkc,nkc->n", away, away) / N_NODES
            for normals in (ends[1], given[some])
            for away in [agreed.normals[some] - normalise(np.matmul(NODES, normals))]
        )

        # a ray that meets the face later, by its height, finds it turned by so much more
        height = length_of(np.matmul(AT_NODES, coefficients[some])).max(axis=1)
        along, turn[some] = (length_of(np.roll(x, -1, axis=1) - x).max(axis=1) for x in ends)
        by_height = height * turn[some] / along
        gained[some] = (np.sqrt(turned) + by_height) ** 2
        apart[some] = turned_as_drawn + by_height**2
        yield 0

    return Trial((agreed.jump**2).mean(axis=1), gained, apart, turn)
