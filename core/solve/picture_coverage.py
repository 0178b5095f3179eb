"""How much of the picture is seen, why the rest is not, and why the display stays dark."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.messages import Message
from ..base.steps import Steps
from ..base.words import percent
from ..image.picture import cover_in_view, of_square, picture_from_view, why_unseen
from ..light.rays import REASON_WORDS, Reason
from ..map.view_map import ViewMap
from ..rig.rig import PicturePlace, Rig
from ..rig.viewer import Viewer
from .channel import Traced

UNSEEN_PX2 = 1e-6  # viewer px^2: a picture that covers less is seen edge-on or not at all
TOO_FINE = Message("finer than a viewer pixel")

LEAST_LIGHT = 1e-12  # of the picture: less is no light

PIXELS_AT_ONCE = 1 << 18
POINTS_AT_ONCE = 1 << 19
APART_PX = 16  # of viewer pixels that are looked at first


def of_the_picture(
    picture: PicturePlace, viewer: Viewer, view_map: ViewMap, view_coverage: Floats
) -> Steps[tuple[float, dict[str, float]]]:
    """Share of the picture, as a viewer sees it, that is covered,
    and shares of it by reason of the misses: 1 in all. Pauses on the way.

    The part missing in a pixel is put down to the reasons of the rays at its corners and within.
    Where all these have landed, it is beyond the display's edge, if one cell maps the pixel; else
    between branches finer than a pixel.
    """
    w, h = view_map.view_size
    unseen = 0.0
    lost = np.zeros(len(Reason))
    within = yield from _reasons_within(view_map)
    cover_of_view = cover_in_view(picture, viewer)
    shown = _shown(picture, viewer, cover_of_view)

    rows = max(1, PIXELS_AT_ONCE // w)
    for first in range(0, h, rows):
        cover = cover_of_view[first : first + rows].ravel()
        missing = np.clip(cover - view_coverage[first : first + rows].ravel(), 0, 1)
        unseen += missing.sum()
        some = np.flatnonzero(missing)
        row, column = np.divmod(first * w + some, w)
        by_corner = np.stack([
            view_map.reason[row + down, column + right] for down in (0, 1) for right in (0, 1)
        ])  # fmt: skip

        # each ray of a pixel has a vote on the reason for what is missing in it
        of_reason = by_corner[None] == np.arange(len(Reason))[:, None, None]
        votes = of_reason.sum(axis=1) + within[:, first * w + some]
        votes[Reason.ARRIVED] = 0
        at_edge = view_map.is_one_cell[first : first + rows].ravel()[some] & (
            votes.sum(axis=0) == 0
        )
        votes[Reason.MISSED_DISPLAY, at_edge] = 1
        lost += (missing[some] * votes / np.maximum(votes.sum(axis=0), 1)).sum(axis=1)
        yield 0

    misses = {
        REASON_WORDS[reason]: float(lost[reason] / shown) for reason in Reason if lost[reason] > 0
    }
    between = float((unseen - lost.sum()) / shown)
    if between > LEAST_LIGHT:
        misses[TOO_FINE] = between

    return float(1 - unseen / shown), misses


def check_seen(picture: PicturePlace, viewer: Viewer) -> None:
    """Raise RigError where a viewer sees nothing of a picture even with no glass in the way."""
    if picture.mesh is not None and _fills_a_pixel(picture, viewer):
        return
    _shown(picture, viewer, cover_in_view(picture, viewer))


def _fills_a_pixel(picture: PicturePlace, viewer: Viewer) -> bool:
    """Does a picture fill one of some viewer pixels? Most do: then not all need be looked at."""
    x, y = (np.arange(n // 2 % APART_PX, n, APART_PX) for n in (viewer.width, viewer.height))
    middles = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2) + 0.5
    return bool((picture_from_view(picture, viewer, middles, of_square(1.0)).cover == 1).any())


def _shown(picture: PicturePlace, viewer: Viewer, cover_of_view: Floats) -> float:
    """Viewer px^2 of the picture, by how much of each pixel shows it; RigError where it is none."""
    shown = float(cover_of_view.sum())
    if shown < UNSEEN_PX2:
        raise RigError(
            "The viewer '{viewer}' does not see the picture '{picture}', {why}.",
            viewer=viewer.name,
            picture=picture.name,
            why=why_unseen(picture, viewer),
        )
    return shown


def _reasons_within(view_map: ViewMap) -> Steps[NDArray[np.uint16]]:
    """How many rays within each viewer pixel, not on its
    edges, ended for each reason: (reasons, pixels).
    """
    w, h = view_map.view_size
    points = view_map.points
    counts = np.zeros((len(Reason), w * h), np.uint16)
    for first in range(0, len(points), POINTS_AT_ONCE):
        some = slice(first, first + POINTS_AT_ONCE)
        view = points.view[some]
        column, row = np.floor(view).astype(np.int64).T
        is_within = (view != np.floor(view)).all(axis=1) & (column < w) & (row < h)
        reason = points.reason[some][is_within]
        pixel = row[is_within] * w + column[is_within]
        np.add.at(counts.reshape(-1), reason.astype(np.int64) * w * h + pixel, np.uint16(1))
        yield 0
    return counts


MOST_LEAKED = 0.5  # share of the light: where more goes through gaps these are why all is dark

REMEDIES = {
    Reason.MISSED_GLASS: Message("no ray from the viewer meets the glass: turn the viewer to it"),
    Reason.LOST_INSIDE: Message(
        "every ray is lost inside the glass: look for faces that cut each other"
    ),
    Reason.MISSED_PLATE: Message("no ray reaches the plate: move or enlarge it"),
    Reason.BLOCKED: Message(
        "every ray is blocked: move the blockers, or turn the front of the display to the plate"
    ),
    Reason.MISSED_DISPLAY: Message("no ray reaches the display: move or enlarge it"),
    Reason.CUT_OFF: Message(
        "every ray meets more surfaces than Max Events allows: raise it, or change the glass"
    ),
}
# where light goes straight from the glass to the display
STRAIGHT = {
    Reason.BLOCKED: Message(
        "every ray is blocked: move the blockers, or turn the front of the display to the glass"
    ),
}


def why_dark(traced: Traced, leaks: Sequence[float]) -> RigError:
    """The reason why no ray of a viewer arrives: nobody means a black source image.

    Raises RigError where a viewer that looks at the glass does not see the picture: then no part
    keeps light away.

    leaks : for each glass the share, 0..1, of the picture's light that goes through its gaps
    """
    leaked = max(leaks)
    if leaked > MOST_LEAKED:
        glass = traced.plan.rig.glasses[leaks.index(leaked)]
        return RigError(
            "The display stays dark: {share} of the picture's light goes through gaps in"
            " the glass '{glass}': close them.",
            share=percent(leaked),
            glass=glass.name,
        )

    counts = np.bincount(traced.view_map.reason.ravel(), minlength=len(Reason))
    counts[Reason.ARRIVED] = 0
    beyond_glass = [r for r in Reason if r > Reason.MISSED_GLASS and counts[r]]
    reason = max(beyond_glass, key=lambda r: counts[r]) if beyond_glass else Reason.MISSED_GLASS

    rig, viewer = traced.plan.rig, traced.plan.viewer
    remedies = REMEDIES if traced.plan.needs_plate else REMEDIES | STRAIGHT
    remedy = remedies[reason]
    if beyond_glass:
        check_seen(rig.place_of(viewer), viewer)
    else:
        remedy = _too_small(rig, viewer) or remedy

    return RigError("The display stays dark: {remedy}.", remedy=remedy)


def _too_small(rig: Rig, viewer: Viewer) -> Message | None:
    """Is all glass in the viewer's image so narrow that rays pass it by?"""
    size = (viewer.width, viewer.height)
    small = None
    for glass in rig.glasses:
        corners = viewer.project(list(product(*glass.mesh.bounds.T)))
        middle, extent = corners.mean(axis=0), np.ptp(corners, axis=0)
        if not ((middle >= 0) & (middle <= size)).all():
            continue
        if (extent >= 1).all():
            return None
        small = small or Message(
            "the viewer '{viewer}' sees the glass '{glass}' narrower than one of its pixels: make"
            " the glass larger, or raise the viewer's resolution",
            viewer=viewer.name,
            glass=glass.name,
        )
    return small
