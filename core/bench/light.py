"""The light of points that the viewer looks at: where each ray goes through glass and plate, and
where it lands.

Rays are the viewer's own, straight through points in space. So the light of a place does not
depend on the picture that stands there: one bundle answers for pictures of any size in its reach.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import at
from ..light.landings import BY_GAPS, REASON_WORDS, Reason, main_landings
from ..light.plan import Plan
from ..light.rays import Step
from ..light.trace import tracing
from ..rig.kinds import Kind
from .flat import IS_FLAT, Outline

RAYS_AT_ONCE = 5000  # that are traced together: so often Esc is heard


@dataclass(frozen=True, eq=False)
class Light:
    """The light of points (n), in their order.

    is_seen : (n,) lies the point within the viewer's image?
    reason : (n,) of Reason; of points out of sight BLOCKED
    branch : (n,) the way of the light, 0 where it ended on the way
    positions : (n, 3) m, of the ends
    has_leaked : (n,) through a gap in open glass
    into_glass, out_of_glass : (n, 3) m, first and last meeting with glass, NaN where there is none
    at_plate : (n, 3) m, first meeting with the plate that was asked about, NaN where there is none
    """

    is_seen: Bools
    reason: NDArray[np.uint8]
    branch: NDArray[np.uint64]
    positions: Floats
    has_leaked: Bools
    into_glass: Floats
    out_of_glass: Floats
    at_plate: Floats

    @property
    def has_arrived(self) -> Bools:
        """(n,) is the point seen, and has its light a landing on the display?"""
        return self.is_seen & (self.reason == Reason.ARRIVED)

    def lost(self, weight: Floats) -> dict[str, float]:
        """Shares of the weight (n,) in sight that do not arrive, by reason in words; light that
        went through a gap has no other one.
        """
        seen = np.where(self.is_seen, weight, 0.0)
        whole = max(float(seen.sum()), np.finfo(float).tiny)
        by_reason = {
            word: float(seen[~self.has_leaked & (self.reason == number)].sum()) / whole
            for number, word in REASON_WORDS.items()
        }
        is_in_gap = self.has_leaked & (self.reason != Reason.ARRIVED)
        by_reason[BY_GAPS] = float(seen[is_in_gap].sum()) / whole
        return {word: share for word, share in by_reason.items() if share > 0}


def together(lights: Sequence[Light]) -> Light:
    """The light of several viewers as one, the points of each behind those of the one before."""
    return Light(
        **{
            field.name: np.concatenate([getattr(light, field.name) for light in lights])
            for field in fields(Light)
        }
    )


def light_of(
    plan: Plan, points: Floats, plate: Outline | None = None
) -> Generator[float, None, Light]:
    """Follow the viewer's rays straight through points (n, 3), m; yields progress 0..1.

    plate : the outline of a plate, whose meetings are noted
    """
    viewer = plan.viewer
    xy = viewer.project(points)
    is_seen = ((xy >= 0) & (xy <= (viewer.width, viewer.height))).all(axis=1)  # false for NaN too
    light = Light(
        is_seen=is_seen,
        reason=np.full(len(points), Reason.BLOCKED, np.uint8),
        branch=np.zeros(len(points), np.uint64),
        positions=np.full((len(points), 3), np.nan),
        has_leaked=np.zeros(len(points), bool),
        into_glass=np.full((len(points), 3), np.nan),
        out_of_glass=np.full((len(points), 3), np.nan),
        at_plate=np.full((len(points), 3), np.nan),
    )

    seen = np.flatnonzero(is_seen)
    origins, directions = viewer.rays(xy[seen])
    for first in range(0, len(seen), RAYS_AT_ONCE):
        some = slice(first, first + RAYS_AT_ONCE)
        steps: list[Step] = []
        found = yield from at(
            first / len(seen), tracing(plan, origins[some], directions[some], steps=steps)
        )
        of = seen[some]
        landings = main_landings(found, len(of))
        light.reason[of] = landings.reason
        light.branch[of] = landings.branch
        light.positions[of] = landings.positions
        light.has_leaked[of] = landings.leak >= 0
        _note_meetings(plan, light, of, steps)
        if plate is not None:
            _note_plate(plan, light, of, steps, plate)

    return light


def _note_meetings(plan: Plan, light: Light, of: Ints, steps: list[Step]) -> None:
    """Write down where rays, those of points `of`, met glass."""
    for step in steps:
        is_glass = _kind(plan, step) == Kind.GLASS
        ray = of[step.rays[is_glass]]
        place = step.place[is_glass]
        is_new = np.isnan(light.into_glass[ray, 0])
        light.into_glass[ray[is_new]] = place[is_new]
        light.out_of_glass[ray] = place


def _note_plate(plan: Plan, light: Light, of: Ints, steps: list[Step], plate: Outline) -> None:
    """Write down where rays, those of points `of`, first met a plate."""
    normal = np.cross(*plate.axes)
    for step in steps:
        off = np.abs((step.place - plate.middle) @ normal)
        is_here = (_kind(plan, step) == Kind.PLATE) & (off <= IS_FLAT * plate.half.max())
        ray = of[step.rays[is_here]]
        is_new = np.isnan(light.at_plate[ray, 0])
        light.at_plate[ray[is_new]] = step.place[is_here][is_new]


def _kind(plan: Plan, step: Step) -> Ints:
    """The kind of part (h,) that each ray of a step met."""
    return plan.parts.kind[plan.triangles.part[step.triangle]]
