"""Depth at which two eyes see points of the picture, and the disparity that no depth explains.

Each eye sees a point of the picture along the ray on which its light arrives, in the air before the
glass. The two *lines of sight* of a point are fused half way between their nearest points. The
distance of this place in front of the picture's plane is the point's *depth*.

Angles are Helmholtz's, about the line between the eyes: the *elevation* of a direction turns about
this line, its *azimuth* is the angle from the plane across it. Lines of sight to one point have
equal elevations. The difference of elevations (*vertical disparity*) is therefore explained by no
depth; the difference of azimuths, less the point's own, gives the depth (*horizontal disparity*).
The terms follow Howard and Rogers, Perceiving in Depth, vol. 2 (2012).

Eyes tolerate little vertical disparity. Kooi and Toet (Visual comfort of binocular and 3D displays,
Displays 25, 2004, 99-108, doi 10.1016/j.displa.2004.07.004) had observers rate brief looks at pairs
of images, and found that nearly all asymmetries, vertical shifts among them, reduce comfort if they
are large enough. Makers of binoculars keep the images of both tubes within 15 arcmin in height,
beyond which eyes strain and heads ache (Tonkin, Binocular Astronomy, table 2.1). Binoculars are
used for long, like a picture in glass.
"""

import base64
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.numbers import number
from ...base.steps import hold_progress
from ...base.vectors import dot, length_of, normalise
from ...bench.part_sizes import plane_of
from ...files.encoding import quantised
from ...files.png import encoded
from ...light.compile_plan import compile_plan_steps
from ...light.mesh_cache import MeshCache
from ...rig.rig import Rig, Viewer
from ...rig.settings import Settings
from ...rig.viewer import ARCMIN
from ...solve.solution import Solution, without_glass
from ..atlas.heads import check_perspective
from ..drawing.svg import FONT, document, text_at
from .places_seen import Observer, grid_of, grid_on, places_seen
from .viewer_errors import N_POINTS, displaced

MOST_APART = np.cos(np.radians(45.0))  # largest angle between the axes of two eyes
TIRES_FROM = 15.0  # arcmin of vertical disparity; source above
NEITHER, LEFT, RIGHT, BOTH = (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Sights:
    """Points of the picture, n x n, as two eyes see them, row by row from the top; NaN unless both
    do.

    horizontal : (n, n) arcmin, additional convergence of the eyes; positive in front of the plane
    vertical : (n, n) arcmin, elevation of the left eye's view above the right's
    depth : (n, n) m, in front of the picture's plane, towards the eyes; -inf if the lines of sight
        come nearest behind the eyes (beyond infinity)
    """

    horizontal: Floats
    vertical: Floats
    depth: Floats

    @property
    def is_seen(self) -> Bools:
        """Whether both eyes see each point, (n, n)."""
        return np.isfinite(self.vertical)

    @property
    def mean_vertical(self) -> float | None:
        """Mean magnitude, arcmin; None if no point is seen."""
        return self._reduced(np.abs(self.vertical), np.mean)

    @property
    def largest_vertical(self) -> float | None:
        """Largest magnitude, arcmin; None if no point is seen."""
        return self._reduced(np.abs(self.vertical), np.max)

    @property
    def mean_horizontal(self) -> float | None:
        """Mean, arcmin; None if no point is seen."""
        return self._reduced(self.horizontal, np.mean)

    @property
    def largest_horizontal(self) -> float | None:
        """Largest magnitude, arcmin; None if no point is seen."""
        return self._reduced(np.abs(self.horizontal), np.max)

    @property
    def mean_depth(self) -> float | None:
        """Mean, m; None if no point is seen."""
        return self._reduced(self.depth, np.mean)

    @property
    def largest_depth(self) -> float | None:
        """Depth of the point seen farthest from the plane, m; None if no point is seen."""
        return self._reduced(self.depth, lambda depth: depth[np.abs(depth).argmax()])

    @property
    def nearest_depth(self) -> float | None:
        """Depth of the nearest point, m; None if no point is seen."""
        return self._reduced(self.depth, np.max)

    @property
    def farthest_depth(self) -> float | None:
        """Depth of the farthest point, m; None if no point is seen."""
        return self._reduced(self.depth, np.min)

    def _reduced(self, values: Floats, number: Callable[[Floats], np.floating]) -> float | None:
        return float(number(values[self.is_seen])) if self.is_seen.any() else None


@dataclass(frozen=True, eq=False)
class TwoEyes:
    """The picture as a pair of eyes sees it, by the content of the display.

    left, right : names of the viewers
    uncompensated : the plain picture, right for a rig whose glass does not refract
    for_left, for_right, for_both : source image for one of them, or for both by their weights, with
        disagreements settled at the mean place (*sharp*)
    """

    left: str
    right: str
    uncompensated: Sights
    for_left: Sights
    for_right: Sights
    for_both: Sights


def two_eyes(
    rig: Rig, settings: Settings, n: int = N_POINTS, kept: MeshCache | None = None
) -> Generator[float, None, TwoEyes]:
    """Look at n x n points of the picture with a rig's two viewers; yields progress 0..1.

    Display pixels are taken as infinitely small. Only a few rays are traced.

    Raises
    ------
    RigError, MeshError : the viewers are not a pair, the picture is not a flat rectangle, or the
        rig cannot be traced
    """
    rig.check()
    settings.check()
    left, right = pair_of(rig)
    plane_of(rig)
    rig = replace(rig, viewers=(left, right))
    # Glass of index 1 has no effect, but light past it has to count.
    how = replace(settings, only_through_glass=False, suppress_glare=0.0)
    bare = yield from hold_progress(0.0, compile_plan_steps(without_glass(rig), how))
    plan = yield from hold_progress(0.1, compile_plan_steps(rig, settings, kept))
    yield 0.2

    plain = [Observer(bare.seen_by(eye), eye.weight) for eye in rig.viewers]
    uv = grid_on(rig.picture_place, n)
    found = []
    for k, (before, counted) in enumerate(((plain, NEITHER), ([], LEFT), ([], RIGHT), ([], BOTH))):
        eyes = [
            Observer(plan.seen_by(eye), part * eye.weight)
            for eye, part in zip(rig.viewers, counted, strict=True)
        ]
        view = yield from hold_progress(0.2 * (k + 1), places_seen([*before, *eyes], uv))
        found.append(_sights(rig, view[-2:], n))
    yield 1.0
    return TwoEyes(left.name, right.name, *found)


def sights_of(solution: Solution) -> tuple[Viewer, Viewer, Sights]:
    """Left and right eye of a solved rig, and points of the picture as they see them.

    The places come from `displaced`, on the display's own pixels.

    Raises
    ------
    RigError : the viewers are not a pair, or the picture is not a flat rectangle
    """
    rig = solution.rig
    left, right = pair_of(rig)
    plane_of(rig)
    numbers = (0, 1) if left is rig.viewers[0] else (1, 0)
    view = np.stack([displaced(solution, number)[0] for number in numbers])
    return left, right, _sights(replace(rig, viewers=(left, right)), view, N_POINTS)


def pair_of(rig: Rig) -> tuple[Viewer, Viewer]:
    """Left and right eye of a rig.

    Raises
    ------
    RigError : its viewers are not a pair of eyes
    """
    if len(rig.viewers) != 2:
        raise RigError(
            "Two eyes need two viewers, but the rig has {n}. Choose a left and a right one.",
            n=len(rig.viewers),
        )
    for viewer in rig.viewers:
        check_perspective(viewer)

    one, other = rig.viewers
    side = one.axes[0] + other.axes[0]
    apart = other.position - one.position
    is_parallel = one.axes[2] @ other.axes[2] >= MOST_APART
    is_level = abs(apart @ side) > MOST_APART * np.linalg.norm(apart) * np.linalg.norm(side)
    if not (is_parallel and is_level):
        raise RigError(
            "The viewers '{one}' and '{other}' are not a pair of eyes. Place them side by side,"
            " both facing the picture.",
            one=one.name,
            other=other.name,
        )
    return (one, other) if apart @ side > 0 else (other, one)


def _sights(rig: Rig, view: Floats, n: int) -> Sights:
    """Points of the picture as a rig's two eyes see them at places (2, n * n, 2) viewer px."""
    plane = plane_of(rig)
    left, right = rig.viewers
    across = normalise(right.position - left.position)
    normal = normalise(np.cross(*plane.sides))
    normal = normal * np.sign((left.position - plane.middle) @ normal)

    points = plane.middle + (grid_of(n) - 0.5) @ plane.sides
    sights = [eye.rays(xy)[1] for eye, xy in zip((left, right), view, strict=True)]
    straight = [normalise(points - eye.position) for eye in (left, right)]
    converged, raised = angles_between(*sights, across)
    expected, _ = angles_between(*straight, across)

    seen = nearest_between(left.position, right.position, *sights)
    depth = dot(seen - plane.middle, normal)
    # behind the eyes: beyond infinity
    is_behind = dot(seen - left.position, sights[0] + sights[1]) < 0
    depth = np.where(is_behind | ~np.isfinite(depth), -np.inf, depth)
    is_seen = np.isfinite(view).all(axis=(0, 2))
    return Sights(*(
        np.where(is_seen, values, np.nan).reshape(n, n)
        for values in (ARCMIN * (converged - expected), ARCMIN * raised, depth)
    ))  # fmt: skip


def angles_between(left: Floats, right: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Differences, left less right, of Helmholtz azimuth and elevation, rad (n,) each.

    Directions (n, 3) are unit vectors of a left and a right eye. With c the unit vector from the
    left eye to the right, the azimuth of d is asin(d . c), and the elevation the angle about c. The
    difference of elevations is the angle between the two vectors d x c.

    across : (3,) c
    """
    azimuth = [np.arcsin(np.clip(dot(d, across), -1, 1)) for d in (left, right)]
    one, other = (np.cross(across, d) for d in (left, right))
    # right x forward is up: the sign follows the mean forward direction
    raised = np.arctan2(dot(np.cross(other, one), across), dot(one, other))
    return azimuth[0] - azimuth[1], raised


def nearest_between(one: Floats, other: Floats, along: Floats, along_other: Floats) -> Floats:
    """Midpoints (n, 3) of the shortest distance between two lines; NaN if they are parallel.

    With w = other - one and m = u x v, the lines one + s u and other + t v are closest at
    s = (w x v) . m / m^2 and t = (w x u) . m / m^2.

    one, other : (3,) a point of each line; along, along_other : (n, 3) unit directions u and v
    """
    apart = other - one
    m = np.cross(along, along_other)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = dot(np.cross(apart, along_other), m) / dot(m, m)
        t = dot(np.cross(apart, along), m) / dot(m, m)
    first = one + s[:, None] * along
    second = other + t[:, None] * along_other
    return (first + second) / 2


FILE = "two_eyes.svg"
WAYS = ("uncompensated", "for_left", "for_right", "for_both")  # fields of TwoEyes
# px
WIDTH = 330  # of the picture
GAP = 30
HEAD = 46  # space above a picture for its caption
TOP = 60
MOST_PIXELS = 220  # of the picture's own, each way
FADED = 0.25
LONGEST = 0.42  # of the distance between two points: longest arrow, and largest disc
# Least values, arcmin and m, of the longest arrow and the largest disc.
LEAST = {"vertical": 0.01, "horizontal": 0.01, "depth": 1e-5}
MORE, LESS = "#c8501e", "#0b6e99"  # smallest value that is drawn


def as_data(found: TwoEyes) -> dict[str, Any]:
    """Record for a report: for each content of the display lists of rows from the top.

    None for points that are not seen by both, and for depths beyond infinity.
    """
    report: dict[str, Any] = {"left": found.left, "right": found.right}
    for name in WAYS:
        sights = getattr(found, name)
        report[name] = {
            "n_points": int(sights.is_seen.sum()),
            "mean_horizontal_arcmin": sights.mean_horizontal,
            "largest_horizontal_arcmin": sights.largest_horizontal,
            "mean_vertical_arcmin": sights.mean_vertical,
            "largest_vertical_arcmin": sights.largest_vertical,
            "vertical_arcmin": _rows(sights.vertical),
            "horizontal_arcmin": _rows(sights.horizontal),
            "depth_m": _rows(sights.depth),
        }
    return report


def _rows(values: Floats) -> list[list[float | None]]:
    return [[x if np.isfinite(x) else None for x in row] for row in values.tolist()]


def as_svg(rig: Rig, found: TwoEyes) -> str:
    """Drawing with a column for each content of the display: vertical arrows, horizontal arrows,
    discs.

    Raises
    ------
    RigError : the picture is not a flat rectangle
    """
    across, up = length_of(plane_of(rig).sides)
    size = np.array([WIDTH, WIDTH * up / across])
    picture = embedded(rig, size)
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
        "Two eyes, over the picture. Above, arcmin: arrows point up where the left eye sees a"
        " point higher than the right eye does.",
        "Middle, arcmin: arrows point right where the eyes converge more than for the picture's"
        " plane. Below, mm: filled discs in front of this plane, rings behind it.",
    )
    titles = [text_at((GAP, 26 + 20 * n), line, size=15) for n, line in enumerate(title)]
    return document((round(width), round(height)), f'font-family="{FONT}"', [*titles, *parts])


def _scales(sights: list[Sights]) -> dict[str, float]:
    """Largest disparities, arcmin, and largest finite depth, m, of all panels, by field of
    `Sights`.
    """
    found = {}
    for field, least in LEAST.items():
        values = np.concatenate([getattr(one, field).ravel() for one in sights])
        found[field] = float(np.abs(values[np.isfinite(values)]).max(initial=least))
    return found


def _places(sights: Sights, size: Floats) -> tuple[Floats, float]:
    """Positions of points (n, n, 2) in a panel, px, and the length of the longest mark."""
    n = len(sights.vertical)
    uv = grid_of(n).reshape(n, n, 2)
    return np.stack([uv[..., 0], 1 - uv[..., 1]], axis=2) * size, LONGEST * size.min() / n


def _arrows(sights: Sights, size: Floats, field: str, scales: dict[str, float]) -> list[str]:
    """Arrows for a disparity: up or right if the left eye sees a point higher or farther right."""
    places, longest = _places(sights, size)
    along = np.array([0.0, -1.0] if field == "vertical" else [1.0, 0.0])
    label = np.array([4.0, 4.0] if field == "vertical" else [4.0, 12.0])  # px, of the number
    parts = []
    for middle, value in zip(places.reshape(-1, 2), getattr(sights, field).ravel(), strict=True):
        if not np.isfinite(value):
            continue
        arrow = longest * value / scales[field] * along
        start, end = middle - arrow, middle + arrow
        across = 0.3 * arrow[::-1]
        barbs = end - 0.3 * arrow + across, end - 0.3 * arrow - across
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = start, end, *barbs
        parts += [
            f'<path class="arrow" d="M{x0:.2f},{y0:.2f} L{x1:.2f},{y1:.2f}'
            f' M{x2:.2f},{y2:.2f} L{x1:.2f},{y1:.2f} L{x3:.2f},{y3:.2f}" fill="none"'
            f' stroke="{MORE if value > 0 else LESS}" stroke-width="2"/>',
            text_at(tuple(middle + label), rounded(value), size=8),
        ]
    return parts


def rounded(value: float) -> str:
    """A number to two decimals, without a sign if it rounds to 0."""
    return f"{round(value, 2) + 0.0:.2f}"


def _discs(sights: Sights, size: Floats, scale: float) -> list[str]:
    """Discs with an area proportional to depth: filled in front of the plane."""
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


def embedded(rig: Rig, size: Floats) -> str:
    """The faded picture in its outline; the outline alone without pixels or if the UV map exceeds
    them.
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
