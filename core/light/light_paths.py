"""Complete paths of a few rays, from the viewer to the display or to the point of loss.

Rays are traced as in a solve; their steps are joined to polylines.
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
NOTHING = -1  # no part: start of a path, or an end in empty space


@dataclass(frozen=True)
class Tails:
    """Lengths of paths beyond their last event, m.

    tail : of a ray into empty space
    reach : limit for a ray past the plate or the display; within it, the path ends on their plane,
        or else at its closest point to their centre
    """

    tail: float
    reach: float


@dataclass(frozen=True, eq=False)
class LightPath:
    """The path of a ray.

    points : (k, 3) m, world: the start, each surface hit, the end
    parts : (k,) numbers of the plan's parts hit there, or NOTHING
    reason : why the light is lost at the last point; ARRIVED for a landing
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
    """Follow rays and return their paths, in order.

    Parameters
    ----------
    origins, directions : (n, 3) m, world; unit directions; all starting in air
    aims : (n,) m, distance of the place each ray is aimed at; a ray past the glass ends a tail
        beyond
    """
    n = len(origins)
    steps: list[Step] = []
    found = yield from tracing(plan, origins, directions, steps=steps)
    landings = main_landings(found, n)

    ray = np.concatenate([step.rays for step in steps] or [np.empty(0, np.int64)])
    place = np.concatenate([step.place for step in steps] or [np.empty((0, 3))])
    triangle = np.concatenate([step.triangle for step in steps] or [np.empty(0, np.int64)])
    order = np.argsort(ray, kind="stable")
    first = np.searchsorted(ray[order], np.arange(n + 1))

    ends, end_parts, is_more = _ends(plan, landings, np.diff(first), triangle[order], first, tails)
    paths = []
    for i in range(n):
        events = order[first[i] : first[i + 1]]
        points = [origins[i : i + 1], place[events], ends[i : i + 1][is_more[i : i + 1]]]
        parts = plan.triangles.part[triangle[events]]
        of_end = end_parts[i : i + 1][is_more[i : i + 1]]
        path = LightPath(
            points=np.concatenate(points),
            parts=np.concatenate([[NOTHING], parts, of_end]).astype(np.int64),
            reason=Reason(int(landings.reason[i])),
        )
        paths.append(_shorten_missed(path, directions[i], aims[i] + tails.tail))
    return paths


def _shorten_missed(path: LightPath, direction: Floats, length: float) -> LightPath:
    """Shorten a path that missed the glass, if it meets nothing before; others are unchanged."""
    start = path.points[0]
    if path.reason != Reason.MISSED_GLASS:
        return path
    if len(path.points) > 2 and np.linalg.norm(path.points[1] - start) < length:
        return path
    points = np.stack([start, start + length * direction])
    return LightPath(points, np.full(2, NOTHING), path.reason)


def _ends(
    plan: Plan, landings: Landings, n_events: Ints, triangle: Ints, first: Ints, tails: Tails
) -> tuple[Floats, Ints, Bools]:
    """The last point (n, 3) of each path, the part (n,) there, and whether it differs from the last
    event.

    n_events : (n,) recorded events
    triangle : of all events, ray by ray; those of a ray start at `first` (n + 1,)
    """
    at = landings.positions.copy()
    part = np.full(len(at), NOTHING)

    # on a display beyond a plate, which records no event; or on a surface that ends all light
    has_landed = landings.n_events > n_events
    part[has_landed] = len(plan.parts) - 1
    is_met = n_events > 0
    last = plan.triangles.part[triangle[np.maximum(first[1:] - 1, 0)]] if len(triangle) else part
    ends_there = is_met & ENDS[plan.parts.kind[np.where(is_met, last, 0)]]
    is_over = (landings.reason == Reason.CUT_OFF) | (landings.reason == Reason.BLOCKED)
    goes_on = ~has_landed & ~ends_there & ~is_over

    # the others continue to the plane they pass, or into empty space
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
    """Distance (n,) from points (n, 3) to a part that rays pass: to its plane, or else to their
    closest point to its centre.

    inf if behind them or out of reach.
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
    """The mesh of a plate or of the display, by part number."""
    kind = plan.parts.kind[number]
    if kind == Kind.DISPLAY:
        return plan.rig.display.mesh
    return plan.rig.plates[int((plan.parts.kind[:number] == kind).sum())].mesh
