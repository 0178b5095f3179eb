"""Resizes and moves objects by their own transforms: their meshes may have other users and
modifiers.
"""

from collections.abc import Callable

import bpy
import numpy as np
from mathutils import Matrix

from ...base.arrays import Floats
from ...base.errors import RigError
from .read_mesh import column, mesh_of

# of its size: an object no thicker along one of its axes is perpendicular to the axis
FLAT_AXIS = 1e-5
RESIZED_WITHIN = 1e-4  # of a side: allowed deviation from the wanted size and place
FLOAT32_SUM_ERROR = 2.0**-22  # relative error of a sum of two or three float32 numbers
SQUARE = 1e-3  # allowed difference of a square's sides, as a fraction


def give_side(context: bpy.types.Context, thing: bpy.types.Object, side: float) -> None:
    """Give a flat object sides of this length, Blender units, about its centre; its children stay.

    Raises
    ------
    RigError : the reason, as a clause; everything is as before
    """
    refuse_held(thing)
    context.view_layer.update()
    points = _points(context, thing)
    factors = _factors(np.array(thing.matrix_world, float), points, side)
    rescale(
        context,
        thing,
        points,
        factors,
        lambda after: np.abs(_factors(after, points, side) - 1).max() <= RESIZED_WITHIN,
    )


def has_side(context: bpy.types.Context, thing: bpy.types.Object, side: float) -> bool:
    """Whether a flat object has sides of this length, Blender units."""
    try:
        factors = _factors(np.array(thing.matrix_world, float), _points(context, thing), side)
    except RigError:
        return False
    return bool(np.abs(factors - 1).max() <= RESIZED_WITHIN)


def scale_by(
    context: bpy.types.Context, thing: bpy.types.Object, factor: float, shift: Floats
) -> None:
    """Scale a flat object by a factor, and move it by (3,), Blender units.

    Raises
    ------
    RigError : the reason, as a clause; everything is as before
    """
    refuse_held(thing)
    context.view_layer.update()
    points = _points(context, thing)
    wanted = factor * np.array(thing.matrix_world, float)[:3, :3]
    slack = RESIZED_WITHIN * np.abs(wanted).max()

    before = thing.matrix_basis.copy(), thing.matrix_parent_inverse.copy()
    move_by(context, thing, shift)
    try:
        rescale(
            context,
            thing,
            points,
            np.full(3, factor),
            lambda after: np.abs(after[:3, :3] - wanted).max() <= slack,
        )
    except BaseException:
        thing.matrix_basis, thing.matrix_parent_inverse = before
        context.view_layer.update()
        raise


def move_by(context: bpy.types.Context, thing: bpy.types.Object, shift: Floats) -> None:
    """Move an object by (3,) Blender units, with its children.

    Raises
    ------
    RigError : the reason, as a clause; the object is not moved
    """
    if not np.any(shift):
        return
    give_matrix(context, thing, Matrix.Translation(np.asarray(shift).tolist()) @ thing.matrix_world)


def give_matrix(context: bpy.types.Context, thing: bpy.types.Object, matrix: Matrix) -> None:
    """Give an object a location and rotation in the world, with its children; its scale stays.

    Raises
    ------
    RigError : the reason, as a clause; the object is not moved
    """
    if is_animated(thing):
        raise RigError("it is animated")
    if any((*thing.lock_location, *thing.lock_rotation)):
        raise RigError("its transform is locked")

    context.view_layer.update()
    before = thing.matrix_basis.copy(), thing.matrix_parent_inverse.copy()
    is_askew = _is_sheared(thing, matrix)
    if is_askew and thing.parent_type == "OBJECT":
        # location, rotation and scale cannot express shear, but the parent inverse can
        to_parent = thing.parent.matrix_world.inverted_safe() @ matrix
        thing.matrix_parent_inverse = to_parent @ before[0].inverted_safe()
    else:
        thing.matrix_world = matrix
    context.view_layer.update()

    wanted, found = np.array(matrix, float), np.array(thing.matrix_world, float)
    far = np.abs(found - wanted)
    size = max(np.abs(wanted[:3, :3]).max(), max(thing.dimensions, default=0.0))
    rounding = FLOAT32_SUM_ERROR * np.abs(wanted[:3, 3]).max()
    if far.max() > RESIZED_WITHIN * size + rounding:
        thing.matrix_basis, thing.matrix_parent_inverse = before
        context.view_layer.update()
        if is_askew and thing.parent_type != "OBJECT":
            raise RigError("its parent '{parent}' is scaled unevenly", parent=thing.parent.name)
        raise RigError("a constraint or a driver holds it")


def _is_sheared(thing: bpy.types.Object, matrix: Matrix) -> bool:
    """Whether this world matrix would need shear below the object's parent."""
    if thing.parent is None:
        return False
    parent = thing.matrix_world @ thing.matrix_local.inverted_safe()
    axes = np.array(parent.inverted_safe() @ matrix, float)[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    cosines = axes.T @ axes - np.diag(lengths**2)
    return bool(np.abs(cosines).max() > RESIZED_WITHIN * lengths.max() ** 2)


def rescale(
    context: bpy.types.Context,
    thing: bpy.types.Object,
    points: Floats,
    factors: Floats,
    is_right: Callable,
) -> None:
    """Scale an object along its own axes, about its centre; its children stay.

    Parameters
    ----------
    points : (n, 3) of it as shown, in its own coordinates
    factors : (3,)
    is_right : whether its new matrix (4, 4) in the world is the wanted one

    Raises
    ------
    RigError : its scale or place does not hold, a clause for a sentence; everything is as before
    """
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    before = np.array(thing.matrix_world, float)
    basis = np.array(thing.matrix_basis, float)[:3, :3]
    children = [child for child in thing.children if child.parent_type == "OBJECT"]
    saved = [(thing, "scale", thing.scale.copy()), (thing, "location", thing.location.copy())]
    saved += [
        (child, "matrix_parent_inverse", child.matrix_parent_inverse.copy()) for child in children
    ]

    try:
        thing.scale = (np.array(thing.scale) * factors).tolist()
        thing.location = (np.array(thing.location) + basis @ (middle * (1 - factors))).tolist()
        context.view_layer.update()
        after = np.array(thing.matrix_world, float)

        for child in children:
            child.matrix_parent_inverse = (
                Matrix(after.tolist()).inverted_safe()
                @ Matrix(before.tolist())
                @ child.matrix_parent_inverse
            )

        context.view_layer.update()
        moved = (after - before)[:3, :3] @ middle + (after - before)[:3, 3]
        rounding = FLOAT32_SUM_ERROR * np.abs(after[:3, 3]).max()
        size = np.ptp(points @ after[:3, :3].T, axis=0).max()
        if not is_right(after) or np.abs(moved).max() > RESIZED_WITHIN * size + rounding:
            raise RigError("a constraint or a driver holds it")
    except BaseException:
        for owner, name, value in saved:
            setattr(owner, name, value)
        context.view_layer.update()
        raise


def is_animated(block: bpy.types.ID) -> bool:
    """Whether a datablock has keyframes, drivers or strips, which may override set values."""
    animation = block.animation_data
    if animation is None:
        return False
    return bool(animation.action or animation.drivers or animation.nla_tracks)


def refuse_held(thing: bpy.types.Object) -> None:
    """Raise RigError if a scale is animated or locked."""
    if is_animated(thing):
        raise RigError("it is animated")
    if any(thing.lock_scale):
        raise RigError("its transform is locked")


def _points(context: bpy.types.Context, thing: bpy.types.Object) -> Floats:
    """Vertices (n, 3) of an object as it is shown, in its own coordinates."""
    if thing.type == "EMPTY":
        raise RigError("it is an instance")

    with mesh_of(thing.evaluated_get(context.evaluated_depsgraph_get())) as mesh:
        points = column(mesh.vertices, "co", 3, np.float32).astype(float)

    if not len(points) or not np.isfinite(points).all():
        raise RigError("it has no size")

    return points


def _factors(matrix: Floats, points: Floats, side: float) -> Floats:
    """Factors for each of an object's axes that make its sides equal to `side`.

    Parameters
    ----------
    matrix : (4, 4) of the object in the world
    points : (n, 3) in its own coordinates
    """
    extent = np.ptp(points, axis=0)
    thin = int(extent.argmin())
    if extent[thin] <= FLAT_AXIS * extent.max():
        lengths = np.delete(np.linalg.norm(matrix[:3, :3], axis=0) * extent, thin)
        if not lengths.all():
            raise RigError("it has no size")
        # a flat object may be scaled across its plane, too, which keeps an even scale even
        return np.insert(side / lengths, thin, side / np.sqrt(lengths.prod()))

    # the plane is oblique to the object's axes: one factor for all of them keeps its angle
    world = points @ matrix[:3, :3].T
    _, axes = np.linalg.eigh(np.cov(world.T))
    normal = axes[:, 0]
    along = matrix[:3, :2].T - np.outer(matrix[:3, :2].T @ normal, normal)
    along = along[np.linalg.norm(along, axis=1).argmax()]
    along /= np.linalg.norm(along)
    thick, width, height = (
        np.ptp(world @ axis) for axis in (normal, along, np.cross(normal, along))
    )
    if thick > SQUARE * width:
        raise RigError("it is not flat")
    if abs(width - height) > SQUARE * width:
        raise RigError("its mesh is rotated in the object and not square")

    return np.full(3, side / width)
