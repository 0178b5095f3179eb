"""Where does a picture's light land, and how large has a display to be for it?

Points spread evenly over the picture are traced from the viewer, straight through them, to the
display's plane. Each stands for the part of the picture around it, as the viewer sees it.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.messages import Message
from ..glass.meshes import areas_of
from ..light.landings import BY_GAPS, Reason
from ..light.plan import Plan
from ..rig.rig import PicturePlace
from .light import Light, light_of

SEVERAL = Message("several parts of the picture")
# by row, from the lowest, and column
PARTS = (
    (
        Message("the picture's lower left corner"),
        Message("the picture's lower side"),
        Message("the picture's lower right corner"),
    ),
    (
        Message("the picture's left side"),
        Message("the picture's middle"),
        Message("the picture's right side"),
    ),
    (
        Message("the picture's upper left corner"),
        Message("the picture's upper side"),
        Message("the picture's upper right corner"),
    ),
)
THIRDS = 1 / 3, 2 / 3  # of the picture's sides
MOST = 0.95  # share of the light without its outermost part


@dataclass(frozen=True)
class LightRays:
    """How a picture's light is followed, and told about.

    n_grid : points along each edge of a triangle of the picture
    named_share : of the outermost light, that has to come from a
        part of the picture for that part to be named
    """

    n_grid: int = 128
    named_share: float = 0.5


LIGHT_RAYS = LightRays()


@dataclass(frozen=True, eq=False)
class Spread:
    """The light of a picture on the plane of its display.

    places : (n, 2) in the picture's UV
    across : (n, 2) m, along the display's width and height, from its middle to the landings
    weight : (n,) share of the picture
    beside : (m, 2) as places, of light that lands beside the display
    beside_weight : (m,) share of the picture
    lost : shares of the picture that do not arrive, by reason; the
        part out of the viewer's sight does not count
    leaked : share of the picture that arrives through gaps in open glass
    """

    places: Floats
    across: Floats
    weight: Floats
    beside: Floats
    beside_weight: Floats
    lost: dict[str, float]
    leaked: float

    @property
    def unseen(self) -> dict[str, float]:
        """As `lost`, with light that arrives through gaps: nobody knows that it is seen."""
        leaked = self.lost.get(BY_GAPS, 0.0) + self.leaked
        return {**self.lost, BY_GAPS: leaked} if leaked else self.lost

    def width(self, aspect: float, share: float = 1.0) -> float:
        """Width, m, of a display, `aspect` times as wide as high,
        on which this share of the arriving light lands.
        """
        if not len(self.across):
            return 0.0
        half = self._half_widths(aspect)
        order = np.argsort(half)
        within = np.cumsum(self.weight[order])
        last = np.searchsorted(within, share * within[-1]) if share < 1 else len(order) - 1
        return 2 * float(half[order[last]])

    def outermost(self, aspect: float) -> Message:
        """From which part of the picture the light comes that lands
        furthest from the display's middle, in words.
        """
        is_far = 2 * self._half_widths(aspect) > self.width(aspect, MOST)
        return part_of_picture(self.places[is_far], self.weight[is_far])

    def _half_widths(self, aspect: float) -> Floats:
        return np.maximum(np.abs(self.across[:, 0]), np.abs(self.across[:, 1]) * aspect)


def part_of_picture(places: Floats, weight: Floats) -> Message:
    """The part of a picture in which most of these places (n,
    2) lie, in its UV, by their weight (n,), in words.
    """
    if not len(places):
        return SEVERAL

    # the light of each of nine parts
    column, row = np.digitize(places, THIRDS).T
    of_part = np.zeros((3, 3))
    np.add.at(of_part, (row, column), weight / weight.sum())

    # one part alone
    row, column = np.unravel_index(of_part.argmax(), (3, 3))
    if of_part[row, column] >= LIGHT_RAYS.named_share:
        return PARTS[row][column]

    # or a whole side
    sides = {
        PARTS[0][1]: of_part[0],
        PARTS[2][1]: of_part[2],
        PARTS[1][0]: of_part[:, 0],
        PARTS[1][2]: of_part[:, 2],
    }
    side = max(sides, key=lambda words: sides[words].sum())
    return side if sides[side].sum() >= LIGHT_RAYS.named_share else SEVERAL


def points_of(place: PicturePlace, n: int = 0) -> tuple[Floats, Floats, Floats]:
    """Points (n, 3) spread evenly over the triangles of a picture,
    their UV (n, 2) and the area (n,) each stands for.
    """
    return points_over(place.mesh.corners, place.mesh.uv, n or LIGHT_RAYS.n_grid)


def points_over(corners: Floats, uv: Floats, n: int) -> tuple[Floats, Floats, Floats]:
    """The same over triangles (t, 3, 3), with UV (t, 3, 2), by n points along each edge.

    A triangle is divided into small ones; a third of each belongs to each of its corners.
    """
    # the corners of the small ones, by barycentric coordinates
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
    """The small triangles (m, 3) of `points_over`, as numbers of its points."""
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
    """Trace the light of the picture, which faces the viewer; yields progress 0..1.

    Parameters
    ----------
    plan : of a rig whose display is as large as allowed
    display_frame : (4, 4) of the display, m
    """
    points, uv, area = points_of(plan.rig.picture_place)
    light = yield from light_of(plan, points)
    return spread_in(light, uv, area, display_frame)


def spread_in(light: Light, uv: Floats, area: Floats, display_frame: Floats) -> Spread:
    """The spread of light that was traced already.

    Parameters
    ----------
    uv, area : (n, 2) and (n,) of the light's points, as by `points_of`
    display_frame : (4, 4) of the display, m
    """
    seen = np.where(light.is_seen, area, 0.0)
    weight = seen / max(seen.sum(), np.finfo(float).tiny)
    across = (light.positions - display_frame[:3, 3]) @ display_frame[:3, :2]
    arrived = light.has_arrived
    beside = light.is_seen & (light.reason == Reason.MISSED_DISPLAY)
    return Spread(
        places=uv[arrived],
        across=across[arrived],
        weight=weight[arrived],
        beside=uv[beside],
        beside_weight=weight[beside],
        lost=light.lost(weight),
        leaked=float(weight[arrived & light.has_leaked].sum()),
    )
