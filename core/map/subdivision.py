"""Into how many quads is a smooth cell cut?

A quad is bilinear, the cell biquartic: n parts a side leave an error that falls as 1 / n^2. A
display pixel takes one colour from each quad in it, so quads are also smaller than display pixels,
by the number of places. By the tolerance alone they were too large: a colour from one or two places
costs more in the source image than the whole map is off.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from . import interpolation
from .points import bounds_of


@dataclass(frozen=True)
class Subdivision:
    """How far smooth cells are cut into quads; tuned on the ball and on flat glass, by the error of
    the source image against the number of shares (docs/design.md, decision 5).

    of_tolerance : share of the tolerance by which quads may be off their smooth cell
    cheap_error_px : display px, so near they come to it, unless that takes quads smaller than
        viewer pixels
    n_places : along a display pixel that is larger than a viewer pixel: its colour is taken there
    n_places_few : along a smaller one
    one_place_tolerance_px : display px, from this tolerance on one place is enough along a smaller
        one, on curved glass: on the ball, at 0.1 px, two gain nothing for 15 % more time
    most_parts : along the side of a smooth cell
    """

    of_tolerance: float = 0.25
    cheap_error_px: float = 0.01
    n_places: int = 4
    n_places_few: float = 2.0
    one_place_tolerance_px: float = 0.2
    most_parts: int = 128


SUBDIVISION = Subdivision()


def n_parts(xy: Floats, size: Ints, is_inside: Bools, tolerance: float) -> Ints:
    """Into how many quads (c,) the sides of smooth cells are cut.

    Parameters
    ----------
    xy : (c, 25, 2) display px, of the nodes
    size : (c,) viewer px, side of the cells
    is_inside : (c,) whether a cell lies in both images, wholly
    tolerance : display px
    """
    knobs = SUBDIVISION

    # for the tolerance
    off = interpolation.sag(xy)
    parts, parts_cheap = (
        interpolation.parts_for(off, allowed, knobs.most_parts)
        for allowed in (knobs.of_tolerance * tolerance, knobs.cheap_error_px)
    )
    parts = np.maximum(parts, np.minimum(parts_cheap, size))

    # for the places; on flat glass, where one quad would keep
    # the tolerance, they alone keep the picture sharp
    low, high = bounds_of(xy)
    span = (high - low).max(axis=1)
    n_places = np.where(
        parts == 1,
        knobs.n_places_few,
        np.clip(knobs.one_place_tolerance_px / tolerance, 1.0, knobs.n_places_few),
    )
    pixels = np.clip(knobs.n_places * span, 1.0, size) / np.maximum(span / (n_places * size), 1.0)
    parts = np.maximum(parts, 2 ** np.log2(np.maximum(pixels, 1.0)).astype(np.int64))

    # a pixel each where the image folds or lies across the display's edge
    at_fold = interpolation.is_folded(xy)
    return np.where(is_inside & ~at_fold, parts, np.maximum(parts, size))
