"""The conflict of several viewers as a false-colour image of the result."""

from typing import NamedTuple

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arrays import Bools, Floats
from ...files.encoding import linear_from_srgb
from ..data.image import pack, set_pixels
from ..data.rigs import name_for
from .write_result import has_size_of, let_go, replace_image, unpacked_image

CONFLICT = "Kiriko Conflict"
LEAST = {"px": 0.01, "white": 1 / 255}  # smallest end of the scale: lower values are rounding


class Conflict(NamedTuple):
    """Disagreement of several viewers about each display pixel.

    of_pixel : (H, W)
    is_seen : (H, W), seen by any of them
    unit : "px" of the picture for places, "white" for colours
    """

    of_pixel: Floats
    is_seen: Bools
    unit: str

    @property
    def largest(self) -> float:
        """Maximum over all pixels."""
        return float(self.of_pixel.max(initial=0.0))


def colours(conflict: Conflict) -> NDArray[np.float32]:
    """Pixels (H, W, 3), linear: dark for 0, bright for the largest, black if unseen."""
    end = max(conflict.largest, LEAST[conflict.unit])
    shown = linear_from_srgb(viridis(conflict.of_pixel.ravel() / end))
    shown = shown.reshape(*conflict.of_pixel.shape, 3)
    return np.where(conflict.is_seen[..., None], shown, 0.0).astype(np.float32)


def write_conflict(scene: bpy.types.Scene, conflict: Conflict | None, is_packed: bool) -> None:
    """Write a conflict into the result's image, or remove the image.

    is_packed : pack it into the file at once; else `pack_conflict` does it later
    """
    result = scene.kiriko.result
    old = result.conflict
    if conflict is None:
        result.conflict = None
        if old is not None:
            let_go(result, old)
        return

    name, pixels = name_for(scene, CONFLICT), colours(conflict)
    if is_packed:
        result.conflict = replace_image(old, name, pixels)
    elif has_size_of(old, pixels):
        set_pixels(old, pixels)
    else:
        result.conflict = unpacked_image(old, name, pixels)


def pack_conflict(scene: bpy.types.Scene) -> None:
    """Pack the image into the file, unless it is."""
    image = scene.kiriko.result.conflict
    if image is not None and image.is_dirty:
        pack(image, image.name)


# matplotlib's viridis by S. van der Walt and N. Smith (CC0), at quarters of its length
ANCHORS = np.array(
    [
        (0.267, 0.005, 0.329),
        (0.229, 0.322, 0.546),
        (0.128, 0.567, 0.551),
        (0.369, 0.789, 0.383),
        (0.993, 0.906, 0.144),
    ]
)


def viridis(values: ArrayLike) -> Floats:
    """Colours (n, 3), sRGB, of values (n,) 0..1."""
    at = np.clip(values, 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(ANCHORS))
    return np.stack([np.interp(at, places, column) for column in ANCHORS.T], axis=-1)
