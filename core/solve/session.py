"""Keeps ray engines, view map and shares between solves, by fingerprint of content, and solves.

Nothing is computed again that has not changed: a new picture costs one product with the shares, a
moved viewer builds no ray engine. Shares are made, painted and summed some at a time, so that there
may be more of them than memory holds.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..errors import RigError
from ..fingerprint import fingerprint
from ..image.glare import LightBeside, look_beside
from ..image.pyramid import Pyramid
from ..image.simulation import PlateView, plate_view
from ..light.kept import Kept
from ..light.landings import Reason
from ..light.plan import Plan
from ..light.planning import make_plan
from ..map.share_batches import ShareBatches
from ..map.view_map import ViewMap
from ..rig import Picture, Rig
from ..settings import Settings
from ..steps import (
    at,
    last_told,
    within,
)
from ..words import percent
from .accuracy import Accuracy, measure
from .memory import check_borders, check_memory
from .painting import Clock, Placed, finished, paint, place, weight_beside
from .picture_coverage import of_the_picture
from .reach import sample_reached
from .remarks import remarks_on
from .solution import Solution

MOSTLY = 0.5  # share of the light: where more goes through gaps these are why all is dark
MEASURED = 0.25  # of the work after tracing: until then errors are measured, then it is painted
PAINTED = 0.97  # of the progress of a solve

REMEDIES = {
    Reason.MISSED_GLASS: "no ray from the viewer meets the glass: turn the viewer to it",
    Reason.LOST_INSIDE: "every ray is lost inside the glass: look for faces that cut each other",
    Reason.MISSED_PLATE: "no ray reaches the plate: move or enlarge it",
    Reason.BLOCKED: "every ray is blocked: move the blockers, or turn the front of the display to"
    " the plate",
    Reason.MISSED_DISPLAY: "no ray reaches the display: move or enlarge it",
    Reason.CUT_OFF: "every ray meets more surfaces than Max Events allows: raise it, or change the"
    " glass",
}


@dataclass(frozen=True, eq=False)
class _Optics:
    """The part of a solve that does not depend on the picture."""

    key: str
    plan: Plan
    view_map: ViewMap
    accuracy: Accuracy
    plate: PlateView | None
    beside: LightBeside | None
    weight_beside: Floats | None


class Session:
    """Results that can be used again from one solve to the next."""

    def __init__(self) -> None:
        self._kept = Kept()
        self._optics: _Optics | None = None
        self._placed: Placed | None = None
        self._pyramid: Pyramid | None = None
        self.is_tracing = False  # is the view map of a solve under way?

    def solve(self, rig: Rig, settings: Settings | None = None) -> Generator[float, None, Solution]:
        """Paint the source image of a rig; yields progress 0..1 and returns a Solution.

        Raises
        ------
        RigError, MeshError
            One sentence on the fault of the rig; the session stays as it was.
        """
        settings = settings or Settings()
        clock = Clock()
        started = perf_counter()
        rig.check()
        settings.check()
        key = fingerprint(replace(rig, pictures=()), settings.of_optics)
        clock.lap("fingerprint")
        optics, told = self._optics, 0.0
        is_new = optics is None or optics.key != key
        if is_new:
            check_memory(rig, settings)
            optics, told = yield from self._look(rig, settings, key, clock)
        yield told
        picture = rig.picture
        placed_key = fingerprint(key, picture.mesh, picture.image.shape, settings.ghosts)
        placed = self._placed
        if placed is None or placed.key != placed_key:
            if placed is not None:
                placed.let_go()  # or there would be twice as many
            placed = place(placed_key, optics.view_map, rig, settings)
        if is_new:
            so_far = perf_counter() - started
            told = max(told, min(PAINTED, so_far / (so_far + placed.seconds_to_paint)))
        painting = yield from within(
            paint(rig, placed, self._pyramid_of(picture), clock), told, PAINTED
        )
        if is_new:
            _refuse_if_dark(optics, placed.shares)
            self._optics = optics
        source = finished(painting, placed.coverage, optics.weight_beside, settings)
        clock.lap("painting")
        yield PAINTED
        if placed.covered is None:
            placed.view_coverage = placed.view_coverage_in(optics.view_map)
            placed.covered = of_the_picture(rig, optics.view_map, placed.view_coverage)
        self._placed = placed
        plan = replace(optics.plan, settings=settings)
        glare = None if optics.beside is None else optics.beside.seen_of(source)
        clock.lap("coverage")
        yield 1.0
        return Solution(
            rig,
            source,
            placed.shares,
            placed.coverage.weight,
            optics.view_map,
            placed.coverage.of_display,
            placed.view_coverage,
            *placed.covered,
            clock.seconds,
            optics.view_map.n_rays if is_new else 0,
            optics.accuracy.tessellation.error,
            optics.plate,
            glare,
            plan,
            optics.plan.used,
            optics.plan.left_out + (() if is_new else ("tracing (the optics have not changed)",)),
            remarks_on(
                rig, plan, optics.accuracy, optics.view_map.error, placed.covered[1], source, glare
            ),
        )

    def glance(self, rig: Rig, settings: Settings) -> Generator[float, None, NDArray[np.float32]]:
        """The source image of a coarse rig alone, of which
        nothing is measured; yields progress 0..1.

        The last solve stays known. So does the glass that is
        made ready: it may be called within a solve.

        Raises
        ------
        RigError, MeshError : as by `solve`, but for the words
        """
        clock = Clock()
        _, view_map = yield from within(
            sample_reached(rig, settings, self._kept, clock.lap), 0.0, 0.5
        )
        placed = place("", view_map, rig, settings)
        painting = yield from within(
            paint(rig, placed, self._pyramid_of(rig.picture), clock), 0.5, 1.0
        )
        if not len(placed.shares):
            raise RigError("The display stays dark.")
        # refuses a picture out of sight
        of_the_picture(rig, view_map, placed.view_coverage_in(view_map))
        beside = yield from at(1.0, weight_beside(view_map, settings))
        return finished(painting, placed.coverage, beside, settings)

    def plan(self, rig: Rig, settings: Settings) -> Plan:
        """The whole of a rig ready to be traced, with all that is kept from before."""
        rig.check()
        settings.check()
        return make_plan(rig, settings, self._kept)

    def _pyramid_of(self, picture: Picture) -> Pyramid:
        """The sizes of a picture's image, made once as long as it is the same."""
        if not (self._pyramid and self._pyramid.is_of(picture.image)):
            self._pyramid = Pyramid(picture.image)
        return self._pyramid

    def _look(
        self, rig: Rig, settings: Settings, key: str, clock: Clock
    ) -> Generator[float, None, tuple[_Optics, float]]:
        """Trace the view map of a rig; yields progress of the whole solve, and returns it, too."""
        self.is_tracing = True
        try:
            sampling = within(sample_reached(rig, settings, self._kept, clock.lap), 0.0, PAINTED)
            (plan, view_map), told = yield from last_told(sampling)
        finally:
            self.is_tracing = False
        clock.lap("tracing")
        check_borders(rig, settings, view_map)
        is_cut_off = bool((view_map.points.reason == Reason.CUT_OFF).any())
        after = told + MEASURED * (PAINTED - told)
        accuracy = yield from within(measure(plan, is_cut_off), told, after)
        clock.lap("tessellation error")
        plate = yield from at(after, plate_view(plan))
        if plate is not None:
            clock.lap("brightness and blur")
        beside = (yield from at(after, look_beside(plan))) if settings.only_through_glass else None
        weight = yield from at(after, weight_beside(view_map, settings))
        clock.lap("glare")
        return _Optics(key, plan, view_map, accuracy, plate, beside, weight), after


def _refuse_if_dark(optics: _Optics, shares: ShareBatches) -> None:
    """Raise RigError when no ray arrives: nobody means a black source image."""
    if len(shares):
        return

    leaks = optics.accuracy.leaks
    leaked = max(leaks)
    if leaked > MOSTLY:
        glass = optics.plan.rig.glasses[leaks.index(leaked)]
        raise RigError(
            f"The display stays dark: {percent(leaked)} of the picture's light goes through gaps"
            f" in the glass '{glass.name}': close them."
        )

    counts = np.bincount(optics.view_map.reason.ravel(), minlength=len(Reason))
    counts[Reason.ARRIVED] = 0
    beyond_glass = [r for r in Reason if r > Reason.MISSED_GLASS and counts[r]]
    reason = max(beyond_glass, key=lambda r: counts[r]) if beyond_glass else Reason.MISSED_GLASS
    raise RigError(f"The display stays dark: {REMEDIES[reason]}.")
