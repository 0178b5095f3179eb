"""The view map the other way: at which places of the viewer's image is a point of the display seen?

A point may be seen at several places, on as many sheets of the map. One of them counts: that on
the path that most of the display pixel is seen by, and of several on this path the one that shows
it largest. A source image that settles ghosts by the strongest path shows the same.

Where the middle of a pixel is seen on no such path, but a part of the pixel is, the place is the
middle of that part's largest share. So no pixel at a border is lost.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints, taken
from ..base.steps import Pauses, at
from ..image.ghosts import NO_PATH, strongest_paths
from ..light.plan import Plan
from ..map.points import is_in_image, trace_points, tracer
from ..map.share_batches import ShareBatches
from ..map.view_map import ViewMap
from ..solve.channel import shares_of
from .covering import Candidates, candidates
from .grid import Grid
from .settling import derivative, inverse_of, settle

POINTS_AT_ONCE = 1 << 18  # of the grid: where light is chaotic a point has tens of candidates
HALF_PIXEL = 0.5**0.5  # display px, from its middle to its corner


@dataclass(frozen=True, eq=False)
class ViewPlaces:
    """For each point of a grid the place of the viewer's image that shows it.

    view : (n, 2) viewer px, NaN where the point's pixel is not seen
    view_by_display : (n, 2, 2) viewer px per display px
    path : (n,) uint64, the way that its light takes, NO_PATH where it is not known
    multiplicity : (n,) at how many places the very point is seen; 0 where only another part of its
        pixel is
    off : (n,) display px between the point and the place's landing, at most; inf where its pixel is
        not seen
    """

    view: Floats
    view_by_display: Floats
    path: NDArray[np.uint64]
    multiplicity: Ints
    off: Floats


def paths_shown(plan: Plan, view_map: ViewMap) -> Pauses[NDArray[np.uint64]]:
    """The path (H * W,) that counts for each display pixel."""
    return strongest_paths(_shares(plan, view_map))


def _shares(plan: Plan, view_map: ViewMap) -> ShareBatches:
    return shares_of(view_map, plan.settings.brightness, view_map.pieces, has_path=True)


def view_from_display(
    plan: Plan, view_map: ViewMap, grid: Grid, strongest: NDArray[np.uint64] | None = None
) -> Generator[float, None, ViewPlaces]:
    """The places that show the points of a grid; yields progress 0..1.

    Only those on the path that counts are traced; of others the map says that they are there.

    strongest : as by `paths_shown`, if it is known
    """
    if strongest is None:
        strongest = yield from at(0.0, paths_shown(plan, view_map))
    wanted = strongest[grid.pixels(view_map.display_size)]

    found = ViewPlaces(
        view=np.full((len(grid), 2), np.nan),
        view_by_display=np.zeros((len(grid), 2, 2)),
        path=np.full(len(grid), NO_PATH),
        multiplicity=np.zeros(len(grid), np.int64),
        off=np.full(len(grid), np.inf),
    )
    # the very points, by the pieces of the map that show them; a fold may show one a hundred times
    for rows in grid.bands(POINTS_AT_ONCE):
        done = 0.8 * rows.start / grid.rows
        lots = [Candidates.none()]
        for some in candidates(view_map, grid, rows):
            lots.append(some)
            yield done
        lot = _each_once(Candidates(*map(np.concatenate, zip(*lots, strict=True))), view_map)
        found.multiplicity[:] += np.bincount(lot.point, minlength=len(grid))
        lot = lot.at(np.flatnonzero(lot.path == wanted[lot.point]))
        yield from at(done, _place(found, plan, view_map, grid, lot))

    # other parts of their pixels
    lacks = np.flatnonzero(np.isnan(found.view[:, 0]) & (wanted != NO_PATH))
    if len(lacks):
        shares = _shares(plan, view_map)
        largest = yield from at(0.85, _largest(shares, strongest, view_map.display_size))
        pixels = grid.pixels(view_map.display_size)[lacks]
        yield from at(0.9, _fill(found, plan, view_map, grid.at(lacks), lacks, largest[pixels]))
    return found


def _largest(
    shares: ShareBatches, strongest: NDArray[np.uint64], display_size: tuple[int, int]
) -> Pauses[Floats]:
    """The middle (H * W, 2), viewer px, of the largest share of each pixel's strongest path."""
    width, height = display_size
    place = np.full((width * height, 2), np.nan)
    weight = np.zeros(width * height)

    for some in shares.pausing():
        yield 0
        if some is None:
            continue
        pixel = some.display_index
        counts = (some.path == strongest[pixel]) & (some.weight > weight[pixel])
        # of several of one pixel the last is kept
        order = np.flatnonzero(counts)
        order = order[np.argsort(some.weight[order], kind="stable")]
        weight[pixel[order]] = some.weight[order]
        place[pixel[order]] = some.view_xy[order]

    return place


def _each_once(lot: Candidates, view_map: ViewMap) -> Candidates:
    """Candidates, each place but once.

    A map knows its landings to its tolerance. Two places on one path, which has the same way round
    at both, are one where they are no farther apart than that.
    """
    reach = 2 * view_map.tolerance * np.abs(lot.view_by_display).sum(axis=2).max(axis=1)
    order = np.lexsort((lot.view[:, 0], lot.path, lot.point))
    point, path, view, reach = (
        taken(values, order) for values in (lot.point, lot.path, lot.view, reach)
    )
    repeated = np.zeros(len(order), bool)
    for k in range(1, len(order)):
        same = np.flatnonzero((point[k:] == point[:-k]) & (path[k:] == path[:-k]))
        away = np.abs(view[same + k] - view[same])
        near = np.minimum(reach[same + k], reach[same])
        if not (away[:, 0] <= near).any():  # and so of none that is further on
            break
        repeated[same[away.max(axis=1) <= near] + k] = True
    return lot.at(order[~repeated])


def _place(
    found: ViewPlaces, plan: Plan, view_map: ViewMap, grid: Grid, lot: Candidates
) -> Pauses[None]:
    """Set the places of points: of each the candidate that shows it largest, brought to the point.
    Light ends, or jumps, where the map knows only as well as its tolerance: where a candidate does
    not show its point, the next largest does.
    """
    (a, b), (c, d) = np.moveaxis(lot.view_by_display, 0, 2)
    size = np.abs(a * d - b * c)
    if plan.settings.brightness:
        size *= lot.throughput**2
    lot = lot.at(np.lexsort((size, lot.point)))

    while len(lot.point):
        is_largest = np.append(lot.point[1:] != lot.point[:-1], True)
        some, lot = lot.at(np.flatnonzero(is_largest)), lot.at(np.flatnonzero(~is_largest))
        points = grid.at(some.point)
        places = yield from settle(plan, points, some.view, some.view_by_display, some.branch)
        is_true = (places.off <= view_map.tolerance) & is_in_image(places.view, view_map.view_size)
        true = np.flatnonzero(is_true)
        number = some.point[true]
        found.view[number] = places.view[true]
        found.view_by_display[number] = some.view_by_display[true]
        found.path[number] = some.path[true]
        found.off[number] = places.off[true]
        found.multiplicity[some.point[~is_true]] -= 1
        lot = lot.at(np.flatnonzero(np.isnan(found.view[lot.point, 0])))


def _fill(
    found: ViewPlaces, plan: Plan, view_map: ViewMap, points: Floats, number: Ints, start: Floats
) -> Pauses[None]:
    """Set the places of points (n, 2) by their numbers (n,) from shares in their pixels: the very
    points where the way leads there within the viewer's image, else the middles (n, 2) of the
    shares.
    """
    traced = yield from trace_points(plan, start)
    by_view = yield from derivative(tracer(plan), start, traced.xy, traced.branch)
    inverse = inverse_of(by_view)
    places = yield from settle(plan, points, start, inverse, traced.branch)
    is_there = (places.off <= view_map.tolerance) & (traced.branch != 0)
    is_there &= is_in_image(places.view, view_map.view_size)

    found.view[number] = np.where(is_there[:, None], places.view, start)
    found.view_by_display[number] = inverse
    # the way round that it shows the display is the sign of the derivative
    (a, b), (c, d) = np.moveaxis(inverse, 0, 2)
    found.path[number] = np.where(is_there, traced.branch ^ (a * d < b * c), NO_PATH)
    away = np.hypot(*(traced.xy - points).T)
    found.off[number] = np.where(
        is_there, places.off, np.where(traced.branch != 0, away, HALF_PIXEL)
    )
    found.multiplicity[number] = np.maximum(found.multiplicity[number], is_there)
