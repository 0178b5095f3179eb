"""The cube of the reference rig in few pixels, solved, and the pixels that are drawn larger."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import finish
from kiriko.core.image.outline import cut_along_outline
from kiriko.core.lab.measure.diagram import COLOURS
from kiriko.core.map.shares import Shares
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.channel import Channel
from kiriko.core.solve.session import Session
from known.reference_rigs import cube_rig

VIEW_PX = 18
DISPLAY_PX = 24
LEAN_DEGREES = 8.0  # about the viewer's line of sight: edges run aslant through the pixels
ON_BORDER_PX = 0.01  # points that are nearer to each other are one place


@dataclass(frozen=True, eq=False)
class Polygon:
    """One piece of the view map.

    view, display : (k, 2) its corners, viewer px and display px
    """

    view: Floats
    display: Floats
    branch: int

    @property
    def area(self) -> float:
        """On the viewer's image, px^2."""
        x, y = self.view.T
        return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    @property
    def pixel(self) -> tuple[int, int]:
        """The viewer pixel that its middle lies in."""
        x, y = np.floor(self.view.mean(axis=0)).astype(int)
        return int(x), int(y)


@dataclass(frozen=True, eq=False)
class Solved:
    """A solve, and the pixels of it that are drawn larger.

    Parameters
    ----------
    polygons : all that land
    colours : by branch
    pixel : (2,) the cut pixel, viewer px
    display_pixel : (2,) one that shows a part of it
    shares : of that one
    """

    rig: Rig
    channel: Channel
    polygons: list[Polygon]
    colours: dict[int, str]
    pixel: Floats
    display_pixel: Floats
    shares: Shares

    @property
    def cut(self) -> list[Polygon]:
        """The pieces of the cut pixel."""
        return [polygon for polygon in self.polygons if polygon.pixel == tuple(self.pixel)]

    def traced_in_pixel(self) -> Iterator[tuple[Floats, str]]:
        """The traced points of the cut pixel and their colours, black where two branches meet."""
        points = self.channel.view_map.points
        is_in = (np.abs(points.view - self.pixel - 0.5) < 0.5 + ON_BORDER_PX).all(axis=1)
        some = points.at(np.flatnonzero(is_in))
        for view, branch in zip(some.view, some.branch, strict=True):
            if int(branch) in self.colours:
                is_near = np.abs(some.view - view).max(axis=1) < ON_BORDER_PX
                is_shared = (some.branch[is_near] != branch).any()
                yield view, "black" if is_shared else self.colours[int(branch)]

    def by_branch(self, polygons: Iterable[Polygon]) -> Iterator[tuple[str, list[Polygon]]]:
        """The colour of each branch, and those of some polygons that are on it."""
        polygons = list(polygons)
        for branch, colour in self.colours.items():
            if some := [polygon for polygon in polygons if polygon.branch == branch]:
                yield colour, some


def leaned_cube() -> Rig:
    """The cube's rig, with the cube turned about the viewer's line of sight."""
    rig = cube_rig(pixels=VIEW_PX, display_pixels=DISPLAY_PX)
    c, s = np.cos(np.radians(LEAN_DEGREES)), np.sin(np.radians(LEAN_DEGREES))
    (glass,) = rig.glasses
    vertices = glass.mesh.vertices @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return replace(rig, glasses=(replace(glass, mesh=replace(glass.mesh, vertices=vertices)),))


def solved() -> Solved:
    """The cube, solved, and the pixels of it that are drawn larger."""
    rig = leaned_cube()
    (channel,) = finish(Session().solve(rig, Settings())).channels
    polygons = list(landed(rig, channel))

    area: dict[int, float] = {}
    for polygon in polygons:
        area[polygon.branch] = area.get(polygon.branch, 0.0) + polygon.area
    by_area = sorted(area, key=area.get, reverse=True)
    colours = {branch: COLOURS[n % len(COLOURS)] for n, branch in enumerate(by_area)}

    pixel = most_evenly_cut(polygons)
    display_pixel, shares = busiest(channel, pixel)
    return Solved(
        rig=rig,
        channel=channel,
        polygons=polygons,
        colours=colours,
        pixel=np.array(pixel),
        display_pixel=display_pixel,
        shares=shares,
    )


def landed(rig: Rig, channel: Channel) -> Iterator[Polygon]:
    """The pieces that are painted, which are cut along the picture's outline."""
    pieces = channel.view_map.pieces()
    for piece in cut_along_outline(pieces, rig.picture_place, channel.viewer):
        for view, display, branch in zip(piece.view, piece.display, piece.branch, strict=True):
            if np.isfinite(display).all() and branch:
                yield Polygon(view, display, int(branch))


def most_evenly_cut(polygons: list[Polygon]) -> tuple[int, int]:
    """The viewer pixel of which two branches, both on the display, have the most equal parts."""
    parts: dict[tuple[int, int], dict[int, float]] = {}
    for polygon in polygons:
        is_on = (polygon.display >= 0).all() and (polygon.display <= DISPLAY_PX).all()
        if is_on and np.ptp(polygon.view, axis=0).max() <= 1 + 1e-9:
            of_pixel = parts.setdefault(polygon.pixel, {})
            of_pixel[polygon.branch] = of_pixel.get(polygon.branch, 0.0) + polygon.area
    cut = {pixel: of for pixel, of in parts.items() if len(of) == 2}
    return max(cut, key=lambda pixel: (round(min(cut[pixel].values()), 3), pixel))


def busiest(channel: Channel, pixel: tuple[int, int]) -> tuple[Floats, Shares]:
    """The display pixel with the most shares among those that have one of a viewer pixel, and
    its shares.
    """
    (shares,) = channel.shares
    is_of_pixel = (np.floor(shares.view_xy) == pixel).all(axis=1)
    count = np.bincount(shares.display_index, minlength=DISPLAY_PX**2)
    asked = np.unique(shares.display_index[is_of_pixel]).tolist()
    index = max(asked, key=lambda index: (count[index], index))
    row, column = divmod(index, DISPLAY_PX)
    return np.array([column, row]), shares.at(np.flatnonzero(shares.display_index == index))
