"""The whole way of a few rays, point by point, from the viewer to the end or to the place where
the light is lost.

Rays are traced as for a solve; the steps between their events are joined to polylines here.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import Steps
from ..base.vectors import dot
from ..rig.rig import Kind, Mesh
from .interactions import ENDS
from .plan import Plan
from .rays import Landings, Reason, Step, main_landings
from .trace import tracing

PASSED_BY = {Reason.MISSED_PLATE: Kind.PLATE, Reason.MISSED_DISPLAY: Kind.DISPLAY}
NOTHING = -1  # in the place of a part: the start of a way, or an end where nothing is met


@dataclass(frozen=True)
class Tails:
    """The lengths of ways beyond their last event, m.

    tail : of a ray that leaves to nowhere
    reach : of one that passes by the plate or the display: it ends on their plane, or else where
        it is nearest to their middle, if that is no further away
    """

    tail: float
    reach: float


@dataclass(frozen=True, eq=False)
class LightPath:
    """The way of a ray.

    points : (k, 3) m, world: the start, each surface met, the end
    parts : (k,) numbers of the plan's parts that are met there, or NOTHING
    reason : why the light is lost at the last point; ARRIVED where that is its landing
    """

    points: Floats
    parts: Ints
    reason: Reason

    @property
    def has_arrived(self) -> bool:
        return self.reason == Reason.ARRIVED


def following(
    plan: Plan, origins: Floats, directions: Floats, aims: Floats, tails: Tails
) -> Steps[list[LightPath]]:
    """Follow rays, and return their ways, in the same order.

    Parameters
    ----------
    origins, directions : (n, 3) m, world; unit directions; all starting in air
    aims : (n,) m, how far away is the place that each ray looks at: one that misses the glass is
        lost there, and ends a tail beyond
    """
    n = len(origins)
    steps: list[Step] = []
    found = yield from tracing(plan, origins, directions, steps=steps)
    landings = main_landings(found, n)

    # the events of each ray, in order
    ray = np.concatenate([step.rays for step in steps] or [np.empty(0, np.int64)])
    place = np.concatenate([step.place for step in steps] or [np.empty((0, 3))])
    triangle = np.concatenate([step.triangle for step in steps] or [np.empty(0, np.int64)])
    order = np.argsort(ray, kind="stable")
    first = np.searchsorted(ray[order], np.arange(n + 1))

    ends, end_parts, is_more = _ends(plan, landings, np.diff(first), triangle[order], first, tails)
    ways = []
    for i in range(n):
        events = order[first[i] : first[i + 1]]
        points = [origins[i : i + 1], place[events], ends[i : i + 1][is_more[i : i + 1]]]
        parts = plan.triangles.part[triangle[events]]
        of_end = end_parts[i : i + 1][is_more[i : i + 1]]
        way = LightPath(
            points=np.concatenate(points),
            parts=np.concatenate([[NOTHING], parts, of_end]).astype(np.int64),
            reason=Reason(int(landings.reason[i])),
        )
        ways.append(_passing_by(way, directions[i], aims[i] + tails.tail))
    return ways


def _passing_by(way: LightPath, direction: Floats, length: float) -> LightPath:
    """A way that missed the glass, cut off where it has passed by;
    any other, or one that meets something before, as it is.
    """
    start = way.points[0]
    if way.reason != Reason.MISSED_GLASS:
        return way
    if len(way.points) > 2 and np.linalg.norm(way.points[1] - start) < length:
        return way
    points = np.stack([start, start + length * direction])
    return LightPath(points, np.full(2, NOTHING), way.reason)


def _ends(
    plan: Plan, landings: Landings, n_events: Ints, triangle: Ints, first: Ints, tails: Tails
) -> tuple[Floats, Ints, Bools]:
    """The last point (n, 3) of each way, the part (n,) there, and
    is it another than that of the last event?

    n_events : (n,) events that were noted; triangle : of all events, ray by
        ray, those of a ray from `first` (n + 1,) on
    """
    at = landings.positions.copy()
    part = np.full(len(at), NOTHING)

    # on a display beyond a plate, of which no event is noted; on a surface that ends all light
    has_landed = landings.n_events > n_events
    part[has_landed] = len(plan.parts) - 1
    is_met = n_events > 0
    last = plan.triangles.part[triangle[np.maximum(first[1:] - 1, 0)]] if len(triangle) else part
    ends_there = is_met & ENDS[plan.parts.kind[np.where(is_met, last, 0)]]
    goes_on = ~has_landed & ~ends_there & (landings.reason != Reason.CUT_OFF)

    # the others go on, to the plane that they pass by or into nothing
    length = np.full(len(at), tails.tail)
    for reason, kind in PASSED_BY.items():
        some = np.flatnonzero(goes_on & (landings.reason == reason))
        numbers = np.flatnonzero(plan.parts.kind == kind)
        if len(some) and len(numbers):
            rays = at[some], landings.directions[some]
            by = np.min([_passing(plan, int(n), *rays, tails.reach) for n in numbers], axis=0)
            length[some] = np.where(np.isfinite(by), by, tails.tail)

    at[goes_on] += length[goes_on, None] * landings.directions[goes_on]
    return at, part, has_landed | goes_on


def _passing(plan: Plan, number: int, points: Floats, directions: Floats, reach: float) -> Floats:
    """How far (n,) rays go from points (n, 3) until they pass by a
    part: to its plane, or else to the place nearest to its middle;
    inf where that is behind them or out of reach.
    """
    its_own = plan.triangles.part == number
    normal = plan.triangles.normals[its_own][0]
    mesh = _mesh_of(plan, number)
    middle = mesh.bounds.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_plane = dot(middle - points, normal) / dot(directions, normal)
    nearest = dot(middle - points, directions)

    is_by = [(length > 0) & (length <= reach) for length in (to_plane, nearest)]
    is_by[0] &= mesh.is_flat
    return np.select(is_by, [to_plane, nearest], np.inf)


def _mesh_of(plan: Plan, number: int) -> Mesh:
    """The mesh of a plate or of the display, by its number among the parts."""
    kind = plan.parts.kind[number]
    if kind == Kind.DISPLAY:
        return plan.rig.display.mesh
    return plan.rig.plates[int((plan.parts.kind[:number] == kind).sum())].mesh
