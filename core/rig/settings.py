"""How to solve: the user's choices, and their bounds."""

from dataclasses import dataclass, replace
from math import isqrt
from typing import Literal, get_args

from ..base.errors import RigError
from .rig import WAVELENGTH

Ghosts = Literal["mean", "strongest"]
Disagreement = Literal["sharp", "blended"]
# px; landings are right to about 1e-7 px where the glass is curved
LEAST_TOLERANCE = 1e-6
MOST_TOLERANCE = 100.0
MOST_EFFORT = 4096  # rays for a viewer pixel


@dataclass(frozen=True)
class Settings:
    """How to solve.

    Parameters
    ----------
    tolerance : display pixels by which landings may be off; LEAST_TOLERANCE to MOST_TOLERANCE
    max_events : surfaces a ray may meet before it counts as lost
    only_through_glass : only rays that went through glass carry the picture
    brightness : weigh paths by their throughput (Fresnel) instead of by 1
    effort : rays that sample a viewer pixel where light is chaotic, rounded down to a square;
        up to 3.25 times as many where the display is faint (core/map/samples.py). No pixel takes
        more than 24 times as many, for each display pixel that there is for it
        (core/map/ray_budget.py);
        1 to MOST_EFFORT
    margin : display pixels by which the covered area is grown in the source image
    wavelength : m
    suppress_glare : weight, 0 to 1, of light beside the glass, which shall be
        dark; where only light through glass carries the picture
    ghosts : what a display pixel shows that is seen by several paths: the "mean"
        of what they ask for, or what the "strongest" of them asks for
    only_through_plate : only rays that met a plate carry the picture; of no account in a rig that
        has no plate
    disagreement : what a display pixel shows for which several viewers ask for different places of
        the picture: the picture at the weighted mean of these places ("sharp"), or the weighted
        mean of their colours ("blended"); of no account where there is one viewer
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

    @property
    def looks_beside(self) -> bool:
        """Is light beside the glass followed to the display, though it carries no picture?"""
        return self.only_through_glass and self.suppress_glare > 0

    @property
    def of_optics(self) -> "Settings":
        """These settings, with those that do not count
        before anything is painted at their defaults.
        """
        return replace(
            self,
            margin=0,
            ghosts="mean",
            suppress_glare=float(self.looks_beside),
            disagreement="sharp",
        )

    @property
    def samples_along(self) -> int:
        """Samples along a viewer pixel's side where light is chaotic.

        Each quarter of a pixel has one at least.
        """
        return isqrt(int(self.effort))

    def check(self) -> None:
        """Raise RigError when the tolerance is none that can be kept, or no surface may be met."""
        # Blender keeps it as float32
        if not LEAST_TOLERANCE <= round(self.tolerance, 12) <= MOST_TOLERANCE:
            raise RigError(
                "The tolerance is {tolerance:g} display pixels: set one from {least:g} to"
                " {most:g}.",
                tolerance=self.tolerance,
                least=LEAST_TOLERANCE,
                most=MOST_TOLERANCE,
            )

        if self.max_events < 1:
            raise RigError("A ray may meet {n} surfaces: allow it 1 or more.", n=self.max_events)

        if not 1 <= self.effort <= MOST_EFFORT or self.effort != int(self.effort):
            raise RigError(
                "Effort is {n} rays for a viewer pixel: set a whole number from 1 to {most}.",
                n=self.effort,
                most=MOST_EFFORT,
            )

        if not 0 <= self.suppress_glare <= 1:
            raise RigError(
                "Suppress Glare is {suppress_glare:g}: set it from 0 to 1.",
                suppress_glare=self.suppress_glare,
            )

        if self.ghosts not in get_args(Ghosts):
            raise RigError(
                "Ghosts is '{ghosts}': set it to 'mean' or 'strongest'.", ghosts=self.ghosts
            )

        if self.disagreement not in get_args(Disagreement):
            raise RigError(
                "Disagreement is '{disagreement}': set it to 'sharp' or 'blended'.",
                disagreement=self.disagreement,
            )
