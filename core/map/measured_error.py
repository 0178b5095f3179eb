"""Error of a view map, measured with additional rays at random places."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Steps
from ..light.plan import Plan
from ..light.rays import Reason
from .points import is_in_image, is_seen, trace_points
from .smooth_cells import Squares
from .view_map import MapError, ViewMap

N_PLACES = 1024  # smooth squares, and pixels, at which a map is checked
N_PLACES_EACH = 16  # in each square or pixel, if there are few
QUANTILE = 0.999  # of the error, to be within the tolerance
TINY = 1e-300  # px^2: avoids divisions by 0


@dataclass(frozen=True, eq=False)
class _Places:
    """Random places: viewer px (n, 2), and the area (n,), px^2, each represents.

    is_one : (n,) in a pixel with corners on one branch
    is_in_glass : (n,) not in a pixel with all corners outside the glass
    """

    at: Floats
    area: Floats
    is_one: Bools
    is_in_glass: Bools


def measure(plan: Plan, view_map: ViewMap, pixels: Ints) -> Generator[int, None, MapError]:
    """Errors at random places of smooth cells, and of the finest pixels with corners (n, 4)."""
    yield 0
    places = _places(view_map, pixels)
    yield 0
    found = yield from trace_points(plan, places.at)
    display_size = view_map.display_size

    yield 0
    expected = yield from view_map.lookup.by_cells(places.at)
    yield 0
    is_sampled = np.zeros(len(places.at), bool)
    is_sampled[view_map.lookup.nearest_samples(places.at, np.isnan(expected[:, 0]))[0]] = True

    # places that show the display; light past the glass carries no picture
    seen = is_seen(expected, found.xy, display_size) & is_in_image(places.at, view_map.view_size)
    seen &= places.is_in_glass | (found.reason != Reason.MISSED_GLASS)

    whole = max(float(places.area[seen].sum()), TINY)
    sampled = float(places.area[seen & is_sampled].sum() / whole)
    seen &= ~is_sampled

    # display px; inf if only the map or only the ray lands on the display
    off = np.nan_to_num(np.linalg.norm(expected - found.xy, axis=1)[seen], nan=np.inf)
    both = is_in_image(expected, display_size) & is_in_image(found.xy, display_size)
    off[~both[seen] & (off > view_map.tolerance)] = np.inf

    area = places.area[seen]
    is_one = places.is_one[seen]
    is_cut_off = found.reason[seen] == Reason.CUT_OFF

    noise = sampled / plan.settings.samples_along
    limited, unresolved = (kind & (off > view_map.tolerance) for kind in (is_one, ~is_one))
    return MapError(
        rms=_rms(off, area),
        percentile=_quantile(off, area, QUANTILE),
        facet_limited=float(area[limited].sum() / whole),
        facet_error=_rms(off[limited], area[limited]),
        unresolved=float(area[unresolved].sum() / whole) + noise,
        unresolved_error=_rms(off[unresolved], area[unresolved]),
        cut_off=float(area[~is_one & is_cut_off].sum() / whole),
        sampled=sampled,
        noise=noise,
        n_samples=len(view_map.samples),
        n_checked=len(places.at),
        most_samples=int(np.rint(1 / view_map.sample_area.min(initial=np.inf))),
    )


def checked(plan: Plan, view_map: ViewMap) -> Steps[ViewMap]:
    """The map with its errors, measured now unless done before."""
    if view_map.unchecked is None:
        return view_map
    return view_map.with_error((yield from measure(plan, view_map, view_map.unchecked)))


def _places(view_map: ViewMap, pixels: Ints) -> _Places:
    """Random places of smooth cells, and of pixels with corners (n, 4), the same each time."""
    random = np.random.default_rng(0)
    points = view_map.points

    has_picture = ~view_map.is_past_glass(view_map.nodes[:, 0])
    smooth = Squares(view_map.corner, view_map.size).at(has_picture)

    n_smooth, n_pixels = (min(N_PLACES, N_PLACES_EACH * len(kind)) for kind in (smooth, pixels))

    # squares in proportion to area, pixels equally
    squares = smooth.at(
        random.choice(len(smooth), n_smooth, p=smooth.size**2 / (smooth.size**2).sum())
        if n_smooth
        else []
    )
    some = pixels[random.integers(0, max(len(pixels), 1), n_pixels)]
    at = np.concatenate([
        squares.corner + squares.size[:, None] * random.random((n_smooth, 2)),
        points.view[some[:, 0]] + random.random((n_pixels, 2)),
    ])  # fmt: skip

    area = np.repeat(
        [(smooth.size**2.0).sum() / max(n_smooth, 1), len(pixels) / max(n_pixels, 1)],
        [n_smooth, n_pixels],
    )

    branch = points.branch[some]
    is_one = np.append(np.zeros(n_smooth, bool), (branch == branch[:, :1]).all(axis=1))
    is_past_glass = view_map.is_past_glass(some).all(axis=1)
    is_in_glass = np.append(np.ones(n_smooth, bool), ~is_past_glass)

    return _Places(at, area, is_one, is_in_glass)


def _rms(off: Floats, area: Floats) -> float:
    """Root mean square of the finite errors (n,) over areas (n,)."""
    is_finite = np.isfinite(off)
    return float(
        np.sqrt((area[is_finite] * off[is_finite] ** 2).sum() / max(area[is_finite].sum(), TINY))
    )


def _quantile(off: Floats, area: Floats, share: float) -> float:
    """Quantile of the finite errors (n,) over areas (n,); 0 without any."""
    is_finite = np.isfinite(off)
    off = off[is_finite]
    area = area[is_finite]
    order = np.argsort(off)
    below = np.cumsum(area[order])

    return (
        float(off[order[np.searchsorted(below, share * below[-1])]])
        if len(off) and below[-1] > 0
        else 0.0
    )
