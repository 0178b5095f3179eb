"""How legible a picture is through the glass: a card of squares as it is seen, beside the ideal.

The card takes the place of the picture, so that the number does not depend on what that shows. It
is solved for a viewer of few pixels, which takes a fraction of a solve, so that it is known before
time is spent. See docs/legibility.md.
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
VIEWER_PX = 64  # of the viewer's longer side
READABLE = 0.7  # a picture of less is hard to recognise


def card() -> Floats:
    """A picture (h, w, 4) float32, linear RGBA: squares that are black or white by chance."""
    squares = np.random.default_rng(0).permutation(SQUARES**2) % 2
    light = np.kron(squares.reshape(SQUARES, SQUARES), np.ones((SQUARE_PX, SQUARE_PX)))
    return np.stack([light, light, light, np.ones_like(light)], axis=2).astype(np.float32)


def illegible(found: float) -> Message:
    """The sentence on a picture of less legibility than READABLE."""
    return Message("The picture is hard to recognise: legibility {share}.", share=percent(found))


def likeness(seen: Floats, ideal: Floats, weight: Floats) -> float:
    """The correlation of two images (h, w), 0..1, weighed (h, w): 1 if they differ by brightness
    and contrast alone, 0 if they have nothing in common.
    """
    if not weight.sum():
        return 0.0
    a, b = (image - np.average(image, weights=weight) for image in (seen, ideal))
    power = np.average(a**2, weights=weight) * np.average(b**2, weights=weight)
    return float(max(np.average(a * b, weights=weight) / power**0.5, 0.0)) if power else 0.0


def legibility(solution: Solution) -> float:
    """How like the ideal image the first viewer's is, 0..1, where the display is seen within the
    picture's outline. Light that is lost is told by the picture's coverage.
    """
    channel = solution.first
    seen, ideal = (image.mean(axis=2, dtype=float) for image in (solution.seen(), solution.ideal()))
    cover = cover_in_view(solution.rig.place_of(channel.viewer), channel.viewer)
    return likeness(seen, ideal, cover * channel.view_coverage)


def card_legibility(
    rig: Rig, settings: Settings, kept: MeshCache | None = None
) -> Generator[float, None, float]:
    """The legibility of a card in the place of a rig's picture, seen by its first viewer; yields
    progress 0..1. 0 if nothing is seen.

    kept : glass that is made ready
    """
    of_card = replace(rig, viewers=rig.viewers[:1], pictures=(rig.picture_place.showing(card()),))
    try:
        return legibility((yield from Session(kept).solve(*coarser(of_card, settings, VIEWER_PX))))
    except RigError:
        return 0.0
