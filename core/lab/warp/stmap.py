"""STMaps, images of positions in another image, and the same maps as meshes.

A position (s, t) is 0..1 from the left and from the bottom, so the middle of pixel i of W is at
(i + 0.5) / W, as in Nuke's STMap and Blender's Map UV.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats, Ints
from ...base.steps import Result, Steps
from ...files import disk
from ...image.flat_picture import flat_mapping
from ...image.ghosts import NO_PATH
from ...image.picture import picture_from_view
from ...light.rays import Reason
from ...map.points import is_in_image, trace_points, tracer
from ...rig.rig import PicturePlace
from ...rig.viewer import Viewer
from ...solve.channel import Channel
from .view_from_display import Grid, ViewPlaces, derivative, middles, nodes, view_from_display

STEP_PX = 0.01  # viewer px, step of the finite differences


@dataclass(frozen=True, eq=False)
class STMap:
    """An image whose pixels are positions in another image; row 0 is at the top.

    to_size : (width, height) of the other image, px
    st : (h, w, 2) positions, NaN if unknown
    coverage : (h, w) 0..1, fraction of each pixel that shows the other image; 0 outside the image
        or its plane
    multiplicity : (h, w) number of positions in the viewer's image where the display's pixel is
        seen
    jacobian : (h, w, 2, 2) px of the other image per px of this one, x right and y down in both; 0
        if unknown
    """

    to_size: tuple[int, int]
    st: Floats
    coverage: Floats
    multiplicity: NDArray[np.integer]
    jacobian: Floats

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.st.shape[1], self.st.shape[0]

    @property
    def is_there(self) -> Bools:
        """Pixels (h, w) with a position in the other image."""
        return self.coverage > 0

    def with_overscan(self, percent: float) -> "STMap":
        """The same map into an image enlarged by `percent` at each side."""
        if not percent:
            return self
        more = percent / 100
        # the other image keeps its number of pixels, so they grow
        return replace(
            self,
            st=(self.st + more) / (1 + 2 * more),
            jacobian=self.jacobian / (1 + 2 * more),
        )


def warp_map(
    channel: Channel,
    times: int = 1,
    overscan: float = 0.0,
    strongest: NDArray[np.uint64] | None = None,
) -> Generator[float, None, STMap]:
    """Map display pixels to the picture, with `times` x `times` samples per pixel. Yields progress
    0..1.

    overscan : per cent, enlargement of the picture at each side
    strongest : result of `paths_shown`, computed if None
    """
    plan, view_map = channel.plan, channel.view_map
    grid = middles(view_map.display_size, times)
    places = yield from view_from_display(plan, view_map, grid, strongest)
    place = plan.rig.place_of(channel.viewer)
    coverage = channel.coverage.of_display.repeat(times, axis=0).repeat(times, axis=1)
    return of_places(place, channel.viewer, grid, places, coverage, overscan)


def of_places(
    place: PicturePlace,
    viewer: Viewer,
    grid: Grid,
    places: ViewPlaces,
    coverage: Floats,
    overscan: float = 0.0,
) -> STMap:
    """The map to a picture from the viewer px of a grid's points."""
    st = np.full((len(grid), 2), np.nan)
    by_view = np.zeros((len(grid), 2, 2))
    seen = np.flatnonzero(np.isfinite(places.view[:, 0]))
    st[seen], by_view[seen] = _picture_places(place, viewer, places.view[seen])

    shape = grid.rows, grid.columns
    is_on = _is_on(place, viewer, st, overscan).reshape(shape)
    found = STMap(
        to_size=(place.width, place.height),
        st=st.reshape(*shape, 2),
        coverage=coverage,
        multiplicity=places.multiplicity.reshape(shape),
        jacobian=np.einsum("nij,njk->nik", by_view, places.view_by_display).reshape(*shape, 2, 2),
    ).with_overscan(overscan)
    return _extended(replace(found, coverage=np.where(is_on, coverage, 0.0)))


def view_stmap(channel: Channel, warp: STMap) -> Generator[float, None, STMap]:
    """Map viewer pixels to the display. Yields progress 0..1.

    warp : the same channel's map from display pixels, the source of the multiplicity
    """
    width, height = channel.view_map.view_size
    size = channel.view_map.display_size
    view = middles((width, height)).at(np.arange(width * height))

    traced = yield from _traced_progress(trace_points(channel.plan, view), 3 * len(view), 0.0)
    is_there = (traced.reason == Reason.ARRIVED) & is_in_image(traced.xy, size)
    some = np.flatnonzero(is_there)
    by_view = np.zeros((len(view), 2, 2))
    by_view[some] = yield from _traced_progress(
        derivative(tracer(channel.plan), view[some], traced.xy[some], traced.branch[some]),
        3 * len(view),
        1 / 3,
    )

    st = np.full((len(view), 2), np.nan)
    st[some] = _st_of(traced.xy[some], size)
    multiplicity = np.zeros(len(view), np.int64)
    column, row = np.clip(traced.xy[some], 0, np.array(size) - 1).astype(np.int64).T
    multiplicity[some] = np.maximum(warp.multiplicity[row, column], 1)

    shape = height, width
    return STMap(
        to_size=size,
        st=st.reshape(*shape, 2),
        coverage=np.where(is_there.reshape(shape), channel.view_coverage, 0.0),
        multiplicity=multiplicity.reshape(shape),
        jacobian=by_view.reshape(*shape, 2, 2),
    )


def _traced_progress(
    work: Steps[Result], n_rays: int, start: float
) -> Generator[float, None, Result]:
    """Run work that yields numbers of rays; yields progress from `start`."""
    n = 0
    while True:
        try:
            n += next(work)
        except StopIteration as done:
            return done.value
        yield min(start + n / n_rays, 1.0)


def _picture_places(place: PicturePlace, viewer: Viewer, view: Floats) -> tuple[Floats, Floats]:
    """Picture positions (n, 2) as (s, t) from viewer px (n, 2), and picture px per viewer px (n, 2,
    2), y down.
    """
    st = _picture_st(place, viewer, view)
    by_view = np.empty((len(view), 2, 2))
    for axis in range(2):
        offset = np.zeros(2)
        offset[axis] = STEP_PX
        change = _picture_st(place, viewer, view + offset) - _picture_st(
            place, viewer, view - offset
        )
        by_view[:, 0, axis] = change[:, 0] * place.width / (2 * STEP_PX)
        by_view[:, 1, axis] = -change[:, 1] * place.height / (2 * STEP_PX)
    return st, np.nan_to_num(by_view)


def _picture_st(place: PicturePlace, viewer: Viewer, view: Floats) -> Floats:
    """Picture positions (n, 2) as (s, t) from viewer px (n, 2); a flat rectangle continues beyond
    its borders.
    """
    mapping = flat_mapping(place, viewer)
    if mapping is None:
        points = picture_from_view(place, viewer, view)
        st = _st_of(points.xy, (place.width, place.height))
        st[points.cover == 0] = np.nan
        return st

    u, v, w = (a * view[:, 0] + b * view[:, 1] + c for a, b, c in mapping.matrix)
    w = np.where(w > 0, w, np.nan)
    return np.stack([u / w, v / w], axis=1)


def _st_of(xy: Floats, size: tuple[int, int]) -> Floats:
    """(s, t) from px (n, 2) of an image."""
    return np.stack([xy[:, 0] / size[0], 1 - xy[:, 1] / size[1]], axis=1)


def _is_on(place: PicturePlace, viewer: Viewer, st: Floats, overscan: float) -> Bools:
    """Positions (n, 2) on the picture as a source image shows it.

    A plane may show a part of its image or continue beyond it; overscan, per cent of the image,
    extends it further.
    """
    mapping = flat_mapping(place, viewer)
    if mapping is None:
        return np.isfinite(st).all(axis=1)
    more = overscan / 100
    return ((st >= mapping.low - more) & (st <= mapping.high + more)).all(axis=1)


def _extended(stmap: STMap) -> STMap:
    """The map with positions beyond the other image clamped to the middles of its outermost pixels.
    A source image shows their colours there, but many programs would show nothing.
    """
    is_beyond = stmap.is_there[..., None] & ((stmap.st < 0) | (stmap.st > 1))
    edge = 0.5 / np.array(stmap.to_size)
    return replace(
        stmap,
        st=np.where(is_beyond, np.clip(stmap.st, edge, 1 - edge), stmap.st),
        jacobian=np.where(is_beyond[..., None], 0.0, stmap.jacobian),
    )


QUAD_CORNERS = (0, 0), (0, 1), (1, 1), (1, 0)  # row and column, clockwise


@dataclass(frozen=True, eq=False)
class WarpMesh:
    """Fine nodes in rows and columns over a display, row 0 at the top.

    display_size : (width, height) px
    finer : fine cells along a large cell
    stmap : at the nodes, (finer n + 1, finer m + 1) for n x m large cells
    path : (h, w) uint64, NO_PATH for unused nodes
    """

    display_size: tuple[int, int]
    finer: int
    stmap: STMap
    path: np.ndarray

    def is_cell(self, step: int) -> Bools:
        """Cells (n, m), `step` nodes wide, with four corners on one path."""
        path = self.path[::step, ::step]
        corners = path[:-1, :-1], path[:-1, 1:], path[1:, 1:], path[1:, :-1]
        is_same = np.logical_and.reduce([corner == corners[0] for corner in corners])
        return is_same & (corners[0] != NO_PATH)

    @property
    def places(self) -> Floats:
        """Nodes (h, w, 2) on the display's plane: x right, -aspect..aspect, and y up, -1..1."""
        height, width = self.path.shape
        aspect = self.display_size[0] / self.display_size[1]
        x = np.linspace(-aspect, aspect, width)
        y = np.linspace(1, -1, height)
        return np.stack(np.meshgrid(x, y), axis=2)


def mesh_grid(display_size: tuple[int, int], step: float) -> Grid:
    """Fine nodes of a mesh with large cells about `step` px wide."""
    large = nodes(display_size, step)
    finer = _finer(large)
    x, y = large.step
    return Grid(
        large.first,
        (x / finer, y / finer),
        finer * (large.columns - 1) + 1,
        finer * (large.rows - 1) + 1,
    )


def _finer(large: Grid) -> int:
    """Number of fine cells, each about a pixel wide, along a large cell. It is limited by the size
    of the large cell, not by the requested step.
    """
    x, y = large.step
    return max(1, round((x * y) ** 0.5))


def mesh_of(
    display_size: tuple[int, int], step: float, stmap: STMap, places: ViewPlaces
) -> WarpMesh:
    """The mesh of a map at the nodes of its grid."""
    path = places.path.reshape(stmap.size[::-1])
    is_node = (places.multiplicity > 0).reshape(path.shape) & stmap.is_there
    finer = _finer(nodes(display_size, step))
    return WarpMesh(display_size, finer, stmap, np.where(is_node, path, NO_PATH))


def quads_of(mesh: WarpMesh) -> Ints:
    """Corners (n, 4) of the cells, as row-major numbers of fine nodes, clockwise from the upper
    left.
    """
    whole = mesh.is_cell(mesh.finer)
    large = _corners(np.argwhere(whole) * mesh.finer, mesh.finer, mesh.path.shape[1])
    fine = mesh.is_cell(1) & ~whole.repeat(mesh.finer, axis=0).repeat(mesh.finer, axis=1)
    return np.concatenate([large, _corners(np.argwhere(fine), 1, mesh.path.shape[1])])


def mesh_error(mesh: WarpMesh) -> dict[str, float]:
    """Interpolation error of the large cells at the fine nodes within them, picture px: rms,
    largest.
    """
    whole = mesh.is_cell(mesh.finer)
    if not whole.any():
        return {"rms": 0.0, "largest": 0.0}

    # a cell's two triangles meet along the diagonal from its upper left corner
    fine = np.arange(mesh.finer)
    y, x = fine[:, None] / mesh.finer, fine / mesh.finer
    row, column = np.nonzero(whole)
    st = mesh.stmap.st
    a, b, c, d = (
        st[mesh.finer * (row + i), mesh.finer * (column + j)][:, None, None]
        for i, j in QUAD_CORNERS
    )
    x = x[..., None]
    y = y[..., None]
    linear = np.where(x >= y, a + x * (b - a) + y * (c - b), a + y * (d - a) + x * (c - d))

    true = st[
        mesh.finer * row[:, None, None] + fine[:, None], mesh.finer * column[:, None, None] + fine
    ]
    off = np.linalg.norm((linear - true) * mesh.stmap.to_size, axis=-1)
    off = off[np.isfinite(off)]
    return {"rms": float(np.sqrt((off**2).mean())), "largest": float(off.max())}


def write_obj(path: Path, mesh: WarpMesh, about: str) -> None:
    """Write a mesh as Wavefront OBJ; `about` becomes its comment."""
    quads = quads_of(mesh)
    used, number = np.unique(quads, return_inverse=True)
    places = mesh.places.reshape(-1, 2)[used]
    st = mesh.stmap.st.reshape(-1, 2)[used]
    # OBJ faces are counterclockwise from the front
    faces = number.reshape(-1, 4)[:, ::-1] + 1

    lines = [f"# {line}" for line in about.splitlines()]
    lines += ["o warp"]
    lines += [f"v {x:.9g} {y:.9g} 0" for x, y in places]
    lines += [f"vt {s:.9g} {t:.9g}" for s, t in st]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in faces.tolist()]
    disk.write_text(path, "\n".join(lines) + "\n")


def write_data(path: Path, mesh: WarpMesh) -> None:
    """Write a mesh in Paul Bourke's .data format: planar, rows from the bottom, x y u v i per
    node.
    """
    is_drawn = _drawn_nodes(mesh)[::-1]
    step = np.s_[:: -mesh.finer, :: mesh.finer]
    st = mesh.stmap.st[step]
    brightness = np.where(is_drawn, mesh.stmap.coverage[step], -1.0)
    st = np.where(is_drawn[..., None], st, 0.0)

    rows, columns = is_drawn.shape
    table = np.concatenate([mesh.places[step], st, brightness[..., None]], axis=2)
    lines = ["2", f"{columns} {rows}"]
    lines += [" ".join(f"{x:.7g}" for x in node) for node in table.reshape(-1, 5)]
    disk.write_text(path, "\n".join(lines) + "\n")


def _drawn_nodes(mesh: WarpMesh) -> Bools:
    """Nodes (h, w) of the large cells to draw. Programs draw a cell if all its corners are drawn,
    so in a cell with several paths only the nodes of one path remain.
    """
    path = mesh.path[:: mesh.finer, :: mesh.finer]
    drawn = path != NO_PATH
    corners = [np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, 1:], np.s_[1:, :-1]]
    of_cell = np.stack([path[corner] for corner in corners])

    # the most frequent path of the corners; a tie goes to the larger number
    votes = (of_cell[:, None] == of_cell[None]).sum(axis=1) * (of_cell != NO_PATH)
    most = np.where(votes == votes.max(axis=0), of_cell, 0).max(axis=0)
    for corner, of_corner in zip(corners, of_cell, strict=True):
        drawn[corner] &= (of_corner == most) | (of_corner == NO_PATH)

    return drawn


def _corners(place: Ints, step: int, columns: int) -> Ints:
    """Node numbers (n, 4) of the corners of cells, `step` nodes wide, from the row and column (n,
    2) of the upper left node.
    """
    first = place[:, 0] * columns + place[:, 1]
    return first[:, None] + np.array([0, step, step * columns + step, step * columns])
