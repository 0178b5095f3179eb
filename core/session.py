"""Keeps ray engines, view map and shares between solves, by fingerprint of content, and solves.

What has not changed is not computed again: a new picture costs one product with the shares, a moved viewer builds
no ray engine. Shares are made, painted and summed some at a time, so that there may be more of them than memory holds.
"""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .accuracy import Tessellation, rounding_error, tessellation
from .display import display_pixel
from .errors import RigError
from .memory import check_memory
from .picture import Pyramid, Taps, ideal_image, picture_from_view
from .plan import Kept, Plan, Settings, fingerprint, make_plan
from .reach import sample_reached
from .rig import ConstantIndex, Floats, Rig
from .seen_image import seen_image
from .shares import Coverage, ShareBatches
from .simulation import PlateView, plate_view
from .source_image import Painting, find_strokes
from .trace import REASON_WORDS, Reason
from .view_map import MapError, ViewMap

Result = TypeVar("Result")

PIXELS_AT_ONCE = 1 << 18
MOST_PLACED = 32  # batches of shares whose strokes are kept for the next picture
ROUNDED = 0.1  # display px: where rounding may do more than this it is worth a remark
COARSE = 0.25  # display px: where the surface may be further off than this it is worth a remark
BEYOND = 0.01  # share of what is seen that may be off by more than the tolerance without a remark
UNDECIDED = 0.01  # share of the light whose way may be another one

REMEDIES = {
    Reason.MISSED_GLASS: "no ray from the viewer meets the glass: turn the viewer to it",
    Reason.LOST_INSIDE: "every ray is lost inside the glass: raise the limit of surfaces or change the glass",
    Reason.MISSED_PLATE: "no ray reaches the plate: move or enlarge it",
    Reason.BLOCKED: "every ray is blocked: move the blockers, or turn the front of the display to the plate",
    Reason.MISSED_DISPLAY: "no ray reaches the display: move or enlarge it",
}


@dataclass(frozen=True, eq=False)
class Solution:
    """The source image, and what became of the viewer's rays.

    source : (H, W, 3) float32 linear, row 0 at the top
    shares : of all cells, some at a time
    weight : (H, W) viewer px^2, sum of area * throughput^2 over the shares of each display pixel
    display_coverage, view_coverage : (H, W), (h, w), 0..1
    picture_coverage : share of the picture, as the viewer sees it, that the display can show
    misses : share of the picture as seen, by reason why it has no landing
    seconds : time by part of the work; n_rays : rays traced for this solve
    tessellation_error : about how far landings are from those of the surface that was meant, rms display px
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    used, left_out : what this rig needed and what it did not; notes : what the user should know
    """

    rig: Rig
    source: NDArray[np.float32]
    shares: ShareBatches
    weight: Floats
    view_map: ViewMap
    display_coverage: Floats
    view_coverage: Floats
    picture_coverage: float
    misses: dict[str, float]
    seconds: dict[str, float]
    n_rays: int
    tessellation_error: float
    plate: PlateView | None
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def map_error(self) -> MapError:
        return self.view_map.error

    def ideal(self) -> NDArray[np.float32]:
        """What the viewer would see of the picture with no glass in the way: (h, w, 3) linear."""
        return ideal_image(self.rig.picture, self.rig.viewer)

    def seen(self, source: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """What the viewer sees, through the glass, of the source image or of another one: (h, w, 3) linear."""
        return seen_image(self._seen_shares, self.source if source is None else source)

    @cached_property
    def _seen_shares(self) -> ShareBatches:
        """Shares each of which lies in one viewer pixel: those that paint may be larger."""
        return _batches(self.view_map, self.shares.has_throughput, at_pixels=True)


def finish(steps: Generator[float, None, Result]) -> Result:
    """Run long work, such as a solve, to its end and return what it returns."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def within(work: Generator[float, None, Result], start: float, stop: float) -> Generator[float, None, Result]:
    """Hand on the progress of one part of the work, from start to stop of the whole."""
    while True:
        try:
            yield start + (stop - start) * next(work)
        except StopIteration as done:
            return done.value


def without_glass(rig: Rig) -> Rig:
    """The same rig with glass that does not refract: what it paints is the plain, uncompensated picture."""
    return replace(rig, glasses=tuple(replace(glass, ior=ConstantIndex(1.0)) for glass in rig.glasses))


@dataclass(frozen=True, eq=False)
class _Optics:
    """What of a solve does not depend on the picture; the coverage is complete when all shares were made once."""

    key: str
    plan: Plan
    view_map: ViewMap
    tessellation: Tessellation
    plate: PlateView | None
    shares: ShareBatches
    coverage: Coverage

    @cached_property
    def rounding_error(self) -> float:
        return rounding_error(self.plan)

    @cached_property
    def view_coverage(self) -> Floats:
        return np.where(self.view_map.is_whole, 1.0, self.coverage.of_view)


@dataclass(eq=False)
class _Placed:
    """What of a solve depends on the picture's place and size, but not on its colours."""

    key: str
    strokes: list[Taps] = field(default_factory=list)  # of the first batches of shares
    covered: tuple[float, dict[str, float]] | None = None


class _Clock:
    """Seconds by part of the work."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, part: str) -> None:
        """What has passed since the last lap was this part's."""
        now = perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._last
        self._last = now


class Session:
    """What can be used again from one solve to the next."""

    def __init__(self) -> None:
        self._kept = Kept()
        self._optics: _Optics | None = None
        self._placed: _Placed | None = None
        self._pyramid: Pyramid | None = None

    def solve(self, rig: Rig, settings: Settings | None = None) -> Generator[float, None, Solution]:
        """Paint the source image of a rig; yields progress 0..1 and returns a Solution.

        Raises
        ------
        RigError, MeshError
            One sentence on what makes the rig unsolvable; the session stays as it was.
        """
        settings = settings or Settings()
        clock = _Clock()
        rig.check()
        settings.check()
        key = fingerprint(replace(rig, pictures=()), replace(settings, margin=0))
        clock.lap("fingerprint")
        optics = self._optics
        is_new = optics is None or optics.key != key
        if is_new:
            check_memory(rig, settings)
            optics = yield from self._look(rig, settings, key, clock)
        yield 0.85
        picture = rig.picture
        placed_key = fingerprint(key, picture.mesh, picture.image.shape)
        placed = self._placed if self._placed and self._placed.key == placed_key else _Placed(placed_key)
        if not (self._pyramid and self._pyramid.is_of(picture.image)):
            self._pyramid = Pyramid(picture.image)
        painting = yield from _paint(rig, optics, placed, self._pyramid, is_new, clock)
        if is_new:
            _refuse_if_dark(optics.view_map, len(optics.shares))
            self._optics = optics
        source = painting.finished(optics.coverage.weight, settings.margin)
        clock.lap("painting")
        yield 0.98
        if placed.covered is None:
            placed.covered = _of_the_picture(rig, optics.view_map, optics.view_coverage)
        self._placed = placed
        clock.lap("coverage")
        yield 1.0
        return Solution(
            rig,
            source,
            optics.shares,
            optics.coverage.weight,
            optics.view_map,
            optics.coverage.of_display,
            optics.view_coverage,
            *placed.covered,
            clock.seconds,
            optics.view_map.n_rays if is_new else 0,
            optics.tessellation.error,
            optics.plate,
            optics.plan.used,
            optics.plan.left_out + (() if is_new else ("tracing (the optics have not changed)",)),
            _notes(rig, optics, source),
        )

    def plan(self, rig: Rig, settings: Settings) -> Plan:
        """The whole of a rig ready to be traced, with what is kept from before."""
        rig.check()
        settings.check()
        return make_plan(rig, settings, self._kept)

    def _look(self, rig: Rig, settings: Settings, key: str, clock: _Clock) -> Generator[float, None, _Optics]:
        """Trace the view map of a rig; yields progress 0..0.85."""
        plan, view_map = yield from within(sample_reached(rig, settings, self._kept, clock.lap), 0.0, 0.8)
        clock.lap("tracing")
        mesh = yield from within(tessellation(plan), 0.8, 0.84)
        clock.lap("tessellation error")
        plate = yield from within(plate_view(plan), 0.84, 0.85)
        if plate is not None:
            clock.lap("brightness and blur")
        coverage = Coverage(view_map.display_size, view_map.view_size)
        return _Optics(key, plan, view_map, mesh, plate, _batches(view_map, settings.brightness), coverage)


def _paint(
    rig: Rig, optics: _Optics, placed: _Placed, pyramid: Pyramid, is_new: bool, clock: _Clock
) -> Generator[float, None, Painting]:
    """Add all shares to a painting, and to the coverage where the optics are new; yields progress 0.85..0.98."""
    painting = Painting(optics.shares.display_size)
    clock.lap("painting")
    for n, shares in enumerate(optics.shares):
        clock.lap("shares")
        if is_new:
            optics.coverage.add(shares)
            clock.lap("coverage")
        if n < len(placed.strokes):
            strokes = placed.strokes[n]
        else:
            strokes = find_strokes(rig.picture, rig.viewer, shares)
            if n < MOST_PLACED:
                placed.strokes.append(strokes)
        painting.add(pyramid, strokes)
        clock.lap("painting")
        yield 0.98 - 0.13 / (1 + n)
    if not optics.shares.are_kept:
        placed.strokes.clear()  # next to all that has to be made again they would save little
    return painting


def _notes(rig: Rig, optics: _Optics, source: NDArray[np.float32]) -> tuple[str, ...]:
    """What the user should know of a solution."""
    plan, mesh, error = optics.plan, optics.tessellation, optics.view_map.error
    notes = [
        f"The glass '{glass.name}' is not closed ({n} open edges): close it."
        for glass, n in zip(rig.glasses, plan.n_open, strict=True)
        if n
    ]
    for part, n in zip((*rig.glasses, *rig.mirrors), plan.n_contradicted, strict=True):
        if n:
            faces = f"{n} smooth triangle{'s' if n > 1 else ''} of '{part.name}'"
            notes.append(
                f"The normals of {faces} contradict the shape or are missing: followed flat. Mark edges there sharp"
                " (Shade Smooth by Angle), or subdivide."
            )
    beyond = error.facet_limited + error.unresolved
    if beyond > BEYOND:
        notes.append(
            f"{beyond:.1%} of what is seen is off by more than the tolerance, or lost,"
            " where the view through the glass changes within a viewer pixel: raise the viewer's resolution, or use a"
            " finer, smooth mesh."
        )
    if mesh.undecided > UNDECIDED:
        notes.append(
            f"{mesh.undecided:.0%} of the light meets gaps or overlaps of glass that are thinner than its mesh is"
            " exact, and may go another way: use the same mesh for faces that touch, or move them apart."
        )
    if mesh.error > COARSE:
        notes.append(
            f"The mesh is coarse: up to about {mesh.error:.2g} display pixels of error. Subdivide the glass, or shade"
            " it smooth where it is meant to be."
        )
    rounded, touching = optics.rounding_error, plan.merge_distance
    if max(rounded, touching / display_pixel(rig.display)) > ROUNDED:
        notes.append(
            f"Blender rounds places: landings may be off by {rounded:.2g} display pixels, and glass nearer than"
            f" {1e3 * touching:.2g} mm touches. Move the rig to the origin, and the origins of its objects to their"
            " middles."
        )
    brightest = reduce(np.maximum, (source[..., channel] for channel in range(3)))  # rows of three are slow in numpy
    bright = np.count_nonzero(brightest > 1 + 1e-6) / max(np.count_nonzero(brightest > 0), 1)
    if bright > 0:
        notes.append(
            f"{bright:.1%} of the source image is brighter than a display's white and would be clipped:"
            " lower the picture's brightness."
        )
    return tuple(notes)


def _batches(view_map: ViewMap, is_weighed: bool, at_pixels: bool = False) -> ShareBatches:
    """The shares of a map's cells."""
    return ShareBatches(view_map.display_size, view_map.view_size, is_weighed, partial(view_map.pieces, at_pixels))


def _refuse_if_dark(view_map: ViewMap, n_shares: int) -> None:
    """Raise RigError when no ray arrives: a black source image is never what was meant."""
    if n_shares:
        return
    counts = np.bincount(view_map.reason.ravel(), minlength=len(Reason))
    counts[Reason.ARRIVED] = 0
    beyond_glass = [r for r in Reason if r > Reason.MISSED_GLASS and counts[r]]
    reason = max(beyond_glass, key=lambda r: counts[r]) if beyond_glass else Reason.MISSED_GLASS
    raise RigError(f"The display stays dark: {REMEDIES[reason]}.")


def _of_the_picture(rig: Rig, view_map: ViewMap, view_coverage: Floats) -> tuple[float, dict[str, float]]:
    """Share of the picture, as the viewer sees it, that is covered, and shares of it by reason of the misses."""
    w, h = view_map.view_size
    shown, unseen, lost = 0.0, 0.0, np.zeros(len(Reason))
    rows = max(1, PIXELS_AT_ONCE // w)
    for first in range(0, h, rows):
        x, y = np.meshgrid(np.arange(w) + 0.5, np.arange(first, min(first + rows, h)) + 0.5)
        cover = picture_from_view(rig.picture, rig.viewer, np.stack([x.ravel(), y.ravel()], axis=1), 1.0).cover
        shown += cover.sum()
        missing = np.clip(cover - view_coverage[first : first + rows].ravel(), 0, 1)
        unseen += missing.sum()
        some = np.flatnonzero(missing)
        top = view_map.reason[first : first + rows + 1]
        by_corner = np.stack([top[:-1, :-1], top[:-1, 1:], top[1:, :-1], top[1:, 1:]]).reshape(4, -1)[:, some]
        of_reason = by_corner[None] == np.arange(len(Reason))[:, None, None]
        of_reason[Reason.ARRIVED] = False
        votes = of_reason.sum(axis=1)
        lost += (missing[some] * votes / np.maximum(votes.sum(axis=0), 1)).sum(axis=1)
    if shown == 0:
        raise RigError(
            f"The viewer does not see the picture '{rig.picture.name}' straight:"
            " move it into view, or use an image in the viewer's own pixels."
        )
    misses = {REASON_WORDS[reason]: float(lost[reason] / shown) for reason in Reason if lost[reason] > 0}
    return float(1 - unseen / shown), misses
