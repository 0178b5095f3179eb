"""Solver with caches: ray engines, view maps and shares, each found again by its content.

Nothing that has not changed is computed again: a new picture costs one product with the shares, a
moved viewer builds no ray engine. Shares are made, painted and summed in batches, so that there may
be more of them than fit into memory.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import frozen
from ..base.errors import RigError
from ..base.fingerprint import fingerprint
from ..base.messages import Message
from ..base.stages import AFTER, MAP, TRACING, section, spans
from ..base.steps import Steps, hold_progress, run_steps, subprogress
from ..image.pyramid import Pyramid, pyramids_of
from ..light.compile_plan import compile_plan_steps
from ..light.mesh_cache import MeshCache
from ..light.plan import Plan
from ..map.measured_error import checked
from ..map.view_map import ViewMap
from ..rig.rig import Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .accuracy import LEAST_LOST, leaks
from .channel import (
    NOT_KEPT,
    UNTRACED,
    Channel,
    ChannelMaps,
    Traced,
    channel_keys,
    measuring,
    sample_reached,
    weight_past_glass,
)
from .disagreement import Settled, is_comparable, is_sharp, settle
from .lateral_colour import MAP_EACH, Colours, LateralColour, why_one_map
from .memory import check_memory, check_traced
from .painting import PASS, Clock, Placed, finished, paint, place
from .picture_coverage import but_leaked, check_seen, of_displays, why_dark
from .projection import (
    Projection,
    project,
    remarks_on_projectors,
    settings_of_projectors,
    trace_projector,
)
from .reflected_picture import is_reflected, reflect_picture
from .remarks import remarks_on, remarks_on_displays
from .sharpening import SHARPENING, Sharpener
from .solution import Solution
from .through_pupil import PupilViews, views_of

PAINTED = 0.4  # progress of a solve that sharpens once the image is painted


class Optics(NamedTuple):
    """The part of a solve that does not depend on the picture: each channel and its key."""

    keys: tuple[str, ...]
    channels: tuple[Traced, ...]

    @property
    def maps(self) -> tuple[ViewMap, ...]:
        """View map of each channel."""
        return tuple(traced.view_map for traced in self.channels)

    @property
    def by_key(self) -> dict[str, Traced]:
        """Channels by key."""
        return dict(zip(self.keys, self.channels, strict=True))


class PlacedParts(NamedTuple):
    """The part that depends on the picture's place and size: each channel and its key.

    together : key of the weights and of how viewers' disagreement is settled
    settled : None if there is nothing to settle
    """

    keys: tuple[str, ...]
    channels: tuple[Placed, ...]
    together: str
    settled: Settled | None = None


class Shown(NamedTuple):
    """The light of the last source image, and all that it was painted from."""

    place: PlacedParts
    pyramids: tuple[Pyramid, ...]
    settings: Settings
    light: NDArray[np.float32]


def keys_of(rig: Rig, settings: Settings) -> tuple[str, ...]:
    """Key of each channel's view map."""
    lit = dict(zip(rig.viewers, rig.light_keys, strict=True))
    keys = channel_keys(rig, settings)
    return tuple(fingerprint(lit[key.viewer], key.of(settings).of_optics) for key in keys)


def placed_for(
    rig: Rig, settings: Settings, optics: Optics, before: PlacedParts | None
) -> PlacedParts:
    """Shares of all channels for a picture's place and size, from the cache if they are there."""
    of_rig = channel_keys(rig, settings)
    pictures = [rig.place_of(one.viewer) for one in of_rig]
    keys = tuple(
        fingerprint(key, picture, settings.ghosts)
        for key, picture in zip(optics.keys, pictures, strict=True)
    )
    weights = tuple((one.viewer.weight, one.colours) for one in of_rig)
    together = fingerprint(keys, weights, is_comparable(rig), is_sharp(rig, settings))
    if before is not None and before.together == together:
        return before

    cached = {} if before is None else dict(zip(before.keys, before.channels, strict=True))
    for key in set(cached) - set(keys):  # before new ones are made, to save memory
        cached[key].let_go()

    channels = []
    of_each = zip(keys, optics.channels, of_rig, pictures, strict=True)
    for key, traced, one, picture in of_each:
        old = cached.get(key)
        if old is not None:
            old.filter_taps = None  # the new channel makes its own
        channels.append(
            place(traced.view_map, picture, one, settings)
            if old is None
            # Filter taps and steps depend on the other channels.
            else replace(old, key=one, filter_taps=None, lacks_memory=False, step=None)
        )

    for placed in channels:
        placed.shares.share_memory(len(channels))
    return PlacedParts(keys, tuple(channels), together)


def uncovered(optics: Optics, place: PlacedParts) -> list[tuple[Placed, ViewMap]]:
    """Channels whose picture coverage is not computed yet, with their maps."""
    both = zip(optics.channels, place.channels, strict=True)
    return [(one, traced.view_map) for traced, one in both if one.covered is None]


def cover(uncovered: Sequence[tuple[Placed, ViewMap]]) -> Generator[float, None, None]:
    """Compute how much of the picture is seen; yields progress 0..1."""
    for k, (placed, view_map) in enumerate(uncovered):
        yield from hold_progress(k / len(uncovered), placed.cover(view_map))


def plans_of(rig: Rig, settings: Settings, optics: Optics) -> list[Plan]:
    """Plan of each channel, for a rig that differs from the traced one in picture and names at
    most.
    """
    return [
        replace(traced.plan, rig=rig, settings=key.of(settings), viewer=key.viewer)
        for key, traced in zip(channel_keys(rig, settings), optics.channels, strict=True)
    ]


def unmeasured(optics: Optics, plans: Sequence[Plan]) -> list[tuple[Traced, Plan]]:
    """Channels not measured yet with the picture at its present place, with their plans."""
    picture = fingerprint(plans[0].rig.picture_place)
    return [
        (traced, plan)
        for traced, plan in zip(optics.channels, plans, strict=True)
        if traced.measured is None or traced.measured.picture != picture
    ]


def measure(unmeasured: Sequence[tuple[Traced, Plan]], clock: Clock) -> Generator[float, None, int]:
    """Measure traced channels; yields progress 0..1 and returns the number of rays used for
    checks.
    """
    n_rays = 0
    for n, (traced, plan) in enumerate(unmeasured):
        start, stop = (k / len(unmeasured) for k in (n, n + 1))
        before = traced.view_map
        traced.view_map = yield from hold_progress(start, checked(plan, before))
        if traced.view_map is not before:
            n_rays += traced.view_map.n_rays - before.n_rays
            clock.lap("tracing")
        steps = measuring(plan, traced.view_map, clock.lap, traced.measured)
        traced.measured = yield from subprogress(steps, start, stop)
    return n_rays


def channels_of(
    plans: Sequence[Plan], optics: Optics, place: PlacedParts, light: NDArray[np.float32]
) -> tuple[Channel, ...]:
    """The channel of each viewer."""
    of_each = zip(plans, optics.channels, place.channels, strict=True)
    return Channel.joined([_channel(*of_one, light) for of_one in of_each])


def _channel(plan: Plan, traced: Traced, placed: Placed, light: NDArray[np.float32]) -> Channel:
    """A completely painted channel.

    plan : as traced, for the rig that is solved
    light : (H, W, 3) wanted of the display
    """
    picture_coverage, misses = placed.covered
    stray, shown = traced.measured.stray, plan.rig.display.nearest(light)
    measured = traced.measured
    if sum(measured.accuracy.leaked.values()) > LEAST_LOST:
        picture_coverage, misses = but_leaked(picture_coverage, misses, measured.accuracy.leaked)

    return Channel(
        plan=plan,
        view_map=traced.view_map,
        accuracy=measured.accuracy,
        plate=measured.plate,
        glare=stray.seen_of(shown) if plan.settings.only_through_glass else None,
        split=stray.split_of(shown) if plan.n_copies else None,
        shares=placed.shares,
        shown=placed.shown,
        coverage=placed.coverage,
        view_coverage=placed.view_coverage,
        picture_coverage=picture_coverage,
        misses=misses,
    )


class Session:
    """A sequence of solves that share caches."""

    def __init__(self, cache: MeshCache | None = None) -> None:
        self._cache = cache or MeshCache()
        self._optics: Optics | None = None
        self._placed: PlacedParts | None = None
        self._pyramids: tuple[Pyramid, ...] = ()  # for each channel's image
        self._shown: Shown | None = None
        self._projections: dict[str, Projection] = {}
        self._colours = Colours(self._cache)
        self._views: dict[str, PupilViews] = {}
        self._sharpener = Sharpener()
        self.is_tracing = False  # whether a view map is being traced

    def solve(
        self,
        rig: Rig,
        settings: Settings | None = None,
        show: Callable[[NDArray[np.float32]], None] | None = None,
        is_moving: bool = False,
    ) -> Generator[float, None, Solution]:
        """Paint the source image of a rig; yields progress 0..1 and returns a Solution.

        is_moving : the rig rather than the picture is about to change
        show : receives the source image as soon as it is painted, if there is still something to
            measure

        Raises
        ------
        RigError, MeshError
            One sentence on the rig's fault; the session stays as it was.
        """
        settings = (settings or Settings()).for_rig(rig)
        rig.check()
        settings.check()
        if is_reflected(rig):
            rig = yield from hold_progress(0.0, reflect_picture(rig, settings, self._cache))
        if not rig.projectors:
            return (yield from self._solve(rig, settings, show, is_moving))

        projections = yield from subprogress(self._trace_projectors(rig, settings), 0.0, 0.4)
        found = yield from subprogress(self._solve(rig, settings, show, is_moving), 0.4, 0.9)
        images = yield from subprogress(project(projections, rig, found.source), 0.9, 1.0)
        remarks = found.remarks + remarks_on_projectors(projections, rig, found.source)
        yield 1.0
        return replace(found, projected=images, remarks=remarks)

    def _trace_projectors(
        self, rig: Rig, settings: Settings
    ) -> Generator[float, None, tuple[Projection, ...]]:
        """Light of all projectors, from the cache if it is there; yields progress 0..1."""
        keys = replace(rig, viewers=rig.projectors).light_keys
        keys = tuple(fingerprint(key, settings_of_projectors(settings)) for key in keys)
        found = {key: one for key, one in self._projections.items() if key in keys}
        for k, (key, projector) in enumerate(zip(keys, rig.projectors, strict=True)):
            if key not in found:
                steps = trace_projector(rig, projector, settings, self._cache)
                span = section((0.0, 1.0), k, len(keys))
                found[key] = yield from subprogress(steps, *span)
        self._projections = found
        return tuple(found[key] for key in keys)

    def _solve(
        self,
        rig: Rig,
        settings: Settings,
        show: Callable[[NDArray[np.float32]], None] | None,
        is_moving: bool,
    ) -> Generator[float, None, Solution]:
        """`solve` without projectors."""
        steps = self._paint(rig, settings, show, is_moving)
        end = PAINTED if settings.sharpen else 1.0
        found, plans, optics, light = yield from subprogress(steps, 0.0, end)
        self._views = views_of(plans, optics.maps, optics.keys, self._views)
        views = tuple(self._views.values())
        if not settings.sharpen:
            return replace(found, views=views, left_out=(*found.left_out, SHARPENING))

        clock = Clock()
        past_glass = [traced.weight_past_glass for traced in optics.channels]
        steps = self._sharpener.sharpened(plans, views, past_glass, light)
        sharp = yield from subprogress(steps, end, 1.0)
        clock.lap("sharpening")
        channels = channels_of(plans, optics, self._placed, sharp.light)
        by_display = yield from hold_progress(1.0, _by_display(channels))
        remarks = remarks_on(channels, sharp.light, found.colour)
        return replace(
            found,
            source=found.rig.display.source_for(sharp.light),
            channels=channels,
            remarks=remarks + remarks_on_displays(found.rig, by_display),
            seconds=found.seconds | clock.seconds,
            used=(*found.used, SHARPENING),
            views=views,
            sharpened=sharp,
        )

    def _paint(
        self,
        rig: Rig,
        settings: Settings,
        show: Callable[[NDArray[np.float32]], None] | None,
        is_moving: bool,
    ) -> Generator[float, None, tuple[Solution, list[Plan], Optics, NDArray[np.float32]]]:
        """The painted solution, its plans and optics, and the light that is wanted of the display;
        yields progress 0..1.
        """
        clock = Clock()
        rig, apart = yield from hold_progress(0.0, self._colours.needed(rig, settings))
        keys = keys_of(rig, settings)
        clock.lap("fingerprint")

        optics, n_rays = self._optics, 0
        is_new = not self._has(keys)
        if is_new or optics.keys != keys:
            span, *_ = spans(TRACING, *AFTER)
            optics, n_rays = yield from subprogress(
                self._trace_missing(rig, settings, keys, clock), *span
            )

        # painting, and the measurements that are missing
        placed = placed_for(rig, settings, optics, self._placed)
        plans = plans_of(rig, settings, optics)
        to_be_measured = unmeasured(optics, plans)
        to_be_covered = uncovered(optics, placed)
        done = TRACING if is_new else ()
        rest = ("coverage",) if to_be_covered else (), ("measuring",) if to_be_measured else ()
        _, painted, covered, measured = spans(done, ("painting",), *rest)
        yield painted[0]

        steps = self._light_of(placed, optics, rig, settings, clock, not is_moving)
        pyramids, placed, light = yield from subprogress(steps, *painted)
        yield from hold_progress(covered[0], self._take_up(optics, placed))
        source = rig.display.source_for(light)

        for one, _ in to_be_covered:
            check_seen(one.picture, one.viewer)
        self._placed, self._shown = placed, Shown(placed, pyramids, settings, light)
        if show is not None and (to_be_covered or to_be_measured):
            show(source)

        # what the source image does not show
        yield covered[0]
        yield from subprogress(cover(to_be_covered), *covered)
        clock.lap("coverage")
        yield measured[0]
        n_rays += yield from subprogress(measure(to_be_measured, clock), *measured)
        channels = channels_of(plans, optics, placed, light)
        colour = self._colours.lateral(plans, optics.maps, optics.keys, apart)
        by_display = yield from hold_progress(measured[1], _by_display(channels))
        clock.lap("coverage")

        yield 1.0
        solution = Solution(
            rig=rig,
            source=source,
            channels=channels,
            seconds=clock.seconds,
            n_rays=n_rays,
            used=channels[0].plan.used + ((MAP_EACH,) if rig.disperses else ()),
            left_out=channels[0].plan.left_out + _left_out(is_new, placed.channels, colour),
            remarks=remarks_on(channels, light, colour) + remarks_on_displays(rig, by_display),
            colour=colour,
            by_display=by_display[0] if by_display else (),
            settled=placed.settled,
        )
        return solution, plans, optics, light

    def solve_preview(
        self, rig: Rig, settings: Settings
    ) -> Generator[float, None, NDArray[np.float32]]:
        """Source image of a coarse rig, without measurements; yields progress 0..1.

        The rig was checked before. The last solve and the prepared glass stay cached, so this may
        be called during a solve.

        Raises
        ------
        RigError, MeshError : like `solve`, but in other words
        """
        clock = Clock()
        settings = settings.for_rig(rig)
        traced, painted = spans(TRACING, ("painting",))
        maps = yield from subprogress(self.view_maps(rig, settings, is_coarse=True), *traced)
        found = [
            (view_map, place(view_map, rig.place_of(key.viewer), key, settings))
            for key, view_map in maps
        ]

        channels = [placed for _, placed in found]
        if is_sharp(rig, settings):
            yield from hold_progress(painted[0], settle(channels, clock, is_sharp=True))
        painting = yield from subprogress(
            paint(channels, self._pyramids_of(rig, channels), clock, are_kept=False), *painted
        )
        if not any(len(placed.shares) for placed in channels):
            raise RigError("The display stays dark.")

        past_glass = []
        for view_map, placed in found:
            check_seen(placed.picture, placed.viewer)
            past_glass.append(
                (yield from hold_progress(1.0, weight_past_glass(view_map, settings)))
            )

        return rig.display.source_for(finished(painting, channels, past_glass, settings))

    def view_maps(
        self, rig: Rig, settings: Settings, is_coarse: bool = False
    ) -> Generator[float, None, ChannelMaps]:
        """Each channel and its view map, from the cache if they are there; yields progress 0..1.

        is_coarse : for a first picture, see `Sampling`; these are not cached
        """
        settings = settings.for_rig(rig)
        clock = Clock()
        if is_coarse:
            rig = rig.in_one_colour(settings.wavelength)
        else:
            rig, _ = yield from hold_progress(0.0, self._colours.needed(rig, settings))
        of_rig = channel_keys(rig, settings)
        if not is_coarse:
            keys = keys_of(rig, settings)
            if not self._has(keys):
                self._optics, _ = yield from self._trace_missing(rig, settings, keys, clock)
            by_key = self._optics.by_key
            return [(one, by_key[key].view_map) for one, key in zip(of_rig, keys, strict=True)]

        found = []
        for k, one in enumerate(of_rig):
            of_it = one.viewer, one.of(settings), self._cache
            steps = sample_reached(rig, *of_it, clock.lap, is_coarse=True)
            _, view_map = yield from subprogress(steps, *section((0.0, 1.0), k, len(of_rig)))
            found.append((one, view_map))
        return found

    def plan(self, rig: Rig, settings: Settings) -> Plan:
        """The rig ready for tracing, with all of its glass, from the caches."""
        rig.check()
        settings.check()
        return run_steps(compile_plan_steps(rig, settings, self._cache))

    def has_view_maps(self, rig: Rig, settings: Settings) -> bool:
        """Whether the view maps of a rig are cached, so that a solve traces none."""
        settings = settings.for_rig(rig)
        needed = self._colours.cached(rig, settings)
        return needed is not None and self._has(keys_of(needed, settings))

    def _has(self, keys: tuple[str, ...]) -> bool:
        return self._optics is not None and set(keys) <= set(self._optics.keys)

    def lend(self, cache: MeshCache) -> None:
        """Share the prepared glass with another cache."""
        cache.borrow(self._cache)

    def _take_up(self, optics: Optics, placed: PlacedParts) -> Steps[None]:
        """Cache new optics unless the display stays dark."""
        if optics is not self._optics and not any(len(one.shares) for one in placed.channels):
            dark = optics.channels[0]
            raise why_dark(dark, (yield from leaks(dark.plan)))
        self._optics = optics

    def _light_of(
        self,
        place: PlacedParts,
        optics: Optics,
        rig: Rig,
        settings: Settings,
        clock: Clock,
        are_kept: bool,
    ) -> Generator[float, None, tuple[tuple[Pyramid, ...], PlacedParts, NDArray[np.float32]]]:
        """Settle the viewers' disagreement if needed, and paint, unless nothing changed; yields
        progress 0..1. Another solve may run during a pause.
        """
        pyramids, shown = self._pyramids_of(rig, place.channels), self._shown
        if shown is not None and shown[:3] == (place, pyramids, settings):
            return pyramids, place, shown.light

        part = 0.0
        if _is_to_be_settled(place, rig):
            part = PASS
            steps = settle(place.channels, clock, is_sharp(rig, settings))
            place = place._replace(settled=(yield from subprogress(steps, 0.0, part)))

        steps = paint(place.channels, pyramids, clock, are_kept)
        painting = yield from subprogress(steps, part, 1.0)
        past_glass = [traced.weight_past_glass for traced in optics.channels]
        light = frozen(finished(painting, place.channels, past_glass, settings))
        clock.lap("painting")
        return pyramids, place, light

    def _pyramids_of(self, rig: Rig, channels: Sequence[Placed]) -> tuple[Pyramid, ...]:
        """Pyramid of each channel's image, cached while the image stays the same."""
        images = [rig.picture_of(placed.viewer).image for placed in channels]
        self._pyramids = pyramids_of(images, self._pyramids)
        return self._pyramids

    def _trace_missing(
        self, rig: Rig, settings: Settings, keys: tuple[str, ...], clock: Clock
    ) -> Generator[float, None, tuple[Optics, int]]:
        """Trace the missing view maps of a rig; yields progress 0..1 and returns the number of rays
        too.
        """
        cached = {} if self._optics is None else self._optics.by_key
        of_rig = channel_keys(rig, settings)
        new = {key: one for key, one in zip(keys, of_rig, strict=True) if key not in cached}
        of_new = replace(rig, viewers=tuple(one.viewer for one in new.values()))
        n_rays = 0
        if new:
            of_all = replace(rig, viewers=tuple(one.viewer for one in of_rig))
            are_cached = [one not in new.values() for one in of_rig]
            check_memory(of_all, settings, are_cached, is_checked_again=True)

        for k, (key, one) in enumerate(new.items()):
            span = section((0.0, 1.0), k, len(new))
            steps = self._trace(rig, one.viewer, one.of(settings), clock)
            traced = yield from subprogress(steps, *span)
            yield span[1]
            check_traced(of_new, one.viewer, settings, traced.view_map)
            cached[key] = traced
            n_rays += traced.view_map.n_rays

        return Optics(keys, tuple(cached[key] for key in keys)), n_rays

    def _trace(
        self, rig: Rig, viewer: Viewer, settings: Settings, clock: Clock
    ) -> Generator[float, None, Traced]:
        """Trace the view map of one viewer at one wavelength; yields progress 0..1."""
        reached, spread = spans(("plan", *MAP), ("spread",))
        self.is_tracing = True
        try:
            steps = sample_reached(rig, viewer, settings, self._cache, clock.lap)
            plan, view_map = yield from subprogress(steps, *reached)
        finally:
            self.is_tracing = False

        clock.lap("tracing")
        yield spread[0]
        yield from hold_progress(spread[0], view_map.spread_samples())
        clock.lap("shares")
        yield spread[1]
        weight = yield from hold_progress(spread[1], weight_past_glass(view_map, settings))
        clock.lap("glare")
        return Traced(plan, view_map, weight)


def _left_out(
    is_new: bool, channels: Sequence[Placed], colour: LateralColour | None
) -> tuple[Message, ...]:
    """Parts of a solve that were not needed, or had no room."""
    is_one_map = colour is None or colour.is_one_map
    found = (why_one_map(colour) if is_one_map else ()) + (() if is_new else (UNTRACED,))
    return (*found, NOT_KEPT) if any(one.lacks_memory for one in channels) else found


def _by_display(channels: Sequence[Channel]) -> Steps[list[tuple[float, ...]]]:
    """For each channel the parts of the picture on each display; none for a single display."""
    found = []
    for channel in channels if len(channels[0].plan.rig.lit) > 1 else ():
        found.append((yield from of_displays(channel)))
    return found


def _is_to_be_settled(place: PlacedParts, rig: Rig) -> bool:
    """Whether the viewers' disagreement is still to be settled."""
    return place.settled is None and is_comparable(rig)
