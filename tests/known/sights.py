"""Lines of sight from measured places of images, by Blender's own cameras, and where two of them
are seen as one: the judge of core's pair of eyes, which this shares nothing with.
"""

import bpy
import numpy as np


def line_of_sight(
    camera: bpy.types.Object, size: tuple[int, int], places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where a camera stands (3,), and directions (n, 3) in the world of places (n, 2) px of an
    image, y downward: those that its projection matrix takes to them.
    """
    depsgraph = bpy.context.evaluated_depsgraph_get()
    evaluated = camera.evaluated_get(depsgraph)
    matrix = np.array(evaluated.calc_matrix_camera(depsgraph, x=size[0], y=size[1]), float)
    x, y = (2 * places / size - 1).T * [[1], [-1]]
    local = [(x + matrix[0, 2]) / matrix[0, 0], (y + matrix[1, 2]) / matrix[1, 1], -1 + 0 * x]
    world = np.array(evaluated.matrix_world, float)
    return world[:3, 3], np.stack(local, axis=1) @ world[:3, :3].T


def seen_as_one(
    one: np.ndarray, other: np.ndarray, along: np.ndarray, along_other: np.ndarray
) -> np.ndarray:
    """The middles (n, 3) between the nearest places of lines from two points (3,), by least
    squares: of |one + s u - other - t v| for s and t.
    """
    middles = []
    for u, v in zip(along, along_other, strict=True):
        (s, t), *_ = np.linalg.lstsq(np.stack([u, -v], axis=1), other - one, rcond=None)
        middles.append((one + s * u + other + t * v) / 2)
    return np.array(middles)


def in_front_of(plane: bpy.types.Object, points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are in front of an object of one flat face, to an eye's side."""
    world = np.array(plane.matrix_world, float)
    face = plane.data.polygons[0]
    normal = np.array(face.normal, float) @ np.linalg.inv(world[:3, :3])
    normal /= np.linalg.norm(normal)
    middle = world[:3, :3] @ face.center + world[:3, 3]
    return (points - middle) @ normal * np.sign((eye - middle) @ normal)


def raised(
    one: np.ndarray, other: np.ndarray, along: np.ndarray, along_other: np.ndarray
) -> np.ndarray:
    """By how much higher the left eye sees points than the right, arcmin (n,): the angle between
    the planes that the line between the eyes has with either line of sight.
    """
    across = (other - one) / np.linalg.norm(other - one)
    level = along[0] - along[0] @ across * across
    level /= np.linalg.norm(level)
    up = np.cross(across, level)
    left, right = (np.arctan2(d @ up, d @ level) for d in (along, along_other))
    return np.degrees(left - right) * 60
