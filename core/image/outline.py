"""Cuts cells along the outline of the picture, so that each lies within it or beside it.

A cell across the outline would be painted as a whole, by a guess of how much of it is within: on
the source image of a ball more than half of the squared error was in the pixels along the outline.
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

ON_LINE = 1e-6  # viewer px: a point nearer to the outline is on it, so that rounding does not cut


def cut_along_outline(
    pieces: Iterator[Piece], place: PicturePlace, viewer: Viewer
) -> Iterator[Piece]:
    """Cut pieces of a view map along a flat picture's outline;
    pieces of pictures of another shape stay as they are.

    A quad that a line crosses from side to side becomes two quads. Others that it crosses become
    triangles, which are so small that their images are flat. The pieces are used up: a crossed one
    comes back without an image (NaN), and its parts come at the end.
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
        whole = Piece(*map(np.concatenate, zip(*parts, strict=True)))
        for polygons, of in _cut_along(lines, np.concatenate([whole.view, whole.display], axis=2)):
            yield Piece(
                polygons[..., :2], polygons[..., 2:], whole.throughput[of], whole.branch[of]
            )


def _cut_along(lines: Floats, polygons: Floats) -> Iterator[tuple[Floats, Ints]]:
    """Quads (m, 4, 4) and triangles (m, 3, 4) of which none is
    across one of the lines, from polygons (n, k, 4).

    Each of the two is followed by the numbers of the shapes that its polygons are parts of.
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
    """Which polygons (n, k, 2) lie on both sides of the outline."""
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
    is_beside = (most <= 0).any(axis=1)
    return near[((least < 0) & (most > 0)).any(axis=1) & ~is_beside]


def _sides(lines: Floats, view: Floats) -> Floats:
    """How far within the picture points (..., 2) lie of lines (l,
    3), viewer px: (..., l); 0 where they lie on them.
    """
    side = turn(lines[:, :2], view) + lines[:, 2]
    return np.where(np.abs(side) < ON_LINE, 0.0, side)


def _in_triangles(polygons: Floats, of: Ints) -> tuple[Floats, Ints]:
    """Triangles (n (k - 2), 3, ...) of convex polygons (n, k,
    ...), and the number (n,) of the polygon each is of.
    """
    fan = [polygons[:, [0, *two]] for two in pairwise(range(1, polygons.shape[1]))]
    return np.concatenate(fan), np.tile(of, len(fan))


def _cut_across(quads: Floats, of: Ints, line: Floats) -> tuple[Floats, Ints, Floats, Ints]:
    """Quads (m, 4, 4) of which none is across a line, and those
    (c, 4, 4) that it does not cross from side to side.

    Each of the two is followed by the numbers of the shapes that its polygons are parts of.
    """
    sign = np.sign(_sides(line[None], quads[..., :2])[..., 0]).astype(int)
    is_across = (sign.min(axis=1) < 0) & (sign.max(axis=1) > 0)

    # two neighbours on each side: opposite corners are then on different ones
    is_crossed = (
        is_across & (sign != 0).all(axis=1) & (sign == -np.roll(sign, 2, axis=1)).all(axis=1)
    )
    whole, crossed, others = (
        np.flatnonzero(which) for which in (~is_across, is_crossed, is_across & ~is_crossed)
    )

    # the two within come first: the second of them is followed by one beyond
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
    """Triangles (m, 3, 4) of which none is across a line, from others (n, 3, 4), and the number
    (m,) of the shape that each is a part of.
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
    """The corners (n, 3, ...), and their sides (n, 3), in turn, so
    that the one comes first that is alone on its side.

    A corner on the line is on the side of another one, or is
    itself alone where both others are on different sides.
    """
    sign = np.sign(side).astype(int)
    has_zero = (sign == 0).any(axis=1)
    first = np.where(has_zero, np.argmax(sign != 0, axis=1), _odd_one(sign))
    order = (first[:, None] + np.arange(3)) % 3
    rows = np.arange(len(triangles))[:, None]
    return triangles[rows, order], side[rows, order]


def _odd_one(sign: Ints) -> Ints:
    """Which (n,) of three signs differs from the two others."""
    return np.argmax(sign == -np.sign(sign.sum(axis=1, keepdims=True)), axis=1)


def _on_edge(corners: Floats, side: Floats, start: int, end: int) -> Floats:
    """Where the edges from one corner to another meet the line: (n, 4)."""
    part = side[:, start] / (side[:, start] - side[:, end])
    return corners[:, start] + part[:, None] * (corners[:, end] - corners[:, start])
