"""Several viewers of one display: the place of the picture that each display pixel shows.

If viewers v need a pixel to show the places p_v of the picture, the pixel shows their weighted mean

    p = sum(w_v c_v p_v) / sum(w_v c_v),

with the viewer's weight w and the fraction c of the pixel that it sees. This is the least-squares
solution in both modes: *sharp* shows the picture at p, *blended* the mean of its colours at all
p_v. The *conflict* of a pixel is the remaining deviation, sqrt(sum(w_v c_v |p_v - p|^2) /
sum(w_v c_v)), which no source image removes.

A viewer that sees part of a pixel needs the place of this part. It differs from the place of the
whole pixel by up to half of the rest, each way, even for viewers that agree. Only a larger
difference counts as disagreement.
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
    """The settled places of all viewers.

    steps : for each viewer (2, H, W) picture px, from the place it needs to the place shown; NaN
        if it needs none
    conflict : (H, W) picture px; 0 if fewer than two viewers need the pixel
    """

    steps: tuple[Floats, ...]
    conflict: Floats


def is_comparable(rig: Rig) -> bool:
    """Whether there are several viewers with comparable places on the picture.

    Places on images of the viewers' own pixels are unrelated.
    """
    if len(rig.viewers) < 2 or rig.has_own_images:
        return False
    return all(plane_mapping(rig.picture_place, viewer) is not None for viewer in rig.viewers)


def is_sharp(rig: Rig, settings: Settings) -> bool:
    """Whether a display pixel shows the picture at the mean place.

    A picture in the viewers' own pixels differs from viewer to viewer, so it is blended.
    """
    is_on_plane = rig.picture_place.mesh is not None
    return settings.disagreement == "sharp" and is_on_plane and is_comparable(rig)


def settle(
    channels: Sequence[Placed], clock: Clock, is_sharp: bool
) -> Generator[float, None, Settled]:
    """`settle_colour` for each colour; returns what the middle one settled."""
    colours = list(dict.fromkeys(placed.key.colours for placed in channels))
    found = []
    for k, colour in enumerate(colours):
        own = [placed for placed in channels if placed.key.colours == colour]
        steps = settle_colour(own, clock, is_sharp)
        found.append((yield from subprogress(steps, k / len(colours), (k + 1) / len(colours))))
    return found[len(found) // 2]


def settle_colour(
    channels: Sequence[Placed], clock: Clock, is_sharp: bool
) -> Generator[float, None, Settled]:
    """Find the places that viewers need and the places to show; yields progress 0..1.

    is_sharp : move the shares to the places to show
    """
    n = len(channels)
    for k, placed in enumerate(channels):
        if placed.lookup is None:
            yield from subprogress(count(placed, clock), k / n, (k + 1) / n)

    shape = channels[0].coverage.weight.shape
    total = np.zeros((2, *shape))
    weight = np.zeros(shape)
    for placed in channels:
        places, part = placed.lookup.places, _part(placed)
        total += np.where(part > 0, places, 0.0) * part
        weight += part

    # A pixel that only one viewer needs shows this viewer's place.
    n_needing = sum((_part(placed) > 0).astype(int) for placed in channels)
    divisor = np.where(weight > 0, weight, 1.0)
    mean = total / divisor
    spreads = [_place_spread(placed) for placed in channels]
    of_mean = sum(_part(placed) * own for placed, own in zip(channels, spreads, strict=True))
    square = np.zeros(shape)
    steps = []
    for placed, own in zip(channels, spreads, strict=True):
        places = placed.lookup.places
        step = np.where(n_needing > 1, mean - places, np.where(np.isnan(places), np.nan, 0.0))
        step = _shortened(step, own + of_mean / divisor)
        square += _part(placed) * np.nan_to_num((step**2).sum(axis=0))
        steps.append(step)
        if is_sharp:
            placed.step = np.nan_to_num(step).reshape(2, -1)

    clock.lap("disagreement")
    conflict = np.sqrt(square / divisor)
    return Settled(tuple(steps), conflict)


def _part(placed: Placed) -> Floats:
    """Weight (H, W) of a viewer in each pixel's mean: 0 if it needs no place there."""
    is_needed = np.isfinite(placed.lookup.places).all(axis=0)
    return placed.viewer.weighed(placed.coverage.of_display * is_needed)


def _place_spread(placed: Placed) -> Floats:
    """Largest distance (H, W), picture px, from the place of a pixel's part to that of the whole.

    It is the change of places over half of the pixel's unseen rest.
    """
    places = placed.lookup.places
    change = np.zeros(places.shape[1:])
    for axis in (1, 2):
        steps = np.linalg.norm(np.diff(places, axis=axis), axis=0)
        # Take the largest step around: steps to a partly seen pixel are too short.
        around = np.zeros(places.shape[1:])
        n = places.shape[axis]
        for k in range(-2, 2):
            here = slice(max(-k, 0), min(n - 1 - k, n))
            at = (slice(None),) * (axis - 1) + (here,)
            of = (slice(None),) * (axis - 1) + (slice(here.start + k, here.stop + k),)
            around[at] = np.fmax(around[at], steps[of])
        change += around
    return 0.5 * (1.0 - placed.lookup.parts) * change


def _shortened(step: Floats, by: Floats) -> Floats:
    """Steps (2, H, W) shortened by lengths (H, W), down to 0."""
    length = np.linalg.norm(step, axis=0)
    return step * np.clip(1.0 - by / np.where(length > 0, length, 1.0), 0.0, 1.0)
