"""How near a seen image comes to the ideal: PSNR, SSIM and ringing."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..base.arrays import Bools, Floats
from ..files.encoding import encode
from .simulation import LUMINANCE

# Wang, Bovik, Sheikh and Simoncelli, Image quality assessment: from error visibility to structural
# similarity, IEEE Trans. Image Processing 13, 2004, 600-612: window and constants
WINDOW = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
WINDOW /= WINDOW.sum()
C1, C2 = 0.01**2, 0.03**2
AROUND = 2  # px: ringing is light outside the ideal's range in a square this far around


@dataclass(frozen=True)
class SeenQuality:
    """A seen image compared with the ideal one, over the pixels that show only the display.

    psnr : dB, of linear light; white is 1; None if there is no error
    ssim : mean structural similarity of the encoded luminance, up to 1
    ringing : rms of linear light above the brightest or below the darkest ideal pixel nearby, of
        white
    """

    psnr: float | None
    ssim: float
    ringing: float


def quality(seen: Floats, ideal: Floats, is_whole: Bools) -> SeenQuality | None:
    """Quality of a seen image (h, w, 3), linear; None if no pixel counts.

    is_whole : (h, w) pixels that count
    """
    if not is_whole.any():
        return None
    seen, ideal = np.asarray(seen, float), np.asarray(ideal, float)
    square = float(((seen - ideal)[is_whole] ** 2).mean())

    height, width = is_whole.shape
    padded = np.pad(ideal, ((AROUND, AROUND), (AROUND, AROUND), (0, 0)), mode="edge")
    steps = range(2 * AROUND + 1)
    around = [padded[y : y + height, x : x + width] for y, x in product(steps, steps)]
    low, high = np.minimum.reduce(around), np.maximum.reduce(around)
    outside = np.maximum(seen - high, 0) + np.maximum(low - seen, 0)

    one, other = (encode(image.clip(0, 1)) @ LUMINANCE for image in (seen, ideal))
    return SeenQuality(
        psnr=-10 * float(np.log10(square)) if square > 0 else None,
        ssim=float(_similarity(one, other)[is_whole].mean()),
        ringing=float(np.sqrt((outside[is_whole] ** 2).mean())),
    )


def _similarity(one: Floats, other: Floats) -> Floats:
    """Structural similarity (h, w) of two images (h, w)."""
    a, b = _smoothed(one), _smoothed(other)
    aa, bb, ab = (_smoothed(x) for x in (one * one, other * other, one * other))
    cross, variances = ab - a * b, aa - a * a + bb - b * b
    return (2 * a * b + C1) * (2 * cross + C2) / ((a * a + b * b + C1) * (variances + C2))


def _smoothed(image: Floats) -> Floats:
    """An image (h, w) under the window, its edges repeated."""
    for axis in (0, 1):
        image = np.moveaxis(image, axis, 0)
        padded = np.pad(image, ((5, 5), (0, 0)), mode="edge")
        image = sum(w * padded[k : k + len(image)] for k, w in enumerate(WINDOW))
        image = np.moveaxis(image, 0, axis)
    return image
