"""Flaps: faces that hang on a surface which is closed without them, as cuts may leave them.

A bowl of one surface on a solid base hangs on that as a flap does, and was meant. So a flap lies
within the body, where no light has to do with it, or against it. One that stands out of it is a
scrap: flat, with a small part of the area and less than half of the faces. So are loose bits that
hang on nothing, as beside a scan.
"""

from collections.abc import Iterable, Iterator

import bmesh
import numpy as np

from ..base.arrays import Floats
from ..glass.solids import contains

LARGEST = 0.5  # of area and of faces: more than that is the surface, whatever hangs on it
SCRAP = 0.05  # of the area: what stands out of the body and is larger was meant
FLAT = 0.01  # of its length: a scrap is no thicker
AGAINST = 1e-4  # of the mesh's size: what is nearer to the body than this touches it
MOST_ASKED = 16  # faces of a flap that are looked for in the body
AROUND = np.concatenate([np.eye(3), -np.eye(3)])

Piece = tuple[set[bmesh.types.BMFace], set[bmesh.types.BMEdge]]  # and the edges by which it hangs


def take_flaps(shape: bmesh.types.BMesh) -> int:
    """Take flaps out of a mesh, and those that hang on them; returns how many faces went.

    A flap ends in the open somewhere, and each edge by which it hangs has two faces without it. It
    lies within the body, or is a scrap.
    """
    n = 0
    while flaps := _flaps(shape):
        faces = [face for flap in flaps for face in flap]
        n += len(faces)
        bmesh.ops.delete(shape, geom=faces, context="FACES")
    return n


def take_scraps(shape: bmesh.types.BMesh) -> int:
    """Take scraps that hang on nothing out of a mesh, if they are a small part of it together: else
    it is made of such. Returns how many faces went.
    """
    area = _area(shape.faces)
    scraps: set[bmesh.types.BMFace] = set()
    for piece, hangs in _open_pieces(shape):
        if not hangs and area and _is_scrap(shape, piece, _area(piece) / area):
            scraps |= piece
    if not scraps or _area(scraps) > SCRAP * area:
        return 0
    bmesh.ops.delete(shape, geom=list(scraps), context="FACES")
    return len(scraps)


def _area(faces: Iterable[bmesh.types.BMFace]) -> float:
    return sum(face.calc_area() for face in faces)


def _flaps(shape: bmesh.types.BMesh) -> list[set[bmesh.types.BMFace]]:
    """Flaps of which no two hang on the same edge."""
    area = _area(shape.faces)
    used: set[bmesh.types.BMEdge] = set()
    found = []
    for piece, hangs in _open_pieces(shape):
        has_two = all(len(set(one.link_faces) - piece) == 2 for one in hangs)
        share = _area(piece) / area if area else 1.0
        may_be = hangs and has_two and share < LARGEST and hangs.isdisjoint(used)
        if may_be and (_is_scrap(shape, piece, share) or _is_within(shape, piece)):
            used |= hangs
            found.append(piece)
    return found


def _open_pieces(shape: bmesh.types.BMesh) -> Iterator[Piece]:
    """The pieces that have an edge in the open, each once."""
    seen: set[bmesh.types.BMFace] = set()
    for edge in shape.edges:
        if edge.is_boundary and edge.link_faces[0] not in seen:
            piece, hangs = _piece(edge.link_faces[0])
            seen |= piece
            yield piece, hangs


def _piece(start: bmesh.types.BMFace) -> Piece:
    """The faces that hang together with one over edges of two faces, and the edges of more."""
    piece, hangs, todo = {start}, set(), [start]
    while todo:
        for edge in todo.pop().edges:
            if len(edge.link_faces) > 2:
                hangs.add(edge)
                continue
            for face in edge.link_faces:
                if face not in piece:
                    piece.add(face)
                    todo.append(face)
    return piece, hangs


def _is_scrap(shape: bmesh.types.BMesh, piece: set[bmesh.types.BMFace], share: float) -> bool:
    """Is a piece flat, and small beside the whole?

    share : of the whole area
    """
    if share > SCRAP or len(piece) > LARGEST * len(shape.faces):
        return False
    points = np.array([vertex.co for face in piece for vertex in face.verts])
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[2] <= FLAT * sizes[0])


def _is_within(shape: bmesh.types.BMesh, piece: set[bmesh.types.BMFace]) -> bool:
    """Does a piece lie within the body that the other faces make, or against it?"""
    body = [loops for loops in shape.calc_loop_triangles() if loops[0].face not in piece]
    corners = np.array([[loop.vert.co for loop in loops] for loops in body], float)
    faces = sorted(piece, key=lambda face: face.index)
    step = -(-len(faces) // MOST_ASKED)
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    return all(_touches(corners, face, AGAINST * size) for face in faces[::step])


def _touches(corners: Floats, face: bmesh.types.BMFace, near: float) -> bool:
    """Is the middle of a face in the body of triangles (t, 3, 3), or nearer to it than this?"""
    middle = np.array(face.calc_center_median(), float)
    return bool(contains(corners, middle[None])[0]) or bool(
        contains(corners, middle + near * AROUND).any()
    )
