"""The shares of all cells of a map, a batch at a time."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from .. import kernel
from ..arrays import Floats
from .rasterise import parts_by_rows
from .shares import Shares, index_type

# of a batch; fewer are put together with others
SHARES_AT_ONCE = 1 << 18
FEW_SHARES = 1 << 15
LOTS_AT_ONCE = 4  # of cells, divided side by side: a step of the work
# shares, up to 64 bytes each: more of them are made again each time they are asked for. A ball
# fills a display of 3840 x 2160 with 11 million.
MOST_KEPT = 1 << 24
# of cells: polygons, throughput, path
_Lot = tuple[Floats, Floats, Floats | None, NDArray[np.uint64] | None]


class ShareBatches:
    """The shares of many cells, some at a time: kept where they are
    no more than MOST_KEPT, else made again each time.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    has_throughput, has_path : whether these are to be kept with the shares
    pieces : gives the cells, each time anew, some at a time: polygons and
        throughput, as for `divided`, and path, None where it is not kept
    """

    def __init__(
        self,
        display_size: tuple[int, int],
        view_size: tuple[int, int],
        has_throughput: bool,
        pieces: Callable[[], Iterable[tuple[NDArray, ...]]],
        has_path: bool = False,
    ) -> None:
        self.display_size, self.view_size = display_size, view_size
        self.has_throughput = has_throughput
        self.has_path = has_path
        self._pieces = pieces
        self._kept: list[Shares] | None = None
        self._n = 0
        self.n_sharing = 1  # that share the memory of MOST_KEPT
        # in the pass over all cells that is under way
        self.n_divided = 0  # cells, with those of the lot under way
        self.n_made = 0  # shares
        self.before_lot = 0, 0  # cells and shares

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
        is_large = self.display_size[0] * self.display_size[1] > 4 * SHARES_AT_ONCE

        def lots() -> Iterator[_Lot]:
            for view, display, throughput, path in self._pieces():
                lot = view, display, throughput if self.has_throughput else None, path
                if is_large:
                    order = np.argsort(display[:, 0, 1])
                    lot = tuple(None if values is None else values[order] for values in lot)
                yield lot

        few = []
        n = 0
        before = 0
        self.n_divided = self.n_made = 0

        for some in _by_number(lots(), LOTS_AT_ONCE):
            yield None
            if some is None:
                continue
            n_cells = before + np.cumsum([len(lot[0]) for lot in some])
            before = int(n_cells[-1])

            for number, part in divided(*sizes, some):
                self._count(int(n_cells[number]), len(part))
                if len(part) > FEW_SHARES:
                    yield part
                    continue

                few.append(part)
                n += len(part)
                yield None
                if n >= SHARES_AT_ONCE:
                    yield joined(few)
                    few = []
                    n = 0

        if few:
            yield joined(few)

    def _count(self, n_cells: int, n_shares: int) -> None:
        """So many more shares are made, of a lot that so many cells end with."""
        if n_cells != self.n_divided:
            self.before_lot = self.n_divided, self.n_made
            self.n_divided = n_cells
        self.n_made += n_shares


def _by_number(things: Iterator[_Lot], n: int) -> Iterator[list[_Lot] | None]:
    """n of them at a time; None is a pause while they are gathered."""
    some: list[_Lot] = []
    for thing in things:
        some.append(thing)
        if len(some) < n:
            yield None
            continue
        yield some
        some = []
    if some:
        yield some


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
    display_size: tuple[int, int], view_size: tuple[int, int], lots: Sequence[_Lot]
) -> Iterator[tuple[int, Shares]]:
    """The number of a lot and shares of its cells, a few at
    a time, by the compiled kernel where it can.
    """
    cells = [lot[:2] for lot in lots]
    if all(kernel.can_divide(*of_lot) for of_lot in cells):
        is_numbered = any(values is not None for lot in lots for values in lot[2:])
        parts = kernel.divided(
            display_size, cells, index_type(display_size), SHARES_AT_ONCE, is_numbered
        )
    else:
        parts = (
            (n, part)
            for n, of_lot in enumerate(cells)
            for part in parts_by_rows(display_size, *of_lot)
        )

    for n, (*part, number) in parts:
        of_cell = (None if values is None else values[number] for values in lots[n][2:])
        yield n, Shares(display_size, view_size, *part, *of_cell)
