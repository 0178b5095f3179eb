"""What a session knows of one solve for the next: view maps and shares of each viewer, by a key."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.fingerprint import fingerprint
from ..base.steps import at, within
from ..light.plan import Plan
from ..light.rays import BY_GAPS, REASON_WORDS, Reason
from ..map.measured_error import checked
from ..map.view_map import ViewMap
from ..rig.rig import Rig
from ..rig.settings import Settings
from .accuracy import LEAST_LOST
from .channel import Channel, Traced, channel_keys
from .disagreement import Settled, is_comparable, is_sharp
from .measured import measuring
from .painting import Clock, Placed, place


class Optics(NamedTuple):
    """The part of a solve that does not depend on the picture, for each channel, and its key."""

    keys: tuple[str, ...]
    channels: tuple[Traced, ...]

    @property
    def by_key(self) -> dict[str, Traced]:
        """The channels by their keys."""
        return dict(zip(self.keys, self.channels, strict=True))


class Place(NamedTuple):
    """The part that depends on the picture's place and size, for each channel, and its key.

    together : the key of all that they share in painting: weights, and how they are settled
    settled : None where there is nothing to be settled
    """

    keys: tuple[str, ...]
    channels: tuple[Placed, ...]
    together: str
    settled: Settled | None = None


def keys_of(rig: Rig, settings: Settings) -> tuple[str, ...]:
    """The key of each channel's view map."""
    lit = dict(zip(rig.viewers, rig.light_keys, strict=True))
    keys = channel_keys(rig, settings)
    return tuple(fingerprint(lit[key.viewer], key.of(settings).of_optics) for key in keys)


def placed_for(rig: Rig, settings: Settings, optics: Optics, before: Place | None) -> Place:
    """The shares of all channels for a picture's place and size: known ones, or new ones."""
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

    known = {} if before is None else dict(zip(before.keys, before.channels, strict=True))
    for key in set(known) - set(keys):  # or there would be twice as many
        known[key].let_go()

    channels = []
    of_each = zip(keys, optics.channels, of_rig, pictures, strict=True)
    for key, traced, one, picture in of_each:
        old = known.get(key)
        if old is not None:
            old.strokes.clear()  # or they would be there twice until the solve ends
        channels.append(
            place(traced.view_map, picture, one, settings)
            if old is None
            # what is settled with others is painted in another way
            else replace(old, key=one, strokes=[], step=None)
        )

    for placed in channels:
        placed.shares.share_memory(len(channels))
    return Place(keys, tuple(channels), together)


def uncovered(optics: Optics, place: Place) -> list[tuple[Placed, ViewMap]]:
    """The channels of which it is not known how much of the picture is seen, with their maps."""
    both = zip(optics.channels, place.channels, strict=True)
    return [(one, traced.view_map) for traced, one in both if one.covered is None]


def cover(uncovered: Sequence[tuple[Placed, ViewMap]]) -> Generator[float, None, None]:
    """Find how much of the picture is seen; yields progress 0..1."""
    for k, (placed, view_map) in enumerate(uncovered):
        yield from at(k / len(uncovered), placed.cover(view_map))


def plans_of(rig: Rig, settings: Settings, optics: Optics) -> list[Plan]:
    """The plan of each channel, for a rig that is equal to the one that was traced but for its
    picture, and perhaps for names.
    """
    return [
        replace(traced.plan, rig=rig, settings=key.of(settings), viewer=key.viewer)
        for key, traced in zip(channel_keys(rig, settings), optics.channels, strict=True)
    ]


def unmeasured(optics: Optics, plans: Sequence[Plan]) -> list[tuple[Traced, Plan]]:
    """The channels that were not measured with the picture where it is now, with their plans."""
    picture = fingerprint(plans[0].rig.picture_place)
    return [
        (traced, plan)
        for traced, plan in zip(optics.channels, plans, strict=True)
        if traced.measured is None or traced.measured.picture != picture
    ]


def measure(unmeasured: Sequence[tuple[Traced, Plan]], clock: Clock) -> Generator[float, None, int]:
    """Measure what was traced; yields progress 0..1, and returns the number of rays that view maps
    were checked with.
    """
    n_rays = 0
    for n, (traced, plan) in enumerate(unmeasured):
        start, stop = (k / len(unmeasured) for k in (n, n + 1))
        before = traced.view_map
        traced.view_map = yield from at(start, checked(plan, before))
        if traced.view_map is not before:
            n_rays += traced.view_map.n_rays - before.n_rays
            clock.lap("tracing")
        steps = measuring(plan, traced.view_map, clock.lap, traced.measured)
        traced.measured = yield from within(steps, start, stop)
    return n_rays


def channels_of(
    plans: Sequence[Plan], optics: Optics, place: Place, light: NDArray[np.float32]
) -> tuple[Channel, ...]:
    """All channels of a rig."""
    return tuple(
        _channel(*of_one, light)
        for of_one in zip(plans, optics.channels, place.channels, strict=True)
    )


def _but_leaked(
    coverage: float, misses: dict[str, float], leaked: dict[Reason, float]
) -> tuple[float, dict[str, float]]:
    """Coverage and misses in which light that goes through gaps has no other fate: it may be
    painted, but nobody knows its way.
    """
    lost = {REASON_WORDS[r]: share for r, share in leaked.items() if r != Reason.ARRIVED}
    gone = {word: min(share, lost.get(word, 0.0)) for word, share in misses.items()}
    arrived = min(leaked[Reason.ARRIVED], coverage)
    left = {word: share - gone[word] for word, share in misses.items() if share > gone[word]}
    return coverage - arrived, {**left, BY_GAPS: arrived + sum(gone.values())}


def _channel(plan: Plan, traced: Traced, placed: Placed, light: NDArray[np.float32]) -> Channel:
    """A channel, all shares of which are painted.

    plan : as traced, of the very rig that is solved
    light : (H, W, 3) that is wanted of the display
    """
    picture_coverage, misses = placed.covered
    measured = traced.measured
    if sum(measured.accuracy.leaked.values()) > LEAST_LOST:
        picture_coverage, misses = _but_leaked(picture_coverage, misses, measured.accuracy.leaked)

    return Channel(
        plan=plan,
        view_map=traced.view_map,
        accuracy=measured.accuracy,
        plate=measured.plate,
        glare=measured.beside and measured.beside.seen_of(plan.rig.display.nearest(light)),
        shares=placed.shares,
        shown=placed.shown,
        coverage=placed.coverage,
        view_coverage=placed.view_coverage,
        picture_coverage=picture_coverage,
        misses=misses,
    )
