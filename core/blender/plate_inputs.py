"""The inputs of the plate's node group."""

from typing import NamedTuple

from ..rig.rig import MOST_CROSSING_ERROR, MirrorArray


class Input(NamedTuple):
    """An input of the plate's node group."""

    name: str
    subtype: str
    default: float
    lowest: float
    highest: float
    tooltip: str


_MMAP = MirrorArray()
PLATE_INPUTS = (
    Input("Pitch", "DISTANCE", _MMAP.pitch, 1e-9, 1e3,
    "From mirror to mirror; larger ones blur the image"),
    Input("Height", "DISTANCE", _MMAP.height, 0.0, 1e3,
    "Of the mirrors in one layer; high ones image steep light"),
    Input("IOR", "NONE", _MMAP.ior, 1.0, 100.0,
    "Index of refraction of the glass between the mirrors"),
    Input("Reflectance", "FACTOR", _MMAP.reflectance, 0.0, 1.0,
    "Of a mirror; each reflection dims light by it"),
    Input(
        "Crossing Error", "ANGLE", 0.0, -MOST_CROSSING_ERROR, MOST_CROSSING_ERROR,
        "By which the layers are crossed at more than 90 degrees; it blurs the image",
    ),
    Input("Phase 1", "NONE", 0.0, -1.0, 1.0,
    "In pitches, by which the first mirrors stand beside the origin"),
    Input("Phase 2", "NONE", 0.0, -1.0, 1.0,
    "In pitches, by which the second mirrors stand beside the origin"),
    Input("Fresnel", "FACTOR", 1.0, 0.0, 1.0,
    "1: the plate's two faces reflect as glass does; 0: they do not"),
)  # fmt: skip
LIGHT_INPUTS = (
    Input("Image", "FACTOR", 1.0, 0.0, 1.0, "How much is seen of the mid-air image"),
    Input(
        "Stray 1",
        "FACTOR",
        1.0,
        0.0,
        1.0,
        "How much is seen of the light that only the first mirrors turn round",
    ),
    Input(
        "Stray 2",
        "FACTOR",
        1.0,
        0.0,
        1.0,
        "How much is seen of the light that only the second mirrors turn round",
    ),
    Input(
        "Through", "FACTOR", 1.0, 0.0, 1.0, "How much is seen of what is straight behind the plate"
    ),
    Input(
        "Reflected", "FACTOR", 1.0, 0.0, 1.0, "How much is seen of what the plate's face reflects"
    ),
)
