"""Remarks on the light of a source image: too bright, too dark, or beside the glass."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..base.messages import Message
from ..base.words import percent
from ..image.glare import Glare
from ..light.plan import Plan
from ..rig.rig import Rig
from .remark import Remark, note

# of the light that the viewer gets: more that comes beside the glass is worth a remark
GLARE = 0.05
# linear: half a step of 8 bits, sRGB-encoded, above white
WHITE = ((1 + 0.5 / 255 + 0.055) / 1.055) ** 2.4


def on_white(rig: Rig, plan: Plan, light: NDArray[np.float32]) -> Iterator[Remark]:
    """A remark on light that no display has, the picture's brightness among the remedies."""
    source = rig.display.source_for(light)
    if source.max() <= WHITE:
        return
    # rows of three are slow
    brightest = np.maximum(np.maximum(source[..., 0], source[..., 1]), source[..., 2])
    bright = np.count_nonzero(brightest > WHITE) / max(np.count_nonzero(brightest > 0), 1)
    if not bright:
        return

    remedy = Message("lower the Picture Brightness of '{picture}'", picture=rig.picture.name)
    if plan.settings.brightness:
        remedy = Message("turn Brightness off, {remedy}", remedy=remedy)
    yield note(
        "{share} of the source image is brighter than a display's white and would be clipped:"
        " {remedy}, or export OpenEXR, which keeps it.",
        share=percent(bright),
        remedy=remedy,
    )


def on_black(rig: Rig, light: NDArray[np.float32]) -> Iterator[Remark]:
    """A remark on darkness that this display does not have."""
    black_level = rig.display.black_level
    if not black_level:
        return

    # where nothing is wanted, as around the picture, nobody can do anything about it
    brightest = light.max(axis=2)
    n_wanted = np.count_nonzero(brightest > 0)
    n_dark = np.count_nonzero((brightest > 0) & (brightest < black_level))
    if n_dark:
        yield note(
            "{share} of the source image is wanted darker than the black of '{display}', which"
            " shines {black_level} of its white: it stays that bright. Raise the Picture"
            " Brightness of '{picture}', or take a display of less Black Level.",
            share=percent(n_dark / n_wanted),
            display=rig.display.name,
            black_level=percent(black_level),
            picture=rig.picture.name,
        )


def on_glare(plan: Plan, glare: Glare | None) -> Iterator[Remark]:
    """A remark on light that comes beside the glass."""
    if glare is None or glare.share < GLARE:
        return

    part = Message("plate") if plan.needs_plate else Message("display")
    remedy = (
        Message("cover the part of the {part} that is seen there", part=part)
        if plan.settings.suppress_glare == 1
        else Message(
            "raise Suppress Glare, or cover the part of the {part} that is seen there", part=part
        )
    )

    yield note(
        "Glare: {share} of the light that the viewer gets comes beside the glass, {where}:"
        " {remedy}.",
        share=percent(glare.share),
        where=glare.where,
        remedy=remedy,
    )
