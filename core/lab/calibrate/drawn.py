"""A calibration lattice: drawn, found in a photograph or
read from a file, and its points told apart.

Pixels as the viewer's: x right and y down from the upper left corner, pixel centres at +
0.5. People count columns from the left and rows from the top, both from 1.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...base.errors import ImageError


@dataclass(frozen=True)
class LatticeDrawing:
    """How a lattice is drawn, in spacings of its points.

    dot, mark : radii of dots, and of the first two
    line : half the width of lines
    least_px : px, radius of the dots or half the width of the lines, at the least
    """

    dot: float = 0.2
    mark: float = 0.26
    line: float = 0.04
    least_px: float = 1.0


DRAWING = LatticeDrawing()
Style = Literal["dots", "grid"]


@dataclass(frozen=True)
class Lattice:
    """A picture of columns x rows points.

    The outer ones stand a margin, in widths and heights, inside its borders.
    """

    columns: int
    rows: int
    margin: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 2:
            raise ImageError(
                "A lattice of {columns} x {rows} points is too small: take 2 or more each way.",
                columns=self.columns,
                rows=self.rows,
            )
        if not 0 <= self.margin < 0.5:
            raise ImageError(
                "A lattice cannot have a margin of {margin:g}: set one from 0 to below 0.5.",
                margin=self.margin,
            )

    def __len__(self) -> int:
        return self.columns * self.rows

    @property
    def uv(self) -> Floats:
        """Where the points stand on the picture (rows *
        columns, 2), row by row from the upper left; v up.
        """
        across, down = (
            self.margin + (1 - 2 * self.margin) * np.linspace(0, 1, n)
            for n in (self.columns, self.rows)
        )
        u, v = np.meshgrid(across, 1 - down)
        return np.stack([u.ravel(), v.ravel()], axis=1)

    def image(self, width: int, height: int, style: Style = "dots") -> NDArray[np.float32]:
        """The picture (height, width, 3), linear: bright dots,
        or lines that cross in the points, on black.

        Whoever looks can tell how it is turned and, of three columns or more, whether it is
        mirrored: the first two dots of the upper row are larger; of lines the first two fields hold
        a dot, the first a larger one.
        """
        size = np.array([width, height], float)
        at = np.stack([self.uv[:, 0], 1 - self.uv[:, 1]], axis=1) * size
        pitch = (1 - 2 * self.margin) * size / (self.columns - 1, self.rows - 1)
        spacing = pitch.min()
        room = self.margin * size.min()

        # as large as can be seen, and within the margin
        thin = DRAWING.line if style == "grid" else DRAWING.dot
        if spacing * thin < DRAWING.least_px:
            raise ImageError(
                "{columns} x {rows} points do not fit into {width} x {height} pixels: take"
                " fewer points, or {pixels:.0f} pixels.",
                columns=self.columns,
                rows=self.rows,
                width=width,
                height=height,
                pixels=np.ceil(DRAWING.least_px / thin / spacing * max(width, height)),
            )

        if room < (DRAWING.mark if style == "dots" else 5 * DRAWING.line) * spacing:
            raise ImageError(
                "A margin of {margin:g} would cut the outer points: set one of half a"
                " spacing, {half:.2g}.",
                margin=self.margin,
                half=0.5 / min(self.columns, self.rows),
            )

        if style == "grid":
            cover = _lines(at, pitch, (width, height))
            n_marks = min(2, self.columns - 1)
            at = at[:n_marks] + pitch / 2
            radii = spacing * np.array([DRAWING.dot, DRAWING.dot / 2])[:n_marks]
        else:
            cover = np.zeros((height, width))
            radii = spacing * np.r_[DRAWING.mark, DRAWING.mark, np.full(len(self) - 2, DRAWING.dot)]

        _add_discs(cover, at, radii)
        return np.repeat(cover[..., None], 3, axis=2).astype(np.float32)

    def name(self, index: int) -> str:
        """A point as people call it: (column, row)."""
        return f"({index % self.columns + 1}, {index // self.columns + 1})"


def _lines(at: Floats, pitch: Floats, size: tuple[int, int]) -> Floats:
    """Cover (h, w) of lines through points (rows * columns, 2), px, that stand a pitch (2,)
    apart, on an image of a size (w, h): they go on for half a pitch.
    """
    width, height = size
    spacing = pitch.min()
    cover = np.zeros((height, width))
    x = np.arange(width) + 0.5
    y = np.arange(height) + 0.5
    left, top = at[0] - 0.5 * pitch
    right, bottom = at[-1] + 0.5 * pitch
    long_x, long_y = (
        np.clip(np.minimum(a - lo, hi - a) + 0.5, 0, 1)
        for a, lo, hi in ((x, left, right), (y, top, bottom))
    )

    for across in np.unique(at[:, 0]):
        thin = np.clip(DRAWING.line * spacing + 0.5 - np.abs(x - across), 0, 1)
        np.maximum(cover, thin * long_y[:, None], out=cover)

    for down in np.unique(at[:, 1]):
        thin = np.clip(DRAWING.line * spacing + 0.5 - np.abs(y - down), 0, 1)
        np.maximum(cover, thin[:, None] * long_x, out=cover)

    return cover


def _add_discs(cover: Floats, centres: Floats, radii: Floats) -> None:
    """Draw discs onto a cover (h, w), whose edges are one pixel wide."""
    height, width = cover.shape
    for centre, radius in zip(centres, radii, strict=True):
        x0, y0 = np.floor(centre - radius - 1).astype(int).clip(0)
        x1, y1 = np.ceil(centre + radius + 1)
        y, x = np.mgrid[y0 : min(int(y1), height), x0 : min(int(x1), width)] + 0.5
        patch = cover[y0 : y0 + y.shape[0], x0 : x0 + y.shape[1]]
        disc = np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1)
        np.maximum(patch, disc, out=patch)
