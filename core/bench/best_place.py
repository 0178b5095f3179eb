"""The best place for a picture, and turns of its glass: most of the picture arrives.

Which rays arrive depends on the glass alone. So the light around the picture is traced once, with
the derivatives of its landings, and all places and turns within the limits are compared by it, in
ever finer steps around the best. The same is done within ever smaller parts of the limits, and
without a turn, and a fine trace finds the best of these places: a wider limit is no loss. A display
pixel is seen blurred if the map from viewer to display is flat: its size is divided by the map's
smallest stretch.

Turned glass must be prepared anew. To the light it is the same whether the glass turns or all else
turns the other way about it; so the glass stays while turns are compared.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import RigError
from ..base.steps import at, within
from ..base.vectors import normalise
from ..glass.motion import Motion
from ..rig.rig import ROLES, Rig
from .largest_square import grid_over
from .offset import moved, turned
from .part_sizes import ROOM, Plane, plane_of
from .picture_light import Light, PlanOf, Traced, light_of, traced


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
) -> Generator[float, None, Traced]:
    """The light of the picture with the glass turned; yields progress 0..1."""
    return (yield from traced(with_rest_turned(rig, turn), plan_of, n_grid))


@dataclass(frozen=True)
class Limits:
    """How far a picture may move in its plane, m, and turn there, and its glass may turn, rad."""

    shift: float
    turn: float = np.radians(15)
    glass: float = 0.0


@dataclass(frozen=True)
class PlaceSearch:
    """How places are compared.

    n_rays : along each side of all that the picture may take
    n_points : of a picture, along each side
    n_first : places along each way, and turns, at first; n_rounds : of three, in half the step
    n_limits : of the shift, each half of the one before
    n_grid : points along each edge of a triangle of the picture, for turns of the glass
    n_halvings : of the step of these turns
    blur_weight : of its doubling, as a share of the picture
    motion_weight : of a motion to its limit, the same: of equal places the nearest is taken
    worth_it : gain in the picture's share for which it is moved; turn_worth_it : turned, too;
        glass_worth_it : glass, too
    most_blur : that is told apart
    """

    n_rays: int = 121
    n_points: int = 24
    n_first: tuple[int, int, int] = (25, 25, 9)
    n_rounds: int = 4
    n_limits: int = 4
    n_grid: int = 24
    n_halvings: int = 4
    blur_weight: float = 1e-3
    motion_weight: float = 2e-4
    worth_it: float = 1e-3
    turn_worth_it: float = 5e-3
    glass_worth_it: float = 5e-3
    most_blur: float = 32.0


PLACE_SEARCH = PlaceSearch()


@dataclass(frozen=True, eq=False)
class BestPlace:
    """Where a picture, and its glass, are to go.

    motion : of the picture; shift : (2,) m along its sides, turn : rad in its plane
    glass_turn : (3,) rad about its direction through the glass's middle
    before, after : shares of the picture that arrive; lost : shares that still do not, by reason
    blur_before, blur_after : how many times as large as it is a display's pixel is seen, on average
    """

    motion: Motion
    shift: Floats
    turn: float
    glass_turn: Floats
    before: float
    after: float
    lost: dict[str, float]
    blur_before: float
    blur_after: float

    @property
    def is_better(self) -> bool:
        """Is it worth the motion?"""
        gain = self.after - self.before
        sharper = np.log2(self.blur_before / self.blur_after)
        return bool(gain + PLACE_SEARCH.blur_weight * sharper > PLACE_SEARCH.worth_it)


@dataclass(frozen=True, eq=False)
class _Field:
    """The light around a picture: of rays on a grid (n, n) about its middle, rows going up.

    is_good : does it arrive? log_blur : as a power of two; half : m, to the last ray each way
    """

    is_good: Floats
    log_blur: Floats
    half: Floats

    def scores(self, points: Floats, ways: list[Floats], limits: Floats) -> Floats:
        """Shares (a, b, t) of a picture with points (k, 2) that arrive, less its blur.

        ways : shifts, m, along its sides (a,) and (b,), and turns, rad, (t,)
        limits : (3,) of these
        """
        moves = np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1) / limits
        scores = -PLACE_SEARCH.motion_weight * np.linalg.norm(moves, axis=-1)
        blur = self.is_good * self.log_blur
        for n, turn in enumerate(ways[2]):
            rotated = _rotated(points, turn)
            columns = self._nearest(rotated[:, 0] + ways[0][:, None], 0)
            rows = self._nearest(rotated[:, 1] + ways[1][:, None], 1)
            at = columns[:, None] + len(self.is_good) * rows
            share = self.is_good.take(at).mean(axis=-1)
            cost = blur.take(at).sum(axis=-1) / np.maximum(share * len(points), 1)
            scores[..., n] += share - PLACE_SEARCH.blur_weight * cost
        return scores

    def _nearest(self, places: Floats, axis: int) -> Ints:
        """Columns (axis 0) or rows (1) of the rays nearest to places, m, along it."""
        n = len(self.is_good)
        return np.rint((places / self.half[axis] + 1) * (n - 1) / 2).astype(int).clip(0, n - 1)

    def blur(self, places: Floats) -> float:
        """The mean blur of a picture whose points are at places (k, 2), m."""
        at = self._nearest(places[:, 1], 1), self._nearest(places[:, 0], 0)
        values = self.log_blur[at][self.is_good[at] > 0]
        return float(2.0 ** values.mean()) if len(values) else PLACE_SEARCH.most_blur


def best_place(rig: Rig, plan_of: PlanOf, limits: Limits) -> Generator[float, None, BestPlace]:
    """Find the best place within limits; yields progress 0..1.

    Raises
    ------
    RigError : the picture has no plane of its own, or is no flat rectangle
    """
    plane_of(rig)  # refuses
    before = yield from within(traced(rig, plan_of), 0.0, 0.1)
    still = yield from within(_placed(rig, plan_of, limits, before, np.zeros(3)), 0.1, 0.3)
    if not limits.glass:
        return still

    turn = yield from within(_glass_turn(rig, plan_of, limits.glass), 0.3, 0.8)
    if not turn.any():
        return still
    changed = with_glass_turned(rig, turn)
    other = yield from within(_placed(changed, plan_of, limits, before, turn), 0.8, 1.0)
    if other.after - still.after <= PLACE_SEARCH.glass_worth_it:
        return still
    return replace(other, blur_before=still.blur_before)


def _placed(
    rig: Rig, plan_of: PlanOf, limits: Limits, before: Traced, glass_turn: Floats
) -> Generator[float, None, BestPlace]:
    """The picture's best place in glass as it stands, settled by fine traces."""
    plane = plane_of(rig)
    found = yield from within(_candidates(rig, plan_of, plane, limits), 0.0, 0.5)
    best, most, blur_before = None, -np.inf, found[0][1]

    for n, (place, blur) in enumerate(found):
        motion = _motion(plane, place)
        changed = replace(rig, pictures=(moved(rig.picture_place, motion),))
        done = (0.5 + 0.5 * (n + k) / len(found) for k in range(2))
        after = yield from within(traced(changed, plan_of), *done)
        # a further one has to be worth it
        value = after.share - PLACE_SEARCH.blur_weight * np.log2(blur)
        is_turned = place[2] != 0 and not (best and best.turn)
        if value <= most + (PLACE_SEARCH.turn_worth_it if is_turned else PLACE_SEARCH.worth_it):
            continue
        most = value
        best = BestPlace(
            motion=motion,
            shift=place[:2],
            turn=float(place[2]),
            glass_turn=glass_turn,
            before=before.share,
            after=after.share,
            lost=after.lost,
            blur_before=blur_before,
            blur_after=blur,
        )
    return best


def _candidates(
    rig: Rig, plan_of: PlanOf, plane: Plane, limits: Limits
) -> Generator[float, None, list[tuple[Floats, float]]]:
    """Places (3,) that may be the best, as shifts, m, and turn, rad, with their blur: the present
    one, then those that are not turned, the nearest first, then the others.
    """
    sizes = np.linalg.norm(plane.sides, axis=1)
    line = np.linspace(-0.5, 0.5, PLACE_SEARCH.n_points) * ROOM.spare
    points = np.stack(np.meshgrid(*(line * size for size in sizes)), axis=-1).reshape(-1, 2)
    found = []
    for n in range(PLACE_SEARCH.n_limits):
        shift = limits.shift / 2**n
        done = n / PLACE_SEARCH.n_limits, (n + 1) / PLACE_SEARCH.n_limits
        field = yield from within(_field(rig, plan_of, plane, shift), *done)
        for turn in sorted({0.0, limits.turn}):
            place = _best(field, points, replace(limits, shift=shift, turn=turn))
            found.append((place, field.blur(_rotated(points, place[2]) + place[:2])))

    found = [one for one in found if one[0].any()]
    found.sort(key=lambda one: (one[0][2] != 0, np.linalg.norm(one[0][:2])))
    return [(np.zeros(3), field.blur(points)), *found]


def _motion(plane: Plane, place: Floats) -> Motion:
    """The motion of a picture by shifts, m, and a turn, rad, (3,) in its plane."""
    axes = plane.sides / np.linalg.norm(plane.sides, axis=1)[:, None]
    about = turned(np.cross(*axes), np.degrees(place[2]), plane.middle)
    return Motion(about.rotation, about.shift + place[:2] @ axes)


def _field(rig: Rig, plan_of: PlanOf, plane: Plane, shift: float) -> Generator[float, None, _Field]:
    """The light of all places that a picture may take."""
    sizes = np.linalg.norm(plane.sides, axis=1)
    reach = np.full(2, np.linalg.norm(sizes) / 2 + shift)
    places, step = grid_over(reach, PLACE_SEARCH.n_rays)
    points = plane.middle + places @ (plane.sides / sizes[:, None])
    light = yield from light_of(plan_of(rig), points)
    n = PLACE_SEARCH.n_rays
    is_good = light.has_arrived.reshape(n, n).astype(float)
    return _Field(is_good, _log_blur(light, n, step), reach - step / 2)


def _log_blur(light: Light, n: int, step: float) -> Floats:
    """How large a display's pixel is seen (n, n), as a power of two, by the landings' slopes."""
    landed = np.where(light.has_arrived[:, None], light.positions, np.nan).reshape(n, n, 3)
    up, right = np.gradient(landed, step, axis=(0, 1))
    a, b, c = ((p * q).sum(axis=-1) for p, q in ((right, right), (right, up), (up, up)))
    # the smaller eigenvalue of the metric
    least = (a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b**2)
    worst = np.log2(PLACE_SEARCH.most_blur)
    with np.errstate(divide="ignore", invalid="ignore"):
        blur = -0.5 * np.log2(np.maximum(least, 0.0))
    return np.nan_to_num(blur, nan=0.0, posinf=worst).clip(-worst, worst)


def _rotated(points: Floats, turn: float) -> Floats:
    """Points (k, 2) of a picture that is turned by rad."""
    sine, cosine = np.sin(turn), np.cos(turn)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def _best(field: _Field, points: Floats, limits: Limits) -> Floats:
    """The best shifts, m, and turn, rad, (3,) of a picture with points (k, 2)."""
    reach = np.array([limits.shift, limits.shift, limits.turn])
    counts = PLACE_SEARCH.n_first
    ways = [np.linspace(-r, r, n) if r else np.zeros(1) for r, n in zip(reach, counts, strict=True)]
    step = 2 * reach / (np.array(counts) - 1)

    for _ in range(1 + PLACE_SEARCH.n_rounds):
        scores = field.scores(points, ways, np.where(reach > 0, reach, 1.0))
        at = np.unravel_index(scores.argmax(), scores.shape)
        best = np.array([way[n] for way, n in zip(ways, at, strict=True)])
        step = step / 2
        nearby = (best + step * np.arange(-1, 2)[:, None]).clip(-reach, reach)
        ways = [np.unique(way) for way in nearby.T]
    return best


def _glass_turn(rig: Rig, plan_of: PlanOf, limit: float) -> Generator[float, None, Floats]:
    """The turn (3,) of the glass, up to a limit, rad, by which most of the picture arrives."""

    def score(turn: Floats) -> Generator[float, None, float]:
        light = yield from light_turned(rig, turn, plan_of, PLACE_SEARCH.n_grid)
        return light.share - PLACE_SEARCH.motion_weight * float(np.linalg.norm(turn)) / limit

    best = np.zeros(3)
    most = yield from at(0.0, score(best))
    step = limit / 2
    for n in range(1 + PLACE_SEARCH.n_halvings):
        ways = axes_around()
        for k, way in enumerate(ways):
            done = (n + k / len(ways)) / (1 + PLACE_SEARCH.n_halvings)
            turn = best + step * way
            if np.linalg.norm(turn) > limit:
                continue
            value = yield from at(done, score(turn))
            if value > most:
                best, most = turn, value
        step /= 2
    return best


@dataclass(frozen=True)
class TurnSearch:
    """How turns are tried.

    step : between angles, rad; n_halvings : of the first that does it
    n_best : axes that are tilted at each angle, n_tilted : times; by tilt, rad, and half of it each
        time
    tilts_rad : of the axis that does it, one after the other
    n_grid, n_fine : points along each edge of a triangle of the picture, and to settle it
    enough : share of the lost light that has to come back
    n_growths, growth : how often, and how much, an angle grows that the finer trace finds too small
    """

    step: float = np.radians(2)
    n_halvings: int = 6
    n_best: int = 2
    n_tilted: int = 2
    tilt: float = np.radians(20)
    tilts_rad: tuple[float, ...] = (0.35, 0.17, 0.09, 0.04)
    n_grid: int = 24
    n_fine: int = 64
    enough: float = 0.95
    n_growths: int = 5
    growth: float = 1.03


TURN_SEARCH = TurnSearch()
ROUNDING = 1e-9  # of the limit


@dataclass(frozen=True, eq=False)
class TurnBack:
    """A turn of the glass about its middle.

    turn : (3,) rad about its direction, world
    brought : share of the lost light that comes back
    before, after : shares of the picture that arrive
    does_it : does enough come back? Else it is the turn that brings back most
    """

    turn: Floats
    brought: float
    before: float
    after: float
    does_it: bool

    @property
    def angle(self) -> float:
        """Rad."""
        return float(np.linalg.norm(self.turn))


def axes_around() -> Floats:
    """Directions (26, 3) all around: of a cube's faces, edges and corners."""
    ways = np.array([way for way in product((-1, 0, 1), repeat=3) if any(way)], float)
    return normalise(ways)


def turn_back(
    rig: Rig, plan_of: PlanOf, limit: float = np.radians(30)
) -> Generator[float, None, TurnBack]:
    """Find the smallest turn, of up to `limit` rad, that brings the lost
    light of the picture back; yields progress 0..1. A turn that helps within a few degrees of
    axis or angle only may be missed.

    Raises
    ------
    RigError : no light is lost
    """
    search = _Search(rig, plan_of, TURN_SEARCH.n_grid)
    yield from within(search.begin(), 0.0, 0.05)
    low, kept = 0.0, list[Floats]()

    while low < limit * (1 - ROUNDING):
        high = min(low + TURN_SEARCH.step, limit)
        done = 0.05 + 0.7 * low / limit
        found, kept = yield from at(done, _of_angle(search, kept, high))
        if found:
            turn = yield from at(done, _smallest(search, found, (low, high), limit))
            if turn.does_it:
                return turn
        low = high

    return (yield from within(search.told(search.best, False), 0.9, 1.0))


def _of_angle(
    search: "_Search", kept: list[Floats], angle: float
) -> Generator[float, None, tuple[list[Floats], list[Floats]]]:
    """Axes that do it by an angle, the best first; and the best ones, whether they do or not.

    kept : the best ones of the angle before
    """
    tried: list[tuple[float, bool, Floats]] = []
    ways = [*kept, *axes_around()]
    for n in range(1 + TURN_SEARCH.n_tilted):
        for axis in ways:
            does = yield from search.does(axis, angle)
            tried.append((search.gain, does, axis))
        tried.sort(key=lambda one: -one[0])
        best = [axis for _, _, axis in tried[: TURN_SEARCH.n_best]]
        ways = [way for axis in best for way in _tilted(axis, TURN_SEARCH.tilt / 2**n)]

    return [axis for _, does, axis in tried if does], best


def _smallest(
    search: "_Search", axes: list[Floats], between: tuple[float, float], limit: float
) -> Generator[float, None, TurnBack]:
    """The smallest turn about axes that do it by the larger of two angles, rad."""
    low, high = between
    angles = []
    for axis in axes:
        angles.append((yield from at(0.8, search.halved(axis, low, high))))
    angle = min(angles)
    axis = axes[angles.index(angle)]

    for tilt in TURN_SEARCH.tilts_rad:
        for way in _tilted(axis, tilt):
            less = angle * (1 - 0.2 * tilt)
            if (yield from at(0.85, search.does(way, less))):
                angle = yield from at(0.85, search.halved(way, low * 0.8, less))
                axis = way

    # a finer trace may find some light that needs more
    fine = _Search(search.rig, search.plan_of, TURN_SEARCH.n_fine)
    yield from at(0.9, fine.begin())
    for _ in range(TURN_SEARCH.n_growths):
        does = yield from at(0.95, fine.does(axis, angle))
        if does or angle >= limit:
            break
        angle = min(angle * TURN_SEARCH.growth, limit)
    return (yield from within(fine.told(angle * axis, does), 0.97, 1.0))


def _tilted(axis: Floats, tilt: float) -> Iterator[Floats]:
    """An axis tilted to four sides."""
    side = normalise(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    for way in (side, -side, np.cross(axis, side), -np.cross(axis, side)):
        yield normalise(axis + np.tan(tilt) * way)


class _Search:
    """The light of a rig whose glass is turned, and the turn that brought back most so far."""

    def __init__(self, rig: Rig, plan_of: PlanOf, n_grid: int) -> None:
        self.rig = rig
        self.plan_of = plan_of
        self.n_grid = n_grid
        self.best = np.zeros(3)
        self.gain = -1.0
        self._most = -1.0

    def begin(self) -> Generator[float, None, None]:
        """Note the light that is lost."""
        before = yield from self._light(np.zeros(3))
        self.lost: Bools = before.light.is_seen & ~before.light.has_arrived
        self.before = before.share
        if not before.weight[self.lost].sum() > 0:
            raise RigError("All of the picture arrives: there is nothing to bring back.")

    def does(self, axis: Floats, angle: float) -> Generator[float, None, bool]:
        """Does a turn bring the lost light back, and lose no more elsewhere?"""
        light = yield from self._light(angle * axis)
        brought = self.brought(light)
        gain = min(brought, 1.0 + light.share - self.before)
        self.gain = gain if light.share > self.before else gain - 1.0
        if light.share > self.before and gain > self._most:
            self._most, self.best = gain, angle * axis
        return brought >= TURN_SEARCH.enough and light.share > self.before

    def halved(self, axis: Floats, low: float, high: float) -> Generator[float, None, float]:
        """The smallest angle between two that does it, where `high` does."""
        for _ in range(TURN_SEARCH.n_halvings):
            middle = (low + high) / 2
            does = yield from self.does(axis, middle)
            low, high = (low, middle) if does else (middle, high)
        return high

    def brought(self, light: Traced) -> float:
        """The share of the lost light that arrives."""
        weight = light.weight[self.lost]
        return float(weight[light.light.has_arrived[self.lost]].sum() / weight.sum())

    def told(self, turn: Floats, does_it: bool) -> Generator[float, None, TurnBack]:
        light = yield from self._light(turn)
        return TurnBack(turn, self.brought(light), self.before, light.share, does_it)

    def _light(self, turn: Floats) -> Generator[float, None, Traced]:
        return (yield from light_turned(self.rig, turn, self.plan_of, self.n_grid))
