"""Axes and sides of a flat rectangle, by its UV map."""

import numpy as np

from ...base.arrays import Floats
from ...rig.rig import Mesh

# of its size: the affine error of a flat rectangle's UV map is smaller
AFFINE = 1e-4


def flat_size(mesh: Mesh) -> tuple[float, float] | None:
    """Width and height in m of the UV square on a flat rectangle; None if the UV map is bent,
    skewed or missing.
    """
    if mesh.uv is None or not len(mesh.triangles):
        return None
    axes = uv_axes(mesh.corners.reshape(-1, 3), mesh.uv.reshape(-1, 2))
    return None if axes is None else sides(axes)


def uv_axes(points: Floats, uv: Floats) -> Floats | None:
    """Vectors (2, 3) of a whole u and a whole v, for points (n, 3) with uv (n, 2); None unless uv
    is affine.
    """
    if not (len(points) and np.isfinite(points).all() and np.isfinite(uv).all()):
        return None

    origin = points.mean(axis=0)
    place = uv.mean(axis=0)
    axes, _, rank, _ = np.linalg.lstsq(uv - place, points - origin, rcond=None)
    if rank < 2:
        return None

    missed = np.abs((uv - place) @ axes - (points - origin)).max()
    return None if missed > AFFINE * np.linalg.norm(axes, axis=1).max() else axes


def sides(axes: Floats) -> tuple[float, float] | None:
    """Width and height of the rectangle spanned by vectors (2, 3); None unless they are at right
    angles.
    """
    width, height = np.linalg.norm(axes, axis=1)
    if abs(axes[0] @ axes[1]) > AFFINE * width * height:
        return None
    return float(width), float(height)
