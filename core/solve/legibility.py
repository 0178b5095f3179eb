"""Legibility of a picture through the glass: correlation of a test card, as seen, with the ideal.

The card replaces the picture, so that the figure does not depend on its content. It is solved for
few viewer pixels, in a fraction of a solve, and is available before one. See docs/legibility.md.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.messages import Message
from ..base.words import percent
from ..image.picture import cover_in_view
from ..light.mesh_cache import MeshCache
from ..rig.rig import Rig
from ..rig.settings import Settings
from .first_picture import coarser
from .session import Session
from .solution import Solution

SQUARES = 16  # of the card, each way
SQUARE_PX = 16  # of the card's image
VIEWER_PX = 64  # longer side of the viewer
READABLE = 0.7  # below this a picture is hard to recognise


def card() -> Floats:
    """The test card (h, w, 4) float32, linear RGBA: random black and white squares."""
    squares = np.random.default_rng(0).permutation(SQUARES**2) % 2
    light = np.kron(squares.reshape(SQUARES, SQUARES), np.ones((SQUARE_PX, SQUARE_PX)))
    return np.stack([light, light, light, np.ones_like(light)], axis=2).astype(np.float32)


def illegible(found: float) -> Message:
    """Warning for a legibility below READABLE."""
    return Message("The picture is hard to recognise: legibility {share}.", share=percent(found))


def likeness(seen: Floats, ideal: Floats, weight: Floats) -> float:
    """Weighted correlation of two images (h, w), 0..1.

    It is 1 if they differ in brightness and contrast only, 0 if they are unrelated.
    """
    if not weight.sum():
        return 0.0
    a, b = (image - np.average(image, weights=weight) for image in (seen, ideal))
    power = np.average(a**2, weights=weight) * np.average(b**2, weights=weight)
    return float(max(np.average(a * b, weights=weight) / power**0.5, 0.0)) if power else 0.0


def legibility(solution: Solution) -> float:
    """Likeness of the first viewer's image to the ideal one, 0..1, within the part that arrives.

    The picture's coverage reports lost light.
    """
    channel = solution.first
    seen, ideal = (image.mean(axis=2, dtype=float) for image in (solution.seen(), solution.ideal()))
    cover = cover_in_view(solution.rig.place_of(channel.viewer), channel.viewer)
    return likeness(seen, ideal, cover * channel.view_coverage)


def card_legibility(
    rig: Rig, settings: Settings, cache: MeshCache | None = None
) -> Generator[float, None, float]:
    """Legibility of the test card in a rig's picture, for the first viewer; 0 if nothing is seen.

    Yields progress 0..1.

    cache : cache of prepared glass
    """
    of_card = replace(rig, viewers=rig.viewers[:1], pictures=(rig.picture_place.showing(card()),))
    coarse = coarser(of_card, replace(settings, sharpen=False), VIEWER_PX)
    try:
        return legibility((yield from Session(cache).solve(*coarse)))
    except RigError:
        return 0.0
