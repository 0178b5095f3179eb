"""The source image of a ball by the closed form of its rays: integrals over display pixels."""

import numpy as np

from kiriko.core.image.flat_picture import flat_mapping
from known.closed_forms import landing, through_ball

NODES = 5  # along a display pixel: where on the viewer's image it is seen is a quartic between them
STEP_PX = 1e-4  # viewer px, of differences
NEWTON_STEPS = 12
FARTHEST_STEP_PX = 4.0
GUESSES = 400  # along each side of the viewer's image
LANDED_PX = 1e-7


def exact_source(a_rig, index, radius=0.025, along=33):
    """Red (n,) of some display pixels (n,), and the part of each that shows the picture; NaN where
    the ball shows none of a pixel.

    Light from a point of the display is followed to the viewer's image by Newton's method on the
    closed form, at 5 x 5 places of a pixel; the picture between its pixels is then summed at
    along x along places, weighed by the area that they have on the viewer's image.
    """
    viewer, display = a_rig.viewer, a_rig.displays[0]
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    corner = np.stack([index % display.width, index // display.width], axis=1)
    y, x = np.meshgrid(nodes, nodes, indexing="ij")
    target = (corner[:, None] + np.stack([x.ravel(), y.ravel()], axis=1)).reshape(-1, 2)

    def lands(xy):
        return landing(a_rig, *through_ball(*viewer.rays(xy), radius, a_rig.glasses[0].ior.at(550)))

    view = _settled(lands, _guesses(lands, viewer, corner + 0.5), target)
    view = view.reshape(len(index), NODES, NODES, 2)
    return _sums(a_rig, view, nodes, along)


def _guesses(lands, viewer, middles):
    """The places of a grid on the viewer's image that land nearest to middles of pixels."""
    at = (np.arange(GUESSES) + 0.5) / GUESSES
    x, y = np.meshgrid(at * viewer.width, at * viewer.height)
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    found = lands(grid)
    seen = np.isfinite(found).all(axis=1)
    grid, found = grid[seen], found[seen]
    nearest = [((found - middle) ** 2).sum(axis=1).argmin() for middle in middles]
    return np.repeat(grid[nearest], NODES**2, axis=0)


def _settled(lands, view, target):
    """Viewer px that land on targets, NaN where Newton's method comes to none."""
    for _ in range(NEWTON_STEPS):
        by_x, by_y = (
            (lands(view + h) - lands(view - h)) / (2 * STEP_PX) for h in STEP_PX * np.eye(2)
        )
        missed = target - lands(view)
        det = by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0]
        step = (
            np.stack(
                [
                    by_y[:, 1] * missed[:, 0] - by_y[:, 0] * missed[:, 1],
                    by_x[:, 0] * missed[:, 1] - by_x[:, 1] * missed[:, 0],
                ],
                axis=1,
            )
            / det[:, None]
        )
        far = np.linalg.norm(step, axis=1, keepdims=True)
        view = view + np.nan_to_num(step * np.minimum(1, FARTHEST_STEP_PX / np.maximum(far, 1e-9)))
    is_there = np.abs(lands(view) - target).max(axis=1) < LANDED_PX
    return np.where(is_there[:, None], view, np.nan)


def _sums(a_rig, view, nodes, along):
    powers = np.linalg.inv(np.vander(nodes, increasing=True))
    t = (np.arange(along) + 0.5) / along
    k = np.arange(NODES)
    value = t[:, None] ** k @ powers
    slope = k * t[:, None] ** np.maximum(k - 1, 0) @ powers
    place, by_x, by_y = (
        np.einsum("ai,bj,pijc->pabc", down, across, view, optimize=True)
        for down, across in ((value, value), (value, slope), (slope, value))
    )
    area = np.abs(by_x[..., 0] * by_y[..., 1] - by_x[..., 1] * by_y[..., 0])

    image = a_rig.picture.image[..., 0].astype(float)
    height, width = image.shape
    matrix = flat_mapping(a_rig.picture_place, a_rig.viewer).matrix
    seen = place @ matrix[:, :2].T + matrix[:, 2]
    u, v = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    is_within = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    colour = _between(image, u * width - 0.5, (1 - v) * height - 0.5) * is_within
    whole = area.sum(axis=(1, 2))
    return (colour * area).sum(axis=(1, 2)) / whole, (is_within * area).sum(axis=(1, 2)) / whole


def _between(image, x, y):
    """An image between its pixels, whose middles are at whole numbers."""
    height, width = image.shape
    x, y = np.nan_to_num(x), np.nan_to_num(y)
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    column, row = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    s, t = x - column, y - row
    upper, lower = ((1 - s) * image[r, column] + s * image[r, column + 1] for r in (row, row + 1))
    return (1 - t) * upper + t * lower
