"""Tone curve from the colours of a picture's image to the wanted light.

For a channel c of the straight colour, linear, with black level b, gamma g and brightness B:

    light = B max((c - b) / (1 - b), 0)^(1 / g)

times alpha. At a brightness of 1, white stays white for any black level and gamma.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PIXELS_AT_ONCE = 1 << 18  # processed together


@dataclass(frozen=True)
class Tone:
    """Tone of a picture.

    Parameters
    ----------
    brightness : factor on the light of the image, 0 or more
    gamma : above 0; more than 1 lightens the midtones
    black_level : 0 up to below 1, linear; darker colours become black, and the rest is stretched
    """

    brightness: float = 1.0
    gamma: float = 1.0
    black_level: float = 0.0

    def of(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """The wanted light of an image (h, w, 4), linear, premultiplied; modifies the image."""
        if self == Tone():
            return image

        step = max(1, PIXELS_AT_ONCE // image.shape[1])
        for first in range(0, len(image), step):
            rows = image[first : first + step]
            if self.gamma != 1 or self.black_level != 0:
                _bend(rows, self.gamma, self.black_level)
            rows[..., :3] *= self.brightness

        return image


def _bend(rows: NDArray[np.float32], gamma: float, black_level: float) -> None:
    """Apply black level and gamma to premultiplied rows (n, w, 4), in place."""
    alpha = rows[..., 3:].astype(float)
    straight = np.divide(rows[..., :3], alpha, out=np.zeros(rows[..., :3].shape), where=alpha > 0)
    above = np.maximum((straight - black_level) / (1 - black_level), 0)
    rows[..., :3] = above ** (1 / gamma) * alpha
