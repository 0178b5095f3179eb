"""The warp map of one place of the head, and the one between several, as readers blend it.

Maps are blended only where they show a display pixel by the same path: between two paths a mean of
two places of the picture is neither.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats
from ...base.errors import ImageError
from ...files import disk
from ...image.ghosts import NO_PATH
from ...solve.channel import Channel
from ..warp.grid import middles
from ..warp.stmap import of_places
from ..warp.view_from_display import view_from_display

Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class HeadMap:
    """For each display pixel the place of the picture that a head sees there.

    st : (h, w, 2) places 0..1 from the picture's left and lower edge, NaN where there is none
    coverage : (h, w) 0..1, of each pixel
    path : (h, w) uint32, by which path it is seen; 0 where that is not known
    """

    st: Singles
    coverage: Singles
    path: NDArray[np.uint32]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.st.shape[1], self.st.shape[0]


def head_map(channel: Channel) -> Generator[float, None, HeadMap]:
    """The map of a solved channel; yields progress 0..1."""
    grid = middles(channel.view_map.display_size)
    places = yield from view_from_display(channel.plan, channel.view_map, grid)
    place, coverage = channel.plan.rig.picture_place, channel.coverage.of_display
    found = of_places(place, channel.viewer, grid, places, coverage)

    # half of the bits tell a few paths apart as well
    path = np.where(places.path == NO_PATH, np.uint64(0), places.path)
    short = ((path >> np.uint64(32)) ^ path).astype(np.uint32)
    return HeadMap(
        st=np.where(found.is_there[..., None], found.st, np.nan).astype(np.float32),
        coverage=found.coverage.astype(np.float32),
        path=short.reshape(found.coverage.shape),
    )


@dataclass(frozen=True, eq=False)
class Blended:
    """A map between others.

    is_whole : (h, w) do all of them show the pixel by the same path? Elsewhere a path begins or
        ends between them, and their nearest ones count.
    """

    map: HeadMap
    is_whole: Bools


def between(maps: Sequence[HeadMap], weights: Floats) -> Blended:
    """The map between several, by their weights (n,), which make 1.

    The nearest map that shows a pixel says by which path; others count that show it by the same.
    """
    coverage = sum(np.float32(w) * one.coverage for w, one in zip(weights, maps, strict=True))
    path = np.zeros_like(maps[0].path)
    is_decided = np.zeros(path.shape, bool)
    for k in np.argsort(-np.asarray(weights), kind="stable"):
        is_first = (maps[k].coverage > 0) & ~is_decided
        path[is_first] = maps[k].path[is_first]
        is_decided |= is_first

    total = np.zeros(path.shape, np.float32)
    st = np.zeros((*path.shape, 2), np.float32)
    is_whole = np.ones(path.shape, bool)
    for w, one in zip(weights, maps, strict=True):
        counts = (one.coverage > 0) & (one.path == path)
        weight = np.where(counts, np.float32(w), np.float32(0))
        total += weight
        st += weight[..., None] * np.where(counts[..., None], one.st, np.float32(0))
        is_whole &= counts

    with np.errstate(invalid="ignore"):
        return Blended(HeadMap(st / total[..., None], coverage, path), is_whole)


@dataclass(frozen=True)
class Off:
    """How far a blended map is off the one that was traced.

    median, most : px of the picture, where all maps show a pixel by one path; `most` is that of the
        part SURE of them
    at_borders : the other part, of all pixels that either map shows
    """

    median: float
    most: float
    at_borders: float


SURE = 0.95


def off(blended: Blended, true: HeadMap, picture_size: tuple[int, int]) -> Off:
    """How far a map that was blended is off the one that was traced, px of the picture."""
    found = blended.map
    n_shown = int(((found.coverage > 0) | (true.coverage > 0)).sum())
    is_smooth = blended.is_whole & (true.coverage > 0) & (true.path == found.path)
    if not is_smooth.any():
        return Off(0.0, 0.0, float(n_shown > 0))

    apart = (found.st[is_smooth] - true.st[is_smooth]) * np.array(picture_size)
    median, most = np.quantile(np.hypot(*apart.T), (0.5, SURE))
    return Off(float(median), float(most), 1 - int(is_smooth.sum()) / n_shown)


def as_bytes(found: HeadMap) -> bytes:
    """The file of a map."""
    file = BytesIO()
    np.savez_compressed(file, st=found.st, coverage=found.coverage, path=found.path)
    return file.getvalue()


def write(path: Path, found: HeadMap) -> None:
    """Write a map as .npz, whole or not at all; the same map gives the same bytes."""
    disk.write_bytes(path, as_bytes(found))


def read(path: Path) -> HeadMap:
    """A map that was written; ImageError where there is none."""
    data = disk.read_bytes(path)
    try:
        with np.load(BytesIO(data)) as arrays:
            return HeadMap(arrays["st"], arrays["coverage"], arrays["path"])
    except (ValueError, LookupError, BadZipFile, EOFError) as reason:
        raise ImageError(
            "The file '{path}' is no map of an atlas ({why}): remove it, and write it anew.",
            path=path,
            why=reason,
        ) from None
