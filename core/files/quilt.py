"""Quilts as files: their name, their views, and the interlaced image for a lens sheet.

Players read the tiling from a quilt's name: `_qs8x6a0.75` means 8 x 6 tiles whose width is
0.75 of their height (https://docs.lookingglassfactory.com/keyconcepts/quilts).
"""

import json
import re
from dataclasses import dataclass
from math import atan, cos
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.errors import MALFORMED, ImageError
from ..rig.views import Size, tile_corner

MARK = re.compile(r"_qs\d+x\d+(a[\d.]+)?$")
ROWS_AT_ONCE = 64
MOST_PIXELS = 1 << 28  # of an interlaced image


def quilt_name(path: Path, tiling: Size, aspect: float) -> Path:
    """The path with the name players read; the aspect is the display's width over its height."""
    columns, rows = tiling
    return path.with_stem(f"{MARK.sub('', path.stem)}_qs{columns}x{rows}a{aspect:.5g}")


def tile_size(quilt: NDArray, tiling: Size) -> Size:
    """Width and height, px, of the tiles of a quilt (H, W, ...)."""
    return quilt.shape[1] // tiling[0], quilt.shape[0] // tiling[1]


def tile_of(quilt: NDArray, view: int, tiling: Size) -> NDArray:
    """One view (h, w, ...) of a quilt (H, W, ...), row 0 at the top."""
    width, height = size = tile_size(quilt, tiling)
    left, top = tile_corner(view, tiling, size)
    return quilt[top : top + height, left : left + width]


@dataclass(frozen=True)
class LensSheet:
    """A sheet of slanted cylinder lenses over a panel whose pixels have red, green and blue parts
    side by side, as in a Looking Glass's calibration (visual.json).

    pitch : lenses an inch, across them
    slope : drop of a lens for each unit to the right
    centre : phase of the lenses at the lower left corner, in lenses
    per_inch : pixels an inch
    width, height : px of the panel
    is_inverted : views follow from right to left under a lens, as on all of these devices
    is_flipped : the panel shows its image mirrored
    is_bgr : blue is the leftmost part
    """

    pitch: float
    slope: float
    centre: float
    per_inch: float
    width: int
    height: int
    is_inverted: bool = True
    is_flipped: bool = False
    is_bgr: bool = False

    def check(self) -> None:
        """Raise ImageError for numbers that no sheet has."""
        numbers = self.pitch, self.slope, self.centre, self.per_inch
        if not (np.isfinite(numbers).all() and self.pitch > 0 and self.slope and self.per_inch > 0):
            raise ImageError(
                "The lens sheet has pitch {pitch:g}, slope {slope:g} and {dpi:g} pixels an inch:"
                " set each to its calibrated number.",
                pitch=self.pitch,
                slope=self.slope,
                dpi=self.per_inch,
            )
        if not (min(self.width, self.height) > 0 and self.width * self.height <= MOST_PIXELS):
            raise ImageError(
                "The lens sheet covers {width} x {height} pixels: set the panel's own resolution.",
                width=self.width,
                height=self.height,
            )

    def phase(self, rows: NDArray[np.integer]) -> Floats:
        """Place (n, width, 3) under their lens, 0..1, of the parts of the pixels in rows (n,), row
        0 at the top.

        The rule is that of van Berkel, Image preparation for 3D-LCD, Proc. SPIE 3639 (1999),
        84-91: the distance from the lens's edge along the row, over the lens's width along it.
        Lenses are `pitch` an inch across, and cos(atan(1 / slope)) of that along a row.
        """
        along = (self.pitch / self.per_inch) * cos(atan(1 / self.slope))
        slant = (-1 if self.is_flipped else 1) / self.slope
        x = np.arange(self.width)[:, None] + 0.5 + np.array([0, 1, 2])[None] / 3
        y = self.height - 0.5 - rows
        place = along * (x + slant * y[:, None, None]) - self.centre
        place = np.mod(place, 1.0)
        place = 1 - place if self.is_inverted else place
        return place[..., ::-1] if self.is_bgr else place


def read_lens_sheet(path: Path) -> LensSheet:
    """The lens sheet of a device's calibration.

    Raises
    ------
    ImageError : the file is missing, or not a calibration
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))

        def value(name: str, default: float | None = None) -> Any:
            entry = found[name] if default is None else found.get(name, default)
            return float(entry["value"] if isinstance(entry, dict) else entry)

        sheet = LensSheet(
            pitch=value("pitch"),
            slope=value("slope"),
            centre=value("center"),
            per_inch=value("DPI"),
            width=int(value("screenW")),
            height=int(value("screenH")),
            is_inverted=value("invView", 1) >= 0.5,
            is_flipped=value("flipImageX", 0) >= 0.5,
            is_bgr=value("flipSubp", 0) >= 0.5,
        )
        cells = found.get("subpixelCells")
    except OSError:
        raise ImageError(
            "The calibration '{path}' cannot be read: choose the device's visual.json.", path=path
        ) from None
    except MALFORMED:
        raise ImageError(
            "'{path}' is not the calibration of a lens sheet: choose the device's visual.json.",
            path=path,
        ) from None
    if cells:
        raise ImageError(
            "The panel of '{path}' has its colours in cells, not side by side: export the quilt,"
            " which the device's player interlaces.",
            path=path,
        )
    sheet.check()
    return sheet


def interlaced(quilt: NDArray[np.float32], tiling: Size, sheet: LensSheet) -> NDArray[np.float32]:
    """The image (height, width, 3) that a panel shows under its lens sheet, for a quilt (H, W, 3)
    of a single row of views: each part of a pixel is that of the view its lens sends its way.

    Views share the width of a lens evenly. Places are the nearest ones, so that no colours mix.
    """
    n = tiling[0] * tiling[1]
    width, height = size = tile_size(quilt, tiling)
    image = np.empty((sheet.height, sheet.width, 3), np.float32)
    column = ((np.arange(sheet.width) + 0.5) / sheet.width * width).astype(int)[:, None]
    colour = np.arange(3)
    for first in range(0, sheet.height, ROWS_AT_ONCE):
        rows = np.arange(first, min(first + ROWS_AT_ONCE, sheet.height))
        view = np.minimum((sheet.phase(rows) * n).astype(int), n - 1)
        row = ((rows + 0.5) / sheet.height * height).astype(int)[:, None, None]
        left, top = tile_corner(view, tiling, size)
        image[rows] = quilt[top + row, left + column, colour]
    return image
