"""Follows a batch of rays to their landings."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import kernel
from .arrays import Bools, Floats, Ints, taken
from .curved import EDGE
from .kinds import Kind
from .meshes import interpolate
from .optics import plane_symmetry, reflect, refract
from .plan import Plan
from .plate import ArrayFrame, PlatePath
from .products import turn
from .ray_engine import Accept, Hits, slab
from .steps import Pauses, finish
from .vectors import dot, normalise

Words = NDArray[np.uint64]

PlateLight = Literal["imaged", "folded", "reflected"]

CHUNK = 1 << 16  # rays traced together: their arrays stay in the cache


class ReachedError(Exception):
    """A ray comes near glass that stands aside, not in the plan: `boxes`, numbers in the plan's `aside`."""

    def __init__(self, boxes: set[int]) -> None:
        super().__init__(boxes)
        self.boxes = boxes


class Reason(IntEnum):
    """Why a ray has no landing; 0 when it has one."""

    ARRIVED = 0
    MISSED_GLASS = 1
    LOST_INSIDE = 2
    MISSED_PLATE = 3
    BLOCKED = 4
    MISSED_DISPLAY = 5
    CUT_OFF = 6


REASON_WORDS = {
    Reason.MISSED_GLASS: "missed the glass",
    Reason.LOST_INSIDE: "lost inside the glass",
    Reason.MISSED_PLATE: "missed the plate",
    Reason.BLOCKED: "blocked",
    Reason.MISSED_DISPLAY: "missed the display",
    Reason.CUT_OFF: "cut off by Max Events",
}

# numbers that make up a branch: any odd multiplier mixes; it is the golden ratio's 64 bits
_MIX = np.uint64(0x9E3779B97F4A7C15)
_PASS, _TIR, _PLATE, _MIRROR, _LAND = range(1, 6)


@dataclass(frozen=True, eq=False)
class Landings:
    """Where and how the rays end.

    sample (n,) index of the ray asked for; reason (n,) of Reason; branch (n,) uint64, 0 where there is no landing;
    xy (n, 2) display pixels, x right and y down from the top left corner, NaN without a landing; positions and
    directions (n, 3) of the end, m, world; throughput (n,) of basic radiance; n_events (n,); plate_path (n,) of
    PlatePath; leak (n,) the part through whose gap a ray went in or out, -1 for none

    A ray that only just missed a flat display has branch and xy all the same, beyond the image: the cells at the
    display's border can then be cut there exactly. So has one that came to the display beside the glass, where the
    settings look beside it.
    """

    sample: Ints
    reason: np.ndarray
    branch: np.ndarray
    xy: Floats
    positions: Floats
    directions: Floats
    throughput: Floats
    n_events: Ints
    plate_path: np.ndarray
    leak: Ints

    @property
    def has_arrived(self) -> Bools:
        return self.reason == Reason.ARRIVED

    @property
    def is_beside_glass(self) -> Bools:
        """Did light come by way of the plate, beside the glass? None did where the settings do not look beside it."""
        return (self.reason == Reason.MISSED_GLASS) & (self.branch != 0)

    def pixels(self, width: int, height: int) -> tuple[Bools, Ints]:
        """Which (n,) are on the display's image of a size, and at which of its pixels, row by row; 0 for the others."""
        return self._pixels_of(self.has_arrived, width, height)

    def pixels_beside(self, width: int, height: int) -> tuple[Bools, Ints]:
        """The same of light beside the glass."""
        return self._pixels_of(self.is_beside_glass, width, height)

    def _pixels_of(self, some: Bools, width: int, height: int) -> tuple[Bools, Ints]:
        with np.errstate(invalid="ignore"):
            is_seen = some & (self.xy >= 0).all(axis=1) & (self.xy < (width, height)).all(axis=1)
        column, row = np.where(is_seen[:, None], self.xy, 0).astype(np.int64).T
        return is_seen, row * width + column


def join(parts: list[Landings]) -> Landings:
    """Landings of consecutive chunks as one."""
    return Landings(*(np.concatenate([getattr(p, name) for p in parts]) for name in Landings.__dataclass_fields__))


def trace_all(plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged") -> Landings:
    """Trace any number of rays (n, 3), in chunks; parameters are those of `trace`."""
    parts = []
    for first in range(0, max(len(origins), 1), CHUNK):
        some = trace(plan, origins[first : first + CHUNK], directions[first : first + CHUNK], light=light)
        some.sample[:] += first
        parts.append(some)
    return join(parts)


class Step(NamedTuple):
    """What became of rays between two events: those that met something, where and on which patch; and the others.

    rays (h,) and left (l,) indices; place (h, 3), patch and triangle (h,) of what was met; start and direction (l, 3)
    """

    rays: Ints
    place: Floats
    patch: Ints
    triangle: Ints
    left: Ints
    start: Floats
    direction: Floats


class _Rays:
    """The state of the rays of one batch; `live` are those still under way."""

    def __init__(
        self, origins: Floats, directions: Floats, course: Words | None, is_recorded: bool, light: PlateLight = "imaged"
    ) -> None:
        n = len(origins)
        self.positions = np.array(origins, float, order="C")
        self.directions = np.array(directions, float, order="C")
        self.mask = np.zeros(n, np.uint64)
        self.cluster = np.zeros(n, np.int64)
        self.reason = np.full(n, Reason.CUT_OFF, np.uint8)  # of those still under way in the end
        self.branch = np.zeros(n, np.uint64)
        self.xy = np.full((n, 2), np.nan)
        self.throughput = np.ones(n)
        self.n_events = np.zeros(n, np.int64)
        self.has_met_glass = np.zeros(n, bool)
        self.has_met_plate = np.zeros(n, bool)
        self.plate_path = np.full(n, PlatePath.NONE, np.uint8)
        self.light = light
        self.last_part = np.full(n, -1, np.int64)
        self.leak = np.full(n, -1, np.int64)
        self.live = np.arange(n)
        self.course, self.is_recorded = course, is_recorded
        self.n_words = np.zeros(n, np.int64)
        self.is_astray = np.zeros(n, bool)
        self.has_ended = np.zeros(n, bool)

    def add_to_branch(self, rays: Ints, patch: Ints, event: Ints | int) -> None:
        with np.errstate(over="ignore"):
            word = (patch * 8 + event + 1).astype(np.uint64)
            mixed = (self.branch[rays] ^ word) * _MIX
            self.branch[rays] = mixed ^ (mixed >> np.uint64(29))
        if self.course is None:
            return
        n_words = self.n_words[rays]
        width = self.course.shape[1]
        if self.is_recorded:
            if n_words.max(initial=0) >= width:
                self.course = np.pad(self.course, ((0, 0), (0, width)))
            self.course[rays, n_words] = self.branch[rays]
        else:
            expected = np.where(n_words < width, self.course[rays, np.minimum(n_words, width - 1)], np.uint64(0))
            self.is_astray[rays] = expected != self.branch[rays]
            self.has_ended[rays] |= self.is_astray[rays]
        self.n_words[rays] += 1


def courses(plan: Plan, origins: Floats, directions: Floats) -> Pauses[Words]:
    """What the branch of each ray (n, 3) was after each of its m events at the most: (n, m), for `trace` to compare."""
    rays = _Rays(origins, directions, np.zeros((len(origins), 8), np.uint64), is_recorded=True)
    yield from _following(plan, rays)
    return rays.course[:, : max(1, int(rays.n_words.max(initial=0)))]


def trace(plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged") -> Landings:
    """Landings of rays, traced at once; parameters as for `tracing`."""
    return finish(tracing(plan, origins, directions, light=light))


def tracing(
    plan: Plan,
    origins: Floats,
    directions: Floats,
    course: Words | None = None,
    steps: list[Step] | None = None,
    light: PlateLight = "imaged",
) -> Pauses[Landings]:
    """Follow rays backward from the viewer until each has landed on the display or is lost; pauses now and then.

    Parameters
    ----------
    origins, directions : (n, 3) float64, m, world; unit directions; all starting in air
    course : (n, m) as `courses` gives them: a ray is given up, without a landing, as soon as it leaves its course
    steps : is filled with what happened at each event
    light : which light is followed at mirror arrays: that of the mid-air image, as the mean over all phases; what goes
        where the mirrors stand, stray light and all; or first what the plate's face reflects, then such light.
        At ideal plates it is all the same.
    """
    rays = _Rays(origins, directions, course, False, light)
    yield from _following(plan, rays, steps)
    rays.xy[rays.is_astray] = np.nan
    return Landings(
        np.arange(len(origins)),
        rays.reason,
        np.where(np.isfinite(rays.xy[:, 0]), np.maximum(rays.branch, np.uint64(1)), np.uint64(0)),
        rays.xy,
        rays.positions,
        rays.directions,
        rays.throughput,
        rays.n_events,
        rays.plate_path,
        rays.leak,
    )


def _following(plan: Plan, rays: _Rays, steps: list[Step] | None = None) -> Pauses[None]:
    """Follow rays to their ends: by the compiled kernel where it can, else event by event."""
    if not kernel.can_follow(plan, rays, steps is not None):
        yield from _by_events(plan, rays, steps)
        return
    ways, reached = yield from kernel.follow(plan, rays, steps is not None)
    if reached:
        raise ReachedError(reached)
    if ways is not None:
        steps += _steps_of(plan, rays, ways)


def _steps_of(plan: Plan, rays: _Rays, ways: kernel.Ways) -> Iterator[Step]:
    """What became of rays at each event, from their ways."""
    for event, (places, met) in enumerate(zip(ways.places, ways.met, strict=True)):
        some, left = np.flatnonzero(met >= 0), np.flatnonzero(ways.left_at == event)
        if not len(some) + len(left):
            return
        triangle = met[some]
        ends = left, taken(rays.positions, left), taken(rays.directions, left)
        yield Step(some, taken(places, some), plan.patch[triangle], triangle, *ends)


def _by_events(plan: Plan, rays: _Rays, steps: list[Step] | None) -> Pauses[None]:
    """Follow rays, all of them from one event to the next."""
    for _ in range(plan.settings.max_events):
        if not len(rays.live):
            break
        hits, by_layer = yield from _first_hits(plan, rays)
        hit = hits.triangle >= 0
        left = rays.live[~hit]
        if not hit.all():
            _leave_gaps(plan, rays, left)
            _end_without_hit(plan, rays, left)
            rays.live, hits, by_layer = rays.live[hit], hits.at(hit), [other.at(hit) for other in by_layer]
        rays.positions[rays.live] += hits.distance[:, None] * rays.directions[rays.live]
        rays.n_events[rays.live] += 1
        _leave_gaps(plan, rays, rays.live, hits)
        if steps is not None:
            where = rays.live, rays.positions[rays.live], plan.patch[hits.triangle], hits.triangle
            steps.append(Step(*where, left, rays.positions[left], rays.directions[left]))
        part = plan.part[hits.triangle]
        kind = plan.kind[part]
        # glass in the same place as a sheet just met: the sheet must not be met once more from there
        is_beside = (kind == Kind.GLASS) & (hits.distance <= plan.merge_distance)
        rays.last_part[rays.live[~is_beside]] = plan.sheet[part[~is_beside]]
        for of_kind, meet in _MEETINGS.items():
            chosen = np.flatnonzero(kind == of_kind)
            if len(chosen):
                meet(plan, rays, rays.live[chosen], hits.at(chosen), [other.at(chosen) for other in by_layer])
        rays.live = rays.live[(kind != Kind.BLOCKER) & (kind != Kind.DISPLAY) & ~rays.has_ended[rays.live]]
        yield 0


class _Sides:
    """Which hits in a layer are true (decision 1): one enters a solid from outside and leaves it from inside.

    Sheets are met from either side, but the one just left not again at once. `gap` and `gap_distance` (n,) tell of the
    nearest face of an open solid that a ray came upon from the wrong side: it has gone in or out through a gap.
    """

    def __init__(self, plan: Plan, rays: _Rays) -> None:
        self.plan = plan
        live = rays.live
        self.mask, self.cluster, self.last_part = rays.mask[live], rays.cluster[live], rays.last_part[live]
        self.gap, self.gap_distance = np.full(len(live), -1), np.full(len(live), np.inf)

    def of_layer(self, numbers: Ints, tolerance: float) -> Accept:
        """The question for a layer whose triangles have these numbers in the plan."""
        plan = self.plan

        def accept(i: Ints, hits: Hits) -> tuple[Bools, Bools]:
            # what touches may be a little behind; not so other faces of what was just met, however thin it is
            t = hits.distance
            part = plan.part[numbers[hits.triangle]]
            bit = plan.bit[part]
            is_solid = bit != 0
            fits = hits.enters != (((self.mask[i] & bit) != 0) & (self.cluster[i] == plan.cluster[part]))
            is_last = plan.sheet[part] == self.last_part[i]
            is_new = (t > tolerance) | ~is_last & (t > -1e-3 * tolerance)
            is_behind = is_solid & ~fits & (t > tolerance)
            if plan.open_parts:
                self._note_gaps(i, t, part, is_behind & ~plan.is_closed[part])
            is_true = np.where(is_solid, fits & (t > np.where(is_last, -1e-3, -1.0) * tolerance), is_new)
            return is_true, is_behind & plan.is_closed[part]

        return accept

    def _note_gaps(self, i: Ints, distance: Floats, part: Ints, is_gap: Bools) -> None:
        nearer = np.flatnonzero(is_gap & (distance < self.gap_distance[i]))
        nearer = nearer[np.argsort(-distance[nearer], kind="stable")]  # nearest last, so that it is the one that stays
        self.gap[i[nearer]], self.gap_distance[i[nearer]] = part[nearer], distance[nearer]


def _first_hits(plan: Plan, rays: _Rays) -> Pauses[tuple[Hits, list[Hits]]]:
    """First hits of the live rays, and those of each layer that are no further. Triangles are the plan's."""
    live = rays.live
    origins, directions = rays.positions[live], rays.directions[live]
    sides = _Sides(plan, rays)
    by_layer = [None] * len(plan.layers)
    per_layer = plan.layers, plan.layer_triangles, plan.layer_bits, plan.layer_solids
    nearest = np.full(len(live), np.inf)
    # glass comes first: most of what else there is lies beyond, and then need not be asked
    order = sorted(enumerate(zip(*per_layer, strict=True)), key=lambda numbered: not numbered[1][0].has_engine)
    for number, (layer, numbers, closed_bits, bits) in order:
        tolerance = max(layer.tolerance, plan.merge_distance)
        leaves = None if layer.curved is None or bits is None else (sides.mask & bits[sides.cluster]) != 0
        is_inside = (sides.mask & closed_bits[sides.cluster]) != 0
        accept = sides.of_layer(numbers, tolerance)
        hits = yield from layer.find_first_hits(origins, directions, is_inside, accept, leaves, nearest + tolerance)
        found = hits.triangle >= 0
        hits.triangle[found] = numbers[hits.triangle[found]]
        nearest = np.minimum(nearest, hits.distance)
        by_layer[number] = hits
    first = by_layer[0]
    for hits in by_layer[1:]:
        nearer = hits.distance < first.distance
        if nearer.any():
            first = first.or_where(nearer, hits)
    if plan.aside:
        _keep_clear(plan, origins, directions, first.distance)
    came_in = sides.gap_distance < first.distance
    rays.leak[live[came_in]] = sides.gap[came_in]
    return first, by_layer


def _leave_gaps(plan: Plan, rays: _Rays, i: Ints, hits: Hits | None = None) -> None:
    """Take rays out of open solids that they have left through a gap: beyond the box, or where they meet nothing."""
    for number, box in plan.open_parts:
        is_in = ((rays.mask[i] & plan.bit[number]) != 0) & (rays.cluster[i] == plan.cluster[number])
        if hits is not None:
            at, part = rays.positions[i], plan.part[hits.triangle]
            is_beyond = ((at < box[0]) | (at > box[1])).any(axis=1)
            is_beyond |= (plan.bit[part] != 0) & (plan.cluster[part] != plan.cluster[number])
            is_in &= is_beyond & (part != number)
        gone = i[is_in]
        rays.mask[gone] &= ~plan.bit[number]
        rays.leak[gone] = number


def _keep_clear(plan: Plan, origins: Floats, directions: Floats, distance: Floats) -> None:
    """Raise ReachedError when a ray, on its way of a length of `distance` (n,), enters the box of what stands aside."""
    reached = set()
    for number, box in enumerate(plan.aside_boxes):
        enter, leave = slab(box, origins, directions)
        if ((enter <= leave) & (leave >= 0) & (enter <= distance)).any():
            reached.add(number)
    if reached:
        raise ReachedError(reached)


def _end_without_hit(plan: Plan, rays: _Rays, lost: Ints) -> None:
    rays.reason[lost] = np.select(
        [rays.mask[lost] != 0, ~rays.has_met_glass[lost], ~rays.has_met_plate[lost]],
        [Reason.LOST_INSIDE, Reason.MISSED_GLASS, Reason.MISSED_PLATE],
        Reason.MISSED_DISPLAY,
    )
    if plan.display_plane is not None:
        asked = lost[(rays.reason[lost] == Reason.MISSED_DISPLAY) | _is_beside_glass(plan, rays, lost)]
        xy, _, is_front = _on_plane(plan, rays, asked)
        rays.xy[asked[is_front]] = xy[is_front]
        rays.add_to_branch(asked[is_front], plan.patch[-1], _LAND)


def _on_plane(plan: Plan, rays: _Rays, i: Ints) -> tuple[Floats, Floats, Bools]:
    """Where rays meet the plane of a flat display: display px (n, 2), distance (n,) m, and do they meet its front?"""
    plane = plan.display_plane
    slope = dot(rays.directions[i], plane.normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = dot(plane.corner - rays.positions[i], plane.normal) / slope
        at = rays.positions[i] + t[:, None] * rays.directions[i] - plane.corner
        xy = turn(plane.pixels, at) + plane.origin
    return xy, t, (slope < 0) & (t > 0)


def _is_on_image(plan: Plan, xy: Floats) -> Bools:
    """Are display pixels (n, 2) within the image, or on its edge but for rounding?"""
    size = np.array([plan.rig.display.width, plan.rig.display.height])
    return ((xy >= -EDGE * size) & (xy <= (1 + EDGE) * size)).all(axis=1)


def _is_beside_glass(plan: Plan, rays: _Rays, i: Ints) -> Bools:
    """Is this light that comes by way of the plate, beside the glass, and is it looked for?"""
    return (rays.reason[i] == Reason.MISSED_GLASS) & rays.has_met_plate[i] & plan.settings.looks_beside


def _land_beyond_plate(plan: Plan, rays: _Rays, i: Ints) -> None:
    """End rays that have nothing before them but a flat display."""
    rays.has_ended[i] = True
    i = i[rays.n_events[i] < plan.settings.max_events]
    xy, t, is_front = _on_plane(plan, rays, i)
    with np.errstate(invalid="ignore"):
        hits = (t > 0) & _is_on_image(plan, xy)
    rays.positions[i[hits]] += t[hits, None] * rays.directions[i[hits]]
    rays.n_events[i[hits]] += 1
    has_met_glass = rays.has_met_glass[i]
    counts = has_met_glass | (not plan.settings.only_through_glass)
    rays.reason[i] = np.select(
        [hits & ~counts, hits & ~is_front, hits, ~has_met_glass],
        [Reason.MISSED_GLASS, Reason.BLOCKED, Reason.ARRIVED, Reason.MISSED_GLASS],
        Reason.MISSED_DISPLAY,
    )
    lands = np.isin(rays.reason[i], (Reason.ARRIVED, Reason.MISSED_DISPLAY)) | _is_beside_glass(plan, rays, i)
    lands &= is_front
    rays.xy[i[lands]] = xy[lands]
    rays.add_to_branch(i[lands], plan.patch[-1], _LAND)


def _shading_normals(plan: Plan, directions: Floats, hits: Hits) -> tuple[Floats, Floats]:
    """Geometric and shading normals (n, 3), both turned against the ray."""
    geometric = plan.normals[hits.triangle]
    shading = geometric
    if hits.facing is not None:
        curved = np.flatnonzero(_is_set(hits.facing))
        geometric[curved] = normalise(hits.facing[curved])
    if hits.normal is not None:
        curved = np.flatnonzero(_is_set(hits.normal))
        shading = geometric.copy()
        shading[curved] = normalise(hits.normal[curved])
    if plan.corner_normals is not None:
        bent = np.flatnonzero(plan.is_bent[hits.triangle])
        corners = plan.corner_normals[hits.triangle[bent]]
        shading = geometric.copy() if shading is geometric else shading
        shading[bent] = normalise(interpolate(corners, hits.u[bent], hits.v[bent]))
    front = hits.enters[:, None]
    if shading is geometric:
        geometric = np.where(front, geometric, -geometric)
        return geometric, geometric
    geometric, shading = np.where(front, geometric, -geometric), np.where(front, shading, -shading)
    # where the shading normal looks away from the ray the face's own one is kept
    away = dot(directions, shading) >= 0
    shading[away] = geometric[away]
    return geometric, shading


def _is_set(vectors: Floats) -> Bools:
    x, y, z = vectors.T  # a reduction over rows of three is several times slower
    return (x != 0) | (y != 0) | (z != 0)


def _meet_glass(plan: Plan, rays: _Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Cross or mirror at an interface; faces of other solids at the same place are crossed together with it."""
    part = plan.part[hits.triangle]
    # what is inside one cluster meets no other, but where curved faces stand out of their facets' boxes, or out of gaps
    before = np.where(rays.cluster[i] == plan.cluster[part], rays.mask[i], np.uint64(0))
    rays.cluster[i] = plan.cluster[part]
    after = before ^ plan.bit[part]
    for other in by_layer:
        same_place = (other.triangle >= 0) & (other.triangle != hits.triangle)
        same_place &= plan.cluster[plan.part[other.triangle]] == plan.cluster[part]  # a mask is of one cluster
        same_place &= np.abs(other.distance - hits.distance) <= plan.merge_distance
        after[same_place] ^= plan.bit[plan.part[other.triangle[same_place]]]
    n1, n2 = plan.media.index(part, before), plan.media.index(part, after)
    rays.has_met_glass[i] = True
    bends = n1 != n2
    if not bends.all():
        rays.mask[i[~bends]] = after[~bends]
        i, n1, n2, before, after, hits = i[bends], n1[bends], n2[bends], before[bends], after[bends], hits.at(bends)
    if not len(i):
        return
    directions = rays.directions[i]
    geometric, shading = _shading_normals(plan, directions, hits)
    out, is_tir, transmittance = refract(directions, shading, n1, n2)
    # a bent normal can send light to the wrong side of the face it met: there the face's own normal is used
    wrong = (dot(out, geometric) > 0) != is_tir
    if wrong.any():
        again = refract(directions[wrong], geometric[wrong], n1[wrong], n2[wrong])
        out[wrong], is_tir[wrong], transmittance[wrong] = again
    rays.directions[i] = normalise(out)
    # what is turned back may meet a sheet at this place again, but not other faces of the glass that are behind it
    rays.last_part[i[is_tir]] = plan.part[hits.triangle[is_tir]]
    rays.mask[i] = np.where(is_tir, before, after)
    if plan.settings.brightness:
        rays.throughput[i] *= transmittance
    rays.add_to_branch(i, plan.patch[hits.triangle], np.where(is_tir, _TIR, _PASS))


def _meet_plate(plan: Plan, rays: _Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    part = plan.part[hits.triangle]
    is_ideal = np.ones(len(i), bool)
    for number, array in plan.arrays.items():
        some = np.flatnonzero(part == number)
        if len(some):
            _meet_array(plan, array, rays, i[some])
            is_ideal[some] = False
    if is_ideal.any():
        ideal = i[is_ideal]
        rays.directions[ideal] = plane_symmetry(rays.directions[ideal], plan.normals[hits.triangle[is_ideal]])
        rays.plate_path[ideal] = np.maximum(rays.plate_path[ideal], PlatePath.IMAGED)
    rays.has_met_plate[i] = True
    rays.add_to_branch(i, plan.patch[hits.triangle], _PLATE)
    goes_along = (dot(rays.directions[i], plan.normals[hits.triangle]) > 0).astype(int)
    clear = plan.is_clear[part, goes_along]
    if clear.any():
        _land_beyond_plate(plan, rays, i[clear])


def _meet_array(plan: Plan, array: ArrayFrame, rays: _Rays, i: Ints) -> None:
    is_again = rays.has_met_plate[i]
    again = "folded" if rays.light == "reflected" else rays.light
    for light, some in ((rays.light, i[~is_again]), (again, i[is_again])):
        if not len(some):
            continue
        crossing = getattr(array, light)(rays.positions[some], rays.directions[some])
        rays.positions[some], rays.directions[some] = crossing.positions, crossing.directions
        before = rays.plate_path[some]
        rays.plate_path[some] = np.where(before > PlatePath.IMAGED, before, crossing.path)
        if plan.settings.brightness:
            rays.throughput[some] *= crossing.throughput


def _meet_mirror(plan: Plan, rays: _Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    directions = rays.directions[i]
    geometric, shading = _shading_normals(plan, directions, hits)
    out = reflect(directions, shading)
    wrong = dot(out, geometric) < 0
    out[wrong] = reflect(directions[wrong], geometric[wrong])
    rays.directions[i] = normalise(out)
    rays.add_to_branch(i, plan.patch[hits.triangle], _MIRROR)


def _meet_blocker(plan: Plan, rays: _Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    rays.reason[i] = Reason.BLOCKED


def _meet_display(plan: Plan, rays: _Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End here: with a landing when the light came by glass and plate to the display's front.

    Light that carries no picture, but is followed to see all there is, may come past the plate.
    """
    is_front = dot(rays.directions[i], plan.normals[hits.triangle]) < 0
    counts = rays.has_met_glass[i] | (not plan.settings.only_through_glass)
    reason = np.select(
        [~counts, ~rays.has_met_plate[i] & (rays.light == "imaged"), ~is_front],
        [Reason.MISSED_GLASS, Reason.MISSED_PLATE, Reason.BLOCKED],
        Reason.ARRIVED,
    )
    rays.reason[i] = reason
    rays.add_to_branch(i, plan.patch[hits.triangle], _LAND)
    u, v = interpolate(plan.rig.display.mesh.uv[hits.triangle - plan.display_start], hits.u, hits.v).T
    xy = np.stack([u * plan.rig.display.width, (1 - v) * plan.rig.display.height], axis=1)
    lands = (reason == Reason.ARRIVED) | _is_beside_glass(plan, rays, i) & is_front
    rays.xy[i] = np.where(lands[:, None], xy, np.nan)
    is_off = (reason == Reason.ARRIVED) & ~_is_on_image(plan, xy)  # the UV map leaves the image
    rays.reason[i[is_off]] = Reason.MISSED_DISPLAY


_MEETINGS = {
    Kind.GLASS: _meet_glass,
    Kind.PLATE: _meet_plate,
    Kind.MIRROR: _meet_mirror,
    Kind.BLOCKER: _meet_blocker,
    Kind.DISPLAY: _meet_display,
}
