"""How two eyes see the picture, drawn over it: vertical and horizontal disparity of each point, and
its depth.

A panel for each of the ways to show it, before and after compensation. All have one scale.
"""

import base64
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.numbers import number
from ...base.vectors import length_of
from ...bench.picture_room import plane_of
from ...files.encoding import quantised
from ...files.png import encoded
from ...rig.rig import Rig
from .diagram import FONT, text_at
from .places_seen import grid_of
from .two_eyes import Sights, TwoEyes

FILE = "two_eyes.svg"
WAYS = ("uncompensated", "for_left", "for_right", "for_both")  # fields of TwoEyes
# px
WIDTH = 330  # of the picture
GAP = 30
HEAD = 46  # over a picture, for its words
TOP = 60
MOST_PIXELS = 220  # of the picture's own, each way
FADED = 0.25
LONGEST = 0.42  # of the way between two points: the longest arrow, and the largest disc
# the longest arrow and the largest disc tell of so much, arcmin and m, or of more
LEAST = {"vertical": 0.01, "horizontal": 0.01, "depth": 1e-5}
MORE, LESS = "#c8501e", "#0b6e99"  # than nothing


def as_data(found: TwoEyes) -> dict[str, Any]:
    """What two eyes see, as it stands in a report: for each way to show the picture lists of rows
    from the top; None for points that not both see, and for depths beyond infinity.
    """
    told: dict[str, Any] = {"left": found.left, "right": found.right}
    for name in WAYS:
        sights = getattr(found, name)
        told[name] = {
            "n_points": int(sights.is_seen.sum()),
            "mean_horizontal_arcmin": sights.mean_horizontal,
            "largest_horizontal_arcmin": sights.largest_horizontal,
            "mean_vertical_arcmin": sights.mean_vertical,
            "largest_vertical_arcmin": sights.largest_vertical,
            "vertical_arcmin": _rows(sights.vertical),
            "horizontal_arcmin": _rows(sights.horizontal),
            "depth_m": _rows(sights.depth),
        }
    return told


def _rows(values: Floats) -> list[list[float | None]]:
    return [[x if np.isfinite(x) else None for x in row] for row in values.tolist()]


def as_svg(rig: Rig, found: TwoEyes) -> str:
    """The drawing: a column for each way to show the picture: arrows up and down, arrows aside,
    discs.

    Raises
    ------
    RigError : the picture is no flat rectangle; one sentence
    """
    across, up = length_of(plane_of(rig).sides)
    size = np.array([WIDTH, WIDTH * up / across])
    picture = _embedded(rig, size)
    sights = [getattr(found, name) for name in WAYS]
    scales = _scales(sights)
    titles = (
        "uncompensated",
        f"solved for '{found.left}'",
        f"solved for '{found.right}'",
        "solved for both",
    )

    parts = []
    for column, (title, one) in enumerate(zip(titles, sights, strict=True)):
        for row, (words, marks) in enumerate((
            (_vertical_words(one), _arrows(one, size, "vertical", scales)),
            (_horizontal_words(one), _arrows(one, size, "horizontal", scales)),
            (_depth_words(one), _discs(one, size, scales["depth"])),
        )):  # fmt: skip
            x = GAP + column * (WIDTH + GAP)
            y = TOP + HEAD + row * (size[1] + HEAD + GAP)
            parts += [
                f'<g transform="translate({x:.1f} {y:.1f})">',
                text_at((0, -26), title, size=14),
                text_at((0, -9), words, fill="#555555"),
                picture,
                *marks,
                "</g>",
            ]
    width = GAP + len(WAYS) * (WIDTH + GAP)
    height = TOP + 3 * (size[1] + HEAD + GAP)
    title = (
        "Two eyes, over the picture. Above, arcmin: arrows up where the left eye sees a point"
        " higher than the right eye does.",
        "Middle, arcmin: arrows to the right where they converge more than for the picture's plane."
        " Below, mm: full discs before that plane, rings behind it.",
    )
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}"'
        f' viewBox="0 0 {width:.0f} {height:.0f}" font-family="{FONT}">',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>',
        *(text_at((GAP, 26 + 20 * n), line, size=15) for n, line in enumerate(title)),
        *parts,
        "</svg>",
        "",
    ])  # fmt: skip


def _scales(sights: list[Sights]) -> dict[str, float]:
    """The largest disparities, arcmin, and the largest depth that is not beyond infinity, m, of all
    panels, by the fields of `Sights`.
    """
    found = {}
    for field, least in LEAST.items():
        values = np.concatenate([getattr(one, field).ravel() for one in sights])
        found[field] = float(np.abs(values[np.isfinite(values)]).max(initial=least))
    return found


def _places(sights: Sights, size: Floats) -> tuple[Floats, float]:
    """Where points (n, n, 2) stand in a panel, px, and the length of the longest mark."""
    n = len(sights.vertical)
    uv = grid_of(n).reshape(n, n, 2)
    return np.stack([uv[..., 0], 1 - uv[..., 1]], axis=2) * size, LONGEST * size.min() / n


def _arrows(sights: Sights, size: Floats, field: str, scales: dict[str, float]) -> list[str]:
    """Arrows for a disparity: upward where the left eye sees a point higher, to the right where it
    sees it farther to the right.
    """
    places, longest = _places(sights, size)
    along = np.array([0.0, -1.0] if field == "vertical" else [1.0, 0.0])
    beside = np.array([4.0, 4.0] if field == "vertical" else [4.0, 12.0])  # px, for the number
    parts = []
    for middle, value in zip(places.reshape(-1, 2), getattr(sights, field).ravel(), strict=True):
        if not np.isfinite(value):
            continue
        way = longest * value / scales[field] * along
        start, end = middle - way, middle + way
        across = 0.3 * way[::-1]
        barbs = end - 0.3 * way + across, end - 0.3 * way - across
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = start, end, *barbs
        parts += [
            f'<path class="arrow" d="M{x0:.2f},{y0:.2f} L{x1:.2f},{y1:.2f}'
            f' M{x2:.2f},{y2:.2f} L{x1:.2f},{y1:.2f} L{x3:.2f},{y3:.2f}" fill="none"'
            f' stroke="{MORE if value > 0 else LESS}" stroke-width="2"/>',
            text_at(tuple(middle + beside), rounded(value), size=8),
        ]
    return parts


def rounded(value: float) -> str:
    """A number to a hundredth, without a sign where that is 0."""
    return f"{round(value, 2) + 0.0:.2f}"


def _discs(sights: Sights, size: Floats, scale: float) -> list[str]:
    """Discs for depth, by their area: full where a point is seen before the plane."""
    places, longest = _places(sights, size)
    parts = []
    for (x, y), depth in zip(places.reshape(-1, 2), sights.depth.ravel(), strict=True):
        if np.isnan(depth):
            continue
        text = "beyond" if np.isinf(depth) else rounded(1e3 * depth)
        if np.isfinite(depth):
            radius = longest * np.sqrt(abs(depth) / scale)
            paint = f'fill="{MORE}" fill-opacity="0.6"' if depth > 0 else (
                f'fill="none" stroke="{LESS}" stroke-width="2"'
            )  # fmt: skip
            parts.append(
                f'<circle class="disc" cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}" {paint}/>'
            )
        parts.append(text_at((x, y + 3), text, "middle", size=9))
    return parts


def _vertical_words(sights: Sights) -> str:
    if not sights.is_seen.any():
        return "no point is seen by both eyes"
    mean, most = sights.mean_vertical, sights.largest_vertical
    return f"vertical disparity: mean {number(mean)}, largest {number(most)} arcmin"


def _horizontal_words(sights: Sights) -> str:
    if not sights.is_seen.any():
        return "no point is seen by both eyes"
    mean, most = sights.mean_horizontal, sights.largest_horizontal
    return f"horizontal disparity: mean {number(mean)}, largest {number(most)} arcmin"


def _depth_words(sights: Sights) -> str:
    if not sights.is_seen.any():
        return "no point is seen by both eyes"
    ends = (sights.nearest_depth, sights.farthest_depth)
    near, far = ("beyond infinity" if np.isinf(x) else f"{rounded(1e3 * x)} mm" for x in ends)
    return f"depth: from {near} (nearest) to {far} (farthest)"


def _embedded(rig: Rig, size: Floats) -> str:
    """The picture, faded, in its outline; the outline alone where it has no pixels, or its UV map
    goes beyond them.
    """
    frame = (
        f'<rect width="{size[0]:.2f}" height="{size[1]:.2f}" fill="none" stroke="black"'
        ' stroke-width="1"/>'
    )
    uv = rig.picture_place.mesh.uv.reshape(-1, 2)
    try:
        image = rig.picture.image
    except RigError:
        return frame
    low, high = uv.min(axis=0), uv.max(axis=0)
    if low.min() < -1e-6 or high.max() > 1 + 1e-6:
        return frame

    height, width = image.shape[:2]
    columns, rows = (
        np.clip((a + (b - a) * (np.arange(n) + 0.5) / n) * full, 0, full - 1).astype(int)
        for a, b, full in ((low[0], high[0], width), (1 - high[1], 1 - low[1], height))
        for n in [min(MOST_PIXELS, full)]
    )
    some = np.broadcast_to(image[np.ix_(rows, columns)][..., :3], (len(rows), len(columns), 3))
    data = base64.b64encode(encoded(quantised(np.ascontiguousarray(some), "uint8"))).decode()
    return (
        f'<image width="{size[0]:.2f}" height="{size[1]:.2f}" preserveAspectRatio="none"'
        f' opacity="{FADED}" href="data:image/png;base64,{data}"/>{frame}'
    )
