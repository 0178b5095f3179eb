"""Sketch of a rig to draw over it: light paths, lost parts of the picture, distances.

Lines and texts are plain data; lengths in m, places in the world. An incomplete or unsolvable rig
is sketched as far as possible; without a plan there is no light. A picture in the viewer's own
pixels has no place, so it is drawn across the view at the glass's distance.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.messages import Message
from ..base.steps import Steps
from ..base.vectors import length_of, normalise
from ..light.display import affine_fit, uv_area
from ..light.light_paths import NOTHING, LightPath, Tails, following
from ..light.optics import reflect
from ..light.plan import Plan
from ..light.rays import REASON_WORDS, Reason, main_landings
from ..light.trace import tracing
from ..rig.rig import MET_ROLES, Kind, Mesh, PicturePlace, Rig, Viewer

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
MIDDLE = np.array([[0.5, 0.5]])
SPLIT = np.array([[0, 1, 2], [0, 2, 3]])
RECTANGLE = (
    1e-6  # of its size: deviation up to which a picture counts as a flat, affine, whole rectangle
)
OFF_TRIANGLE = 1e-9  # barycentric: distance beyond all triangles that is still on the picture


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture's triangles in space, with the image coordinates of their corners.

    corners : (t, 3, 3) m, world
    uv : (t, 3, 2) on the picture, 0..1 over all of it, v upward
    """

    corners: Floats
    uv: Floats

    def points(self, places: Floats) -> tuple[Floats, Bools]:
        """Points (n, 3) m of image places (n, 2), and whether they are on the picture (n,).

        Outside the picture's triangles the nearest one is extended.
        """
        best = np.full(len(places), -np.inf)
        points = np.full((len(places), 3), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            for corners, uv in zip(self.corners, self.uv, strict=True):
                weights = _weights(places, uv)
                inside = weights.min(axis=1)
                is_better = inside > best
                best[is_better] = inside[is_better]
                points[is_better] = weights[is_better] @ corners
        return points, best >= -OFF_TRIANGLE

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m, along the lower and the left edge."""
        points, _ = self.points(CORNERS)
        return float(length_of(points[1] - points[0])), float(length_of(points[3] - points[0]))


def _weights(places: Floats, uv: Floats) -> Floats:
    """Barycentric weights (n, 3) of places (n, 2) in a triangle (3, 2); not finite without area."""
    a, b = uv[1] - uv[0], uv[2] - uv[0]
    p = places - uv[0]
    area = a[0] * b[1] - a[1] * b[0]
    u = (p[:, 0] * b[1] - p[:, 1] * b[0]) / area
    v = (a[0] * p[:, 1] - a[1] * p[:, 0]) / area
    return np.stack([1 - u - v, u, v], axis=1)


def canvas_of(picture: PicturePlace, viewer: Viewer | None, towards: Floats) -> Canvas | None:
    """Canvas of a picture; None if it has no place.

    Parameters
    ----------
    towards : (3,) m, centre of the glass, for a picture in the viewer's pixels
    """
    if picture.mesh is not None:
        return _of_mesh(picture.mesh)
    if viewer is None:
        return None

    forward = viewer.axes[2]
    size = np.array([viewer.width, viewer.height])
    origins, directions = viewer.rays(np.abs(CORNERS - [0, 1]) * size)
    depth = float((towards - viewer.position) @ forward)
    if not depth > 0:
        return None

    corners = origins + (depth / (directions @ forward))[:, None] * directions
    return Canvas(corners[SPLIT], CORNERS[SPLIT])


def _of_mesh(mesh: Mesh) -> Canvas | None:
    """A mesh whose UV map is stretched over the whole image's square."""
    if mesh.uv is None or not len(mesh.triangles):
        return None
    flat = mesh.uv.reshape(-1, 2)
    low = flat.min(axis=0)
    extent = flat.max(axis=0) - low
    if not (np.isfinite(mesh.corners).all() and np.isfinite(extent).all() and extent.all()):
        return None

    canvas = Canvas(mesh.corners, (mesh.uv - low) / extent)
    return _as_rectangle(canvas) if len(mesh.triangles) > 2 else canvas


def _as_rectangle(canvas: Canvas) -> Canvas:
    """A flat rectangle reduced to two triangles, for quick lookups; any other canvas unchanged."""
    corners = canvas.corners.reshape(-1, 3)
    fit, missed = affine_fit(canvas.uv.reshape(-1, 2), corners)
    is_flat = missed <= RECTANGLE * np.ptp(corners, axis=0).max()
    if not (is_flat and abs(uv_area(canvas.uv) - 1) <= RECTANGLE):
        return canvas
    ends = np.column_stack([CORNERS, np.ones(4)]) @ fit
    return Canvas(ends[SPLIT], CORNERS[SPLIT])


def sight_lines(viewer: Viewer, points: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """Rays from a viewer to points (n, 3) m: origins, directions, distances (n,), is in the image
    (n,).

    Rays to points behind the viewer follow its axis.
    """
    xy = viewer.project(points)
    size = np.array([viewer.width, viewer.height])
    slack = OFF_TRIANGLE * size
    with np.errstate(invalid="ignore"):
        is_seen = ((xy >= -slack) & (xy <= size + slack)).all(axis=1)

    origins, directions = viewer.rays(np.where(np.isfinite(xy), xy, size / 2))
    distances = np.einsum("ni,ni->n", points - origins, directions)
    return origins, directions, np.where(np.isfinite(xy).all(axis=1), distances, np.nan), is_seen


def outline_of(corners: Floats) -> Floats:
    """Edges (e, 2, 3) of a single one of triangles (t, 3, 3)."""
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    # Number corners by place, so that triangles share them.
    _, place = np.unique(edges.reshape(-1, 3), axis=0, return_inverse=True)
    ends = np.sort(place.reshape(-1, 2), axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return edges[count[number.ravel()] == 1]


@dataclass(frozen=True)
class Hatch:
    """How lost parts are found and hatched; chosen by eye on pictures from 10 to 1000 px.

    n_grid : rays each way over the picture; each represents the part around it
    n_lines : hatch lines across a square picture, from corner to corner
    n_looks : samples of a line for each ray it passes
    """

    n_grid: int = 40
    n_lines: int = 36
    n_looks: int = 4


HATCH = Hatch()


def grid() -> Floats:
    """Centres (n n, 2) of the picture's parts, 0..1, row by row from below."""
    middles = (np.arange(HATCH.n_grid) + 0.5) / HATCH.n_grid
    u, v = np.meshgrid(middles, middles)
    return np.stack([u.ravel(), v.ravel()], axis=1)


def hatched(is_lost: Bools, size: tuple[float, float]) -> Floats:
    """Hatch lines (l, 2, 2) on the lost parts, with ends in picture coordinates, 0..1.

    Parameters
    ----------
    is_lost : (n n,) of the parts around `grid`
    size : width and height of the picture, m, so that lines rise at 45 degrees
    """
    if not (is_lost.any() and min(size) > 0):
        return np.empty((0, 2, 2))
    width, height = np.array(size) / max(size)

    # lines y = x + c on a picture of this width and height
    step = 2 / HATCH.n_lines
    offsets = np.arange(-width + step / 2, height, step)
    lines = [_on_line(is_lost, offset, width, height) for offset in offsets]
    return np.concatenate(lines)


def _on_line(is_lost: Bools, offset: float, width: float, height: float) -> Floats:
    """Pieces (l, 2, 2) of one line y = x + offset on lost parts."""
    start = max(0.0, -offset)
    stop = min(width, height - offset)
    n_looks = max(1, round((stop - start) * HATCH.n_grid * HATCH.n_looks / min(width, height)))
    ends = np.linspace(start, stop, n_looks + 1)
    middles = (ends[1:] + ends[:-1]) / 2
    places = np.stack([middles / width, (middles + offset) / height], axis=1)

    # where the line enters and leaves lost parts
    on = np.concatenate([[False], is_lost[_part_at(places)], [False]])
    first = ends[np.flatnonzero(on[1:] & ~on[:-1])]
    last = ends[np.flatnonzero(on[:-1] & ~on[1:])]
    x = np.stack([first, last], axis=1)
    return np.stack([x / width, (x + offset) / height], axis=2)


def _part_at(places: Floats) -> Ints:
    """Index (n,) of the picture's part at places (n, 2)."""
    column, row = np.clip(places * HATCH.n_grid, 0, HATCH.n_grid - 1).astype(np.int64).T
    return row * HATCH.n_grid + column


# distance of dimension lines from the centre, relative to half the glass's width
DIMENSION_DISTANCE = 1.2
LEAST_TURN = 1e-6  # sine of the angle below which two lines count as parallel


class Station(NamedTuple):
    """A part on the light's path, and the place (3,), m, from which distances to it are
    measured.
    """

    kind: Kind
    mesh: Mesh
    place: Floats


@dataclass(frozen=True, eq=False)
class Dimension:
    """Distance between two places (3,), m, drawn at `offset` (3,), m, from it."""

    start: Floats
    end: Floats
    offset: Floats

    @property
    def length(self) -> float:
        """Distance, m."""
        return float(np.linalg.norm(self.end - self.start))


def stations_of(rig: Rig, plan: Plan | None, way: LightPath | None) -> list[Station]:
    """Stations of a rig: the glass that light leaves last, plates and mirrors, the display.

    way : path of arriving light, preferably from the picture's centre. Stations are the parts on
        it, placed half way through the glass and at the other hits. Without a path, each kind with
        a single part is a station at its centre
    """
    by_kind = {role.kind: rig.of(role) for role in MET_ROLES if role.name != "BLOCKER"}
    if plan is not None:
        by_kind[Kind.DISPLAY] = (rig.display,)
    if plan is None or way is None:
        single = [
            kind for kind in (Kind.GLASS, Kind.PLATE, Kind.DISPLAY) if len(by_kind[kind]) == 1
        ]
        meshes = [by_kind[kind][0].mesh for kind in single]
        return [
            Station(kind, mesh, mesh.bounds.mean(axis=0))
            for kind, mesh in zip(single, meshes, strict=True)
            if is_placed(mesh)
        ]

    met = [int(part) for part in way.parts if part >= 0]
    kinds = [Kind(plan.parts.kind[part]) for part in met]
    places = way.points[way.parts >= 0]
    last_glass = max((k for k, kind in enumerate(kinds) if kind == Kind.GLASS), default=0)

    stations = []
    for k, (part, kind) in enumerate(zip(met, kinds, strict=True)):
        if k < last_glass or kind not in by_kind:
            continue
        place = places[k]
        if kind == Kind.GLASS:
            place = (places[met.index(part)] + place) / 2
        stations.append(Station(kind, by_kind[kind][_number(plan, part, kind)].mesh, place))
    return stations


def is_placed(mesh: Mesh) -> bool:
    """Whether a mesh has a finite place."""
    return len(mesh.triangles) > 0 and bool(np.isfinite(mesh.bounds).all())


def _number(plan: Plan, part: int, kind: Kind) -> int:
    """Index of a plan's part among the rig's parts of its kind."""
    if kind == Kind.GLASS:
        return int(plan.parts.owner[part])
    return int((plan.parts.kind[:part] == kind).sum())


def mirrored(points: Floats, stations: list[Station]) -> Floats | None:
    """Apparent places of display points (..., 3), seen by all plates and mirrors between.

    None if there are none, or if one is bent.
    """
    between = [s for s in stations if s.kind in {Kind.PLATE, Kind.MIRROR, Kind.HALF_MIRROR}]
    if not between or any(not station.mesh.is_flat for station in between):
        return None

    for station in reversed(between):
        corners = station.mesh.corners
        sides = corners[:, 1:] - corners[:, :1]
        across = np.cross(sides[:, 0], sides[:, 1])
        normal = normalise(across[np.argmax(length_of(across))])
        points = station.place + reflect(points - station.place, normal)
    return points


def dimensions_between(stations: list[Station]) -> tuple[Dimension, ...]:
    """Distances between successive stations, drawn next to the light path and clear of the
    glass.
    """
    glass = next((s.mesh for s in stations if s.kind == Kind.GLASS), None)
    pairs = list(pairwise(station.place for station in stations))
    if not pairs:
        return ()

    # Offset perpendicular to the plane in which light turns, otherwise level.
    lines = [end - start for start, end in pairs]
    across = np.cross(lines[0], lines[-1])
    if np.linalg.norm(across) <= LEAST_TURN * np.linalg.norm(lines[0]) * np.linalg.norm(lines[-1]):
        across = np.cross(lines[0], [0.0, 0.0, 1.0])
    if np.linalg.norm(across) <= LEAST_TURN * np.linalg.norm(lines[0]):
        across = np.array([1.0, 0.0, 0.0])
    across = normalise(across)

    reach = 0.1 * np.linalg.norm(lines[0])
    if glass is not None:
        reach = DIMENSION_DISTANCE * np.ptp(glass.vertices[np.unique(glass.triangles)] @ across) / 2
    return tuple(Dimension(start, end, reach * across) for start, end in pairs)


State = Literal["arrives", "lost", "aerial", "picture"]

TAIL = 0.06  # of the rig's size: drawn length of light that leaves the rig
REACH = 0.5  # of the rig's size: largest distance at which light counts as passing plate or display
GOLDEN = (5**0.5 - 1) / 2  # step of the second coordinate in a Fibonacci lattice
LEAST_LOST = 0.005  # of the picture: a smaller lost part gets no label
OUT_OF_VIEW = Message("outside the viewer's frame")
AERIAL = Message("mid-air image of the display")


class Line(NamedTuple):
    """Polyline through points (k, 3), and the meaning of its colour."""

    points: Floats
    state: State


class Note(NamedTuple):
    """Text at a place (3,)."""

    place: Floats
    text: str
    state: State


@dataclass(frozen=True, eq=False)
class SketchedLight:
    """Light of a picture.

    ways : paths of its corners, counterclockwise from the lower left, and of its centre; points
        behind the viewer are left out
    notes : reasons for lost light, each at its place
    hatch : (h, 2, 3) lines on the lost part of the picture
    """

    ways: tuple[LightPath, ...] = ()
    notes: tuple[Note, ...] = ()
    hatch: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(frozen=True, eq=False)
class Sketch:
    """Everything drawn of a rig.

    lines : light paths, outlines of the picture and its mid-air image
    """

    light: SketchedLight = field(default_factory=SketchedLight)
    lines: tuple[Line, ...] = ()
    notes: tuple[Note, ...] = ()
    dimensions: tuple[Dimension, ...] = ()


def sketching(rig: Rig, plan: Plan | None) -> Steps[Sketch]:
    """Sketch a rig, with a few rays if there is a plan."""
    canvas = _canvas(rig)
    light = SketchedLight()
    if plan is not None and canvas is not None:
        light = yield from _following_picture(plan, canvas)

    # An arriving path, preferably the centre's, shows which plates are between picture and display.
    chief = next((way for way in reversed(light.ways) if way.has_arrived), None)
    stations = stations_of(rig, plan, chief)
    aerial = _aerial_plane(rig, stations)
    lines = [Line(way.points, "arrives" if way.has_arrived else "lost") for way in light.ways]
    lines += [Line(edge, "aerial") for edge in aerial]
    if canvas is not None:
        lines += [Line(edge, "picture") for edge in outline_of(canvas.corners)]

    notes = list(light.notes)
    if len(aerial):
        ends = aerial.reshape(-1, 3)
        notes.append(Note(ends[np.argmax(ends[:, 2])], AERIAL, "aerial"))

    return Sketch(
        light=light,
        lines=tuple(line for line in lines if np.isfinite(line.points).all()),
        notes=tuple(note for note in notes if np.isfinite(note.place).all()),
        dimensions=dimensions_between(stations),
    )


def spread_paths(plan: Plan, count: int) -> Steps[list[LightPath]]:
    """Follow rays spread evenly over the picture as its viewer sees it, and return their paths.

    Fewer than `count` if parts of the picture's square are empty or outside the viewer's frame.
    """
    canvas = _canvas(plan.rig)
    if canvas is None:
        return []
    numbers = np.arange(count) + 0.5
    points, is_on = canvas.points(np.stack([numbers / count, numbers * GOLDEN % 1], axis=1))
    origins, directions, aims, is_seen = sight_lines(plan.viewer, points[is_on])
    rays = (values[is_seen] for values in (origins, directions, aims))
    size = size_of(plan.rig)
    paths = yield from following(plan, *rays, Tails(tail=TAIL * size, reach=REACH * size))
    return [path for path in paths if np.isfinite(path.points).all()]


def size_of(rig: Rig) -> float:
    """Size of a rig, m: the diagonal of the box around glass, plates, displays and screens."""
    extent = [part.mesh.bounds for part in (*rig.glasses, *rig.plates, *rig.lit)]
    return float(np.linalg.norm(np.ptp(np.concatenate(extent), axis=0)))


def _canvas(rig: Rig) -> Canvas | None:
    """Canvas of a rig's picture for its first viewer; None if it has no place."""
    glasses = [glass.mesh.bounds for glass in rig.glasses if is_placed(glass.mesh)]
    middle = np.mean(glasses, axis=(0, 1)) if glasses else np.zeros(3)
    viewer = rig.viewers[0] if rig.viewers else None
    return canvas_of(rig.picture_place, viewer, middle) if rig.pictures else None


def _aerial_plane(rig: Rig, stations: list[Station]) -> Floats:
    """Edges (e, 2, 3) of the display at its apparent place, seen by way of the plates."""
    nowhere = np.empty((0, 2, 3))
    if len(rig.displays) != 1 or not is_placed(rig.display.mesh):
        return nowhere
    seen = mirrored(outline_of(rig.display.mesh.corners), stations)
    return nowhere if seen is None else seen


def _following_picture(plan: Plan, canvas: Canvas) -> Steps[SketchedLight]:
    """Trace the light of a picture: corners, centre, and parts all over it."""
    size = size_of(plan.rig)
    tails = Tails(tail=TAIL * size, reach=REACH * size)

    # corners and centre
    points, _ = canvas.points(np.concatenate([CORNERS, MIDDLE]))
    origins, directions, aims, is_seen = sight_lines(plan.viewer, points)
    ways = yield from following(plan, origins, directions, aims, tails)
    marks = [
        (way, REASON_WORDS.get(way.reason, ""))
        if is_seen[i]
        else (_up_to(origins[i], points[i]), OUT_OF_VIEW)
        for i, way in enumerate(ways)
        if np.isfinite(aims[i])
    ]
    notes = [Note(way.points[-1], words, "lost") for way, words in marks if words]

    # lost parts
    points, is_on = canvas.points(grid())
    origins, directions, _, is_seen = sight_lines(plan.viewer, points)
    found = yield from tracing(plan, origins, directions)
    reason = main_landings(found, len(points)).reason
    is_lost = is_on & ~(is_seen & (reason == Reason.ARRIVED))
    words = np.array([REASON_WORDS.get(Reason(int(r)), "") for r in reason], object)
    words[~is_seen] = OUT_OF_VIEW
    noted = {note.text for note in notes}
    notes += _notes_on_parts(points, words, is_lost, noted)

    ends, _ = canvas.points(hatched(is_lost, canvas.size).reshape(-1, 2))
    return SketchedLight(tuple(way for way, _ in marks), tuple(notes), ends.reshape(-1, 2, 3))


def _up_to(origin: Floats, point: Floats) -> LightPath:
    """A straight path that ends at a point."""
    return LightPath(np.stack([origin, point]), np.full(2, NOTHING), Reason.MISSED_GLASS)


def _notes_on_parts(points: Floats, words: Ints, is_lost: Bools, noted: set[str]) -> list[Note]:
    """A note on each new reason for lost parts at points (n, 3), placed at their centre."""
    notes = []
    for text in sorted(set(words[is_lost]) - noted):
        some = points[is_lost & (words == text)]
        if len(some) >= LEAST_LOST * len(points):
            nearest = np.argmin(length_of(some - some.mean(axis=0)))
            notes.append(Note(some[nearest], text, "lost"))
    return notes
