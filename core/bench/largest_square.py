"""Largest square around a place whose rays all get through the glass.

A square of side s around a place p gets through if no ray closer to p than s / 2, along either
axis, is lost. The largest one therefore ends at the nearest lost ray, or where its light spreads
too far on the display.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats

N_PLACES = 17  # places of the first comparison, along the longer side; odd, to include the centre
ENOUGH = 0.999  # fraction of a picture's light that has to arrive
FARTHEST = 2.0  # widths of a picture: light landing farther out counts as lost
WORTH_MOVING = 0.1  # gain over the centre of the glass that is worth another place
ROUNDING = 1e-6  # of the step between rays: closer distances count as equal


@dataclass(frozen=True, eq=False)
class Bundle:
    """Light of a glass, traced on the plane through its centre; m from there along both axes.

    at : (n, 2) of the rays
    landed : (n, 2) on the display, from the image of the glass's centre
    is_good : (n,) whether light reaches the display through glass
    step : between rays
    half : (2,) of the glass's width and height as the viewer sees it
    enough : fraction of a square's rays that have to be good
    """

    at: Floats
    landed: Floats
    is_good: Bools
    step: float
    half: Floats
    enough: float = ENOUGH

    def largest(self, places: Floats, most: float) -> Floats:
        """Sides (m,) of the largest squares around places (m, 2) that get through, up to `most`."""
        found = np.zeros(len(places))
        order, distance = self._by_distance(places)
        is_bad = ~self.is_good[order]
        off = np.take_along_axis(_along_either(self.landed, places), order, axis=1)
        spread = np.maximum.accumulate(np.where(is_bad, 0.0, off), axis=1)
        n = np.arange(1, len(self.at) + 1)

        edge = (self.half - np.abs(places)).min(axis=1)
        is_whole = np.cumsum(is_bad, axis=1) <= (1 - self.enough) * n
        is_near = spread <= FARTHEST * distance
        is_within = distance <= np.minimum(edge, most / 2)[:, None] + self.step / 2
        is_ring = np.diff(distance, axis=1, append=np.inf) > self.step * ROUNDING
        fits = is_whole & is_near & is_within & is_ring

        some = fits.any(axis=1)
        last = len(n) - 1 - np.argmax(fits[:, ::-1], axis=1)
        found[some] = 2 * distance[some, last[some]] + self.step  # each ray represents its cell
        return np.minimum(found, np.minimum(2 * edge, most))

    def share(self, places: Floats, side: float) -> Floats:
        """Fractions (m,) of squares around places (m, 2) that get through."""
        near = _along_either(self.at, places) <= side / 2
        cells = max((side / self.step) ** 2, 1.0)
        return np.minimum(
            (near & self.is_good).sum(axis=1) / np.maximum(near.sum(axis=1), cells), 1
        )

    def _by_distance(self, places: Floats) -> tuple[Floats, Floats]:
        """Rays sorted by their distance from places (m, 2), and the distances: each (m, n)."""
        distance = _along_either(self.at, places)
        order = np.argsort(distance, axis=1)
        return order, np.take_along_axis(distance, order, axis=1)


def _along_either(points: Floats, places: Floats) -> Floats:
    """Chebyshev distance (m, n) of points (n, 2) from places (m, 2)."""
    # Axis by axis, because numpy is slow on rows of two.
    x, y = (np.abs(points[:, k] - places[:, k, None]) for k in (0, 1))
    return np.maximum(x, y)


def grid_over(half: Floats, n_along: int) -> tuple[Floats, float]:
    """Symmetric grid (n, 2) over a rectangle about 0, with a given count along its longer side.

    Returns the step between its places as well.
    """
    step = 2 * float(half.max()) / n_along
    counts = np.maximum(1, np.round(2 * half / step).astype(int))
    across, up = ((np.arange(n) - (n - 1) / 2) * step for n in counts)
    x, y = np.meshgrid(across, up)
    return np.stack([x.ravel(), y.ravel()], axis=1), step


def best_place(bundle: Bundle, most: float) -> tuple[Floats, float]:
    """Place (2,) of the largest square up to `most`, and its side."""
    return _refined(bundle, lambda places: bundle.largest(places, most))


def best_place_for(bundle: Bundle, side: float) -> Floats:
    """Place (2,) where most of a square of the given side gets through."""
    return _refined(bundle, lambda places: bundle.share(places, side), 1.0)[0]


def _refined(
    bundle: Bundle, value: Callable[[Floats], Floats], whole: float = 0.0
) -> tuple[Floats, float]:
    """Place (2,) with the largest value, and the value.

    whole : scale of the values; 0 for the best one
    """
    places, step = grid_over(bundle.half, N_PLACES)
    centre = np.zeros(2)
    best = centre
    for _ in range(3):
        values = value(places)
        top = places[values >= values.max() * (1 - 1e-9)]
        # Of equally good places take the central one.
        best = top[np.linalg.norm(top - top.mean(axis=0), axis=1).argmin()]
        around = np.stack(np.meshgrid(*[np.linspace(-step, step, 7)] * 2), axis=-1)
        places = best + around.reshape(-1, 2)
        step /= 3

    # Prefer the centre of the glass, along both axes or one, if it is about as good.
    x, y = best
    candidates = np.array([[0, 0], [0, y], [x, 0], [x, y]])
    values = value(candidates)
    good = values >= values.max() - WORTH_MOVING * (whole or values.max())
    first = int(good.argmax())
    return candidates[first], float(values[first])


def largest_about(
    middle: Floats, uv: Floats, is_lost: Bools, weight: Floats, share: float = ENOUGH
) -> float:
    """Side of the largest part of a picture about a place (2,) with enough arriving light.

    The side is relative to the picture's; places uv (n, 2) each represent a part of it (n,).
    """
    distance = 2 * np.abs(uv - middle).max(axis=1)
    order = np.argsort(distance)
    lost = np.cumsum(np.where(is_lost, weight, 0.0)[order])
    is_ring = np.diff(distance[order], append=np.inf) > ROUNDING * distance.max()
    fits = is_ring & (lost <= (1 - share) * np.cumsum(weight[order]))
    return float(distance[order[fits]].max(initial=0.0))
