"""The bench drawing: parts to scale, their corners, and the lattice in the viewer's image."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, product
from string import ascii_uppercase
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.messages import Message
from ...base.vectors import cross_2d, dot, length_of, normalise
from ...glass.meshes import Edges, edge_corners, find_edges, geometric_normals
from ...image.flat_picture import view_of_picture
from ...rig.rig import WAVELENGTH, Mesh, Rig, Role, Viewer
from ..calibrate.drawn import Lattice
from .svg import GLASS, MARGIN, PART, PICTURE, SIGHT, TEXT, THIN, Paper, PaperSheet, decimal, spread

# edges between facets with a larger cosine are not drawn
CREASE = np.cos(np.radians(30))


@dataclass(frozen=True, eq=False)
class Rectangle:
    """The smallest rectangle around a flat part, parallel to its longest side.

    corners : (4, 3) m, world: lower left, lower right, upper right, upper left, of its image if it
        has one, else as seen from its front
    normal : (3,) unit, to its front
    """

    corners: Floats
    normal: Floats

    @property
    def centre(self) -> Floats:
        """Middle (3,), m."""
        return self.corners.mean(axis=0)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m."""
        width, height = length_of(np.diff(self.corners[:3], axis=0))
        return float(width), float(height)


def contour(mesh: Mesh, direction: Floats) -> Floats:
    """Edges (e, 2, 3), m, of a mesh in a drawing.

    They are the rim, creases of more than 30 degrees outside smooth surfaces, and the silhouette in
    a direction (3,). Hidden edges are included, because glass is transparent.
    """
    edges = find_edges(mesh.triangles)
    corners = mesh.corners
    normals = geometric_normals(corners)

    # the silhouette
    is_facing = dot(normals, direction) > 0
    turns = (is_facing[edges.first] != is_facing[edges.second]) ^ edges.is_same_way
    is_smooth = np.zeros(len(corners), bool) if mesh.is_smooth is None else mesh.is_smooth
    is_bent = dot(normals[edges.first], normals[edges.second]) < CREASE
    is_crease = is_bent & ~(is_smooth[edges.first] & is_smooth[edges.second])
    inner, _ = edge_corners(corners, edges)

    return np.concatenate([inner[turns | is_crease], _rim(mesh, edges)])


def _rim(mesh: Mesh, edges: Edges) -> Floats:
    """Edges (e, 2, 3), m, with one triangle or with more than two; `edges` has all others."""
    is_paired = np.zeros((len(mesh.triangles), 3), bool)
    is_paired[edges.first, edges.corner_first] = True
    is_paired[edges.second, edges.corner_second] = True
    triangle, corner = np.nonzero(~is_paired)
    corners = mesh.corners
    return np.stack([corners[triangle, corner], corners[triangle, (corner + 1) % 3]], axis=1)


def rectangle(mesh: Mesh) -> Rectangle | None:
    """The rectangle around a flat part; None if it is not flat or has no rim."""
    edges = _rim(mesh, find_edges(mesh.triangles))
    if not (mesh.is_flat and len(edges)):
        return None

    # axes along the longest side
    normal = normalise(geometric_normals(mesh.corners).sum(axis=0))
    sides = edges[:, 1] - edges[:, 0]
    across = normalise(sides[length_of(sides).argmax()])
    axes = np.stack([across, np.cross(normal, across)])

    points = edges.reshape(-1, 3)
    places = np.einsum("ni,ki->nk", points - points[0], axes)
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    box = np.array([[left, low], [right, low], [right, high], [left, high]])
    corners = points[0] + np.einsum("nk,ki->ni", box, axes)

    return Rectangle(_from_lower_left(corners, mesh), normal)


def _from_lower_left(corners: Floats, mesh: Mesh) -> Floats:
    """Corners (4, 3), rotated to begin at the lower left of the image by its UV map; unchanged
    without a UV map.
    """
    if mesh.uv is None:
        return corners

    points = mesh.corners.reshape(-1, 3)
    nearest = [length_of(points - corner).argmin() for corner in corners]
    uv = mesh.uv.reshape(-1, 2)[nearest]
    if cross_2d(uv[1] - uv[0], uv[2] - uv[1]) < 0:  # the UV map is mirrored
        corners, uv = corners[::-1], uv[::-1]
    return np.roll(corners, -int(uv.sum(axis=1).argmin()), axis=0)


UPRIGHT = 1e-6  # horizontal part of a unit vector; below it, a viewer looks straight up or down


@dataclass(frozen=True, eq=False)
class Datum:
    """The origin and axes of the bench's coordinates.

    name : description of the origin
    place : (3,) m, world
    axes : (3, 3) unit rows: the viewer's horizontal forward direction; the viewer's right; up
    """

    name: str
    place: Floats
    axes: Floats

    def of(self, points: Floats) -> Floats:
        """Coordinates forward, right and up of points (..., 3), m."""
        return np.einsum("...i,ki->...k", points - self.place, self.axes)


@dataclass(frozen=True, eq=False)
class StandingPart:
    """A part in the bench's coordinates.

    rectangle : of a flat part, else None
    box : (2, 3) m, bounds of its vertices
    centre : (3,) m
    tilt : degrees to the horizontal; None if not flat
    azimuth : degrees of its front from forward to the right; None if not flat, or horizontal
    """

    role: Role
    part: Any
    rectangle: Rectangle | None
    box: Floats
    centre: Floats
    tilt: float | None
    azimuth: float | None

    @property
    def size(self) -> tuple[float, ...]:
        """Width and height of a flat part, or length, width and height of the box, m."""
        return tuple(np.ptp(self.box, axis=0)) if self.rectangle is None else self.rectangle.size


def level_axes(viewer: Viewer) -> Floats:
    """Horizontal forward, horizontal right and up (3, 3) of a viewer; up is world +z."""
    up = np.array([0.0, 0.0, 1.0])
    forward = viewer.axes[2] * (1, 1, 0)
    if np.linalg.norm(forward) < UPRIGHT:  # it looks down: the top of its image is ahead
        forward = viewer.axes[1] * (1, 1, 0)
    forward = normalise(forward)
    return np.stack([forward, np.cross(forward, up), up])


def find_datum(rig: Rig, viewer: Viewer) -> Datum:
    """The datum: middle of the lowest edge of the first plate, or of the display without plates.

    Of equally low edges, the nearest to the viewer counts.
    """
    axes = level_axes(viewer)
    for part in (*rig.plates, rig.display):
        found = rectangle(part.mesh)
        if found is not None:
            middles = (found.corners + np.roll(found.corners, -1, axis=0)) / 2
            forward, _, up = np.round(middles @ axes.T, 9).T
            lowest = np.lexsort([forward, up])[0]
            return Datum(
                Message("middle of the lowest edge of '{part}'", part=part.name),
                middles[lowest],
                axes,
            )

    bounds = rig.display.mesh.bounds
    return Datum(
        Message("middle of the box around '{part}'", part=rig.display.name),
        bounds.mean(axis=0),
        axes,
    )


def standing(rig: Rig, datum: Datum) -> list[StandingPart]:
    """All parts with a mesh, in the order of the roles."""
    return [
        _standing(role, part, datum)
        for role, part in rig.parts()
        if getattr(part, "mesh", None) is not None
    ]


def _standing(role: Role, part: Any, datum: Datum) -> StandingPart:
    vertices = datum.of(part.mesh.corners.reshape(-1, 3))
    box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    flat = rectangle(part.mesh)
    if flat is None:
        return StandingPart(role, part, None, box, box.mean(axis=0), None, None)

    forward, right, up = flat.normal @ datum.axes.T
    tilt = np.degrees(np.arccos(min(1.0, abs(up))))
    # rounded, or straight back would be 180 or -180 at random
    right = np.round(right, 9) + 0.0
    azimuth = np.degrees(np.arctan2(right, forward)) if np.hypot(forward, right) > UPRIGHT else None
    return StandingPart(role, part, flat, box, datum.of(flat.centre), float(tilt), azimuth)


# paper per bench; the largest that fits is used
SCALES = (5, 2, 1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200, 1 / 500, 1 / 1000)
MM = 1e3
EXPLAINED = 3  # lines of text below the table
MOST_TABLE = 0.4  # of the sheet's height; a table with more parts has smaller letters
ROW = 1.6 * TEXT  # mm, height of a table row
RULER = 16.0  # mm, width of a view's rulers
TITLE = 8.0  # mm
HEADING = 6.0  # mm, above a view
VIEW_BORDER = np.array([RULER, RULER + HEADING])
PENS = {"GLASS": GLASS, "PICTURE": PICTURE}
COLUMNS = (6.0, 42.0, 16.0, 44.0, 20.0, 20.0, 20.0, 14.0, 18.0, 77.0)  # mm
HEADINGS = (
    "",
    "Part",
    "Role",
    "Size",
    "Forward",
    "Right",
    "Up",
    "Tilt",
    "Azimuth",
    "",
)


@dataclass(frozen=True, eq=False)
class View:
    """A view: projection of the bench onto the sheet.

    across, up : bench axis across and up the paper; 0 forward, 1 right, 2 up
    sign : of the axis up the paper
    origin : (2,) mm, datum on the sheet
    scale : mm on paper per mm of the bench
    """

    name: str
    across: int
    up: int
    sign: int
    origin: Floats
    scale: float

    def on_paper(self, points: Floats) -> Floats:
        """Points (..., 3), m in the bench's coordinates, on the sheet (..., 2), mm."""
        x = points[..., self.across]
        y = self.sign * points[..., self.up]
        return self.origin + MM * self.scale * np.stack([x, -y], axis=-1)

    def view_direction(self, datum: Datum) -> Floats:
        """The direction of view (3,), world."""
        rest = 3 - self.across - self.up
        return datum.axes[rest]


def draw_bench(rig: Rig, viewer: Viewer, paper: Paper = "A4") -> str:
    """The bench as SVG: side view, plan view and a table of the parts. Lengths in mm.

    Forward is to the right in both views. The viewer is outside of the sheet.

    Parameters
    ----------
    rig : after `check`
    paper : landscape; the scale is the largest in SCALES that fits both views
    """
    datum = find_datum(rig, viewer)
    parts = standing(rig, datum)
    sheet = PaperSheet(paper)
    width, height = sheet.size
    rows = [HEADINGS, *map(_row, letters(), parts)]
    below = ROW * EXPLAINED
    table = min(ROW * (len(rows) + 1), (height - 2 * MARGIN) * MOST_TABLE)
    bottom = height - MARGIN - below - table
    views = _fitted(parts, np.array([[MARGIN, MARGIN + TITLE], [width - MARGIN, bottom]]))

    scale = views[0].scale
    written = f"{scale:g} : 1" if scale >= 1 else f"1 : {1 / scale:g}"
    sheet.text((MARGIN, MARGIN + 4), "Kiriko: the bench", size=4.5)
    sheet.text(
        (width - MARGIN, MARGIN + 4),
        Message(
            "Scale {scale} on {paper}; lengths in mm, angles in degrees",
            scale=written,
            paper=paper,
        ),
        "end",
    )

    for view in views:
        _draw_view(sheet, view, viewer, datum, parts)
    y = sheet.table((MARGIN, bottom), COLUMNS, rows, table)
    for line in _explained(viewer, datum):
        y += ROW
        sheet.text((MARGIN, y), line)
    return sheet.svg()


def letters() -> Iterator[str]:
    """Letters of the parts: A to Z, AA, AB and so on."""
    for n in count(1):
        for some in product(ascii_uppercase, repeat=n):
            yield "".join(some)


def _fitted(parts: list[StandingPart], room: Floats) -> tuple[View, View]:
    """Side view and plan view in an area (2, 2) of the sheet, mm: one above the other, or side by
    side if the scale is larger then.
    """
    boxes = np.stack([part.box for part in parts] + [np.zeros((2, 3))])
    low = MM * boxes[:, 0].min(axis=0)
    high = MM * boxes[:, 1].max(axis=0)
    sizes = (high - low)[np.array([[0, 2], [0, 1]])]
    below, abreast = (_scale(sizes, room[1] - room[0], along) for along in (1, 0))
    along, scale = (0, abreast) if abreast > below else (1, below)

    # upper left corners of the views; spare space is distributed evenly
    each = scale * sizes + VIEW_BORDER
    used = each.max(axis=0)
    used[along] = each[:, along].sum()
    spare = (room[1] - room[0] - used) / np.where([along == 0, along == 1], 4, 2)
    first = room[0] + spare + (RULER, HEADING)
    second = first.copy()
    second[along] += each[0, along] + 2 * spare[along]

    return (
        View("Side", 0, 2, 1, first + scale * np.array([-low[0], high[2]]), scale),
        View("Plan", 0, 1, -1, second + scale * np.array([-low[0], -low[1]]), scale),
    )


def _scale(sizes: Floats, room: Floats, along: int) -> float:
    """The largest scale in SCALES for views of sizes (2, 2), mm of the bench, in an area (2,), mm
    of paper, arranged along x (0) or y (1).
    """
    need = sizes.max(axis=0)
    need[along] = sizes[:, along].sum()
    free = room - VIEW_BORDER * np.where([along == 0, along == 1], 2, 1)
    most = (free / need).min()
    return next((scale for scale in SCALES if scale <= most), most)


def _draw_view(
    sheet: PaperSheet, view: View, viewer: Viewer, datum: Datum, parts: Sequence[StandingPart]
) -> None:
    """Draw the parts with their letters, the line of sight, and rulers."""
    boxes = np.concatenate([view.on_paper(part.box) for part in parts] + [view.origin[None]])
    low = boxes.min(axis=0)
    high = boxes.max(axis=0)
    sheet.text((low[0] - RULER + 3, low[1] - 2), view.name, size=3.2)

    named: dict[tuple[float, float], str] = {}  # letters of parts with a common middle
    for letter, part in zip(letters(), parts, strict=False):
        lines = view.on_paper(datum.of(contour(part.part.mesh, view.view_direction(datum))))
        sheet.lines(lines, PENS.get(part.role.name, PART))
        middle = view.on_paper(part.centre)
        sheet.dots([middle], 0.4)
        x, y = (float(round(number)) for number in middle.tolist())
        named[x, y] = f"{named.get((x, y), '')} {letter}".strip()

    for (x, y), there in named.items():
        sheet.text((x + 0.8, y - 0.8), there, size=3.2)

    _draw_sight(sheet, view, viewer, datum, low, high)
    x, y = view.origin
    sheet.lines([[[x - 2, y], [x + 2, y]], [[x, y - 2], [x, y + 2]]], PART)
    centres = np.stack([part.centre for part in parts])
    _draw_ruler(sheet, view, centres, False, high[1] + 3)
    _draw_ruler(sheet, view, centres, True, low[0] - 3)


def _draw_sight(
    sheet: PaperSheet, view: View, viewer: Viewer, datum: Datum, low: Floats, high: Floats
) -> None:
    """Draw the central line of sight where it crosses the view."""
    place, ray = (x[0] for x in viewer.rays(np.array([[viewer.width / 2, viewer.height / 2]])))
    start = view.on_paper(datum.of(place))
    step = view.on_paper(datum.of(place + ray)) - start
    if abs(step[0]) < 1e-9:
        return
    times = (np.array([low[0] - RULER / 2, high[0]]) - start[0]) / step[0]
    ends = start + np.clip(times, 0, None)[:, None] * step
    is_near = (ends[:, 1] > low[1] - RULER) & (ends[:, 1] < high[1] + RULER)
    if is_near.all():
        sheet.lines([ends], SIGHT)


def _draw_ruler(
    sheet: PaperSheet, view: View, centres: Floats, is_upright: bool, ruler_at: float
) -> None:
    """Draw distances of centres (n, 3) from the datum, on a ruler below or to the left of the
    view.
    """
    axis, k = (view.up, 1) if is_upright else (view.across, 0)
    marks = np.concatenate([np.zeros((1, 3)), centres])
    on_paper = view.on_paper(marks)
    values = [decimal(number) for number in MM * marks[:, axis]]

    # equal values share a label
    _, first = np.unique(values, return_index=True)
    gap = min(ROW * 0.8, (np.ptp(on_paper[:, k]) + RULER) / len(first))
    size = gap / 1.28
    labels = spread(on_paper[first, k], gap)

    for n, at in zip(first, labels, strict=True):
        mark = on_paper[n]
        near = np.where([k == 0, k == 1], mark[k], ruler_at)
        far = np.where([k == 0, k == 1], at, ruler_at + (-3 if is_upright else 3))
        sheet.lines([[mark, near], [near, far]], THIN)
        if is_upright:
            sheet.text((far[0] - 0.5, far[1] + 0.35 * size), values[n], "end", size)
        else:
            sheet.turned_text((far[0] + 0.35 * size, far[1] + 0.5), values[n], size)


def _row(letter: str, part: StandingPart) -> tuple[str, ...]:
    """A part's row in the table."""
    size = " x ".join(decimal(MM * length) for length in part.size)
    places = (decimal(number) for number in MM * part.centre)
    angles = ("" if x is None else decimal(x) for x in (part.tilt, part.azimuth))
    return letter, part.part.name, part.role.label, size, *places, *angles, _make(part)


def _make(part: StandingPart) -> str:
    """Further data of a part for its maker."""
    thing = part.part
    if part.role.name == "GLASS":
        return Message("index {n:.4f}", n=thing.ior.at(WAVELENGTH))
    if part.role.name == "DISPLAY":
        text = Message("{width} x {height} px", width=thing.width, height=thing.height)
        if part.rectangle is None:
            return text
        pitch = MM * np.array(part.size) / (thing.width, thing.height)
        return Message("{text}, pitch {x:.4f} x {y:.4f}", text=text, x=pitch[0], y=pitch[1])
    if part.role.name == "PLATE" and thing.array is not None:
        return Message(
            "mirrors: pitch {pitch:.3f}, height {height:.3f}",
            pitch=MM * thing.array.pitch,
            height=MM * thing.array.height,
        )
    return ""


def _explained(viewer: Viewer, datum: Datum) -> tuple[str, ...]:
    """The text below the table."""
    eye = datum.of(viewer.position)
    forward, right, up = map(decimal, MM * eye)
    return (
        Message(
            "Measured from the {datum} (+). Forward is horizontal, in the viewer's viewing"
            " direction; right is the viewer's right. Glass sizes are listed as forward, right,"
            " up.",
            datum=datum.name,
        ),
        Message(
            "Tilt is measured from the horizontal. Azimuth is the direction of the part's front,"
            " measured from forward towards the right. Viewer '{viewer}' (eye, dash-dotted line):"
            " forward {forward}, right {right}, up {up}.",
            viewer=viewer.name,
            forward=forward,
            right=right,
            up=up,
        ),
    )


CORNERS = "Lower left", "Lower right", "Upper right", "Upper left"
UNNAMED = "Corner 1", "Corner 2", "Corner 3", "Corner 4"
CORNER_COLUMNS = (42.0, 26.0, 20.0, 20.0, 20.0)  # mm
CROSS = 2.0 * np.array([[[-1, 0], [1, 0]], [[0, -1], [0, 1]]])  # mm
SEEN_TITLE = 12.0  # mm
BETWEEN = 8.0  # mm between the table and the viewer's image


def draw_seen(rig: Rig, viewer: Viewer, lattice: Lattice, paper: Paper = "A4") -> str:
    """The corners of all flat parts in mm from the datum, and the lattice in the viewer's image, as
    SVG.

    Raises
    ------
    RigError : the picture is not a flat rectangle
    """
    datum = find_datum(rig, viewer)
    sheet = PaperSheet(paper)
    width, height = sheet.size
    sheet.text((MARGIN, MARGIN + 4), "Kiriko: corners, and the lattice as seen", size=4.5)
    sheet.text((width - MARGIN, MARGIN + 4), "Lengths in mm; pixels of the viewer", "end")

    rows = [("Part", "Corner", "Forward", "Right", "Up")]
    for part in standing(rig, datum):
        rows += _corner_rows(part, datum.of)
    room = height - 2 * MARGIN - SEEN_TITLE - 4 * TEXT
    bottom = sheet.table((MARGIN, MARGIN + SEEN_TITLE), CORNER_COLUMNS, rows, room)
    sheet.text(
        (MARGIN, bottom + 2 * TEXT),
        Message("Measured from the {datum}, as in the bench drawing.", datum=datum.name),
    )

    left = MARGIN + sum(CORNER_COLUMNS) + BETWEEN
    room = np.array([[left, MARGIN + SEEN_TITLE], [width - MARGIN, height - MARGIN - 4 * TEXT]])
    points = view_of_picture(rig.picture_place, viewer, lattice.uv)
    _draw_image(sheet, viewer, lattice, points, room)
    return sheet.svg()


def _corner_rows(part: StandingPart, of: Callable[[Floats], Floats]) -> list[tuple[str, ...]]:
    """Table rows of a flat part's corners."""
    if part.rectangle is None:
        return []
    names = (
        ("Corner 1", "Corner 2", "Corner 3", "Corner 4") if part.part.mesh.uv is None else CORNERS
    )
    return [
        (part.part.name if n == 0 else "", name, *map(decimal, MM * place))
        for n, (name, place) in enumerate(zip(names, of(part.rectangle.corners), strict=True))
    ]


def _draw_image(
    sheet: PaperSheet, viewer: Viewer, lattice: Lattice, points: Floats, room: Floats
) -> None:
    """Draw the viewer's image in an area (2, 2), mm, with points (n, 2), px, and the pixel
    coordinates of the lattice's corners.
    """
    size = np.array([viewer.width, viewer.height], float)
    scale = ((room[1] - room[0]) / size).min()
    start = room[0]

    def on_paper(xy: Floats) -> Floats:
        return start + scale * xy

    frame = on_paper(size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    sheet.lines(np.stack([frame, np.roll(frame, -1, axis=0)], axis=1), PART)
    middle = on_paper(size / 2)
    sheet.lines(middle + CROSS, THIN)

    grid = points.reshape(lattice.rows, lattice.columns, 2)
    ring = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2::-1, 0]])
    ends = on_paper(np.stack([ring[:-1], ring[1:]], axis=1))
    sheet.lines(ends, PICTURE)
    is_inside = ((points >= 0) & (points <= size)).all(axis=1)
    sheet.dots(on_paper(points[is_inside]), 0.5)

    corners = grid[[0, 0, -1, -1], [0, -1, -1, 0]]
    for n, (x, y) in enumerate(corners.tolist()):
        across, down = on_paper(np.array([x, y]))
        below = 2.5 + TEXT * 0.8 if n > 1 else -2.5
        sheet.text((across, down + below), f"{x:.1f}, {y:.1f}", "middle")

    sheet.text(
        (start[0], on_paper(size)[1] + 1.6 * TEXT),
        Message(
            "Viewer '{viewer}', {width} x {height} px, x to the right and y down from the upper"
            " left corner: {columns} x {rows} points.",
            viewer=viewer.name,
            width=viewer.width,
            height=viewer.height,
            columns=lattice.columns,
            rows=lattice.rows,
        ),
    )
