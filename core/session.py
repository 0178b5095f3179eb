"""Keeps ray engines, view map and shares between solves, by fingerprint of content, and solves.

What has not changed is not computed again: a new picture costs one product with the shares, a moved viewer builds
no ray engine.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .accuracy import tessellation_error
from .errors import RigError
from .picture import PicturePoints, Pyramid, ideal_image, picture_from_view
from .plan import Kept, Plan, Settings, fingerprint, make_plan
from .reach import sample_reached
from .rig import ConstantIndex, Floats, Rig
from .seen_image import seen_image
from .shares import Gathered, Shares, display_coverage, view_coverage
from .simulation import Simulation, simulate
from .source_image import paint
from .trace import REASON_WORDS, Reason
from .view_map import MapError, ViewMap

Result = TypeVar("Result")

CELLS_AT_ONCE, SHARES_AT_ONCE = 1 << 18, 1 << 18
MOST_PLACED = 16  # times so many shares are remembered by their places on the picture, for the next one
COARSE = 0.25  # display px: where the surface may be further off than this it is worth a remark

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
    display_coverage, view_coverage : (H, W), (h, w), 0..1
    picture_coverage : share of the picture, as the viewer sees it, that the display can show
    misses : share of the picture as seen, by reason why it has no landing
    seconds : time by part of the work; n_rays : rays traced for this solve
    tessellation_error : about how far landings are from those of the surface that was meant, rms display px
    used, left_out : what this rig needed and what it did not; notes : what the user should know
    """

    rig: Rig
    source: NDArray[np.float32]
    shares: Shares
    view_map: ViewMap
    display_coverage: Floats
    view_coverage: Floats
    picture_coverage: float
    misses: dict[str, float]
    seconds: dict[str, float]
    n_rays: int
    tessellation_error: float
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
    def _seen_shares(self) -> Shares:
        """Shares each of which lies in one viewer pixel: those that paint may be larger."""
        is_weighed = self.shares.throughput is not None
        return finish(_rasterise(self.view_map, is_weighed, at_pixels=True))


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


class Session:
    """What can be used again from one solve to the next."""

    def __init__(self) -> None:
        self._kept = Kept()
        self._optics: tuple[str, Plan, ViewMap, Shares, float, Floats, Floats] | None = None
        self._placed: tuple[str, list[PicturePoints]] | None = None
        self._pyramid: tuple[str, Pyramid] | None = None

    def solve(self, rig: Rig, settings: Settings | None = None) -> Generator[float, None, Solution]:
        """Paint the source image of a rig; yields progress 0..1 and returns a Solution.

        Raises
        ------
        RigError, MeshError
            One sentence on what makes the rig unsolvable; the session stays as it was.
        """
        settings = settings or Settings()
        seconds: dict[str, float] = {}
        left_out: list[str] = []
        clock = perf_counter()

        def lap(name: str) -> None:
            nonlocal clock
            now = perf_counter()
            seconds[name] = seconds.get(name, 0.0) + now - clock
            clock = now

        rig.check()
        settings.check()
        key = fingerprint(replace(rig, pictures=()), replace(settings, margin=0))
        lap("fingerprint")
        n_rays = 0
        if self._optics and self._optics[0] == key:
            _, plan, view_map, shares, tessellation, seen_share, covered = self._optics
            left_out.append("tracing (the optics have not changed)")
        else:
            steps = sample_reached(rig, settings, self._kept, lap)
            plan, view_map = yield from within(steps, 0.0, 0.8)
            lap("tracing")
            n_rays = view_map.n_rays
            shares = yield from _rasterise(view_map, settings.brightness)
            _refuse_if_dark(view_map, shares)
            lap("shares")
            tessellation = yield from within(tessellation_error(plan), 0.85, 0.9)
            lap("tessellation error")
            seen_share = np.where(view_map.is_whole, 1.0, view_coverage(shares))
            covered = display_coverage(shares)
            lap("coverage")
            self._optics = (key, plan, view_map, shares, tessellation, seen_share, covered)
        yield 0.9
        placed_key = fingerprint(key, rig.picture.mesh, rig.picture.image.shape)
        if not (self._placed and self._placed[0] == placed_key):
            self._placed = (placed_key, [])
        pyramid_key = fingerprint(rig.picture.image)
        if not (self._pyramid and self._pyramid[0] == pyramid_key):
            self._pyramid = (pyramid_key, Pyramid(rig.picture.image))
            yield 0.92
        placed, pyramid = self._placed[1], self._pyramid[1]
        colours = np.empty((3, len(shares)), np.float32)
        for k, first in enumerate(range(0, len(shares), SHARES_AT_ONCE)):
            some = slice(first, first + SHARES_AT_ONCE)
            if k < len(placed):
                points = placed[k]
            else:
                points = picture_from_view(rig.picture, rig.viewer, shares.view_xy[some], shares.area[some])
                if k < MOST_PLACED:
                    placed.append(points)
            colours[:, some] = pyramid.sample(points).T
            yield 0.92 + 0.05 * first / len(shares)
        source = paint(shares, colours.T, settings.margin)
        lap("painting")
        yield 0.98
        picture_coverage, misses = _of_the_picture(rig, view_map, seen_share)
        lap("coverage")
        yield 1.0
        return Solution(
            rig,
            source,
            shares,
            view_map,
            covered,
            seen_share,
            picture_coverage,
            misses,
            seconds,
            n_rays,
            tessellation,
            plan.used,
            plan.left_out + tuple(left_out),
            _notes(rig, plan, source, tessellation),
        )

    def simulate(
        self, rig: Rig, settings: Settings, source: NDArray[np.float32], spp: int
    ) -> Generator[float, None, Simulation]:
        """Simulate what the viewer sees of a source image (H, W, 3 or 4) by the plate's mirrors; yields progress."""
        rig.check()
        settings.check()
        return (yield from simulate(make_plan(rig, settings, self._kept), source, spp))


def _notes(rig: Rig, plan: Plan, source: NDArray[np.float32], tessellation: float) -> tuple[str, ...]:
    """What the user should know of a solution."""
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
    if tessellation > COARSE:
        notes.append(
            f"The mesh is coarse: up to about {tessellation:.2g} display pixels of error. Subdivide the glass, or shade"
            " it smooth where it is meant to be."
        )
    brightest = source.max(axis=2)
    bright = (brightest > 1 + 1e-6).sum() / max((brightest > 0).sum(), 1)
    if bright > 0:
        notes.append(
            f"{bright:.1%} of the source image is brighter than a display's white and would be clipped:"
            " lower the picture's brightness."
        )
    return tuple(notes)


def _rasterise(view_map: ViewMap, is_weighed: bool, at_pixels: bool = False) -> Generator[float, None, Shares]:
    """Shares of all cells, some at a time; yields progress 0.8..0.85."""
    gathered = Gathered(view_map.display_size, view_map.view_size, is_weighed)
    for n, (view, display, throughput) in enumerate(view_map.pieces(at_pixels)):
        gathered.add(view, display, throughput)
        yield 0.85 - 0.05 / (1 + n)
    return gathered.whole()


def _refuse_if_dark(view_map: ViewMap, shares: Shares) -> None:
    """Raise RigError when no ray arrives: a black source image is never what was meant."""
    if len(shares):
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
    rows = max(1, CELLS_AT_ONCE // w)
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
