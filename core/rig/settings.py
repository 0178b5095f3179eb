"""Settings of a solve: the user's choices, and their bounds."""

from dataclasses import dataclass, replace
from math import isqrt
from typing import Literal, get_args

from ..base.errors import RigError, out_of_range
from ..base.messages import Message, as_message, quoted
from .rig import WAVELENGTH, Rig

Ghosts = Literal["mean", "strongest"]
Disagreement = Literal["sharp", "blended"]
# px; landings are accurate to about 1e-7 px on curved glass
LEAST_TOLERANCE = 1e-6
MOST_TOLERANCE = 100.0
MOST_EFFORT = 4096  # rays for a viewer pixel
WHITE = 1.0, 1.0, 1.0
OWNER = Message("The rig")  # of the settings, at the start of a sentence


@dataclass(frozen=True)
class Settings:
    """Settings of a solve.

    Parameters
    ----------
    tolerance : allowed error of landings, display pixels; LEAST_TOLERANCE to MOST_TOLERANCE
    max_events : surfaces a ray may hit before it counts as lost
    only_through_glass : only rays through glass carry the picture; ignored in a rig without glass
    brightness : weigh paths by their throughput (Fresnel) instead of by 1
    effort : rays that sample a viewer pixel with chaotic light, rounded down to a square; up to
        3.25 times as many where the display is faint (core/map/samples.py), and at most 24 times as
        many for each display pixel available to it (core/map/ray_budget.py); 1 to MOST_EFFORT
    margin : display pixels by which the covered area grows in the source image
    wavelength : m
    suppress_glare : weight, 0 to 1, of light past the glass, which should be dark; only if just
        light through glass carries the picture
    ghosts : for a display pixel seen by several paths, the "mean" of their demands, or the demand
        of the "strongest"
    only_through_plate : only rays that met a plate carry the picture; ignored in a rig without
        plates
    disagreement : for a display pixel where several viewers need different places of the picture,
        the picture at the weighted mean place ("sharp"), or the weighted mean colour ("blended");
        ignored for one viewer
    colours : weights of red, green and blue in the traced light, for glass that absorbs them
    sharpen : after painting, change the source image until all viewers see it nearest to their
        ideal images, through their pupils if they have one
    """

    tolerance: float = 0.1
    max_events: int = 32
    only_through_glass: bool = True
    brightness: bool = False
    effort: int = 16
    margin: int = 0
    wavelength: float = WAVELENGTH
    suppress_glare: float = 0.0
    ghosts: Ghosts = "mean"
    only_through_plate: bool = True
    disagreement: Disagreement = "sharp"
    colours: tuple[float, float, float] = WHITE
    sharpen: bool = False

    @property
    def looks_past_glass(self) -> bool:
        """Whether light past the glass is followed to the display, though it carries no picture."""
        return self.only_through_glass and self.suppress_glare > 0

    def for_rig(self, rig: Rig) -> "Settings":
        """These settings; in a rig without glass, no light has to pass it."""
        return self if rig.glasses else replace(self, only_through_glass=False)

    @property
    def of_optics(self) -> "Settings":
        """These settings, with all painting options at their defaults."""
        return replace(
            self,
            margin=0,
            ghosts="mean",
            suppress_glare=float(self.looks_past_glass),
            disagreement="sharp",
            sharpen=False,
        )

    @property
    def samples_along(self) -> int:
        """Samples along a viewer pixel's side where light is chaotic, at least one per quarter
        pixel.
        """
        return isqrt(int(self.effort))

    def check(self) -> None:
        """Raise RigError for a setting out of bounds."""
        # Blender stores float32
        if not LEAST_TOLERANCE <= round(self.tolerance, 12) <= MOST_TOLERANCE:
            bounds = LEAST_TOLERANCE, MOST_TOLERANCE
            raise out_of_range(OWNER, "Tolerance", self.tolerance, *bounds)

        if self.max_events < 1:
            raise out_of_range(OWNER, "Max Events", self.max_events, 0)

        if not 1 <= self.effort <= MOST_EFFORT or self.effort != int(self.effort):
            raise RigError(
                "Effort is {value}: set a whole number from 1 to {most}.",
                value=f"{self.effort:g}",
                most=MOST_EFFORT,
            )

        if not 0 <= self.suppress_glare <= 1:
            raise out_of_range(OWNER, "Suppress Glare", self.suppress_glare, 0, 1)

        choices = ("Ghosts", self.ghosts, Ghosts), ("Disagreement", self.disagreement, Disagreement)
        for label, value, kind in choices:
            if value not in get_args(kind):
                raise RigError(
                    "{name} is '{value}': set it to one of {choices}.",
                    name=as_message(label),
                    value=value,
                    choices=quoted(get_args(kind)),
                )
