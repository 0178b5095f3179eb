"""Which files of warp maps are wanted."""

from dataclasses import dataclass

import numpy as np

from ...base.errors import RigError
from ...base.free_memory import check_free
from ...base.messages import Message
from ...rig.rig import PicturePlace, Rig

# the files of each format
FORMATS = {
    "EXR": ("warp.exr", "view.exr"),
    "FFMPEG": ("x.pgm", "y.pgm"),
    "OBJ": ("warp.obj",),
    "DATA": ("warp.data",),
    "NPZ": ("warp.npz",),
    "PNG": ("warp.png",),
}
TIMES = (1, 2, 4)
MOST_OVERSCAN = 100.0
# m, red, green and blue: dominant wavelengths of the primaries of ITU-R BT.709, as of sRGB
PRIMARIES = (611e-9, 549e-9, 464e-9)
BYTES = 600  # of a point of a map, at the peak: measured where each is seen ten times
NOTHING = 65535  # in a .pgm; beyond every image, so that ffmpeg fills it


def wavelengths_for(rig: Rig, wavelength: float) -> tuple[float, ...]:
    """The wavelengths, m, that a rig needs maps for: where its glass disperses, those of a
    display's colours, else the one that it is solved for.
    """
    disperses = any(len({glass.ior.at(one) for one in PRIMARIES}) > 1 for glass in rig.glasses)
    return PRIMARIES if disperses else (wavelength,)


@dataclass(frozen=True)
class MapOptions:
    """Which files are wanted.

    formats : keys of FORMATS
    overscan : per cent by which the picture's image is larger than the picture at each side
    times : size of the maps for ffmpeg, in display pixels
    mesh_step : display px, about, between the nodes of meshes; the display's size at most
    """

    formats: tuple[str, ...] = ("EXR",)
    overscan: float = 0.0
    times: int = 2
    mesh_step: float = 8.0

    def check(self) -> None:
        """Raise RigError when nothing is wanted, or something that cannot be."""
        if not self.formats:
            raise RigError("No format is chosen for the maps: choose one or more.")
        if not 0 <= self.overscan <= MOST_OVERSCAN:
            raise RigError(
                "Overscan is {overscan:g} %: set it from 0 to {most:g}.",
                overscan=self.overscan,
                most=MOST_OVERSCAN,
            )
        if self.times not in TIMES:
            raise RigError(
                "The maps for ffmpeg cannot be {times} times as large as the display: set 1, 2"
                " or 4.",
                times=self.times,
            )
        if not 1 <= self.mesh_step < np.inf:
            raise RigError(
                "The mesh step is {step:g} display pixels: set 1 or more.", step=self.mesh_step
            )

    def check_for(self, place: PicturePlace) -> None:
        """Raise RigError when a format has no room for the pixels of a picture."""
        if "FFMPEG" in self.formats and self.times * max(place.width, place.height) > NOTHING:
            raise RigError(
                "The picture '{picture}' has {width} x {height} pixels, and the maps for ffmpeg,"
                " {times} x, have room for {most}: set a smaller ffmpeg Size, or other formats.",
                picture=place.name,
                width=place.width,
                height=place.height,
                times=self.times,
                most=NOTHING // self.times,
            )


def memory_needed(display_size: tuple[int, int], options: MapOptions) -> float:
    """Bytes that the maps of a viewer take at their peak, about."""
    width, height = display_size
    larger = options.times**2 if "FFMPEG" in options.formats and options.times > 1 else 0
    return BYTES * width * height * (1 + larger)


def check_memory(rig: Rig, options: MapOptions) -> None:
    """Raise RigError when the maps of a viewer would take more memory than is free."""
    display = rig.display
    remedy = Message(
        "lower the resolution of the display '{display}' ({width} x {height})",
        display=display.name,
        width=display.width,
        height=display.height,
    )
    if "FFMPEG" in options.formats and options.times > 1:
        remedy = Message("set a smaller ffmpeg Size, or other formats")
    needed = memory_needed((display.width, display.height), options)
    check_free(needed, Message("Exporting maps"), remedy)
