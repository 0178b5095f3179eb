"""A calibration lattice: drawn, found in a photograph or read from a file, and its points told apart.

Pixels as the viewer's: x right and y down from the upper left corner, pixel centres at + 0.5. People count columns from
the left and rows from the top, both from 1.
"""

import csv
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import Bools, Floats, Ints
from .errors import ImageError
from .image_io import read_bytes
from .products import solve_symmetric

# as drawn, in spacings
DOT, MARK, LINE = 0.2, 0.26, 0.04  # radii of dots and of the first two; half the width of lines
LEAST_DRAWN = 1.0  # px, of these
# where something may be: bright maxima of the Hessian's determinant, in an image and in its halves, quarters ...
N_LEVELS = 5
SMALLEST = 24  # px, sides of an image in which anything is looked for
ROWS_AT_ONCE = 128  # so that a step's arrays stay in the processor's cache
ABOVE_NOISE = 5.0
LEAST_CONTRAST = 5e-4  # of the image's range: of 8 bits the smallest step
MOST_CANDIDATES = 4000  # of a level, the strongest
AROUND = 20  # px of a level on each side of a candidate
AT_ONCE = 500  # candidates
# what a dot is
LEAST_AREA = 9.0  # px of a level, where it is brighter than half
SOLID = 0.85  # of the area of an ellipse of its moments
LONGEST = 3.0  # times its width
LARGEST = 9.5  # px of a level, half its length: the ring around it has to lie in the window
UNQUIET = 0.2  # of its contrast: rms of what is around it
FREE = 0.6  # of the ring around it
DRAWN_BY_LIGHT = 0.05  # radii, between the centroids of its light and of its outline
# what a crossing is
RADII = np.arange(5.0, 14.0)  # px of a level at which arms are looked for
ANGLES = 2 * np.pi * np.arange(72) / 72
BENT = np.radians(40.0)  # an arm against its opposite
STATIONS = np.concatenate([-np.arange(5.0, 13.0), np.arange(5.0, 13.0)])  # px of a level, along a line
ACROSS = np.arange(-4.5, 4.75, 0.5)  # across it
WAVY = 0.7  # px of a level: rms by which a line may be off its parabola
# how a lattice goes on
NEAR = 0.3  # spacings, from where a point should be by its neighbours
STRANGE = 0.1  # spacings off: what never is too far
UNLIKE = np.log(2.2)  # in size, two neighbours
FAR = 1e9  # px
BY_CHANCE, FEW_BY_CHANCE = 9, 0.6  # fewer points than these are a lattice only if they are most of what was found
N_AROUND = 24  # nearest neighbours that tell a point's spacings
N_SEEDS, N_GROWN = 80, 8
SHAPES = 1j * np.concatenate([[0.5, 0.7, 1.0, 1.4, 2.0], np.exp(1j * np.radians([-30.0, 30.0]))])
MOST_TURNED, LEAST_SCALE, MOST_SCALE = np.radians(50.0), 0.4, 2.5
FEWEST = 4  # points of a lattice
TURNS = [np.array(turn) for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])]
SLANTS = [
    np.array(slant)
    for slant in ([[1, 0], [0, 1]], [[1, 1], [0, 1]], [[1, -1], [0, 1]], [[1, 0], [1, 1]], [[1, 0], [-1, 1]])
]
CLEAR_TURN, CLEAR = np.radians(4.0), 1.5  # how much the second best has to be worse: angle more, times the distance
ABOVE_ROUGHNESS = 6.0  # times the median distance of points from where their neighbours want them
MISTAKEN = 0.3  # spacings off, what is pointed out to people
# how a photograph is compared with the picture: u mirrored, v mirrored, columns and rows aside
COMPARED, LIKER = 400, 0.005  # places each way; by how much more another way has to be like the photograph
WAYS = {
    "mirrored": (True, False, 0, 0),
    "upside down and mirrored": (False, True, 0, 0),
    "upside down": (True, True, 0, 0),
    "a column to the left": (False, False, 1, 0),
    "a column to the right": (False, False, -1, 0),
    "a row higher": (False, False, 0, -1),
    "a row lower": (False, False, 0, 1),
}

Style = Literal["dots", "grid"]


@dataclass(frozen=True)
class Lattice:
    """A picture of columns x rows points; the outer ones stand a margin, in widths and heights, inside its borders."""

    columns: int
    rows: int
    margin: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 2:
            raise ImageError(f"A lattice of {self.columns} x {self.rows} points is none: take 2 or more each way.")
        if not 0 <= self.margin < 0.5:
            raise ImageError(f"A lattice cannot have a margin of {self.margin:g}: set one from 0 to below 0.5.")

    def __len__(self) -> int:
        return self.columns * self.rows

    @property
    def uv(self) -> Floats:
        """Where the points stand on the picture (rows * columns, 2), row by row from the upper left; v up."""
        across, down = (self.margin + (1 - 2 * self.margin) * np.linspace(0, 1, n) for n in (self.columns, self.rows))
        u, v = np.meshgrid(across, 1 - down)
        return np.stack([u.ravel(), v.ravel()], axis=1)

    def image(self, width: int, height: int, style: Style = "dots") -> NDArray[np.float32]:
        """The picture (height, width, 3), linear: bright dots, or lines that cross in the points, on black.

        Whoever looks can tell how it is turned and, of three columns or more, whether it is mirrored: the first two
        dots of the upper row are larger; of lines the first two fields hold a dot, the first a larger one.
        """
        size = np.array([width, height], float)
        at = np.stack([self.uv[:, 0], 1 - self.uv[:, 1]], axis=1) * size
        pitch = (1 - 2 * self.margin) * size / (self.columns - 1, self.rows - 1)
        spacing, room = pitch.min(), self.margin * size.min()
        thin = LINE if style == "grid" else DOT
        if spacing * thin < LEAST_DRAWN:
            raise ImageError(
                f"{self.columns} x {self.rows} points do not fit into {width} x {height} pixels:"
                f" take fewer points, or {np.ceil(LEAST_DRAWN / thin / spacing * max(width, height)):.0f} pixels."
            )
        if room < (MARK if style == "dots" else 5 * LINE) * spacing:
            raise ImageError(
                f"A margin of {self.margin:g} would cut the outer points: set one of half a spacing,"
                f" {0.5 / min(self.columns, self.rows):.2g}."
            )
        cover = np.zeros((height, width))
        if style == "grid":
            x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
            (left, top), (right, bottom) = at[0] - 0.5 * pitch, at[-1] + 0.5 * pitch
            long_x, long_y = (np.clip(np.minimum(a - lo, hi - a) + 0.5, 0, 1) for a, lo, hi in
                              ((x, left, right), (y, top, bottom)))  # fmt: skip
            for across in at[: self.columns, 0]:
                np.maximum(cover, np.clip(LINE * spacing + 0.5 - np.abs(x - across), 0, 1) * long_y[:, None], out=cover)
            for down in at[:: self.columns, 1]:
                np.maximum(cover, np.clip(LINE * spacing + 0.5 - np.abs(y - down), 0, 1)[:, None] * long_x, out=cover)
            n_marks = min(2, self.columns - 1)
            at, radii = at[:n_marks] + pitch / 2, spacing * np.array([DOT, DOT / 2])[:n_marks]
        else:
            radii = spacing * np.r_[MARK, MARK, np.full(len(self) - 2, DOT)]
        for centre, radius in zip(at, radii, strict=True):
            (x0, y0), (x1, y1) = np.floor(centre - radius - 1).astype(int).clip(0), np.ceil(centre + radius + 1)
            y, x = np.mgrid[y0 : min(int(y1), height), x0 : min(int(x1), width)] + 0.5
            patch = cover[y0 : y0 + y.shape[0], x0 : x0 + y.shape[1]]
            np.maximum(patch, np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1), out=patch)
        return np.repeat(cover[..., None], 3, axis=2).astype(np.float32)

    def name(self, index: int) -> str:
        """A point as people call it: (column, row)."""
        return f"({index % self.columns + 1}, {index // self.columns + 1})"


# From a file


def read_points(path: Path | str, lattice: Lattice, expected: Floats) -> Floats:
    """Measured points (m, 2), px, of a CSV file; NaN where there are none.

    Its first line names its columns: column, row, x and y, in any order, the first two counted from 1; or x and y
    alone, in which case `match` tells the points apart. Commas, semicolons or tabs between them; after semicolons a
    number may have a decimal comma.

    Parameters
    ----------
    expected : (m, 2) px, where the points are likely to be, NaN where they are not seen

    Raises
    ------
    ImageError : the file cannot be read, or says what cannot be
    """
    path = Path(path)
    data = read_bytes(path)
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # notes in other letters do not matter
    if "\0" in text:
        raise ImageError(f"The file '{path}' is no text: choose a CSV file of points.")
    if text.lower().startswith("sep="):
        text = text.partition("\n")[2]  # spreadsheets begin so
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(",;\t", key=first.count)
    try:
        rows = csv.reader(text.splitlines(), delimiter=delimiter, strict=True)
        lines = [(rows.line_num, [cell.strip() for cell in row]) for row in rows if any(c.strip() for c in row)]
    except csv.Error as reason:
        raise ImageError(f"The file '{path}' is no CSV file, see line {rows.line_num} ({reason}): repair it.") from None
    head = [name.lower() for name in lines[0][1]] if lines else []
    wanted = ["x", "y"] if {"column", "row"}.isdisjoint(head) else ["column", "row", "x", "y"]
    if any(head.count(name) != 1 for name in wanted):
        raise ImageError(f"The file '{path}' does not begin with the names column, row, x, y, or x, y: add that line.")
    places = [head.index(name) for name in wanted]
    found = np.full((len(lattice), 2), np.nan)
    loose, seen_in = [], {}
    for number, cells in lines[1:]:
        where = f"Line {number} of '{path}'"
        if len(cells) <= max(places):
            raise ImageError(f"{where} has {len(cells)} of {len(head)} columns: complete or remove it.")
        values = [cells[place].replace(",", ".") if delimiter == ";" else cells[place] for place in places]
        if values[-2:] == ["", ""] and len(values) == 4:
            continue  # a table of all points, with blanks for those not measured
        xy = [_number(value, where) for value in values[-2:]]
        if len(values) == 2:
            loose.append(xy)
            continue
        column, row = (_number(value, where) for value in values[:2])
        if not (column in range(1, lattice.columns + 1) and row in range(1, lattice.rows + 1)):
            raise ImageError(
                f"{where} has a point ({column:g}, {row:g}), but columns run from 1 to {lattice.columns}"
                f" and rows from 1 to {lattice.rows}: correct it."
            )
        index = (int(row) - 1) * lattice.columns + int(column) - 1
        if index in seen_in:
            raise ImageError(f"{where} has the point {lattice.name(index)} of line {seen_in[index]} again: remove one.")
        seen_in[index] = number
        found[index] = xy
    if not (loose or seen_in):
        raise ImageError(f"The file '{path}' has no points: choose another one.")
    if not loose:
        return found
    found = match(np.unique(loose, axis=0), expected, lattice)
    missing = missing_borders(found, expected, lattice)
    if missing:
        raise ImageError(
            f"Of the points in '{path}' {missing[0]} is missing, so that which is which cannot be told: complete them,"
            " or name them (column, row, x, y)."
        )
    return found


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ImageError(f"{where} has '{text}' where a number should be: correct it.") from None
    if not np.isfinite(value):
        raise ImageError(f"{where} has '{text}', which is no place: correct or remove the line.")
    return value


# In a photograph


def find_points(image: ArrayLike, style: Style | Literal["auto"] = "auto") -> Floats:
    """Positions (k, 2), px, of bright dots or crossings of bright lines that stand in a lattice; in no order.

    Parameters
    ----------
    image : (h, w) or (h, w, c), row 0 at the top; linear or encoded, for symmetric dots stay so
    style : what to look for; by default, whichever is found more often

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
                # of dots the finest level at which they are whole is the best, of crossings the one that fits
                rank = contrast * 0.8**level if name == "dots" else strength[some][kept]
                size = scale * radius if name == "dots" else 0 * radius + RADII[0]
                found[name].append(np.column_stack([scale * (middles[kept] + off), size, rank]))
    best = np.empty((0, 2))
    for parts in found.values():
        points, sizes = np.split(_distinct(np.concatenate(parts)), [2], axis=1)
        sites = _largest(points, sizes[:, 0], SHAPES)
        if len(sites) > len(best) and _is_lattice(points, sites):
            best = points[list(sites.values())]
    if not len(best):
        what = {"dots": "dots", "grid": "crossing lines", "auto": "dots or crossing lines"}[style]
        raise ImageError(
            f"No lattice of bright {what} was found in the photograph: take one in focus, in which more of it is seen."
        )
    return best


def _grey(image: ArrayLike) -> NDArray[np.float32]:
    """One float channel (h, w), finite."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or min(image.shape[:2]) < SMALLEST:
        raise ImageError(f"A photograph of {' x '.join(map(str, image.shape))} pixels is too small to find points in.")
    top = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1
    if image.ndim == 3:  # without alpha
        channels = [image[..., c] for c in range(3 if image.shape[2] >= 3 else 1)]
        grey = sum((channel.astype(np.float32) for channel in channels[1:]), channels[0].astype(np.float32))
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
    """Pixels x, y (k,) where the image bends down in all directions, as at dots and crossings but not along lines.

    And how much: the root of the Hessian's determinant.
    """
    h = len(level)
    halo = 8  # rows: three passes of two, one for derivatives, one for maxima
    padded = np.pad(level, halo, mode="reflect")
    found, noise = [], []
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
    strong = np.flatnonzero(strength > max(ABOVE_NOISE * level_noise, LEAST_CONTRAST * 0.12 * np.ptp(level)))
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
    """Which windows (k,) hold a dot in their middle; its centroid (n, 2) off the middle, radius (n,), contrast (n,)."""
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
    which, windows, smooth, region, contrast = (a[keep] for a in (which, windows, smooth, region, contrast))
    area, ground = area[keep].astype(float), ground[keep]

    side = np.arange(-AROUND, AROUND + 1.0)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    region = region.reshape(len(region), len(x))
    cx, cy = region @ x / area, region @ y / area
    xx, yy = region @ x**2 / area - cx**2 + 1 / 12, region @ y**2 / area - cy**2 + 1 / 12
    xy = region @ (x * y) / area - cx * cy
    det = xx * yy - xy**2
    long = (xx + yy) / 2 + np.sqrt((xx - yy) ** 2 / 4 + xy**2)
    keep = (area > SOLID * 4 * np.pi * np.sqrt(det)) & (long**2 < LONGEST**2 * det) & (4 * long < LARGEST**2)
    which, cx, cy, xx, yy, xy, det, area, contrast, ground = (
        a[keep] for a in (which, cx, cy, xx, yy, xy, det, area, contrast, ground)
    )
    windows, smooth = (a[keep].reshape(len(which), len(x)) for a in (windows, smooth))

    # from the middle, as a multiple of the ellipse that has the region's moments
    dx, dy = x - cx[:, None], y - cy[:, None]
    rho = np.sqrt(
        np.maximum(yy[:, None] * dx**2 - 2 * xy[:, None] * dx * dy + xx[:, None] * dy**2, 0) / det[:, None] / 4
    )
    radius = np.sqrt(area / np.pi)
    inner, outer = (1.35 + 1.5 / radius)[:, None], (1.9 + 2.0 / radius)[:, None]
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
    # what shines in from beside is cut off, so that it hardly draws the centroid
    bright = contrast[:, None] * np.where(rho < (1.1 + 0.5 / radius)[:, None], 1.3, 0.25)
    weight = np.where(rho < inner, np.clip(windows - plane, -0.25 * contrast[:, None], bright), 0)
    total = np.maximum(weight.sum(axis=1), 1e-12 * contrast)
    centre = np.stack([weight @ x / total, weight @ y / total], axis=1)
    keep = (n_calm > FREE * ring.sum(axis=1)) & (rms < UNQUIET * contrast)
    keep &= np.hypot(centre[:, 0] - cx, centre[:, 1] - cy) < DRAWN_BY_LIGHT * radius + 0.15
    return which[keep], centre[keep], radius[keep], contrast[keep]


def _flooded(mask: Bools) -> Bools:
    """What of masks (k, s, s) is connected with their middle pixel."""
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
    """Which windows (k,) hold a crossing in their middle; its place (n, 2) off the middle, size (n,), contrast (n,)."""
    turn = np.exp(1j * ANGLES)
    arms = np.sort(_sampled(windows, np.broadcast_to(RADII[:, None] * turn, (len(windows), len(RADII), len(turn)))), 1)
    along = arms[:, len(RADII) // 3]  # an arm is bright nearly all the way
    low, high = np.percentile(along, 30, axis=1), along.max(axis=1)
    excess = along - (low + 0.4 * (high - low))[:, None]
    is_arm = excess > 0
    starts = is_arm & ~np.roll(is_arm, 1, axis=1)
    kept = np.flatnonzero((starts.sum(axis=1) == 4) & (is_arm.mean(axis=1) < 0.6))
    contrast = (high - low)[kept]
    windows, excess, starts = windows[kept], np.maximum(excess[kept], 0), starts[kept]
    number = np.cumsum(starts, axis=1) % 4
    directions = np.stack([(excess * (number == k)) @ turn for k in range(4)], axis=1)
    ahead, behind = directions[:, :2], -directions[:, 2:]
    straight = (np.abs(np.angle(ahead * behind.conj())) < BENT).all(axis=1)
    kept, windows, contrast = kept[straight], windows[straight], contrast[straight]
    lines = ahead[straight] / np.abs(ahead[straight]) + behind[straight] / np.abs(behind[straight])
    lines /= np.abs(lines)

    design = np.stack([np.ones_like(STATIONS), STATIONS, STATIONS**2], axis=1)
    parabolas, is_line = np.zeros((len(kept), 2, 3)), np.ones(len(kept), bool)
    for k, line in enumerate(lines.T):
        for _ in range(3):
            ridge = parabolas[:, k] @ design.T
            at = STATIONS[:, None] + 1j * (ridge[:, :, None] + ACROSS)
            values = _sampled(windows, line[:, None, None] * at)
            dark, bright = values.min(axis=2, keepdims=True), values.max(axis=2, keepdims=True)
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
        step = np.stack([(gap.conj() * tangent[:, 1]).imag / cross, (gap.conj() * tangent[:, 0]).imag / cross], axis=1)
        t = np.clip(t + step, -5, 5)
    is_line &= np.abs(place[:, 0]) < 3.0
    meeting = place[is_line, 0]
    return kept[is_line], np.stack([meeting.real, meeting.imag], axis=1), np.ones(len(meeting)), contrast[is_line]


def _sampled(windows: NDArray[np.float32], at: NDArray[np.complex128]) -> Floats:
    """Windows (k, s, s) at places (k, ..., ) off their middles, x + iy, bilinear."""
    most = 2 * AROUND - 1e-3
    x, y = np.clip(at.real + AROUND, 0, most), np.clip(at.imag + AROUND, 0, most)
    column, row = x.astype(int), y.astype(int)
    x, y = x - column, y - row
    side = 2 * AROUND + 1
    first = (np.arange(len(windows)) * side**2).reshape(-1, *(1,) * (at.ndim - 1)) + row * side + column
    flat = windows.reshape(-1)
    return (flat[first] * (1 - x) + flat[first + 1] * x) * (1 - y) + (
        flat[first + side] * (1 - x) + flat[first + side + 1] * x
    ) * y


def _distinct(found: Floats) -> Floats:
    """Points (n, 3) with radius of those found (k, 4), with rank too: of several in one place that of highest rank."""
    found = found[np.argsort(-found[:, 3], kind="stable")][:MOST_CANDIDATES]
    at, free = found[:, 0] + 1j * found[:, 1], np.ones(len(found), bool)
    for k in range(len(found)):
        if free[k]:
            size, rank = found[k, 2:]
            sizes, ranks = found[k + 1 :, 2:].T
            is_same = (sizes < 1.5 * size) & (size < 1.5 * sizes) | (ranks < 0.25 * rank)  # a dot may stand in a glare
            free[k + 1 :] &= ~is_same | (np.abs(at[k + 1 :] - at[k]) > np.maximum(size, sizes))
    return found[free, :3]


# How a lattice goes on

Site = tuple[int, int]
Basis = NDArray[np.complex128]  # (2,) steps to the next column and to the next row, x + iy
Seed = tuple[int, Basis]


def _seeds(points: Floats, sizes: Floats, shapes: NDArray, steps: NDArray | None = None) -> list[Seed]:
    """Points from which a lattice may be grown, and its steps there; the likeliest first.

    Parameters
    ----------
    sizes : (k,) of the points: those of neighbours differ little
    shapes : (q,) complex, step to the next row by that to the next column, as they may be
    steps : (q,) complex px, step to the next column, from which it may be turned and scaled somewhat; None: any
    """
    at = points[:, 0] + 1j * points[:, 1]
    if len(at) < FEWEST:
        return []
    chosen = np.unique(np.linspace(0, len(at) - 1, N_SEEDS).astype(int))
    is_alike = np.abs(np.log(sizes / sizes[chosen, None])) < UNLIKE
    apart = np.where(is_alike, at - at[chosen, None], FAR)
    order = np.argsort(np.abs(apart), axis=1)[:, 1 : N_AROUND + 1]
    around = np.take_along_axis(apart, order, axis=1)
    n = min(10, around.shape[1])
    first, second = (k.ravel() for k in np.nonzero(~np.eye(n, dtype=bool)))
    a, b = around[:, first], around[:, second]
    is_likely = np.zeros(a.shape, bool)
    for k, shape in enumerate(shapes):
        fits = np.abs(b / a / shape - 1) < 0.4
        if steps is not None:
            grown = a / steps[k]
            fits &= (np.abs(np.angle(grown)) < MOST_TURNED) & (np.abs(grown) > LEAST_SCALE)
            fits &= np.abs(grown) < MOST_SCALE
        is_likely |= fits & (np.abs(a) < FAR) & (np.abs(b) < FAR)
    row, pair = np.nonzero(is_likely)
    a, b = a[row, pair], b[row, pair]
    short = np.minimum(np.abs(a), np.abs(b))
    missed = np.zeros(len(a))  # of the eight points around, in NEAR
    for i, j in product((-1, 0, 1), repeat=2):
        if (i, j) != (0, 0):
            off = np.abs(around[row] - (i * a + j * b)[:, None]).min(axis=1)
            missed += np.minimum(off / (NEAR * short), 1)
    missed += 0.05 * (np.abs(a) + np.abs(b)) / np.abs(around[row, 0])  # of equals the shortest
    found, has = [], set()
    for k in np.argsort(missed, kind="stable"):
        if row[k] not in has:
            has.add(row[k])
            found.append((int(chosen[row[k]]), np.array([a[k], b[k]])))
    return found[:N_GROWN]


def _largest(points: Floats, sizes: Floats, *shapes_and_steps: NDArray) -> dict[Site, int]:
    """The largest lattice that grows from a seed: indices of points by column and row, counted from anywhere."""
    best: dict[Site, int] = {}
    for seed in _seeds(points, sizes, *shapes_and_steps):
        sites = _grown(points[:, 0] + 1j * points[:, 1], sizes, *seed)
        if len(sites) > len(best):
            best = sites
        if len(best) > 0.97 * len(points):
            break
    return best


def _grown(at: NDArray[np.complex128], sizes: Floats, seed: int, basis: Basis) -> dict[Site, int]:
    """Points that go on from a seed, each where those before let it be expected: indices by column and row."""
    sites, bases, used = {(0, 0): seed}, {(0, 0): basis}, {seed}
    tried: dict[Site, int] = {}
    reach = 1
    while reach <= 2:  # where one is missing the next may be there
        steps = range(-reach, reach + 1)
        front = {(i + di, j + dj) for i, j in sites for di, dj in product(steps, steps)} - sites.keys()
        found = []
        for site in sorted(front):
            near = _near(site, sites)
            if tried.get(site) == len(near):
                continue
            tried[site] = len(near)
            known = [sites[s] for s in near]
            place, there = _predicted(site, near, at[known], np.mean([bases[s] for s in near], axis=0))
            off = np.where(np.abs(np.log(sizes / np.median(sizes[known]))) < UNLIKE, np.abs(at - place), np.inf)
            nearest = int(off.argmin())
            if off[nearest] < NEAR * np.abs(there).min() and nearest not in used:
                found.append((off[nearest], site, nearest, there))
        for _, site, nearest, there in sorted(found, key=lambda some: some[0]):
            if nearest not in used:
                sites[site], bases[site] = nearest, there
                used.add(nearest)
        reach = 1 if found else reach + 1
        if not found:
            tried.clear()
    return _without_strangers(at, sites, bases)


def _without_strangers(
    at: NDArray[np.complex128], sites: dict[Site, int], bases: dict[Site, Basis], strange: float = STRANGE
) -> dict[Site, int]:
    """Without the points that stand further from where their neighbours want them than the others do, worst first."""
    sites = dict(sites)
    while off := _roughness(at, sites, bases):
        worst = max(off, key=off.get)
        if off[worst] <= max(strange, ABOVE_ROUGHNESS * np.median(list(off.values()))):
            break
        del sites[worst]
    return sites


def _roughness(at: NDArray[np.complex128], sites: dict[Site, int], bases: dict[Site, Basis]) -> dict[Site, float]:
    """How far points stand from where their neighbours want them, in spacings; of those that have enough of these."""
    off = {}
    for site in sites:
        near = [s for s in _near(site, sites) if s != site]
        if len(near) > 3:
            place, there = _predicted(site, near, at[[sites[s] for s in near]], bases[site])
            off[site] = float(np.abs(at[sites[site]] - place) / np.abs(there).min())
    return off


def _mean_steps(at: NDArray[np.complex128], sites: dict[Site, int]) -> Basis:
    design = np.column_stack([np.ones(len(sites)), np.array(list(sites), float).reshape(-1, 2)])
    return np.linalg.lstsq(design, at[list(sites.values())], rcond=None)[0][1:]


def _near(site: Site, sites: dict[Site, int]) -> list[Site]:
    i, j = site
    return [s for di, dj in product(range(-3, 4), range(-3, 4)) if (s := (i + di, j + dj)) in sites]


def _predicted(site: Site, near: list[Site], at: NDArray, basis: Basis) -> tuple[complex, Basis]:
    """Where a point should be, and its steps there: by a paraboloid through points near it, held by known steps."""
    d = np.array(near, float) - site
    design = np.column_stack([np.ones(len(d)), d, d**2, d[:, 0] * d[:, 1]])
    weight = 1 / (d**2).sum(axis=1)
    held = np.diag([0, 0.01, 0.01, 0.03, 0.03, 0.03])
    right = design.T @ (weight * (at - d @ basis))
    found = np.linalg.solve((design.T * weight) @ design + held, right)
    return found[0], basis + found[1:3]


def _is_lattice(points: Floats, sites: dict[Site, int]) -> bool:
    """Are the points that grew together as regular as chance would not have them?"""
    if len(sites) < (FEWEST if len(sites) > FEW_BY_CHANCE * len(points) else BY_CHANCE):
        return False
    at = points[:, 0] + 1j * points[:, 1]
    rough = list(_roughness(at, sites, dict.fromkeys(sites, _mean_steps(at, sites))).values())
    return not rough or bool(np.quantile(rough, 0.75) < STRANGE)


# Which is which


def match(points: Floats, expected: Floats, lattice: Lattice) -> Floats:
    """Points told apart by how the lattice goes on from one to the next: (m, 2), NaN where none was found.

    They may be shifted by any amount against what is expected, turned by up to 45 degrees, scaled by 0.5 to 2 and bent;
    some may be missing, a few may be none of the lattice's. Where whole rows or columns at the border are missing, the
    place nearest to what is expected is taken.

    Parameters
    ----------
    points : (k, 2) px, in any order
    expected : (m, 2) px, NaN where a point is not expected to be seen

    Raises
    ------
    ImageError : the points are not those of the lattice, or may be so in several ways
    """
    expected = np.asarray(expected, float)
    sites = _largest(points, np.ones(len(points)), *_expected_steps(expected, lattice))
    if len(sites) < FEWEST:
        raise ImageError(
            f"The {len(points)} points do not form the lattice of {lattice.columns} x {lattice.rows}:"
            " choose another photograph, or say in a file which point is which."
        )
    index = np.array(list(sites.values()))
    places, at = _placements(np.array(list(sites)), lattice), points[index]
    place = _nearest_placement(places, at, expected, lattice)
    found = np.full((len(lattice), 2), np.nan)
    found[place[place >= 0]] = at[place >= 0]
    n, extra = int((place >= 0).sum()), len(points) - int((place >= 0).sum())
    if extra > max(3, n // 4):
        raise ImageError(
            f"{extra} of {len(points)} points have no place in the lattice of {lattice.columns} x {lattice.rows}:"
            " remove what else is bright, or set the lattice that is shown."
        )
    return found


def _expected_steps(expected: Floats, lattice: Lattice) -> tuple[NDArray, NDArray]:
    """Shapes and steps for `_seeds` at some places of the expected lattice."""
    at = (expected[:, 0] + 1j * expected[:, 1]).reshape(lattice.rows, lattice.columns)
    right, down = (at[:-1, 1:] - at[:-1, :-1]).ravel(), (at[1:, :-1] - at[:-1, :-1]).ravel()
    is_known = np.isfinite(right) & np.isfinite(down) & (np.abs(right) > 0) & (np.abs(down) > 0)
    if not is_known.any():
        raise ImageError("Too little of the lattice is expected to be seen to tell its points apart.")
    right, down = right[is_known], down[is_known]
    some = np.unique(np.linspace(0, len(right) - 1, 9).astype(int))
    return (down / right)[some], right[some]


def _placements(sites: Ints, lattice: Lattice) -> list[tuple[int, Ints]]:
    """Ways to put sites (n, 2) into the lattice that leave (nearly) the fewest over.

    Each as a number of the turn and slant that it takes, and which point (n,) each is then, -1 for none. Slanted,
    because a lattice grows as well by steps along its diagonals.
    """
    size = np.array([lattice.columns, lattice.rows])
    ways = []
    for turn, slant in product(TURNS, SLANTS):
        turned = sites @ slant @ turn
        turned -= turned.min(axis=0)
        # how many sites lie in a window of the lattice's size that begins at - (size - 1), ...: by sums from the corner
        total = np.zeros(turned.max(axis=0) + 2 * size, int)
        np.add.at(total, tuple((turned + size).T), 1)
        total = total.cumsum(axis=0).cumsum(axis=1)
        (w, h), (m, n) = size, np.array(total.shape) - size
        ways.append((turned, total[w:, h:] - total[:m, h:] - total[w:, :n] + total[:m, :n]))
    fewest = max(max(count.max() for _, count in ways) - 1, FEWEST)
    places = []
    for number, (turned, count) in enumerate(ways):
        for start in np.argwhere(count >= fewest):
            moved = turned - (start + 1 - size)
            inside = ((moved >= 0) & (moved < size)).all(axis=1)
            places.append((number, np.where(inside, moved[:, 1] * size[0] + moved[:, 0], -1)))
    return places


def _nearest_placement(places: list[tuple[int, Ints]], at: Floats, expected: Floats, lattice: Lattice) -> Ints:
    """That which is turned least against what is expected, of these the nearest; ImageError where it is not clear."""
    turned: dict[int, float] = {}
    distance = []
    for number, place in places:
        wanted = np.where((place >= 0)[:, None], expected[place], np.nan)
        both = np.isfinite(wanted).all(axis=1)
        distance.append(np.linalg.norm((at - wanted)[both].mean(axis=0)) if both.any() else np.inf)
        p, e = (xy[both, 0] + 1j * xy[both, 1] for xy in (at, wanted))
        if both.sum() >= 2:
            p, e = p - p.mean(), e - e.mean()
            grown = np.vdot(e, p) / np.vdot(e, e)
            off = abs(np.angle(grown)) + 2 * np.linalg.norm(p - grown * e) / np.linalg.norm(grown * e)
            turned[number] = min(off, turned.get(number, np.inf))
    if not turned:
        raise ImageError("No point is seen where one is expected, so they cannot be told apart.")
    least, *others = sorted(turned, key=turned.get)
    if others and turned[others[0]] - turned[least] < CLEAR_TURN:
        raise ImageError(
            "The photograph is turned by about 45 degrees, so left and upper cannot be told apart: turn it."
        )
    order = [k for k in np.argsort(distance) if places[k][0] == least]
    if len(order) > 1 and not distance[order[1]] > CLEAR * distance[order[0]]:
        raise ImageError(
            f"Too few of the {lattice.columns} columns and {lattice.rows} rows are seen to tell which they are:"
            " show more of the lattice, or say in a file which point is which."
        )
    return places[order[0]][1]


def check(points: Floats, lattice: Lattice) -> None:
    """Raise ImageError when points (m, 2), px, NaN where not measured, do not go on smoothly from one to the next.

    Which are swapped or mistaken is found from their neighbours. It takes a third of a spacing, or several times what
    the other points are off: light that is bent unevenly is no mistake.
    """
    at = points[:, 0] + 1j * points[:, 1]
    sites = {(k % lattice.columns, k // lattice.columns): k for k in np.flatnonzero(np.isfinite(at))}
    bases = dict.fromkeys(sites, _mean_steps(at, sites))
    good = _without_strangers(at, sites, bases, MISTAKEN)
    if not good:
        return
    rough = np.median(list(_roughness(at, good, bases).values()) or [0.0])
    most = max(MISTAKEN, ABOVE_ROUGHNESS * rough)
    wanted, spacing = {}, {}
    for site in sorted(sites.keys() - good.keys(), key=sites.get):
        near = _near(site, good)
        if len(near) > 3:
            place, there = _predicted(site, near, at[[good[s] for s in near]], bases[site])
            if np.abs(at[sites[site]] - place) > most * np.abs(there).min():
                wanted[site], spacing[site] = place, np.abs(there).min()
    if rough > MISTAKEN or len(wanted) > len(sites) / 3:
        raise ImageError(
            f"The points do not go on from one to the next as those of a lattice of {lattice.columns} x {lattice.rows}:"
            " they may be numbered in another way, or those of another lattice."
        )
    if not wanted:
        return
    told, swapped = [], set()
    for one, other in product(wanted, repeat=2):
        is_swap = one != other and not swapped & {one, other}
        for here, there in ((one, other), (other, one)):
            is_swap = is_swap and np.abs(at[sites[here]] - wanted[there]) < MISTAKEN * spacing[there]
        if is_swap:
            told.append(f"points {lattice.name(sites[one])} and {lattice.name(sites[other])} seem swapped")
            swapped |= {one, other}
    for site in wanted:
        if site not in swapped:
            far = np.abs(at[sites[site]] - wanted[site])
            told.append(f"point {lattice.name(sites[site])} stands {far:.0f} pixels from where its neighbours have it")
    raise ImageError(f"{'; '.join(told).capitalize()}: correct that, or leave them out.")


def missing_borders(points: Floats, expected: Floats, lattice: Lattice) -> list[str]:
    """Outer columns and rows of which points are expected (m, 2) but none was found (m, 2), in words."""
    shape = lattice.rows, lattice.columns
    is_known, is_due = (np.isfinite(xy).all(axis=1).reshape(shape) for xy in (points, expected))
    borders = {
        "the first column": np.s_[:, 0],
        "the last column": np.s_[:, -1],
        "the first row": np.s_[0],
        "the last row": np.s_[-1],
    }
    return [name for name, k in borders.items() if is_due[k].any() and not is_known[k].any()]


def check_way(points: Floats, expected: Floats) -> None:
    """Raise ImageError where points (m, 2), px, are mirrored or turned far against what is expected (m, 2) of them."""
    both = np.isfinite(points).all(axis=1) & np.isfinite(expected).all(axis=1)
    if both.sum() < FEWEST:
        return
    from_middle = expected[both] - expected[both].mean(axis=0)
    linear = np.linalg.lstsq(from_middle, points[both] - points[both].mean(axis=0), rcond=None)[0].T
    if np.linalg.det(linear) < 0 or np.abs(np.arctan2(linear[1, 0] - linear[0, 1], np.trace(linear))) > MOST_TURNED:
        raise ImageError(
            "The points are mirrored or turned against what is expected: count columns from the left and rows from the"
            " top, and hold the camera as the viewer looks."
        )


def check_picture(points: Floats, lattice: Lattice, photograph: NDArray, picture: NDArray, is_unsure: bool) -> None:
    """Raise ImageError where a photograph shows the picture better when mirrored, upside down or a column or row aside.

    Of a lattice whose points all look alike nothing can be told, but for its border: is_unsure, as where an outer
    column was not found, asks for a picture that is less like the photograph in all other ways.

    Parameters
    ----------
    points : (m, 2) px of the photograph, as they were told apart; NaN where not
    photograph, picture : (h, w, c), row 0 at the top; the picture is what the lattice is on
    """
    is_known = np.isfinite(points).all(axis=1)
    u, v = lattice.uv.T

    def terms(u: Floats, v: Floats) -> Floats:
        return np.stack([np.ones_like(u), u, v, u * v, u * u, v * v], axis=-1)

    if is_known.sum() < 2 * terms(u, v).shape[1]:
        return
    fit = np.linalg.lstsq(terms(u, v)[is_known], points[is_known], rcond=None)[0]
    side = (np.arange(COMPARED) + 0.5) / COMPARED
    u, v = (x.ravel() for x in np.meshgrid(side, side))
    at = terms(u, v) @ fit
    seen, is_inside = _read(photograph, at / photograph.shape[1::-1])
    steps = (1 - 2 * lattice.margin) / (np.array([lattice.columns, lattice.rows]) - 1)
    # only around points that were found: elsewhere the display may show nothing
    column, row = (np.rint((x - lattice.margin) / step).astype(int) for x, step in zip((u, 1 - v), steps, strict=True))
    is_inside &= (column >= 0) & (column < lattice.columns) & (row >= 0) & (row < lattice.rows)
    is_inside &= is_known[np.where(is_inside, row * lattice.columns + column, 0)]
    shown, _ = _read(picture, np.stack([u, 1 - v], axis=1))
    n = min(seen.shape[1], shown.shape[1])
    worst, way = -np.inf, ""
    for name, (mirror_u, mirror_v, columns, rows) in WAYS.items():
        other_u, other_v = (1 - u if mirror_u else u) + columns * steps[0], (1 - v if mirror_v else v) + rows * steps[1]
        other, is_there = _read(picture, np.stack([other_u, 1 - other_v], axis=1))
        some = is_inside & is_there
        more = _likeness(seen[some, :n], other[some, :n]) - _likeness(seen[some, :n], shown[some, :n])
        if more > worst:
            worst, way = more, name
    if worst > (-LIKER if is_unsure else LIKER):
        raise ImageError(
            f"The photograph seems to show the picture {way}, against how its points were told apart: hold the camera"
            " as the viewer looks, show all of the lattice, or say in a CSV which point is which."
        )


def _likeness(a: NDArray, b: NDArray) -> float:
    """Correlation of colours (n, c), the mean of each channel aside; 0 where there is nothing to compare."""
    if not len(a):
        return 0.0
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.sqrt((a * a).sum() * (b * b).sum())
    return float((a * b).sum() / size) if size > 0 else 0.0


def _read(image: NDArray, place: Floats) -> tuple[NDArray, Bools]:
    """Encoded colours (n, 3 or 1) at places (n, 2), 0..1 from the upper left, and which are in the image."""
    height, width = image.shape[:2]
    x, y = np.floor(place * (width, height)).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    channels = image.reshape(height, width, -1)[..., : 3 if image.ndim == 3 and image.shape[2] >= 3 else 1]
    return np.sqrt(np.clip(channels[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], 0, 1)), inside
