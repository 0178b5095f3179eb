"""How large may a picture be, so that its light gets through?

Which rays arrive does not depend on the picture, only on the places that it takes in the viewer's
image. So the light of twice its size is traced once, the largest part around a place ends at the
nearest lost ray, and the border between is found by halving.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.errors import RigError
from ..base.steps import within
from ..image.flat_picture import not_flat, way_to_mesh
from ..light.display import affine_fit
from ..light.plan import Plan
from ..rig.rig import PicturePlace, Rig
from .largest_square import Bundle, best_place, grid_over, largest_about
from .light import light_of
from .part_sizes import ROOM, ROUNDING, Fitted, Wanted
from .picture_light import PlanOf, Traced, traced_by_all


@dataclass(frozen=True)
class Growth:
    """How a picture's size is sought; lengths as shares of it.

    most, least : size, of its present one
    n_rays : along a side of the largest
    n_outline : rays along each side of its outline, by which the border is found
    n_halvings : of the doubt about the border
    """

    most: float = 2.0
    least: float = 0.05
    n_rays: int = 101
    n_outline: int = 200
    n_halvings: int = 8


GROWTH = Growth()
IS_RING = 1e-6  # of a distance: nearer ones are the same


class Plane(NamedTuple):
    """A flat picture: its middle (3,), and its whole width and height (2, 3), m."""

    middle: Floats
    sides: Floats


def plane_of(rig: Rig) -> Plane:
    """The plane of a rig's picture.

    Raises
    ------
    RigError : it has none of its own, or is no flat rectangle
    """
    place = rig.picture_place
    if place.mesh is None:
        raise RigError(
            "The picture is in the viewer's own pixels and has no size of its own: choose a picture"
            " plane."
        )
    if any(way_to_mesh(place.mesh, viewer) is None for viewer in rig.viewers):
        raise not_flat(place)

    uv = place.mesh.uv.reshape(-1, 2)
    fit, _ = affine_fit(uv, place.mesh.corners.reshape(-1, 3))
    low, high = uv.min(axis=0), uv.max(axis=0)
    return Plane((low + high) / 2 @ fit[:2] + fit[2], (high - low)[:, None] * fit[:2])


def resized(place: PicturePlace, plane: Plane, size: float, shift: Floats) -> PicturePlace:
    """A picture so many times as large about its middle, and moved by (3,) m."""
    mesh = place.mesh
    vertices = plane.middle + size * (mesh.vertices - plane.middle) + shift
    return replace(place, mesh=replace(mesh, vertices=vertices))


def fit_picture(
    rig: Rig, plan_of: PlanOf, wanted: Wanted | None = None
) -> Generator[float, None, Fitted]:
    """The picture as large as gets through, up to twice its size; yields progress 0..1.

    Raises
    ------
    RigError : it has no plane of its own, or hardly any of it gets through
    """
    wanted = wanted or Wanted()
    plane = plane_of(rig)
    most = wanted.most or GROWTH.most
    plan = plan_of(rig)

    # about which place, and about how large
    at, step = grid_over(np.full(2, most / 2), GROWTH.n_rays)
    arrives = yield from within(_arrives(plan, plane.middle + at @ plane.sides), 0.0, 0.3)
    bundle = Bundle(at, at, arrives, step, np.full(2, most / 2), wanted.share)
    about = best_place(bundle, most)[0] if wanted.moves else np.zeros(2)
    size = min(most, float(bundle.largest(about[None], most)[0]) + 2 * step)
    shift = about @ plane.sides

    before = yield from within(traced_by_all(rig, plan_of, wanted.n_grid, is_fine=True), 0.3, 0.5)
    size = yield from within(_border(rig, plan_of, wanted, plane, size, shift), 0.5, 0.8)
    if size <= ROOM.spare and before.share >= wanted.share * (1 - ROUNDING):
        size, shift = 1.0, np.zeros(3)  # it arrives as it is, with no more room than is spared
    if size < GROWTH.least:
        raise RigError(
            "Hardly any of the picture '{name}' gets through about its middle: move it, or turn"
            " the glass.",
            name=rig.picture_place.name,
        )

    after = yield from within(_of_size(rig, plan_of, wanted, plane, size, shift), 0.8, 1.0)
    return Fitted(
        size=size,
        width=float(np.linalg.norm(plane.sides[0])) * size,
        shift=shift,
        before=before.share,
        after=after.share,
        lost=after.lost,
        limit=float(np.linalg.norm(plane.sides[0])) * most if size >= most else 0.0,
    )


def _of_size(
    rig: Rig, plan_of: PlanOf, wanted: Wanted, plane: Plane, size: float, shift: Floats
) -> Generator[float, None, Traced]:
    """The light of a picture of another size."""
    changed = replace(rig, pictures=(resized(rig.picture_place, plane, size, shift),))
    return (yield from traced_by_all(changed, plan_of, wanted.n_grid, is_fine=True))


def _border(
    rig: Rig, plan_of: PlanOf, wanted: Wanted, plane: Plane, size: float, shift: Floats
) -> Generator[float, None, float]:
    """The size at which light begins to be lost, no larger than `size`, less some room."""
    found = yield from within(_of_size(rig, plan_of, wanted, plane, size, shift), 0.0, 0.6)
    uv = found.uv
    places = (uv - uv.min(axis=0)) / np.ptp(uv, axis=0)
    is_lost = ~found.light.has_arrived
    if not is_lost.any():
        return size
    if wanted.share < 1:
        whole = largest_about(np.full(2, 0.5), places, is_lost, found.area, wanted.share)
        return size * whole / ROOM.spare

    # all within is good, and something on the next ring is lost
    distance = 2 * np.abs(places - 0.5).max(axis=1)
    high = float(distance[is_lost].min())
    low = float(distance[distance < high * (1 - IS_RING)].max(initial=0.0))
    low, high = size * low, size * high
    plan = plan_of(rig)
    for n in range(GROWTH.n_halvings):
        middle = (low + high) / 2
        is_whole = yield from within(
            _outline_arrives(plan, plane, middle, shift), 0.6 + 0.05 * n, 0.65 + 0.05 * n
        )
        low, high = (middle, high) if is_whole else (low, middle)
    return low / ROOM.spare


def _outline_arrives(
    plan: Plan, plane: Plane, size: float, shift: Floats
) -> Generator[float, None, bool]:
    """Does all light of the outline of a picture so large arrive?"""
    along = np.linspace(-0.5, 0.5, GROWTH.n_outline + 1)
    end = np.full(len(along), 0.5)
    sides = [(along, -end), (along, end), (-end, along), (end, along)]
    places = size * np.concatenate([np.stack(side, axis=1) for side in sides])
    arrives = yield from _arrives(plan, plane.middle + shift + places @ plane.sides)
    return bool(arrives.all())


def _arrives(plan: Plan, points: Floats) -> Generator[float, None, Bools]:
    """(n,) does the light of points (n, 3) arrive to all viewers? Yields progress 0..1."""
    viewers = plan.rig.viewers
    arrives = np.ones(len(points), bool)
    for k, viewer in enumerate(viewers):
        steps = light_of(plan.seen_by(viewer), points)
        light = yield from within(steps, k / len(viewers), (k + 1) / len(viewers))
        arrives &= light.has_arrived
    return arrives
