"""Painting: from a view map's shares to the source image, for a picture at its place."""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import inf
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.free_memory import available
from ..base.steps import Steps, subprogress
from ..image.ghosts import strongest_paths
from ..image.inverse_lookup import InverseLookup, moved_in_view
from ..image.outline import cut_along_outline
from ..image.pyramid import Pyramid
from ..image.source_image import FilterTaps, Painting, find_filter_taps
from ..map.pieces import Piece
from ..map.shares import Coverage, ShareBatches, Shares
from ..map.view_map import ViewMap
from ..rig.rig import PicturePlace
from ..rig.settings import WHITE, Settings
from ..rig.viewer import Viewer
from .channel import ChannelKey, shares_of
from .picture_coverage import of_the_picture

SHARE_OF_FREE = 0.5  # of the free memory, for filter taps kept for the next picture,
STAYS_FREE = 1 << 30  # bytes, apart from these: shares are made and cached at the same time
PASS = 0.5  # progress of the first of two equal passes over all shares


@dataclass(eq=False)
class Placed:
    """The part of a channel that depends on the picture's place and size, not on its colours.

    n_pieces : pieces of the map that the shares come from
    coverage : complete after the first pass over all shares
    is_counted : whether coverage is complete
    lookup : the picture's place for each display pixel; None until `count`
    step : (2, H * W) picture px, from there to the place that is shown; None for no step
    filter_taps, lacks_memory : of all shares, for the next picture; None until they are kept, and
        whether memory was too small for them
    strongest : (H * W,) light path that each pixel shows; None for the mean of all paths
    """

    key: ChannelKey
    picture: PicturePlace
    shares: ShareBatches
    n_pieces: int
    coverage: Coverage
    is_counted: bool = False
    lookup: InverseLookup | None = None
    step: Floats | None = None
    strongest: NDArray[np.uint64] | None = None
    view_coverage: Floats | None = None
    filter_taps: list[FilterTaps] | None = None
    lacks_memory: bool = False
    covered: tuple[float, dict[str, float]] | None = None

    @property
    def viewer(self) -> Viewer:
        return self.key.viewer

    def let_go(self) -> None:
        """Drop cached shares and filter taps; they are made again on demand."""
        self.shares.let_go()
        self.filter_taps = None

    def part_done(self, n: int) -> float:
        """Progress 0..1 of a pass after n shares.

        It counts shares if they are cached, otherwise the pieces they are made of.
        """
        if self.shares.are_cached:
            return n / max(len(self.shares), 1)
        return min(self.shares.n_divided / max(self.n_pieces, 1), 1.0)

    def shown(self, shares: Shares) -> Shares:
        """The shares that display pixels show."""
        if self.strongest is None:
            return shares
        return shares.at(np.flatnonzero(self.strongest[shares.display_index] == shares.path))

    def weighed(self, shares: Shares) -> Shares:
        """Shares as painted: scaled by the viewer's weight, moved to the places to show."""
        if self.viewer.weight != 1:
            shares = replace(shares, area=self.viewer.weighed(shares.area))
        if self.step is None:
            return shares
        return moved_in_view(shares, self.picture, self.viewer, self.step)

    def cover(self, view_map: ViewMap) -> Steps[None]:
        """Compute how much of the picture the display can show, unless cached.

        Raises
        ------
        RigError : the picture is out of sight
        """
        if self.covered is None:
            self.view_coverage = self.view_coverage_in(view_map)
            yield 0
            steps = of_the_picture(self.picture, self.viewer, view_map, self.view_coverage)
            self.covered = yield from steps

    def view_coverage_in(self, view_map: ViewMap) -> Floats:
        """Fraction (h, w) of each viewer pixel connected to the display, 0..1."""
        return np.where(view_map.is_whole, 1.0, self.coverage.of_view)


class Clock:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, part: str) -> None:
        """Add the time since the last lap to a stage."""
        now = perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._last
        self._last = now


def paint(
    channels: Sequence[Placed], pyramids: Sequence[Pyramid], clock: Clock, are_kept: bool = True
) -> Generator[float, None, Painting]:
    """Paint the shares of all channels, each with its pyramid; yields progress 0..1.

    The first pass also completes each channel's coverage.

    are_kept : keep filter taps for the next picture; otherwise they are from the second pass on
    """
    painting = Painting(channels[0].shares.display_size)
    for k, (placed, pyramid) in enumerate(zip(channels, pyramids, strict=True)):
        is_white = placed.key.colours == WHITE
        own = painting if is_white else Painting(placed.shares.display_size)
        steps = _strongest_first(placed, clock, _add(own, placed, pyramid, clock, are_kept))
        yield from subprogress(steps, k / len(channels), (k + 1) / len(channels))
        if not is_white:
            painting.join(own, placed.key.colours)
    return painting


def _add(
    painting: Painting, placed: Placed, pyramid: Pyramid, clock: Clock, are_kept: bool
) -> Generator[float, None, None]:
    """Add the shares of a channel to a painting; yields progress 0..1."""
    kept = placed.filter_taps
    if kept is not None:
        for k, filter_taps in enumerate(kept):
            yield k / len(kept)
            painting.add(pyramid, filter_taps)
        clock.lap("painting")
        return

    is_new = not placed.is_counted
    room, are_kept = 0.0, (are_kept or not is_new) and not placed.lacks_memory
    if are_kept:
        free = available()
        free = inf if free is None else free - STAYS_FREE
        room = SHARE_OF_FREE * free / placed.shares.n_sharing
    kept = []
    n_painted, progress = 0, 0.0
    for shares in placed.shares.pausing():
        clock.lap("shares")
        # Another solve may be half way through the same batches.
        progress = max(progress, placed.part_done(n_painted))
        yield progress
        if shares is None:
            continue

        shown = placed.shown(shares)
        if is_new:
            placed.coverage.add(shares, shown)
            clock.lap("coverage")
            yield progress

        found = find_filter_taps(placed.picture, placed.viewer, placed.weighed(shown))
        yield progress
        painting.add(pyramid, found, are_kept=room > 0)
        room -= found.n_bytes
        if room > 0:
            kept.append(found)
        else:
            kept.clear()
        clock.lap("painting")

        n_painted += len(shares)
        progress = max(progress, placed.part_done(n_painted))
        yield progress

    placed.is_counted = True
    placed.filter_taps = kept if room > 0 else None
    placed.lacks_memory |= are_kept and room <= 0


def place(view_map: ViewMap, picture: PicturePlace, key: ChannelKey, settings: Settings) -> Placed:
    """A channel's shares for a picture at its place, not made yet."""
    shares = _shares_to_paint(view_map, picture, key.viewer, settings)
    return Placed(
        key=key,
        picture=picture,
        shares=shares,
        n_pieces=view_map.n_pieces,
        coverage=Coverage(shares.display_size, shares.view_size),
    )


def finished(
    painting: Painting,
    channels: Sequence[Placed],
    past_glass: Sequence[Floats | None],
    settings: Settings,
) -> NDArray[np.float32]:
    """Light (H, W, 3) for the display's pixels, from a complete painting.

    past_glass : for each channel the weight (H, W) of light past the glass; None if glare is kept
    """

    def summed(of_each: Sequence[Floats | None], colour: int) -> Floats | None:
        them = zip(channels, of_each, strict=True)
        found = [placed.key.weighed(one, colour) for placed, one in them if one is not None]
        return reduce(np.add, found) if found else None

    images = []
    is_grey = all(len(set(placed.key.colours)) == 1 for placed in channels)
    for colour in range(1 if is_grey else 3):
        weight = summed([placed.coverage.weight for placed in channels], colour)
        held_back = summed(past_glass, colour)
        if held_back is not None:
            held_back = settings.suppress_glare * held_back
        images.append(painting.finished(weight, settings.margin, held_back))
    if is_grey:
        return images[0]
    return np.stack([image[..., colour] for colour, image in enumerate(images)], axis=2)


def count(placed: Placed, clock: Clock) -> Generator[float, None, None]:
    """Find the places that a viewer needs, and complete the coverage; yields progress 0..1."""
    return _strongest_first(placed, clock, _count(placed, clock))


def _count(placed: Placed, clock: Clock) -> Generator[float, None, None]:
    lookup = InverseLookup(placed.picture, placed.viewer, placed.shares.display_size)
    n_counted, progress = 0, 0.0

    for shares in placed.shares.pausing():
        clock.lap("shares")
        yield progress
        if shares is None:
            continue
        shown = placed.shown(shares)
        if not placed.is_counted:
            placed.coverage.add(shares, shown)
            yield progress
        lookup.add(shown)
        clock.lap("coverage")

        n_counted += len(shares)
        progress = max(progress, placed.part_done(n_counted))
        yield progress

    placed.is_counted = True
    placed.lookup = lookup


def _strongest_first(
    placed: Placed, clock: Clock, work: Generator[float, None, None]
) -> Generator[float, None, None]:
    """Find the paths that pixels show, if needed, then do some work; yields the progress of
    both.
    """
    clock.lap("painting")
    found = 0.0
    if placed.shares.has_path and placed.strongest is None:
        found = PASS
        yield from subprogress(_find_strongest(placed), 0.0, PASS)
        clock.lap("ghosts")
    yield from subprogress(work, found, 1.0)


def _find_strongest(placed: Placed) -> Generator[float, None, None]:
    """Find the paths that pixels show, from shares made for it; yields progress 0..1."""
    steps, progress = strongest_paths(placed.shares), 0.0
    while True:
        try:
            next(steps)
        except StopIteration as done:
            placed.strongest = done.value
            return
        progress = max(progress, placed.part_done(0))
        yield progress


def _shares_to_paint(
    view_map: ViewMap, picture: PicturePlace, viewer: Viewer, settings: Settings
) -> ShareBatches:
    """Shares of a map's cells, cut along the picture's outline."""

    def pieces() -> Iterator[Piece]:
        return cut_along_outline(view_map.pieces(), picture, viewer)

    return shares_of(view_map, settings.brightness, pieces, has_path=settings.ghosts == "strongest")
