"""Where the surface that was meant is known exactly, for a mesh of quads was subdivided."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Pauses
from .meshes import Edges
from .quad_lines import find_quad_lines
from .quartics import AT
from .splines import Splines, looking_for_splines
from .subdivided import Subdivided, looking_for_subdivided
from .vertices import Vertices

# a larger mesh is judged face by face, as any other: curved all over it would take twice the time
MOST_TRIANGLES = 10_000


@dataclass(frozen=True, eq=False)
class Known:
    """Triangles (t,) over which it is known, as parts tell; the unit normals (f, 3) of the vertices
    at their corners, NaN elsewhere; and rank (t,): where two parts tell of the edge between two
    triangles, that of the higher is believed; 0 where none does.
    """

    parts: tuple[Splines | Subdivided, ...]
    is_face: Bools
    normal: Floats
    rank: Ints

    def faces(self, triangles: Ints) -> tuple[Floats, Floats]:
        """Places and unit normals (n, 15, 3) of such triangles (n,) at nodes and corners."""
        places, normals = np.empty((2, len(triangles), len(AT), 3))
        for part in self.parts:
            some = np.flatnonzero(part.is_face[triangles])
            places[some], normals[some] = part.faces(triangles[some])

        return places, normals


def looking_for_known(
    v: Vertices, edges: Edges, polygon: Ints, asked: Bools
) -> Pauses[Known | None]:
    """Where it is known of a mesh whose triangles are parts of polygons (t,), of those that are
    asked for (t,); None where it is nowhere, and for a mesh of more than MOST_TRIANGLES.
    """
    if len(polygon) > MOST_TRIANGLES:
        return None

    lines = find_quad_lines(v, edges, polygon)
    yield 0
    splines = yield from looking_for_splines(v, lines)
    rest = asked if splines is None else asked & ~splines.is_face
    subdivided = yield from looking_for_subdivided(v, lines, polygon, rest)
    parts = [part for part in (splines, subdivided) if part is not None]
    if not parts:
        return None

    normal = parts[0].normal
    for part in parts[1:]:
        normal = np.where(np.isnan(normal), part.normal, normal)

    # splines alone go through rounded vertices as they are
    rank = np.zeros(len(polygon), np.int64)
    for part in reversed(parts):
        rank[part.is_face] = 2 if part is splines else 1

    return Known(tuple(parts), rank > 0, normal, rank)
