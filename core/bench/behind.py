"""Where the parts of a new rig without a plate stand: the display behind the glass, or under it.

The viewer looks through the glass's centre at the display, which stands upright behind the glass,
or lies under it for a viewer who looks down steeply. The picture is where the display is: as if the
display showed it and there were no glass. Lengths in m.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats
from .placement import REFERENCE_BENCH, Placement, Proposal, Wishes, frame


@dataclass(frozen=True)
class StraightBench:
    """The bench without a plate, for a glass of any size.

    lies_from : rad, of the viewer's look down: from there on the display lies under the glass
    gap_share : of the glass's depth, the way from its back to an upright display: light through the
        middle of a ball of index 1.5 then lands as far from the axis as it came. Glass lies on a
        display that lies
    lift_share : of the picture, by which it stands before the display, so
        that both can be seen and selected
    """

    lies_from: float = np.pi / 4
    gap_share: float = 1.0
    lift_share: float = 0.01


STRAIGHT_BENCH = StraightBench()


def propose_behind(bounds: Floats, wishes: Wishes, aim: Floats | None = None) -> Proposal:
    """A rig without a plate, around glass within these bounds (2, 3), world, m.

    aim : bounds (2, 3) of the glass of which the viewer looks at the middle, where it is not
        all of it: between two glasses there is none. The display is behind all of it
    """
    bench = STRAIGHT_BENCH
    aim = bounds if aim is None else aim
    centre = (aim[0] + aim[1]) / 2
    corners, of_aim = (
        np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3) - centre for box in (bounds, aim)
    )

    # the viewer's axes
    level = np.array([-np.sin(wishes.azimuth), np.cos(wishes.azimuth), 0.0])
    right = np.array([np.cos(wishes.azimuth), np.sin(wishes.azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    down, along = np.sin(wishes.look_down), np.cos(wishes.look_down)
    forward = along * level - down * up
    upward = down * level + along * up

    # sizes of the glass, as the viewer sees it, and how far it reaches to the display
    lies = wishes.look_down >= bench.lies_from - 1e-6
    away = -up if lies else level
    width, height, depth = (float(np.ptp(of_aim @ axis)) for axis in (right, upward, away))
    # all of it is in sight
    wide = 2 * max(float(np.abs(corners @ axis).max()) for axis in (right, upward))
    grow = max(1.0, wide / REFERENCE_BENCH.large_m)
    gap = wishes.distance or (0.0 if lies else bench.gap_share * depth)
    way = (float((corners @ away).max()) + gap) / float(away @ forward)

    # what is seen at the glass is seen larger further away
    distance = wishes.viewer_distance or REFERENCE_BENCH.viewer_distance_m * grow
    seen = REFERENCE_BENCH.picture_share * (min(width, height) or wide)
    picture = wishes.picture or seen * (distance + way) / distance
    at = centre + way * forward
    upright = level if lies else up
    most = REFERENCE_BENCH.most_display * picture * max(wishes.aspect, 1.0)

    return Proposal(
        placement=Placement(
            viewer=frame(right, upward, centre - distance * forward),
            picture=frame(right, upright, at - bench.lift_share * picture * away),
            plate=None,
            display=frame(right, upright, at),
        ),
        viewer_distance=distance,
        field=wishes.field or wide,
        plate=0.0,
        picture=picture,
        display=wishes.display or wishes.max_display or most,
    )
