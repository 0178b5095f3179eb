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
    """The state of the rays of one batch; `live` are those still under way."""

    def __init__(
        self,
        origins: Floats,
        directions: Floats,
        course: Words | None,
        is_recorded: bool,
        light: PlateLight = "imaged",
    ) -> None:
        n = len(origins)
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
        self.live = np.arange(n)
        self.course = course
        self.is_recorded = is_recorded
        self.n_words = np.zeros(n, np.int64)
        self.is_astray = np.zeros(n, bool)
        self.has_ended = np.zeros(n, bool)

    def begin_again(self, some: slice, origins: Floats, directions: Floats) -> None:
        """Let some of these rays be as they were when they began."""
        for name, values in vars(Rays(origins, directions, None, False)).items():
            if isinstance(values, np.ndarray) and name != "live":
                getattr(self, name)[some] = values
        if self.is_recorded:
            self.course[some] = 0

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
                n_words < width, self.course[rays, np.minimum(n_words, width - 1)], np.uint64(0)
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
