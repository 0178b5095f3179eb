"""What several viewers ask of one display, and which place of the picture each of its pixels shows.

A pixel that viewers v ask for the places p_v of the picture shows their weighted mean

    p = sum(w_v c_v p_v) / sum(w_v c_v),

with the viewer's weight w and the part c of the pixel that it sees. It is that of least squares,
whichever way the disagreement is settled: *sharp* shows the picture at this place, *blended* its
colours at all of the places, whose middle this is. The *conflict* of a pixel is the deviation that
is left, sqrt(sum(w_v c_v |p_v - p|^2) / sum(w_v c_v)): no source image removes it.

A viewer to which a part of a pixel shows the picture asks for the place of that part, which lies
beside that of the whole by up to half of the rest, each way. By so much places differ for viewers
that agree, so that only what is left of a difference counts as disagreement.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats
from ..base.steps import subprogress
from ..image.inverse_lookup import plane_mapping
from ..rig.rig import Rig
from ..rig.settings import Settings
from .painting import Clock, Placed, count


@dataclass(frozen=True, eq=False)
class Settled:
    """How the viewers' disagreement is settled.

    steps : for each viewer (2, H, W) picture px, from the place that it asks a display pixel for to
        the one that the pixel shows; NaN where it asks for none
    conflict : (H, W) picture px; 0 where fewer than two viewers ask
    """

    steps: tuple[Floats, ...]
    conflict: Floats


def is_comparable(rig: Rig) -> bool:
    """Are there several viewers, whose places on the picture can be compared?

    Places on images that are one viewer's alone have nothing to do with each other.
    """
    if len(rig.viewers) < 2 or rig.has_own_images:
        return False
    return all(plane_mapping(rig.picture_place, viewer) is not None for viewer in rig.viewers)


def is_sharp(rig: Rig, settings: Settings) -> bool:
    """Does a display pixel show the picture at the mean of the places that viewers ask for?

    A picture in the viewers' own pixels is another one for each: it is blended.
    """
    is_on_plane = rig.picture_place.mesh is not None
    return settings.disagreement == "sharp" and is_on_plane and is_comparable(rig)


def settle(
    channels: Sequence[Placed], clock: Clock, is_sharp: bool
) -> Generator[float, None, Settled]:
    """Look for the places that all viewers ask for, and for those that are shown; yields progress
    0..1. Where it is sharp, the shares are painted as these are.
    """
    n = len(channels)
    for k, placed in enumerate(channels):
        if placed.asked is None:
            yield from subprogress(count(placed, clock), k / n, (k + 1) / n)

    shape = channels[0].coverage.weight.shape
    total = np.zeros((2, *shape))
    weight = np.zeros(shape)
    for placed in channels:
        places, part = placed.asked.places, _part(placed)
        total += np.where(part > 0, places, 0.0) * part
        weight += part

    # a pixel that one viewer alone asks for shows the very place
    n_asking = sum((_part(placed) > 0).astype(int) for placed in channels)
    divisor = np.where(weight > 0, weight, 1.0)
    mean = total / divisor
    beside = [_beside(placed) for placed in channels]
    of_mean = sum(_part(placed) * own for placed, own in zip(channels, beside, strict=True))
    square = np.zeros(shape)
    steps = []
    for placed, own in zip(channels, beside, strict=True):
        places = placed.asked.places
        step = np.where(n_asking > 1, mean - places, np.where(np.isnan(places), np.nan, 0.0))
        step = _shortened(step, own + of_mean / divisor)
        square += _part(placed) * np.nan_to_num((step**2).sum(axis=0))
        steps.append(step)
        if is_sharp:
            placed.step = np.nan_to_num(step).reshape(2, -1)

    clock.lap("disagreement")
    conflict = np.sqrt(square / divisor)
    return Settled(tuple(steps), conflict)


def _part(placed: Placed) -> Floats:
    """How much (H, W) a viewer counts in the mean of a pixel: 0 where it asks for no place."""
    is_asking = np.isfinite(placed.asked.places).all(axis=0)
    return placed.viewer.weighed(placed.coverage.of_display * is_asking)


def _beside(placed: Placed) -> Floats:
    """How far (H, W) the place that a part of a pixel asks for may lie from that of the whole,
    picture px: by as much as places change within half of the rest.
    """
    places = placed.asked.places
    change = np.zeros(places.shape[1:])
    for axis in (1, 2):
        steps = np.linalg.norm(np.diff(places, axis=axis), axis=0)
        # largest of the steps around: those to a pixel that is seen in part are too short
        around = np.zeros(places.shape[1:])
        n = places.shape[axis]
        for k in range(-2, 2):
            here = slice(max(-k, 0), min(n - 1 - k, n))
            at = (slice(None),) * (axis - 1) + (here,)
            of = (slice(None),) * (axis - 1) + (slice(here.start + k, here.stop + k),)
            around[at] = np.fmax(around[at], steps[of])
        change += around
    return 0.5 * (1.0 - placed.asked.parts) * change


def _shortened(step: Floats, by: Floats) -> Floats:
    """Steps (2, H, W) shorter by lengths (H, W), none below 0."""
    length = np.linalg.norm(step, axis=0)
    return step * np.clip(1.0 - by / np.where(length > 0, length, 1.0), 0.0, 1.0)
