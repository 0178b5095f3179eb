"""Flaps: faces that hang on a surface which is closed without them, as cuts may leave them."""

import bmesh

LARGEST = 0.5  # of the whole area: more than that is the surface, whatever hangs on it


def take_flaps(shape: bmesh.types.BMesh) -> int:
    """Take flaps out of a mesh, and those that hang on them; returns how many faces went.

    A flap ends in the open somewhere, and each edge by which it hangs has two faces without it.
    """
    n = 0
    while flaps := _flaps(shape):
        faces = [face for flap in flaps for face in flap]
        n += len(faces)
        bmesh.ops.delete(shape, geom=faces, context="FACES")
    return n


def _flaps(shape: bmesh.types.BMesh) -> list[set[bmesh.types.BMFace]]:
    """Flaps of which no two hang on the same edge."""
    most = LARGEST * sum(face.calc_area() for face in shape.faces)
    seen: set[bmesh.types.BMFace] = set()
    used: set[bmesh.types.BMEdge] = set()
    found = []
    # a flap has an edge in the open: only there it is looked for
    for edge in shape.edges:
        if not edge.is_boundary or edge.link_faces[0] in seen:
            continue
        piece, hangs = _piece(edge.link_faces[0])
        seen |= piece
        has_two = all(len(set(one.link_faces) - piece) == 2 for one in hangs)
        is_small = sum(face.calc_area() for face in piece) < most
        if hangs and has_two and is_small and hangs.isdisjoint(used):
            used |= hangs
            found.append(piece)
    return found


def _piece(
    start: bmesh.types.BMFace,
) -> tuple[set[bmesh.types.BMFace], set[bmesh.types.BMEdge]]:
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
