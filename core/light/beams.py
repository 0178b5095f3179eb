"""The direction in which light leaves a display with views, and the view it belongs to."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.products import turn
from ..base.vectors import dot
from ..rig.views import tile_corner
from .plan import Plan
from .rays import Landings


def beams(plan: Plan, landings: Landings) -> Floats | None:
    """Column and row (n, 2) among the display's views, as `Views.beam`, of rays that land; None if
    it has none.

    Rays are traced backward, so the display emits light against their directions.
    """
    display, plane = plan.rig.display, plan.display.plane
    if display.views is None:
        return None

    per_m = np.linalg.norm(plane.pixels, axis=1)
    axes = plane.pixels / per_m[:, None] * np.array([[1.0], [-1.0]])  # right and up
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = turn(axes, landings.directions) / dot(landings.directions, plane.normal)[:, None]
    middle = np.array(display.size) / 2
    place = (landings.xy - middle) / per_m * np.array([1.0, -1.0])
    return display.views.beam(slope, place)


def quilt_places(plan: Plan, landings: Landings, dither: Floats | float = 0.0) -> Floats:
    """Places (n, 2), px, of landings on the source image; NaN outside the cone of the views.

    dither : (n, 2) from -1/2 to 1/2, at random, for views that overlap: each ray takes one of them
        with the chance of its weight
    """
    display = plan.rig.display
    views = display.views
    if views is None:
        return landings.xy
    beam = np.floor(beams(plan, landings) + views.overlap * dither + 0.5)
    with np.errstate(invalid="ignore"):
        is_in = ((beam >= 0) & (beam < [views.columns, views.rows])).all(axis=1)
    column, row = np.where(is_in[:, None], beam, 0).astype(np.int64).T
    corner = np.stack(
        tile_corner(row * views.columns + column, views.tiling(display.size), display.size), axis=1
    )
    return np.where(is_in[:, None], landings.xy + corner, np.nan)


def in_quilt(
    plan: Plan, landings: Landings, is_seen: Bools, pixel: Ints, dither: Floats | float = 0.0
) -> tuple[Bools, Ints]:
    """Which landings (n,) are in a view, and their pixels of the source image.

    is_seen, pixel : (n,) on the image of one view, as from `Landings.pixels`
    dither : as for `quilt_places`
    """
    if plan.rig.display.views is None:
        return is_seen, pixel
    xy = quilt_places(plan, landings, dither)
    is_seen = is_seen & np.isfinite(xy[:, 0])
    column, row = np.where(is_seen[:, None], xy, 0).astype(np.int64).T
    return is_seen, row * plan.rig.display.image_size[0] + column
