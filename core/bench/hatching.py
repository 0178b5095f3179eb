"""Hatches the part of a picture that is lost."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Hatch:
    """How a lost part is found and hatched. Looked at in Blender, on pictures from 10 to 1000 px.

    n_grid : rays each way, spread over the picture; each stands for the part around it
    n_lines : hatch lines that cross a picture as wide as high from corner to corner
    n_looks : places at which each line is asked whether it is on a lost part, for each ray it
        passes by
    """

    n_grid: int = 40
    n_lines: int = 36
    n_looks: int = 4


HATCH = Hatch()


def grid() -> Floats:
    """Places (n n, 2) on the picture, 0..1, row by row from below: the middles of its parts."""
    middles = (np.arange(HATCH.n_grid) + 0.5) / HATCH.n_grid
    u, v = np.meshgrid(middles, middles)
    return np.stack([u.ravel(), v.ravel()], axis=1)


def hatched(is_lost: Bools, size: tuple[float, float]) -> Floats:
    """Hatch lines (l, 2, 2) on the lost part, by the places of their ends on the picture, 0..1.

    Parameters
    ----------
    is_lost : (n n,) of the parts around `grid`
    size : width and height of the picture, m, so that lines rise at 45 degrees
    """
    if not (is_lost.any() and min(size) > 0):
        return np.empty((0, 2, 2))
    width, height = np.array(size) / max(size)

    # lines y = x + c on a picture of this width and height
    step = 2 / HATCH.n_lines
    offsets = np.arange(-width + step / 2, height, step)
    lines = [_on_line(is_lost, offset, width, height) for offset in offsets]
    return np.concatenate(lines)


def _on_line(is_lost: Bools, offset: float, width: float, height: float) -> Floats:
    """The pieces (l, 2, 2) of one line y = x + offset that lie on lost parts."""
    start = max(0.0, -offset)
    stop = min(width, height - offset)
    n_looks = max(1, round((stop - start) * HATCH.n_grid * HATCH.n_looks / min(width, height)))
    ends = np.linspace(start, stop, n_looks + 1)
    middles = (ends[1:] + ends[:-1]) / 2
    places = np.stack([middles / width, (middles + offset) / height], axis=1)

    # where it goes onto lost parts, and off them
    on = np.concatenate([[False], is_lost[_part_at(places)], [False]])
    first = ends[np.flatnonzero(on[1:] & ~on[:-1])]
    last = ends[np.flatnonzero(on[:-1] & ~on[1:])]
    x = np.stack([first, last], axis=1)
    return np.stack([x / width, (x + offset) / height], axis=2)


def _part_at(places: Floats) -> Ints:
    """The number (n,) of the part of the picture at places (n, 2)."""
    column, row = np.clip(places * HATCH.n_grid, 0, HATCH.n_grid - 1).astype(np.int64).T
    return row * HATCH.n_grid + column
