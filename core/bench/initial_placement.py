"""Place and size of a picture inside its glass.

A grid of rays traces the light of the whole glass, as the viewer sees it, and places are compared
by the largest square that fits around them. The picture is then traced finely and reduced until
enough of its light arrives. Light near a silhouette gets through but spreads far: the picture ends
where its display would have to be twice as wide.

The centre of the glass is used unless another place is better by `worth_moving`, so that a ball's
picture is centred to the last bit.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..base.steps import subprogress
from ..light.optics import reflect
from ..light.plan import Plan
from ..rig.rig import Rig, Viewer
from .largest_square import (
    ENOUGH,
    WORTH_MOVING,
    Bundle,
    best_place,
    best_place_for,
    grid_over,
    largest_about,
)
from .picture_light import Light, Spread, light_of, points_of, spread_in
from .placement import REFERENCE_BENCH, Proposal, Wishes, rig_of

N_RAYS = 47  # rays along the glass's longer side, as the viewer sees it
LEAST, MOST = 0.25, 0.5  # side of a picture, relative to the glass's smaller side
ROOM = 0.98  # fraction of the largest picture that is used, to allow for an inexact bench
N_ROUNDS = 4  # attempts to reduce the picture and trace it again


class InitialPlacement(NamedTuple):
    """A picture's centre (3,), m, and its side, m."""

    middle: Floats
    side: float


def _half_size(bounds: Floats, axes: Floats) -> Floats:
    """Half extents (k,) of a box (2, 3) along axes (k, 3)."""
    return np.abs(axes) @ (bounds[1] - bounds[0]) / 2


def seek(
    plan: Plan, bounds: Floats, proposal: Proposal, side: float = 0.0
) -> Generator[float, None, InitialPlacement]:
    """Best place for a picture in glass within bounds (2, 3); yields progress 0..1.

    Parameters
    ----------
    plan : of the proposal's rig, with the largest display allowed
    side : of the picture, m; 0 for the largest that gets through
    """
    frame = proposal.placement.picture
    middle = bounds.mean(axis=0)
    half = _half_of_view(bounds, proposal)
    at, step = grid_over(half, N_RAYS)
    light = yield from light_of(plan, middle + at @ frame[:3, :2].T)

    image = proposal.placement.display
    bundle = Bundle(
        at=at,
        landed=(light.positions - image[:3, 3]) @ image[:3, :2],
        is_good=light.has_arrived & np.isfinite(light.into_glass[:, 0]),
        step=step,
        half=half,
    )

    place, side = _best(bundle, side)
    depth = _depth(light, at, place, side, frame, middle)
    if abs(depth) < WORTH_MOVING * _half_size(bounds, frame[None, :3, 2])[0]:
        depth = 0.0

    # The plane's place and size follow perspective if it is not at the glass's centre.
    scale = 1 - depth / proposal.viewer_distance
    across = frame[:3, :2] @ place * scale
    return InitialPlacement(middle + across + depth * frame[:3, 2], float(side * scale))


def _best(bundle: Bundle, side: float) -> tuple[Floats, float]:
    """Best place (2,) of a bundle, and the picture's side there."""
    smaller = 2 * float(bundle.half.min())
    if not side:
        most = MOST * smaller / ROOM
        place, found = best_place(bundle, most)
        if found * ROOM >= LEAST * smaller:
            return place, ROOM * found
        side = LEAST * smaller

    return best_place_for(bundle, side), side


def _depth(
    light: Light, at: Floats, place: Floats, side: float, frame: Floats, middle: Floats
) -> float:
    """Distance, m, from the glass's centre forward to the middle of the glass at a place."""
    near = np.abs(at - place).max(axis=1) <= side / 2
    near &= np.isfinite(light.into_glass[:, 0])
    if not near.any():
        return 0.0
    front, back = (
        np.median((meeting[near] - middle) @ frame[:3, 2])
        for meeting in (light.into_glass, light.out_of_glass)
    )
    return float(front + back) / 2


@dataclass(frozen=True, eq=False)
class Request:
    """A request for a new rig.

    bench : glass, and existing plates, mirrors and blockers
    bounds : (2, 3) of the glass the rig is built around, world, m
    viewer : of the rig from `propose`
    pixels : of the display
    """

    bench: Rig
    bounds: Floats
    wishes: Wishes
    viewer: Viewer
    pixels: tuple[int, int]

    def rig(self, proposal: Proposal) -> Rig:
        return rig_of(proposal, self.bench, self.viewer, self.pixels)


def settle(
    request: Request, proposal: Proposal, plan_of: Callable[[Rig], Plan]
) -> Generator[float, None, tuple[Proposal, Spread]]:
    """Place the picture of a proposal in the glass, and size it if needed; yields progress 0..1.

    Returns
    -------
    The proposal, with the widest display allowed, and the spread of the light on it.
    """
    wishes = request.wishes
    if proposal.placement.plate is None:  # without a plate the picture is at the display
        standing = InitialPlacement(proposal.placement.picture[:3, 3], proposal.picture)
    else:
        steps = seek(plan_of(request.rig(proposal)), request.bounds, proposal, wishes.picture)
        standing = yield from subprogress(steps, 0.0, 0.3)

    least = 2 * LEAST * float(_half_of_view(request.bounds, proposal).min())

    for n in range(N_ROUNDS):
        proposal = stood(proposal, standing, wishes)
        plan = plan_of(request.rig(proposal))
        points, uv, area = points_of(plan.rig.picture_place)
        start = 0.3 + 0.7 * n / N_ROUNDS
        light = yield from subprogress(light_of(plan, points), start, start + 0.7 / N_ROUNDS)

        spread = spread_in(light, area, proposal.placement.display)
        is_whole = sum(spread.lost.values()) <= 1 - ENOUGH
        if wishes.picture or is_whole or standing.side <= least:
            break
        share = largest_about(np.full(2, 0.5), uv, light.is_seen & ~light.has_arrived, area)
        standing = InitialPlacement(
            standing.middle, max(least, ROOM * standing.side * min(share, 1.0))
        )

    return proposal, spread


def _half_of_view(bounds: Floats, proposal: Proposal) -> Floats:
    """Half of the glass's width and height (2,) as the viewer sees it."""
    return _half_size(bounds, proposal.placement.picture[:3, :2].T)


def stood(proposal: Proposal, standing: InitialPlacement, wishes: Wishes) -> Proposal:
    """The proposal with its picture moved, and the display with it (by the plate if there is
    one).
    """
    placement = proposal.placement
    shift = standing.middle - placement.picture[:3, 3]
    image = shift if placement.plate is None else reflect(shift, placement.plate[:3, 2])
    most = REFERENCE_BENCH.most_display * standing.side * max(wishes.aspect, 1.0)
    return replace(
        proposal,
        placement=replace(
            placement,
            picture=_shifted(placement.picture, shift),
            display=_shifted(placement.display, image),
        ),
        picture=standing.side,
        display=wishes.display or wishes.max_display or most,
    )


def _shifted(frame: Floats, shift: Floats) -> Floats:
    moved = frame.copy()
    moved[:3, 3] += shift
    return moved
