"""The surface that was meant by a smooth-shaded mesh: a curved face over each smooth triangle.

Around each vertex a quartic height field over its tangent plane is fitted to the positions and
normals of its neighbours, with place and slope exact at the vertex. The fields of a triangle's
three corners, blended, are sampled at the nodes of a quartic triangle: 12 offsets from the facet.
On an edge only the fields of its two ends count, so that neighbours meet without a crack. Edges to
flat faces, and sharp ones, stay straight.
"""

from dataclasses import dataclass, replace

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints, taken
from ..products import combine
from ..steps import Pauses
from ..vectors import dot, length_of, normalise
from .agreement import AGREE, Beside, agree, trusted
from .curved import FACES_AT_ONCE, MOST_OFFSET, CurvedFaces
from .meshes import Edges, areas_of, components
from .quartics import (
    AT,
    AT_NODES,
    FROM_NODES,
    N_NODES,
    N_ON_EDGES,
    N_TERMS,
    NODES,
    by_term,
    cross,
    product,
    slopes,
    value,
)
from .vertex_fields import Fields, fit_fields
from .vertex_normals import contradicted, find_normals
from .vertices import Vertices, find_vertices

STEEPEST = np.cos(np.radians(40))  # corner normals further than this from the facet's contradict it
STEEPEST_INSIDE = np.cos(np.radians(60))  # so do normals of the curved face
# of a fixed point, each of which gains two orders: as many for all, or neighbours would not meet
STEPS = 2
# times the sag of an arc that turns as the normals do: a face beyond it follows a bevel beside it
SWOLLEN = 3.0
UNTOLD = 0.01  # of an edge: so far faces may stand out besides, whose edges turn one way and back
COPLANAR = 1e-4  # radians: facets that turn by less are one flat face in parts


def _node_offsets(v: Vertices, fields: Fields, corner: Ints) -> Floats:
    """Offsets (12, 3, n) of the nodes of triangles with
    corners (n, 3), from the facet to the blended fields.

    All fields are met along one direction, blended from the corners' normals: met along different
    ones they would differ sideways by the third power of the edge, which costs an order.
    """
    weight = NODES**2 / (NODES**2).sum(axis=1, keepdims=True)
    if kernel.library() is not None:
        return kernel.Fit(v, fields).find_offsets(fields.coefficients, NODES, weight, corner)

    offsets = np.zeros((N_NODES, 3, len(corner)))
    at = taken(v.at, corner)
    normal = taken(v.normal, corner)
    for i in range(3):
        own = corner[:, i]
        size = fields.size[own]
        frame = fields.axis_x[own], fields.axis_y[own], v.normal[own]
        sides = [
            [dot(at[:, (i + s) % 3] - at[:, i], axis) / size for axis in frame] for s in (1, 2)
        ]
        leans = [[dot(normal[:, (i + s) % 3], axis) for axis in frame] for s in (1, 2)]
        c = np.ascontiguousarray(fields.coefficients[own].T)
        for node in np.flatnonzero(weight[:, i]):
            li, lj, lk = (NODES[node, (i + s) % 3] for s in range(3))
            x, y, z = (lj * a + lk * b for a, b in zip(*sides, strict=True))
            dx, dy, dz = (lj * a + lk * b for a, b in zip(*leans, strict=True))
            dz += li
            height = (value(c, x, y) - z) / dz
            for _ in range(STEPS):
                height = (value(c, x + height * dx, y + height * dy) - z) / dz
            direction = sum(NODES[node, m] * normal[:, m].T for m in range(3))
            offsets[node] += weight[node, i] * (size * height) * direction
    return offsets


_BY_U, _BY_V = slopes(*AT[:, 1:].T)  # (15, 14) of the terms
# (15, 12) from offsets
_DU_AT = _BY_U @ FROM_NODES
_DV_AT = _BY_V @ FROM_NODES


def _normals_at_nodes(offsets: Floats, corners: Floats) -> Floats:
    """Unit normals (n, 15, 3) at nodes and corners of curved faces
    of node offsets (12, 3, n) over facets (n, 3, 3).
    """
    by_u, by_v = (
        combine(matrix, offsets.reshape(N_NODES, -1)).reshape(len(AT), 3, -1)
        + (corners[:, c] - corners[:, 0]).T
        for matrix, c in ((_DU_AT, 1), (_DV_AT, 2))
    )
    normal = cross(by_u.swapaxes(0, 1), by_v.swapaxes(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.sqrt(product(normal, normal))
    return normal.transpose(2, 1, 0)


def _is_whole(offsets: Floats, corners: Floats, normals: Floats, facets: Floats) -> Bools:
    """Do curved faces, of node offsets (12, 3, n) and normals (n,
    15, 3), stay near facets and look the same way?
    """
    longest = length_of(corners[:, 1:] - corners[:, :1]).max(axis=1)
    with np.errstate(invalid="ignore"):
        is_near = np.sqrt((offsets**2).sum(axis=1).max(axis=0)) < MOST_OFFSET * longest
        return is_near & (np.einsum("nkc,nc->nk", normals, facets).min(axis=1) > STEEPEST_INSIDE)


def _is_swollen(offsets: Floats, corners: Floats, at_corners: Floats) -> Bools:
    """Do curved faces stand out, or in, further than the normals
    (n, 3, 3) at their corners (n, 3, 3) account for?
    """
    turned, along = (np.roll(x, -1, axis=1) - x for x in (at_corners, corners))
    sag = dot(turned, along) / 8  # of arcs over the edges
    height = np.einsum("kcn,nc->kn", offsets, normalise(at_corners.sum(axis=1)))
    more = UNTOLD * length_of(along).max(axis=1)
    with np.errstate(invalid="ignore"):
        stands_out = height.max(axis=0) > SWOLLEN * np.maximum(sag.max(axis=1), 0) + more
        stands_in = height.min(axis=0) < SWOLLEN * np.minimum(sag.min(axis=1), 0) - more
    return stands_out | stands_in


@dataclass(frozen=True, eq=False)
class _Faces:
    """Curved faces in the making.

    chosen (n,) numbers of their triangles; coefficients (n, 14, 3) m; own
    (n, 15, 3) unit normals at nodes and corners; is_swollen (n,)
    """

    chosen: Ints
    coefficients: Floats
    own: Floats
    is_swollen: Bools

    def at(self, which: Bools) -> "_Faces":
        return _Faces(
            self.chosen[which], self.coefficients[which], self.own[which], self.is_swollen[which]
        )


def make_curved(
    vertices: Floats,
    triangles: Ints,
    corner_normals: Floats,
    wanted: Bools,
    edges: Edges,
    is_joined: Bools,
    facets: Floats,
    has_mean_normals: bool,
    is_automatic: bool = False,
) -> Pauses[tuple[CurvedFaces | None, Bools]]:
    """Curved faces over those of the wanted triangles whose
    normals agree with their shape; which (t,) are doubted.

    Parameters
    ----------
    vertices, triangles : (v, 3) m, (t, 3)
    corner_normals : (t, 3, 3) unit; a flat triangle has its own three times
    wanted : (t,) smooth triangles
    edges : of the triangles; is_joined : (e,) those at whose ends the corner normals agree
    facets : (t, 3) normals of the triangles, unit
    has_mean_normals : normals are means of the faces around: the
        surface's own are found from the vertices
    is_automatic : faces that are no nearer to the surface meant
        than the facets are doubted, and left flat
    """
    # the vertices, with normals that may be found from their places
    corners = taken(vertices, triangles)
    asked = wanted
    least = np.einsum("tij,tj->ti", corner_normals, facets).min(axis=1)
    wanted = wanted & (least > STEEPEST)
    is_joined = is_joined & ~edges.is_same_way
    v = find_vertices(vertices, triangles, corner_normals, least > 0, edges, is_joined)
    given = v.normal
    is_used = _are_corners(v, wanted)
    yield 0
    if has_mean_normals:
        v = replace(v, normal=find_normals(v, is_used))
        wanted &= (np.einsum("tij,tj->ti", taken(v.normal, v.of_corner), facets) > STEEPEST).all(
            axis=1
        )
    yield 0

    # a face over each triangle that does not contradict itself
    wanted, face = _in_agreement(v, wanted, asked, is_used, edges, is_joined, facets)
    yield 0
    fields = fit_fields(v, _are_corners(v, wanted))
    faces, is_whole = yield from _fit_faces(v, fields, corners, facets, np.flatnonzero(wanted))
    if not is_automatic:  # Automatic looks at swollen faces and their neighbours together
        is_whole &= ~np.isin(face[faces.chosen], face[faces.chosen[faces.is_swollen]])
    if not is_whole.all():
        faces = faces.at(is_whole)
    beside = Beside.of(faces.chosen, len(triangles), edges, is_joined)
    yield 0

    # normals that agree at the edges, and faces that are trusted for it
    area = areas_of(corners)
    agreed, jump = agree(
        faces.own, taken(v.normal, v.of_corner[faces.chosen]), area[faces.chosen], beside
    )
    yield 0
    is_doubted = np.zeros(len(triangles), bool)
    if is_automatic:
        is_trusted = _are_trusted(v, faces, face, corners, agreed, jump)
        if not is_trusted.all():
            is_doubted[faces.chosen] = ~is_trusted
            faces = faces.at(is_trusted)
            beside = Beside.of(faces.chosen, len(triangles), edges, is_joined)
    if not len(faces.chosen):
        return None, is_doubted

    # drawn faces have the normals that were given: so have the faces around its vertices
    is_drawn = np.zeros(len(v.at), bool)
    is_drawn[v.of_corner[beside.row < 0]] = True
    normal = np.where(is_drawn[:, None], given, v.normal)
    if len(faces.chosen) < len(triangles):
        yield 0
        agreed, jump = agree(
            faces.own, taken(normal, v.of_corner[faces.chosen]), area[faces.chosen], beside
        )
    yield 0
    return _put_together(
        corners, v.of_corner[faces.chosen], normal, faces, agreed, jump, beside
    ), is_doubted


def _are_corners(v: Vertices, wanted: Bools) -> Bools:
    """Which vertices are corners of wanted triangles (t,)?"""
    is_used = np.zeros(len(v.at), bool)
    is_used[v.of_corner[wanted]] = True
    return is_used


def _in_agreement(
    v: Vertices,
    wanted: Bools,
    asked: Bools,
    is_used: Bools,
    edges: Edges,
    is_joined: Bools,
    facets: Floats,
) -> tuple[Bools, Ints]:
    """Which wanted triangles (t,) have normals that fit their
    shape; and the flat face (t,) that each is a part of.

    asked : (t,) triangles that were wanted to begin with; is_used : vertices at their corners
    """
    is_bad = contradicted(v, v.normal, is_used)
    if is_bad.any():
        n = len(v.at)
        bad = np.concatenate(
            [v.start[is_bad] * n + v.end[is_bad], v.end[is_bad] * n + v.start[is_bad]]
        )
        wanted = wanted & ~np.isin(v.of_corner * n + np.roll(v.of_corner, -1, axis=1), bad).any(
            axis=1
        )

    # a flat face in parts is curved as a whole or not at all
    is_flat = is_joined & (
        np.abs(taken(facets, edges.first) - taken(facets, edges.second)).max(axis=1) < COPLANAR
    )
    face = components(len(wanted), edges.first[is_flat], edges.second[is_flat])
    wanted = wanted & ~np.isin(face, face[asked & ~wanted])

    # nor is it when nothing around it is
    among = is_joined & ~is_flat & wanted[edges.first] & wanted[edges.second]
    return wanted & np.isin(
        face, face[np.concatenate([edges.first[among], edges.second[among]])]
    ), face


def _fit_faces(
    v: Vertices, fields: Fields, corners: Floats, facets: Floats, chosen: Ints
) -> Pauses[tuple[_Faces, Bools]]:
    """Faces over chosen triangles (n,), and which of them stay near their facets."""
    coefficients = np.empty((len(chosen), N_TERMS, 3))
    own = np.empty((len(chosen), len(AT), 3))
    is_whole, is_swollen = np.empty((2, len(chosen)), bool)
    for k in range(0, len(chosen), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        at = taken(corners, chosen[some])
        of_corner = v.of_corner[chosen[some]]
        offsets = _node_offsets(v, fields, of_corner)
        own[some] = _normals_at_nodes(offsets, at)
        is_whole[some] = _is_whole(offsets, at, own[some], taken(facets, chosen[some]))
        is_swollen[some] = _is_swollen(offsets, at, taken(v.normal, of_corner))
        fitted = combine(FROM_NODES, offsets.reshape(N_NODES, -1)).reshape(N_TERMS, 3, -1)
        coefficients[some] = fitted.transpose(2, 0, 1)
        yield 0
    return _Faces(chosen, coefficients, own, is_swollen), is_whole


def _are_trusted(
    v: Vertices, faces: _Faces, face: Ints, corners: Floats, agreed: Floats, jump: Floats
) -> Bools:
    """Which faces (n,) are nearer to the surface meant than their facets.

    All parts of a flat face (t,), or none.
    """
    vertex = v.of_corner[faces.chosen]
    of_face = face[faces.chosen]
    is_trusted = ~faces.is_swollen & trusted(
        taken(corners, faces.chosen),
        faces.coefficients,
        taken(v.normal, vertex),
        vertex,
        agreed,
        jump,
    )
    return is_trusted if is_trusted.all() else is_trusted & ~np.isin(of_face, of_face[~is_trusted])


def _put_together(
    corners: Floats,
    vertex: Ints,
    normal: Floats,
    faces: _Faces,
    agreed: Floats,
    jump: Floats,
    beside: Beside,
) -> CurvedFaces:
    """The curved faces, with straight edges and terms of their normals where they need them."""
    coefficients = faces.coefficients
    is_straight = beside.triangle < 0
    held = np.flatnonzero(is_straight.any(axis=1))
    bent_row = np.full(len(vertex), -1, np.int32)
    bent_row[held] = np.arange(len(held))
    bent = coefficients[held]
    offsets = np.matmul(AT_NODES, bent)
    offsets[:, :N_ON_EDGES] *= ~np.repeat(is_straight[held], 3, axis=1)[..., None]
    coefficients[held] = np.matmul(FROM_NODES, offsets)

    off = length_of(np.concatenate([agreed, taken(normal, vertex)], axis=1) - faces.own).max(axis=1)
    with_terms = np.flatnonzero(is_straight.any(axis=1) | (off > AGREE))
    normal_row = np.full(len(vertex), -1, np.int32)
    normal_row[with_terms] = np.arange(len(with_terms))
    normal_terms = np.matmul(
        FROM_NODES, agreed[with_terms] - np.matmul(NODES, taken(normal, vertex[with_terms]))
    )
    return CurvedFaces(
        corners=corners,
        row=beside.row,
        coefficients=by_term(coefficients),
        neighbour=beside.triangle,
        neighbour_edge=beside.edge,
        vertex=vertex,
        vertex_normal=normal,
        normal_row=normal_row,
        normal_terms=by_term(normal_terms),
        jump=jump[:, 1::3].max(axis=1),  # in the middles of edges
        bent_row=bent_row,
        bent=bent,
    )
