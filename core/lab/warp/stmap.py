"""STMaps: for each pixel of one image the place in another that it shows.

A place is (s, t): 0..1 from the left and from the bottom, so that the middle of pixel i of W is at
(i + 0.5) / W. That is the convention of Nuke's STMap and of Blender's Map UV.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats
from ...base.steps import Pauses, Result
from ...image.flat_picture import flat_way
from ...image.picture import picture_from_view
from ...light.landings import Reason
from ...map.points import is_in_image, trace_points, tracer
from ...rig.rig import PicturePlace
from ...rig.viewer import Viewer
from ...solve.channel import Channel
from .grid import Grid, middles
from .settling import derivative
from .view_from_display import ViewPlaces, view_from_display

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


def _told(work: Pauses[Result], n_rays: int, start: float) -> Generator[float, None, Result]:
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
    way = flat_way(place, viewer)
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
    way = flat_way(place, viewer)
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
