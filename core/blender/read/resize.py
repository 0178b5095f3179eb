"""Gives a flat object another size, by its own scale: its
mesh may be others', too, and have modifiers.
"""

from collections.abc import Callable

import bpy
import numpy as np
from mathutils import Matrix

from ...base.arrays import Floats
from ...base.errors import RigError
from .read_mesh import column, mesh_of

# of its size: an object no thicker along an axis of its own is perpendicular to that axis
FLAT_AXIS = 1e-5
RESIZED_WITHIN = 1e-4  # of a side: so near an object has to come to its size and stay in its place
FLOAT32_SUM_ERROR = (
    2.0**-22
)  # of its place: the error, in single precision, of a sum of two or three numbers
SQUARE = 1e-3  # of a side, by which the other may differ


def give_side(context: bpy.types.Context, thing: bpy.types.Object, side: float) -> None:
    """Make a flat object this long and wide, Blender units,
    about its middle; its children stay as they are.

    Raises
    ------
    RigError : the reason why it cannot be, a clause for a sentence; everything is as it was
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
    """Is a flat object this long and wide, Blender units?"""
    try:
        factors = _factors(np.array(thing.matrix_world, float), _points(context, thing), side)
    except RigError:
        return False
    return bool(np.abs(factors - 1).max() <= RESIZED_WITHIN)


def scale_by(
    context: bpy.types.Context, thing: bpy.types.Object, factor: float, shift: Floats
) -> None:
    """Make a flat object so many times as large, and move it by (3,), Blender units.

    Raises
    ------
    RigError : the reason why it cannot be, a clause for a sentence; everything is as it was
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
    """Move an object by (3,) Blender units, its children with it.

    Raises
    ------
    RigError : the reason why it cannot be, a clause for a sentence; it is where it was
    """
    if not np.any(shift):
        return
    give_matrix(context, thing, Matrix.Translation(np.asarray(shift).tolist()) @ thing.matrix_world)


def give_matrix(context: bpy.types.Context, thing: bpy.types.Object, matrix: Matrix) -> None:
    """Give an object a place and a turn in the world, its children with it; its scale stays.

    Raises
    ------
    RigError : the reason why it cannot be, a clause for a sentence; it is where it was
    """
    if is_animated(thing):
        raise RigError("it is animated")
    if any((*thing.lock_location, *thing.lock_rotation)):
        raise RigError("its location or rotation is locked")

    context.view_layer.update()
    before = thing.matrix_basis.copy(), thing.matrix_parent_inverse.copy()
    is_askew = _is_sheared(thing, matrix)
    if is_askew and thing.parent_type == "OBJECT":
        # location, turn and scale know no shear, but the way to the parent does
        way = thing.parent.matrix_world.inverted_safe() @ matrix
        thing.matrix_parent_inverse = way @ before[0].inverted_safe()
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
    """Would an object have to be sheared below its parent to have this matrix in the world?"""
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
    """Scale an object along its own axes, about its middle; its children stay as they are.

    Parameters
    ----------
    points : (n, 3) of it as shown, in its own coordinates
    factors : (3,)
    is_right : of the matrix (4, 4) that it then has in the world: is it as it was meant to be?

    Raises
    ------
    RigError : it does not keep scale or place, a clause for a sentence; everything is as it was
    """
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    before = np.array(thing.matrix_world, float)
    basis = np.array(thing.matrix_basis, float)[:3, :3]
    children = [child for child in thing.children if child.parent_type == "OBJECT"]
    kept = [(thing, "scale", thing.scale.copy()), (thing, "location", thing.location.copy())]
    kept += [
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
        for owner, name, value in kept:
            setattr(owner, name, value)
        context.view_layer.update()
        raise


def is_animated(block: bpy.types.ID) -> bool:
    """Has a datablock keyframes, drivers or strips, by which what is set might not stay?"""
    kept = block.animation_data
    return kept is not None and bool(kept.action or kept.drivers or kept.nla_tracks)


def refuse_held(thing: bpy.types.Object) -> None:
    """Raise RigError where a scale would not stay as it is set, or is not meant to be set."""
    if is_animated(thing):
        raise RigError("it is animated")
    if any(thing.lock_scale):
        raise RigError("its scale is locked")


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
    """By how much each of an object's axes has to be scaled for its sides to be as long.

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
        # a thing without thickness may be scaled along it, too,
        # so that the scale stays even where it is
        return np.insert(side / lengths, thin, side / np.sqrt(lengths.prod()))

    # the plane lies askew to the object's axes: one factor for all of them keeps its angle
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
