"""Polygons cut with each other, by a clipper that knows nothing of edges, rows or
cumulative sums.
"""

from fractions import Fraction
from itertools import pairwise

import numpy as np


def clip(polygon, axis, limit, sign):
    """Keep the part of a polygon (list of points) where sign * (coordinate - limit) >= 0."""
    kept = []
    for a, b in pairwise([*polygon, *polygon[:1]]):
        da = sign * (a[axis] - limit)
        db = sign * (b[axis] - limit)
        if da >= 0:
            kept.append(a)
        if (da > 0 > db) or (da < 0 < db):
            kept.append(tuple(p + (q - p) * da / (da - db) for p, q in zip(a, b, strict=True)))
    return kept


def area_and_centroid(polygon):
    """Signed area and centroid (0, 0, 0 for none), taken from a
    corner so that a small polygon far away counts.
    """
    area = mx = my = 0
    (x, y), *rest = polygon or [(0, 0)]
    around = [(px - x, py - y) for px, py in rest]
    for (ax, ay), (bx, by) in pairwise(around):
        cross = ax * by - ay * bx
        area = area + cross / 2
        mx = mx + cross * (ax + bx) / 6
        my = my + cross * (ay + by) / 6
    return (area, x + mx / area, y + my / area) if area else (0, 0, 0)


def clipped(polygon, width, height, exact=False):
    """Area and centroid {pixel: (area, x, y)} of a convex polygon in each pixel of a display."""
    number = Fraction if exact else float
    points = [tuple(number(value) for value in point) for point in polygon]
    columns, rows = (
        [int(np.floor(f(point[i] for point in points))) for f in (min, max)] for i in (0, 1)
    )

    found = {}
    for row in range(max(rows[0], 0), min(rows[1], height - 1) + 1):
        strip = clip(clip(points, 1, row, 1), 1, row + 1, -1)
        for column in range(max(columns[0], 0), min(columns[1], width - 1) + 1):
            area, x, y = area_and_centroid(clip(clip(strip, 0, column, 1), 0, column + 1, -1))
            if abs(area) > 1e-14:
                found[row * width + column] = float(abs(area)), float(x), float(y)

    return found


def pieces_of(polygon, width, height):
    """The part of a convex polygon in each pixel of a display: {pixel: points}."""
    columns, rows = (
        [int(np.floor(f(point[i] for point in polygon))) for f in (min, max)] for i in (0, 1)
    )
    found = {}
    for row in range(max(rows[0], 0), min(rows[1], height - 1) + 1):
        strip = clip(clip(polygon, 1, row, 1), 1, row + 1, -1)
        for column in range(max(columns[0], 0), min(columns[1], width - 1) + 1):
            found[row * width + column] = clip(clip(strip, 0, column, 1), 0, column + 1, -1)
    return found


def covariance(polygon):
    """Covariance (2, 2) of the points of a convex polygon: the
    mean over the edges' middles is exact in triangles.
    """
    points = np.asarray(polygon, float)
    area, *middle = area_and_centroid([tuple(point) for point in points])
    total = np.zeros((2, 2))
    for b, c in pairwise(points[1:]):
        corners = np.stack([points[0], b, c]) - middle
        edges = (corners + np.roll(corners, -1, axis=0)) / 2
        total += np.linalg.det(corners[1:] - corners[0]) / 2 * (edges.T @ edges) / 3
    return total / area
