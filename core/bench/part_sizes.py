"""How large have display and plate to be for a picture's light?

The light of the picture is traced with the part in question as large as it may be, and the part
then has to reach the places where that light meets it. The answer is settled by tracing the rig
with the part as large as was found. The light of all viewers counts.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..base.messages import Message
from ..base.steps import within
from ..light.display import affine_fit
from ..rig.rig import Display, Plate, Rig
from .flat import Outline, outline_of
from .picture_light import PlanOf, Traced, place_in_sight, traced_by_all
from .spread import MOST


@dataclass(frozen=True)
class Wanted:
    """What is wanted of a part's size.

    share : of the light that could arrive, that has to
    moves : may the part's middle move in its plane?
    most : times its present size that a part may have; 0: `ROOM`'s
    n_grid : points along each edge of a triangle of the picture; 0: as many as Add Rig takes
    """

    share: float = 1.0
    moves: bool = False
    most: float = 0.0
    n_grid: int = 0


@dataclass(frozen=True)
class Room:
    """What counts in sizing.

    spare : a part's size, of what its light needs at least
    most_plate : times its present size
    most_display : times the picture's longer side
    at_limit : of the largest size, from which on light is taken to go further
    """

    spare: float = 1.01
    most_plate: float = 4.0
    most_display: float = 10.0
    at_limit: float = 0.98


ROOM = Room()
ROUNDING = 1e-9  # of a share


@dataclass(frozen=True, eq=False)
class Fitted:
    """A part as large as its light needs.

    size : times as large as it was; width : m, that it then has; shift : (3,) m of its middle
    before, after : shares of the picture that arrive
    lost : shares that still do not, by reason
    for_most : m, the width that `MOST` of that light needs; 0 where nobody asked
    limit : m, the width up to which light was looked for, where there is light so far out; else 0
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
        """By how much wider it is, m; below 0 where it is narrower."""
        return self.width - self.width / self.size


def display_outline(display: Display) -> Outline:
    """The outline of a flat display, along the rows of its image."""
    mesh = display.mesh
    fit, _ = affine_fit(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3))
    return outline_of(mesh, fit[0], Message("The display '{name}'", name=display.name))


def plate_outline(plate: Plate) -> Outline:
    """The outline of a plate, along the side by which its mirrors stand."""
    corners = plate.mesh.corners
    side = corners[0, 1] - corners[0, 0] if plate.side is None else plate.side
    return outline_of(plate.mesh, side, Message("The plate '{name}'", name=plate.name))


def fit_display(
    rig: Rig, plan_of: PlanOf, wanted: Wanted | None = None
) -> Generator[float, None, Fitted]:
    """The display as large as the light needs that comes to its plane; yields progress 0..1.

    Raises
    ------
    RigError : it is not flat, or no light of the picture comes to its plane
    """
    wanted = wanted or Wanted()
    outline = display_outline(rig.display)
    sizing = _Sizing(rig, plan_of, wanted, "displays", 0, outline)
    most = max(1.0, wanted.most or _most_display(rig, outline))
    large = sizing.rig_with(most)
    there = yield from within(traced_by_all(large, plan_of, wanted.n_grid), 0.0, 0.4)
    arrived = there.light.has_arrived
    if not arrived.any():
        raise RigError(
            "No light of the picture comes to the plane of the display '{name}': move or turn it.",
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
    """A plate as large as the light needs that it sends to the
    display's plane; yields progress 0..1.

    Raises
    ------
    RigError : no light of the picture meets it, or the display is not flat
    """
    wanted = wanted or Wanted()
    plate = rig.plates[number]
    outline = plate_outline(plate)
    sizing = _Sizing(rig, plan_of, wanted, "plates", number, outline)
    most = max(1.0, wanted.most or ROOM.most_plate)
    large = sizing.rig_with(most)

    # a display that is too small is another matter
    screen = _screen_for(rig.display, plate)
    sizes = max(1.0, _most_display(rig, screen))
    large = _Sizing(large, plan_of, wanted, "displays", 0, screen).rig_with(sizes)
    there = yield from within(traced_by_all(large, plan_of, wanted.n_grid, outline), 0.0, 0.4)
    meets = there.light.has_arrived & np.isfinite(there.light.at_plate[:, 0])
    if not meets.any():
        raise RigError(
            "No light of the picture comes to the display by way of the plate '{name}': move or"
            " turn it.",
            name=plate.name,
        )
    return (
        yield from sizing.settled(
            outline.across(there.light.at_plate[meets]), there.weight[meets], most
        )
    )


def _screen_for(display: Display, plate: Plate) -> Outline:
    """The outline of the display to which a plate sends its light."""
    try:
        return display_outline(display)
    except RigError:
        raise RigError(
            "The size of the plate '{plate}' is for you to choose, for the display '{display}' is"
            " not flat.",
            plate=plate.name,
            display=display.name,
        ) from None


def _most_display(rig: Rig, outline: Outline) -> float:
    """How many times as large a display may be."""
    places = [place_in_sight(rig.picture_place, viewer) for viewer in rig.viewers]
    longest = max(np.linalg.norm(np.ptp(p.mesh.corners.reshape(-1, 3), axis=0)) for p in places)
    return float(ROOM.most_display * longest / (2 * outline.half.max()))


@dataclass(frozen=True, eq=False)
class _Sizing:
    """A part of a rig, by the rig's field and its number there, that is to have another size."""

    rig: Rig
    plan_of: PlanOf
    wanted: Wanted
    field: str
    number: int
    outline: Outline

    def rig_with(self, size: float, shift: Floats | None = None) -> Rig:
        """The rig with the part so many times as large, and moved by (3,) m."""
        parts = list(getattr(self.rig, self.field))
        part = parts[self.number]
        shift = np.zeros(3) if shift is None else shift
        parts[self.number] = replace(part, mesh=self.outline.changed(part.mesh, size, shift))
        return replace(self.rig, **{self.field: tuple(parts)})

    def settled(
        self, across: Floats, weight: Floats, largest: float
    ) -> Generator[float, None, Fitted]:
        """The part as large as places (n, 2) need, of weights (n,), that were looked for with
        the part `largest` times as large; yields the rest of the progress.
        """
        wanted = self.wanted
        about = np.zeros(2)
        if wanted.moves:
            about = across.min(axis=0) / 2 + across.max(axis=0) / 2

        reach = self.outline.reach(across, about)
        order = np.argsort(reach)
        within_reach = np.cumsum(weight[order]) / weight.sum()
        size, most = (
            ROOM.spare * float(reach[order[np.argmax(within_reach >= share * (1 - ROUNDING))]])
            for share in (wanted.share, MOST)
        )
        before = yield from within(self._traced(self.rig), 0.4, 0.7)
        if wanted.share >= 1 - ROUNDING:
            # whatever arrives stays, also where no point of the coarser grid was
            now = float(self.outline.reach(self._met(before), about).max(initial=0.0))
            size = max(size, ROOM.spare * now if wanted.moves else min(ROOM.spare * now, 1.0))
        shift = about @ self.outline.axes
        farthest = float(self.outline.reach(across, np.zeros(2)).max())
        width = 2 * float(self.outline.half[0])

        after = yield from within(self._traced(self.rig_with(size, shift)), 0.7, 1.0)
        return Fitted(
            size=size,
            width=width * size,
            shift=shift,
            before=before.share,
            after=after.share,
            lost=after.lost,
            for_most=width * most,
            limit=width * largest if farthest > ROOM.at_limit * largest else 0.0,
        )

    def _traced(self, rig: Rig) -> Generator[float, None, Traced]:
        plate = self.outline if self.field == "plates" else None
        return (
            yield from traced_by_all(rig, self.plan_of, self.wanted.n_grid, plate, is_fine=True)
        )

    def _met(self, light: Traced) -> Floats:
        """Where light that arrives meets the part, (n, 2) along its axes."""
        found = light.light
        places = found.at_plate if self.field == "plates" else found.positions
        places = places[found.has_arrived]
        return self.outline.across(places[np.isfinite(places[:, 0])])
