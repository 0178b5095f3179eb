"""Sides of a flat rectangle with an image by its UV map, and resizing of it."""

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ..data.rectangle import sides, uv_axes
from .read_mesh import column, mesh_of, uv_layer
from .resize import RESIZED_WITHIN, refuse_held, rescale

ALONG = 1e-5  # of its length: the largest deviation of a direction along an axis


def size_of(
    context: bpy.types.Context, thing: bpy.types.Object, uv_map: str = ""
) -> tuple[float, float]:
    """Width and height in the world, Blender units, of the whole image.

    uv_map : '' for the one used in renders

    Raises RigError, a clause for a sentence.
    """
    _, axes = laid_out(context, thing, uv_map)
    return sides(axes @ np.array(thing.matrix_world, float)[:3, :3].T)


def give_size(
    context: bpy.types.Context, thing: bpy.types.Object, size: tuple[float, float]
) -> None:
    """Give a rectangle this width and height, Blender units, about its centre; its children stay.

    Raises
    ------
    RigError : the reason, as a clause; everything is as before
    """
    refuse_held(thing)
    context.view_layer.update()
    points, axes = laid_out(context, thing)

    def missing(matrix: Floats) -> Floats:
        """Factors (2,) from its sides to the wanted ones."""
        return np.array(size) / sides(axes @ matrix[:3, :3].T)

    factors = axis_factors(axes, missing(np.array(thing.matrix_world, float)))
    rescale(
        context,
        thing,
        points,
        factors,
        lambda after: np.abs(missing(after) - 1).max() <= RESIZED_WITHIN,
    )


def laid_out(
    context: bpy.types.Context, thing: bpy.types.Object, uv_map: str = ""
) -> tuple[Floats, Floats]:
    """Vertices (n, 3) of a rectangle as shown, and the vectors (2, 3) of a whole u and v, in its
    own coordinates.
    """
    if thing.type == "EMPTY":
        raise RigError("it is an instance")

    with mesh_of(thing.evaluated_get(context.evaluated_depsgraph_get())) as mesh:
        layer = uv_layer(mesh, uv_map)
        if layer is None:
            raise RigError("it has no UV map")
        points = column(mesh.vertices, "co", 3, np.float32).astype(float)
        corners = points[column(mesh.loops, "vertex_index", 1, np.int32)]
        axes = uv_axes(corners, column(layer.uv, "vector", 2, np.float32).astype(float))

    size = None if axes is None else sides(axes @ np.array(thing.matrix_world, float)[:3, :3].T)
    if size is None:
        raise RigError("its UV map is not one rectangle")
    if not min(size):
        raise RigError("it has no size")

    return points, axes


def axis_factors(axes: Floats, factors_of_ways: Floats) -> Floats:
    """Factors (3,) for an object's axes that scale its two vectors (2, 3) by factors (2,)."""
    lengths = np.linalg.norm(axes, axis=1)
    off = np.sqrt(np.maximum(lengths[:, None] ** 2 - axes**2, 0))
    along = [
        int(row.argmin()) if row.min() <= ALONG * length else None
        for row, length in zip(off, lengths, strict=True)
    ]
    if along == [None, None]:
        raise RigError("its mesh is rotated in the object (scale it in Edit Mode)")

    # a flat object may be scaled across its plane, too, which keeps an even scale even
    factors = np.full(3, np.sqrt(np.prod(factors_of_ways)))
    # the other vector is perpendicular to this one's axis: scaled evenly, it keeps its direction
    if None in along:
        factors[:] = factors_of_ways[along.index(None)]

    for axis, value in zip(along, factors_of_ways, strict=True):
        if axis is not None:
            factors[axis] = value

    return factors
