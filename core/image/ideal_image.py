"""The ideal image: the picture, undistorted, in the viewer's own pixels."""

import numpy as np
from numpy.typing import NDArray

from ..rig.rig import Picture, Viewer
from .picture import POINTS_AT_ONCE, of_square, picture_from_view
from .pyramid import Pyramid

SUBPIXELS = 2  # an ideal pixel is the mean of this many points an axis, each with its own footprint


def ideal_image(picture: Picture, viewer: Viewer) -> NDArray[np.float32]:
    """The picture as the viewer would see it with no glass in the way: (h, w, 3) linear."""
    pyramid = Pyramid(picture.image)
    place = picture.place
    w, h = viewer.width, viewer.height
    image = np.zeros((h * w, 3), np.float32)
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
    footprint = of_square(1 / SUBPIXELS)

    for first in range(0, h * w, POINTS_AT_ONCE):
        pixels = np.arange(first, min(first + POINTS_AT_ONCE, h * w))
        corner = np.stack([pixels % w, pixels // w], axis=1)
        total = np.zeros((len(pixels), 3))

        for dx in offsets:
            for dy in offsets:
                at = corner + np.array([dx, dy])
                total += pyramid.sample(picture_from_view(place, viewer, at, footprint))
        image[pixels] = total / SUBPIXELS**2

    return image.reshape(h, w, 3)
