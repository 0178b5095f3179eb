"""The warp map of one head position, the blending of maps, and the refinement of the grid.

Maps are blended only at display pixels seen by the same path in each: the mean of two picture
positions on different paths is on neither.
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
from ...base.errors import ImageError, RigError, out_of_range
from ...base.messages import Message
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
from ..warp.view_from_display import middles, refuse_views, view_from_display
from .heads import AXES, HeadBox, HeadGrid, Offset, check_viewer, viewer_at

Singles = NDArray[np.float32]
OWNER = Message("The atlas")  # of settings, at the start of a message


@dataclass(frozen=True, eq=False)
class HeadMap:
    """The picture position seen at each display pixel from one head position.

    st : (h, w, 2) 0..1 from the picture's left and lower edge, NaN if nothing is seen
    coverage : (h, w) 0..1, of each pixel
    path : (h, w) uint32, 0 if unknown
    """

    st: Singles
    coverage: Singles
    path: NDArray[np.uint32]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.st.shape[1], self.st.shape[0]


def head_map(channel: Channel) -> Generator[float, None, HeadMap]:
    """The map of a solved channel. Yields progress 0..1."""
    grid = middles(channel.view_map.display_size)
    places = yield from view_from_display(channel.plan, channel.view_map, grid)
    place, coverage = channel.plan.rig.picture_place, channel.coverage.of_display
    found = of_places(place, channel.viewer, grid, places, coverage)

    # 32 bits are enough to distinguish a few paths
    path = np.where(places.path == NO_PATH, np.uint64(0), places.path)
    short = ((path >> np.uint64(32)) ^ path).astype(np.uint32)
    return HeadMap(
        st=np.where(found.is_there[..., None], found.st, np.nan).astype(np.float32),
        coverage=found.coverage.astype(np.float32),
        path=short.reshape(found.coverage.shape),
    )


@dataclass(frozen=True, eq=False)
class Blended:
    """A blended map.

    is_whole : (h, w) whether all blended maps see the pixel by the same path. At other pixels a
        path begins or ends between the maps, and only maps with the chosen path count.
    """

    map: HeadMap
    is_whole: Bools


def between(maps: Sequence[HeadMap], weights: Floats) -> Blended:
    """Blend maps by weights (n,) with sum 1.

    Each pixel has the path of the nearest map with coverage there; maps with another path do not
    count.
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
    """Error of a blended map against the traced map.

    median, most : picture px, over pixels with one path in all maps; `most` is the quantile at SURE
    at_borders : fraction of the other pixels, among all covered pixels of both maps
    """

    median: float
    most: float
    at_borders: float


SURE = 0.95


def off(blended: Blended, true: HeadMap, picture_size: tuple[int, int]) -> Off:
    """Error of a blended map against the traced map."""
    found = blended.map
    n_shown = int(((found.coverage > 0) | (true.coverage > 0)).sum())
    is_smooth = blended.is_whole & (true.coverage > 0) & (true.path == found.path)
    if not is_smooth.any():
        return Off(0.0, 0.0, float(n_shown > 0))

    apart = (found.st[is_smooth] - true.st[is_smooth]) * np.array(picture_size)
    median, most = np.quantile(np.hypot(*apart.T), (0.5, SURE))
    return Off(float(median), float(most), 1 - int(is_smooth.sum()) / n_shown)


def as_bytes(found: HeadMap) -> bytes:
    """The map as .npz bytes."""
    file = BytesIO()
    np.savez_compressed(file, st=found.st, coverage=found.coverage, path=found.path)
    return file.getvalue()


def write(path: Path, found: HeadMap) -> None:
    """Write a map as .npz, atomically; the same map gives the same bytes."""
    disk.write_bytes(path, as_bytes(found))


def read(path: Path) -> HeadMap:
    """Read a map; ImageError if the file is missing or malformed."""
    data = disk.read_bytes(path)
    try:
        with np.load(BytesIO(data)) as arrays:
            return HeadMap(arrays["st"], arrays["coverage"], arrays["path"])
    except (ValueError, LookupError, BadZipFile, EOFError) as reason:
        raise ImageError(
            "'{path}' is not a map of an atlas ({why}). Remove it and write it again.",
            path=path,
            why=reason,
        ) from None


MapAt = Callable[[Offset], Generator[float, None, HeadMap]]
SOLVED = 0.5  # approximate fraction of the work; the inverse lookup is the rest


def solved_at(
    session: Session, rig: Rig, viewer: Viewer, settings: Settings, offset: Offset
) -> Generator[float, None, tuple[HeadMap, NDArray[np.float32]]]:
    """The map and the source image of a head at an offset from the viewer's own position. Yields
    progress 0..1.

    Raises
    ------
    RigError, MeshError : the rig cannot be solved there
    """
    head = viewer_at(viewer, rig.picture_place, offset)
    moved = replace(rig, viewers=(head,)).in_one_colour(settings.wavelength)
    solution = yield from subprogress(session.solve(moved, settings), 0.0, SOLVED)
    found = yield from subprogress(head_map(solution.first), SOLVED, 1.0)
    return found, solution.source


def map_at(
    session: Session, rig: Rig, viewer: Viewer, settings: Settings, offset: Offset
) -> Generator[float, None, HeadMap]:
    """The map of a head at an offset. Yields progress 0..1."""
    found, _ = yield from solved_at(session, rig, viewer, settings, offset)
    return found


@dataclass(frozen=True)
class Refined:
    """A grid refined along the lines through the middle of its box.

    off : worst errors midway between neighbours, by axis; only axes of movement
    seconds, n_bytes : median cost of a map
    maps : all maps traced during refinement, by offset
    """

    grid: HeadGrid
    off: dict[str, Off]
    seconds: float
    n_bytes: float
    maps: dict[Offset, HeadMap]


def check(rig: Rig, viewer: Viewer, box: HeadBox, tolerance: float, most: int) -> None:
    """Raise RigError or MeshError if the input rules out an atlas; no light is traced."""
    rig.check()
    refuse_views(rig)
    check_viewer(rig, viewer)
    if not tolerance > 0:
        raise out_of_range(OWNER, "Tolerance", f"{tolerance:g} px", 0)
    for offset in _corners(box, most):
        viewer_at(viewer, rig.picture_place, offset)


def check_heads(rig: Rig, viewer: Viewer, settings: Settings, box: HeadBox, most: int) -> None:
    """Raise RigError or MeshError if a coarse trace from the box's middle or from a corner sees
    nothing.
    """
    cache = MeshCache()
    middle = tuple((a + b) / 2 for a, b in zip(box.low, box.high, strict=True))
    for offset in (middle, *_corners(box, most)):
        head = viewer_at(viewer, rig.picture_place, offset)
        check_light(cache, replace(rig, viewers=(head,)), settings)


def refine(
    at: MapAt, box: HeadBox, place: PicturePlace, tolerance: float, most: int
) -> Generator[float, None, Refined]:
    """Halve each axis until its blending error is within its part of the tolerance, picture px;
    yields progress 0..1.

    The errors along the axes add up, so each axis has an equal part. The error of a smooth map
    falls to a quarter with each halving.

    Raises
    ------
    RigError : more than `most` positions are needed
    """
    _corners(box, most)
    line = _Line(at, box)
    grid = HeadGrid(box)
    found = {}
    n_axes = len(box.axes)

    for k, axis in enumerate(box.axes):
        done, end = k / n_axes, (k + 1) / n_axes
        while True:
            so_far, done = done, (done + end) / 2  # the number of halvings is unknown
            steps = _worst_between(line, grid, axis, (place.width, place.height))
            worst = yield from subprogress(steps, so_far, done)
            if worst.most <= tolerance / n_axes:
                break
            finer = grid.halved(axis)
            if len(finer) > most:
                raise too_coarse(len(grid), worst.most, most)
            grid = finer
        found[AXES[axis]] = worst

    return Refined(
        grid=grid,
        off=found,
        seconds=float(np.median(line.seconds)),
        n_bytes=float(np.median(line.n_bytes)),
        maps=line.maps,
    )


def too_coarse(n: int, off: float, most: int) -> RigError:
    """Error for a grid of `n` positions that is `off` px off and cannot be refined."""
    return RigError(
        "With {n} head positions, blended maps are {off:.3g} px off. Set a larger tolerance, a"
        " smaller box, or more than {most} positions (for chaotic light, no number is enough).",
        n=n,
        off=off,
        most=most,
    )


def _corners(box: HeadBox, most: int) -> list[Offset]:
    """Positions of the coarsest grid; RigError if the box is empty or has more than `most`."""
    box.check()
    grid = HeadGrid(box)
    if len(grid) > most:
        raise RigError(
            "{n} head positions are too few. Set {corners} or more, one for each corner of the"
            " box.",
            n=most,
            corners=len(grid),
        )
    return grid.offsets()


class _Line:
    """Cached maps on the lines along the axes, through the middle of a box."""

    def __init__(self, at: MapAt, box: HeadBox) -> None:
        self._at = at
        self._middle = tuple((a + b) / 2 for a, b in zip(box.low, box.high, strict=True))
        self.maps: dict[Offset, HeadMap] = {}
        self.seconds: list[float] = []
        self.n_bytes: list[int] = []

    def map(self, axis: int, x: float) -> Generator[float, None, HeadMap]:
        """The map at a position along an axis. Yields progress 0..1."""
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
    """The worst errors midway between neighbours along an axis."""
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
