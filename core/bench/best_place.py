"""Best place for a picture, and turns of its glass, by the light that arrives.

Which rays arrive depends on the glass alone. The light around the picture is therefore traced once,
and all places and turns within the limits are compared by it, in ever finer steps around the best.
A fine trace then decides whether the gain is worth the motion.

Turned glass would have to be prepared again. Turning everything else the other way gives the same
light, so the glass stays while turns are compared.
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
    """Centre (3,), m, of the box around all glass of a rig."""
    boxes = np.stack([glass.mesh.bounds for glass in rig.glasses])
    return (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2


def turn_of(rig: Rig, turn: Floats) -> Motion:
    """Rotation of the glass about its centre.

    turn : (3,) rotation vector, rad
    """
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    return turned(axis, np.degrees(angle), glass_middle(rig))


def with_glass_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with all its glass turned as one."""
    motion = turn_of(rig, turn)
    return replace(rig, glasses=tuple(moved(glass, motion) for glass in rig.glasses))


def with_rest_turned(rig: Rig, turn: Floats) -> Rig:
    """The rig with everything but the glass turned the other way, which gives the same light."""
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
    """Light of the picture with the glass turned; yields progress 0..1."""
    return (yield from traced(with_rest_turned(rig, turn), plan_of, n_grid))


N_RAYS = 241  # rays along each side of the area that a picture may reach
N_POINTS = 600  # points of a picture that are looked up among these rays
GOLDEN = (5**0.5 - 1) / 2  # golden section: spreads the points evenly
N_FIRST = 25, 25, 9  # shifts along each side, and turns, of the first comparison
N_ROUNDS = 4  # further comparisons of three each way, in half the step
N_GRID = 24  # points along each edge of a triangle of the picture, for turns of the glass
N_HALVINGS = 6  # halvings of the step between turns of the glass
MOTION_WEIGHT = 2e-4  # cost of a motion to its limit, in light: the nearest of equal places wins
WORTH_MOVING = 1e-3  # gain of light that is worth a shift of the picture
WORTH_TURNING = 5e-3  # gain of light that is worth a turn of the picture or the glass
STEP_RAD = np.radians(2)  # between angles of a recovering turn
TILTS_RAD = 0.35, 0.17  # tilts of the best axis of an angle
ROUNDING = 1e-9  # relative to the limit
ENOUGH = 0.95  # fraction of the lost light that a turn has to recover


@dataclass(frozen=True)
class Limits:
    """Limits of the picture's shift, m, and turn, rad, in its plane, and of the glass's turn,
    rad.
    """

    shift: float
    turn: float = np.radians(15)
    glass: float = 0.0


@dataclass(frozen=True, eq=False)
class BestPlace:
    """Motion of a picture and its glass.

    motion : of the picture
    shift : (2,) m along its sides; turn : rad in its plane
    glass_turn : (3,) rotation vector about the glass's centre, rad
    before, after : fractions of the picture that arrive
    lost : fractions that still do not, by reason
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
        """Whether the gain is worth the motion."""
        return self.after - self.before > WORTH_MOVING


def best_place(rig: Rig, plan_of: PlanOf, limits: Limits) -> Generator[float, None, BestPlace]:
    """Find the best place within limits; yields progress 0..1.

    Raises
    ------
    RigError : the picture has no plane of its own, or is not a flat rectangle
    """
    plane_of(rig)  # raises RigError
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
    """Best place of the picture in fixed glass: as it is, moved, or moved and turned.

    Fine traces decide; each further motion has to be worth it.
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
    """Candidates (3,): shifts, m, and turn, rad, for as it is, moved, moved and turned."""
    sizes = np.linalg.norm(plane.sides, axis=1)
    reach = np.full(2, np.linalg.norm(sizes) / 2 + limits.shift)
    grid, step = grid_over(reach, N_RAYS)
    light = yield from light_of(plan_of(rig), plane.middle + grid @ (plane.sides / sizes[:, None]))
    arrives = light.has_arrived.reshape(N_RAYS, N_RAYS)

    # No two points share a row or column, so that each small shift changes the score.
    k = np.arange(N_POINTS) + 0.5
    points = (np.stack([k / N_POINTS, k * GOLDEN % 1], axis=1) - 0.5) * ROOM_SPARE * sizes
    turns = sorted({0.0, limits.turn})
    found = [_best(arrives, step, points, (limits.shift, limits.shift, turn)) for turn in turns]
    return [np.zeros(3), *(place for place in found if place.any())]


def _motion(plane: Plane, place: Floats) -> Motion:
    """Motion of a picture in its plane by shifts, m, and a turn, rad, (3,)."""
    axes = plane.sides / np.linalg.norm(plane.sides, axis=1)[:, None]
    about = turned(np.cross(*axes), np.degrees(place[2]), plane.middle)
    return Motion(about.rotation, about.shift + place[:2] @ axes)


def _best(
    arrives: Bools, step: float, points: Floats, limits: tuple[float, float, float]
) -> Floats:
    """Shifts, m, and turn, rad, (3,) with most of the picture arriving.

    Parameters
    ----------
    arrives : (n, n) rays on a grid about the picture's centre, `step` m apart, rows upward
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
    """Turn (3,) of the glass, up to a limit, rad, with most of the picture arriving."""

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
    """A turn of the glass about its centre.

    turn : (3,) rotation vector, world, rad
    brought : fraction of the lost light that is recovered
    before, after : fractions of the picture that arrive
    """

    turn: Floats
    brought: float
    before: float
    after: float

    @property
    def angle(self) -> float:
        """Angle of the turn, rad."""
        return float(np.linalg.norm(self.turn))

    @property
    def does_it(self) -> bool:
        """Whether enough light is recovered and more of the picture arrives."""
        return self.gain >= ENOUGH

    @property
    def gain(self) -> float:
        """Fraction of the lost light that is recovered; negative unless more of the picture
        arrives.
        """
        return self.brought if self.after > self.before else self.brought - 2.0


def axes_around() -> Floats:
    """Unit vectors (26, 3) to the faces, edges and corners of a cube."""
    ways = np.array([way for way in product((-1, 0, 1), repeat=3) if any(way)], float)
    return normalise(ways)


def turn_back(
    rig: Rig, plan_of: PlanOf, limit: float = np.radians(30)
) -> Generator[float, None, TurnBack]:
    """Find the smallest turn, up to `limit` rad, that recovers the picture's lost light; yields
    0..1.

    Axes in all directions are tried with growing angles, and the best axis of each angle is tilted.
    The first turn that suffices is then reduced step by step. A turn that works only within a few
    degrees of axis or angle may be missed.

    Raises
    ------
    RigError : no light is lost
    """
    before = yield from light_turned(rig, np.zeros(3), plan_of, N_GRID)
    is_lost = before.light.is_seen & ~before.light.has_arrived
    if not before.weight[is_lost].sum() > 0:
        raise RigError("The whole picture already arrives.")

    def tried(axes: Iterable[Floats], angle: float) -> Generator[float, None, TurnBack]:
        """The best turn about any of the axes."""
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
