"""Where rays ended, and why not on the display."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from .plate import PlatePath

Words = NDArray[np.uint64]


class Reason(IntEnum):
    """Why a ray has no landing; 0 when it has one."""

    ARRIVED = 0
    MISSED_GLASS = 1
    LOST_INSIDE = 2
    MISSED_PLATE = 3
    BLOCKED = 4
    MISSED_DISPLAY = 5
    CUT_OFF = 6


REASON_WORDS = {
    Reason.MISSED_GLASS: Message("missed the glass"),
    Reason.LOST_INSIDE: Message("lost inside the glass"),
    Reason.MISSED_PLATE: Message("missed the plate"),
    Reason.BLOCKED: Message("blocked"),
    Reason.MISSED_DISPLAY: Message("missed the display"),
    Reason.CUT_OFF: Message("cut off by Max Events"),
}
BY_GAPS = Message("passed gaps in the glass")  # in place of the reason: nobody knows such a way


@dataclass(frozen=True, eq=False)
class Landings:
    """Where and how the rays end, in any order: a ray may have one landing, several, or none.

    sample (n,) index of the ray asked for; reason (n,) of Reason; branch (n,) uint64, 0 where there
    is no landing; xy (n, 2) display pixels, x right and y down from the top left corner, NaN
    without a landing; positions and directions (n, 3) of the end, m, world; throughput (n,) of
    basic radiance; n_events (n,); plate_path (n,) of PlatePath; leak (n,) the part through whose
    gap a ray went in or out, -1 for none

    A ray that only just missed a flat display has branch and xy all the same, beyond the image: the
    cells at the display's border can then be cut there exactly. So has one that came to the display
    beside the glass, where the settings look beside it.
    """

    sample: Ints
    reason: np.ndarray
    branch: np.ndarray
    xy: Floats
    positions: Floats
    directions: Floats
    throughput: Floats
    n_events: Ints
    plate_path: np.ndarray
    leak: Ints

    def at(self, some: Ints | Bools) -> "Landings":
        """Some of the landings."""
        return Landings(*(getattr(self, name)[some] for name in Landings.__dataclass_fields__))

    @property
    def has_arrived(self) -> Bools:
        return self.reason == Reason.ARRIVED

    @property
    def is_beside_glass(self) -> Bools:
        """Did light come beside the glass, by way of the plate where one is
        needed? None did where the settings do not look beside it.
        """
        return (self.reason == Reason.MISSED_GLASS) & (self.branch != 0)

    def pixels(self, width: int, height: int) -> tuple[Bools, Ints]:
        """Which (n,) are on the display's image of a size, and at
        which of its pixels, row by row; 0 for the others.
        """
        return self._pixels_of(self.has_arrived, width, height)

    def pixels_beside(self, width: int, height: int) -> tuple[Bools, Ints]:
        """The same of light beside the glass."""
        return self._pixels_of(self.is_beside_glass, width, height)

    def _pixels_of(self, some: Bools, width: int, height: int) -> tuple[Bools, Ints]:
        with np.errstate(invalid="ignore"):
            is_seen = some & (self.xy >= 0).all(axis=1) & (self.xy < (width, height)).all(axis=1)
        column, row = np.where(is_seen[:, None], self.xy, 0).astype(np.int64).T
        return is_seen, row * width + column


def join(parts: list[Landings]) -> Landings:
    """Landings of consecutive chunks as one."""
    return Landings(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in Landings.__dataclass_fields__
        )
    )


def main_of(landings: Landings, n_rays: int, expected: Words | None = None) -> Ints:
    """The main landing (n,) of each of n rays, by number; -1 for a ray that has none.

    A landing that has a place comes before one that has none, one on the display before one beside
    it, then the one with the largest throughput, then the one whose branch has the smallest number.
    The choice does not depend on the order in which landings are listed.

    expected : (n,) branches, where they are known: a landing on its ray's comes before all others
    """
    is_other = np.zeros(len(landings.sample), bool)
    if expected is not None:
        is_other = landings.branch != expected[landings.sample]

    # the last counts most
    order = np.lexsort((
        landings.branch,
        -landings.throughput,
        ~landings.has_arrived,
        landings.branch == 0,
        is_other,
        landings.sample,
    ))  # fmt: skip
    with_one, first = np.unique(landings.sample[order], return_index=True)
    main = np.full(n_rays, -1)
    main[with_one] = order[first]
    return main


def main_landings(landings: Landings, n_rays: int, expected: Words | None = None) -> Landings:
    """The main landing of each of n rays, in their order, as by `main_of`. A ray that has none
    missed the display: its throughput is 0, its end unknown.
    """
    if len(landings.sample) == n_rays and (landings.sample == np.arange(n_rays)).all():
        return landings

    main = main_of(landings, n_rays, expected)
    with_one = np.flatnonzero(main >= 0)

    unknown = Landings(
        sample=np.arange(n_rays),
        reason=np.full(n_rays, Reason.MISSED_DISPLAY, landings.reason.dtype),
        branch=np.zeros(n_rays, np.uint64),
        xy=np.full((n_rays, 2), np.nan),
        positions=np.full((n_rays, 3), np.nan),
        directions=np.full((n_rays, 3), np.nan),
        throughput=np.zeros(n_rays),
        n_events=np.zeros(n_rays, np.int64),
        plate_path=np.full(n_rays, PlatePath.NONE, landings.plate_path.dtype),
        leak=np.full(n_rays, -1, np.int64),
    )
    for name in Landings.__dataclass_fields__:
        getattr(unknown, name)[with_one] = getattr(landings, name)[main[with_one]]

    return unknown
