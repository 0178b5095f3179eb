"""The light of points that the viewer looks at: where each ray goes through glass and plate, and
where it lands.

Rays are the viewer's own, straight through points in space. So the light of a place does not
depend on the picture that stands there: one bundle answers for pictures of any size in its reach.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats
from ..kinds import Kind
from ..light.landings import REASON_WORDS, Reason, main_landings
from ..light.plan import Plan
from ..light.trace import Step, tracing
from ..steps import at

RAYS_AT_ONCE = 5000  # that are traced together: so often Esc is heard


@dataclass(frozen=True, eq=False)
class Light:
    """The light of points (n), in their order.

    is_seen : (n,) lies the point within the viewer's image?
    reason : (n,) of Reason; of points out of sight BLOCKED
    positions : (n, 3) m, of the ends
    has_leaked : (n,) through a gap in open glass
    into_glass, out_of_glass : (n, 3) m, first and last meeting with glass, NaN where there is none
    at_plate : (n, 3) m, first meeting with a plate, NaN where there is none
    """

    is_seen: Bools
    reason: NDArray[np.uint8]
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
        """Shares of the weight (n,) in sight that do not arrive, by reason in words."""
        seen = np.where(self.is_seen, weight, 0.0)
        whole = max(float(seen.sum()), np.finfo(float).tiny)
        by_reason = {
            word: float(seen[self.reason == number].sum()) / whole
            for number, word in REASON_WORDS.items()
        }
        return {word: share for word, share in by_reason.items() if share > 0}


def light_of(plan: Plan, points: Floats) -> Generator[float, None, Light]:
    """Follow the viewer's rays straight through points (n, 3), m; yields progress 0..1."""
    viewer = plan.viewer
    xy = viewer.project(points)
    is_seen = ((xy >= 0) & (xy <= (viewer.width, viewer.height))).all(axis=1)  # false for NaN too
    light = Light(
        is_seen=is_seen,
        reason=np.full(len(points), Reason.BLOCKED, np.uint8),
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
        light.positions[of] = landings.positions
        light.has_leaked[of] = landings.leak >= 0
        _note_meetings(plan, light, of, steps)

    return light


def _note_meetings(plan: Plan, light: Light, of: NDArray[np.int64], steps: list[Step]) -> None:
    """Write down where rays, those of points `of`, met glass and plates."""
    for step in steps:
        kind = plan.parts.kind[plan.triangles.part[step.triangle]]
        for place, wanted, is_first in (
            (light.into_glass, Kind.GLASS, True),
            (light.out_of_glass, Kind.GLASS, False),
            (light.at_plate, Kind.PLATE, True),
        ):
            some = kind == wanted
            ray = of[step.rays[some]]
            if is_first:
                is_new = np.isnan(place[ray, 0])
                place[ray[is_new]] = step.place[some][is_new]
            else:
                place[ray] = step.place[some]
