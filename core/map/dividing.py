"""Divides cells among display pixels: by the compiled kernel where it can, else by numpy."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ..base.arrays import Floats
from . import native_divide
from .native_divide import Divided
from .rasterise import parts_by_rows
from .shares import index_type

# of a batch; fewer are put together with others
SHARES_AT_ONCE = 1 << 18


class OnDisplay(NamedTuple):
    """Cells to be divided.

    display_size : (width, height), px
    view, display : polygons (n, k, 2), as for `rasterise.parts_by_rows`
    """

    display_size: tuple[int, int]
    view: Floats
    display: Floats


def divided(lots: Sequence[OnDisplay], is_numbered: bool) -> Iterator[tuple[int, Divided]]:
    """The number of a lot and shares of its cells, a few at a
    time; with the number of each share's cell, if asked for.

    The kernel's other threads begin with this call, before the first is asked for.
    """
    if all(native_divide.can_divide(lot.view, lot.display) for lot in lots):
        types = [index_type(lot.display_size) for lot in lots]
        return native_divide.divided(lots, types, SHARES_AT_ONCE, is_numbered)
    return ((n, part) for n, lot in enumerate(lots) for part in parts_by_rows(*lot))
