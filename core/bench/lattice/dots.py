"""Dots in a photograph, to a hundredth of a pixel.

A dot is the part of a window that is connected with its middle and brighter than half of its
contrast. Light from beside, a glare or a gradient, would draw its centroid. So a plane is laid
through the calm part of a ring around the dot, and the centroid is that of the light above it:
c = sum w x / sum w, w = clip(light - plane).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints
from ...base.products import solve_symmetric
from .windows import SEARCH, Marks


@dataclass(frozen=True)
class DotRule:
    """What is a dot; held to rendered photographs by tests/core/test_lattice.py.

    Lengths in px of a level, radii of a ring in multiples of the ellipse of the dot's moments:
    (a, b) stands for a + b / radius, and contrast is that of the dot.

    ground_percent : of a window's pixels that are darker than the dot's ground
    edge : of the contrast, where the outline is
    least_area_px : px^2, within the outline
    solid : of the area of an ellipse of its moments, at the least
    longest : times its width, at the most
    largest_px : half its length: the ring around it has to lie in the window
    inner, outer : of the ring
    calm : of the contrast, by which light in the ring may be off the plane
    unquiet : of the contrast, rms there at the most
    free : of the ring, that is calm at the least
    bright_within, brightest : radius of the bright part, and the largest weight there
    brightest_beside, darkest : largest weight outside of it, and the largest below the plane
    drawn_by_light, drawn_px : radii, and px more, between centroids of its light and its outline
    """

    ground_percent: float = 30
    edge: float = 0.5
    least_area_px: float = 9.0
    solid: float = 0.85
    longest: float = 3.0
    largest_px: float = 9.5
    inner: tuple[float, float] = (1.35, 1.5)
    outer: tuple[float, float] = (1.9, 2.0)
    calm: float = 0.35
    unquiet: float = 0.2
    free: float = 0.6
    bright_within: tuple[float, float] = (1.1, 0.5)
    brightest: float = 1.3
    brightest_beside: float = 0.25
    darkest: float = 0.25
    drawn_by_light: float = 0.05
    drawn_px: float = 0.15


DOT_RULE = DotRule()
# off a window's middle, px, pixel by pixel
X, Y = (a.ravel() for a in np.meshgrid(*2 * [np.arange(-SEARCH.around_px, SEARCH.around_px + 1.0)]))


class _Spots(NamedTuple):
    """Spots in the middles of windows.

    which (n,) windows; light, smooth, region : of the windows, as they are,
    smoothed, and which of their pixels are within the outline
    contrast, ground (n,); area (n,) of the outline, px^2
    """

    which: Ints
    light: NDArray[np.float32]
    smooth: NDArray[np.float32]
    region: Bools
    contrast: Floats
    ground: Floats
    area: Floats

    def at(self, which: Bools) -> "_Spots":
        return _Spots(*(values[which] for values in self))


class _Ellipses(NamedTuple):
    """Middles, covariances and their determinants (n,) of outlines, px."""

    x: Floats
    y: Floats
    xx: Floats
    yy: Floats
    xy: Floats
    det: Floats

    def at(self, which: Bools) -> "_Ellipses":
        return _Ellipses(*(values[which] for values in self))


def find_dots(windows: NDArray[np.float32]) -> Marks:
    """The dots in the middles of windows (k, s, s)."""
    spots = _spots(windows)
    ellipses = _ellipses(spots)
    long = (ellipses.xx + ellipses.yy) / 2 + np.sqrt(
        (ellipses.xx - ellipses.yy) ** 2 / 4 + ellipses.xy**2
    )
    keep = (
        (spots.area > DOT_RULE.solid * 4 * np.pi * np.sqrt(ellipses.det))
        & (long**2 < DOT_RULE.longest**2 * ellipses.det)
        & (4 * long < DOT_RULE.largest_px**2)
    )
    spots = spots.at(keep)
    ellipses = ellipses.at(keep)
    light, smooth = (a.reshape(len(a), len(X)) for a in (spots.light, spots.smooth))

    # from the middle, as a multiple of the ellipse that has the region's moments
    dx = X - ellipses.x[:, None]
    dy = Y - ellipses.y[:, None]
    rho = np.sqrt(
        np.maximum(
            ellipses.yy[:, None] * dx**2
            - 2 * ellipses.xy[:, None] * dx * dy
            + ellipses.xx[:, None] * dy**2,
            0,
        )
        / ellipses.det[:, None]
        / 4
    )

    # the ground around it
    radius = np.sqrt(spots.area / np.pi)
    inner, outer = ((a + b / radius)[:, None] for a, b in (DOT_RULE.inner, DOT_RULE.outer))
    ring = (rho > inner) & (rho < outer)
    plane, off, calm = _plane(spots, smooth, ring)
    n_calm = calm.sum(axis=1)
    rms = np.sqrt((calm * off**2).sum(axis=1) / np.maximum(n_calm, 1))

    # light from beside is cut off, so that it hardly draws the centroid
    contrast = spots.contrast
    a, b = DOT_RULE.bright_within
    bright = contrast[:, None] * np.where(
        rho < (a + b / radius)[:, None], DOT_RULE.brightest, DOT_RULE.brightest_beside
    )
    dark = -DOT_RULE.darkest * contrast[:, None]
    weight = np.where(rho < inner, np.clip(light - plane, dark, bright), 0)
    total = np.maximum(weight.sum(axis=1), 1e-12 * contrast)
    centre = np.stack([weight @ X / total, weight @ Y / total], axis=1)

    keep = (n_calm > DOT_RULE.free * ring.sum(axis=1)) & (rms < DOT_RULE.unquiet * contrast)
    drawn = np.hypot(centre[:, 0] - ellipses.x, centre[:, 1] - ellipses.y)
    keep &= drawn < DOT_RULE.drawn_by_light * radius + DOT_RULE.drawn_px
    return Marks(spots.which[keep], centre[keep], radius[keep], contrast[keep])


def _spots(windows: NDArray[np.float32]) -> _Spots:
    """Windows (k, s, s) with something in their middles that lies in them wholly."""
    smooth = np.pad(windows, ((0, 0), (1, 1), (1, 1)), mode="edge")
    smooth = smooth[:, :-2] + 2 * smooth[:, 1:-1] + smooth[:, 2:]
    smooth = (smooth[:, :, :-2] + 2 * smooth[:, :, 1:-1] + smooth[:, :, 2:]) / 16

    ground = np.percentile(windows.reshape(len(windows), -1), DOT_RULE.ground_percent, axis=1)
    contrast = smooth[:, SEARCH.around_px, SEARCH.around_px] - ground
    region = _flooded(smooth > (ground + DOT_RULE.edge * contrast)[:, None, None])

    # not cut off by the window
    is_whole = ~(region[:, [0, -1]].any(axis=(1, 2)) | region[:, :, [0, -1]].any(axis=(1, 2)))
    area = region.sum(axis=(1, 2))
    keep = is_whole & (area >= DOT_RULE.least_area_px)
    return _Spots(
        which=np.arange(len(windows)),
        light=windows,
        smooth=smooth,
        region=region,
        contrast=contrast,
        ground=ground,
        area=area.astype(float),
    ).at(keep)


def _ellipses(spots: _Spots) -> _Ellipses:
    """Ellipses that have the moments of the outlines."""
    region = spots.region.reshape(len(spots.region), len(X))
    x = region @ X / spots.area
    y = region @ Y / spots.area
    xx = region @ X**2 / spots.area - x**2 + 1 / 12
    yy = region @ Y**2 / spots.area - y**2 + 1 / 12
    xy = region @ (X * Y) / spots.area - x * y
    return _Ellipses(x, y, xx, yy, xy, xx * yy - xy**2)


def _plane(spots: _Spots, smooth: NDArray[np.float32], ring: Bools) -> tuple[Floats, Floats, Bools]:
    """Planes (n, p) through the calm parts of rings (n, p), how far smoothed
    light (n, p) is off them, and where it is calm (n, p).
    """
    edge = spots.ground + DOT_RULE.edge * spots.contrast
    calm = ring & (smooth < edge[:, None])
    design = np.stack([np.ones_like(X), X / SEARCH.around_px, Y / SEARCH.around_px], axis=1)

    for _ in range(2):
        normal = np.einsum("kp,pi,pj->kij", calm, design, design, optimize=True) + 1e-6 * np.eye(3)
        plane = solve_symmetric(normal, ((calm * smooth) @ design)[..., None])[..., 0] @ design.T
        off = smooth - plane
        calm = ring & (np.abs(off) < DOT_RULE.calm * spots.contrast[:, None])

    return plane, off, calm


def _flooded(mask: Bools) -> Bools:
    """The parts of masks (k, s, s) that are connected with their middle pixel."""
    region = np.zeros_like(mask)
    middle = mask.shape[1] // 2
    region[:, middle, middle] = mask[:, middle, middle]

    count = -1
    while (now := np.count_nonzero(region)) != count:
        count = now
        grown = region.copy()
        grown[:, 1:] |= region[:, :-1]
        grown[:, :-1] |= region[:, 1:]
        grown[:, :, 1:] |= region[:, :, :-1]
        grown[:, :, :-1] |= region[:, :, 1:]
        region = grown & mask

    return region
