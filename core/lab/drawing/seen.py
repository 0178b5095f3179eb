"""Where the lattice's points should be seen by the viewer, and where corners stand on the bench."""

from collections.abc import Callable

import numpy as np

from ...base.arrays import Floats
from ...base.messages import Message
from ...image.flat_picture import view_of_picture
from ...rig.rig import Rig, Viewer
from ..calibrate.drawn import Lattice
from .bench import Standing, find_datum, standing
from .sheet import MARGIN, PART, PICTURE, TEXT, THIN, Paper, Sheet, decimal

MM = 1e3
CORNERS = "Lower left", "Lower right", "Upper right", "Upper left"
UNNAMED = "Corner 1", "Corner 2", "Corner 3", "Corner 4"
CORNER_COLUMNS = (42.0, 26.0, 20.0, 20.0, 20.0)  # mm
CROSS = 2.0 * np.array([[[-1, 0], [1, 0]], [[0, -1], [0, 1]]])  # mm
BETWEEN = 8.0  # mm from the table to the viewer's image
TITLE = 12.0  # mm


def draw_seen(rig: Rig, viewer: Viewer, lattice: Lattice, paper: Paper = "A4") -> str:
    """As SVG: on the left the corners of all flat parts, mm from the bench's datum; on
    the right the viewer's image, with the points of the lattice in the picture's place.

    Raises
    ------
    RigError : the picture is no flat rectangle
    """
    datum = find_datum(rig, viewer)
    sheet = Sheet(paper)
    width, height = sheet.size
    sheet.text((MARGIN, MARGIN + 4), "Kiriko: corners, and the lattice as seen", size=4.5)
    sheet.text((width - MARGIN, MARGIN + 4), "Lengths in mm; pixels of the viewer", "end")

    rows = [("Part", "Corner", "Forward", "Right", "Up")]
    for part in standing(rig, datum):
        rows += _corner_rows(part, datum.of)
    room = height - 2 * MARGIN - TITLE - 4 * TEXT
    bottom = sheet.table((MARGIN, MARGIN + TITLE), CORNER_COLUMNS, rows, room)
    sheet.text(
        (MARGIN, bottom + 2 * TEXT),
        Message("From the {datum}, as on the sheet of the bench.", datum=datum.name),
    )

    left = MARGIN + sum(CORNER_COLUMNS) + BETWEEN
    room = np.array([[left, MARGIN + TITLE], [width - MARGIN, height - MARGIN - 4 * TEXT]])
    points = view_of_picture(rig.picture_place, viewer, lattice.uv)
    _draw_image(sheet, viewer, lattice, points, room)
    return sheet.svg()


def _corner_rows(part: Standing, of: Callable[[Floats], Floats]) -> list[tuple[str, ...]]:
    """Lines of a flat part's corners."""
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
    sheet: Sheet, viewer: Viewer, lattice: Lattice, points: Floats, room: Floats
) -> None:
    """Draw the viewer's image into room (2, 2), mm, with the points (n, 2), px, and the
    pixels of the lattice's corners.
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

    # the corners' pixels
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
