"""Light of a rig's picture: paths, landings, and the fraction that arrives.

Rays are those of the viewer, straight through points in space. The light of a place is independent
of the picture there, so one bundle serves pictures of any size within its reach. Points spread
evenly over the picture each represent the part around them. If neighbours take different paths, a
strip between them may be lost without containing a point, as at the edges of cut glass: there the
picture is divided further, at up to a few times the work.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import RigError
from ..base.steps import hold_progress, subprogress
from ..base.vectors import cross_2d, normalise
from ..glass.meshes import areas_of, geometric_normals
from ..light.plan import Plan
from ..light.rays import BY_GAPS, REASON_WORDS, Reason, Step, main_landings
from ..light.trace import tracing
from ..rig.mesh import Mesh
from ..rig.rig import Kind, PicturePlace, Rig
from ..rig.viewer import Viewer

IS_FLAT = 1e-4  # of its size: how far a flat part may leave its plane


@dataclass(frozen=True, eq=False)
class Outline:
    """Outline of a flat part.

    middle : (3,) m, world, centre of its extents along the axes
    axes : (2, 3) unit, along its sides
    edges : (e, 2, 2) m along the axes, from the centre
    half : (2,) m, half of its width and height
    """

    middle: Floats
    axes: Floats
    edges: Floats
    half: Floats

    def across(self, places: Floats) -> Floats:
        """Points (n, 3) in the outline's coordinates: (n, 2) m from its centre."""
        return (places - self.middle) @ self.axes.T

    def reach(self, across: Floats, about: Floats) -> Floats:
        """Scale (n,) of the outline that just reaches points (n, 2) if its centre is at (2,)."""
        start, end = np.moveaxis(self.edges, 1, 0)
        along = end - start
        p = (across - about)[:, None]
        steep = cross_2d(p, along[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            # The ray t p meets the edge at start + s along.
            t = cross_2d(start, along) / steep
            s = cross_2d(np.broadcast_to(start, (len(p), *start.shape)), p) / steep
            is_met = (t > 0) & (s >= -IS_FLAT) & (s <= 1 + IS_FLAT)
            outermost = np.where(is_met, t, 0.0).max(axis=1)
            return np.where(outermost > 0, 1 / outermost, 0.0)

    def changed(self, mesh: Mesh, size: float, shift: Floats) -> Mesh:
        """The part's mesh scaled by `size` about its centre, and moved by (3,) m."""
        return replace(mesh, vertices=self.middle + size * (mesh.vertices - self.middle) + shift)


def outline_of(mesh: Mesh, along: Floats, owner: str) -> Outline:
    """Outline of a flat mesh.

    Parameters
    ----------
    along : (3,) world, along one of its sides
    owner : name of the part at the beginning of a sentence

    Raises
    ------
    RigError : the mesh is not flat
    """
    normal = geometric_normals(mesh.corners)[areas_of(mesh.corners).argmax()]
    x = normalise(along - (along @ normal) * normal)
    axes = np.stack([x, np.cross(normal, x)])
    origin = mesh.corners[0, 0]
    points = mesh.corners.reshape(-1, 3) - origin
    across = points @ axes.T
    size = np.ptp(across, axis=0).max()
    if np.ptp(points @ normal) > IS_FLAT * size:
        raise RigError("{owner} isn't flat: set the size by hand.", owner=owner)

    middle = across.min(axis=0) / 2 + across.max(axis=0) / 2
    vertices = (mesh.vertices - origin) @ axes.T - middle
    return Outline(
        middle=origin + middle @ axes,
        axes=axes,
        edges=vertices[_borders(mesh)],
        half=np.ptp(across, axis=0) / 2,
    )


def _borders(mesh: Mesh) -> Ints:
    """Edges (e, 2) of a single triangle, as vertex indices."""
    pairs = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, counts = np.unique(pairs, axis=0, return_counts=True)
    return edges[counts == 1]


RAYS_AT_ONCE = 5000  # batch size: Esc is checked between batches


@dataclass(frozen=True, eq=False)
class Light:
    """Light of n points, in their order.

    is_seen : (n,) whether the point lies in the viewer's image
    reason : (n,) Reason; BLOCKED outside the image
    branch : (n,) the light's branch, 0 if it ended on the way
    positions : (n, 3) m, of the ends
    has_leaked : (n,) whether it went through a gap in open glass
    into_glass, out_of_glass : (n, 3) m, first and last hit on glass, NaN for none
    at_plate : (n, 3) m, first hit on the given plate, NaN for none
    """

    is_seen: Bools
    reason: NDArray[np.uint8]
    branch: NDArray[np.uint64]
    positions: Floats
    has_leaked: Bools
    into_glass: Floats
    out_of_glass: Floats
    at_plate: Floats

    @property
    def has_arrived(self) -> Bools:
        """Whether points are seen and their light lands on the display, (n,)."""
        return self.is_seen & (self.reason == Reason.ARRIVED)

    def lost(self, weight: Floats) -> dict[str, float]:
        """Fractions of the visible weight (n,) that do not arrive, by reason as text.

        Light through a gap counts under this reason only.
        """
        seen = np.where(self.is_seen, weight, 0.0)
        whole = max(float(seen.sum()), np.finfo(float).tiny)
        by_reason = {
            word: float(seen[~self.has_leaked & (self.reason == number)].sum()) / whole
            for number, word in REASON_WORDS.items()
        }
        is_in_gap = self.has_leaked & (self.reason != Reason.ARRIVED)
        by_reason[BY_GAPS] = float(seen[is_in_gap].sum()) / whole
        return {word: share for word, share in by_reason.items() if share > 0}


def together(lights: Sequence[Light]) -> Light:
    """Light of several viewers joined, their points in succession."""
    return Light(
        **{
            field.name: np.concatenate([getattr(light, field.name) for light in lights])
            for field in fields(Light)
        }
    )


def light_of(
    plan: Plan, points: Floats, plate: Outline | None = None
) -> Generator[float, None, Light]:
    """Trace the viewer's rays through points (n, 3), m; yields progress 0..1.

    plate : outline of a plate whose hits are recorded
    """
    viewer = plan.viewer
    xy = viewer.project(points)
    is_seen = ((xy >= 0) & (xy <= (viewer.width, viewer.height))).all(axis=1)  # false for NaN too
    light = Light(
        is_seen=is_seen,
        reason=np.full(len(points), Reason.BLOCKED, np.uint8),
        branch=np.zeros(len(points), np.uint64),
        positions=np.full((len(points), 3), np.nan),
        has_leaked=np.zeros(len(points), bool),
        into_glass=np.full((len(points), 3), np.nan),
        out_of_glass=np.full((len(points), 3), np.nan),
        at_plate=np.full((len(points), 3), np.nan),
    )

    seen = np.flatnonzero(is_seen)
    origins, directions = viewer.rays(xy[seen])
    for first in range(0, len(seen), RAYS_AT_ONCE):
        some = slice(first, first + RAYS_AT_ONCE)
        steps: list[Step] = []
        found = yield from hold_progress(
            first / len(seen), tracing(plan, origins[some], directions[some], steps=steps)
        )
        of = seen[some]
        landings = main_landings(found, len(of))
        light.reason[of] = landings.reason
        light.branch[of] = landings.branch
        light.positions[of] = landings.positions
        light.has_leaked[of] = landings.leak >= 0
        _note_meetings(plan, light, of, steps)
        if plate is not None:
            _note_plate(plan, light, of, steps, plate)

    return light


def _note_meetings(plan: Plan, light: Light, of: Ints, steps: list[Step]) -> None:
    """Record the first and last hit on glass of the rays of points `of`."""
    for step in steps:
        is_glass = _kind(plan, step) == Kind.GLASS
        ray = of[step.rays[is_glass]]
        place = step.place[is_glass]
        is_new = np.isnan(light.into_glass[ray, 0])
        light.into_glass[ray[is_new]] = place[is_new]
        light.out_of_glass[ray] = place


def _note_plate(plan: Plan, light: Light, of: Ints, steps: list[Step], plate: Outline) -> None:
    """Record the first hit on a plate of the rays of points `of`."""
    normal = np.cross(*plate.axes)
    for step in steps:
        off = np.abs((step.place - plate.middle) @ normal)
        is_here = (_kind(plan, step) == Kind.PLATE) & (off <= IS_FLAT * plate.half.max())
        ray = of[step.rays[is_here]]
        is_new = np.isnan(light.at_plate[ray, 0])
        light.at_plate[ray[is_new]] = step.place[is_here][is_new]


def _kind(plan: Plan, step: Step) -> Ints:
    """Kind of part (h,) that each ray of a step hits."""
    return plan.parts.kind[plan.triangles.part[step.triangle]]


MOST = 0.95  # fraction of the light without its outermost part


N_GRID = 128  # points along each edge of a triangle of the picture


@dataclass(frozen=True, eq=False)
class Spread:
    """Light of a picture on the plane of its display.

    across : (n, 2) m, along the display's width and height, from its centre to the landings
    weight : (n,) fraction of the picture
    off_display_weight : (m,) fraction of the picture whose light misses the display on its plane
    lost : fractions of the visible picture that do not arrive, by reason
    leaked : fraction of the picture that arrives through gaps in open glass
    """

    across: Floats
    weight: Floats
    off_display_weight: Floats
    lost: dict[str, float]
    leaked: float

    @property
    def unseen(self) -> dict[str, float]:
        """`lost`, with light that arrives through gaps counted as lost."""
        leaked = self.lost.get(BY_GAPS, 0.0) + self.leaked
        return {**self.lost, BY_GAPS: leaked} if leaked else self.lost

    def width(self, aspect: float, share: float = 1.0) -> float:
        """Width, m, of a display that receives a given fraction of the arriving light.

        aspect : the display's width by its height
        """
        if not len(self.across):
            return 0.0
        half = self._half_widths(aspect)
        order = np.argsort(half)
        within = np.cumsum(self.weight[order])
        last = np.searchsorted(within, share * within[-1]) if share < 1 else len(order) - 1
        return 2 * float(half[order[last]])

    def _half_widths(self, aspect: float) -> Floats:
        return np.maximum(np.abs(self.across[:, 0]), np.abs(self.across[:, 1]) * aspect)


def points_of(place: PicturePlace, n: int = 0) -> tuple[Floats, Floats, Floats]:
    """Points (n, 3) spread evenly over the triangles of a picture.

    Returns their UV (n, 2) and the area (n,) each represents as well.
    """
    return points_over(place.mesh.corners, place.mesh.uv, n or N_GRID)


def points_over(corners: Floats, uv: Floats, n: int) -> tuple[Floats, Floats, Floats]:
    """`points_of` for triangles (t, 3, 3) with UV (t, 3, 2) and n points along each edge.

    Each triangle is divided into small ones, whose corners represent a third of each.
    """
    # corners of the small triangles, in barycentric coordinates
    a, b = (x.ravel() for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
    a, b = a[a + b <= n], b[a + b <= n]
    c = n - a - b
    n_at_borders = (a == 0).astype(int) + (b == 0) + (c == 0)
    area = np.array([6, 3, 1])[n_at_borders] / (3 * n**2)

    weights = np.stack([a, b, c], axis=1) / n
    points, at = (
        np.einsum("pk,tkc->tpc", weights, x).reshape(-1, x.shape[-1]) for x in (corners, uv)
    )
    return points, at, (areas_of(corners)[:, None] * area).ravel()


def small_triangles(n: int, n_triangles: int) -> Ints:
    """Small triangles (m, 3) of `points_over`, as indices of its points."""
    b, a = np.indices((n + 1, n + 1)).reshape(2, -1)
    b, a = b[a + b <= n], a[a + b <= n]
    number = np.full((n + 2, n + 2), -1)
    number[b, a] = np.arange(len(a))
    b, a = b[a + b < n], a[a + b < n]
    lower = np.stack([number[b, a], number[b, a + 1], number[b + 1, a]], axis=1)
    upper = np.stack([number[b, a + 1], number[b + 1, a + 1], number[b + 1, a]], axis=1)
    one = np.concatenate([lower, upper[(upper >= 0).all(axis=1)]])
    n_points = (n + 1) * (n + 2) // 2
    return (n_points * np.arange(n_triangles)[:, None, None] + one).reshape(-1, 3)


def spread_of(plan: Plan, display_frame: Floats) -> Generator[float, None, Spread]:
    """Trace the light of a picture that faces the viewer; yields progress 0..1.

    Parameters
    ----------
    plan : of a rig with the largest display allowed
    display_frame : (4, 4) of the display, m
    """
    points, _, area = points_of(plan.rig.picture_place)
    light = yield from light_of(plan, points)
    return spread_in(light, area, display_frame)


def spread_in(light: Light, area: Floats, display_frame: Floats) -> Spread:
    """Spread of traced light.

    Parameters
    ----------
    area : (n,) of the light's points, from `points_of`
    display_frame : (4, 4) of the display, m
    """
    seen = np.where(light.is_seen, area, 0.0)
    weight = seen / max(seen.sum(), np.finfo(float).tiny)
    across = (light.positions - display_frame[:3, 3]) @ display_frame[:3, :2]
    arrived = light.has_arrived
    off_display = light.is_seen & (light.reason == Reason.MISSED_DISPLAY)
    return Spread(
        across=across[arrived],
        weight=weight[arrived],
        off_display_weight=weight[off_display],
        lost=light.lost(weight),
        leaked=float(weight[arrived & light.has_leaked].sum()),
    )


PlanOf = Callable[[Rig], Plan]


# Repeated divisions of a triangle's edge between different paths. MOST_RAYS limits them, because in
# cut crystal paths differ everywhere.
PARTS_ALONG, MOST_DIVISIONS, MOST_RAYS = 4, 3, 60_000


def place_in_sight(place: PicturePlace, viewer: Viewer) -> PicturePlace:
    """A picture with a plane: its own, or one before the viewer for an image of the viewer's
    pixels.
    """
    if place.mesh is not None:
        return place

    corners = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
    origins, directions = viewer.rays(corners * (viewer.width, viewer.height))
    ahead = directions @ viewer.axes[2]
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return replace(
        place, mesh=Mesh(origins + directions / ahead[:, None], triangles, uv=uv[triangles])
    )


@dataclass(frozen=True, eq=False)
class TracedPicture:
    """Light of a rig's picture at places uv (n, 2).

    area : (n,) fraction of the picture at each place; `weight` is 0 at places out of sight
    """

    light: Light
    uv: Floats
    area: Floats

    @property
    def weight(self) -> Floats:
        return np.where(self.light.is_seen, self.area, 0.0)

    @property
    def lost(self) -> dict[str, float]:
        return self.light.lost(self.area)

    @property
    def share(self) -> float:
        """Fraction of the picture that arrives."""
        return 1.0 - sum(self.lost.values())


def traced(rig: Rig, plan_of: PlanOf, n_grid: int = 0) -> Generator[float, None, TracedPicture]:
    """Trace the light of a rig's picture to its first viewer; yields progress 0..1."""
    return (yield from traced_by_all(replace(rig, viewers=rig.viewers[:1]), plan_of, n_grid))


def traced_by_all(
    rig: Rig,
    plan_of: PlanOf,
    n_grid: int = 0,
    plate: Outline | None = None,
    is_fine: bool = False,
) -> Generator[float, None, TracedPicture]:
    """`traced` for all viewers in succession, with equal weight.

    is_fine : divide the picture further between different paths
    """
    plan, n = plan_of(rig), len(rig.viewers)
    lights, uvs, areas = [], [], []
    for k, viewer in enumerate(rig.viewers):
        place = place_in_sight(rig.picture_place, viewer)
        steps = _light_over(plan.seen_by(viewer), place, n_grid, plate, is_fine)
        light, uv, area = yield from subprogress(steps, k / n, (k + 1) / n)
        seen = float(area[light.is_seen].sum())
        lights.append(light)
        uvs.append(uv)
        areas.append(area / max(seen, np.finfo(float).tiny) / n)
    return TracedPicture(together(lights), np.concatenate(uvs), np.concatenate(areas))


def _light_over(
    plan: Plan, place: PicturePlace, n_grid: int, plate: Outline | None, is_fine: bool
) -> Generator[float, None, tuple[Light, Floats, Floats]]:
    """Light of points over a picture, their UV (n, 2) and areas (n,); yields progress 0..1."""
    n = n_grid or N_GRID
    points, uv, area = points_of(place, n)
    small = small_triangles(n, len(place.mesh.triangles))
    light = yield from subprogress(light_of(plan, points, plate), 0.0, 0.4 if is_fine else 1.0)
    lights, uvs, areas = [light], [uv], [area]
    for level in range(MOST_DIVISIONS if is_fine else 0):
        parts = small[_part(light, small)]
        times = min(PARTS_ALONG, int(np.sqrt(2 * MOST_RAYS / max(len(parts), 1))) - 1)
        if not len(parts) or times < 2:
            break
        # Their area passes to the new points between them.
        np.subtract.at(areas[-1], parts, areas_of(points[parts])[:, None] / 3)
        points, uv, area = points_over(points[parts], uv[parts], times)
        small = small_triangles(times, len(parts))
        steps = light_of(plan, points, plate)
        light = yield from subprogress(steps, 0.4 + 0.2 * level, 0.6 + 0.2 * level)
        lights.append(light)
        uvs.append(uv)
        areas.append(area)
    whole = np.maximum(np.concatenate(areas), 0.0)  # rounding
    return together(lights), np.concatenate(uvs), whole


def _part(light: Light, triangles: Ints) -> Bools:
    """Whether the light of a triangle's (m, 3) corners takes different paths, (m,)."""
    ways = (light.branch, light.reason, light.is_seen)
    return np.any([(way[triangles] != way[triangles[:, :1]]).any(axis=1) for way in ways], axis=0)
