"""Fit of the intended surface of a smooth-shaded mesh: a curved face over each smooth triangle.

Around each vertex a quartic height field over its tangent plane is fitted to the positions and
normals of its neighbours, exact in place and slope at the vertex. The fields of a triangle's three
corners, blended, are sampled at the nodes of a quartic triangle: 12 offsets from the facet. On an
edge only the fields of its two ends count, so neighbours meet without a crack. Edges to flat faces,
and sharp ones, stay straight.

If the mesh only has means of face normals, normals are fitted to its vertices first.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, greatest, take
from ..base.products import solve_symmetric
from ..base.steps import Steps
from ..base.vectors import dot, length_of, normalise
from ..native import loading
from .agreement import AGREEMENT, Agreed, FaceNeighbours, agreement_steps, trial_steps
from .curved import CurvedFaces
from .fitted_faces import (
    RIDGE,
    STIFFER,
    Faces,
    Fields,
    field_steps,
    fit_faces,
    gradients,
    match_edges,
    system,
    tangent_planes,
)
from .meshes import Edges, areas_of, components
from .quartics import AT_NODES, FROM_NODES, N_ON_EDGES, N_TERMS, NODES, by_term
from .subdivided import ExactLimit, exact_limit_steps
from .trust import FlatParts, blend_faces, trust_steps
from .vertices import Vertices, find_vertices, with_second_ring


@dataclass(frozen=True)
class NormalOptions:
    """Fit of normals to vertices, and limits for their use (docs/decisions/02-curved-faces.md).

    Tuned by `dev.py irregular` on uneven, noisy, decimated and bevelled meshes: with vertices on
    the surface, chords contradict found normals by 0.001 of the turn and less.

    Parameters
    ----------
    sweeps, settled : largest number, even, and the change of normals that ends them
    restless : fraction of the turn to a neighbour: normals that change more in the last sweep do
        not settle
    moved : fraction of the turn: normals further from the mean have to prove themselves
    straight : fraction of the turn: largest contradiction by chords to neighbours; noise and rims
        add to it
    gentle : rad, to a neighbour: sharper turns are not refitted with stiffer fields, which omit too
        much there: coarse balls, tori and ellipsoids get worse
    bulge : rad: edges with less turn cannot bulge enough to matter
    jump : a curvature grown by this factor from one edge to the next, across a vertex, ...
    shorter : ... on an edge shorter by this factor, means normals of a bevel, not of the face next
        to it
    straight_on : cosine between an edge and its continuation
    """

    sweeps: int = 40
    settled: float = 1e-10
    restless: float = 0.01
    moved: float = 0.2
    straight: float = 0.1
    gentle: float = 0.7
    bulge: float = np.radians(4)
    jump: float = 5.0
    shorter: float = 3.0
    straight_on: float = -0.7


NORMALS = NormalOptions()


def normal_steps(v: Vertices, wanted: Bools, exact: Floats) -> Steps[Floats]:
    """Normals (f, 3) of the surface through the vertices, if the given ones are only means.

    exact : (f, 3) normals found elsewhere, NaN without one

    The slope at a vertex follows from the heights and slopes of its neighbours (a compact scheme:
    fourth order from one ring). Sweeps make slopes agree with neighbours' slopes; each at least
    halves the error. On uneven neighbours the error may grow: these slopes are refitted with
    stiffer fields, while accepted ones are held. At a rim, where the mean is of the last faces
    alone, slopes follow from two rings of neighbours: third order.
    """
    is_held = ~np.isnan(exact[:, 0])
    is_left = wanted & ~is_held
    normal = np.where(is_held[:, None], exact, v.normal)
    across = with_second_ring(v)
    fields = tangent_planes(across)
    turn = _turns(v, v.normal)

    for ridge in (RIDGE, STIFFER):
        found = normal.copy()
        change = yield from _settle_normal_steps(across, fields, ridge, is_left, found)
        yield 0
        is_near, is_straight = _are_near(v, fields.is_rim, turn, found, change)
        if ridge is STIFFER:  # these settle near the mean, whatever chords say
            is_near &= is_straight
        is_near |= is_held

        # normals are found together: one far from the mean is only as good as its worst neighbour
        is_refused = ~(is_near | is_straight)
        has_refused = np.bincount(v.start, is_refused[v.end], len(v.at)) > 0
        is_believed = is_near | (is_straight & ~has_refused)

        # on a mesh too irregular for a fit the mean is the better guess
        normal = np.where(is_believed[:, None], found, v.normal)
        is_held |= wanted & is_believed
        is_left &= ~is_believed & (turn < NORMALS.gentle)
        if not is_left.any():
            break

    return normal


def _turns(v: Vertices, normal: Floats) -> Floats:
    """Largest turn (f,), rad, from normals (f, 3) to a neighbour's."""
    turn = length_of(take(normal, v.end) - take(normal, v.start))
    return np.maximum.reduceat(turn, v.first[:-1])


def _are_near(
    v: Vertices, is_rim: Bools, turn: Floats, normal: Floats, change: Floats
) -> tuple[Bools, Bools]:
    """Masks of normals (f, 3) near the means, and of normals consistent with the chords.

    change : (f, 3) in the last sweep
    turn : (f,) rad, from a mean to its neighbours
    is_rim : (f,) vertices whose means are half a face away
    """
    turn = np.where(is_rim, _turns(v, normal), turn)
    with np.errstate(invalid="ignore"):
        moved = length_of(normal - v.normal)
        is_settled = length_of(change) <= NORMALS.restless * turn
        is_near = is_settled & (moved <= NORMALS.moved * turn)
        is_straight = is_settled & (_bend(v, normal) < NORMALS.straight * turn)

    return is_near, is_straight


def _bend(v: Vertices, normal: Floats) -> Floats:
    """Contradiction (f,), rad rms, between chords to neighbours and the normals (f, 3) at their
    ends.

    On a parabola the slope of a chord is the mean of the slopes at its ends.
    """
    chord = normalise(take(v.at, v.end) - take(v.at, v.start))
    unlike = dot(take(normal, v.end) + take(normal, v.start), chord) / 2
    return np.sqrt(np.bincount(v.start, unlike**2, len(v.at)) / np.maximum(np.diff(v.first), 1))


def _settle_normal_steps(
    v: Vertices, fields: Fields, ridge: Floats, wanted: Bools, normal: Floats
) -> Steps[Floats]:
    """Make the wanted ones of normals (f, 3) agree with their neighbours', with pauses.

    Returns their change (f, 3) in the last sweep.
    """
    if loading.library() is not None:
        fit = fields.kernel_fit(v)
        return (
            yield from fit.settle_normal_steps(
                wanted, ridge, normal, NORMALS.sweeps, NORMALS.settled
            )
        )

    before = normal
    solvers = []
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = system(v, fields, some, pairs, ridge)
        weighted = rows * weights[..., None]

        slope = np.zeros((len(some), N_TERMS, 2))
        slope[:, [0, 1], [0, 1]] = 1.0

        # rows of the pseudo-inverse for the slope; the matrix is symmetric
        inverse = np.matmul(weighted, solve_symmetric(matrix, slope))

        m = pairs.shape[1]
        solvers.append((some, pairs, np.einsum("nrk,nr->nk", inverse[:, :m], z), inverse[:, m:]))
        yield 0

    for _ in range(NORMALS.sweeps):
        change = 0.0
        before = normal.copy()

        for some, pairs, from_heights, from_slopes in solvers:
            theirs = np.concatenate(gradients(v, fields, some, pairs, before), axis=1)
            slope = from_heights + np.einsum("nrk,nr->nk", from_slopes, theirs)
            found = (
                v.normal[some]
                - slope[:, :1] * fields.axis_x[some]
                - slope[:, 1:] * fields.axis_y[some]
            )
            found = normalise(found)
            change = max(change, float(np.abs(found - before[some]).max(initial=0.0)))
            normal[some] = found
            yield 0

        if change < NORMALS.settled:
            break

    return normal - before


def contradicted(v: Vertices, normal: Floats, wanted: Bools) -> Bools:
    """Pairs (p,) with normals that turn as on a bevel, on the large face next to it.

    Curvature changes little from an edge to its continuation. If it jumps up on a much shorter
    edge, the normal between them belongs to the short edge.
    """
    away = take(v.at, v.end) - take(v.at, v.start)
    length = length_of(away)
    direction = away / np.maximum(length, 1e-300)[:, None]
    turn = np.abs(dot(take(normal, v.end) - take(normal, v.start), direction))

    is_bad = np.zeros(len(v.start), bool)
    suspect = wanted & (np.bincount(v.start, turn > NORMALS.bulge, len(v.at)) > 0)
    for _, pairs in v.by_valence(suspect):
        facing = np.einsum("nic,njc->nij", direction[pairs], direction[pairs])
        continuation = np.take_along_axis(
            pairs, facing.argmin(axis=2), axis=1
        )  # the pair straight on
        is_bad[pairs] = (
            (facing.min(axis=2) < NORMALS.straight_on)
            & (turn[pairs] > NORMALS.bulge)
            & (length[pairs] > NORMALS.shorter * length[continuation])
            & (
                turn[continuation] * length[pairs]
                > NORMALS.jump * turn[pairs] * length[continuation]
            )
        )

    return is_bad


@dataclass(frozen=True)
class FitOptions:
    """Smooth triangles that become curved faces (docs/decisions/02-curved-faces.md).

    Tuned by `dev.py irregular` and `dev.py bench`, against closed forms.

    least_cosine : between corner normals and the facet's, 40 degrees: beyond it they contradict it
    coplanar : rad: facets with less turn are parts of one flat face
    """

    least_cosine: float = np.cos(np.radians(40))
    coplanar: float = 1e-4


FIT = FitOptions()


@dataclass(frozen=True, eq=False)
class Drawn:
    """Mesh as drawn.

    vertices, triangles : (v, 3) m, (t, 3)
    corner_normals : (t, 3, 3) unit; a flat triangle repeats its own three times
    facets : (t, 3) unit normals of the triangles
    edges : of the triangles
    is_joined : (e,) the corner normals agree at both ends
    polygon : (t,) polygon of each triangle; None if each is one of its own
    """

    vertices: Floats
    triangles: Ints
    corner_normals: Floats
    facets: Floats
    edges: Edges
    is_joined: Bools
    polygon: Ints | None


def make_curved(
    drawn: Drawn, wanted: Bools, has_mean_normals: bool, is_automatic: bool = False
) -> Steps[tuple[CurvedFaces | None, int]]:
    """Curved faces over the wanted triangles with consistent normals, and the number of doubted
    ones.

    Parameters
    ----------
    wanted : (t,) smooth triangles
    has_mean_normals : normals are means of the faces around: the surface's own are found from the
        vertices
    is_automatic : faces no closer to the intended surface than the facets are doubted, and left
        flat
    """
    # the surface does not continue across an edge with both sides running the same way
    edges = drawn.edges
    drawn = replace(drawn, is_joined=drawn.is_joined & ~edges.is_same_way)
    is_joined = drawn.is_joined
    n_triangles = len(drawn.triangles)

    corners = take(drawn.vertices, drawn.triangles)
    requested = wanted
    found = yield from _find_normals(drawn, wanted, has_mean_normals)
    v = found.v

    wanted, flat_face = _in_agreement(found, drawn, requested)
    yield 0
    size, faces, is_whole = yield from _fit(found, drawn, corners, wanted)

    if not is_automatic:  # Automatic judges swollen faces together with their neighbours
        is_whole &= ~np.isin(flat_face[faces.chosen], flat_face[faces.chosen[faces.is_swollen]])

    if not is_whole.all():
        faces = faces.at(is_whole)
        yield 0

    neighbours = FaceNeighbours.of(faces.chosen, n_triangles, edges, is_joined)
    yield 0

    # normals that agree at the edges, and trust in the faces
    area = areas_of(corners)
    at_corners = take(v.normal, v.of_corner[faces.chosen])
    agreed = yield from agreement_steps(faces.intended, at_corners, area[faces.chosen], neighbours)
    yield 0
    n_doubted = 0

    if is_automatic:
        at, given = take(corners, faces.chosen), take(found.given, v.of_corner[faces.chosen])
        estimate = yield from trial_steps(at, faces.coefficients, at_corners, given, agreed)
        yield 0
        is_exact = np.zeros(n_triangles, bool) if found.limit is None else found.limit.is_face
        parts = FlatParts(flat_face, is_exact[faces.chosen])
        trusted = yield from trust_steps(v, size, faces, estimate, parts)
        if not (trusted.is_curved.all() and (trusted.weight == 1).all()):
            n_doubted = int((~trusted.is_curved).sum())
            v, faces = blend_faces(v, faces.at(trusted.is_curved), found.given, trusted.weight)
            neighbours = FaceNeighbours.of(faces.chosen, n_triangles, edges, is_joined)

    if not len(faces.chosen):
        return None, n_doubted

    # flat faces keep the given normals: so do the curved faces around their vertices
    normal = _with_given(v, found.given, neighbours.row < 0)
    vertex = v.of_corner[faces.chosen]

    if len(faces.chosen) < n_triangles:
        yield 0
        agreed = yield from agreement_steps(
            faces.intended, take(normal, vertex), area[faces.chosen], neighbours
        )

    yield 0
    return _put_together(corners, vertex, normal, faces, agreed, neighbours), n_doubted


class _FittedNormals(NamedTuple):
    """Vertices of a mesh with the intended normals.

    given : (f, 3) normals before the fit
    wanted : (t,) triangles still to be curved
    is_used : (f,) vertices at the corners of triangles wanted before
    limit : the exact limit surface, if any
    """

    v: Vertices
    given: Floats
    wanted: Bools
    is_used: Bools
    limit: ExactLimit | None


def _find_normals(drawn: Drawn, wanted: Bools, has_mean_normals: bool) -> Steps[_FittedNormals]:
    """Vertices, with fitted normals if the given ones are means; `wanted` are the triangles they
    fit.
    """
    requested = wanted
    least = np.einsum("tij,tj->ti", drawn.corner_normals, drawn.facets).min(axis=1)
    wanted = wanted & (least > FIT.least_cosine)
    v = find_vertices(
        drawn.vertices,
        drawn.triangles,
        drawn.corner_normals,
        least > 0,
        drawn.edges,
        drawn.is_joined,
    )
    given = v.normal
    is_used = _are_corners(v, wanted)
    yield 0

    limit = None
    if has_mean_normals:
        if drawn.polygon is not None:
            limit = yield from exact_limit_steps(v, drawn.edges, drawn.polygon, requested)
        exact = np.full_like(given, np.nan) if limit is None else limit.normal
        v = replace(v, normal=(yield from normal_steps(v, is_used, exact)))
        yield 0
        cosine = np.einsum("tij,tj->ti", take(v.normal, v.of_corner), drawn.facets)
        wanted &= (cosine > FIT.least_cosine).all(axis=1)
        if limit is not None:
            wanted |= requested & limit.is_face

    yield 0
    return _FittedNormals(v, given, wanted, is_used, limit)


def _fit(
    found: _FittedNormals, drawn: Drawn, corners: Floats, wanted: Bools
) -> Steps[tuple[Floats, Faces, Bools]]:
    """Sizes (f,) of vertices' fields, faces over wanted triangles (t,), and a mask of faces near
    their facets.

    corners : (t, 3, 3) m, of all triangles
    """
    v, limit = found.v, found.limit
    chosen = np.flatnonzero(wanted)
    if limit is None:
        fields = yield from field_steps(v, _are_corners(v, wanted))
        return fields.size, *(yield from fit_faces(v, fields, corners, drawn.facets, chosen, None))

    fields = yield from field_steps(v, _are_corners(v, wanted & ~limit.is_face))
    faces, is_whole = yield from fit_faces(v, fields, corners, drawn.facets, chosen, limit)
    joined = drawn.edges.at(drawn.is_joined)
    is_whole &= match_edges(faces, limit, joined, corners, drawn.facets)
    yield 0
    return fields.size, faces, is_whole


def _are_corners(v: Vertices, wanted: Bools) -> Bools:
    """Mask of vertices at corners of wanted triangles (t,)."""
    is_used = np.zeros(len(v.at), bool)
    is_used[v.of_corner[wanted]] = True
    return is_used


def _with_given(v: Vertices, given: Floats, is_drawn: Bools) -> Floats:
    """Normals (f, 3) of vertices: the given ones at drawn triangles (t,), the fitted ones
    elsewhere.
    """
    return np.where(_are_corners(v, is_drawn)[:, None], given, v.normal)


def _in_agreement(found: _FittedNormals, drawn: Drawn, requested: Bools) -> tuple[Bools, Ints]:
    """Mask of wanted triangles (t,) with normals that fit their shape, and the flat face (t,) of
    each.

    requested : (t,) triangles wanted at first
    """
    v, wanted = found.v, found.wanted

    is_bad = contradicted(v, v.normal, found.is_used)
    if is_bad.any():
        n = len(v.at)
        start = v.start[is_bad]
        end = v.end[is_bad]
        bad = np.concatenate([start * n + end, end * n + start])
        along = v.of_corner * n + np.roll(v.of_corner, -1, axis=1)
        is_bad = np.isin(along, bad).any(axis=1)
        if found.limit is not None:
            is_bad &= ~found.limit.is_face
        wanted = wanted & ~is_bad

    # a flat face is curved as a whole or not at all
    first, second = drawn.edges.first, drawn.edges.second
    turn = greatest(np.abs(take(drawn.facets, first) - take(drawn.facets, second)))
    is_flat = drawn.is_joined & (turn < FIT.coplanar)
    flat_face = components(len(wanted), first[is_flat], second[is_flat])
    wanted = wanted & ~np.isin(flat_face, flat_face[requested & ~wanted])

    # and stays flat if nothing around it is curved
    among = drawn.is_joined & ~is_flat & wanted[first] & wanted[second]
    curved = flat_face[np.concatenate([first[among], second[among]])]
    return wanted & np.isin(flat_face, curved), flat_face


def _put_together(
    corners: Floats,
    vertex: Ints,
    normal: Floats,
    faces: Faces,
    agreed: Agreed,
    neighbours: FaceNeighbours,
) -> CurvedFaces:
    """Curved faces, with straight edges and terms of their normals where needed."""
    # faces with straight edges, and their coefficients without
    coefficients = faces.coefficients
    is_straight = neighbours.triangle < 0
    held = np.flatnonzero(is_straight.any(axis=1))
    bent_row = np.full(len(vertex), -1, np.int32)
    bent_row[held] = np.arange(len(held))
    bent = coefficients[held]
    offsets = np.matmul(AT_NODES, bent)
    offsets[:, :N_ON_EDGES] *= ~np.repeat(is_straight[held], 3, axis=1)[..., None]
    coefficients[held] = np.matmul(FROM_NODES, offsets)

    # terms of normals other than the faces' own
    at_corners = take(normal, vertex)
    intended = agreed.normals, at_corners
    own = np.split(faces.own, [agreed.normals.shape[1]], axis=1)
    off = np.maximum(*(greatest(length_of(a - b)) for a, b in zip(intended, own, strict=True)))
    with_terms = np.flatnonzero(is_straight.any(axis=1) | (off > AGREEMENT.agree))
    normal_row = np.full(len(vertex), -1, np.int32)
    normal_row[with_terms] = np.arange(len(with_terms))
    interpolated = np.matmul(NODES, at_corners[with_terms])
    normal_terms = np.matmul(FROM_NODES, agreed.normals[with_terms] - interpolated)

    return CurvedFaces(
        corners=corners,
        row=neighbours.row,
        coefficients=by_term(coefficients),
        neighbour=neighbours.triangle,
        neighbour_edge=neighbours.edge,
        vertex=vertex,
        vertex_normal=normal,
        normal_row=normal_row,
        normal_terms=by_term(normal_terms),
        bent_row=bent_row,
        bent=bent,
    )
