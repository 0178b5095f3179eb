"""The place of a flat picture that a viewer needs at each display pixel.

A share lies somewhere on the viewer's image, and the place of the picture seen there without glass
is the one it needs. A pixel's place is the weighted mean over its shares. The picture's plane is
common to all viewers, so their places can be compared.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats
from ..map.shares import Shares, add_at
from ..rig.rig import PicturePlace
from ..rig.viewer import Viewer
from .flat_picture import flat_mapping

# weight of a share outside the picture, relative to one within: it only counts in pixels that show
# nothing of the picture
OUTSIDE_WEIGHT = 1e-12
REACH = 1.0  # places are clipped to this many sides of the picture around it


@dataclass(frozen=True, eq=False)
class PlaneMapping:
    """Mapping between a viewer's image and pixels of a flat picture.

    there, back : (3, 3), projective maps of (x, y, 1); x right, y down on both sides
    low, high : (2,) the picture's bounds, picture px
    """

    there: Floats
    back: Floats
    low: Floats
    high: Floats


def plane_mapping(place: PicturePlace, viewer: Viewer) -> PlaneMapping | None:
    """The mapping for a viewer; None if the picture is not a flat rectangle, or is seen edge-on."""
    flat = flat_mapping(place, viewer)
    if flat is None or np.linalg.matrix_rank(flat.matrix / np.abs(flat.matrix).max()) < 3:
        return None

    size = np.array([place.width, place.height], float)
    in_pixels = np.array([[size[0], 0, 0], [0, -size[1], size[1]], [0, 0, 1]])
    there = in_pixels @ flat.matrix
    low, high = (flat.low, flat.high) if place.mesh is not None else (np.zeros(2), np.ones(2))
    return PlaneMapping(
        there=there,
        back=np.linalg.inv(there),
        low=size * [low[0], 1 - high[1]],
        high=size * [high[0], 1 - low[1]],
    )


def mapped(matrix: Floats, xy: Floats) -> tuple[Floats, Floats]:
    """Project points (n, 2); returns points (2, n) and their w (n,)."""
    x, y = xy.T
    u, v, w = (a * x + b * y + c for a, b, c in matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([u / w, v / w]), w


class InverseLookup:
    """Places of the picture that a viewer needs at display pixels, as sums over its shares.

    Add all shares before reading the result.
    """

    def __init__(self, place: PicturePlace, viewer: Viewer, display_size: tuple[int, int]) -> None:
        width, height = display_size
        self._mapping = plane_mapping(place, viewer)
        self._sum = np.zeros((2, height, width))
        self._weight = np.zeros((height, width))
        self._area = np.zeros((2, height, width))

    def add(self, shares: Shares) -> None:
        """Add some of the shares shown by display pixels."""
        mapping = self._mapping
        xy, w = mapped(mapping.there, shares.view_xy)
        is_before = w > 0  # else it looks away from the picture's plane
        low, high = mapping.low[:, None], mapping.high[:, None]
        is_within = ((xy >= low) & (xy <= high)).all(axis=0)
        weight = np.where(is_within, 1.0, OUTSIDE_WEIGHT) * shares.weight * is_before
        add_at(self._weight, shares.display_index, weight)
        area = shares.display_area * is_before
        for total, some in zip(self._area, (area, area * is_within), strict=True):
            add_at(total, shares.display_index, some)

        reach = REACH * (high - low)
        clipped = np.where(is_before, np.clip(xy, low - reach, high + reach), 0.0)
        for total, along in zip(self._sum, clipped, strict=True):
            add_at(total, shares.display_index, weight * along)

    @property
    def places(self) -> Floats:
        """The place (2, H, W) needed at each display pixel, picture px; NaN for none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self._weight > 0, self._sum / self._weight, np.nan)

    @property
    def parts(self) -> Floats:
        """The fraction (H, W) of each display pixel, 0..1, that determines its place: the area
        showing the picture, or else all that is seen.
        """
        of_all, within = self._area
        return np.minimum(np.where(within > 0, within, of_all), 1.0)


def moved_in_view(shares: Shares, place: PicturePlace, viewer: Viewer, step: Floats) -> Shares:
    """Shift the places of the picture needed by shares, by moving the shares on the viewer's image.

    step : (2, H * W) picture px for each display pixel; 0 leaves shares in place
    """
    number = np.flatnonzero((step != 0).any(axis=0)[shares.display_index])
    if not len(number):
        return shares

    mapping = plane_mapping(place, viewer)
    xy, w = mapped(mapping.there, shares.view_xy[number])
    back, _ = mapped(mapping.back, (xy + step[:, shares.display_index[number]]).T)
    can_move = (w > 0) & np.isfinite(back).all(axis=0)
    view_xy = shares.view_xy.copy()
    view_xy[number[can_move]] = back[:, can_move].T
    return replace(shares, view_xy=view_xy)
