"""The pyramids of several images, of which some may be the same."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .pyramid import Pyramid


def pyramids_of(
    images: Sequence[NDArray[np.float32]], known: Sequence[Pyramid] = ()
) -> tuple[Pyramid, ...]:
    """A pyramid for each image (h, w, 4): one for the same array, and a known one where it is of
    such an image.
    """
    found: dict[int, Pyramid] = {}
    for image in images:
        if id(image) not in found:
            is_known = (one for one in known if one.is_of(image))
            found[id(image)] = next(is_known, None) or Pyramid(image)
    return tuple(found[id(image)] for image in images)
