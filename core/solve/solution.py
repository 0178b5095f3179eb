"""The result of a solve."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.steps import Pauses
from ..rig.rig import ConstantIndex, Rig
from .channel import Channel
from .disagreement import Settled
from .remark import Remark


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
        return tuple(remark.told() for remark in self.remarks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that tell of light that is lost or goes another way."""
        return tuple(remark.told() for remark in self.remarks if remark.is_warning)

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

    def seeing(self, source: NDArray[np.float32]) -> Pauses[NDArray[np.float32]]:
        """The same of another source image, with pauses."""
        return self.first.seeing(source)

    def look_beside(self) -> Generator[float, None, None]:
        """Trace light beside the glass for the first viewer; yields progress 0..1."""
        yield from self.first.look_beside()


def without_glass(rig: Rig) -> Rig:
    """The same rig with glass that does not refract: it paints the plain, uncompensated picture."""
    return replace(
        rig, glasses=tuple(replace(glass, ior=ConstantIndex(1.0)) for glass in rig.glasses)
    )
