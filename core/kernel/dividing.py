"""Divides cells among display pixels, as `shares.py` does, cell by cell."""

import ctypes
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rig import Floats
from .loading import library, loaded
from .structures import DivisionStructure, Made

LEAST_ROOM = 256  # shares


class Divided(NamedTuple):
    """Shares, as `shares.Shares` has them, and the number (n,) of the cell of each."""

    display_index: NDArray[np.integer]
    view_xy: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats
    number: NDArray[np.int64]


def can_divide(view_polygons: Floats, display_polygons: Floats) -> bool:
    """Can the kernel divide such cells?"""
    shape = np.shape(display_polygons)
    return library() is not None and shape[1:] in {(3, 2), (4, 2)} and np.shape(view_polygons) == shape


def divided(
    display_size: tuple[int, int],
    view_polygons: Floats,
    display_polygons: Floats,
    index_type: type[np.signedinteger],
    at_once: int,
) -> Iterator[Divided]:
    """Shares of cells, no more than so many at once: other parameters as for `shares.rasterise`."""
    made, n_cells = Made(DivisionStructure), len(display_polygons)
    division = made.structure
    made.point("view", view_polygons, float)
    made.point("display", display_polygons, float)
    width, height = display_size
    made.set(n_cells=n_cells, n_corners=display_polygons.shape[1], width=width, height=height)

    kernel, address = loaded(), ctypes.addressof(division)
    room = min(4 * n_cells + LEAST_ROOM, at_once)
    while division.cell < n_cells:
        shares = _room_for(room, index_type)
        _point_to(division, shares)
        division.n, division.room = 0, room
        kernel.kiriko_divide(address)
        if division.n:
            yield _first_of(shares, division.n)
        room = min(2 * room, at_once)


def _room_for(n: int, index_type: type[np.signedinteger]) -> Divided:
    """Arrays for n shares."""
    return Divided(
        np.empty(n, index_type),
        np.empty((n, 2)),
        np.empty((3, n), np.float32),
        np.empty(n),
        np.empty(n),
        np.empty(n, np.int64),
    )


def _point_to(division: ctypes.Structure, shares: Divided) -> None:
    """Let a division put its shares there, as long as these are kept."""
    is_wide = shares.display_index.dtype == np.int64
    pixel, *others = (values.ctypes.data for values in shares)
    division.pixel, division.wide_pixel = (None, pixel) if is_wide else (pixel, None)
    division.view_xy, division.covariance, division.area, division.display_area, division.number = others


def _first_of(shares: Divided, n: int) -> Divided:
    """The first n shares."""
    pixel, view_xy, covariance, area, display_area, number = shares
    return Divided(pixel[:n], view_xy[:n], covariance[:, :n], area[:n], display_area[:n], number[:n])
