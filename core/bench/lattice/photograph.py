"""Where a lattice's dots and crossings are in a photograph."""

from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arrays import Bools, Floats, Ints
from ...errors import ImageError
from ...products import solve_symmetric
from .drawn import Style
from .growth import SHAPES, is_lattice, largest

# where something may be: bright maxima of the Hessian's
# determinant, in an image and in its halves, quarters ...
N_LEVELS = 5
SMALLEST = 24  # px, sides of an image in which anything is looked for
ROWS_AT_ONCE = 128  # so that a step's arrays stay in the processor's cache
ABOVE_NOISE = 5.0
LEAST_CONTRAST = 5e-4  # of the image's range: of 8 bits the smallest step
MOST_CANDIDATES = 4000  # of a level, the strongest
AROUND = 20  # px of a level on each side of a candidate
AT_ONCE = 500  # candidates
# dots
LEAST_AREA = 9.0  # px of a level, where it is brighter than half
SOLID = 0.85  # of the area of an ellipse of its moments
LONGEST = 3.0  # times its width
LARGEST = 9.5  # px of a level, half its length: the ring around it has to lie in the window
UNQUIET = 0.2  # of its contrast: rms around it
FREE = 0.6  # of the ring around it
DRAWN_BY_LIGHT = 0.05  # radii, between the centroids of its light and of its outline
# crossings
RADII = np.arange(5.0, 14.0)  # px of a level at which arms are looked for
ANGLES = 2 * np.pi * np.arange(72) / 72
BENT = np.radians(40.0)  # an arm against its opposite
# px of a level, along a line
STATIONS = np.concatenate([-np.arange(5.0, 13.0), np.arange(5.0, 13.0)])
ACROSS = np.arange(-4.5, 4.75, 0.5)  # across it
WAVY = 0.7  # px of a level: rms by which a line may be off its parabola


def find_points(image: ArrayLike, style: Style | Literal["auto"] = "auto") -> Floats:
    """Positions (k, 2), px, of bright dots or crossings of
    bright lines that stand in a lattice; in no order.

    Parameters
    ----------
    image : (h, w) or (h, w, c), row 0 at the top; linear or encoded, for symmetric dots stay so
    style : dots or crossings; by default, whichever is found more often

    Raises
    ------
    ImageError : there is no lattice in the image
    """
    grey = _grey(image)
    finders = {"dots": _dots, "grid": _crossings}
    finders = finders if style == "auto" else {style: finders[style]}
    found = {name: [np.empty((0, 4))] for name in finders}
    for level, image_there in enumerate(_levels(grey)):
        x, y, strength = _candidates(image_there)
        padded = np.pad(image_there, AROUND, mode="edge")
        for first in range(0, len(x), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            windows = _windows(padded, x[some], y[some])
            middles = np.stack([x[some], y[some]], axis=1) + 0.5
            for name, finder in finders.items():
                kept, off, radius, contrast = finder(windows)
                scale = 2.0**level
                # of dots the finest level at which they are whole is
                # the best, of crossings the one that fits
                rank = contrast * 0.8**level if name == "dots" else strength[some][kept]
                size = scale * radius if name == "dots" else 0 * radius + RADII[0]
                found[name].append(np.column_stack([scale * (middles[kept] + off), size, rank]))
    best = np.empty((0, 2))
    for parts in found.values():
        points, sizes = np.split(_distinct(np.concatenate(parts)), [2], axis=1)
        sites = largest(points, sizes[:, 0], SHAPES)
        if len(sites) > len(best) and is_lattice(points, sites):
            best = points[list(sites.values())]
    if not len(best):
        marks = {"dots": "dots", "grid": "crossing lines", "auto": "dots or crossing lines"}[style]
        raise ImageError(
            "No lattice of bright {marks} was found in the photograph: take one in focus,"
            " in which more of it is seen.",
            marks=marks,
        )
    return best


def _grey(image: ArrayLike) -> NDArray[np.float32]:
    """One float channel (h, w), finite."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or min(image.shape[:2]) < SMALLEST:
        raise ImageError(
            "A photograph of {size} pixels is too small to find points in.",
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


def _levels(grey: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The image, and means of 2 x 2, 4 x 4 ... of its pixels, which keep centroids."""
    levels = [grey]
    while len(levels) < N_LEVELS and min(levels[-1].shape) >= 2 * SMALLEST:
        last = levels[-1]
        h, w = (n // 2 * 2 for n in last.shape)
        rows = last[0:h:2, :w] + last[1:h:2, :w]
        levels.append((rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25))
    return levels


def _candidates(level: NDArray[np.float32]) -> tuple[Ints, Ints, Floats]:
    """Pixels x, y (k,) where the image bends down in all
    directions, as at dots and crossings but not along lines.

    And how much: the root of the Hessian's determinant.
    """
    h = len(level)
    halo = 8  # rows: three passes of two, one for derivatives, one for maxima
    padded = np.pad(level, halo, mode="reflect")
    found = []
    noise = []
    for first in range(0, h, ROWS_AT_ONCE):
        rows = padded[first : min(first + ROWS_AT_ONCE, h) + 2 * halo]
        for _ in range(3):  # each with a variance of one pixel squared
            rows = _smooth(rows)
            rows = _smooth(rows.T).T
        rows = np.ascontiguousarray(rows)
        inner = rows[1:-1, 1:-1]
        xx = rows[1:-1, 2:] - 2 * inner + rows[1:-1, :-2]
        yy = rows[2:, 1:-1] - 2 * inner + rows[:-2, 1:-1]
        xy = (rows[2:, 2:] - rows[2:, :-2] - rows[:-2, 2:] + rows[:-2, :-2]) / 4
        trace = xx + yy
        noise.append(trace[::4, ::4].ravel())
        bend = np.where(trace < 0, xx * yy - xy * xy, 0)
        middle = bend[1:-1, 1:-1]
        is_top = middle > 0
        n, m = middle.shape
        for dy, dx in product((0, 1, 2), repeat=2):
            if (dy, dx) != (1, 1):
                other = bend[dy : dy + n, dx : dx + m]
                is_top &= middle > other if (dy, dx) < (1, 1) else middle >= other
        y, x = np.nonzero(is_top)
        found.append(np.stack([x, y + first, np.sqrt(middle[y, x])], axis=1))
    x, y, strength = np.concatenate(found).T
    level_noise = np.median(np.abs(np.concatenate(noise))) / 0.67 / 2
    strong = np.flatnonzero(
        strength > max(ABOVE_NOISE * level_noise, LEAST_CONTRAST * 0.12 * np.ptp(level))
    )
    strong = strong[np.argsort(-strength[strong], kind="stable")][:MOST_CANDIDATES]
    return x[strong].astype(int), y[strong].astype(int), strength[strong]


def _smooth(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Binomial of five along the first axis, which loses two at each end."""
    one = rows[1:] + rows[:-1]
    two = one[1:] + one[:-1]
    one = two[1:] + two[:-1]
    return (one[1:] + one[:-1]) * np.float32(1 / 16)


def _windows(padded: NDArray[np.float32], x: Ints, y: Ints) -> NDArray[np.float32]:
    """The image around pixels (k,): (k, 2 AROUND + 1, 2 AROUND + 1)."""
    side = np.arange(2 * AROUND + 1)
    return padded[y[:, None, None] + side[:, None], x[:, None, None] + side]


def _dots(windows: NDArray[np.float32]) -> tuple[Ints, Floats, Floats, Floats]:
    """Which windows (k,) hold a dot in their middle.

    Its centroid (n, 2) off the middle, radius (n,), contrast (n,).
    """
    which = np.arange(len(windows))
    smooth = np.pad(windows, ((0, 0), (1, 1), (1, 1)), mode="edge")
    smooth = smooth[:, :-2] + 2 * smooth[:, 1:-1] + smooth[:, 2:]
    smooth = (smooth[:, :, :-2] + 2 * smooth[:, :, 1:-1] + smooth[:, :, 2:]) / 16
    ground = np.percentile(windows.reshape(len(windows), -1), 30, axis=1)
    contrast = smooth[:, AROUND, AROUND] - ground
    region = _flooded(smooth > (ground + 0.5 * contrast)[:, None, None])
    is_whole = ~(region[:, [0, -1]].any(axis=(1, 2)) | region[:, :, [0, -1]].any(axis=(1, 2)))
    area = region.sum(axis=(1, 2))
    keep = is_whole & (area >= LEAST_AREA)
    which, windows, smooth, region, contrast = (
        a[keep] for a in (which, windows, smooth, region, contrast)
    )
    area = area[keep].astype(float)
    ground = ground[keep]

    side = np.arange(-AROUND, AROUND + 1.0)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    region = region.reshape(len(region), len(x))
    cx = region @ x / area
    cy = region @ y / area
    xx = region @ x**2 / area - cx**2 + 1 / 12
    yy = region @ y**2 / area - cy**2 + 1 / 12
    xy = region @ (x * y) / area - cx * cy
    det = xx * yy - xy**2
    long = (xx + yy) / 2 + np.sqrt((xx - yy) ** 2 / 4 + xy**2)
    keep = (
        (area > SOLID * 4 * np.pi * np.sqrt(det))
        & (long**2 < LONGEST**2 * det)
        & (4 * long < LARGEST**2)
    )
    which, cx, cy, xx, yy, xy, det, area, contrast, ground = (
        a[keep] for a in (which, cx, cy, xx, yy, xy, det, area, contrast, ground)
    )
    windows, smooth = (a[keep].reshape(len(which), len(x)) for a in (windows, smooth))

    # from the middle, as a multiple of the ellipse that has the region's moments
    dx = x - cx[:, None]
    dy = y - cy[:, None]
    rho = np.sqrt(
        np.maximum(yy[:, None] * dx**2 - 2 * xy[:, None] * dx * dy + xx[:, None] * dy**2, 0)
        / det[:, None]
        / 4
    )
    radius = np.sqrt(area / np.pi)
    inner = (1.35 + 1.5 / radius)[:, None]
    outer = (1.9 + 2.0 / radius)[:, None]
    ring = (rho > inner) & (rho < outer)
    calm = ring & (smooth < (ground + 0.5 * contrast)[:, None])
    design = np.stack([np.ones_like(x), x / AROUND, y / AROUND], axis=1)
    for _ in range(2):
        normal = np.einsum("kp,pi,pj->kij", calm, design, design, optimize=True) + 1e-6 * np.eye(3)
        plane = solve_symmetric(normal, ((calm * smooth) @ design)[..., None])[..., 0] @ design.T
        off = smooth - plane
        calm = ring & (np.abs(off) < 0.35 * contrast[:, None])
    n_calm = calm.sum(axis=1)
    rms = np.sqrt((calm * off**2).sum(axis=1) / np.maximum(n_calm, 1))
    # light from beside is cut off, so that it hardly draws the centroid
    bright = contrast[:, None] * np.where(rho < (1.1 + 0.5 / radius)[:, None], 1.3, 0.25)
    weight = np.where(rho < inner, np.clip(windows - plane, -0.25 * contrast[:, None], bright), 0)
    total = np.maximum(weight.sum(axis=1), 1e-12 * contrast)
    centre = np.stack([weight @ x / total, weight @ y / total], axis=1)
    keep = (n_calm > FREE * ring.sum(axis=1)) & (rms < UNQUIET * contrast)
    keep &= np.hypot(centre[:, 0] - cx, centre[:, 1] - cy) < DRAWN_BY_LIGHT * radius + 0.15
    return which[keep], centre[keep], radius[keep], contrast[keep]


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


def _crossings(windows: NDArray[np.float32]) -> tuple[Ints, Floats, Floats, Floats]:
    """Which windows (k,) hold a crossing in their middle.

    Its place (n, 2) off the middle, size (n,), contrast (n,).
    """
    turn = np.exp(1j * ANGLES)
    arms = np.sort(
        _sampled(
            windows, np.broadcast_to(RADII[:, None] * turn, (len(windows), len(RADII), len(turn)))
        ),
        1,
    )
    along = arms[:, len(RADII) // 3]  # an arm is bright nearly all the way
    low = np.percentile(along, 30, axis=1)
    high = along.max(axis=1)
    excess = along - (low + 0.4 * (high - low))[:, None]
    is_arm = excess > 0
    starts = is_arm & ~np.roll(is_arm, 1, axis=1)
    kept = np.flatnonzero((starts.sum(axis=1) == 4) & (is_arm.mean(axis=1) < 0.6))
    contrast = (high - low)[kept]
    windows = windows[kept]
    excess = np.maximum(excess[kept], 0)
    starts = starts[kept]
    number = np.cumsum(starts, axis=1) % 4
    directions = np.stack([(excess * (number == k)) @ turn for k in range(4)], axis=1)
    ahead = directions[:, :2]
    behind = -directions[:, 2:]
    straight = (np.abs(np.angle(ahead * behind.conj())) < BENT).all(axis=1)
    kept = kept[straight]
    windows = windows[straight]
    contrast = contrast[straight]
    lines = ahead[straight] / np.abs(ahead[straight]) + behind[straight] / np.abs(behind[straight])
    lines /= np.abs(lines)

    design = np.stack([np.ones_like(STATIONS), STATIONS, STATIONS**2], axis=1)
    parabolas = np.zeros((len(kept), 2, 3))
    is_line = np.ones(len(kept), bool)
    for k, line in enumerate(lines.T):
        for _ in range(3):
            ridge = parabolas[:, k] @ design.T
            at = STATIONS[:, None] + 1j * (ridge[:, :, None] + ACROSS)
            values = _sampled(windows, line[:, None, None] * at)
            dark = values.min(axis=2, keepdims=True)
            bright = values.max(axis=2, keepdims=True)
            weight = np.maximum(values - dark - 0.15 * (bright - dark), 1e-12)
            ridge = ridge + weight @ ACROSS / weight.sum(axis=2)
            parabolas[:, k] = np.linalg.lstsq(design, ridge.T, rcond=None)[0].T
        is_line &= np.sqrt(((ridge - parabolas[:, k] @ design.T) ** 2).mean(axis=1)) < WAVY
    # where the two meet: line 0 at t0, line 1 at t1, by Newton's method
    t = np.zeros((len(kept), 2))
    one = np.stack([np.ones(len(kept)), np.zeros(len(kept)), np.zeros(len(kept))], axis=1)
    for _ in range(5):
        powers = np.stack([one[:, :1] + 0 * t, t, t**2], axis=2)
        slopes = np.stack([0 * t, one[:, :1] + 0 * t, 2 * t], axis=2)
        place = lines * (t + 1j * (parabolas * powers).sum(axis=2))
        tangent = lines * (1 + 1j * (parabolas * slopes).sum(axis=2))
        gap = place[:, 1] - place[:, 0]
        cross = (tangent[:, 0].conj() * tangent[:, 1]).imag
        cross = np.where(np.abs(cross) < 0.1, 1.0, cross)
        step = np.stack(
            [(gap.conj() * tangent[:, 1]).imag / cross, (gap.conj() * tangent[:, 0]).imag / cross],
            axis=1,
        )
        t = np.clip(t + step, -5, 5)
    is_line &= np.abs(place[:, 0]) < 3.0
    meeting = place[is_line, 0]
    return (
        kept[is_line],
        np.stack([meeting.real, meeting.imag], axis=1),
        np.ones(len(meeting)),
        contrast[is_line],
    )


def _sampled(windows: NDArray[np.float32], at: NDArray[np.complex128]) -> Floats:
    """Windows (k, s, s) at places (k, ..., ) off their middles, x + iy, bilinear."""
    most = 2 * AROUND - 1e-3
    x = np.clip(at.real + AROUND, 0, most)
    y = np.clip(at.imag + AROUND, 0, most)
    column = x.astype(int)
    row = y.astype(int)
    x, y = x - column, y - row
    side = 2 * AROUND + 1
    first = (
        (np.arange(len(windows)) * side**2).reshape(-1, *(1,) * (at.ndim - 1)) + row * side + column
    )
    flat = windows.reshape(-1)
    return (flat[first] * (1 - x) + flat[first + 1] * x) * (1 - y) + (
        flat[first + side] * (1 - x) + flat[first + side + 1] * x
    ) * y


def _distinct(found: Floats) -> Floats:
    """Points (n, 3) with radius of those found (k, 4), with rank
    too: of several in one place that of highest rank.
    """
    found = found[np.argsort(-found[:, 3], kind="stable")][:MOST_CANDIDATES]
    at = found[:, 0] + 1j * found[:, 1]
    free = np.ones(len(found), bool)
    for k in range(len(found)):
        if free[k]:
            size, rank = found[k, 2:]
            sizes, ranks = found[k + 1 :, 2:].T
            # a dot may stand in a glare
            is_same = (sizes < 1.5 * size) & (size < 1.5 * sizes) | (ranks < 0.25 * rank)
            free[k + 1 :] &= ~is_same | (np.abs(at[k + 1 :] - at[k]) > np.maximum(size, sizes))
    return found[free, :3]
