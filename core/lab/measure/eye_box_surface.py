"""A closed surface that shows how far a head may go, and by how much the picture is off on it.

It goes through the six ends of an eye box. In each of the eight octants between them it is the
eighth of an ellipsoid whose half axes are the octant's own three ways. Between the ends it is drawn
and not found: a head that comes nearer may go less far aside. The angle by which the picture is off
is traced there, too, and tells where the limit is kept. Rejected: to find the surface along each
way, as along the six, which takes six times as long.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats, Ints
from ...base.steps import at
from ...base.vectors import normalise
from ...glass.quartics import grid
from .eye_box import WAYS, EyeBox, Walk

N_TRACED = 3  # parts of an octant's edges between places that are traced
N_BETWEEN = 4  # parts of those that are drawn
MOST = 2.0  # times the limit: more is not told apart


@dataclass(frozen=True, eq=False)
class Surface:
    """Places on the surface, and how they hang together.

    Parameters
    ----------
    positions : (n, 3) m, world
    triangles : (m, 3), anticlockwise from outside
    off : (n,) arcmin, the largest angle by which a point of the picture is off from there, up to
        `MOST` limits; as much where fewer points are seen than have to be
    """

    positions: Floats
    triangles: Ints
    off: Floats


def surface_of(walk: Walk, box: EyeBox) -> Generator[float, None, Surface]:
    """The surface of an eye box that a walk has found; yields progress 0..1.

    An end where the head was not followed any further is drawn no farther away than the picture is.
    """
    ends = np.zeros((2, 3))
    for (axis, sign, _), extent, is_open in zip(WAYS, box.ends, box.is_open, strict=True):
        ends[int(sign > 0), axis] = min(extent, walk.distance) if is_open else extent

    coarse, faces = octahedron()
    offsets = _swelled(coarse, ends)
    parts = yield from at(0.0, walk.parts(list(offsets)))
    off = box.limit * np.minimum(parts, MOST)

    # finer, so that it looks round
    weights, parts = grid(N_BETWEEN)
    steps = np.rint(N_BETWEEN * weights).astype(int) @ coarse[faces]
    points, first, index = np.unique(
        steps.reshape(-1, 3), axis=0, return_index=True, return_inverse=True
    )
    viewer = walk.plan.viewer
    yield 1.0
    return Surface(
        positions=viewer.position + _swelled(points, ends) @ viewer.axes,
        triangles=index.reshape(len(faces), -1)[:, parts].reshape(-1, 3),
        off=(off[faces] @ weights.T).ravel()[first],
    )


def octahedron() -> tuple[Ints, Ints]:
    """Points (n, 3) on an octahedron with corners N_TRACED from its middle to the right, up and
    forward, and its triangles (m, 3), anticlockwise from outside.
    """
    weights, parts = grid(N_TRACED)
    steps = np.rint(N_TRACED * weights).astype(int)
    points, faces = [], []
    for signs in np.stack(np.meshgrid(*3 * [[-1, 1]]), axis=-1).reshape(-1, 3):
        # right, up, forward are left-handed
        turned = parts if signs.prod() < 0 else parts[:, ::-1]
        faces.append(turned + len(points) * len(steps))
        points.append(signs * steps)
    found, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return found, index.ravel()[np.concatenate(faces)]


def _swelled(points: Ints, ends: Floats) -> Floats:
    """Offsets (n, 3), m, of points (n, 3) on an octahedron, moved out to the surface whose ends
    (2, 3) are so far along each axis: those below 0 and those above.
    """
    directions = normalise(points.astype(float))
    return directions * np.where(directions > 0, ends[1], ends[0])
