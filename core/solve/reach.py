"""Which glass does light come near? Other glass is not
made ready to be traced until a ray comes by.
"""

from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from ..base.messages import Message
from ..base.stages import MAP, spans
from ..base.steps import at, within
from ..light.compile_plan import planning
from ..light.mesh_cache import Kept
from ..light.plan import Aside, Plan
from ..light.rays import ReachedError
from ..map.sampling import Sampling
from ..map.view_map import ViewMap
from ..rig.rig import Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer

UNTRACED = Message("tracing (the optics have not changed)")

MOST_STARTS = 3  # the last of them with everything


def out_of_sight(rig: Rig, viewer: Viewer) -> tuple[int, ...]:
    """Glasses, by their number, that a viewer does not look at:
    light may come to them by way of the others only.
    """
    if len(rig.glasses) == 1:
        return ()

    aside = []
    for number, glass in enumerate(rig.glasses):
        low, high = glass.mesh.bounds
        corners = np.array(
            [
                [x, y, z]
                for x in (low[0], high[0])
                for y in (low[1], high[1])
                for z in (low[2], high[2])
            ]
        )

        xy = viewer.project(corners)
        is_before = np.isfinite(xy).all(axis=1)
        if not is_before.any():
            aside.append(number)
        elif is_before.all():
            left, top = xy.min(axis=0)
            right, bottom = xy.max(axis=0)
            if right < 0 or bottom < 0 or left > viewer.width or top > viewer.height:
                aside.append(number)

    return tuple(aside) if len(aside) < len(rig.glasses) else ()


def sample_reached(
    rig: Rig,
    viewer: Viewer,
    settings: Settings,
    kept: Kept,
    lap: Callable[[str], None],
    is_coarse: bool = False,
) -> Generator[float, None, tuple[Plan, ViewMap]]:
    """Plan and view map of a viewer, without the glass that none of its light
    comes near; yields progress 0..1.

    If a ray or a bundle of rays comes near such a glass after all, it begins again with that glass.

    Parameters
    ----------
    lap : called with the name of the work just done
    is_coarse : for a first picture, as Sampling has it

    Raises
    ------
    RigError, MeshError : as by make_plan
    """
    aside = out_of_sight(rig, viewer)
    _, of_map = spans(("plan",), MAP)
    told = 0.0

    for start in range(MOST_STARTS):
        plan = yield from at(
            told, planning(rig, settings, kept, aside if start < MOST_STARTS - 1 else ())
        )
        plan = plan.seen_by(viewer)
        lap("plan")

        # rays that check a map tell, too, whether light comes near to what stands aside
        sampling = Sampling(plan, is_coarse, is_checked=bool(plan.aside.glasses))
        steps = within(sampling.sample(), *of_map)

        try:
            while True:
                # a solve that begins again has come no further
                told = max(told, next(steps))
                yield told
        except StopIteration as end:
            return replace(plan, aside=Aside.none()), end.value
        except ReachedError as found:
            aside = tuple(
                number for k, number in enumerate(plan.aside.glasses) if k not in found.boxes
            )
            lap("tracing")

    raise AssertionError("with everything in the plan nothing else can be reached")
