"""Keeps ray engines, view map and shares between solves, by fingerprint of content, and solves.

What has not changed is not computed again: a new picture costs one product with the shares, a moved viewer builds
no ray engine. Shares are made, painted and summed some at a time, so that there may be more of them than memory holds.
"""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from .accuracy import Accuracy, measure
from .arrays import Floats
from .errors import RigError
from .fingerprint import fingerprint
from .ghosts import Paths, paths_of
from .glare import Glare, LightBeside, look_beside, looking_beside
from .ideal_image import ideal_image
from .kept import Kept
from .landings import REASON_WORDS, Reason
from .memory import check_borders, check_memory
from .outline import cut_along_outline
from .picture import cover_in_view, why_unseen
from .plan import Plan, make_plan
from .pyramid import Pyramid
from .reach import sample_reached, times_slower
from .remarks import Remark, remarks_on
from .rig import ConstantIndex, Picture, Rig
from .sampling import sample
from .seen_image import seen_image
from .settings import Settings
from .share_batches import ShareBatches
from .shares import Coverage, Shares, add_at
from .simulation import PlateView, plate_view
from .source_image import Painting, Strokes, find_strokes
from .steps import Pauses, at, last_told, within
from .steps import finish as finish  # also from here: scripts of 0.1 have it so
from .view_map import MapError, Piece, ViewMap
from .words import percent

PIXELS_AT_ONCE = 1 << 18
UNSEEN = 1e-6  # viewer px^2: a picture that covers less is seen edge-on or not at all
ROUNDING = 1e-12  # of the picture: less is no light
MOSTLY = 0.5  # share of the light: where more goes through gaps these are why all is dark
TOO_FINE = "finer than a viewer pixel"
MEASURED = 0.25  # of what comes after tracing: until then errors are measured, then it is painted
PAINTED = 0.97  # of the progress of a solve
# seconds, about, that painting takes for each display pixel, cell and share, where `reach.times_slower` is 1
PAINTING = 0.48e-6, 0.67e-6, 0.14e-6
MOST_PLACED = 1 << 22  # shares whose strokes are kept for the next picture

REMEDIES = {
    Reason.MISSED_GLASS: "no ray from the viewer meets the glass: turn the viewer to it",
    Reason.LOST_INSIDE: "every ray is lost inside the glass: look for faces that cut each other",
    Reason.MISSED_PLATE: "no ray reaches the plate: move or enlarge it",
    Reason.BLOCKED: "every ray is blocked: move the blockers, or turn the front of the display to the plate",
    Reason.MISSED_DISPLAY: "no ray reaches the display: move or enlarge it",
    Reason.CUT_OFF: "every ray meets more surfaces than Max Events allows: raise it, or change the glass",
}


@dataclass(frozen=True, eq=False)
class Solution:
    """The source image, and what became of the viewer's rays.

    source : (H, W, 3) float32 linear, row 0 at the top
    shares : of all cells, some at a time
    weight : (H, W) viewer px^2, sum of area * throughput^2 over the shares of each display pixel that it shows
    display_coverage, view_coverage : (H, W), (h, w), 0..1
    picture_coverage : share of the picture, as the viewer sees it, that the display can show
    misses : share of the picture as seen, by reason why it has no landing; with picture_coverage they make 1
    seconds : time by part of the work; n_rays : rays traced for this solve
    tessellation_error : about how far landings are from those of the surface that was meant, rms display px
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    glare : what of the light comes beside the glass; None where that carries the picture, too
    used, left_out : what this rig needed and what it did not; remarks : what the user should know
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
    glare: Glare | None
    plan: Plan
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    remarks: tuple[Remark, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know, one or two sentences each."""
        return tuple(remark.told() for remark in self.remarks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that tell of light that is lost or goes another way."""
        return tuple(remark.told() for remark in self.remarks if remark.is_warning)

    @property
    def map_error(self) -> MapError:
        return self.view_map.error

    def ideal(self) -> NDArray[np.float32]:
        """What the viewer would see of the picture with no glass in the way: (h, w, 3) linear."""
        return ideal_image(self.rig.picture, self.rig.viewer)

    def seen(self, source: NDArray[np.float32] | None = None, beside: bool = False) -> NDArray[np.float32]:
        """What the viewer sees, through the glass, of the source image or of another one: (h, w, 3) linear.

        beside : and by way of the plate alone, beside the glass; that is traced when first asked for, see `look_beside`
        """
        source = self.source if source is None else source
        seen = seen_image(self._seen_shares, source)
        if not beside or self._seen_beside is None:
            return seen
        return seen + seen_image(self._seen_beside, source)

    @cached_property
    def _seen_shares(self) -> ShareBatches:
        """Shares each of which lies in one viewer pixel: those that paint may be larger."""
        return _shares_of(self.view_map, self.shares.has_throughput, partial(self.view_map.pieces, at_pixels=True))

    def look_beside(self) -> Generator[float, None, None]:
        """Trace light beside the glass, unless it is known or is part of the map anyway; yields progress 0..1."""
        settings = self.plan.settings
        if settings.only_through_glass and not settings.looks_beside and "_map_beside" not in vars(self):
            check_memory(self.rig, settings)
            vars(self)["_map_beside"] = yield from sample(looking_beside(self.plan))

    @cached_property
    def _map_beside(self) -> ViewMap:
        return self.view_map if self.plan.settings.looks_beside else finish(sample(looking_beside(self.plan)))

    @cached_property
    def _seen_beside(self) -> ShareBatches | None:
        """The shares of light beside the glass, each in one viewer pixel; None where it is part of the map anyway."""
        if not self.plan.settings.only_through_glass:
            return None
        pieces = partial(self._map_beside.pieces, at_pixels=True, beside=True)
        return _shares_of(self._map_beside, self.shares.has_throughput, pieces)


def without_glass(rig: Rig) -> Rig:
    """The same rig with glass that does not refract: what it paints is the plain, uncompensated picture."""
    return replace(rig, glasses=tuple(replace(glass, ior=ConstantIndex(1.0)) for glass in rig.glasses))


@dataclass(frozen=True, eq=False)
class _Optics:
    """What of a solve does not depend on the picture."""

    key: str
    plan: Plan
    view_map: ViewMap
    accuracy: Accuracy
    plate: PlateView | None
    beside: LightBeside | None
    weight_beside: Floats | None


@dataclass(eq=False)
class _Placed:
    """What of a solve depends on the picture's place and size, but not on its colours.

    seconds_to_paint : about, with all that comes with it
    cells, part : (5,) after how many cells which part of the shares is made, about, 0..1
    coverage : complete when all shares were made once
    strongest : (H * W,) the path that a pixel shows, None where it shows the mean of all
    """

    key: str
    shares: ShareBatches
    seconds_to_paint: float
    cells: Floats
    part: Floats
    coverage: Coverage
    strongest: NDArray[np.uint64] | None = None
    view_coverage: Floats | None = None
    strokes: list[Strokes] = field(default_factory=list)  # of the first batches of shares
    covered: tuple[float, dict[str, float]] | None = None

    def let_go(self) -> None:
        """Keep no shares: they are made again when they are asked for."""
        self.shares.let_go()
        self.strokes.clear()

    def shown(self, shares: Shares) -> Shares:
        """Those of some shares that display pixels show."""
        if self.strongest is None:
            return shares
        return shares.at(np.flatnonzero(self.strongest[shares.display_index] == shares.path))

    def view_coverage_in(self, view_map: ViewMap) -> Floats:
        """Part (h, w) of each viewer pixel that is connected to the display, 0..1."""
        return np.where(view_map.is_whole, 1.0, self.coverage.of_view)


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
        self.is_tracing = False  # is the view map of a solve under way?

    def solve(self, rig: Rig, settings: Settings | None = None) -> Generator[float, None, Solution]:
        """Paint the source image of a rig; yields progress 0..1 and returns a Solution.

        Raises
        ------
        RigError, MeshError
            One sentence on what makes the rig unsolvable; the session stays as it was.
        """
        settings = settings or Settings()
        clock, started = _Clock(), perf_counter()
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
            placed = _place(placed_key, optics.view_map, rig, settings)
        if is_new:
            so_far = perf_counter() - started
            told = max(told, min(PAINTED, so_far / (so_far + placed.seconds_to_paint)))
        painting = yield from within(_paint(rig, placed, self._pyramid_of(picture), clock), told, PAINTED)
        if is_new:
            _refuse_if_dark(optics, placed.shares)
            self._optics = optics
        source = _finished(painting, placed.coverage, optics.weight_beside, settings)
        clock.lap("painting")
        yield PAINTED
        if placed.covered is None:
            placed.view_coverage = placed.view_coverage_in(optics.view_map)
            placed.covered = _of_the_picture(rig, optics.view_map, placed.view_coverage)
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
            remarks_on(rig, plan, optics.accuracy, optics.view_map.error, placed.covered[1], source, glare),
        )

    def glance(self, rig: Rig, settings: Settings) -> Generator[float, None, NDArray[np.float32]]:
        """The source image of a coarse rig alone, of which nothing is measured; yields progress 0..1.

        What is known of the last solve stays known. So does what is made ready: it may be called within a solve.

        Raises
        ------
        RigError, MeshError : as by `solve`, but for the words
        """
        clock = _Clock()
        _, view_map = yield from within(sample_reached(rig, settings, self._kept, clock.lap), 0.0, 0.5)
        placed = _place("", view_map, rig, settings)
        painting = yield from within(_paint(rig, placed, self._pyramid_of(rig.picture), clock), 0.5, 1.0)
        if not len(placed.shares):
            raise RigError("The display stays dark.")
        _of_the_picture(rig, view_map, placed.view_coverage_in(view_map))  # refuses what is out of sight
        beside = yield from at(1.0, _weight_beside(view_map, settings))
        return _finished(painting, placed.coverage, beside, settings)

    def plan(self, rig: Rig, settings: Settings) -> Plan:
        """The whole of a rig ready to be traced, with what is kept from before."""
        rig.check()
        settings.check()
        return make_plan(rig, settings, self._kept)

    def _pyramid_of(self, picture: Picture) -> Pyramid:
        """The sizes of a picture's image, made once as long as it is the same."""
        if not (self._pyramid and self._pyramid.is_of(picture.image)):
            self._pyramid = Pyramid(picture.image)
        return self._pyramid

    def _look(
        self, rig: Rig, settings: Settings, key: str, clock: _Clock
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
        weight = yield from at(after, _weight_beside(view_map, settings))
        clock.lap("glare")
        return _Optics(key, plan, view_map, accuracy, plate, beside, weight), after


def _paint(rig: Rig, placed: _Placed, pyramid: Pyramid, clock: _Clock) -> Generator[float, None, Painting]:
    """Add all shares to a painting, and to the sums over them where these are new; yields progress 0..1."""
    painting, is_new = Painting(placed.shares.display_size), placed.covered is None
    n_painted, told = 0, 0.0
    clock.lap("painting")
    if is_new and placed.shares.has_path:
        placed.strongest = yield from at(0.0, _strongest_paths(placed.shares))
        clock.lap("ghosts")

    for n, shares in enumerate(placed.shares):
        clock.lap("shares")
        is_known = n < len(placed.strokes)
        shown = None if is_known and not is_new else placed.shown(shares)
        if is_new:
            placed.coverage.add(shares, shown)
            clock.lap("coverage")

        strokes = placed.strokes[n] if is_known else find_strokes(rig.picture, rig.viewer, shown)
        if n == len(placed.strokes) and n_painted < MOST_PLACED:  # another solve may have let some go meanwhile
            placed.strokes.append(strokes)
        painting.add(pyramid, strokes)
        clock.lap("painting")

        n_painted += len(shares)
        batches = placed.shares
        part = n_painted / len(batches) if batches.are_kept else np.interp(batches.n_divided, placed.cells, placed.part)
        told = max(told, float(part))  # another solve may be half way through the same batches
        yield told
    if not placed.shares.are_kept:
        placed.strokes.clear()  # next to all that has to be made again they would save little
    return painting


def _place(key: str, view_map: ViewMap, rig: Rig, settings: Settings) -> _Placed:
    """The shares of a map as a picture's place has them, none of which are made yet."""
    shares = _shares_to_paint(view_map, rig, settings)
    width, height = shares.display_size
    cells, n_shares = np.cumsum(np.pad(view_map.n_by_kind, ((0, 0), (1, 0))), axis=1)
    seconds = times_slower() * float(np.dot(PAINTING, [width * height, cells[-1], n_shares[-1]]))
    part = n_shares / max(n_shares[-1], 1)
    return _Placed(key, shares, seconds, cells, part, Coverage(shares.display_size, shares.view_size))


def _finished(painting: Painting, coverage: Coverage, beside: Floats | None, settings: Settings) -> NDArray[np.float32]:
    """The source image of a painting to which all shares were added."""
    held_back = None if beside is None else settings.suppress_glare * beside
    return painting.finished(coverage.weight, settings.margin, held_back)


def _strongest_paths(batches: ShareBatches) -> Pauses[NDArray[np.uint64]]:
    paths = Paths(batches.display_size)
    for shares in batches:
        paths.add(shares)
        yield 0
    return paths.strongest()


def _shares_to_paint(view_map: ViewMap, rig: Rig, settings: Settings) -> ShareBatches:
    """The shares of a map's cells, which are cut along the picture's outline."""

    def pieces() -> Iterator[Piece]:
        return cut_along_outline(view_map.pieces(), rig.picture, rig.viewer)

    return _shares_of(view_map, settings.brightness, pieces, has_path=settings.ghosts == "strongest")


def _shares_of(
    view_map: ViewMap, has_throughput: bool, pieces: Callable[[], Iterator[Piece]], has_path: bool = False
) -> ShareBatches:
    """The shares of pieces of a map, with their paths if asked for."""

    def cells() -> Iterator[tuple[NDArray | None, ...]]:
        for piece in pieces():
            yield piece.view, piece.display, piece.throughput, paths_of(piece) if has_path else None

    return ShareBatches(view_map.display_size, view_map.view_size, has_throughput, cells, has_path)


def _weight_beside(view_map: ViewMap, settings: Settings) -> Pauses[Floats | None]:
    """Sum (H, W) of area * throughput^2, viewer px^2, over the shares of light beside the glass, if asked for."""
    if not settings.looks_beside:
        return None

    width, height = view_map.display_size
    weight = np.zeros((height, width))
    for shares in _shares_of(view_map, settings.brightness, partial(view_map.pieces, beside=True)):
        add_at(weight, shares.display_index, shares.weight)
        yield 0
    return weight


def _refuse_if_dark(optics: _Optics, shares: ShareBatches) -> None:
    """Raise RigError when no ray arrives: a black source image is never what was meant."""
    if len(shares):
        return

    leaks = optics.accuracy.leaks
    leaked = max(leaks)
    if leaked > MOSTLY:
        glass = optics.plan.rig.glasses[leaks.index(leaked)]
        raise RigError(
            f"The display stays dark: {percent(leaked)} of the picture's light goes through gaps in the glass"
            f" '{glass.name}': close them."
        )

    counts = np.bincount(optics.view_map.reason.ravel(), minlength=len(Reason))
    counts[Reason.ARRIVED] = 0
    beyond_glass = [r for r in Reason if r > Reason.MISSED_GLASS and counts[r]]
    reason = max(beyond_glass, key=lambda r: counts[r]) if beyond_glass else Reason.MISSED_GLASS
    raise RigError(f"The display stays dark: {REMEDIES[reason]}.")


def _of_the_picture(rig: Rig, view_map: ViewMap, view_coverage: Floats) -> tuple[float, dict[str, float]]:
    """Share of the picture, as the viewer sees it, that is covered, and shares of it by reason of the misses: 1 in all.

    What is missing in a pixel is put down to the reasons of the rays at its corners and within. Where all of these have
    landed, it is beyond the display's edge, if one cell maps the pixel; else between branches finer than a pixel.
    """
    w, h = view_map.view_size
    unseen, lost = 0.0, np.zeros(len(Reason))
    within = _reasons_within(view_map)
    cover_of_view = cover_in_view(rig.picture, rig.viewer)
    shown = float(cover_of_view.sum())
    rows = max(1, PIXELS_AT_ONCE // w)
    for first in range(0, h, rows):
        cover = cover_of_view[first : first + rows].ravel()
        missing = np.clip(cover - view_coverage[first : first + rows].ravel(), 0, 1)
        unseen += missing.sum()
        some = np.flatnonzero(missing)
        top = view_map.reason[first : first + rows + 1]
        by_corner = np.stack([top[:-1, :-1], top[:-1, 1:], top[1:, :-1], top[1:, 1:]]).reshape(4, -1)[:, some]
        of_reason = by_corner[None] == np.arange(len(Reason))[:, None, None]
        votes = of_reason.sum(axis=1) + within[:, first * w + some]
        votes[Reason.ARRIVED] = 0
        at_edge = view_map.is_one_cell[first : first + rows].ravel()[some] & (votes.sum(axis=0) == 0)
        votes[Reason.MISSED_DISPLAY, at_edge] = 1
        lost += (missing[some] * votes / np.maximum(votes.sum(axis=0), 1)).sum(axis=1)
    if shown < UNSEEN:
        raise RigError(
            f"The viewer '{rig.viewer.name}' does not see the picture '{rig.picture.name}',"
            f" {why_unseen(rig.picture, rig.viewer)}."
        )
    misses = {REASON_WORDS[reason]: float(lost[reason] / shown) for reason in Reason if lost[reason] > 0}
    between = float((unseen - lost.sum()) / shown)
    if between > ROUNDING:
        misses[TOO_FINE] = between
    return float(1 - unseen / shown), misses


def _reasons_within(view_map: ViewMap) -> NDArray[np.uint16]:
    """How many rays within each viewer pixel, not on its edges, ended for each reason: (reasons, pixels)."""
    w, h = view_map.view_size
    view = view_map.points.view
    column, row = np.floor(view).astype(np.int64).T
    is_within = (view != np.floor(view)).all(axis=1) & (column < w) & (row < h)
    counts = np.zeros((len(Reason), w * h), np.uint16)
    np.add.at(counts, (view_map.points.reason[is_within], row[is_within] * w + column[is_within]), 1)
    return counts
