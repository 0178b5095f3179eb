"""The warp map of one place of the head, the one that readers blend, and how fine the grid must be.

Maps are blended only where they show a display pixel by the same path: between two paths a mean of
two places of the picture is neither.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from time import perf_counter
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats
from ...base.errors import ImageError, RigError
from ...base.steps import subprogress
from ...files import disk
from ...image.ghosts import NO_PATH
from ...light.mesh_cache import MeshCache
from ...rig.rig import PicturePlace, Rig
from ...rig.settings import Settings
from ...rig.viewer import Viewer
from ...solve.channel import Channel
from ...solve.first_picture import check_light
from ...solve.session import Session
from ..warp.stmap import of_places
from ..warp.view_from_display import middles, view_from_display
from .heads import AXES, IN_WORDS, HeadBox, HeadGrid, Offset, check_viewer, viewer_at

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


MapAt = Callable[[Offset], Generator[float, None, HeadMap]]
SOLVED = 0.5  # of a map's work, about; then it is looked up for each display pixel


def solved_at(
    session: Session, rig: Rig, viewer: Viewer, settings: Settings, offset: Offset
) -> Generator[float, None, tuple[HeadMap, NDArray[np.float32]]]:
    """The map and the source image of a head at an offset from the viewer's own place; yields
    progress 0..1.

    Raises
    ------
    RigError, MeshError : the rig cannot be solved there
    """
    head = viewer_at(viewer, rig.picture_place, offset)
    moved = replace(rig, viewers=(head,))
    solution = yield from subprogress(session.solve(moved, settings), 0.0, SOLVED)
    found = yield from subprogress(head_map(solution.first), SOLVED, 1.0)
    return found, solution.source


def map_at(
    session: Session, rig: Rig, viewer: Viewer, settings: Settings, offset: Offset
) -> Generator[float, None, HeadMap]:
    """The map alone."""
    found, _ = yield from solved_at(session, rig, viewer, settings, offset)
    return found


@dataclass(frozen=True)
class Refined:
    """A grid that is fine enough, as far as lines through the middle of its box tell.

    off : along each axis on which the head moves, in the middle between neighbours, at worst
    seconds, n_bytes : that a map takes, at the median
    maps : those that were traced on the way, by their offsets
    """

    grid: HeadGrid
    off: dict[str, Off]
    seconds: float
    n_bytes: float
    maps: dict[Offset, HeadMap]


def check(rig: Rig, viewer: Viewer, box: HeadBox, tolerance: float, most: int) -> None:
    """Raise RigError or MeshError where it is known before any light is traced that no atlas of a
    viewer's head can be made.
    """
    rig.check()
    check_viewer(viewer, rig.picture_place)
    if not tolerance > 0:
        raise RigError(
            "The tolerance of the atlas is {tolerance:g} px: set one above 0.", tolerance=tolerance
        )
    for offset in _corners(box, most):
        viewer_at(viewer, rig.picture_place, offset)


def check_heads(rig: Rig, viewer: Viewer, settings: Settings, box: HeadBox, most: int) -> None:
    """Raise RigError or MeshError where a head in the middle of a box or at one of its corners sees
    nothing, by a coarse look from each.
    """
    kept = MeshCache()
    middle = tuple((a + b) / 2 for a, b in zip(box.low, box.high, strict=True))
    for offset in (middle, *_corners(box, most)):
        head = viewer_at(viewer, rig.picture_place, offset)
        check_light(kept, replace(rig, viewers=(head,)), settings)


def refine(
    at: MapAt, box: HeadBox, place: PicturePlace, tolerance: float, most: int
) -> Generator[float, None, Refined]:
    """Halve each axis until blending keeps its part of the tolerance, px of the picture; yields
    progress 0..1.

    Errors of blending along the axes add up, so that each may have its part. They fall to a quarter
    with each halving, where the map is smooth.

    Raises
    ------
    RigError : more than `most` places are needed
    """
    _corners(box, most)
    line = _Line(at, box)
    grid = HeadGrid(box)
    found = {}
    n_axes = len(box.axes)

    for k, axis in enumerate(box.axes):
        done, end = k / n_axes, (k + 1) / n_axes
        while True:
            so_far, done = done, (done + end) / 2  # how many halvings come is not known
            steps = _worst_between(line, grid, axis, (place.width, place.height))
            worst = yield from subprogress(steps, so_far, done)
            if worst.most <= tolerance / n_axes:
                break
            grid = grid.halved(axis)
            if len(grid) > most:
                raise RigError(
                    "{n} places of the head are too few: with {there} of them {axis}, blending"
                    " is {off:.3g} px off: set a larger tolerance, a smaller box, or more places"
                    " (where light is chaotic no number is enough).",
                    n=most,
                    there=len(grid.nodes[axis]) // 2 + 1,
                    axis=IN_WORDS[axis],
                    off=worst.most,
                )
        found[AXES[axis]] = worst

    return Refined(
        grid=grid,
        off=found,
        seconds=float(np.median(line.seconds)),
        n_bytes=float(np.median(line.n_bytes)),
        maps=line.maps,
    )


def _corners(box: HeadBox, most: int) -> list[Offset]:
    """Places of the coarsest grid; RigError where the box is none or they are more than `most`."""
    box.check()
    grid = HeadGrid(box)
    if len(grid) > most:
        raise RigError(
            "{n} places of the head are too few: the corners of its box are {corners}.",
            n=most,
            corners=len(grid),
        )
    return grid.offsets()


class _Line:
    """The maps on the lines along the axes, through the middle of a box; each is made once."""

    def __init__(self, at: MapAt, box: HeadBox) -> None:
        self._at = at
        self._middle = tuple((a + b) / 2 for a, b in zip(box.low, box.high, strict=True))
        self.maps: dict[Offset, HeadMap] = {}
        self.seconds: list[float] = []
        self.n_bytes: list[int] = []

    def map(self, axis: int, x: float) -> Generator[float, None, HeadMap]:
        """The map at a place along an axis; yields progress 0..1."""
        offset = tuple(x if k == axis else m for k, m in enumerate(self._middle))
        if offset not in self.maps:
            started = perf_counter()
            self.maps[offset] = yield from self._at(offset)
            self.n_bytes.append(len(as_bytes(self.maps[offset])))
            self.seconds.append(perf_counter() - started)
        return self.maps[offset]


def _worst_between(
    line: _Line, grid: HeadGrid, axis: int, picture_size: tuple[int, int]
) -> Generator[float, None, Off]:
    """The largest of each number in the middles between neighbours along an axis."""
    nodes, middles = grid.nodes[axis], grid.middles(axis)
    found = []
    n = len(middles)
    for k in range(n):
        places = (nodes[k], middles[k], nodes[k + 1])
        maps = []
        for j, x in enumerate(places):
            maps.append(
                (yield from subprogress(line.map(axis, x), (k + j / 3) / n, (k + (j + 1) / 3) / n))
            )
        low, middle, high = maps
        found.append(off(between([low, high], np.array([0.5, 0.5])), middle, picture_size))

    return Off(
        median=max(one.median for one in found),
        most=max(one.most for one in found),
        at_borders=max(one.at_borders for one in found),
    )
