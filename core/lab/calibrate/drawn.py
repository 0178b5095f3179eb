"""The calibration lattice and its picture.

Viewer pixels: x right and y down from the upper left corner, pixel centres at + 0.5. In texts,
columns count from the left and rows from the top, both from 1.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...base.errors import ImageError


@dataclass(frozen=True)
class LatticeDrawing:
    """Sizes of a drawn lattice, in spacings of its points.

    dot : radius of the dots
    mark : radius of the first two dots
    line : half width of lines
    least_px : px, least radius of dots or half width of lines
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

    margin : distance of the outer points from the borders, in widths and heights
    """

    columns: int
    rows: int
    margin: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 2:
            raise ImageError(
                "A lattice of {columns} x {rows} points is too small. Set 2 or more in each"
                " direction.",
                columns=self.columns,
                rows=self.rows,
            )
        if not 0 <= self.margin < 0.5:
            raise ImageError(
                "A lattice cannot have a margin of {margin:g}. Set it to 0 or more, below 0.5.",
                margin=self.margin,
            )

    def __len__(self) -> int:
        return self.columns * self.rows

    @property
    def uv(self) -> Floats:
        """UV (rows * columns, 2) of the points, row by row from the upper left; v up."""
        across, down = (
            self.margin + (1 - 2 * self.margin) * np.linspace(0, 1, n)
            for n in (self.columns, self.rows)
        )
        u, v = np.meshgrid(across, 1 - down)
        return np.stack([u.ravel(), v.ravel()], axis=1)

    def image(self, width: int, height: int, style: Style = "dots") -> NDArray[np.float32]:
        """The picture (height, width, 3), linear: bright dots, or lines crossing at the points, on
        black.

        Marks show the rotation and, from three columns on, the mirroring: the first two dots of the
        upper row are larger. With lines, the first two fields contain a dot, the first a larger
        one.
        """
        size = np.array([width, height], float)
        at = np.stack([self.uv[:, 0], 1 - self.uv[:, 1]], axis=1) * size
        pitch = (1 - 2 * self.margin) * size / (self.columns - 1, self.rows - 1)
        spacing = pitch.min()
        room = self.margin * size.min()

        # thick enough to be visible, small enough for the margin
        thin = DRAWING.line if style == "grid" else DRAWING.dot
        if spacing * thin < DRAWING.least_px:
            raise ImageError(
                "{columns} x {rows} points do not fit into {width} x {height} pixels. Set fewer"
                " points, or {pixels:.0f} pixels.",
                columns=self.columns,
                rows=self.rows,
                width=width,
                height=height,
                pixels=np.ceil(DRAWING.least_px / thin / spacing * max(width, height)),
            )

        if room < (DRAWING.mark if style == "dots" else 5 * DRAWING.line) * spacing:
            raise ImageError(
                "A margin of {margin:g} would cut the outer points. Set it to half a spacing"
                " ({half:.2g}).",
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
        """A point's name in texts: (column, row)."""
        return f"({index % self.columns + 1}, {index // self.columns + 1})"


def _lines(at: Floats, pitch: Floats, size: tuple[int, int]) -> Floats:
    """Coverage (h, w) of lines through points (rows * columns, 2), px, in an image of size (w, h).

    pitch : (2,) px, distance of the points; lines extend half a pitch beyond the outer ones
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
    """Draw discs with one-pixel edges onto a coverage image (h, w)."""
    height, width = cover.shape
    for centre, radius in zip(centres, radii, strict=True):
        x0, y0 = np.floor(centre - radius - 1).astype(int).clip(0)
        x1, y1 = np.ceil(centre + radius + 1)
        y, x = np.mgrid[y0 : min(int(y1), height), x0 : min(int(x1), width)] + 0.5
        patch = cover[y0 : y0 + y.shape[0], x0 : x0 + y.shape[1]]
        disc = np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1)
        np.maximum(patch, disc, out=patch)
