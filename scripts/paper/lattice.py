"""How far the dots of the lattice are from where they are wanted, as Cycles shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from kiriko.core.blender.preview.cycles_preview import render_preview
from kiriko.core.blender.read.scene import Reading
from kiriko.core.image.seen_image import LatticeShift, dot_centroids, ideal_image
from kiriko.core.rig.rig import Viewer

ACROSS = 1165  # viewer pixels from the first to the last dot, as in the paper's photographs
SAMPLES = 4  # the optics is delta: more only smooth the edges of display pixels


def framed(viewer: Viewer, width: int, crop: tuple[int, int, int, int]) -> Viewer:
    """The part (left, top, right, bottom; px) of a viewer's image at another width of the whole, as
    a viewer.
    """
    height = round(width * viewer.height / viewer.width)
    x0, y0, x1, y1 = crop
    left, right, bottom, top = viewer.window
    window = (
        left + (right - left) * x0 / width,
        left + (right - left) * x1 / width,
        top + (bottom - top) * y1 / height,
        top + (bottom - top) * y0 / height,
    )
    return replace(viewer, window=window, width=x1 - x0, height=y1 - y0)


def measuring_width(reading: Reading, ideal: np.ndarray) -> int:
    """Width of the frame at which the lattice is ACROSS pixels wide, from the ideal image (h, w, 3)
    at any size.
    """
    dots = dot_centroids(ideal)
    span = np.nanmax(dots[..., 0]) - np.nanmin(dots[..., 0])
    return round(reading.rig.viewer.width * ACROSS / span)


@dataclass(frozen=True, eq=False)
class Dots:
    """Where a render shows the dots of the lattice: (n, n, 2) px of a whole frame, NaN where a dot
    is not seen.

    size : width and height of the frame, px
    crop : left, top, right and bottom of the part of it that was rendered, px
    """

    shown: np.ndarray
    size: tuple[int, int]
    crop: tuple[int, int, int, int]


def shift_in_cycles(
    scene: bpy.types.Scene,
    reading: Reading,
    source: np.ndarray,
    ideal: np.ndarray,
    seen: np.ndarray,
    samples: int = SAMPLES,
) -> LatticeShift:
    """Displacement of the lattice in a Cycles render, ACROSS pixels from dot to dot, against the
    ideal image; as `dots_in_cycles`.
    """
    dots = dots_in_cycles(scene, reading, source, ideal, seen, samples)
    part = framed(reading.rig.viewer, dots.size[0], dots.crop)
    wanted = dot_centroids(ideal_image(reading.rig.picture, part)) + dots.crop[:2]
    return LatticeShift(dots.shown - wanted)


def dots_in_cycles(
    scene: bpy.types.Scene,
    reading: Reading,
    source: np.ndarray,
    ideal: np.ndarray,
    seen: np.ndarray,
    samples: int = SAMPLES,
) -> Dots:
    """The dots of the lattice in a Cycles render, ACROSS pixels from the first to the last.

    source (H, W, 3) is on the display; ideal and seen (h, w, 3) are core's images of the viewer's
    own size. `seen` shows which part of the frame has the dots, so only this part is rendered.
    """
    viewer = reading.rig.viewer
    width = measuring_width(reading, ideal)
    height = round(width * viewer.height / viewer.width)
    y, x = np.nonzero(np.maximum(ideal, seen)[..., 0] > 1e-3)
    scale = width / viewer.width
    margin = 8
    crop = (
        max(0, int(x.min() * scale) - margin),
        max(0, int(y.min() * scale) - margin),
        min(width, int((x.max() + 1) * scale) + margin),
        min(height, int((y.max() + 1) * scale) + margin),
    )

    # Blender rounds a border to pixels from fractions of the
    # frame: the middle of the last pixel is safe
    left, right = ((x + 0.01) / width for x in (crop[0], crop[2]))
    low, high = (1 - (y - 0.01) / height for y in (crop[3], crop[1]))
    border = left, right, low, high
    render = render_preview(
        scene, reading, source, size=(width, height), border=border, samples=samples, fresnel=False
    )[..., :3]
    wanted = crop[3] - crop[1], crop[2] - crop[0], 3
    if render.shape != wanted:
        raise ValueError(f"Cycles rendered {render.shape} instead of {wanted}")
    return Dots(dot_centroids(render) + crop[:2], (width, height), crop)
