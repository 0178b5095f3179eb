"""The mirrors of a plate."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..base.errors import RigError

MOST_CROSSING_ERROR = np.radians(10.0)


@dataclass(frozen=True)
class MirrorArray:
    """A plate of upright micro mirrors in glass, in two perpendicular directions that form corners.

    Parameters
    ----------
    layout : "crossed", two stacked layers of slits (MMAP); "holes", square holes with both
        directions in one layer (DCRA); "radial", holes rotated with the azimuth about the plate's
        centre
    pitch : m, from mirror to mirror
    height : m, of the mirrors in one layer
    ior : index of refraction of the glass between the mirrors
    reflectance : of a mirror, above 0, up to 1
    crossing_error : rad, deviation of the second layer from 90 degrees to the first
    has_fresnel : the plate's two faces reflect as glass does
    phase : in pitches, offset of the mirrors of each direction from the plate's centre
    """

    layout: Literal["crossed", "holes", "radial"] = "crossed"
    pitch: float = 0.5e-3
    height: float = 1.25e-3
    ior: float = 1.52
    reflectance: float = 0.87
    crossing_error: float = 0.0
    has_fresnel: bool = True
    phase: tuple[float, float] = (0.0, 0.0)

    @property
    def n_layers(self) -> int:
        return 2 if self.layout == "crossed" else 1

    @property
    def thickness(self) -> float:
        """From face to face, m."""
        return self.n_layers * self.height

    def check(self, owner: str) -> None:
        """Raise RigError for an impossible plate."""
        for name, value in (("pitch", self.pitch), ("mirror height", self.height)):
            if not (np.isfinite(value) and value > 0):
                raise RigError(
                    "{owner} has a {name} of {value:g} mm: set one above 0.",
                    owner=owner,
                    name=name,
                    value=1e3 * value,
                )

        if not 0 < self.reflectance <= 1:
            raise RigError(
                "{owner} has mirrors with a reflectance of {reflectance:g}: set one above"
                " 0, up to 1.",
                owner=owner,
                reflectance=self.reflectance,
            )

        if not (np.isfinite(self.ior) and self.ior >= 1):
            raise RigError(
                "{owner} has an index of refraction of {ior:g}: set one of 1 or more.",
                owner=owner,
                ior=self.ior,
            )

        if not abs(self.crossing_error) <= MOST_CROSSING_ERROR:
            raise RigError(
                "{owner} has layers crossed {angle:g} degrees wrong: set at most {most:g}.",
                owner=owner,
                angle=np.degrees(self.crossing_error),
                most=np.degrees(MOST_CROSSING_ERROR),
            )

        if self.crossing_error and self.layout != "crossed":
            raise RigError(
                "{owner} has one layer only, which cannot be crossed wrong: set the"
                " crossing error to 0.",
                owner=owner,
            )

        if not np.isfinite(self.phase).all():
            raise RigError(
                "{owner} has a phase that is no number: set one in pitches.", owner=owner
            )
