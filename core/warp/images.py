"""STMaps as image files: OpenEXR, and PNG for programs that read none.

Their numbers are places, no colours: no curve is put on them.
"""

from pathlib import Path

import numpy as np

from ..files import image_io, png
from .stmap import STMap

# outside of every image, so that programs show nothing there
NOWHERE = -1.0
# Blender takes a file with dots in the names of channels for one of render layers, without a size
CHANNELS = (
    "R",
    "G",
    "B",
    "A",
    "multiplicity",
    *(f"jacobian_{of}" for of in ("xx", "xy", "yx", "yy")),
)
TOP = 65535  # the largest number of 16 bits


def write_exr(path: Path, stmap: STMap, about: str) -> None:
    """Write a map as 32-bit OpenEXR: R = s, G = t, B = coverage, A = 1, and more channels.

    Raises
    ------
    ImageError : it cannot be written, or there is no OpenImageIO
    """
    oiio = image_io.openimageio()
    width, height = stmap.size
    pixels = np.empty((height, width, len(CHANNELS)), np.float32)
    pixels[..., :2] = np.where(np.isfinite(stmap.st), stmap.st, NOWHERE)
    pixels[..., 2] = stmap.coverage
    pixels[..., 3] = 1.0
    pixels[..., 4] = stmap.multiplicity
    pixels[..., 5:] = stmap.jacobian.reshape(height, width, 4)

    spec = oiio.ImageSpec(width, height, len(CHANNELS), "float")
    spec.channelnames = CHANNELS
    spec.alpha_channel = CHANNELS.index("A")
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "data")
    spec.attribute("Software", "Kiriko")
    spec.attribute("ImageDescription", about)
    image_io.put(path, spec, pixels)


def write_png(path: Path, stmap: STMap, about: str) -> None:
    """Write a map as 16-bit PNG: R = s, G = t, B = coverage, each times 65535; 0 where there
    is nothing.
    """
    there = stmap.is_there[..., None]
    values = np.concatenate([stmap.st, stmap.coverage[..., None]], axis=2)
    numbers = np.rint(np.clip(np.where(there, values, 0.0), 0, 1) * TOP).astype(np.uint16)
    if not image_io.has_openimageio():
        png.write(path, numbers)
        return

    oiio = image_io.openimageio()
    spec = oiio.ImageSpec(*stmap.size, 3, "uint16")
    spec.attribute("oiio:ColorSpace", "data")
    spec.attribute("Software", "Kiriko")
    spec.attribute("ImageDescription", about)
    image_io.put(path, spec, numbers)
