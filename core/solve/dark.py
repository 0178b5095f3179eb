"""The display stays dark: which fault keeps all light from it, and what helps."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ..base.errors import RigError
from ..base.messages import Message
from ..base.words import percent
from ..light.rays import Reason
from ..rig.rig import Rig
from ..rig.viewer import Viewer
from .channel import Traced
from .picture_coverage import check_seen

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
