"""STMaps: for each pixel of one image the place in another that it shows; also as a mesh.

A place is (s, t): 0..1 from the left and from the bottom, so that the middle of pixel i of W is at
(i + 0.5) / W. That is the convention of Nuke's STMap and of Blender's Map UV.
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

STEP_PX = 0.01  # viewer px, over which the straight way to the picture is differentiated


@dataclass(frozen=True, eq=False)
class STMap:
    """An image whose pixels are places in another, its row 0 at the top.

    to_size : (width, height) of the other image, px
    st : (h, w, 2) places, NaN where there is none
    coverage : (h, w) 0..1, how much of each pixel shows anything of the other image; 0 where
        its place is beside that, or beside the plane that has it
    multiplicity : (h, w) at how many places of the viewer's image the display's pixel is seen
    jacobian : (h, w, 2, 2) px of the other image per px of this, x right and y down in both; 0
        where it is not known
    """

    to_size: tuple[int, int]
    st: Floats
    coverage: Floats
    multiplicity: NDArray[np.integer]
    jacobian: Floats

    @property
    def size(self) -> tuple[int, int]:
        """Its own width and height, px."""
        return self.st.shape[1], self.st.shape[0]

    @property
    def is_there(self) -> Bools:
        """Which pixels (h, w) show a place on the other image?"""
        return self.coverage > 0

    def with_overscan(self, percent: float) -> "STMap":
        """The same map into an image that is larger by so many per cent at each side."""
        if not percent:
            return self
        more = percent / 100
        # the pixels of the other image are as many, hence larger
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
    """Display pixels to picture coordinates, each pixel cut into `times` a side; yields
    progress 0..1.

    overscan : per cent, by which the picture is larger at each side
    strongest : as by `paths_shown`, if it is known
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
    """The map to a picture, by the places that show the points of a grid."""
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
    """Viewer pixels to display coordinates; yields progress 0..1.

    warp : of the same channel, from the display's pixels; it knows their multiplicity
    """
    width, height = channel.view_map.view_size
    size = channel.view_map.display_size
    view = middles((width, height)).at(np.arange(width * height))

    traced = yield from _told(trace_points(channel.plan, view), 3 * len(view), 0.0)
    is_there = (traced.reason == Reason.ARRIVED) & is_in_image(traced.xy, size)
    some = np.flatnonzero(is_there)
    by_view = np.zeros((len(view), 2, 2))
    by_view[some] = yield from _told(
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


def _told(work: Steps[Result], n_rays: int, start: float) -> Generator[float, None, Result]:
    """Tell the progress of work that yields numbers of rays."""
    n = 0
    while True:
        try:
            n += next(work)
        except StopIteration as done:
            return done.value
        yield min(start + n / n_rays, 1.0)


def _picture_places(place: PicturePlace, viewer: Viewer, view: Floats) -> tuple[Floats, Floats]:
    """Places (n, 2) in the picture, as (s, t), of viewer px (n, 2), and picture px per viewer px
    (n, 2, 2), y down.
    """
    st = _picture_st(place, viewer, view)
    by_view = np.empty((len(view), 2, 2))
    for axis in range(2):
        beside = np.zeros(2)
        beside[axis] = STEP_PX
        change = _picture_st(place, viewer, view + beside) - _picture_st(
            place, viewer, view - beside
        )
        by_view[:, 0, axis] = change[:, 0] * place.width / (2 * STEP_PX)
        by_view[:, 1, axis] = -change[:, 1] * place.height / (2 * STEP_PX)
    return st, np.nan_to_num(by_view)


def _picture_st(place: PicturePlace, viewer: Viewer, view: Floats) -> Floats:
    """Places (n, 2) in a picture, as (s, t), of viewer px (n, 2); beyond its borders, too, where
    it is a flat rectangle.
    """
    way = flat_mapping(place, viewer)
    if way is None:
        points = picture_from_view(place, viewer, view)
        st = _st_of(points.xy, (place.width, place.height))
        st[points.cover == 0] = np.nan
        return st

    u, v, w = (a * view[:, 0] + b * view[:, 1] + c for a, b, c in way.matrix)
    w = np.where(w > 0, w, np.nan)
    return np.stack([u / w, v / w], axis=1)


def _st_of(xy: Floats, size: tuple[int, int]) -> Floats:
    """(s, t) of px (n, 2) of an image of a size."""
    return np.stack([xy[:, 0] / size[0], 1 - xy[:, 1] / size[1]], axis=1)


def _is_on(place: PicturePlace, viewer: Viewer, st: Floats, overscan: float) -> Bools:
    """Which places (n, 2) are on the picture, as a source image has it? Its plane may have a part
    of its image, or more than that; by overscan, per cent of the image, it reaches further.
    """
    way = flat_mapping(place, viewer)
    if way is None:
        return np.isfinite(st).all(axis=1)
    more = overscan / 100
    return ((st >= way.low - more) & (st <= way.high + more)).all(axis=1)


def _extended(stmap: STMap) -> STMap:
    """A map whose places beyond the other image are the middles of its outermost pixels: there a
    source image shows their colours, and many programs show nothing.
    """
    is_beyond = stmap.is_there[..., None] & ((stmap.st < 0) | (stmap.st > 1))
    edge = 0.5 / np.array(stmap.to_size)
    return replace(
        stmap,
        st=np.where(is_beyond, np.clip(stmap.st, edge, 1 - edge), stmap.st),
        jacobian=np.where(is_beyond[..., None], 0.0, stmap.jacobian),
    )


QUAD_CORNERS = (0, 0), (0, 1), (1, 1), (1, 0)  # rows and columns, with the clock


@dataclass(frozen=True, eq=False)
class WarpMesh:
    """Nodes in rows and columns over a display, the finest there are, row 0 at the top.

    display_size : (width, height) px
    finer : cells along a large one, where it is cut
    stmap : at the nodes, (finer n + 1, finer m + 1) of them for n x m large cells
    path : (h, w) uint64, on which each is seen; NO_PATH where it is no node
    """

    display_size: tuple[int, int]
    finer: int
    stmap: STMap
    path: np.ndarray

    def is_cell(self, step: int) -> Bools:
        """Which cells (n, m), `step` nodes wide, have four corners on one path?"""
        path = self.path[::step, ::step]
        corners = path[:-1, :-1], path[:-1, 1:], path[1:, 1:], path[1:, :-1]
        is_same = np.logical_and.reduce([corner == corners[0] for corner in corners])
        return is_same & (corners[0] != NO_PATH)

    @property
    def places(self) -> Floats:
        """The nodes (h, w, 2) on the display's plane, x right and y up: y is 1 at its upper edge,
        -1 at its lower one, and x as much as its shape says.
        """
        height, width = self.path.shape
        aspect = self.display_size[0] / self.display_size[1]
        x = np.linspace(-aspect, aspect, width)
        y = np.linspace(1, -1, height)
        return np.stack(np.meshgrid(x, y), axis=2)


def mesh_grid(display_size: tuple[int, int], step: float) -> Grid:
    """The finest nodes of a mesh, the large cells of which are about `step` px wide."""
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
    """Into how many cells of about a pixel a large one is cut along its side: never into more than
    it has pixels, about, however large a step was asked for.
    """
    x, y = large.step
    return max(1, round((x * y) ** 0.5))


def mesh_of(
    display_size: tuple[int, int], step: float, stmap: STMap, places: ViewPlaces
) -> WarpMesh:
    """The mesh of a map at the nodes of its grid, by the places that show them."""
    path = places.path.reshape(stmap.size[::-1])
    is_node = (places.multiplicity > 0).reshape(path.shape) & stmap.is_there
    finer = _finer(nodes(display_size, step))
    return WarpMesh(display_size, finer, stmap, np.where(is_node, path, NO_PATH))


def quads_of(mesh: WarpMesh) -> Ints:
    """Corners (n, 4) of the cells, by their numbers among the finest nodes, row by row; they run
    with the clock as they are seen, upper left first.
    """
    whole = mesh.is_cell(mesh.finer)
    large = _corners(np.argwhere(whole) * mesh.finer, mesh.finer, mesh.path.shape[1])
    fine = mesh.is_cell(1) & ~whole.repeat(mesh.finer, axis=0).repeat(mesh.finer, axis=1)
    return np.concatenate([large, _corners(np.argwhere(fine), 1, mesh.path.shape[1])])


def mesh_error(mesh: WarpMesh) -> dict[str, float]:
    """How far the large cells are off at the finest nodes within them, picture px: rms, largest."""
    whole = mesh.is_cell(mesh.finer)
    if not whole.any():
        return {"rms": 0.0, "largest": 0.0}

    # both triangles of a cell meet along the diagonal from its upper left corner
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
    """Write a mesh as OBJ."""
    quads = quads_of(mesh)
    used, number = np.unique(quads, return_inverse=True)
    places = mesh.places.reshape(-1, 2)[used]
    st = mesh.stmap.st.reshape(-1, 2)[used]
    # seen from the front, faces run against the clock
    faces = number.reshape(-1, 4)[:, ::-1] + 1

    lines = [f"# {line}" for line in about.splitlines()]
    lines += ["o warp"]
    lines += [f"v {x:.9g} {y:.9g} 0" for x, y in places]
    lines += [f"vt {s:.9g} {t:.9g}" for s, t in st]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in faces.tolist()]
    disk.write_text(path, "\n".join(lines) + "\n")


def write_data(path: Path, mesh: WarpMesh) -> None:
    """Write a mesh as Paul Bourke's .data: planar, rows from below, x y u v i a node."""
    is_kept = _kept_nodes(mesh)[::-1]
    step = np.s_[:: -mesh.finer, :: mesh.finer]
    st = mesh.stmap.st[step]
    brightness = np.where(is_kept, mesh.stmap.coverage[step], -1.0)
    st = np.where(is_kept[..., None], st, 0.0)

    rows, columns = is_kept.shape
    table = np.concatenate([mesh.places[step], st, brightness[..., None]], axis=2)
    lines = ["2", f"{columns} {rows}"]
    lines += [" ".join(f"{x:.7g}" for x in node) for node in table.reshape(-1, 5)]
    disk.write_text(path, "\n".join(lines) + "\n")


def _kept_nodes(mesh: WarpMesh) -> Bools:
    """Which nodes (h, w) of the large cells are drawn: a program draws each cell all of whose
    corners are, so of a cell that has several paths only one keeps its nodes.
    """
    path = mesh.path[:: mesh.finer, :: mesh.finer]
    kept = path != NO_PATH
    corners = [np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, 1:], np.s_[1:, :-1]]
    of_cell = np.stack([path[corner] for corner in corners])

    # the path that most corners have, of equal ones that with the larger number
    votes = (of_cell[:, None] == of_cell[None]).sum(axis=1) * (of_cell != NO_PATH)
    most = np.where(votes == votes.max(axis=0), of_cell, 0).max(axis=0)
    for corner, of_corner in zip(corners, of_cell, strict=True):
        kept[corner] &= (of_corner == most) | (of_corner == NO_PATH)

    return kept


def _corners(place: Ints, step: int, columns: int) -> Ints:
    """Numbers (n, 4) of the corners of cells, `step` nodes wide, from nodes at rows and
    columns (n, 2).
    """
    first = place[:, 0] * columns + place[:, 1]
    return first[:, None] + np.array([0, step, step * columns + step, step * columns])
