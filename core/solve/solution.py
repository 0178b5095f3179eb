"""The result of a solve."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.errors import ImageError
from ..base.messages import Message
from ..base.numbers import millimetres
from ..base.steps import Steps, hold_progress, subprogress
from ..rig.joined_display import Section, sections_of, stack
from ..rig.rig import Rig
from ..rig.settings import LEAST_TOLERANCE, MOST_TOLERANCE
from .channel import Channel
from .disagreement import Settled
from .lateral_colour import LateralColour
from .sharpening import Sharpened
from .through_pupil import PupilViews


@dataclass(frozen=True)
class Remark:
    """A note to the user.

    text : with lengths as `Length`
    is_warning : whether light is lost or takes another path
    """

    text: Message
    is_warning: bool = False

    def sentence(self, length_text: Callable[[float], str] = millimetres) -> Message:
        """The sentence, with lengths formatted by a function of metres."""
        return self.text.in_units(length_text)


def note(template: str, /, **values: object) -> Remark:
    """A remark that informs."""
    return Remark(Message(template, **values))


def warning(template: str, /, **values: object) -> Remark:
    """A remark on light that is lost or takes another path."""
    return Remark(Message(template, **values), is_warning=True)


@dataclass(frozen=True, eq=False)
class Solution:
    """The source image, and the fate of the viewers' rays.

    Attributes
    ----------
    rig : as solved
    source : (H, W, 3) float32 linear, row 0 at the top
    channels : one for each viewer
    seconds : time by stage
    n_rays : rays traced for this solve
    used : parts of the method this rig needed
    left_out : parts it did not need
    remarks : notes to the user
    settled : places settled between viewers; None with one viewer, and unless the picture is a flat
        rectangle
    by_display : of several displays and screens, the fraction of the picture, as the first viewer
        sees it, that each shows
    projected : (h, w, 3) float32 linear, an image for each projector
    colour : lateral colour of the first viewer; None if the glass does not disperse
    views : what each viewer sees through its pupil, one for each of its colours if glass disperses
    sharpened : the effect of Sharpen; None if it is off
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
    by_display: tuple[float, ...] = ()
    projected: tuple[NDArray[np.float32], ...] = ()
    colour: LateralColour | None = None
    views: tuple[PupilViews, ...] = ()
    sharpened: Sharpened | None = None

    @property
    def sections(self) -> tuple[Section, ...]:
        """The rows of the source image for each display, then for each screen."""
        return sections_of(self.rig.lit)

    @property
    def image(self) -> NDArray[np.float32]:
        """The source image, with the images of projectors below it: sections of all outputs."""
        return with_projected(self.rig, self.source, self.projected)

    @property
    def first(self) -> Channel:
        """The channel of the rig's first viewer."""
        return self.channels[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks as text, one or two sentences each."""
        return tuple(remark.sentence() for remark in self.remarks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks as text, on lost or diverted light only."""
        return tuple(remark.sentence() for remark in self.remarks if remark.is_warning)

    @cached_property
    def weight(self) -> Floats:
        """Sum (H, W) of area * throughput^2, viewer px^2, over the shares each display pixel shows.

        Each channel counts by the weight of its viewer, each of several colours in full.
        """
        each = [one for channel in self.channels for one in channel.colours or (channel,)]
        return reduce(np.add, [one.viewer.weighed(one.coverage.weight) for one in each])

    @cached_property
    def display_coverage(self) -> Floats:
        """Largest fraction (H, W) of each display pixel that any channel sees, 0..1."""
        each = [one for channel in self.channels for one in channel.colours or (channel,)]
        return reduce(np.maximum, [one.coverage.of_display for one in each])

    @property
    def picture_coverage(self) -> float:
        """Fraction of the picture, as the first viewer sees it, that the display can show."""
        return self.first.picture_coverage

    @property
    def misses(self) -> dict[str, float]:
        """Fraction of the picture, as the first viewer sees it, by the reason why it has no
        landing.
        """
        return self.first.misses

    def ideal(self) -> NDArray[np.float32]:
        """The picture as the first viewer would see it without glass: (h, w, 3) linear."""
        return self.first.ideal()

    def seen(
        self, source: NDArray[np.float32] | None = None, past_glass: bool = False
    ) -> NDArray[np.float32]:
        """The first viewer's image of the source image, or of another one: (h, w, 3) linear.

        Parameters
        ----------
        source : (H, W, 3) linear, row 0 at the top; None: the source image
        past_glass : add light that reaches the viewer past the glass, by way of the plate
        """
        source = self.source if source is None else source
        if source.shape[:2] != self.source.shape[:2]:
            raise ImageError(
                "The source image has {width} x {height} pixels, but '{display}' has"
                " {display_width} x {display_height}: solve again.",
                width=source.shape[1],
                height=source.shape[0],
                display=self.rig.display.name,
                display_width=self.source.shape[1],
                display_height=self.source.shape[0],
            )
        return self.first.seen(source, past_glass)

    def seeing(self, source: NDArray[np.float32]) -> Steps[NDArray[np.float32]]:
        """`seen` in steps."""
        return self.first.seeing(source)

    def seeing_with_pupil(
        self, source: NDArray[np.float32]
    ) -> Generator[float, None, NDArray[np.float32]]:
        """The first viewer's image through its pupil (h, w, c) of source images (H, W, c); yields
        progress 0..1. Without a pupil the same as `seeing`.
        """
        if not self.first.viewer.pupil:
            return (yield from hold_progress(0.0, self.seeing(source)))
        light, n = self.rig.display.light_of(source), max(len(self.first.colours), 1)
        seen = []
        for k, views in enumerate(self.views[:n]):
            yield from subprogress(views.trace(), k / n, (k + 1) / n)
            steps = views.seeing(light[..., k::n])
            seen.append((yield from hold_progress((k + 1) / n, steps)))
        return np.stack(seen, axis=-1).reshape(*seen[0].shape[:2], -1)

    def trace_stray_light(self) -> Generator[float, None, None]:
        """Trace light past the glass for the first viewer; yields progress 0..1."""
        yield from self.first.trace_stray_light()


def with_projected(
    rig: Rig, source: NDArray[np.float32], projected: Sequence[NDArray[np.float32]] = ()
) -> NDArray[np.float32]:
    """A source image (H, W, 3) with the images of a rig's projectors below it; black without."""
    if not rig.projectors:
        return source
    images = [section.of(source) for section in sections_of(rig.lit)]
    return stack(sections_of(rig.outputs), [*images, *projected])


def without_glass(rig: Rig) -> Rig:
    """The rig without its glass, which paints the plain picture."""
    return replace(rig, glasses=())


# stages that the splat needs as well, once for all samples
BUILD = ("fingerprint", "plan")
REFINED = ("tracing", "shares")  # stages that depend on the tolerance
# Order of interpolation in a cell, by its side. Cells cover an area, so their number changes with
# the power 2 / ORDER of the tolerance.
ORDER = 4


def cost(
    seconds: dict[str, float],
    tolerance: float,
    wanted: float,
    ladder: Sequence[tuple[float, float]] = (),
) -> float | None:
    """Seconds the last solve would have taken at another tolerance, approximate.

    Parameters
    ----------
    seconds : of the last solve by stage
    tolerance, wanted : display px, of the last solve and the other one
    ladder : tolerances (display px) and seconds measured by a report. Without it the number of
        cells is assumed to change with the tolerance to the power -2 / ORDER, which is too much
        once cells are as small as they get.

    Returns
    -------
    None if the last solve traced nothing, or the wanted tolerance is out of range
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
