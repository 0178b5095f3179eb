"""Figures of a display with views, and remarks on them: light outside the cone, cross-talk between
viewers, and the disparity of neighbouring views.

*Cross-talk* is the part of a viewer's light whose pixels other viewers need, too: each share of
light counts by the others' part of its pixel's weight. A point of the picture off the display moves
on the display from one view to the next, by its *disparity*. Lens sheets blend neighbouring views,
so it is seen double if this is too large. "Roughly 4-5 px is the practical ceiling; beyond ~8 px
expect visible ghosting" (E. G. Suchanek, quiltwright 0.16, documentation of `view_disparity`,
2026).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from ..base.messages import Message, joined
from ..base.numbers import number
from ..base.words import percent
from ..image.flat_picture import flat_mapping, view_of_picture
from ..light.beams import beams
from ..light.rays import REASON_WORDS, Reason, main_landings
from ..light.trace import trace_all
from .accuracy import LEAST_LOST
from .channel import Channel
from .solution import Remark, note, warning

# A change of 1 % is visible, and 5.8 % is perceptible but not annoying (Investigation of crosstalk
# in a 2-view 3D display, SID Symposium Digest, paper 73.4).
MOST_CROSSTALK = 0.05
SOFT_PX, GHOSTS_PX = 5.0, 8.0  # source above
POINTS = (np.stack(np.meshgrid(*2 * [np.arange(5)]), axis=-1).reshape(-1, 2) + 0.5) / 5
STEP = 1e-3  # of the viewer's distance from the picture, between two places of a viewer


@dataclass(frozen=True)
class ViewFigures:
    """Figures of a viewer of a display with views.

    outside : part of the picture, as seen, whose light is outside the cone
    crosstalk : part of the light in pixels that other viewers need
    disparity : display px, largest among points of the picture; None if none was found
    """

    viewer: str
    outside: float
    crosstalk: float
    disparity: float | None


def view_figures(channels: Sequence[Channel]) -> tuple[ViewFigures, ...]:
    """Figures of each channel; none for a display without views."""
    if channels[0].plan.rig.display.views is None:
        return ()
    weights = [one.viewer.weighed(one.coverage.weight) for one in channels]
    total = reduce(np.add, weights)
    divisor = np.where(total > 0, total, 1.0)
    return tuple(
        ViewFigures(
            channel.viewer.name,
            channel.misses.get(REASON_WORDS[Reason.OUTSIDE_CONE], 0.0),
            float(1 - (own * own / divisor).sum() / max(own.sum(), 1e-300)),
            disparity(channel),
        )
        for channel, own in zip(channels, weights, strict=True)
    )


def disparity(channel: Channel) -> float | None:
    """Largest movement of points of the picture on the display from one view to the next, px; None
    if no point is seen.

    With the derivatives L of a landing and B of its beam by the viewer's place, right and up, the
    beam on an axis of views changes by 1 for the shortest move s = b / |b|^2, where b is the row of
    B: the point moves by L s.
    """
    viewer, place = channel.viewer, channel.plan.rig.picture_place
    views = channel.plan.rig.display.views
    if place.mesh is None or flat_mapping(place, viewer) is None:
        return None
    step = STEP * np.linalg.norm(place.mesh.bounds.mean(axis=0) - viewer.position)
    by_place, is_same = [], np.ones(len(POINTS), bool)
    for axis in viewer.axes[:2]:
        found = []
        for side in (-0.5, 0.5):
            moved = replace(viewer, position=viewer.position + side * step * axis)
            straight = view_of_picture(place, moved, POINTS)
            landings = main_landings(trace_all(channel.plan, *moved.rays(straight)), len(straight))
            at = np.concatenate([landings.xy, beams(channel.plan, landings)], axis=1)
            found.append((at, landings.branch))
        (at, branch), (other_at, other_branch) = found
        by_place.append((other_at - at) / step)
        is_same &= (branch == other_branch) & (branch != 0)
    derivatives = np.stack(by_place, axis=2)[is_same]
    of_xy, of_beam = derivatives[:, :2], derivatives[:, 2:]
    moved = []
    for k, n in enumerate((views.columns, views.rows)):
        if n > 1:
            move = of_beam[:, k] / (of_beam[:, k] ** 2).sum(axis=1, keepdims=True)
            moved.append(np.linalg.norm(np.einsum("nij,nj->ni", of_xy, move), axis=1))
    return float(np.max(moved)) if moved and len(derivatives) else None


def remarks_on_views(channels: Sequence[Channel]) -> Iterator[Remark]:
    """Remarks on a display with views; none for any other."""
    figures = view_figures(channels)
    for one in figures:
        if one.outside > LEAST_LOST:
            yield warning(
                "'{viewer}' loses {share} of the picture outside the cone of the views: widen the"
                " cone, or turn the display to the light.",
                viewer=one.viewer,
                share=percent(one.outside),
            )
    if len(figures) > 1:
        worst = max(figures, key=lambda one: one.crosstalk)
        clauses = [
            Message("'{name}' {share}", name=one.viewer, share=percent(one.crosstalk))
            for one in figures
        ]
        yield note("Cross-talk by viewer: {shares}.", shares=joined(clauses, ", "))
        if worst.crosstalk > MOST_CROSSTALK:
            yield warning(
                "'{viewer}' shares {share} of its light with other viewers: use more views, less"
                " Overlap, or viewers further apart.",
                viewer=worst.viewer,
                share=percent(worst.crosstalk),
            )
    largest = max((one.disparity for one in figures if one.disparity is not None), default=0.0)
    if largest > SOFT_PX:
        text = Message(
            "The picture moves by up to {n} display pixels from one view to the next, so it may"
            " look doubled: use more views, a narrower cone, or a display nearer to the picture.",
            n=number(largest),
        )
        yield Remark(text, is_warning=largest > GHOSTS_PX)
