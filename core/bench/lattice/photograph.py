"""Where a lattice's dots and crossings are in a photograph.

Bright maxima of the Hessian's determinant are candidates, in the image and in its halves, quarters
(windows.py). Each is looked at closely, as a dot (dots.py) and as a crossing (crossings.py), and
the largest lattice that grows out of dots or out of crossings (growth.py) is the one that is seen.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arrays import Floats
from ...base.errors import ImageError
from ...base.messages import Message
from .crossings import RADII_PX, find_crossings
from .dots import find_dots
from .drawn import Style
from .growth import SHAPES, is_lattice, largest
from .windows import SEARCH, candidates, levels_of, windows_at

FINER_RANK = 0.8  # of a dot's rank, at the next coarser level: the finest at which it is whole
ALIKE_SIZE = 1.5  # times the size: dots in one place are one dot up to here
RANK_IN_GLARE = 0.25  # of the rank: a dot may stand in a glare


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
    found = _marks(_grey(image), ("dots", "grid") if style == "auto" else (style,))

    best = np.empty((0, 2))
    for parts in found.values():
        points, sizes = np.split(_distinct(np.concatenate(parts)), [2], axis=1)
        sites = largest(points, sizes[:, 0], SHAPES)
        if len(sites) > len(best) and is_lattice(points, sites):
            best = points[list(sites.values())]

    if not len(best):
        marks = {
            "dots": Message("dots"),
            "grid": Message("crossing lines"),
            "auto": Message("dots or crossing lines"),
        }[style]
        raise ImageError(
            "No lattice of bright {marks} was found in the photograph: take a sharp one"
            " that shows more of the lattice.",
            marks=marks,
        )

    return best


def _marks(grey: NDArray[np.float32], styles: tuple[Style, ...]) -> dict[Style, list[Floats]]:
    """Dots and crossings at all levels, by style: place, size and rank (n, 4), px of the image."""
    finders = {"dots": find_dots, "grid": find_crossings}
    found = {style: [np.empty((0, 4))] for style in styles}

    for level, image_there in enumerate(levels_of(grey)):
        scale = 2.0**level
        x, y, strength = candidates(image_there)
        padded = np.pad(image_there, SEARCH.around_px, mode="edge")

        for first in range(0, len(x), SEARCH.windows_at_once):
            some = slice(first, first + SEARCH.windows_at_once)
            windows = windows_at(padded, x[some], y[some])
            middles = np.stack([x[some], y[some]], axis=1) + 0.5

            for style in styles:
                marks = finders[style](windows)
                # of dots the finest level at which they are whole is
                # the best, of crossings the one that fits
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
    """One float channel (h, w), finite."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or min(image.shape[:2]) < SEARCH.least_side_px:
        raise ImageError(
            "A photograph of {size} pixels is too small to find points in: take a larger one.",
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
    """Points (n, 3) with radius of those found (k, 4), with rank
    too: of several in one place that of highest rank.
    """
    found = found[np.argsort(-found[:, 3], kind="stable")][: SEARCH.most_candidates]

    at = found[:, 0] + 1j * found[:, 1]
    free = np.ones(len(found), bool)

    for k in range(len(found)):
        if free[k]:
            size, rank = found[k, 2:]
            sizes, ranks = found[k + 1 :, 2:].T
            # a dot may stand in a glare
            is_same = (sizes < ALIKE_SIZE * size) & (size < ALIKE_SIZE * sizes)
            is_same |= ranks < RANK_IN_GLARE * rank
            free[k + 1 :] &= ~is_same | (np.abs(at[k + 1 :] - at[k]) > np.maximum(size, sizes))

    return found[free, :3]
