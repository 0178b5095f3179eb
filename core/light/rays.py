"""Rays being traced, with their branches, and their landings: where each ended, and why."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from ..rig.parts import Preference
from . import polarisation
from .plate import PlatePath
from .polarisation import Amplitudes, Passed

Words = NDArray[np.uint64]


class Reason(IntEnum):
    """Why a ray has no landing; 0 if it has one."""

    ARRIVED = 0
    MISSED_GLASS = 1
    LOST_INSIDE = 2
    MISSED_PLATE = 3
    BLOCKED = 4
    MISSED_DISPLAY = 5
    CUT_OFF = 6
    OUTSIDE_CONE = 7  # of a display's views


REASON_WORDS = {
    Reason.MISSED_GLASS: Message("missed the glass"),
    Reason.LOST_INSIDE: Message("lost inside the glass"),
    Reason.MISSED_PLATE: Message("missed the plate"),
    Reason.BLOCKED: Message("blocked"),
    Reason.MISSED_DISPLAY: Message("missed the display"),
    Reason.CUT_OFF: Message("cut off by Max Events"),
    Reason.OUTSIDE_CONE: Message("outside the cone of the views"),
}
BY_GAPS = Message("went through gaps in the glass")  # instead of a reason


@dataclass(frozen=True, eq=False)
class Landings:
    """Ends of rays, in any order: a ray may have one landing, several, or none.

    sample : (n,) index of the traced ray
    reason : (n,) of Reason
    branch : (n,) uint64, 0 without a landing
    xy : (n, 2) display pixels, x right and y down from the top left corner; NaN without a landing
    positions, directions : (n, 3) at the end, m, world
    throughput : (n,) of basic radiance
    n_events : (n,)
    rank : (n,) turns onto a path that is not preferred, where light splits
    plate_path : (n,) of PlatePath
    leak : (n,) the part through whose gap the ray passed, -1 for none

    A ray that narrowly misses a flat display also has branch and xy, beyond the image, so cells at
    the display's border can be cut exactly. So does a ray that reaches the display past the glass,
    if the settings follow such light.
    """

    sample: Ints
    reason: np.ndarray
    branch: np.ndarray
    xy: Floats
    positions: Floats
    directions: Floats
    throughput: Floats
    n_events: Ints
    rank: Ints
    plate_path: np.ndarray
    leak: Ints

    def at(self, some: Ints | Bools) -> "Landings":
        """Some of the landings."""
        return Landings(*(getattr(self, name)[some] for name in Landings.__dataclass_fields__))

    @property
    def has_arrived(self) -> Bools:
        return self.reason == Reason.ARRIVED

    @property
    def is_past_glass(self) -> Bools:
        """Whether light passed by the glass, via the plate if one is required; False if the
        settings do not follow such light.
        """
        return (self.reason == Reason.MISSED_GLASS) & (self.branch != 0)

    def pixels(self, width: int, height: int) -> tuple[Bools, Ints]:
        """Which (n,) are on the display's image, and their pixels, row by row; 0 for the others."""
        return self._pixels_of(self.has_arrived, width, height)

    def pixels_past_glass(self, width: int, height: int) -> tuple[Bools, Ints]:
        """The same for light past the glass."""
        return self._pixels_of(self.is_past_glass, width, height)

    def _pixels_of(self, some: Bools, width: int, height: int) -> tuple[Bools, Ints]:
        with np.errstate(invalid="ignore"):
            is_seen = some & (self.xy >= 0).all(axis=1) & (self.xy < (width, height)).all(axis=1)
        column, row = np.where(is_seen[:, None], self.xy, 0).astype(np.int64).T
        return is_seen, row * width + column


def join(parts: list[Landings]) -> Landings:
    """Concatenate landings of consecutive chunks."""
    return Landings(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in Landings.__dataclass_fields__
        )
    )


def main_of(landings: Landings, n_rays: int, expected: Words | None = None) -> Ints:
    """Index (n,) of each ray's main landing; -1 without one.

    Preferred in order: its expected branch, a place on the display plane, arrival on the display,
    the smallest rank, the largest throughput; among equals the transmitted light, which comes first
    in the order of `Rays`.

    expected : (n,) branches, if available
    """
    is_other = np.zeros(len(landings.sample), bool)
    if expected is not None:
        is_other = landings.branch != expected[landings.sample]

    # the last key is the most significant
    order = np.lexsort((
        -np.round(landings.throughput, 9),
        landings.rank,
        ~landings.has_arrived,
        landings.branch == 0,
        is_other,
        landings.sample,
    ))  # fmt: skip
    with_one, first = np.unique(landings.sample[order], return_index=True)
    main = np.full(n_rays, -1)
    main[with_one] = order[first]
    return main


def are_main(landings: Landings, n_rays: int) -> Bools:
    """Whether (n,) each is the main landing of its ray, as by `main_of`."""
    is_main = np.ones(len(landings.sample), bool)
    if len(is_main) > n_rays:
        is_main[:] = False
        is_main[main_of(landings, n_rays)] = True
    return is_main


def main_landings(landings: Landings, n_rays: int, expected: Words | None = None) -> Landings:
    """The main landing of each of n rays, in order, as by `main_of`.

    A ray without one missed the display, with throughput 0 and an undefined end.
    """
    if len(landings.sample) == n_rays and (landings.sample == np.arange(n_rays)).all():
        return landings

    main = main_of(landings, n_rays, expected)
    with_one = np.flatnonzero(main >= 0)

    result = Landings(
        sample=np.arange(n_rays),
        reason=np.full(n_rays, Reason.MISSED_DISPLAY, landings.reason.dtype),
        branch=np.zeros(n_rays, np.uint64),
        xy=np.full((n_rays, 2), np.nan),
        positions=np.full((n_rays, 3), np.nan),
        directions=np.full((n_rays, 3), np.nan),
        throughput=np.zeros(n_rays),
        n_events=np.zeros(n_rays, np.int64),
        rank=np.zeros(n_rays, np.int64),
        plate_path=np.full(n_rays, PlatePath.NONE, landings.plate_path.dtype),
        leak=np.full(n_rays, -1, np.int64),
    )
    for name in Landings.__dataclass_fields__:
        getattr(result, name)[with_one] = getattr(landings, name)[main[with_one]]

    return result


PlateLight = Literal["imaged", "folded", "reflected"]


class DeferredObjectError(Exception):
    """A ray comes near deferred glass, which is not in the plan; `boxes` has its numbers in
    `plan.deferred`.
    """

    def __init__(self, boxes: set[int]) -> None:
        super().__init__(boxes)
        self.boxes = boxes


LEAST_THROUGHPUT = 1e-4  # of light that splits; fainter light ends

# hash multiplier, the golden ratio's 64 bits; any odd number works
_MIX = np.uint64(0x9E3779B97F4A7C15)
# Events, at most eight per patch. The last three use the face's own normal because its bent normal
# fails; light is discontinuous between the two.
PASS, TIR, PLATE, MIRROR, LAND, FACE_PASS, FACE_TIR, FACE_MIRROR = range(1, 9)


class Rays:
    """The state of a batch of rays; `live` ones are still being traced.

    A ray that splits continues in up to `n_copies` copies, 2^k - 1 for k splits. Rows: first the
    traced rays, then the first copy of each, and so on.
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
        self.n_originals, self.n_copies = len(origins), n_copies
        n = (1 + n_copies) * len(origins)
        if n_copies:
            origins, directions = (np.tile(x, (1 + n_copies, 1)) for x in (origins, directions))
        self.positions = np.array(origins, float, order="C")
        self.directions = np.array(directions, float, order="C")

        # media around them
        self.mask = np.zeros(n, np.uint64)
        self.cluster = np.zeros(n, np.int64)

        self.reason = np.full(n, Reason.CUT_OFF, np.uint8)  # for rays still live at the end
        self.branch = np.zeros(n, np.uint64)
        self.xy = np.full((n, 2), np.nan)
        self.throughput = np.ones(n)
        self.absorption = np.zeros(n)  # 1/m, of the medium around the ray
        self.n_events = np.zeros(n, np.int64)
        self.rank = np.zeros(n, np.int64)
        self.n_splits = np.zeros(n, np.int64)

        self.row, self.reference = None, None  # polarisation

        self.has_met_glass = np.zeros(n, bool)
        self.has_met_plate = np.zeros(n, bool)
        self.plate_path = np.full(n, PlatePath.NONE, np.uint8)
        self.light = light
        self.last_part = np.full(n, -1, np.int64)
        self.leak = np.full(n, -1, np.int64)

        self.live = np.arange(self.n_originals)
        # whether the copy exists
        self.is_begun = np.arange(n) < self.n_originals if n_copies else np.ones(n, bool)
        self.born = self.parents = np.empty(0, np.int64)  # new copies, not yet live, and their rays
        self.course = course
        self.is_recorded = is_recorded
        self.n_words = np.zeros(n, np.int64)
        self.is_astray = np.zeros(n, bool)
        self.has_ended = np.zeros(n, bool)

    def begin_again(self, some: slice, origins: Floats, directions: Floats) -> None:
        """Reset some rays to their initial state."""
        fresh = Rays(origins, directions, None, False, n_copies=self.n_copies)
        fresh.begin_polarisation(self.row is not None)
        for name, values in fresh._rows().items():
            self._by_copy(getattr(self, name))[:, some] = fresh._by_copy(values)
        if self.is_recorded:
            self._by_copy(self.course)[:, some] = 0

    def begin_polarisation(self, is_polarised: bool) -> None:
        """Carry the polarisation of rays at their viewer, if a plan needs it."""
        if is_polarised:
            self.row, self.reference = polarisation.begin(self.directions)

    def branch_off(
        self, rays: Ints, reflected: Passed, transmitted: Passed, prefers: Preference
    ) -> tuple[Ints, Ints]:
        """Continue rays (n,) as their transmitted light, and their reflected light in copies.

        Returns which (m,) of them have a copy, and the copies' rows (m,). Fainter light than
        LEAST_THROUGHPUT ends.
        """
        bright = np.flatnonzero(self.throughput[rays] * reflected.share >= LEAST_THROUGHPUT)
        splits, copies = self.split(rays[bright])
        splits = bright[splits]
        self.pass_on(copies, reflected.at(splits))
        self.pass_on(rays, transmitted)
        self.rank[copies] += prefers == "transmitted"
        self.rank[rays] += prefers == "reflected"
        self._end_faint(rays)
        return splits, copies

    def _end_faint(self, rays: Ints) -> Ints:
        """End rays fainter than LEAST_THROUGHPUT, and return them."""
        faint = rays[self.throughput[rays] < LEAST_THROUGHPUT]
        self.reason[faint] = Reason.BLOCKED
        self.has_ended[faint] = True
        return faint

    def passed(self, rays: Ints, others: Floats, along: Amplitudes, over: Amplitudes) -> Passed:
        """Light of rays (n,) after a part, as `polarisation.passed`."""
        state = self.row[rays], self.reference[rays], self.directions[rays]
        return polarisation.passed(*state, others, along, over)

    def pass_on(self, rays: Ints, passed: Passed) -> None:
        """Continue rays (n,) as light after a part; faint polarised light ends."""
        self.throughput[rays] *= passed.share
        if self.row is not None:
            self.row[rays], self.reference[rays] = passed.row, passed.reference
            self._end_faint(rays)

    def reach_display(self, rays: Ints, absorbing: Floats) -> None:
        """Weigh rays (n,) that end on a display by the polarisation of its light.

        absorbing : (n, 3) its polariser's absorbing axes, 0 for light that is not polarised
        """
        row = self.passed(rays, absorbing, 1.0, 1.0).row
        self.throughput[rays] *= row[:, 0] + absorbing.any(axis=1) * row[:, 1]
        self.xy[self._end_faint(rays)] = np.nan

    def split(self, rays: Ints) -> tuple[Ints, Ints]:
        """Split some rays: which (m,) of them (n,) have splits left, and the rows (m,) of the new
        copies, in the same state.

        A copy's row is its path, a binary digit for each split, whatever the order of splits.
        """
        digit = (1 + self.n_copies) >> (1 + self.n_splits[rays])
        splits = np.flatnonzero(digit)
        parents = rays[splits]
        copies = parents + self.n_originals * digit[splits]
        self.n_splits[parents] += 1
        for values in self._rows().values():
            values[copies] = values[parents]
        if self.is_recorded:
            self.course[copies] = self.course[parents]
        self.born = np.concatenate([self.born, copies])
        self.parents = np.concatenate([self.parents, parents])
        return splits, copies

    def rows_of(self, some: slice) -> Ints:
        """Rows of some rays and of all their copies."""
        return self._by_copy(np.arange(len(self.mask)))[:, some].ravel()

    def _rows(self) -> dict[str, np.ndarray]:
        """All arrays with a row for each ray and copy."""
        others = "live", "born", "parents", "course"
        arrays = {k: x for k, x in vars(self).items() if isinstance(x, np.ndarray)}
        return {name: values for name, values in arrays.items() if name not in others}

    def _by_copy(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(1 + self.n_copies, self.n_originals, *values.shape[1:])

    def add_to_branch(self, rays: Ints, patch: Ints, event: Ints | int) -> None:
        with np.errstate(over="ignore"):
            word = (patch * 8 + event + 1).astype(np.uint64)
            mixed = (self.branch[rays] ^ word) * _MIX
            self.branch[rays] = mixed ^ (mixed >> np.uint64(29))

        if self.course is None:
            return

        n_words = self.n_words[rays]
        width = self.course.shape[1]

        if self.is_recorded:
            if n_words.max(initial=0) >= width:
                self.course = np.pad(self.course, ((0, 0), (0, width)))
            self.course[rays, n_words] = self.branch[rays]
        else:
            expected = np.where(
                n_words < width,
                self.course[rays % self.n_originals, np.minimum(n_words, width - 1)],
                np.uint64(0),
            )
            self.is_astray[rays] = expected != self.branch[rays]
            self.has_ended[rays] |= self.is_astray[rays]

        self.n_words[rays] += 1


class Step(NamedTuple):
    """Rays between two events: hits with place and patch, and rays that left without a hit.

    rays, left : (h,) and (l,) indices; of copies, rows of `Rays`
    place : (h, 3) m
    patch, triangle : (h,) of the surface
    start, direction : (l, 3)
    """

    rays: Ints
    place: Floats
    patch: Ints
    triangle: Ints
    left: Ints
    start: Floats
    direction: Floats


def main_steps(steps: list[Step], main: Ints, n_rays: int) -> list[Step]:
    """The steps of rays that split, each along the path to its main landing.

    main : (n_rays,) row of each ray's main landing
    """
    is_main = np.zeros(max(int(main.max(initial=0)) + 1, n_rays), bool)
    is_main[main] = True
    chosen = []
    for step in steps:
        h, left = (
            np.flatnonzero((rows < len(is_main)) & is_main[np.minimum(rows, len(is_main) - 1)])
            for rows in (step.rays, step.left)
        )
        chosen.append(
            Step(
                step.rays[h] % n_rays, step.place[h], step.patch[h], step.triangle[h],
                step.left[left] % n_rays, step.start[left], step.direction[left],
            )
        )  # fmt: skip
    return chosen


def copied_steps(steps: list[Step], parents: Ints, copies: Ints) -> list[Step]:
    """Steps so far, with those of new copies (c,), which begin as their parents' (c,)."""
    if not len(copies):
        return steps
    with_copies = []
    for step in steps:
        order = np.argsort(step.rays)
        at = order[np.minimum(np.searchsorted(step.rays, parents, sorter=order), len(order) - 1)]
        h = at[step.rays[at] == parents]
        theirs = copies[step.rays[at] == parents]
        with_copies.append(
            step._replace(
                rays=np.append(step.rays, theirs),
                place=np.concatenate([step.place, step.place[h]]),
                patch=np.append(step.patch, step.patch[h]),
                triangle=np.append(step.triangle, step.triangle[h]),
            )
        )
    return with_copies
