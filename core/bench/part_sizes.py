"""Sizes of display, plate and picture that the picture's light needs.

The light is traced with the largest display or plate allowed; the part has to reach the hits of
this light. Which rays arrive does not depend on the picture, so light is traced once for twice its
size, and its largest part around a place ends at the nearest lost ray. A trace with the found size
confirms the result. The light of all viewers counts.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.errors import RigError
from ..base.steps import subprogress
from ..image.flat_picture import mesh_mapping, not_flat
from ..light.display import affine_fit
from ..light.plan import Plan
from ..rig.rig import ROLES, PicturePlace, Plate, Rig, owner
from .largest_square import Bundle, best_place, grid_over, largest_about
from .picture_light import (
    MOST,
    Outline,
    PlanOf,
    TracedPicture,
    light_of,
    outline_of,
    place_in_sight,
    traced_by_all,
)


@dataclass(frozen=True)
class Wanted:
    """Requirements for a part's size.

    share : fraction of the reachable light that has to arrive
    moves : whether the part's centre may move in its plane
    most : largest size relative to the present one; 0 for the default
    n_grid : points along each edge of a triangle of the picture; 0 for as many as Add Rig uses
    """

    share: float = 1.0
    moves: bool = False
    most: float = 0.0
    n_grid: int = 0


ROLE = {role.name: role for role in ROLES}
ROOM_SPARE = 1.01  # size relative to the least that the light needs
MOST_PLATE = 4.0  # times its present size
MOST_DISPLAY = 10.0  # times the picture's longer side
AT_LIMIT = 0.98  # of the largest size: from here on light probably goes further
ROUNDING = 1e-9  # of a fraction of light


@dataclass(frozen=True, eq=False)
class Fitted:
    """A part as large as its light needs.

    size : relative to its size before; width : the new width, m; shift : (3,) m of its centre
    before, after : fractions of the picture that arrive
    lost : fractions that still do not, by reason
    for_most : width, m, for the fraction `MOST` of the light; 0 if not requested
    limit : width, m, up to which light was traced if there is light that far out; otherwise 0
    """

    size: float
    width: float
    shift: Floats
    before: float
    after: float
    lost: dict[str, float]
    for_most: float = 0.0
    limit: float = 0.0

    @property
    def more(self) -> float:
        """Growth of the width, m; negative if the part shrinks."""
        return self.width - self.width / self.size


def display_outline(rig: Rig) -> Outline:
    """Outline of a rig's flat display, along the rows of its image; RigError if it has others."""
    display = rig.display
    if rig.displays != (display,):
        raise RigError("The rig has several displays, or screens: set their sizes by hand.")
    mesh = display.mesh
    fit, _ = affine_fit(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3))
    return outline_of(mesh, fit[0], owner(ROLE["DISPLAY"], display))


def plate_outline(plate: Plate) -> Outline:
    """Outline of a plate, along the side that orients its mirrors."""
    corners = plate.mesh.corners
    side = corners[0, 1] - corners[0, 0] if plate.side is None else plate.side
    return outline_of(plate.mesh, side, owner(ROLE["PLATE"], plate))


def fit_display(
    rig: Rig, plan_of: PlanOf, wanted: Wanted | None = None
) -> Generator[float, None, Fitted]:
    """Size of the display for the light that reaches its plane; yields progress 0..1.

    Raises
    ------
    RigError : the display is not flat, or no light of the picture reaches its plane
    """
    wanted = wanted or Wanted()
    outline = display_outline(rig)
    sizing = _Sizing(rig, plan_of, wanted, "displays", 0, outline)
    most = max(1.0, wanted.most or _most_display(rig, outline))
    large = sizing.rig_with(most)
    there = yield from subprogress(traced_by_all(large, plan_of, wanted.n_grid), 0.0, 0.4)
    arrived = there.light.has_arrived
    if not arrived.any():
        raise RigError(
            "No light of the picture reaches the plane of '{name}': move or turn it.",
            name=rig.display.name,
        )
    return (
        yield from sizing.settled(
            outline.across(there.light.positions[arrived]), there.weight[arrived], most
        )
    )


def fit_plate(
    rig: Rig, plan_of: PlanOf, wanted: Wanted | None = None, number: int = 0
) -> Generator[float, None, Fitted]:
    """Size of a plate for the light it sends to the display's plane; yields progress 0..1.

    Raises
    ------
    RigError : no light of the picture reaches the plate, or the display is not flat
    """
    wanted = wanted or Wanted()
    plate = rig.plates[number]
    outline = plate_outline(plate)
    sizing = _Sizing(rig, plan_of, wanted, "plates", number, outline)
    most = max(1.0, wanted.most or MOST_PLATE)
    large = sizing.rig_with(most)

    # A display that is too small must not limit the plate.
    screen = display_outline(rig)
    sizes = max(1.0, _most_display(rig, screen))
    large = _Sizing(large, plan_of, wanted, "displays", 0, screen).rig_with(sizes)
    there = yield from subprogress(traced_by_all(large, plan_of, wanted.n_grid, outline), 0.0, 0.4)
    meets = there.light.has_arrived & np.isfinite(there.light.at_plate[:, 0])
    if not meets.any():
        raise RigError(
            "No light of the picture reaches the plane of '{name}': move or turn it.",
            name=plate.name,
        )
    return (
        yield from sizing.settled(
            outline.across(there.light.at_plate[meets]), there.weight[meets], most
        )
    )


def _most_display(rig: Rig, outline: Outline) -> float:
    """Largest size allowed for a display, relative to its present one."""
    places = [place_in_sight(rig.picture_place, viewer) for viewer in rig.viewers]
    longest = max(np.linalg.norm(np.ptp(p.mesh.corners.reshape(-1, 3), axis=0)) for p in places)
    return float(MOST_DISPLAY * longest / (2 * outline.half.max()))


@dataclass(frozen=True, eq=False)
class _Sizing:
    """A part to resize, given by the rig's field and its number there."""

    rig: Rig
    plan_of: PlanOf
    wanted: Wanted
    field: str
    number: int
    outline: Outline

    def rig_with(self, size: float, shift: Floats | None = None) -> Rig:
        """The rig with the part resized by a factor and moved by (3,) m."""
        parts = list(getattr(self.rig, self.field))
        part = parts[self.number]
        shift = np.zeros(3) if shift is None else shift
        parts[self.number] = replace(part, mesh=self.outline.changed(part.mesh, size, shift))
        return replace(self.rig, **{self.field: tuple(parts)})

    def settled(
        self, across: Floats, weight: Floats, largest: float
    ) -> Generator[float, None, Fitted]:
        """The part as large as places (n, 2) of weights (n,) need; yields the rest of the progress.

        largest : size, relative to the present one, with which these places were traced
        """
        wanted = self.wanted
        about = np.zeros(2)
        if wanted.moves:
            about = across.min(axis=0) / 2 + across.max(axis=0) / 2

        reach = self.outline.reach(across, about)
        order = np.argsort(reach)
        within_reach = np.cumsum(weight[order]) / weight.sum()
        size, most = (
            ROOM_SPARE * float(reach[order[np.argmax(within_reach >= share * (1 - ROUNDING))]])
            for share in (wanted.share, MOST)
        )
        before = yield from subprogress(self._traced(self.rig), 0.4, 0.7)
        if wanted.share >= 1 - ROUNDING:
            # Keep all light that arrives now, even between points of the coarser grid.
            now = float(self.outline.reach(self._met(before), about).max(initial=0.0))
            size = max(size, ROOM_SPARE * now if wanted.moves else min(ROOM_SPARE * now, 1.0))
        shift = about @ self.outline.axes
        farthest = float(self.outline.reach(across, np.zeros(2)).max())
        width = 2 * float(self.outline.half[0])

        after = yield from subprogress(self._traced(self.rig_with(size, shift)), 0.7, 1.0)
        return Fitted(
            size=size,
            width=width * size,
            shift=shift,
            before=before.share,
            after=after.share,
            lost=after.lost,
            for_most=width * most,
            limit=width * largest if farthest > AT_LIMIT * largest else 0.0,
        )

    def _traced(self, rig: Rig) -> Generator[float, None, TracedPicture]:
        plate = self.outline if self.field == "plates" else None
        return (
            yield from traced_by_all(rig, self.plan_of, self.wanted.n_grid, plate, is_fine=True)
        )

    def _met(self, light: TracedPicture) -> Floats:
        """Hits (n, 2) of arriving light on the part, along its axes."""
        found = light.light
        places = found.at_plate if self.field == "plates" else found.positions
        places = places[found.has_arrived]
        return self.outline.across(places[np.isfinite(places[:, 0])])


MOST_PICTURE, LEAST_PICTURE = 2.0, 0.05  # times a picture's present size
N_RAYS = 101  # along a side of the largest picture


class Plane(NamedTuple):
    """A flat picture: its centre (3,), and its whole width and height (2, 3), m."""

    middle: Floats
    sides: Floats


def plane_of(rig: Rig) -> Plane:
    """Plane of a rig's picture.

    Raises
    ------
    RigError : the picture has no plane, or is not a flat rectangle
    """
    place = rig.picture_place
    if place.mesh is None:
        raise RigError("The picture is an image in the viewer's pixels: use a picture plane.")
    if any(mesh_mapping(place.mesh, viewer) is None for viewer in rig.viewers):
        raise not_flat(place)

    uv = place.mesh.uv.reshape(-1, 2)
    fit, _ = affine_fit(uv, place.mesh.corners.reshape(-1, 3))
    low, high = uv.min(axis=0), uv.max(axis=0)
    return Plane((low + high) / 2 @ fit[:2] + fit[2], (high - low)[:, None] * fit[:2])


def resized(place: PicturePlace, plane: Plane, size: float, shift: Floats) -> PicturePlace:
    """A picture resized by a factor about its centre, and moved by (3,) m."""
    mesh = place.mesh
    vertices = plane.middle + size * (mesh.vertices - plane.middle) + shift
    return replace(place, mesh=replace(mesh, vertices=vertices))


def fit_picture(
    rig: Rig, plan_of: PlanOf, wanted: Wanted | None = None
) -> Generator[float, None, Fitted]:
    """Largest picture that gets through, up to twice its size; yields progress 0..1.

    Raises
    ------
    RigError : the picture has no plane, or hardly any of it gets through
    """
    wanted = wanted or Wanted()
    plane = plane_of(rig)
    most = wanted.most or MOST_PICTURE
    plan = plan_of(rig)

    # approximate place and size
    at, step = grid_over(np.full(2, most / 2), N_RAYS)
    arrives = yield from subprogress(_arrives(plan, plane.middle + at @ plane.sides), 0.0, 0.3)
    bundle = Bundle(at, at, arrives, step, np.full(2, most / 2), wanted.share)
    about = best_place(bundle, most)[0] if wanted.moves else np.zeros(2)
    size = min(most, float(bundle.largest(about[None], most)[0]) + 2 * step)
    shift = about @ plane.sides

    before = yield from subprogress(
        traced_by_all(rig, plan_of, wanted.n_grid, is_fine=True), 0.3, 0.5
    )
    whole = yield from subprogress(_of_size(rig, plan_of, wanted, plane, size, shift), 0.5, 0.8)
    size *= _part_that_arrives(whole, wanted.share)
    if size <= ROOM_SPARE and before.share >= wanted.share * (1 - ROUNDING):
        size, shift = 1.0, np.zeros(3)  # all of it arrives already, and more room would be wasted
    if size < LEAST_PICTURE:
        raise RigError(
            "Hardly any of the picture '{name}' gets through the glass: move it, or turn the"
            " glass.",
            name=rig.picture_place.name,
        )

    after = yield from subprogress(_of_size(rig, plan_of, wanted, plane, size, shift), 0.8, 1.0)
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
) -> Generator[float, None, TracedPicture]:
    """Light of the picture at another size."""
    changed = replace(rig, pictures=(resized(rig.picture_place, plane, size, shift),))
    return (yield from traced_by_all(changed, plan_of, wanted.n_grid, is_fine=True))


def _part_that_arrives(found: TracedPicture, share: float) -> float:
    """Size, relative to the picture's, at which light begins to be lost, less a margin; 1 for no
    loss.
    """
    is_lost = ~found.light.has_arrived
    if not is_lost.any():
        return 1.0
    places = (found.uv - found.uv.min(axis=0)) / np.ptp(found.uv, axis=0)
    return largest_about(np.full(2, 0.5), places, is_lost, found.area, share) / ROOM_SPARE


def _arrives(plan: Plan, points: Floats) -> Generator[float, None, Bools]:
    """Whether light of points (n, 3) reaches all viewers, (n,); yields progress 0..1."""
    viewers = plan.rig.viewers
    arrives = np.ones(len(points), bool)
    for k, viewer in enumerate(viewers):
        steps = light_of(plan.seen_by(viewer), points)
        light = yield from subprogress(steps, k / len(viewers), (k + 1) / len(viewers))
        arrives &= light.has_arrived
    return arrives
