"""Detection of a lattice's dots and crossings in a photograph, to a hundredth of a pixel.

Bright maxima of the Hessian's determinant are candidates, in the image and in its halves,
quarters and so on. Each candidate is fitted as a dot and as a crossing. The result is the largest
lattice grown from dots or from crossings (match.py).

- *Crossing*: on circles around it, two lines show as four bright arms. Along each line the ridge of
  its light is a parabola, z = a + b t + c t^2 across it, fitted to centroids at stations on both
  sides. The crossing is the intersection of the parabolas. The overlap of the lines in the middle
  is excluded, because each line would bias the other.
- *Dot*: the part of a window connected with its middle and brighter than half of its contrast.
  Glare or a gradient would bias its centroid. So a plane is fitted to the calm part of a ring
  around the dot, and the centroid is of the light above the plane: c = sum w x / sum w, w =
  clip(light - plane).
"""

from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arrays import Bools, Floats, Ints
from ...base.errors import ImageError
from ...base.products import solve_symmetric
from .drawn import Style
from .match import SHAPES, is_lattice, largest

# Verified on rendered photographs in tests/core/test_lattice.py.
N_LEVELS = 5  # the image, its halves, quarters and so on
LEAST_SIDE_PX = 24  # smallest image side
ABOVE_NOISE = 5.0  # least strength, in multiples of the level's noise
LEAST_STRENGTH = 6e-5  # fraction of the image's range, for a dot with a contrast of 5e-4 of it
MOST_CANDIDATES = 4000  # of a level, the strongest
AROUND_PX = 20  # of a level, on each side of a candidate
AT_ONCE = 500  # candidates in a batch
ROWS_AT_ONCE = 128  # so that the arrays fit into the processor's cache
HALO = 8  # rows: three passes of two, one for derivatives, one for maxima


class Marks(NamedTuple):
    """Dots or crossings in the middles of windows.

    which : (n,) windows
    off : (n, 2) px from the middle
    radius, contrast : (n,)
    """

    which: Ints
    off: Floats
    radius: Floats
    contrast: Floats


def levels_of(grey: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The image and its 2 x 2, 4 x 4 ... means, which preserve centroids."""
    levels = [grey]
    while len(levels) < N_LEVELS and min(levels[-1].shape) >= 2 * LEAST_SIDE_PX:
        last = levels[-1]
        h, w = (n // 2 * 2 for n in last.shape)
        rows = last[0:h:2, :w] + last[1:h:2, :w]
        levels.append((rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25))
    return levels


def candidates(level: NDArray[np.float32]) -> tuple[Ints, Ints, Floats]:
    """Pixels x, y (k,) with negative curvature in all directions, as at dots and crossings but not
    along lines, and their strengths (k,).

    The strength is the root of the Hessian's determinant.
    """
    h = len(level)
    padded = np.pad(level, HALO, mode="reflect")

    found = []
    noise = []

    for first in range(0, h, ROWS_AT_ONCE):
        rows = padded[first : min(first + ROWS_AT_ONCE, h) + 2 * HALO]
        bend, trace = _bend(rows)
        noise.append(trace[::4, ::4].ravel())
        y, x = np.nonzero(_is_top(bend))
        found.append(np.stack([x, y + first, np.sqrt(bend[1:-1, 1:-1][y, x])], axis=1))

    # well above the noise, the strongest first
    x, y, strength = np.concatenate(found).T
    # the median of absolute normal noise is 0.67 deviations; a trace is two strengths
    level_noise = np.median(np.abs(np.concatenate(noise))) / 0.67 / 2
    least = max(ABOVE_NOISE * level_noise, LEAST_STRENGTH * np.ptp(level))
    strong = np.flatnonzero(strength > least)
    strong = strong[np.argsort(-strength[strong], kind="stable")][:MOST_CANDIDATES]

    return x[strong].astype(int), y[strong].astype(int), strength[strong]


def _bend(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The Hessian's determinant, 0 unless the curvature is negative, and its trace."""
    for _ in range(3):  # each with a variance of one pixel squared
        rows = _smooth(rows)
        rows = _smooth(rows.T).T

    rows = np.ascontiguousarray(rows)

    inner = rows[1:-1, 1:-1]
    xx = rows[1:-1, 2:] - 2 * inner + rows[1:-1, :-2]
    yy = rows[2:, 1:-1] - 2 * inner + rows[:-2, 1:-1]
    xy = (rows[2:, 2:] - rows[2:, :-2] - rows[:-2, 2:] + rows[:-2, :-2]) / 4
    trace = xx + yy

    return np.where(trace < 0, xx * yy - xy * xy, 0), trace


def _is_top(bend: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Mask of the inner pixels above 0 and largest among their neighbours."""
    middle = bend[1:-1, 1:-1]
    is_top = middle > 0
    n, m = middle.shape
    for dy, dx in product((0, 1, 2), repeat=2):
        if (dy, dx) != (1, 1):
            other = bend[dy : dy + n, dx : dx + m]
            is_top &= middle > other if (dy, dx) < (1, 1) else middle >= other
    return is_top


def _smooth(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Binomial filter of width 5 along the first axis, which removes two rows at each end."""
    one = rows[1:] + rows[:-1]
    two = one[1:] + one[:-1]
    one = two[1:] + two[:-1]
    return (one[1:] + one[:-1]) * np.float32(1 / 16)


def windows_at(padded: NDArray[np.float32], x: Ints, y: Ints) -> NDArray[np.float32]:
    """Windows (k, s, s) around pixels (k,), s = 2 AROUND_PX + 1, of an image padded by
    AROUND_PX.
    """
    side = np.arange(2 * AROUND_PX + 1)
    return padded[y[:, None, None] + side[:, None], x[:, None, None] + side]


def read_between(windows: NDArray[np.float32], at: NDArray[np.complex128]) -> Floats:
    """Bilinear samples of windows (k, s, s) at offsets (k, ...) from their middles, x + iy."""
    around = AROUND_PX
    most = 2 * around - 1e-3
    x = np.clip(at.real + around, 0, most)
    y = np.clip(at.imag + around, 0, most)
    column = x.astype(int)
    row = y.astype(int)
    x, y = x - column, y - row

    side = 2 * around + 1
    first = (
        (np.arange(len(windows)) * side**2).reshape(-1, *(1,) * (at.ndim - 1)) + row * side + column
    )
    flat = windows.reshape(-1)
    return (flat[first] * (1 - x) + flat[first + 1] * x) * (1 - y) + (
        flat[first + side] * (1 - x) + flat[first + side + 1] * x
    ) * y


# Verified on rendered photographs in tests/core/test_lattice.py. Px are of a level, and contrast is
# of the dot or crossing.
GROUND_PERCENT = 30  # percentile of pixels or directions at ground level
RADII_PX = np.arange(5.0, 14.0)  # of a level, circles for the arms
TURNS_AROUND = np.exp(1j * (2 * np.pi * np.arange(72) / 72))  # directions, x + iy
# px of a level, along a line, and across it
STATIONS_PX = np.concatenate([-np.arange(5.0, 13.0), np.arange(5.0, 13.0)])
ACROSS_PX = np.arange(-4.5, 4.75, 0.5)
N_RIDGES = 3  # fits of a parabola to the ridge, each around the previous one
N_NEWTON = 5
WAVY_PX = 0.7  # rms residual of a line from its parabola
FARTHEST_PX = 3.0  # of a crossing from the window's middle


def find_crossings(windows: NDArray[np.float32]) -> Marks:
    """Crossings in the middles of windows (k, s, s); their radius is 1."""
    crossed, lines, contrast = _arms(windows)
    parabolas, is_line = _ridges(windows[crossed], lines)
    place = _meeting(lines, parabolas)
    is_line &= np.abs(place) < FARTHEST_PX

    place = place[is_line]
    return Marks(
        which=crossed[is_line],
        off=np.stack([place.real, place.imag], axis=1),
        radius=np.ones(len(place)),
        contrast=contrast[is_line],
    )


def _arms(windows: NDArray[np.float32]) -> tuple[Ints, NDArray[np.complex128], Floats]:
    """Windows (n,) with four arms in two nearly straight pairs, the directions (n, 2) of their
    lines, and their contrast (n,).
    """
    at = RADII_PX[:, None] * TURNS_AROUND
    arms = np.sort(read_between(windows, np.broadcast_to(at, (len(windows), *at.shape))), 1)
    along = arms[:, len(RADII_PX) // 3]  # a percentile: an arm is bright nearly everywhere
    low = np.percentile(along, GROUND_PERCENT, axis=1)
    high = along.max(axis=1)
    excess = along - (low + 0.4 * (high - low))[:, None]

    is_arm = excess > 0
    starts = is_arm & ~np.roll(is_arm, 1, axis=1)
    has_four = (starts.sum(axis=1) == 4) & (is_arm.mean(axis=1) < 0.6)  # arms are narrow
    crossed = np.flatnonzero(has_four)
    contrast = (high - low)[crossed]
    excess = np.maximum(excess[crossed], 0)

    # mean direction of each arm
    number = np.cumsum(starts[crossed], axis=1) % 4
    directions = np.stack([(excess * (number == k)) @ TURNS_AROUND for k in range(4)], axis=1)
    ahead = directions[:, :2]
    behind = -directions[:, 2:]
    straight = (np.abs(np.angle(ahead * behind.conj())) < np.radians(40)).all(axis=1)
    lines = ahead[straight] / np.abs(ahead[straight]) + behind[straight] / np.abs(behind[straight])
    lines /= np.abs(lines)

    return crossed[straight], lines, contrast[straight]


def _ridges(windows: NDArray[np.float32], lines: NDArray[np.complex128]) -> tuple[Floats, Bools]:
    """Parabolas (n, 2, 3) along the two lines, with directions (n, 2), in windows (n, s, s), and a
    mask (n,) of the windows with two good fits.
    """
    design = np.stack([np.ones_like(STATIONS_PX), STATIONS_PX, STATIONS_PX**2], axis=1)
    parabolas = np.zeros((len(lines), 2, 3))
    is_line = np.ones(len(lines), bool)

    for k, line in enumerate(lines.T):
        for _ in range(N_RIDGES):
            ridge = parabolas[:, k] @ design.T
            at = STATIONS_PX[:, None] + 1j * (ridge[:, :, None] + ACROSS_PX)
            values = read_between(windows, line[:, None, None] * at)

            # centroid of the light across the line
            dark = values.min(axis=2, keepdims=True)
            bright = values.max(axis=2, keepdims=True)
            weight = np.maximum(values - dark - 0.15 * (bright - dark), 1e-12)
            ridge = ridge + weight @ ACROSS_PX / weight.sum(axis=2)
            parabolas[:, k] = np.linalg.lstsq(design, ridge.T, rcond=None)[0].T

        off = ridge - parabolas[:, k] @ design.T
        is_line &= np.sqrt((off**2).mean(axis=1)) < WAVY_PX

    return parabolas, is_line


def _meeting(lines: NDArray[np.complex128], parabolas: Floats) -> NDArray[np.complex128]:
    """Intersections (n,) of two lines (n, 2), x + iy: line 0 at t0, line 1 at t1, by Newton's
    method.
    """
    t = np.zeros((len(lines), 2))
    one = np.stack([np.ones(len(lines)), np.zeros(len(lines)), np.zeros(len(lines))], axis=1)

    for _ in range(N_NEWTON):
        powers = np.stack([one[:, :1] + 0 * t, t, t**2], axis=2)
        slopes = np.stack([0 * t, one[:, :1] + 0 * t, 2 * t], axis=2)
        place = lines * (t + 1j * (parabolas * powers).sum(axis=2))
        tangent = lines * (1 + 1j * (parabolas * slopes).sum(axis=2))
        gap = place[:, 1] - place[:, 0]

        cross = (tangent[:, 0].conj() * tangent[:, 1]).imag
        cross = np.where(np.abs(cross) < 0.1, 1.0, cross)  # nearly parallel lines do not cross
        step = np.stack(
            [(gap.conj() * tangent[:, 1]).imag / cross, (gap.conj() * tangent[:, 0]).imag / cross],
            axis=1,
        )
        t = np.clip(t + step, -RADII_PX[0], RADII_PX[0])

    return place[:, 0]


STRAY_LIMIT = 0.25  # of the contrast: limit of the weight outside a dot and of negative weights
# px from a window's middle, for each pixel
X, Y = (a.ravel() for a in np.meshgrid(*2 * [np.arange(-AROUND_PX, AROUND_PX + 1.0)]))


class _Spots(NamedTuple):
    """Spots in the middles of windows.

    which : (n,) windows
    light, smooth : (n, s, s) the windows, unfiltered and smoothed
    region : (n, s, s) mask of the outline
    contrast, ground : (n,)
    area : (n,) px^2, of the outline
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
    """Dots in the middles of windows (k, s, s)."""
    spots = _spots(windows)
    ellipses = _ellipses(spots)
    long = (ellipses.xx + ellipses.yy) / 2 + np.sqrt(
        (ellipses.xx - ellipses.yy) ** 2 / 4 + ellipses.xy**2
    )
    # nearly elliptic, not long, and with a ring inside the window
    keep = (
        (spots.area > 0.85 * 4 * np.pi * np.sqrt(ellipses.det))
        & (long**2 < 3.0**2 * ellipses.det)
        & (4 * long < 9.5**2)
    )
    spots = spots.at(keep)
    ellipses = ellipses.at(keep)
    light, smooth = (a.reshape(len(a), len(X)) for a in (spots.light, spots.smooth))

    # distance from the middle, in multiples of the ellipse with the region's moments
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

    # ground plane
    radius = np.sqrt(spots.area / np.pi)
    inner, outer = ((a + b / radius)[:, None] for a, b in ((1.35, 1.5), (1.9, 2.0)))
    ring = (rho > inner) & (rho < outer)
    plane, off, calm = _plane(spots, smooth, ring)
    n_calm = calm.sum(axis=1)
    rms = np.sqrt((calm * off**2).sum(axis=1) / np.maximum(n_calm, 1))

    # stray light is clipped to limit its effect on the centroid
    contrast = spots.contrast
    bright = contrast[:, None] * np.where(rho < (1.1 + 0.5 / radius)[:, None], 1.3, STRAY_LIMIT)
    dark = -STRAY_LIMIT * contrast[:, None]
    weight = np.where(rho < inner, np.clip(light - plane, dark, bright), 0)
    total = np.maximum(weight.sum(axis=1), 1e-12 * contrast)
    centre = np.stack([weight @ X / total, weight @ Y / total], axis=1)

    keep = (n_calm > 0.6 * ring.sum(axis=1)) & (rms < 0.2 * contrast)  # its ground is calm
    drawn = np.hypot(centre[:, 0] - ellipses.x, centre[:, 1] - ellipses.y)
    keep &= drawn < 0.05 * radius + 0.15  # else stray light shifts it
    return Marks(spots.which[keep], centre[keep], radius[keep], contrast[keep])


def _spots(windows: NDArray[np.float32]) -> _Spots:
    """Spots in windows (k, s, s) that lie completely inside."""
    smooth = np.pad(windows, ((0, 0), (1, 1), (1, 1)), mode="edge")
    smooth = smooth[:, :-2] + 2 * smooth[:, 1:-1] + smooth[:, 2:]
    smooth = (smooth[:, :, :-2] + 2 * smooth[:, :, 1:-1] + smooth[:, :, 2:]) / 16

    ground = np.percentile(windows.reshape(len(windows), -1), GROUND_PERCENT, axis=1)
    contrast = smooth[:, AROUND_PX, AROUND_PX] - ground
    region = _flooded(smooth > (ground + contrast / 2)[:, None, None])

    # not cut by the window
    is_whole = ~(region[:, [0, -1]].any(axis=(1, 2)) | region[:, :, [0, -1]].any(axis=(1, 2)))
    area = region.sum(axis=(1, 2))
    keep = is_whole & (area >= 9)
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
    """Ellipses with the moments of the outlines."""
    region = spots.region.reshape(len(spots.region), len(X))
    x = region @ X / spots.area
    y = region @ Y / spots.area
    xx = region @ X**2 / spots.area - x**2 + 1 / 12
    yy = region @ Y**2 / spots.area - y**2 + 1 / 12
    xy = region @ (X * Y) / spots.area - x * y
    return _Ellipses(x, y, xx, yy, xy, xx * yy - xy**2)


def _plane(spots: _Spots, smooth: NDArray[np.float32], ring: Bools) -> tuple[Floats, Floats, Bools]:
    """Planes (n, p) through the calm parts of rings (n, p), residuals (n, p) of the smoothed light,
    and masks (n, p) of the calm parts.
    """
    edge = spots.ground + spots.contrast / 2
    calm = ring & (smooth < edge[:, None])
    design = np.stack([np.ones_like(X), X / AROUND_PX, Y / AROUND_PX], axis=1)

    for _ in range(2):
        normal = np.einsum("kp,pi,pj->kij", calm, design, design, optimize=True) + 1e-6 * np.eye(3)
        plane = solve_symmetric(normal, ((calm * smooth) @ design)[..., None])[..., 0] @ design.T
        off = smooth - plane
        calm = ring & (np.abs(off) < 0.35 * spots.contrast[:, None])

    return plane, off, calm


def _flooded(mask: Bools) -> Bools:
    """The parts of masks (k, s, s) connected with their middle pixels."""
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


FINER_RANK = 0.8  # factor of a dot's rank per level, which prefers the finest complete one
ALIKE_SIZE = 1.5  # size ratio up to which dots at one position are the same
RANK_IN_GLARE = 0.25  # fraction of a glare's rank, down to which a dot inside counts


def find_points(image: ArrayLike, style: Style | Literal["auto"] = "auto") -> Floats:
    """Positions (k, 2), px, of a lattice of bright dots or of crossings of bright lines, unordered.

    Parameters
    ----------
    image : (h, w) or (h, w, c), row 0 at the top; linear or encoded, since symmetric dots stay
        symmetric
    style : dots or crossings; 'auto' for the larger lattice

    Raises
    ------
    ImageError : no lattice in the image
    """
    found = _marks(_grey(image), ("dots", "grid") if style == "auto" else (style,))

    best = np.empty((0, 2))
    for parts in found.values():
        points, sizes = np.split(_distinct(np.concatenate(parts)), [2], axis=1)
        sites = largest(points, sizes[:, 0], SHAPES)
        if len(sites) > len(best) and is_lattice(points, sites):
            best = points[list(sites.values())]

    if not len(best):
        raise ImageError(
            "No lattice of bright dots or crossing lines was found. Take a sharp photograph of"
            " more of the lattice."
        )

    return best


def _marks(grey: NDArray[np.float32], styles: tuple[Style, ...]) -> dict[Style, list[Floats]]:
    """Dots and crossings at all levels, by style: position, size and rank (n, 4), px of the
    image.
    """
    finders = {"dots": find_dots, "grid": find_crossings}
    found = {style: [np.empty((0, 4))] for style in styles}

    for level, image_there in enumerate(levels_of(grey)):
        scale = 2.0**level
        x, y, strength = candidates(image_there)
        padded = np.pad(image_there, AROUND_PX, mode="edge")

        for first in range(0, len(x), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            windows = windows_at(padded, x[some], y[some])
            middles = np.stack([x[some], y[some]], axis=1) + 0.5

            for style in styles:
                marks = finders[style](windows)
                # a dot is best at the finest level at which it is complete, a crossing at the level
                # of its width
                if style == "dots":
                    rank = marks.contrast * FINER_RANK**level
                    size = scale * marks.radius
                else:
                    rank = strength[some][marks.which]
                    size = 0 * marks.radius + RADII_PX[0]

                at = scale * (middles[marks.which] + marks.off)
                found[style].append(np.column_stack([at, size, rank]))

    return found


def _grey(image: ArrayLike) -> NDArray[np.float32]:
    """One finite float channel (h, w)."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or min(image.shape[:2]) < LEAST_SIDE_PX:
        raise ImageError(
            "A photograph of {size} pixels is too small to find points in. Take a larger one.",
            size=" x ".join(map(str, image.shape)),
        )

    top = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1
    if image.ndim == 3:  # without alpha
        channels = [image[..., c] for c in range(3 if image.shape[2] >= 3 else 1)]
        grey = sum(
            (channel.astype(np.float32) for channel in channels[1:]), channels[0].astype(np.float32)
        )
        top = top * len(channels)
    else:
        grey = image.astype(np.float32)

    if not np.isfinite(grey).all():
        grey = np.nan_to_num(grey, posinf=0.0, neginf=0.0)

    return grey / np.float32(top)


def _distinct(found: Floats) -> Floats:
    """Distinct points (n, 3), with radius, from found ones (k, 4), with radius and rank: at each
    position the one of highest rank.
    """
    found = found[np.argsort(-found[:, 3], kind="stable")][:MOST_CANDIDATES]

    at = found[:, 0] + 1j * found[:, 1]
    free = np.ones(len(found), bool)

    for k in range(len(found)):
        if free[k]:
            size, rank = found[k, 2:]
            sizes, ranks = found[k + 1 :, 2:].T
            # a dot of another size may be inside a glare
            is_same = (sizes < ALIKE_SIZE * size) & (size < ALIKE_SIZE * sizes)
            is_same |= ranks < RANK_IN_GLARE * rank
            free[k + 1 :] &= ~is_same | (np.abs(at[k + 1 :] - at[k]) > np.maximum(size, sizes))

    return found[free, :3]
