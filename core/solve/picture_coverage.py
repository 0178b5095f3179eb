"""Coverage of the picture, the reasons for the rest, and the reason for a dark display."""

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
from ..light.rays import BY_GAPS, REASON_WORDS, Reason
from ..map.view_map import ViewMap
from ..rig.joined_display import sections_of
from ..rig.rig import PicturePlace, Rig
from ..rig.viewer import Viewer
from .channel import Channel, Traced

UNSEEN_PX2 = 1e-6  # viewer px^2: a smaller picture is seen edge-on or not at all
TOO_FINE = Message("finer than a viewer pixel")

LEAST_LIGHT = 1e-12  # fraction of the picture

PIXELS_AT_ONCE = 1 << 18
POINTS_AT_ONCE = 1 << 19
APART_PX = 16  # distance of the viewer pixels that are tried first


def of_the_picture(
    picture: PicturePlace, viewer: Viewer, view_map: ViewMap, view_coverage: Floats
) -> Steps[tuple[float, dict[str, float]]]:
    """Fraction of the picture, as a viewer sees it, that is covered, and the rest by reason; sums
    to 1.

    The missing part of a pixel is attributed to the reasons of the rays at its corners and inside.
    If all of these have landed, it lies beyond the display's edge if one cell maps the pixel,
    otherwise between branches finer than a pixel.
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
        # Each ray of a pixel has one vote for the reason.
        votes = within[:, first * w + some].astype(np.int64)
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            votes[view_map.reason[row + down, column + right], np.arange(len(some))] += 1
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


def of_displays(channel: Channel) -> Steps[tuple[float, ...]]:
    """Fraction of the picture, as a viewer sees it, on each of the rig's displays and screens."""
    rig, viewer = channel.plan.rig, channel.viewer
    cover = cover_in_view(rig.place_of(viewer), viewer).ravel()
    tops = [one.top for one in sections_of(rig.lit)]
    shown = np.zeros(len(tops))
    for shares in channel.shares.pausing():
        yield 0
        if shares is not None:
            row = shares.display_index // shares.display_size[0]
            number = np.searchsorted(tops, row, side="right") - 1
            shown += np.bincount(number, shares.area * cover[shares.view_index], len(tops))
    return tuple(float(part) for part in np.minimum(shown / cover.sum(), 1.0))


def check_seen(picture: PicturePlace, viewer: Viewer) -> None:
    """Raise RigError if a viewer would not see the picture even without glass."""
    if not is_in_view(picture, viewer):
        raise _unseen(picture, viewer)


def _unseen(picture: PicturePlace, viewer: Viewer) -> RigError:
    return RigError(
        "The viewer '{viewer}' does not see the picture '{picture}', {why}.",
        viewer=viewer.name,
        picture=picture.name,
        why=why_unseen(picture, viewer),
    )


def is_in_view(picture: PicturePlace, viewer: Viewer) -> bool:
    """Whether a viewer would see the picture without glass."""
    if picture.mesh is not None and _fills_a_pixel(picture, viewer):
        return True
    return float(cover_in_view(picture, viewer).sum()) >= UNSEEN_PX2


def _fills_a_pixel(picture: PicturePlace, viewer: Viewer) -> bool:
    """Whether a picture fills any of some spread viewer pixels; a quick test that most pictures
    pass.
    """
    x, y = (np.arange(n // 2 % APART_PX, n, APART_PX) for n in (viewer.width, viewer.height))
    middles = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2) + 0.5
    return bool((picture_from_view(picture, viewer, middles, of_square(1.0)).cover == 1).any())


def _shown(picture: PicturePlace, viewer: Viewer, cover_of_view: Floats) -> float:
    """Area of the picture in the viewer's image, px^2; RigError if there is none."""
    shown = float(cover_of_view.sum())
    if shown < UNSEEN_PX2:
        raise _unseen(picture, viewer)
    return shown


def _reasons_within(view_map: ViewMap) -> Steps[NDArray[np.uint16]]:
    """Number of rays inside each viewer pixel, edges excluded, by reason: (reasons, pixels)."""
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


MOST_LEAKED = 0.5  # fraction of the light through gaps that explains a dark display

REMEDIES = {
    Reason.MISSED_GLASS: Message("no ray from the viewer hits the glass: aim the viewer at it"),
    Reason.LOST_INSIDE: Message(
        "every ray is lost inside the glass: check it for intersecting faces"
    ),
    Reason.MISSED_PLATE: Message(
        "no ray reaches the {part}: move or enlarge it", part=Message("plate")
    ),
    Reason.BLOCKED: Message(
        "every ray is blocked: move the blockers, or turn the display's front to the rig"
    ),
    Reason.MISSED_DISPLAY: Message(
        "no ray reaches the {part}: move or enlarge it", part=Message("display")
    ),
    Reason.CUT_OFF: Message(
        "every ray meets more surfaces than Max Events allows: raise it, or simplify the glass"
    ),
    Reason.OUTSIDE_CONE: Message(
        "every ray is outside the cone of its views: turn it to the viewer, or widen its cone"
    ),
}


def why_dark(traced: Traced, leaks: Sequence[float]) -> RigError:
    """Error that explains why no ray of a viewer arrives; a black source image is never intended.

    Raises RigError if the viewer looks at the glass but not at the picture: then no part blocks
    light.

    leaks : for each glass the fraction, 0..1, of the picture's light through its gaps
    """
    leaked = max(leaks, default=0.0)
    if leaked > MOST_LEAKED:
        glass = traced.plan.rig.glasses[leaks.index(leaked)]
        return RigError(
            "The display stays dark: {share} of the picture's light leaks through gaps in"
            " '{glass}'. Close them.",
            share=percent(leaked),
            glass=glass.name,
        )

    counts = np.bincount(traced.view_map.reason.ravel(), minlength=len(Reason))
    counts[Reason.ARRIVED] = 0
    beyond_glass = [r for r in Reason if r > Reason.MISSED_GLASS and counts[r]]
    reason = max(beyond_glass, key=lambda r: counts[r]) if beyond_glass else Reason.MISSED_GLASS

    rig, viewer = traced.plan.rig, traced.plan.viewer
    remedy = REMEDIES[reason]
    if beyond_glass:
        check_seen(rig.place_of(viewer), viewer)
    else:
        remedy = _too_small(rig, viewer) or remedy

    return RigError("The display stays dark: {remedy}.", remedy=remedy)


def _too_small(rig: Rig, viewer: Viewer) -> Message | None:
    """Remedy if all glass in the viewer's image is narrower than a pixel."""
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
            "'{glass}' is narrower than one pixel of the viewer '{viewer}': enlarge the glass, or"
            " raise the viewer's resolution",
            viewer=viewer.name,
            glass=glass.name,
        )
    return small


def but_leaked(
    coverage: float, misses: dict[str, float], leaked: dict[Reason, float]
) -> tuple[float, dict[str, float]]:
    """Coverage and misses with light through gaps under its own reason.

    Such light may be painted, but its real path is unknown.
    """
    lost = {REASON_WORDS[r]: share for r, share in leaked.items() if r != Reason.ARRIVED}
    gone = {word: min(share, lost.get(word, 0.0)) for word, share in misses.items()}
    arrived = min(leaked[Reason.ARRIVED], coverage)
    left = {word: share - gone[word] for word, share in misses.items() if share > gone[word]}
    return coverage - arrived, {**left, BY_GAPS: arrived + sum(gone.values())}
