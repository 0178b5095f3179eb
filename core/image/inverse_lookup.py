"""Which place of a flat picture does a viewer ask each display pixel to show?

Its shares tell it: where a share lies on the viewer's image, and where the picture is seen there as
if there were no glass, that place is asked for. A pixel's place is the mean over its shares, by
their weight. The picture's plane is one for all viewers, so that their places can be compared.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats
from ..map.shares import Shares, add_at
from ..rig.rig import PicturePlace
from ..rig.viewer import Viewer
from .flat_picture import flat_mapping

# times the weight of a share within the picture: one beside it
# tells the place only in pixels that show nothing of the picture
BESIDE = 1e-12
REACH = 1.0  # sides of the picture beside it: a place further off is taken to be no further


@dataclass(frozen=True, eq=False)
class PlaneMapping:
    """The way from a viewer's image to pixels of a flat picture, and back.

    there, back : (3, 3), projective maps of (x, y, 1); x right, y down on both sides
    low, high : (2,) the picture's bounds, picture px
    """

    there: Floats
    back: Floats
    low: Floats
    high: Floats


def plane_mapping(place: PicturePlace, viewer: Viewer) -> PlaneMapping | None:
    """None where the picture is no flat rectangle, or is seen edge-on."""
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
    """Points (2, n) by a projective map of points (n, 2), and their w (n,)."""
    x, y = xy.T
    u, v, w = (a * x + b * y + c for a, b, c in matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([u / w, v / w]), w


class InverseLookup:
    """The places of the picture that a viewer asks display pixels for: sums over its shares, all of
    which are added before it is asked.
    """

    def __init__(self, place: PicturePlace, viewer: Viewer, display_size: tuple[int, int]) -> None:
        width, height = display_size
        self._way = plane_mapping(place, viewer)
        self._sum = np.zeros((2, height, width))
        self._weight = np.zeros((height, width))
        self._area = np.zeros((2, height, width))

    def add(self, shares: Shares) -> None:
        """Add some of the shares that display pixels show."""
        way = self._way
        xy, w = mapped(way.there, shares.view_xy)
        is_before = w > 0  # else it looks away from the picture's plane
        low, high = way.low[:, None], way.high[:, None]
        is_within = ((xy >= low) & (xy <= high)).all(axis=0)
        weight = np.where(is_within, 1.0, BESIDE) * shares.weight * is_before
        add_at(self._weight, shares.display_index, weight)
        area = shares.display_area * is_before
        for total, some in zip(self._area, (area, area * is_within), strict=True):
            add_at(total, shares.display_index, some)

        reach = REACH * (high - low)
        kept = np.where(is_before, np.clip(xy, low - reach, high + reach), 0.0)
        for total, along in zip(self._sum, kept, strict=True):
            add_at(total, shares.display_index, weight * along)

    @property
    def places(self) -> Floats:
        """The place (2, H, W) that each display pixel is asked for, picture px; NaN for none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self._weight > 0, self._sum / self._weight, np.nan)

    @property
    def parts(self) -> Floats:
        """The part (H, W) of each display pixel, 0..1, that tells its place: the one that shows the
        picture, or else all that is seen.
        """
        of_all, within = self._area
        return np.minimum(np.where(within > 0, within, of_all), 1.0)


def moved_in_view(shares: Shares, place: PicturePlace, viewer: Viewer, step: Floats) -> Shares:
    """Shares that ask for other places of the picture, moved on the viewer's image to where these
    are seen as if there were no glass.

    step : (2, H * W) picture px, from the places that they ask for; where it is 0 they stay
    """
    number = np.flatnonzero((step != 0).any(axis=0)[shares.display_index])
    if not len(number):
        return shares

    way = plane_mapping(place, viewer)
    xy, w = mapped(way.there, shares.view_xy[number])
    back, _ = mapped(way.back, (xy + step[:, shares.display_index[number]]).T)
    can_move = (w > 0) & np.isfinite(back).all(axis=0)
    view_xy = shares.view_xy.copy()
    view_xy[number[can_move]] = back[:, can_move].T
    return replace(shares, view_xy=view_xy)
