"""Shares: the parts of the viewer's image from which each display pixel is seen.

A cell is a small polygon on the viewer's image together with its image on the display. It makes a
share for each display pixel with a part of its image (rasterise.py). The shares of all cells of a
map are made in batches.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints, take
from ..native import loading
from ..rig.views import Views
from . import native_divide, rasterise
from .native_divide import Divided, index_type

FEW_SHARES = 1 << 14
LOTS_AT_ONCE = 8  # of cells, divided side by side in one step
LOTS_AT_FIRST = 2  # then twice as many each time: other threads start soon
# shares, up to 64 bytes each: more are not cached, but made again for each use. A ball fills a
# display of 3840 x 2160 with 11 million.
MOST_CACHED = 1 << 24


@dataclass(frozen=True, eq=False)
class Shares:
    """Sparse matrix between viewer and display: one entry for each part of a cell in one display
    pixel.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    display_index : (n,) int32 or int64, row * width + column on the display, row 0 at the top
    view_xy : (n, 2) float64, viewer px, centroid on the viewer's image. A share may be a thousandth
        of a pixel wide; single precision resolves only 2e-4 px at 4096.
    covariance : (3, n) float32, viewer px^2: xx, xy and yy of the share's points on the viewer's
        image, evenly spread
    area : (n,) float64, viewer px^2, on the viewer's image
    display_area : (n,) float64, display px^2, on the display
    throughput : (n,) float64, or None if it is 1 everywhere
    path : (n,) uint64, path of the light, or None if not requested
    """

    display_size: tuple[int, int]
    view_size: tuple[int, int]
    display_index: NDArray[np.integer]
    view_xy: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats
    throughput: Floats | None = None
    path: NDArray[np.uint64] | None = None

    def at(self, which: NDArray) -> "Shares":
        def some(values: NDArray | None) -> NDArray | None:
            return None if values is None else values[..., which]

        return Shares(
            self.display_size,
            self.view_size,
            self.display_index[which],
            take(self.view_xy, which),
            *(
                some(v)
                for v in (self.covariance, self.area, self.display_area, self.throughput, self.path)
            ),
        )

    def __len__(self) -> int:
        return len(self.area)

    @property
    def weight(self) -> Floats:
        """Weight (n,) of each share in its display pixel: area * throughput^2, viewer px^2."""
        return self.area if self.throughput is None else self.area * self.throughput**2

    @property
    def view_index(self) -> NDArray[np.integer]:
        """Viewer pixel (n,), int32 or int64, around each share's centroid: row * width + column."""
        width, height = self.view_size
        column, row = self.view_xy.T.astype(index_type(self.view_size))
        return np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)


class Coverage:
    """How much display and viewer see of each other: sums over shares. Add all shares before use.

    weight : (H, W) sum of the weights of the shares each display pixel shows, viewer px^2
    """

    def __init__(self, display_size: tuple[int, int], view_size: tuple[int, int]) -> None:
        self.weight, self._display, self._view = (
            np.zeros(size[::-1]) for size in (display_size, display_size, view_size)
        )

    def add(self, shares: Shares, shown: Shares | None = None) -> None:
        """Add some of the shares.

        shown : the subset shown by the display, if it does not show all
        """
        shown = shares if shown is None else shown
        if loading.library() is not None:
            native_divide.add(
                (self.weight, shown.display_index, shown.weight),
                (self._display, shares.display_index, shares.display_area),
                (self._view, shares.view_xy, shares.area),
            )
            return
        add_at(self.weight, shown.display_index, shown.weight)
        add_at(self._display, shares.display_index, shares.display_area)
        add_at(self._view, shares.view_index, shares.area)

    @cached_property
    def of_display(self) -> Floats:
        """Part (H, W) of each display pixel seen by the viewer, 0..1.

        Areas seen several times count once.
        """
        return np.minimum(self._display, 1.0, out=self._display)

    @cached_property
    def of_view(self) -> Floats:
        """Part (h, w) of each viewer pixel connected to the display, 0..1."""
        return np.minimum(self._view, 1.0, out=self._view)


def add_at(image: Floats, index: NDArray[np.integer], weights: NDArray[np.floating]) -> None:
    """Add weights (n,) to the pixels (n,) of an image (h, w): row * width + column."""
    if native_divide.can_add(image, index, weights):
        native_divide.add((image, index, weights))
    elif len(index):
        # a batch of shares may lie in a few rows of a large image
        first = int(index.min())
        last = int(index.max())
        image.reshape(-1)[first : last + 1] += np.bincount(index - first, weights)


Begun = tuple[
    list[int], Iterator[tuple[int, Shares]]
]  # number of cells in each lot, and the shares


class Lot(NamedTuple):
    """Some cells.

    view, display : polygons (n, k, 2), px
    throughput, path : (n,), None if not needed
    beam : (n, 3, 2) among the display's views, as in `Piece`; None without views
    """

    view: Floats
    display: Floats
    throughput: Floats | None = None
    path: NDArray[np.uint64] | None = None
    beam: Floats | None = None

    def at(self, which: Ints) -> "Lot":
        return Lot(*(None if values is None else take(values, which) for values in self))


class ShareBatches:
    """Shares of many cells, in batches: cached up to MOST_CACHED, else made again for each use.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    has_throughput, has_path : whether shares have these
    pieces : returns the cells, in batches: polygons and throughput, as for `divided`, and path and
        beam, None if not needed
    views : of the display, each of display_size, which becomes the size of their quilt; None for
        none
    """

    def __init__(
        self,
        display_size: tuple[int, int],
        view_size: tuple[int, int],
        has_throughput: bool,
        pieces: Callable[[], Iterable[tuple[NDArray, ...]]],
        has_path: bool = False,
        views: Views | None = None,
    ) -> None:
        self.tile_size, self.view_size, self.views = display_size, view_size, views
        self.display_size = display_size if views is None else views.quilt_size(display_size)
        self.has_throughput = has_throughput
        self.has_path = has_path
        self._pieces = pieces
        self._cached: list[Shares] | None = None
        self._n = 0
        self.n_sharing = 1  # batches in the memory of MOST_CACHED
        self.n_divided = 0  # cells, in the current pass

    def __len__(self) -> int:
        """Number of shares, once all of them were made."""
        return self._n

    @property
    def are_cached(self) -> bool:
        """Whether all shares are made and cached."""
        return self._cached is not None

    def share_memory(self, n: int) -> None:
        """Limit the cache to an n-th of MOST_CACHED."""
        self.n_sharing = n
        if self.are_cached and len(self) > MOST_CACHED // n:
            self.let_go()

    def let_go(self) -> None:
        """Clear the cache: shares are made again for their next use."""
        self._cached = None

    def __iter__(self) -> Iterator[Shares]:
        return (shares for shares in self.pausing() if shares is not None)

    def pausing(self) -> Iterator[Shares | None]:
        """All batches; None is a pause before the next one."""
        if self.are_cached:
            yield from self._cached
            return

        n = 0
        cached = []
        most = MOST_CACHED // self.n_sharing

        for shares in self._made():
            if shares is not None:
                n += len(shares)
                cached = [*cached, shares] if n <= most else []
            yield shares

        self._n = n
        if n <= most:
            self._cached = cached

    def _made(self) -> Iterator[Shares | None]:
        """Divide all cells; small batches are joined with the next; None is a pause."""
        sizes = self.tile_size, self.view_size
        # on a large display cells are sorted from top to bottom: a batch then lies in a few rows,
        # and `add_at` has less to add
        is_large = self.tile_size[0] * self.tile_size[1] > 4 * rasterise.SHARES_AT_ONCE

        def lots() -> Iterator[Lot]:
            for view, display, throughput, *others in self._pieces():
                lot = Lot(view, display, throughput if self.has_throughput else None, *others)
                if is_large:
                    lot = lot.at(np.argsort(display[:, 0, 1]))
                yield lot

        few = []
        n = 0
        before = 0
        self.n_divided = 0

        begun = (
            None
            if some is None
            else ([len(lot.view) for lot in some], divided(*sizes, some, self.views))
            for some in _by_number(lots())
        )
        for some in _one_ahead(begun):
            yield None
            if some is None:
                continue
            n_cells = before + np.cumsum(some[0])
            before = int(n_cells[-1])

            for number, part in some[1]:
                self.n_divided = int(n_cells[number])
                if len(part) > FEW_SHARES:
                    yield part
                    continue

                few.append(part)
                n += len(part)
                yield None
                if n >= rasterise.SHARES_AT_ONCE:
                    yield joined(few)
                    few = []
                    n = 0

        if few:
            yield joined(few)


def _by_number(things: Iterator[Lot]) -> Iterator[list[Lot] | None]:
    """Lots in groups of growing size, up to LOTS_AT_ONCE; None is a pause while one is gathered."""
    n = min(LOTS_AT_FIRST, LOTS_AT_ONCE)
    some: list[Lot] = []
    for thing in things:
        some.append(thing)
        if len(some) < n:
            yield None
            continue
        yield some
        some = []
        n = min(2 * n, LOTS_AT_ONCE)
    if some:
        yield some


def _one_ahead(things: Iterator[Begun | None]) -> Iterator[Begun | None]:
    """Each item after the next has begun, so other threads work on it while this one is used. None
    is a pause.
    """
    waiting = None
    for thing in things:
        if thing is not None:
            thing, waiting = waiting, thing
        yield thing
    yield waiting


def joined(parts: Sequence[Shares]) -> Shares:
    """Join one or more sets of shares of the same sizes."""
    if len(parts) == 1:
        return parts[0]

    def joined(name: str, axis: int = 0) -> NDArray | None:
        values = [getattr(part, name) for part in parts]
        return None if values[0] is None else np.concatenate(values, axis=axis)

    return Shares(
        parts[0].display_size,
        parts[0].view_size,
        joined("display_index"),
        joined("view_xy"),
        joined("covariance", axis=1),
        *map(joined, ("area", "display_area", "throughput", "path")),
    )


def divided(
    display_size: tuple[int, int],
    view_size: tuple[int, int],
    lots: Sequence[Lot],
    views: Views | None = None,
) -> Iterator[tuple[int, Shares]]:
    """Shares of lots of cells, a few at a time, with the number of the lot.

    Other threads start with this call, before the first shares are requested.

    views : of the display, each of its size; shares are then of the quilt
    """
    is_numbered = any(values is not None for lot in lots for values in lot[2:])
    parts = rasterise.divided(display_size, [lot[:2] for lot in lots], is_numbered)
    return _shares_of(parts, (display_size, view_size), lots, views)


def _shares_of(
    parts: Iterator[tuple[int, Divided]],
    sizes: tuple[tuple[int, int], tuple[int, int]],
    lots: Sequence[Lot],
    views: Views | None,
) -> Iterator[tuple[int, Shares]]:
    for n, (*part, number) in parts:
        *of_cell, beam = (None if values is None else values[number] for values in lots[n][2:])
        shares = Shares(*sizes, *part, *of_cell)
        yield n, shares if views is None else in_views(shares, beam, views)


def in_views(shares: Shares, beam: Floats, views: Views) -> Shares:
    """Shares of a view's image as shares of the quilt: each in the view of its light, or divided
    between views that overlap, or lost outside the cone.

    beam : (n, 3, 2), as in `Piece`, evaluated at their centroids
    """
    x, y = shares.view_xy.T[..., None]
    xx, xy, yy = shares.covariance[..., None]
    by_x, by_y, start = np.moveaxis(beam, 1, 0)
    # of an interval with the variance of the beam within the share, which a border may cut
    spread = np.sqrt(12 * np.maximum(by_x**2 * xx + 2 * by_x * by_y * xy + by_y**2 * yy, 0))
    size = shares.display_size
    quilt = views.quilt_size(size)
    parts = []
    for rays, view, weight in views.shown(by_x * x + by_y * y + start, spread):
        some = shares.at(rays)
        pixel = views.in_quilt(some.display_index.astype(np.int64), view, size)
        parts.append(
            replace(
                some,
                display_size=quilt,
                display_index=pixel.astype(index_type(quilt)),
                area=some.area * weight,
                display_area=some.display_area * weight,
            )
        )
    return joined(parts)
