"""A test card to verify that a display shows an image pixel for pixel, without cropping."""

import numpy as np
from numpy.typing import NDArray

FIELDS = 9  # squares of the lattice along the shorter side
GREYS = 11  # steps of the ramp from black to white
RAMP = (0.80, 0.88)  # of the height: start and end of the ramp
DIM = 0.15  # light of the lattice's lines, linear


def card(width: int, height: int) -> NDArray[np.float32]:
    """The card (height, width, 3), linear.

    A lattice of squares, a circle, a grey ramp with equal steps of encoded values, checkerboards of
    single pixels in the corners, and a white line along the outermost edge.
    """
    x = np.arange(width) - (width - 1) / 2
    y = np.arange(height)[:, None] - (height - 1) / 2
    side = min(width, height) / FIELDS
    image = np.zeros((height, width))

    # one pixel wide, at the squares' edges, counted from the middle
    lines = (np.abs(x - side * np.rint(x / side)) <= 0.5) | (
        np.abs(y - side * np.rint(y / side)) <= 0.5
    )
    image[lines] = DIM
    radius = min(width, height) / 2 - 0.5 * side
    image[np.abs(np.hypot(x, y) - radius) <= 1.0] = 1.0

    top, bottom = (int(part * height) for part in RAMP)
    encoded = np.floor(np.linspace(0, GREYS, width, endpoint=False)) / (GREYS - 1)
    greys = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    image[top:bottom] = greys

    n = max(2, int(side / 2))
    turns = (np.indices((n, n)).sum(axis=0) % 2).astype(float)
    for rows in (slice(0, n), slice(height - n, height)):
        for columns in (slice(0, n), slice(width - n, width)):
            image[rows, columns] = turns[: image[rows].shape[0], : image[rows, columns].shape[1]]

    image[[0, -1]] = image[:, [0, -1]] = 1.0
    return np.repeat(image[..., None], 3, axis=2).astype(np.float32)
