"""From where is the picture seen? Viewers on a sphere
around it, each looking straight at points of it.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from math import isqrt

import numpy as np

from ..arrays import Floats
from ..errors import RigError
from ..glass.meshes import areas_of
from ..glass.quartics import grid
from ..light.landings import main_landings
from ..light.plan import Plan
from ..light.trace import trace_all
from ..vectors import dot

FARTHEST = np.radians(75.0)  # from the viewer's own place, each way
STEPS = 60  # places along each way over the whole range
FINE = np.radians(0.1)  # steps straight to the left, right, down and up, to tell angles
POINTS = 72  # of the picture that are looked at, at the most
AT_ONCE = 1 << 16
ROUNDING = 1e-9  # of shares


@dataclass(frozen=True, eq=False)
class VisibleRange:
    """The picture's points as viewers see them at places of a
    grid, rows going up and columns to the right.

    Parameters
    ----------
    positions : (n, n, 3) m, world
    share : (n, n) of the picture's area whose light comes from the display, 0..1
    brightness : (n, n) mean throughput of that light
    extent : how far to the left, right, down and up from the viewer's place as
        much is seen as was asked for, rad; NaN where not even from there
    best : largest share seen from any place
    """

    positions: Floats
    share: Floats
    brightness: Floats
    extent: tuple[float, float, float, float]
    best: float


def visible_range(plan: Plan, enough: float = 1.0) -> Generator[float, None, VisibleRange]:
    """Find from where at least a share `enough` of the picture is seen; yields progress 0..1.

    Raises
    ------
    RigError : the picture has no place of its own
    """
    viewer = plan.rig.viewer
    picture = plan.rig.picture_place
    if picture.mesh is None:
        raise RigError(
            "The picture is in the viewer's own pixels and moves with it: choose a picture plane."
        )
    plan = replace(plan, settings=replace(plan.settings, brightness=True))
    points, area = _points_of(picture.mesh.corners)
    centre = picture.mesh.bounds.mean(axis=0)
    right, up, forward = viewer.axes
    distance = float((centre - viewer.position) @ forward)
    if not distance > 0:
        raise RigError(
            "The picture '{picture}' is behind the viewer: turn the viewer round.",
            picture=picture.name,
        )

    def places(a: Floats, b: Floats) -> Floats:
        """Positions (..., 3) by angles (...) to the right and up."""
        outward = np.cos(b)[..., None] * (
            np.sin(a)[..., None] * right - np.cos(a)[..., None] * forward
        )
        return centre + distance * (outward + np.sin(b)[..., None] * up)

    def seen_from(positions: Floats) -> tuple[Floats, Floats]:
        """Share and brightness (n,) from positions (n, 3)."""
        origins = np.repeat(positions, len(points), axis=0)
        directions = np.tile(points, (len(positions), 1)) - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        landings = main_landings(trace_all(plan, origins, directions), len(origins))
        share = landings.has_arrived.reshape(len(positions), -1) @ area
        light = dot(
            np.where(landings.has_arrived, landings.throughput, 0.0).reshape(len(positions), -1),
            area,
        )
        return np.minimum(share, 1.0), light / np.where(share > 0, share, 1.0)

    angles = np.linspace(-FARTHEST, FARTHEST, STEPS + 1)
    a, b = np.meshgrid(angles, angles)
    positions = places(a, b).reshape(-1, 3)
    share, brightness = np.empty((2, len(positions)))
    step = AT_ONCE // len(points)
    for first in range(0, len(positions), step):
        some = slice(first, first + step)
        share[some], brightness[some] = seen_from(positions[some])
        yield 0.9 * min(first + step, len(positions)) / len(positions)
    extent = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        way = sign * np.arange(0.0, FARTHEST, FINE)
        seen, _ = seen_from(places(way, 0 * way) if axis == 0 else places(0 * way, way))
        n_seen = int(np.logical_and.accumulate(seen >= enough - ROUNDING).sum())
        extent.append(float("nan") if n_seen == 0 else float(abs(way[n_seen - 1])))
        yield 0.9 + 0.025 * len(extent)
    shape = a.shape
    return VisibleRange(
        positions.reshape(*shape, 3),
        share.reshape(shape),
        brightness.reshape(shape),
        tuple(extent),
        float(share.max()),
    )


def _points_of(corners: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) spread over triangles (m, 3, 3), at most
    POINTS of them, and each one's share (n,) of the area.
    """
    area = areas_of(corners)
    if len(corners) > POINTS:  # every so much of the area, a triangle
        until = np.cumsum(area) / area.sum()
        chosen = np.searchsorted(until, (np.arange(POINTS) + 0.5) / POINTS)
        return corners[chosen].mean(axis=1), np.full(POINTS, 1 / POINTS)
    weights, parts = grid(isqrt(POINTS // len(corners)))
    points = (weights[parts].mean(axis=1) @ corners).reshape(-1, 3)
    return points, np.repeat(area / area.sum() / len(parts), len(parts))
