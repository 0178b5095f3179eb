"""Is the viewer where a viewer can be?"""

import numpy as np

from ..base.errors import RigError
from ..glass.solids import contains
from ..glass.surfaces import Surface
from ..rig.rig import Glass, Viewer
from .hits import slab


class InsideGlassError(RigError):
    """A viewer is inside a solid."""


def check_viewer_outside(viewer: Viewer, glass: Glass, solid: Surface) -> None:
    """Raise RigError when a viewer is inside a solid, or a
    solid cuts an orthographic viewer's plane.
    """
    if solid.n_open:
        return  # has no inside

    if viewer.projection == "orthographic" and cuts_image(viewer, solid):
        raise RigError(
            "The glass '{glass}' cuts the plane of the orthographic viewer '{viewer}': move"
            " it out.",
            glass=glass.name,
            viewer=viewer.name,
        )

    at, _ = viewer.rays(np.zeros((1, 2)))
    low, high = solid.bounds
    if ((at >= low) & (at <= high)).all() and contains(solid.corners, at).any():
        raise InsideGlassError(
            "The viewer '{viewer}' is inside the glass '{glass}': move it out.",
            viewer=viewer.name,
            glass=glass.name,
        )


def cuts_image(viewer: Viewer, solid: Surface) -> bool:
    """Does a surface cut the rectangle on its own plane through which an orthographic
    viewer looks?
    """
    left, right, bottom, top = viewer.window
    low, high = solid.bounds
    middle = ((low + high) / 2 - viewer.position) @ viewer.axes.T
    reach = (high - low) / 2 @ np.abs(viewer.axes.T)
    if abs(middle[2]) > reach[2]:
        return False

    # triangles with corners on both sides of the plane
    corners = (solid.corners - viewer.position) @ viewer.axes.T
    is_before = corners[..., 2] > 0
    corners, is_before = (
        x[is_before.any(axis=1) & ~is_before.all(axis=1)] for x in (corners, is_before)
    )

    # two of each triangle's edges cross the plane, those at the
    # corner that is on the other side than the others
    alone = np.argmax(is_before == (is_before.sum(axis=1) == 1)[:, None], axis=1)
    apex, *others = (corners[np.arange(len(corners)), (alone + k) % 3] for k in range(3))
    start, end = (apex + (apex[:, 2:] / (apex - other)[:, 2:]) * (other - apex) for other in others)
    start[:, 2] = end[:, 2] = 0.0

    enter, leave = slab(np.array([[left, bottom, -1.0], [right, top, 1.0]]), start, end - start)
    return bool(((enter <= leave) & (enter <= 1) & (leave >= 0)).any())
