"""At which depth do two eyes see points of the picture, and what of their sights does not meet?

Each eye sees a point of the picture in the direction of the ray on which its light comes, in the
air before the glass. The two *lines of sight* of a point are seen as one at the middle between
their nearest places. How far that is in front of the picture's plane is the *depth* of the point.

Angles are Helmholtz's, about the line between the eyes: a direction's *elevation* turns about that
line, its *azimuth* is the angle from the plane across the line. Lines of sight to one point have
one elevation, wherever it is. So the difference of elevations (*vertical disparity*) is what no
depth explains, and the difference of azimuths, less that of the point itself, tells the depth
(*horizontal disparity*). Howard and Rogers, Perceiving in Depth, vol. 2 (2012), name them so.

Eyes cannot follow much vertical disparity. Kooi and Toet (Visual comfort of binocular and 3D
displays, Displays 25, 2004, 99-108, doi 10.1016/j.displa.2004.07.004) had observers rate brief
looks at pairs of images, and found that nearly all asymmetries, vertical shifts among them, reduce
comfort where they are large enough. Makers of binoculars keep the images of both tubes within 15
arcmin in height, beyond which eyes strain and tire, and heads ache (Tonkin, Binocular Astronomy,
table 2.1): those are held to the eyes for long, as a picture in glass is.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.steps import at
from ...base.vectors import dot, normalise
from ...bench.picture_room import plane_of
from ...light.compile_plan import planning
from ...light.mesh_cache import Kept
from ...rig.rig import Rig, Viewer
from ...rig.settings import Settings
from ...solve.solution import Solution, without_glass
from .places_seen import Look, grid_of, grid_on, places_seen
from .viewer_errors import ARCMIN, N_POINTS, displaced

MOST_APART = np.cos(np.radians(45.0))  # between where two eyes look, or their sides point
TIRES_FROM = 15.0  # arcmin of vertical disparity; the source is above
NEITHER, LEFT, RIGHT, BOTH = (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Sights:
    """How two eyes see n x n points of the picture, row by row from the top; NaN where not both
    see one.

    horizontal : (n, n) arcmin, by how much more the eyes converge than for the point itself: above
        0 where it is seen in front of the plane
    vertical : (n, n) arcmin, by how much higher the left eye sees it than the right
    depth : (n, n) m, in front of the picture's plane, on the eyes' side; -inf where the lines of
        sight come nearest behind the eyes, as of something further than infinity
    """

    horizontal: Floats
    vertical: Floats
    depth: Floats

    @property
    def is_seen(self) -> Bools:
        """Which points (n, n) both eyes see."""
        return np.isfinite(self.vertical)

    @property
    def mean_vertical(self) -> float | None:
        """Mean size, arcmin; None where no point is seen."""
        return self._told(np.abs(self.vertical), np.mean)

    @property
    def largest_vertical(self) -> float | None:
        """Largest size, arcmin; None where no point is seen."""
        return self._told(np.abs(self.vertical), np.max)

    @property
    def mean_horizontal(self) -> float | None:
        """Mean, arcmin; None where no point is seen."""
        return self._told(self.horizontal, np.mean)

    @property
    def largest_horizontal(self) -> float | None:
        """Largest size, arcmin; None where no point is seen."""
        return self._told(np.abs(self.horizontal), np.max)

    @property
    def mean_depth(self) -> float | None:
        """Mean, m; None where no point is seen."""
        return self._told(self.depth, np.mean)

    @property
    def largest_depth(self) -> float | None:
        """Of the point that is seen farthest from the plane, m; None where no point is seen."""
        return self._told(self.depth, lambda depth: depth[np.abs(depth).argmax()])

    @property
    def nearest_depth(self) -> float | None:
        """Of the point that is seen nearest, m; None where none is seen."""
        return self._told(self.depth, np.max)

    @property
    def farthest_depth(self) -> float | None:
        """Of the point that is seen farthest, m; None where none is seen."""
        return self._told(self.depth, np.min)

    def _told(self, values: Floats, number: Callable[[Floats], np.floating]) -> float | None:
        return float(number(values[self.is_seen])) if self.is_seen.any() else None


@dataclass(frozen=True, eq=False)
class TwoEyes:
    """How a pair of eyes sees the picture, by what the display shows.

    left, right : names of the viewers
    uncompensated : the plain picture, as it would be right for a rig whose glass does not refract
    for_left, for_right, for_both : the source image for one of them, or for both by their weights,
        where they disagree the picture at the mean of their places (*sharp*)
    """

    left: str
    right: str
    uncompensated: Sights
    for_left: Sights
    for_right: Sights
    for_both: Sights


def two_eyes(
    rig: Rig, settings: Settings, n: int = N_POINTS, kept: Kept | None = None
) -> Generator[float, None, TwoEyes]:
    """Look at n x n points of the picture with the two viewers of a rig; yields progress 0..1.

    Display pixels are taken to be as small as can be. Only a few rays are traced.

    Raises
    ------
    RigError, MeshError : the viewers are no pair, the picture is no flat rectangle, or the rig
        cannot be traced; one sentence
    """
    rig.check()
    settings.check()
    left, right = pair_of(rig)
    plane_of(rig)
    rig = replace(rig, viewers=(left, right))
    # glass that does not refract is no matter, but the light has to go through it
    how = replace(settings, only_through_glass=False, suppress_glare=0.0)
    bare = yield from at(0.0, planning(without_glass(rig), how))
    plan = yield from at(0.1, planning(rig, settings, kept))
    yield 0.2

    plain = [Look(bare.seen_by(eye), eye.weight) for eye in rig.viewers]
    uv = grid_on(rig.picture_place, n)
    found = []
    for k, (before, counted) in enumerate(((plain, NEITHER), ([], LEFT), ([], RIGHT), ([], BOTH))):
        eyes = [
            Look(plan.seen_by(eye), part * eye.weight)
            for eye, part in zip(rig.viewers, counted, strict=True)
        ]
        view = yield from at(0.2 * (k + 1), places_seen([*before, *eyes], uv))
        found.append(_sights(rig, view[-2:], n))
    yield 1.0
    return TwoEyes(left.name, right.name, *found)


def sights_of(solution: Solution) -> tuple[Viewer, Viewer, Sights]:
    """The left and the right eye of a rig that is solved, and how they see points of the picture:
    the places are those that `displaced` finds, on the display's own pixels.

    Raises
    ------
    RigError : the viewers are no pair, or the picture is no flat rectangle; one sentence
    """
    rig = solution.rig
    left, right = pair_of(rig)
    plane_of(rig)
    numbers = (0, 1) if left is rig.viewers[0] else (1, 0)
    view = np.stack([displaced(solution, number)[0] for number in numbers])
    return left, right, _sights(replace(rig, viewers=(left, right)), view, N_POINTS)


def pair_of(rig: Rig) -> tuple[Viewer, Viewer]:
    """The left and the right eye of a rig.

    Raises
    ------
    RigError : its viewers are no pair of eyes
    """
    if len(rig.viewers) != 2:
        raise RigError(
            "Two eyes are two viewers, and the rig has {n}: choose a left and a right one.",
            n=len(rig.viewers),
        )
    for viewer in rig.viewers:
        if viewer.projection == "orthographic":
            raise RigError(
                "The viewer '{viewer}' is orthographic and is no eye: set it to Perspective.",
                viewer=viewer.name,
            )

    one, other = rig.viewers
    if one.axes[2] @ other.axes[2] < MOST_APART:
        raise RigError(
            "The viewers '{one}' and '{other}' look in different directions and are no pair of"
            " eyes: turn both to the picture.",
            one=one.name,
            other=other.name,
        )

    side = (one.axes[0] + other.axes[0]) / np.linalg.norm(one.axes[0] + other.axes[0])
    apart = other.position - one.position
    if not abs(apart @ side) > MOST_APART * np.linalg.norm(apart):
        raise RigError(
            "The viewers '{one}' and '{other}' do not stand side by side and are no pair of eyes:"
            " move one to the right of the other.",
            one=one.name,
            other=other.name,
        )
    return (one, other) if apart @ side > 0 else (other, one)


def _sights(rig: Rig, view: Floats, n: int) -> Sights:
    """How the two eyes of a rig see points of the picture, at places (2, n * n, 2) viewer px."""
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
    """By how much unit directions (n, 3) of a left and a right eye differ in Helmholtz's azimuth
    and elevation, rad (n,) each: the left less the right.

    With c the unit vector from the left eye to the right, the azimuth of d is asin(d . c), and the
    elevation the angle about c. The difference of elevations is that between d x c of the two.

    across : (3,) c
    """
    azimuth = [np.arcsin(np.clip(dot(d, across), -1, 1)) for d in (left, right)]
    one, other = (np.cross(across, d) for d in (left, right))
    # of right x forward, which is up, turned to the forward of both
    raised = np.arctan2(dot(np.cross(other, one), across), dot(one, other))
    return azimuth[0] - azimuth[1], raised


def nearest_between(one: Floats, other: Floats, along: Floats, along_other: Floats) -> Floats:
    """The middle (n, 3) between the nearest places of two lines; NaN where they are parallel.

    With w = other - one and m = u x v, the places one + s u and other + t v are nearest where
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
