"""The best place for a picture, and turns of its glass: most of the picture arrives.

Which rays arrive depends on the glass alone. So the light around the picture is traced once, and
all places and turns within the limits are compared by it, in ever finer steps around the best. A
fine trace then decides whether the best place gains enough to move, and the turn enough to turn.

Turned glass must be prepared anew. To the light it is the same whether the glass turns or all else
turns the other way about it; so the glass stays while turns are compared.
"""

from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.errors import RigError
from ..base.steps import hold_progress, subprogress
from ..base.vectors import normalise
from ..glass.motion import Motion
from ..rig.rig import ROLES, Rig
from .largest_square import grid_over
from .offset import moved, turned
from .part_sizes import ROOM_SPARE, Plane, plane_of
from .picture_light import PlanOf, TracedPicture, light_of, traced


def glass_middle(rig: Rig) -> Floats:
    """The middle (3,), m, of the box around all glass of a rig."""
    boxes = np.stack([glass.mesh.bounds for glass in rig.glasses])
    return (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2


def turn_of(rig: Rig, turn: Floats) -> Motion:
    """The motion of the glass by a turn (3,), rad about its
    direction, right-handed, through the glass's middle.
    """
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    return turned(axis, np.degrees(angle), glass_middle(rig))


def with_glass_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with all its glass turned as one."""
    motion = turn_of(rig, turn)
    return replace(rig, glasses=tuple(moved(glass, motion) for glass in rig.glasses))


def with_rest_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with all but the glass turned the other way: the same to the light."""
    motion = turn_of(rig, -turn)
    return replace(
        rig,
        **{
            role.field: tuple(
                part if getattr(part, "mesh", part) is None else moved(part, motion)
                for part in rig.of(role)
            )
            for role in ROLES
            if role.name != "GLASS"
        },
    )


def light_turned(
    rig: Rig, turn: Floats, plan_of: PlanOf, n_grid: int
) -> Generator[float, None, TracedPicture]:
    """The light of the picture with the glass turned; yields progress 0..1."""
    return (yield from traced(with_rest_turned(rig, turn), plan_of, n_grid))


N_RAYS = 241  # along each side of all places that a picture may take: the grid of the light
N_POINTS = 600  # of a picture, that are looked up in that grid
GOLDEN = (5**0.5 - 1) / 2  # of the golden section, by which they are spread evenly
N_FIRST = 25, 25, 9  # shifts along each side, and turns, that are compared at first
N_ROUNDS = 4  # of three each, in half the step
N_GRID = 24  # points along each edge of a triangle of the picture, for turns of the glass
N_HALVINGS = 6  # of the step between turns of the glass
MOTION_WEIGHT = 2e-4  # of a motion to its limit, as a share: of equal places the nearest is taken
WORTH_MOVING = 1e-3  # gain in the picture's share for which it is moved
WORTH_TURNING = 5e-3  # gain for which it, or its glass, is turned
STEP_RAD = np.radians(2)  # between angles of a turn that brings lost light back
TILTS_RAD = 0.35, 0.17  # by which the best axis of an angle is tilted
ROUNDING = 1e-9  # of the limit
ENOUGH = 0.95  # share of the lost light that has to come back


@dataclass(frozen=True)
class Limits:
    """How far a picture may move in its plane, m, and turn there, and its glass may turn, rad."""

    shift: float
    turn: float = np.radians(15)
    glass: float = 0.0


@dataclass(frozen=True, eq=False)
class BestPlace:
    """Where a picture, and its glass, are to go.

    motion : of the picture; shift : (2,) m along its sides, turn : rad in its plane
    glass_turn : (3,) rad about its direction through the glass's middle
    before, after : shares of the picture that arrive; lost : shares that still do not, by reason
    """

    motion: Motion
    shift: Floats
    turn: float
    glass_turn: Floats
    before: float
    after: float
    lost: dict[str, float]

    @property
    def is_better(self) -> bool:
        """Is it worth the motion?"""
        return self.after - self.before > WORTH_MOVING


def best_place(rig: Rig, plan_of: PlanOf, limits: Limits) -> Generator[float, None, BestPlace]:
    """Find the best place within limits; yields progress 0..1.

    Raises
    ------
    RigError : the picture has no plane of its own, or is no flat rectangle
    """
    plane_of(rig)  # refuses
    before = yield from subprogress(traced(rig, plan_of), 0.0, 0.1)
    still = yield from subprogress(_placed(rig, plan_of, limits, before, np.zeros(3)), 0.1, 0.3)
    if not limits.glass:
        return still

    turn = yield from subprogress(_glass_turn(rig, plan_of, limits.glass), 0.3, 0.8)
    if not turn.any():
        return still
    changed = with_glass_turned(rig, turn)
    other = yield from subprogress(_placed(changed, plan_of, limits, before, turn), 0.8, 1.0)
    return other if other.after - still.after > WORTH_TURNING else still


def _placed(
    rig: Rig, plan_of: PlanOf, limits: Limits, before: TracedPicture, glass_turn: Floats
) -> Generator[float, None, BestPlace]:
    """The picture's best place in glass as it stands, settled by fine traces: as it is, moved, or
    turned, too, where each has to be worth it.
    """
    plane = plane_of(rig)
    best = None
    places = yield from subprogress(_candidates(rig, plan_of, plane, limits), 0.0, 0.4)
    for n, place in enumerate(places):
        motion = _motion(plane, place)
        changed = replace(rig, pictures=(moved(rig.picture_place, motion),))
        after = yield from subprogress(traced(changed, plan_of), 0.4 + 0.2 * n, 0.6 + 0.2 * n)
        gain = WORTH_TURNING if place[2] else WORTH_MOVING
        if best is None or after.share > best.after + gain:
            best = BestPlace(
                motion, place[:2], place[2], glass_turn, before.share, after.share, after.lost
            )
    return best


def _candidates(
    rig: Rig, plan_of: PlanOf, plane: Plane, limits: Limits
) -> Generator[float, None, list[Floats]]:
    """Places (3,) that may be the best, as shifts, m, and turn, rad: as it is, moved, turned."""
    sizes = np.linalg.norm(plane.sides, axis=1)
    reach = np.full(2, np.linalg.norm(sizes) / 2 + limits.shift)
    grid, step = grid_over(reach, N_RAYS)
    light = yield from light_of(plan_of(rig), plane.middle + grid @ (plane.sides / sizes[:, None]))
    arrives = light.has_arrived.reshape(N_RAYS, N_RAYS)

    # no two in one row or column: the share changes with each small shift
    k = np.arange(N_POINTS) + 0.5
    points = (np.stack([k / N_POINTS, k * GOLDEN % 1], axis=1) - 0.5) * ROOM_SPARE * sizes
    turns = sorted({0.0, limits.turn})
    found = [_best(arrives, step, points, (limits.shift, limits.shift, turn)) for turn in turns]
    return [np.zeros(3), *(place for place in found if place.any())]


def _motion(plane: Plane, place: Floats) -> Motion:
    """The motion of a picture by shifts, m, and a turn, rad, (3,) in its plane."""
    axes = plane.sides / np.linalg.norm(plane.sides, axis=1)[:, None]
    about = turned(np.cross(*axes), np.degrees(place[2]), plane.middle)
    return Motion(about.rotation, about.shift + place[:2] @ axes)


def _best(
    arrives: Bools, step: float, points: Floats, limits: tuple[float, float, float]
) -> Floats:
    """The shifts, m, and turn, rad, (3,) by which most of a picture arrives.

    Parameters
    ----------
    arrives : (n, n) of rays on a grid about the picture's middle, `step` m apart, rows going up
    points : (k, 2) of the picture, m
    """
    reach = np.array(limits)
    counts = np.array(N_FIRST)
    ways = [np.linspace(-r, r, n) if r else np.zeros(1) for r, n in zip(reach, counts, strict=True)]
    apart = 2 * reach / (counts - 1)

    for _ in range(1 + N_ROUNDS):
        moves = np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1)
        scores = -MOTION_WEIGHT * np.linalg.norm(moves / np.where(reach > 0, reach, 1.0), axis=-1)
        for n, turn in enumerate(ways[2]):
            sine, cosine = np.sin(turn), np.cos(turn)
            x, y = (points @ np.array([[cosine, sine], [-sine, cosine]])).T
            column, row = (
                np.rint(places / step + (N_RAYS - 1) / 2).astype(int).clip(0, N_RAYS - 1)
                for places in (x + ways[0][:, None], y + ways[1][:, None])
            )
            scores[..., n] += arrives.take(column[:, None] + N_RAYS * row).mean(axis=-1)
        at = np.unravel_index(scores.argmax(), scores.shape)
        best = np.array([way[n] for way, n in zip(ways, at, strict=True)])
        apart = apart / 2
        ways = [
            np.unique(way)
            for way in (best + apart * np.array([[-1], [0], [1]])).clip(-reach, reach).T
        ]
    return best


def _glass_turn(rig: Rig, plan_of: PlanOf, limit: float) -> Generator[float, None, Floats]:
    """The turn (3,) of the glass, up to a limit, rad, by which most of the picture arrives."""

    def score(turn: Floats) -> Generator[float, None, float]:
        if np.linalg.norm(turn) > limit:
            return -np.inf
        light = yield from light_turned(rig, turn, plan_of, N_GRID)
        return light.share - MOTION_WEIGHT * float(np.linalg.norm(turn)) / limit

    best = np.zeros(3)
    most = yield from hold_progress(0.0, score(best))
    ways = axes_around()
    for n in range(N_HALVINGS):
        for k, way in enumerate(ways):
            turn = best + limit / 2 ** (n + 1) * way
            value = yield from hold_progress((n + k / len(ways)) / N_HALVINGS, score(turn))
            if value > most:
                best, most = turn, value
    return best


@dataclass(frozen=True, eq=False)
class TurnBack:
    """A turn of the glass about its middle.

    turn : (3,) rad about its direction, world
    brought : share of the lost light that comes back
    before, after : shares of the picture that arrive
    """

    turn: Floats
    brought: float
    before: float
    after: float

    @property
    def angle(self) -> float:
        """Rad."""
        return float(np.linalg.norm(self.turn))

    @property
    def does_it(self) -> bool:
        """Does enough come back, and more of the picture arrive?"""
        return self.gain >= ENOUGH

    @property
    def gain(self) -> float:
        """Share of the lost light that comes back; below 0 if no more of the picture arrives."""
        return self.brought if self.after > self.before else self.brought - 2.0


def axes_around() -> Floats:
    """Directions (26, 3) all around: of a cube's faces, edges and corners."""
    ways = np.array([way for way in product((-1, 0, 1), repeat=3) if any(way)], float)
    return normalise(ways)


def turn_back(
    rig: Rig, plan_of: PlanOf, limit: float = np.radians(30)
) -> Generator[float, None, TurnBack]:
    """Find the smallest turn, of up to `limit` rad, that brings the lost light of the picture back;
    yields progress 0..1. A turn that helps within a few degrees of axis or angle may be missed.

    Axes all around are tried by angles that grow, and the best one of each angle is tilted. The
    first turn that does it is then made smaller by steps to all sides.

    Raises
    ------
    RigError : no light is lost
    """
    before = yield from light_turned(rig, np.zeros(3), plan_of, N_GRID)
    is_lost = before.light.is_seen & ~before.light.has_arrived
    if not before.weight[is_lost].sum() > 0:
        raise RigError("All of the picture arrives: there is nothing to bring back.")

    def tried(axes: Iterable[Floats], angle: float) -> Generator[float, None, TurnBack]:
        """The best turn about some axes."""
        found = []
        for axis in axes:
            light = yield from light_turned(rig, angle * axis, plan_of, N_GRID)
            weight = light.weight[is_lost]
            brought = float(weight[light.light.has_arrived[is_lost]].sum() / weight.sum())
            found.append(TurnBack(angle * axis, brought, before.share, light.share))
        return max(found, key=lambda one: one.gain)

    best = TurnBack(np.zeros(3), 0.0, before.share, before.share)
    angle = 0.0
    while not best.does_it and angle < limit * (1 - ROUNDING):
        angle = min(angle + STEP_RAD, limit)
        done = 0.7 * angle / limit
        there = yield from hold_progress(done, tried(axes_around(), angle))
        for tilt in TILTS_RAD:
            tilted = yield from hold_progress(done, tried(_tilted(there.turn / angle, tilt), angle))
            there = max(there, tilted, key=lambda one: one.gain)
        best = max(best, there, key=lambda one: one.gain)

    step = 2 * STEP_RAD if best.does_it else 0.0
    for n in range(N_HALVINGS):
        for way in axes_around():
            turn = best.turn + step * way
            angle = float(np.linalg.norm(turn))
            if angle < best.angle:
                done = 0.7 + 0.3 * n / N_HALVINGS
                smaller = yield from hold_progress(done, tried([turn / angle], angle))
                best = smaller if smaller.does_it else best
        step /= 2
    return best


def _tilted(axis: Floats, tilt: float) -> Iterator[Floats]:
    """An axis tilted to four sides."""
    side = normalise(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    for way in (side, -side, np.cross(axis, side), -np.cross(axis, side)):
        yield normalise(axis + np.tan(tilt) * way)
