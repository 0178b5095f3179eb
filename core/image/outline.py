"""Cuts cells along the outline of the picture, so each lies fully inside or outside.

A cell across the outline would be painted as a whole, with an estimate of its covered part. For a
ball, more than half of the source image's squared error was in the pixels along the outline.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..base.arrays import Floats, Ints, take
from ..base.products import turn
from ..map import native_divide
from ..map.pieces import Piece
from ..native import loading
from ..rig.rig import PicturePlace, Viewer
from .flat_picture import outline_in_view

ON_LINE = 1e-6  # viewer px: a closer point is on the outline, so rounding does not cause cuts


def cut_along_outline(
    pieces: Iterator[Piece], place: PicturePlace, viewer: Viewer
) -> Iterator[Piece]:
    """Cut pieces of a view map along a flat picture's outline; pieces of other pictures are
    unchanged.

    A quad crossed from side to side becomes two quads. Other crossed quads become triangles, small
    enough to have flat images. Pieces are modified: a crossed one is returned with a NaN image, and
    its parts follow at the end.
    """
    lines = outline_in_view(place, viewer)
    if lines is None:
        yield from pieces
        return

    crossed: dict[int, list[Piece]] = {}  # by number of corners
    for piece in pieces:
        across = _across(lines, piece.view)
        if len(across):
            crossed.setdefault(piece.view.shape[1], []).append(piece.at(across))
            piece.display[across] = np.nan
        yield piece

    for parts in crossed.values():
        whole = Piece(
            *(None if x[0] is None else np.concatenate(x) for x in zip(*parts, strict=True))
        )
        for polygons, of in _cut_along(lines, np.concatenate([whole.view, whole.display], axis=2)):
            yield whole.at(of)._replace(view=polygons[..., :2], display=polygons[..., 2:])


def _cut_along(lines: Floats, polygons: Floats) -> Iterator[tuple[Floats, Ints]]:
    """Cut polygons (n, k, 4) into quads (m, 4, 4) and triangles (m, 3, 4) that no line crosses.

    Each is returned with the indices of its original polygons.
    """
    number = np.arange(len(polygons))
    none = np.arange(0)
    quads = (polygons, number)
    triangles = (np.empty((0, 3, 4)), none)
    if polygons.shape[1] == 3:
        quads = (np.empty((0, 4, 4)), none)
        triangles = (polygons, number)

    for line in lines:
        *quads, corners, of_corners = _cut_across(*quads, line)
        others = _in_triangles(corners, of_corners)
        triangles = _cut(*map(np.concatenate, zip(triangles, others, strict=True)), line)

    return (some for some in (quads, triangles) if len(some[1]))


def _across(lines: Floats, view: Floats) -> Ints:
    """Indices of polygons (n, k, 2) that cross the outline."""
    if loading.library() is not None:
        return native_divide.find_across(lines, view, ON_LINE)

    x, y = columns = np.ascontiguousarray(view[:, 0].T)
    reach = [
        max(np.abs(view[:, k, i] - columns[i]).max(initial=0) for k in range(1, view.shape[1]))
        for i in (0, 1)
    ]
    is_near = np.zeros(len(view), bool)
    for a, b, c in lines:
        is_near |= np.abs(a * x + b * y + c) <= abs(a) * reach[0] + abs(b) * reach[1] + ON_LINE

    near = np.flatnonzero(is_near)
    side = _sides(lines, take(view, near))
    least = side.min(axis=1)
    most = side.max(axis=1)
    is_outside = (most <= 0).any(axis=1)
    return near[((least < 0) & (most > 0)).any(axis=1) & ~is_outside]


def _sides(lines: Floats, view: Floats) -> Floats:
    """Signed distances (..., l) of points (..., 2) from lines (l, 3), viewer px, positive inside
    the picture; 0 on a line.
    """
    side = turn(lines[:, :2], view) + lines[:, 2]
    return np.where(np.abs(side) < ON_LINE, 0.0, side)


def _in_triangles(polygons: Floats, of: Ints) -> tuple[Floats, Ints]:
    """Triangles (n (k - 2), 3, ...) of convex polygons (n, k, ...), and the polygon (n,) of
    each.
    """
    fan = [polygons[:, [0, *two]] for two in pairwise(range(1, polygons.shape[1]))]
    return np.concatenate(fan), np.tile(of, len(fan))


def _cut_across(quads: Floats, of: Ints, line: Floats) -> tuple[Floats, Ints, Floats, Ints]:
    """Quads (m, 4, 4) that a line does not cross, and quads (c, 4, 4) it crosses, but not from side
    to side.

    Each is followed by the indices of its original polygons.
    """
    sign = np.sign(_sides(line[None], quads[..., :2])[..., 0]).astype(int)
    is_across = (sign.min(axis=1) < 0) & (sign.max(axis=1) > 0)

    # two neighbours on each side: opposite corners then differ
    is_crossed = (
        is_across & (sign != 0).all(axis=1) & (sign == -np.roll(sign, 2, axis=1)).all(axis=1)
    )
    whole, crossed, others = (
        np.flatnonzero(which) for which in (~is_across, is_crossed, is_across & ~is_crossed)
    )

    # the two inside come first, with the second followed by one outside
    second = np.argmax((sign[crossed] > 0) & (np.roll(sign[crossed], -1, axis=1) < 0), axis=1)
    order = (second[:, None] + np.array([-1, 0, 1, 2])) % 4
    corners = np.take_along_axis(quads[crossed], order[..., None], axis=1)
    side = _sides(line[None], corners[..., :2])[..., 0]
    right = _on_edge(corners, side, 1, 2)
    left = _on_edge(corners, side, 0, 3)
    within = np.stack([corners[:, 0], corners[:, 1], right, left], axis=1)
    beyond = np.stack([left, right, corners[:, 2], corners[:, 3]], axis=1)

    return (
        np.concatenate([quads[whole], within, beyond]),
        np.concatenate([of[whole], of[crossed], of[crossed]]),
        quads[others],
        of[others],
    )


def _cut(triangles: Floats, of: Ints, line: Floats) -> tuple[Floats, Ints]:
    """Cut triangles (n, 3, 4) into triangles (m, 3, 4) that a line does not cross, with the
    original polygon (m,) of each.
    """
    side = _sides(line[None], triangles[..., :2])[..., 0]
    is_across = (side.min(axis=1) < 0) & (side.max(axis=1) > 0)
    whole = np.flatnonzero(~is_across)
    across = np.flatnonzero(is_across)

    corners, side = _alone_first(triangles[across], side[across])
    start, end = (_on_edge(corners, side, 0, k) for k in (1, 2))
    apex = np.stack([corners[:, 0], start, end], axis=1)
    rest, of_rest = _in_triangles(
        np.stack([start, corners[:, 1], corners[:, 2], end], axis=1), of[across]
    )

    return np.concatenate([triangles[whole], apex, rest]), np.concatenate(
        [of[whole], of[across], of_rest]
    )


def _alone_first(triangles: Floats, side: Floats) -> tuple[Floats, Floats]:
    """Rotate the corners (n, 3, ...) and their sides (n, 3) so that the corner alone on its side
    comes first.

    A corner on the line belongs to another one's side, or is the one alone if the others differ.
    """
    sign = np.sign(side).astype(int)
    has_zero = (sign == 0).any(axis=1)
    first = np.where(has_zero, np.argmax(sign != 0, axis=1), _odd_one(sign))
    order = (first[:, None] + np.arange(3)) % 3
    rows = np.arange(len(triangles))[:, None]
    return triangles[rows, order], side[rows, order]


def _odd_one(sign: Ints) -> Ints:
    """Index (n,) of the sign that differs from the two others."""
    return np.argmax(sign == -np.sign(sign.sum(axis=1, keepdims=True)), axis=1)


def _on_edge(corners: Floats, side: Floats, start: int, end: int) -> Floats:
    """Intersections (n, 4) of the edges between two corners with the line."""
    part = side[:, start] / (side[:, start] - side[:, end])
    return corners[:, start] + part[:, None] * (corners[:, end] - corners[:, start])
