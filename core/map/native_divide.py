"""Kernel calls to divide cells among display pixels, and to add up shares."""

import ctypes
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, transpose_rows
from ..native.loading import library, loaded, n_threads
from ..native.structures import DivisionStructure, Made, SumStructure

LEAST_CAPACITY = 256  # shares
GUESSED = 256  # cells used to estimate the shares of a lot, at least
CAPACITY_MARGIN = 1.05  # room over the estimate: if it is too small, one thread continues alone


class Divided(NamedTuple):
    """Shares, as in `shares.Shares`, and the cell number (n,) of each, if requested."""

    display_index: NDArray[np.integer]
    view_xy: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats
    number: NDArray[np.int64] | None


def index_type(size: tuple[int, int]) -> type[np.signedinteger]:
    """Integer type for the pixel numbers of an image of a size (width, height)."""
    return np.int32 if size[0] * size[1] <= np.iinfo(np.int32).max else np.int64


def can_divide(view_polygons: Floats, display_polygons: Floats) -> bool:
    """Whether the kernel can divide such cells."""
    shape = np.shape(display_polygons)
    return (
        library() is not None and shape[1:] in {(3, 2), (4, 2)} and np.shape(view_polygons) == shape
    )


def divided(
    display_size: tuple[int, int],
    lots: Sequence[tuple[Floats, Floats]],
    at_once: int,
    is_numbered: bool = True,
) -> Iterator[tuple[int, Divided]]:
    """Shares of cells, at most `at_once` together, and the number of their lot.

    All threads but the caller's start to divide the lots with this call. The caller is free until
    it requests the first shares. Lots come in order.

    Parameters
    ----------
    lots : polygons on the viewer's image and on the display, as for `rasterise.parts_by_rows`
    is_numbered : whether to return the cell number of each share
    """
    # all lots at once, within the estimated room
    pixels = index_type(display_size)
    made = [_lot_of(display_size, *lot) for lot in lots]
    divisions = (DivisionStructure * len(made))(*(lot.structure for lot in made))
    capacities = [
        min(_estimate(display_size, display) + LEAST_CAPACITY, at_once) for _, display in lots
    ]
    shares = [
        _allocate(capacity, pixels, division, is_numbered)
        for capacity, division in zip(capacities, divisions, strict=True)
    ]
    begun = _Begun(divisions, made, shares)
    return _parts_of(begun, pixels, at_once, is_numbered)


class _Begun:
    """Lots in work by other threads, until `end` or until this object is deleted."""

    def __init__(
        self, divisions: ctypes.Array, made: Sequence[Made], shares: list[Divided]
    ) -> None:
        self.divisions, self.made, self.shares = divisions, made, shares
        at = ctypes.addressof(divisions), len(divisions)
        self._work = loaded().kiriko_begin_division(*at, n_threads())
        # holds the arrays of the threads as long as they run
        self._left = finalize(self, _leave, self._work, divisions, made, tuple(shares))

    def end(self) -> None:
        """Divide the remaining lots, and wait for the other threads."""
        self._left.detach()
        loaded().kiriko_end(self._work, 1)
        if not self._work:  # out of memory
            loaded().kiriko_divide(ctypes.addressof(self.divisions), len(self.divisions))


def _leave(work: int | None, *_: object) -> None:
    """Stop the other threads, each after its lot."""
    loaded().kiriko_end(work, 0)


def _parts_of(
    begun: _Begun, pixels: type[np.signedinteger], at_once: int, is_numbered: bool
) -> Iterator[tuple[int, Divided]]:
    """The shares of lots in work."""
    begun.end()
    kernel, shares = loaded(), begun.shares
    # one by one, if a lot needs more room
    for number, division in enumerate(begun.divisions):
        capacity = division.room
        if division.n:
            yield number, _first_of(shares[number], division.n)
        while division.cell < division.n_cells:
            capacity = min(2 * capacity, at_once)
            shares[number] = _allocate(capacity, pixels, division, is_numbered)
            kernel.kiriko_divide(ctypes.addressof(division), 1)
            if division.n:
                yield number, _first_of(shares[number], division.n)


def can_add(
    image: NDArray[np.floating], index: NDArray[np.integer], weights: NDArray[np.floating]
) -> bool:
    """Whether the kernel can add such weights to such an image."""
    is_supported = (
        image.dtype == np.float64
        and index.dtype in (np.int32, np.int64)
        and image.flags.c_contiguous
    )
    return library() is not None and is_supported and index.shape == weights.shape == (len(index),)


def add(*sums: tuple[Floats, NDArray[np.integer] | Floats, Floats]) -> None:
    """Add weights to several different images at once.

    sums : for each an image (h, w), contiguous; pixels (n,), int32 or int64, or places (n, 2), px,
        each counted for the pixel around it, or nearest to it; weights (n,)
    """
    structures = (SumStructure * len(sums))()
    held = []  # until they are added
    for one, (image, where, weights) in zip(structures, sums, strict=True):
        if where.ndim == 2:
            name, where = "places", np.ascontiguousarray(where, float)
        else:
            name = "wide_pixel" if where.dtype == np.int64 else "pixel"
            where = np.ascontiguousarray(where)
        weights = np.ascontiguousarray(weights, float)
        held += where, weights
        setattr(one, name, where.ctypes.data)
        one.weights, one.n, one.image = weights.ctypes.data, len(weights), image.ctypes.data
        one.height, one.width = image.shape
    loaded().kiriko_add(ctypes.addressof(structures), len(sums), n_threads())


def find_across(lines: Floats, polygons: Floats, on_line: float) -> NDArray[np.int64]:
    """Indices of polygons (n, k, 2) on both sides of an outline, as in `outline.py`.

    lines : (l, 3) of the outline; on_line : a corner nearer than this to a line is on it
    """
    lines, polygons = (np.ascontiguousarray(values, float) for values in (lines, polygons))
    n, k, _ = polygons.shape
    found = np.empty(n, np.int64)
    of_lines = lines.ctypes.data, len(lines), on_line
    n_found = loaded().kiriko_find_across(polygons.ctypes.data, n, k, *of_lines, found.ctypes.data)
    return found[:n_found]


def _lot_of(display_size: tuple[int, int], view_polygons: Floats, display_polygons: Floats) -> Made:
    made = Made(DivisionStructure)
    width, height = display_size
    made.point("view", view_polygons, float)
    made.point("display", display_polygons, float)
    made.set(
        n_cells=len(display_polygons),
        n_corners=display_polygons.shape[1],
        width=width,
        height=height,
    )

    return made


def _estimate(display_size: tuple[int, int], polygons: Floats) -> int:
    """Upper estimate of the number of shares of polygons (n, k, 2) on the display, from some of
    them.

    The box around one, w wide and h high, touches (w + 1) (h + 1) pixels on average.
    """
    n = len(polygons)
    some = polygons[:: 1 + n // GUESSED]
    by_corner = transpose_rows(some)
    low, high = np.minimum.reduce(by_corner), np.maximum.reduce(by_corner)
    size = np.array(display_size)[:, None]
    with np.errstate(invalid="ignore"):
        width, height = np.clip(high, 0, size) - np.clip(low, 0, size)
        is_seen = ((high > 0) & (low < size)).all(axis=0)
        touched = np.where(is_seen, (width + 1) * (height + 1), 0)
    return int(CAPACITY_MARGIN * n * np.nan_to_num(touched).sum() / max(len(some), 1))


def _allocate(
    n: int, pixels: type[np.signedinteger], division: ctypes.Structure, is_numbered: bool
) -> Divided:
    """Arrays for n shares, as output of a division; they must live as long as it runs."""
    shares = Divided(
        np.empty(n, pixels),
        np.empty((n, 2)),
        np.empty((3, n), np.float32),
        np.empty(n),
        np.empty(n),
        np.empty(n, np.int64) if is_numbered else None,
    )

    pixel, *others = (None if values is None else values.ctypes.data for values in shares)
    division.pixel, division.wide_pixel = (None, pixel) if pixels is np.int64 else (pixel, None)
    division.view_xy, division.covariance, division.area, division.display_area, division.number = (
        others
    )
    division.n, division.room = 0, n

    return shares


def _first_of(shares: Divided, n: int) -> Divided:
    """The first n shares; copies if most of the room is empty, to free it."""
    is_empty = 2 * n < len(shares.area)

    def first(values: NDArray | None) -> NDArray | None:
        """The first n along the last axis; places are rows."""
        if values is None:
            return None
        some = values[:n] if values is shares.view_xy else values[..., :n]
        return some.copy() if is_empty else some

    return Divided(*map(first, shares))
