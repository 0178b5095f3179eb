"""The result of a solve."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.messages import Message
from ..base.numbers import millimetres
from ..base.steps import Steps
from ..rig.rig import ConstantIndex, Rig
from ..rig.settings import LEAST_TOLERANCE, MOST_TOLERANCE
from .channel import Channel
from .disagreement import Settled


@dataclass(frozen=True)
class Remark:
    """A note to the user.

    text : with lengths as `Length`
    is_warning : does it tell of light that is lost or goes another way?
    """

    text: Message
    is_warning: bool = False

    def sentence(self, length_text: Callable[[float], str] = millimetres) -> Message:
        """The sentence, with lengths in words as a function of metres has them."""
        return self.text.in_units(length_text)


def note(template: str, /, **values: object) -> Remark:
    """A remark that informs."""
    return Remark(Message(template, **values))


def warning(template: str, /, **values: object) -> Remark:
    """A remark on light that is lost or goes another way."""
    return Remark(Message(template, **values), is_warning=True)


@dataclass(frozen=True, eq=False)
class Solution:
    """The source image, and the fate of the viewers' rays.

    source : (H, W, 3) float32 linear, row 0 at the top
    channels : one for each viewer and wavelength
    seconds : time by part of the work; n_rays : rays traced for this solve
    used, left_out : what this rig needed and what it did not; remarks : sentences for the user
    settled : how the viewers' disagreement is settled; None with one viewer, and where the picture
        is no flat rectangle
    """

    rig: Rig
    source: NDArray[np.float32]
    channels: tuple[Channel, ...]
    seconds: dict[str, float]
    n_rays: int
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    remarks: tuple[Remark, ...]
    settled: Settled | None = None

    @property
    def first(self) -> Channel:
        """The channel of the rig's first viewer."""
        return self.channels[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user, one or two sentences each."""
        return tuple(remark.sentence() for remark in self.remarks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that tell of light that is lost or goes another way."""
        return tuple(remark.sentence() for remark in self.remarks if remark.is_warning)

    @cached_property
    def weight(self) -> Floats:
        """Sum (H, W) of area * throughput^2, viewer px^2, over the shares of all channels
        that each display pixel shows, by the weights of their viewers.
        """
        return reduce(
            np.add,
            [channel.viewer.weighed(channel.coverage.weight) for channel in self.channels],
        )

    @cached_property
    def display_coverage(self) -> Floats:
        """Part (H, W) of each display pixel that the channel sees that sees most of it, 0..1."""
        return reduce(np.maximum, [channel.coverage.of_display for channel in self.channels])

    @property
    def picture_coverage(self) -> float:
        """Share of the picture, as the first viewer sees it, that the display can show."""
        return self.first.picture_coverage

    @property
    def misses(self) -> dict[str, float]:
        """Share of the picture as the first viewer sees it, by reason why it has no landing."""
        return self.first.misses

    def ideal(self) -> NDArray[np.float32]:
        """The picture as the first viewer would see it with no glass in the way: (h, w, 3)."""
        return self.first.ideal()

    def seen(
        self, source: NDArray[np.float32] | None = None, beside: bool = False
    ) -> NDArray[np.float32]:
        """The first viewer's image, through the glass, of the source
        image or of another one: (h, w, 3) linear; `beside` as in Channel.seen.
        """
        return self.first.seen(self.source if source is None else source, beside)

    def seeing(self, source: NDArray[np.float32]) -> Steps[NDArray[np.float32]]:
        """The same of another source image, with pauses."""
        return self.first.seeing(source)

    def trace_stray_light(self) -> Generator[float, None, None]:
        """Trace light beside the glass for the first viewer; yields progress 0..1."""
        yield from self.first.trace_stray_light()


def without_glass(rig: Rig) -> Rig:
    """The same rig with glass that does not refract: it paints the plain, uncompensated picture."""
    return replace(
        rig, glasses=tuple(replace(glass, ior=ConstantIndex(1.0)) for glass in rig.glasses)
    )


# parts of a solve that the splat needs as well, once for all samples
BUILD = ("fingerprint", "plan")
REFINED = ("tracing", "shares")  # parts of a solve that depend on the tolerance
# of interpolation within a cell, in the cell's side; cells
# cover an area: their number goes by 2 / ORDER
ORDER = 4


def cost(
    seconds: dict[str, float],
    tolerance: float,
    wanted: float,
    ladder: Sequence[tuple[float, float]] = (),
) -> float | None:
    """About how many seconds the last solve would have taken at another tolerance.

    Parameters
    ----------
    seconds : of the last solve by part
    tolerance, wanted : display px, the last solve's and the other
    ladder : tolerances (display px) and seconds that a report measured. Without, a cell's error is
        taken to go with its side to the power ORDER, so that the number of cells goes with the
        tolerance to the power -2 / ORDER: too much where cells are as small as they get already.

    Returns
    -------
    None when the last solve traced nothing, or the wanted tolerance cannot be kept
    """
    if REFINED[0] not in seconds or not LEAST_TOLERANCE <= wanted <= MOST_TOLERANCE:
        return None

    fixed = sum(taken for part, taken in seconds.items() if part in BUILD)
    total = sum(seconds.values())

    if len(ladder) > 1:
        at, measured = np.log(np.array(sorted(ladder))).T
        here, there = np.interp(np.log([tolerance, wanted]), at, measured)
        return float(fixed + (total - fixed) * np.exp(there - here))

    refined = sum(seconds.get(part, 0.0) for part in REFINED)
    return float(total - refined + refined * (tolerance / wanted) ** (2 / ORDER))
