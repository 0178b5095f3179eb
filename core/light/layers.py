"""Which solids are asked for hits together, and how far they reach."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Pauses
from ..glass.bounding_shell import making_hull
from ..glass.curved import CurvedFaces
from ..glass.surfaces import Surface
from .ray_engine import FEW_TRIANGLES, Layer

MOST_UNLIKE = 1e4  # times the size of a part: the extent of the layer that it shares


def colour(touch: np.ndarray) -> Ints:
    """Greedy colours (n,) such that parts that touch differ."""
    colours = np.full(len(touch), -1)
    for i in range(len(touch)):
        taken = set(colours[touch[i] & (np.arange(len(touch)) != i)].tolist())
        colours[i] = next(c for c in range(len(touch) + 1) if c not in taken)
    return colours


def are_unlike(boxes: Floats) -> Bools:
    """Which of boxes (n, 2, 3) are too large together for
    float32 to resolve the smaller one? (n, n).
    """
    together = np.maximum(boxes[:, None, 1], boxes[None, :, 1]) - np.minimum(
        boxes[:, None, 0], boxes[None, :, 0]
    )
    size = np.ptp(boxes, axis=1).max(axis=1)
    return together.max(axis=2) > MOST_UNLIKE * np.minimum(size[:, None], size[None])


def group_parts(surfaces: list[Surface], touch: Bools) -> list[list[int]]:
    """Which parts share a layer: each of few faces is its
    own, the others by colour so that none touch (p, p).
    """
    small = [i for i, surface in enumerate(surfaces) if len(surface.corners) <= FEW_TRIANGLES]
    if len(small) > FEW_TRIANGLES:  # many boxes and panels: an engine beats asking each of them
        small = []

    rest = [i for i in range(len(surfaces)) if i not in small]
    groups = [[i] for i in small]

    if rest:
        boxes = np.stack([surfaces[i].bounds for i in rest])
        colours = colour(touch[np.ix_(rest, rest)] | are_unlike(boxes))
        groups += [
            [rest[k] for k in np.flatnonzero(colours == c)] for c in range(colours.max() + 1)
        ]

    return groups


def making_layer(surfaces: list[Surface]) -> Pauses[Layer]:
    """Make the layer of several surfaces, with pauses."""
    corners, curved = surfaces[0].corners, surfaces[0].curved
    if len(surfaces) > 1:
        of_each = [surface.corners for surface in surfaces]
        corners = np.concatenate(of_each)
        curved = CurvedFaces.join([surface.curved for surface in surfaces], of_each)

    hull = None if curved is None else (yield from making_hull(curved))
    yield 0
    return Layer(corners, curved, hull)


def triangles_of_boxes(boxes: Floats) -> Floats:
    """Triangles (12 b, 3, 3) of boxes (b, 2, 3)."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
    corners = np.where(corner[None], boxes[:, 1:], boxes[:, :1])
    return corners[:, triangles].reshape(-1, 3, 3)
