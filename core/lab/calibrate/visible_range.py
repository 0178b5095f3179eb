"""The visible range: directions from which the picture is seen.

Viewers are placed on a sphere around the picture and look at sampled points of it.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from math import isqrt

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.vectors import dot
from ...glass.meshes import areas_of
from ...glass.quartics import grid
from ...light.plan import Plan
from ...light.rays import main_landings
from ...light.trace import trace_all


@dataclass(frozen=True)
class Survey:
    """Sampling of the visible range.

    farthest_rad : angle from the viewer's own position, each way
    n_steps : steps along each axis over the whole range
    fine_rad : step to the left, right, down and up, for the extent
    n_points : most points on the picture
    rays_at_once : rays traced together
    rounding : tolerance of shares
    """

    farthest_rad: float = np.radians(75.0)
    n_steps: int = 60
    fine_rad: float = np.radians(0.1)
    n_points: int = 72
    rays_at_once: int = 1 << 16
    rounding: float = 1e-9


SURVEY = Survey()


@dataclass(frozen=True, eq=False)
class VisibleRange:
    """The picture seen from a grid of positions, rows upwards and columns to the right.

    Parameters
    ----------
    positions : (n, n, 3) m, world
    share : (n, n) of the picture's area with light from the display, 0..1
    brightness : (n, n) mean throughput of this light
    extent : angles to the left, right, down and up from the viewer's position up to which enough is
        seen, rad; NaN if not even the viewer sees enough
    best : largest share from any position
    """

    positions: Floats
    share: Floats
    brightness: Floats
    extent: tuple[float, float, float, float]
    best: float


def visible_range(plan: Plan, enough: float = 1.0) -> Generator[float, None, VisibleRange]:
    """Find the positions from which at least a share `enough` of the picture is seen. Yields
    progress 0..1.

    Raises
    ------
    RigError : the picture moves with the viewer, or is behind it
    """
    picture = plan.rig.picture_place
    picture.check_still()

    sphere = _Sphere(plan)
    if not sphere.distance > 0:
        raise RigError(
            "The picture '{picture}' is behind the viewer. Turn the viewer around.",
            picture=picture.name,
        )

    angles = np.linspace(-SURVEY.farthest_rad, SURVEY.farthest_rad, SURVEY.n_steps + 1)
    a, b = np.meshgrid(angles, angles)
    positions = sphere.places(a, b).reshape(-1, 3)
    share, brightness = np.empty((2, len(positions)))
    step = SURVEY.rays_at_once // len(sphere.points)
    for first in range(0, len(positions), step):
        some = slice(first, first + step)
        share[some], brightness[some] = sphere.seen_from(positions[some])
        yield 0.9 * min(first + step, len(positions)) / len(positions)

    # outward from the viewer until less than enough is seen
    extent = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        angle = sign * np.arange(0.0, SURVEY.farthest_rad, SURVEY.fine_rad)
        there = sphere.places(angle, 0 * angle) if axis == 0 else sphere.places(0 * angle, angle)
        seen, _ = sphere.seen_from(there)
        n_seen = int(np.logical_and.accumulate(seen >= enough - SURVEY.rounding).sum())
        extent.append(float("nan") if n_seen == 0 else float(abs(angle[n_seen - 1])))
        yield 0.9 + 0.025 * len(extent)

    shape = a.shape
    return VisibleRange(
        positions=positions.reshape(*shape, 3),
        share=share.reshape(shape),
        brightness=brightness.reshape(shape),
        extent=tuple(extent),
        best=float(share.max()),
    )


class _Sphere:
    """The sphere around the picture's middle through a plan's viewer."""

    def __init__(self, plan: Plan) -> None:
        self.plan = replace(plan, settings=replace(plan.settings, brightness=True))
        viewer = plan.viewer
        mesh = plan.rig.picture_place.mesh
        self.points, self.area = _points_of(mesh.corners)
        self.centre = mesh.bounds.mean(axis=0)
        self.right, self.up, self.forward = viewer.axes
        self.distance = float((self.centre - viewer.position) @ self.forward)

    def places(self, a: Floats, b: Floats) -> Floats:
        """Positions (..., 3) from angles (...) to the right and up."""
        outward = np.cos(b)[..., None] * (
            np.sin(a)[..., None] * self.right - np.cos(a)[..., None] * self.forward
        )
        return self.centre + self.distance * (outward + np.sin(b)[..., None] * self.up)

    def seen_from(self, positions: Floats) -> tuple[Floats, Floats]:
        """Share and brightness (n,) from positions (n, 3)."""
        origins = np.repeat(positions, len(self.points), axis=0)
        directions = np.tile(self.points, (len(positions), 1)) - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)

        landings = main_landings(trace_all(self.plan, origins, directions), len(origins))
        share = landings.has_arrived.reshape(len(positions), -1) @ self.area
        light = dot(
            np.where(landings.has_arrived, landings.throughput, 0.0).reshape(len(positions), -1),
            self.area,
        )
        return np.minimum(share, 1.0), light / np.where(share > 0, share, 1.0)


def _points_of(corners: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) spread over triangles (m, 3, 3), at most SURVEY.n_points, and their shares (n,)
    of the area.
    """
    area = areas_of(corners)

    if len(corners) > SURVEY.n_points:  # triangles at equal steps of the cumulative area
        until = np.cumsum(area) / area.sum()
        chosen = np.searchsorted(until, (np.arange(SURVEY.n_points) + 0.5) / SURVEY.n_points)
        return corners[chosen].mean(axis=1), np.full(SURVEY.n_points, 1 / SURVEY.n_points)

    weights, parts = grid(isqrt(SURVEY.n_points // len(corners)))
    points = (weights[parts].mean(axis=1) @ corners).reshape(-1, 3)
    return points, np.repeat(area / area.sum() / len(parts), len(parts))
