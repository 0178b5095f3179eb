"""Rays under way: their places, their media, and the branch they have come along."""

from typing import Literal, NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints
from .landings import Reason, Words
from .plate import PlatePath

PlateLight = Literal["imaged", "folded", "reflected"]


class ReachedError(Exception):
    """A ray comes near glass that stands aside, not in the
    plan: `boxes`, numbers in the plan's `aside`.
    """

    def __init__(self, boxes: set[int]) -> None:
        super().__init__(boxes)
        self.boxes = boxes


# numbers that make up a branch: any odd multiplier mixes; it is the golden ratio's 64 bits
_MIX = np.uint64(0x9E3779B97F4A7C15)
# Events; the last three by a face's own normal, where its bent one fails: light jumps from one to
# the other. Of a patch there are eight at the most.
PASS, TIR, PLATE, MIRROR, LAND, FACE_PASS, FACE_TIR, FACE_MIRROR = range(1, 9)


class Rays:
    """The state of the rays of one batch; `live` are those still under way.

    A ray that splits goes on in copies, `n_copies` at the most. All have rows of their own: first
    those of the rays asked for, then the first copy of each, and so on.
    """

    def __init__(
        self,
        origins: Floats,
        directions: Floats,
        course: Words | None,
        is_recorded: bool,
        light: PlateLight = "imaged",
        n_copies: int = 0,
    ) -> None:
        self.n_asked, self.n_copies = len(origins), n_copies
        n = (1 + n_copies) * len(origins)
        if n_copies:
            origins, directions = (np.tile(x, (1 + n_copies, 1)) for x in (origins, directions))
        self.positions = np.array(origins, float, order="C")
        self.directions = np.array(directions, float, order="C")

        # where they are, in which media
        self.mask = np.zeros(n, np.uint64)
        self.cluster = np.zeros(n, np.int64)

        # their result
        self.reason = np.full(n, Reason.CUT_OFF, np.uint8)  # of those still under way in the end
        self.branch = np.zeros(n, np.uint64)
        self.xy = np.full((n, 2), np.nan)
        self.throughput = np.ones(n)
        self.n_events = np.zeros(n, np.int64)

        # parts they have met
        self.has_met_glass = np.zeros(n, bool)
        self.has_met_plate = np.zeros(n, bool)
        self.plate_path = np.full(n, PlatePath.NONE, np.uint8)
        self.light = light
        self.last_part = np.full(n, -1, np.int64)
        self.leak = np.full(n, -1, np.int64)

        # the course that they keep to, or that is recorded
        self.live = np.arange(self.n_asked)
        self.is_begun = np.arange(n) < self.n_asked  # is there such a copy?
        self.born = np.empty(0, np.int64)  # copies that are not live yet
        self.course = course
        self.is_recorded = is_recorded
        self.n_words = np.zeros(n, np.int64)
        self.is_astray = np.zeros(n, bool)
        self.has_ended = np.zeros(n, bool)

    def begin_again(self, some: slice, origins: Floats, directions: Floats) -> None:
        """Let some of these rays be as they were when they began."""
        fresh = Rays(origins, directions, None, False, n_copies=self.n_copies)
        for name, values in fresh._rows().items():
            self._by_copy(getattr(self, name))[:, some] = fresh._by_copy(values)
        if self.is_recorded:
            self._by_copy(self.course)[:, some] = 0

    def split(self, rays: Ints) -> tuple[Ints, Ints]:
        """Let some rays go two ways: which (m,) of them (n,) have copies left, and the rows (m,) of
        copies as these rays are now.
        """
        copies = np.full(len(rays), -1)
        for first in range(self.n_asked, len(self.mask), self.n_asked):
            row = first + rays % self.n_asked
            free = np.flatnonzero((copies < 0) & ~self.is_begun[row])
            # two copies of one ray may split at the same time
            free = free[np.unique(row[free], return_index=True)[1]]
            copies[free] = row[free]
            self.is_begun[row[free]] = True

        splits = np.flatnonzero(copies >= 0)
        for values in self._rows().values():
            values[copies[splits]] = values[rays[splits]]
        if self.is_recorded:
            self.course[copies[splits]] = self.course[rays[splits]]
        self.born = np.concatenate([self.born, copies[splits]])
        return splits, copies[splits]

    def _rows(self) -> dict[str, np.ndarray]:
        """All arrays that have a row for each ray and copy."""
        others = "live", "born", "course"
        arrays = {k: x for k, x in vars(self).items() if isinstance(x, np.ndarray)}
        return {name: values for name, values in arrays.items() if name not in others}

    def _by_copy(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(1 + self.n_copies, self.n_asked, *values.shape[1:])

    def add_to_branch(self, rays: Ints, patch: Ints, event: Ints | int) -> None:
        with np.errstate(over="ignore"):
            word = (patch * 8 + event + 1).astype(np.uint64)
            mixed = (self.branch[rays] ^ word) * _MIX
            self.branch[rays] = mixed ^ (mixed >> np.uint64(29))

        if self.course is None:
            return

        # the course: recorded, or compared
        n_words = self.n_words[rays]
        width = self.course.shape[1]

        if self.is_recorded:
            if n_words.max(initial=0) >= width:
                self.course = np.pad(self.course, ((0, 0), (0, width)))
            self.course[rays, n_words] = self.branch[rays]
        else:
            expected = np.where(
                n_words < width,
                self.course[rays % self.n_asked, np.minimum(n_words, width - 1)],
                np.uint64(0),
            )
            self.is_astray[rays] = expected != self.branch[rays]
            self.has_ended[rays] |= self.is_astray[rays]

        self.n_words[rays] += 1


class Step(NamedTuple):
    """Rays between two events: those that met something, where and on which patch; and the others.

    rays (h,) and left (l,) indices; place (h, 3), patch and
    triangle (h,) of the surface; start and direction (l, 3)
    """

    rays: Ints
    place: Floats
    patch: Ints
    triangle: Ints
    left: Ints
    start: Floats
    direction: Floats
