"""Agreement of normals across the edges of curved faces, and whether the faces can be trusted."""

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
class AgreementOptions:
    """Thresholds of agreement and trust (docs/decisions/04-automatic-surface.md).

    agree : rad: a smaller difference of normals moves landings by 1e-3 px at most; on fine regular
        meshes they differ by 1e-7 or less
    trusted : largest jump of a face's normals, as a fraction of its gain over the facet. At a jump
        of 0.25 noisy balls and tori gain nothing (`dev.py irregular`)
    scattered : largest distance of coarse faces' vertices from smooth lines, as a fraction of the
        gain. Up to it jumps only show coarse faces, and are harmless up to the gain. Coarse
        ellipsoids and tori have 0.11 or less, a torus of sheared quads 0.14, nine in ten remeshed
        and decimated faces 0.35 or more. At 0.15 a lentil of 8 faces around gets worse
    coarse : jump of a coarse face, as a fraction of the gain, over the square of its turn, rad, or
        of the part of a circle or ellipse its edges span (from the lines). 0.3 to 1.5 on balls and
        tori; 8 by the turn in the shoulder of a bottle, whose lines are smooth as well
    by_lines : largest trusted jump on coarse lines of faces with little turn, as in the flat parts
        of ellipsoids: at 0.8 some of 6 to 12 faces around get worse
    fine : rad: on faces with less turn and smooth lines, jumps may come from the curves themselves:
        between two patches of a Subdivision surface jump and gain shrink alike. A vase of 32 steps
        turns by 0.2 or more: it must not be trusted in one of its walls alone
    smooth : the same distance for the vertices of fine faces. On tori whose noise spoils the gain
        it is 0.1 or more on most faces
    on_smooth : largest trusted jump on such faces: at 0.5 faces next to a bottle's shoulder get
        worse
    """

    agree: float = 1e-6
    trusted: float = 0.2
    scattered: float = 0.14
    coarse: float = 4.0
    by_lines: float = 0.7
    fine: float = 0.15
    smooth: float = 0.06
    on_smooth: float = 0.4


AGREEMENT = AgreementOptions()
LEAST_CHANGE = AGREEMENT.agree / 10  # smaller changes on edges leave the nodes inside unchanged


class Agreed(NamedTuple):
    """Agreed normals (p, 12, 3) at the nodes, and the jump (p, 9), rad, at the nodes on edges: an
    estimate of their error.
    """

    normals: Floats
    jump: Floats


@dataclass(frozen=True, eq=False)
class FaceNeighbours:
    """Neighbours of p curved faces across their edges.

    row : (t,) curved face of each triangle, -1 without one
    triangle, edge : (p, 3) triangle across each edge and its edge there, if it is curved; triangle
        is -1 elsewhere
    is_drawn : (p, 3) the surface continues with a flat face, as drawn
    """

    row: Ints
    triangle: Ints
    edge: Ints
    is_drawn: Bools

    @classmethod
    def of(cls, chosen: Ints, n_triangles: int, edges: Edges, is_joined: Bools) -> "FaceNeighbours":
        """Neighbours of the chosen triangles (p,), out of n."""
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

        for here, e, there, other in ((f, i, s, j), (s, j, f, i)):
            triangle[row[here[both]], e[both]] = there[both]
            edge[row[here[both]], e[both]] = other[both]

        for here, e in ((f, i), (s, j)):
            ends = ~both & (row[here] >= 0)
            is_drawn[row[here[ends]], e[ends]] = True

        return cls(row, triangle, edge, is_drawn)


def agreement_steps(
    own: Floats, at_corners: Floats, area: Floats, neighbours: FaceNeighbours
) -> Steps[Agreed]:
    """Normals shared by neighbours.

    On an edge the normal is the mean of both sides, or the facet's own next to a flat face. Inside,
    the face's own normals follow the changes on its edges. Both sides interpolate the same numbers
    along an edge, and so agree all along it. A wrong height turns the normal in proportion to
    height over distance to the edge, so each side is weighted by its area squared.

    Parameters
    ----------
    own : (p, 15, 3) normals of the faces; at_corners : (p, 3, 3) of the vertices; area : (p,) m^2
    """
    if loading.library() is not None:
        found = Agreed(np.empty((len(own), N_NODES, 3)), np.empty((len(own), N_ON_EDGES)))
        weights = NODES[:N_ON_EDGES], INWARD
        across = neighbours.row, neighbours.triangle, neighbours.edge, neighbours.is_drawn
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
            triangle = neighbours.triangle[some, edge]
            is_drawn = neighbours.is_drawn[some, edge]

            other = neighbours.row[triangle]
            # the edge runs the other way there
            first = other * len(AT) + 3 * neighbours.edge[some, edge]
            theirs = take(own.reshape(-1, 3), first[:, None] + [2, 1, 0])

            # mean, weighted by area squared
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

        # faces with smaller changes keep their own normals inside
        differ = np.flatnonzero(np.abs(change).max(axis=(1, 2)) > LEAST_CHANGE)
        agreed[k + differ, N_ON_EDGES:] += np.matmul(INWARD, change[differ])
        yield 0

    return Agreed(agreed, jump)


class ErrorEstimate(NamedTuple):
    """Error and gain of curved faces (p,) over their facets, rad squared.

    error : error of the face's normals, from their jumps
    gain : error of the facet's normals
    drawn_gain : the same for normals interpolated from the given ones
    turn : rad, between the normals at the corners
    """

    error: Floats
    gain: Floats
    drawn_gain: Floats
    turn: Floats

    @property
    def is_coarse(self) -> Bools:
        """Faces whose turn may explain their jumps."""
        return AGREEMENT.coarse * self.turn**2 > AGREEMENT.trusted

    def at(self, which: Ints) -> "ErrorEstimate":
        return ErrorEstimate(*(x[which] for x in self))

    def on_lines(self, scatter: Floats, phase: Floats) -> "ErrorEstimate":
        """The same for corners off smooth lines by scatter (p, 3), on lines with phase (p, 3), rad
        squared, from vertex to vertex.
        """
        by_turn = AGREEMENT.coarse * self.turn**2
        by_lines = np.minimum(AGREEMENT.coarse * phase.mean(axis=1), AGREEMENT.by_lines)
        part = np.minimum(np.maximum(by_turn, by_lines), 1.0)
        return self._limited(scatter, AGREEMENT.scattered, np.maximum(part, AGREEMENT.trusted))

    def on_smooth_lines(self, scatter: Floats) -> "ErrorEstimate":
        """The same for fine faces with corners off smooth lines by scatter (p, 3)."""
        part = np.where(self.turn < AGREEMENT.fine, AGREEMENT.on_smooth, AGREEMENT.trusted)
        return self._limited(scatter, AGREEMENT.smooth, part)

    def _limited(self, scatter: Floats, scattered: float, part: Floats) -> "ErrorEstimate":
        """The same, with scatter and jumps accepted up to these fractions of the gain."""
        # rescaled so the accepted limit of each equals `trusted`
        by_scatter = (scatter**2).mean(axis=1) * (AGREEMENT.trusted / scattered) ** 2
        by_jump = self.error * (AGREEMENT.trusted / part) ** 2
        return self._replace(error=np.minimum(self.error, np.maximum(by_scatter, by_jump)))

    def trusted(self, vertex: Ints) -> Bools:
        """Mask of faces, with vertices (p, 3), closer to the intended surface than their facets.

        The error must be small against the gain: summed around each vertex of the face, or around
        one vertex and in the face itself. A spoilt face then rejects few others.
        """

        def is_believed(error: Floats, gain: Floats) -> Bools:
            return error <= AGREEMENT.trusted**2 * gain + AGREEMENT.agree**2

        both = self.error, self.gain
        is_fine = is_believed(*(np.bincount(vertex.ravel(), np.repeat(x, 3)) for x in both))[vertex]
        return is_fine.all(axis=1) | (is_fine.any(axis=1) & is_believed(*both))


def trial_steps(
    corners: Floats, coefficients: Floats, at_corners: Floats, given: Floats, agreed: Agreed
) -> Steps[ErrorEstimate]:
    """Estimated error and gain of curved faces, from the fit alone.

    The jump of normals between neighbours estimates their error. The gain of a face is the angle
    between its normals and the facet's, plus the turn caused by its height. The facet's normals
    interpolate the given ones, which are off where faces around a vertex are uneven.

    Parameters
    ----------
    corners : (p, 3, 3) m; coefficients : (p, 14, 3) m; at_corners : (p, 3, 3) unit normals, and
        given : (p, 3, 3) those of the facets
    agreed : normals shared by neighbours
    """
    gain, drawn_gain, turn = np.empty((3, len(corners)))
    for k in range(0, len(corners), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        ends = corners[some], at_corners[some]
        turned, turned_as_drawn = (
            np.einsum("nkc,nkc->n", away, away) / N_NODES
            for normals in (ends[1], given[some])
            for away in [agreed.normals[some] - normalise(np.matmul(NODES, normals))]
        )

        # a ray meets the face later, by its height, and finds it turned by this much more
        height = length_of(np.matmul(AT_NODES, coefficients[some])).max(axis=1)
        along, turn[some] = (length_of(np.roll(x, -1, axis=1) - x).max(axis=1) for x in ends)
        by_height = height * turn[some] / along
        gain[some] = (np.sqrt(turned) + by_height) ** 2
        drawn_gain[some] = turned_as_drawn + by_height**2
        yield 0

    return ErrorEstimate((agreed.jump**2).mean(axis=1), gain, drawn_gain, turn)
