"""Warp maps as meshes: the display's plane, with the places in the picture as its UV.

Between its nodes a mesh is linear. Its cells are as large as asked for where all four corners show
the picture on one path. Where they do not, an OBJ has smaller ones, of about a pixel; the regular
grid of a .data leaves the cell out.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.arrays import Bools, Floats, Ints
from ...files import disk
from ...image.ghosts import NO_PATH
from .grid import Grid, nodes
from .stmap import STMap
from .view_from_display import ViewPlaces

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
