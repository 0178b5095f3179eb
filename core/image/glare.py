"""Glare: display light that reaches the viewer past the glass, only via the plate or directly."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints
from ..base.messages import Message, joined
from ..base.steps import Steps
from ..base.vectors import dot
from ..light.beams import in_quilt
from ..light.plan import Plan
from ..light.rays import are_main
from ..light.trace import tracing
from .simulation import LUMINANCE

N_RAYS_A_SIDE = 64  # of the viewer's image: a share of a tenth is accurate to a hundredth
# offset from the glass, in standard deviations of the light through it, that counts as one side
OFF_MIDDLE = 0.5
AROUND = Message("all around it")


class Glare(NamedTuple):
    """Share, 0..1, of the viewer's light that passes by the glass, and a phrase for its
    direction.
    """

    share: float
    where: str


class Split(NamedTuple):
    """Light in a rig whose parts split it.

    brightness : mean throughput of the picture's light, 0..1
    stray : share, 0..1, of the viewer's light by other paths than the picture's
    """

    brightness: float
    stray: float


@dataclass(frozen=True, eq=False)
class StrayLight:
    """A sample of rays from the display, through the glass and past it.

    view : (n, 2) viewer px
    pixel : (n,) of the display, row by row
    throughput : (n,)
    is_past_glass : (n,) past the glass
    is_main : (n,) by the path of the picture, if parts split light
    """

    view: Floats
    pixel: Ints
    throughput: Floats
    is_past_glass: NDArray[np.bool_]
    is_main: NDArray[np.bool_]

    def split_of(self, shown: NDArray[np.float32]) -> Split:
        """Brightness and stray light of the display's light (H, W, 3), linear."""
        light = dot(shown.reshape(-1, 3)[self.pixel].astype(float), LUMINANCE) * self.throughput
        total = light.sum()
        return Split(
            brightness=float(self.throughput[self.is_main].mean()) if self.is_main.any() else 0.0,
            stray=float(light[~self.is_main].sum() / total) if total else 0.0,
        )

    def seen_of(self, shown: NDArray[np.float32]) -> Glare:
        """The glare of the display's light (H, W, 3), linear."""
        colours = shown.reshape(-1, 3)[self.pixel].astype(float)
        light = dot(colours, LUMINANCE) * self.throughput
        past_glass = light * self.is_past_glass
        total = light.sum()
        if not total or not past_glass.sum():
            return Glare(0.0, "")
        return Glare(float(past_glass.sum() / total), self._where(light - past_glass, past_glass))

    def _where(self, through: Floats, past_glass: Floats) -> Message:
        """The side of the glass with most of the glare."""
        if not through.sum():
            return AROUND

        middle, off = (
            np.average(self.view, axis=0, weights=light) for light in (through, past_glass)
        )
        spread = np.sqrt(np.average(((self.view - middle) ** 2).sum(axis=1), weights=through))
        x, y = (off - middle) / max(spread, 1.0)
        sides = {
            Message("above"): y < -OFF_MIDDLE,
            Message("below"): y > OFF_MIDDLE,
            Message("left of"): x < -OFF_MIDDLE,
            Message("right of"): x > OFF_MIDDLE,
        }
        words = [word for word, is_there in sides.items() if is_there]
        if not words:
            return AROUND
        return Message("mostly {sides} it", sides=joined(words, " and "))


def with_stray_light(plan: Plan) -> Plan:
    """The same plan, following light past the glass to the display."""
    return replace(plan, settings=replace(plan.settings, suppress_glare=1.0))


def trace_stray_light(plan: Plan, seed: int = 0) -> Steps[StrayLight]:
    """Follow a sample of the viewer's rays, spread evenly over its image."""
    viewer = plan.viewer
    along = np.arange(N_RAYS_A_SIDE)
    cell = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    within = np.random.default_rng(seed).random(cell.shape)
    view = (cell + within) / N_RAYS_A_SIDE * (viewer.width, viewer.height)
    landings = yield from tracing(with_stray_light(plan), *viewer.rays(view))

    size = plan.rig.display.width, plan.rig.display.height
    is_through, pixel = landings.pixels(*size)
    is_past_glass, past_pixel = landings.pixels_past_glass(*size)
    is_seen, pixel = in_quilt(plan, landings, is_through | is_past_glass, pixel + past_pixel)
    return StrayLight(
        view[landings.sample[is_seen]],
        pixel[is_seen],
        landings.throughput[is_seen],
        is_past_glass[is_seen],
        are_main(landings, len(view))[is_seen],
    )
