"""The light of a rig's picture to its viewers: which share of it arrives, and why not all.

Points spread evenly over the picture each stand for the part around them. Where the light of
neighbours takes different ways a strip between them may be lost that no point is in, as beside the
edges of cut glass: there the picture is divided further, as far as that is no more than a few times
the work.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import within
from ..glass.meshes import areas_of
from ..light.plan import Plan
from ..rig.mesh import Mesh
from ..rig.rig import PicturePlace, Rig
from ..rig.viewer import Viewer
from .flat import Outline
from .light import Light, light_of, together
from .spread import LIGHT_RAYS, points_of, points_over, small_triangles

PlanOf = Callable[[Rig], Plan]


@dataclass(frozen=True)
class Finer:
    """How the picture is divided further where ways part.

    times : into so many parts along an edge, each time
    levels : at most
    most_rays : each time: where ways part all over, as in cut crystal, it is divided less
    """

    times: int = 4
    levels: int = 3
    most_rays: int = 60_000


FINER = Finer()


def place_in_sight(place: PicturePlace, viewer: Viewer) -> PicturePlace:
    """A picture with a plane: its own, or one in front of
    the viewer where it is in the viewer's own pixels.
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
class Traced:
    """The light of a rig's picture, of places uv (n, 2) and their shares (n,) of the picture.

    area : (n,) as weight, which is 0 out of sight, in all places
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
        """The part of the picture that arrives."""
        return 1.0 - sum(self.lost.values())


def traced(rig: Rig, plan_of: PlanOf, n_grid: int = 0) -> Generator[float, None, Traced]:
    """Follow the light of a rig's picture to its first viewer; yields progress 0..1."""
    return (yield from traced_by_all(replace(rig, viewers=rig.viewers[:1]), plan_of, n_grid))


def traced_by_all(
    rig: Rig,
    plan_of: PlanOf,
    n_grid: int = 0,
    plate: Outline | None = None,
    is_fine: bool = False,
) -> Generator[float, None, Traced]:
    """The same to all viewers, one behind the other, each with an even part of the weight.

    is_fine : divide the picture further where ways of light part
    """
    plan, n = plan_of(rig), len(rig.viewers)
    lights, uvs, areas = [], [], []
    for k, viewer in enumerate(rig.viewers):
        place = place_in_sight(rig.picture_place, viewer)
        steps = _light_over(plan.seen_by(viewer), place, n_grid, plate, is_fine)
        light, uv, area = yield from within(steps, k / n, (k + 1) / n)
        seen = float(area[light.is_seen].sum())
        lights.append(light)
        uvs.append(uv)
        areas.append(area / max(seen, np.finfo(float).tiny) / n)
    return Traced(together(lights), np.concatenate(uvs), np.concatenate(areas))


def _light_over(
    plan: Plan, place: PicturePlace, n_grid: int, plate: Outline | None, is_fine: bool
) -> Generator[float, None, tuple[Light, Floats, Floats]]:
    """The light of points over a picture, their UV (n, 2), and the area (n,) that each stands
    for; yields progress 0..1.
    """
    n = n_grid or LIGHT_RAYS.n_grid
    points, uv, area = points_of(place, n)
    small = small_triangles(n, len(place.mesh.triangles))
    light = yield from within(light_of(plan, points, plate), 0.0, 0.4 if is_fine else 1.0)
    lights, uvs, areas = [light], [uv], [area]
    for level in range(FINER.levels if is_fine else 0):
        parts = small[_part(light, small)]
        times = min(FINER.times, int(np.sqrt(2 * FINER.most_rays / max(len(parts), 1))) - 1)
        if not len(parts) or times < 2:
            break
        # what they stood for goes to the points between
        np.subtract.at(areas[-1], parts, areas_of(points[parts])[:, None] / 3)
        points, uv, area = points_over(points[parts], uv[parts], times)
        small = small_triangles(times, len(parts))
        steps = light_of(plan, points, plate)
        light = yield from within(steps, 0.4 + 0.2 * level, 0.6 + 0.2 * level)
        lights.append(light)
        uvs.append(uv)
        areas.append(area)
    whole = np.maximum(np.concatenate(areas), 0.0)  # but for rounding
    return together(lights), np.concatenate(uvs), whole


def _part(light: Light, triangles: Ints) -> Bools:
    """(m,) does the light of the corners of triangles (m, 3) take different ways?"""
    ways = (light.branch, light.reason, light.is_seen)
    return np.any([(way[triangles] != way[triangles[:, :1]]).any(axis=1) for way in ways], axis=0)
