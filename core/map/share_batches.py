"""The shares of all cells of a map, a batch at a time."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints, each_value, taken
from . import dividing
from .decimation import Thinning, in_pixels
from .dividing import OnDisplay
from .native_divide import Divided
from .shares import Shares

FEW_SHARES = 1 << 14
LOTS_AT_ONCE = 8  # of cells, divided side by side: a step of the work
LOTS_AT_FIRST = 2  # then twice as many each time, so that other threads are soon at work
# shares, up to 64 bytes each: more of them are made again each time they are asked for. A ball
# fills a display of 3840 x 2160 with 11 million.
MOST_KEPT = 1 << 24

Begun = tuple[list[int], Iterator[tuple[int, Shares]]]  # numbers of lots' cells, and the shares


class Lot(NamedTuple):
    """Some cells.

    view, display : polygons (n, k, 2), px
    throughput, path : (n,), None where they are not kept
    stride : px; of each square of so many each way one pixel takes their light, 1 for all
    """

    view: Floats
    display: Floats
    throughput: Floats | None = None
    path: NDArray[np.uint64] | None = None
    stride: int = 1

    def at(self, which: Ints) -> "Lot":
        """Some of them."""
        return Lot(
            *(None if values is None else taken(values, which) for values in self[:-1]), self.stride
        )


class ShareBatches:
    """The shares of many cells, some at a time: kept where they are
    no more than MOST_KEPT, else made again each time.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    has_throughput, has_path : whether these are to be kept with the shares
    pieces : gives the cells, each time anew, some at a time: polygons and
        throughput, as for `divided`, and path, None where it is not kept
    thinning : of those that spread far, None where none are too many
    """

    def __init__(
        self,
        display_size: tuple[int, int],
        view_size: tuple[int, int],
        has_throughput: bool,
        pieces: Callable[[], Iterable[tuple[NDArray, ...]]],
        has_path: bool = False,
        thinning: Thinning | None = None,
    ) -> None:
        self.display_size, self.view_size = display_size, view_size
        self.has_throughput = has_throughput
        self.has_path = has_path
        self._pieces = pieces
        self._thinning = thinning
        self._kept: list[Shares] | None = None
        self._n = 0
        self.n_sharing = 1  # that share the memory of MOST_KEPT
        self.n_divided = 0  # cells, in the pass over all that is under way

    def __len__(self) -> int:
        """Number of shares, after they were all made once."""
        return self._n

    @property
    def are_kept(self) -> bool:
        """Were they all made, and no more than are kept?"""
        return self._kept is not None

    def share_memory(self, n: int) -> None:
        """Keep no more than what n batches like these may keep each."""
        self.n_sharing = n
        if self.are_kept and len(self) > MOST_KEPT // n:
            self.let_go()

    def let_go(self) -> None:
        """Keep none: they are made again when they are asked for."""
        self._kept = None

    def __iter__(self) -> Iterator[Shares]:
        return (shares for shares in self.pausing() if shares is not None)

    def pausing(self) -> Iterator[Shares | None]:
        """All batches; None is a pause in the making of the next."""
        if self.are_kept:
            yield from self._kept
            return

        n = 0
        kept = []
        most = MOST_KEPT // self.n_sharing

        for shares in self._made():
            if shares is not None:
                n += len(shares)
                kept = [*kept, shares] if n <= most else []
            yield shares

        self._n = n
        if n <= most:
            self._kept = kept

    def _made(self) -> Iterator[Shares | None]:
        """Divide all cells; few shares at a time are put together with the next; None is a
        pause.
        """
        sizes = self.display_size, self.view_size
        # on a large display cells go from top to bottom: most batches
        # lie in a few rows, and `add_at` has less to add
        is_large = self.display_size[0] * self.display_size[1] > 4 * dividing.SHARES_AT_ONCE

        def lots() -> Iterator[Lot]:
            for view, display, throughput, path in self._pieces():
                lot = Lot(view, display, throughput if self.has_throughput else None, path)
                if is_large:
                    lot = lot.at(np.argsort(display[:, 0, 1]))
                yield from self._thinned(lot)

        few = []
        n = 0
        before = 0
        self.n_divided = 0

        begun = (
            None if some is None else ([len(lot.view) for lot in some], divided(*sizes, some))
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
                if n >= dividing.SHARES_AT_ONCE:
                    yield joined(few)
                    few = []
                    n = 0

        if few:
            yield joined(few)

    def _thinned(self, lot: Lot) -> Iterator[Lot]:
        """A lot, parted by the strides of its cells. Quads are never thinned: they are of smooth
        cells, or as large as pixels.
        """
        if self._thinning is None or lot.display.shape[1] > 3:
            yield lot
            return
        for stride, which in each_value(self._thinning.strides(lot.view, lot.display)):
            yield lot.at(which)._replace(stride=int(stride))


def _by_number(things: Iterator[Lot]) -> Iterator[list[Lot] | None]:
    """Ever more of them at a time, as far as LOTS_AT_ONCE; None is a pause while they are
    gathered.
    """
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
    """Each of them after the next has begun, which other threads work on while this one is used.
    None is a pause.
    """
    waiting = None
    for thing in things:
        if thing is not None:
            thing, waiting = waiting, thing
        yield thing
    yield waiting


def joined(parts: Sequence[Shares]) -> Shares:
    """Shares of the same sizes, one part or more, in one."""
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
    display_size: tuple[int, int], view_size: tuple[int, int], lots: Sequence[Lot]
) -> Iterator[tuple[int, Shares]]:
    """The number of a lot and shares of its cells, a few at a time.

    Other threads begin with this call, before any are asked for.
    """
    is_numbered = any(
        lot.stride > 1 or lot.throughput is not None or lot.path is not None for lot in lots
    )
    cells = [_on_display(display_size, lot) for lot in lots]
    parts = dividing.divided(cells, is_numbered)
    return _shares_of(parts, (display_size, view_size), lots)


def _shares_of(
    parts: Iterator[tuple[int, Divided]],
    sizes: tuple[tuple[int, int], tuple[int, int]],
    lots: Sequence[Lot],
) -> Iterator[tuple[int, Shares]]:
    for n, part in parts:
        lot = lots[n]
        if lot.stride > 1:
            part = in_pixels(part, lot.view, lot.stride, sizes[0])
        *part, number = part
        of_cell = (None if values is None else values[number] for values in lot[2:4])
        yield n, Shares(*sizes, *part, *of_cell)


def _on_display(display_size: tuple[int, int], lot: Lot) -> OnDisplay:
    """Cells on the display, or on one of pixels as large as their stride."""
    if lot.stride == 1:
        return OnDisplay(display_size, lot.view, lot.display)
    width, height = (-(-n // lot.stride) for n in display_size)
    return OnDisplay((width, height), lot.view, lot.display / lot.stride)
