"""Paints the source image: least squares through the shares, and a brute-force reference."""

from collections.abc import Generator
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats
from ..light.beams import in_quilt
from ..light.plan import Plan
from ..light.rays import PlateLight, main_landings
from ..light.trace import TRACED_AT_ONCE, trace
from ..map.shares import Shares, add_at
from ..native import image_passes, loading
from ..rig.rig import PicturePlace, Viewer
from . import native_paint
from .flat_picture import flat_mapping
from .picture import picture_from_view
from .pyramid import Pyramid, Taps, find_taps, pyramids_of

FilterTaps = Taps | native_paint.FlatTaps

# Viewer px^2, times throughput^2: display pixels with less weight are not covered. Taps are
# float32, without digits below its least normal number. The limit is absolute, so uniformly faint
# light is still shown.
LEAST_WEIGHT = float(np.finfo(np.float32).tiny)
# Upper limit of a display pixel's light, for sums and multiples in float32. Given the least weight,
# only a picture of 1e7 or brighter approaches it: by Cauchy and Schwarz, light is at most the
# picture's maximum times sqrt(area / weight).
MOST_LIGHT = 1e30


class Painting:
    """Accumulates a source image: the x that minimises the sum over shares of area (T x -
    colour)^2.

    Shares are added in batches; their filter taps can be reused for another picture of the same
    size.
    """

    def __init__(self, display_size: tuple[int, int]) -> None:
        width, height = display_size
        # np.zeros would map small pages lazily, one fault at a time
        self._total = np.empty((3, height, width))
        self._total.fill(0)

    def add(self, pyramid: Pyramid, filter_taps: FilterTaps, are_kept: bool = False) -> None:
        """Add shares by their filter taps (`find_filter_taps`).

        are_kept : keep the taps for another picture
        """
        if isinstance(filter_taps, native_paint.FlatTaps):
            native_paint.paint(self._total, pyramid.levels, filter_taps, are_kept)
            return
        for total, values in zip(self._total, pyramid.read(filter_taps), strict=True):
            add_at(total, filter_taps.point, values)

    def join(self, other: "Painting", colours: tuple[float, ...]) -> None:
        """Add another painting, with a weight for each colour."""
        self._total += np.array(colours)[:, None, None] * other._total

    def finished(
        self, weight: Floats, margin: int = 0, stray: Floats | None = None
    ) -> NDArray[np.float32]:
        """Source image (H, W, 3), linear, finite.

        Parameters
        ----------
        weight : (H, W), sum of area * T^2 over the shares of each display pixel
        margin : px by which the covered area grows outward
        stray : (H, W), the same sum over light past the glass, which should be dark
        """
        covered, is_free = weight >= LEAST_WEIGHT, True
        if stray is not None:
            weight = weight + stray
            is_free = stray == 0

        if loading.library() is not None:
            image = image_passes.finish(self._total, weight, covered)
        else:
            image = np.empty((*weight.shape, 3), np.float32)
            for channel, total in enumerate(self._total):
                light = np.divide(total, weight, out=np.zeros_like(total), where=covered)
                image[..., channel] = light.clip(-MOST_LIGHT, MOST_LIGHT)

        return grow(image, covered, margin, is_free)


def find_filter_taps(place: PicturePlace, viewer: Viewer, shares: Shares) -> FilterTaps:
    """How the sums area * T * colour of display pixels are read from a picture in its place: taps
    whose points are display pixels.

    A share lies fully inside or outside the picture and is read over its footprint. For a flat
    picture, the compiled kernel keeps the shares and computes the taps when painting.
    """
    mapping = flat_mapping(place, viewer) if loading.library() is not None else None
    if mapping is not None:
        return native_paint.FlatTaps(shares, mapping, (place.width, place.height))

    points = picture_from_view(place, viewer, shares.view_xy, shares.covariance)
    weight = np.where(points.cover >= 0.5, shares.area, 0.0)
    if shares.throughput is not None:
        weight *= shares.throughput
    taps = find_taps(points, weight, (place.width, place.height))
    return replace(taps, point=shares.display_index[taps.point])


def grow(
    image: NDArray[np.float32], covered: Bools, margin: int, is_free: Bools | bool = True
) -> NDArray[np.float32]:
    """Fill free pixels next to covered ones with the mean of their covered neighbours, `margin`
    times.
    """
    if not margin:
        return image
    image, covered = image.copy(), covered.copy()
    around = [(dy, dx) for dy in range(3) for dx in range(3)]
    h, w = covered.shape

    for _ in range(margin):
        mask = np.pad(covered, 1)
        is_near = reduce(np.logical_or, [mask[dy : dy + h, dx : dx + w] for dy, dx in around])
        # few pixels: read colours only around these
        y, x = new = np.nonzero(is_near & ~covered & is_free)
        count = total = np.float32(0)
        for dy, dx in around:
            is_met = mask[y + dy, x + dx]
            # nothing is covered outside the image, so any pixel may be read
            rows, columns = (y + dy - 1).clip(0, h - 1), (x + dx - 1).clip(0, w - 1)
            count = count + is_met
            total = total + image[rows, columns] * is_met[:, None]

        image[new] = total / count[:, None]
        covered[new] = True
    return image


def splat(
    plan: Plan, spp: int, seed: int = 0, light: PlateLight = "imaged"
) -> Generator[float, None, NDArray[np.float32]]:
    """Source image by brute force: `spp` random samples a viewer pixel, averaged on each display
    pixel.

    Pixels without samples are black. Imaged light carries the same values as `Painting` and
    converges to the same image. For other light, including stray light, a pixel shows the mean
    colour weighted by throughput, which requires the `brightness` setting; white stays white.
    Several viewers of the rig count by their weights, as for `blended`.
    """
    viewers = plan.rig.viewers if len(plan.rig.viewers) > 1 else (plan.viewer,)
    display = plan.rig.display
    pictures = [plan.rig.picture_of(viewer) for viewer in viewers]
    pyramids = pyramids_of([picture.image for picture in pictures])
    random = np.random.default_rng(seed)
    shape = display.image_size[::-1]
    n = shape[0] * shape[1]
    total = np.zeros((3, n))
    norm = np.zeros(n)
    lots = [
        (viewer, picture.place, pyramid, first)
        for viewer, picture, pyramid in zip(viewers, pictures, pyramids, strict=True)
        for first in range(0, viewer.width * viewer.height, TRACED_AT_ONCE)
    ]

    for k in range(spp):
        for number, (viewer, place, pyramid, first) in enumerate(lots):
            some = np.arange(first, min(first + TRACED_AT_ONCE, viewer.width * viewer.height))
            corner = np.stack([some % viewer.width, some // viewer.width], axis=1)
            xy = corner + random.random((len(some), 2))

            landings = trace(plan.seen_by(viewer), *viewer.rays(xy), light=light)
            if light == "imaged":  # as in the view map
                landings = main_landings(landings, len(xy))
            inside, index = landings.pixels(display.width, display.height)
            if display.views is not None:
                dither = random.random((len(index), 2)) - 0.5
                inside, index = in_quilt(plan, landings, inside, index, dither)
            index = index[inside]
            colours = pyramid.sample(picture_from_view(place, viewer, xy[landings.sample[inside]]))
            weight = landings.throughput[inside]

            norm += np.bincount(
                index, viewer.weighed(weight**2 if light == "imaged" else weight), n
            )
            for channel in range(3):
                total[channel] += np.bincount(
                    index, viewer.weighed(weight) * colours[:, channel], n
                )
            yield (k * len(lots) + number + 1) / (spp * len(lots))

    is_seen = norm >= LEAST_WEIGHT
    image = np.where(is_seen, total / np.where(is_seen, norm, 1), 0).T.clip(-MOST_LIGHT, MOST_LIGHT)
    return display.source_for(image.reshape(*shape, 3).astype(np.float32))
