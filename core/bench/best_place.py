"""The best place for a picture, and turn of its glass: most of it arrives, with the least blur.

Which rays arrive depends on the glass alone. So the light around the picture is traced, with the
derivatives of its landings, and all its places and turns within the limits are compared by it, in
ever finer steps around the best. The same is done within ever smaller parts of the limits, and
without a turn, and a fine trace tells which of these places is best: a wider limit is no loss, and
nothing is moved or turned for nothing. A display pixel is seen blurred where the map from viewer
to display is flat: as large as it is, divided by the smallest stretch of the map. Turns of the
glass are traced anew each.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.steps import at, within
from ..glass.motion import Motion
from ..rig.rig import Rig
from .largest_square import grid_over
from .light import Light, light_of
from .offset import moved, turned
from .part_sizes import ROOM
from .picture_light import PlanOf, Traced, traced
from .picture_room import Plane, plane_of
from .rotated_rig import light_turned, with_glass_turned
from .turn_back import axes_around


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
