"""Errors of maps and images, against references: what is measured, and how far off it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...files.encoding import encode

PERCENTILE = 99.9

# between black and white, in the encoded image
STEPS_OF_FORMAT = {"8 bit": 255, "10 bit": 1023, "16 bit": 65535}


@dataclass(frozen=True)
class MapErrors:
    """How far off one viewer's map is: as the solve itself tells, and from traced landings.

    Distances are those of the points that map and trace both take to the display.

    estimate : percentile of the map's error as the solve itself estimates it, display px
    facet_limited, unresolved : shares of the viewer's image that the solve itself says are so
    rms, percentile : rms and PERCENTILE of the distance,
        display px; None where there are no such points
    overlap : of the points that the map or the trace takes to
        the display, the share that both do (IoU)
    """

    estimate: float
    facet_limited: float
    unresolved: float
    rms: float | None
    percentile: float | None
    overlap: float | None


@dataclass(frozen=True)
class SeenErrors:
    """How far off one viewer's seen image is.

    seen_psnr : dB, white is 1, over the viewer's pixels that show the picture and no more: what is
        seen of this source image, against what is seen of the reference's; None when there is no
        difference
    lattice_shift, lattice_largest : mean and largest displacement of the dots of the
        lattice as seen, against the ideal image, viewer px; None where no dot is seen
    lattice_seen : dots that are seen; None where the lattice was not painted
    """

    seen_psnr: float | None
    lattice_shift: float | None
    lattice_largest: float | None
    lattice_seen: int | None


@dataclass(frozen=True)
class ImageErrors:
    """How far off a source image is, and each viewer's seen image.

    source_rmse : linear values, over the display pixels that show
        the picture and no more (Reference.is_shown)
    holes : those of them that stay black, where the picture is
        nowhere black; they count in source_rmse
    """

    source_rmse: float
    holes: int
    channels: tuple[SeenErrors, ...]


def rms(values: Floats) -> float:
    """Root of the mean square; 0 of none."""
    return float(np.sqrt(np.mean(np.square(values, dtype=float)))) if values.size else 0.0


def psnr(difference: Floats) -> float | None:
    """Peak signal-to-noise ratio, dB, of an image that is off by this; None where it is not."""
    off = rms(difference)
    return float(-20 * np.log10(off)) if off > 0 else None


def quantisation(source: NDArray[np.float32]) -> dict[str, float]:
    """Rms changes by number formats in an image (..., 3), linear, sRGB-encoded to 0..1.

    Clipping is not counted.
    """
    encoded = encode(source)
    changed = {
        name: np.rint(encoded * top) / top - encoded for name, top in STEPS_OF_FORMAT.items()
    }
    changed["half float"] = encode(np.asarray(source, np.float16)) - encoded
    return {name: float(np.sqrt((change**2).mean())) for name, change in changed.items()}
