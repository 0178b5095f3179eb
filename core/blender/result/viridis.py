"""Colours of a scale from dark to bright that people with any colour vision can read."""

import numpy as np
from numpy.typing import ArrayLike

from ...base.arrays import Floats

# matplotlib's viridis by S. van der Walt and N. Smith (CC0), at every fourth of its length
ANCHORS = np.array(
    [
        (0.267, 0.005, 0.329),
        (0.229, 0.322, 0.546),
        (0.128, 0.567, 0.551),
        (0.369, 0.789, 0.383),
        (0.993, 0.906, 0.144),
    ]
)


def viridis(values: ArrayLike) -> Floats:
    """Colours (n, 3), sRGB, of values (n,) 0..1."""
    at = np.clip(values, 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(ANCHORS))
    return np.stack([np.interp(at, places, column) for column in ANCHORS.T], axis=-1)
