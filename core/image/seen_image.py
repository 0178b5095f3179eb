"""Simulates the seen image of a source image, and compares it with the ideal image."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.steps import Steps
from ..map.pieces import UNIT_SQUARE, Piece
from ..map.shares import ShareBatches, add_at
from ..rig.rig import Picture, Viewer
from .flat_picture import outline_in_view
from .outline import cut_along_outline
from .picture import POINTS_AT_ONCE
from .pyramid import Pyramid
from .source_image import Painting, find_filter_taps

UNCUT = 2  # squares along an ideal pixel's side, if the picture's outline does not cut them


@dataclass(frozen=True)
class DotOptions:
    """Options for finding the dots of a lattice in an image.

    Parameters
    ----------
    dark : fraction of the brightest red; a darker pixel is background
    compact : ratio of a dot's rms radius to that of a disc of its area, above which it is in
        several pieces
    least_square : px^2; lower limit of a dot's mean square radius
    heap : cell size, in radii of its disc, for locating the largest piece
    near : radius of a piece around its centre, in cells
    most_rounds : of separating pieces
    """

    dark: float = 0.02
    compact: float = 1.3
    least_square: float = 0.25
    heap: float = 1.5
    near: float = 1.5
    most_rounds: int = 20


DOTS = DotOptions()


def seeing(batches: ShareBatches, source: NDArray[np.float32]) -> Steps[NDArray[np.float32]]:
    """The seen image (h, w, 3) of a source image (H, W, 3): the transposed product with the shares.

    Pauses while shares are made, and after each batch.
    """
    width, height = batches.view_size
    n_channels = source.shape[2]
    seen = np.zeros((n_channels, height, width))
    for shares in batches.pausing():
        yield 0
        if shares is None:
            continue
        weight = shares.area if shares.throughput is None else shares.area * shares.throughput
        shown = source.reshape(-1, n_channels)[shares.display_index]
        pixel = shares.view_index
        for channel in range(n_channels):
            add_at(seen[channel], pixel, weight * shown[:, channel])
    return np.ascontiguousarray(seen.transpose(1, 2, 0), np.float32)


def ideal_image(picture: Picture, viewer: Viewer) -> NDArray[np.float32]:
    """The picture seen by the viewer without glass: (h, w, 3) linear.

    It is painted like a source image, on a display that is the viewer's own image.
    """
    size = viewer.width, viewer.height
    is_cut = outline_in_view(picture.place, viewer) is not None
    pieces = cut_along_outline(_squares(size, 1 if is_cut else UNCUT), picture.place, viewer)
    batches = ShareBatches(
        size, size, False, lambda: ((piece.view, piece.display, None, None) for piece in pieces)
    )
    painting, pyramid = Painting(size), Pyramid(picture.image)
    for shares in batches:
        painting.add(pyramid, find_filter_taps(picture.place, viewer, shares))
    return painting.finished(np.ones(size[::-1]))


def _squares(size: tuple[int, int], n_along: int) -> Iterator[Piece]:
    """Squares of a view, n along a pixel's side, with themselves as images."""
    width, height = (n_along * n for n in size)
    for first in range(0, width * height, POINTS_AT_ONCE):
        number = np.arange(first, min(first + POINTS_AT_ONCE, width * height))
        corner = np.stack([number % width, number // width], axis=1)
        view = (corner[:, None] + UNIT_SQUARE) / n_along
        n = len(number)
        yield Piece(view, view.copy(), np.ones(n), np.zeros(n, np.uint64))


@dataclass(frozen=True, eq=False)
class LatticeShift:
    """Displacement of the dots of a lattice from the ideal image.

    shift : (n, n, 2) viewer px, NaN for a dot not seen
    mean : its mean length
    mean_xy : means of |dx|, |dy|
    """

    shift: Floats

    @property
    def is_seen(self) -> np.ndarray:
        return np.isfinite(self.shift[..., 0])

    @property
    def n_seen(self) -> int:
        return int(self.is_seen.sum())

    @property
    def mean(self) -> float:
        return float(self._lengths().mean()) if self.n_seen else float("nan")

    @property
    def largest(self) -> float:
        return float(self._lengths().max()) if self.n_seen else float("nan")

    @property
    def mean_xy(self) -> tuple[float, float]:
        if not self.n_seen:
            return float("nan"), float("nan")
        dx, dy = np.abs(self.shift[self.is_seen]).mean(axis=0)
        return float(dx), float(dy)

    def _lengths(self) -> Floats:
        """Displacement, viewer px, of each dot (m,) seen."""
        return np.linalg.norm(self.shift[self.is_seen], axis=-1)


def lattice_shift(seen: Floats, ideal: Floats, n: int = 7) -> LatticeShift:
    """Displacement of each dot of an n x n colour-coded lattice between two images (h, w, >= 3) of
    one size, linear.
    """
    return LatticeShift(dot_centroids(seen, n) - dot_centroids(ideal, n))


def dot_centroids(image: Floats, n: int = 7) -> Floats:
    """Centroids (n, n, 2) in pixels of the dots of a lattice; entry [j, i] is column i, row j; NaN
    if not seen.

    Dots are identified by colour: dot (i, j) has G / R = (i + 1) / (n + 1), B / R = (j + 1) / (n +
    1). A pixel's weight is its R, linear on black. A dot in several pieces counts at its largest
    one.
    """
    red, green, blue = (np.asarray(image[..., c], float) for c in range(3))
    y, x = np.nonzero(red > DOTS.dark * max(red.max(), 1e-30))
    weight = red[y, x]

    i = np.rint(green[y, x] / weight * (n + 1)).astype(int) - 1
    j = np.rint(blue[y, x] / weight * (n + 1)).astype(int) - 1
    label = np.where((i >= 0) & (i < n) & (j >= 0) & (j < n), j * n + i, -1)

    centroids = np.full((n, n, 2), np.nan)
    for k in np.unique(label[label >= 0]):
        mine = label == k
        points = np.stack([x[mine], y[mine]], axis=1) + 0.5
        centroids[k // n, k % n] = _main_piece(points, weight[mine])
    return centroids


def _main_piece(points: Floats, weight: Floats) -> Floats:
    """Weighted centroid (2,) of points (m, 2), or of their largest piece."""
    for _ in range(DOTS.most_rounds):
        centre = np.average(points, axis=0, weights=weight)
        square = ((points - centre) ** 2).sum(axis=1)
        # mean square radius of a disc of this area
        disc = weight.sum() / weight.max() / (2 * np.pi)
        if np.average(square, weights=weight) <= DOTS.compact**2 * max(disc, DOTS.least_square):
            break

        # the heaviest cell of a grid
        side = np.sqrt(2 * disc) * DOTS.heap + 1
        cell = np.floor((points - points.min(axis=0)) / side).astype(int)
        name = cell[:, 1] * (cell[:, 0].max() + 1) + cell[:, 0]
        heaviest = np.argmax(np.bincount(name, weight))
        is_in = name == heaviest
        heart = np.average(points[is_in], axis=0, weights=weight[is_in])

        near = ((points - heart) ** 2).sum(axis=1) <= (DOTS.near * side) ** 2
        if near.all():
            break
        points = points[near]
        weight = weight[near]
    return centre
