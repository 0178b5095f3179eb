"""A goblet as plain data."""

import numpy as np

from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh

# radius and height of its profile, mm: foot, stem and bowl outside, then the bowl inside
OUTSIDE = [(0, 0), (34, 2), (30, 5), (5, 10), (4, 90), (25, 105), (36, 130), (38, 150), (32, 200)]
INSIDE = [(30, 200), (36, 150), (34, 130), (23, 107), (0, 94)]


def goblet(n: int = 48) -> Glass:
    """A bowl of 76 mm on a thin stem and a foot, 200 mm high
    about 0, its wall 2 mm, open at the top; flat faces.
    """
    profile = 1e-3 * np.array([*OUTSIDE, *INSIDE], float)
    rows = len(profile)
    angle = 2 * np.pi * np.arange(n) / n
    radius, height = profile[:, :1], profile[:, 1:] - 0.1
    height = np.broadcast_to(height, (rows, n))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)

    # the two ends are points in the axis
    index = np.arange(rows * n).reshape(rows, n)
    index[[0, -1]] = index[[0, -1], :1]
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    triangles = np.concatenate(
        [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, d, c), (a, c, b))]
    )
    is_whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return Glass("goblet", Mesh(points.reshape(-1, 3), triangles[is_whole]), ConstantIndex(1.5))
