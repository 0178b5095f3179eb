"""The view through a viewer's pupil: the mean of pinhole views from even places in it."""

from collections.abc import Generator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base.fingerprint import fingerprint
from ..base.free_memory import check_free
from ..base.messages import Message
from ..base.steps import Steps, hold_progress, subprogress
from ..image.seen_image import seeing
from ..light.compile_plan import compile_plan_steps
from ..light.plan import Plan
from ..light.rays import main_landings
from ..light.trace import trace
from ..map.points import BYTES_OF_POINT
from ..map.sampling import sample
from ..map.shares import ShareBatches
from ..map.view_map import ViewMap
from ..rig.pupil import focus_of, pinholes, rays_through
from .channel import shares_of

# Least places in a pupil: the seen image is within 1e-3 of white of its limit, and Sharpen within
# 2 dB of what 64 places reach (docs/measured.md)
LEAST_PLACES = 16
MOST_PLACES = 256  # each takes a view map
N_ALONG = 9  # rays along the viewer's image that measure the spot
N_RIM = 8  # places on the pupil's rim


class PupilViews:
    """A viewer's images through places of its pupil, traced on first use; a pinhole has one.

    batches : shares of each place, each share in one viewer pixel; None until traced
    """

    def __init__(self, plan: Plan, view_map: ViewMap) -> None:
        self._plan, self._view_map = plan, view_map
        self.batches: tuple[ShareBatches, ...] | None = None

    def trace(self) -> Generator[float, None, None]:
        """Trace the view maps of all places, unless cached; yields progress 0..1.

        Raises
        ------
        RigError : there are more maps than memory holds
        """
        if self.batches is not None:
            return
        plan, maps = self._plan, [self._view_map]
        viewer = plan.viewer
        if viewer.pupil:
            if len(plan.rig.glasses) > 1:  # the plan has only the glass that the pinhole sees
                plan = yield from hold_progress(0.0, compile_plan_steps(plan.rig, plan.settings))
            n = n_places(plan.seen_by(viewer))
            needed = float(n * BYTES_OF_POINT * len(self._view_map.points))
            check_free(needed, Message("The pupil"), Message("make the pupil smaller"))
            maps = []
            for k, pinhole in enumerate(pinholes(plan.rig.place_of(viewer), viewer, n)):
                steps = sample(plan.seen_by(pinhole))
                maps.append((yield from subprogress(steps, k / n, (k + 1) / n)))
        self.batches = tuple(
            shares_of(one, plan.settings.brightness, partial(one.pieces, at_pixels=True))
            for one in maps
        )
        for batches in self.batches:
            batches.share_memory(len(maps))

    def seeing(self, light: NDArray[np.float32]) -> Steps[NDArray[np.float32]]:
        """The seen image (h, w, 3) of the display's light (H, W, 3), in steps."""
        total = 0.0
        for batches in self.batches:
            total = total + (yield from seeing(batches, light)).astype(float)
        return (total / len(self.batches)).astype(np.float32)


def views_of(
    plans: Sequence[Plan],
    maps: Sequence[ViewMap],
    keys: Sequence[str],
    cached: Mapping[str, PupilViews],
) -> dict[str, PupilViews]:
    """Views of each channel by the content that they depend on, from the cache if they are there.

    keys : of the view maps
    """
    found = {}
    for plan, view_map, key in zip(plans, maps, keys, strict=True):
        viewer = plan.viewer
        focus = focus_of(plan.rig.place_of(viewer), viewer) if viewer.pupil else None
        number = fingerprint(len(found), key, viewer.pupil, focus)
        found[number] = cached.get(number) or PupilViews(plan, view_map)
    return found


def n_places(plan: Plan) -> int:
    """Places in a viewer's pupil that sample its mean spot on the display once for each pixel.

    The spot is where rays through the pupil's rim and one point of the plane of focus land.
    """
    viewer = plan.viewer
    focus = focus_of(plan.rig.place_of(viewer), viewer)
    along = (np.arange(N_ALONG) + 0.5) / N_ALONG
    xy = np.stack(np.meshgrid(along * viewer.width, along * viewer.height), axis=-1).reshape(-1, 2)
    angle = 2 * np.pi * np.arange(N_RIM) / N_RIM
    rim = viewer.pupil / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    middle = main_landings(trace(plan, *viewer.rays(xy)), len(xy))
    squares = []
    for place in rim:
        rays = rays_through(viewer, xy, np.broadcast_to(place, xy.shape), focus)
        found = main_landings(trace(plan, *rays), len(xy), middle.branch)
        is_same = (found.branch == middle.branch) & (middle.branch != 0)
        squares.append((((found.xy - middle.xy)[is_same]) ** 2).sum(axis=1))
    area = np.pi * np.concatenate([[0.0], *squares]).mean()
    return int(np.clip(np.ceil(area), LEAST_PLACES, MOST_PLACES))
