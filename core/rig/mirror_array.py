"""The mirrors of a plate."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..base.errors import RigError, not_finite, out_of_range

MOST_CROSSING_ERROR = np.radians(10.0)
LEAST_REFLECTANCE = 0.001  # of the interface


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
        for label, length in (("Pitch", self.pitch), ("Mirror Height", self.height)):
            if not (np.isfinite(length) and length > 0):
                raise out_of_range(owner, label, f"{1e3 * length:g} mm", 0)

        if not 0 < self.reflectance <= 1:
            raise out_of_range(owner, "Reflectance", self.reflectance, LEAST_REFLECTANCE, 1)

        if not (np.isfinite(self.ior) and self.ior >= 1):
            raise out_of_range(owner, "IOR", self.ior, 1)

        if not abs(self.crossing_error) <= MOST_CROSSING_ERROR:
            most = np.degrees(MOST_CROSSING_ERROR)
            value = f"{np.degrees(self.crossing_error):g}\N{DEGREE SIGN}"
            raise out_of_range(owner, "Crossing Error", value, -most, most)

        if self.crossing_error and self.layout != "crossed":
            raise RigError("{owner} has one layer: set Crossing Error to 0.", owner=owner)

        if not np.isfinite(self.phase).all():
            raise not_finite(owner)
