"""The display as a surface for light: its UV islands, and its plane if it is one flat rectangle."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.vectors import cross_2d, normalise
from ..glass.meshes import components, edge_corners, find_edges
from ..glass.surfaces import Surface
from ..rig.rig import Display, Mesh
from .polarisation import axes_of

# relative tolerance for a display to count as one flat rectangle
DISPLAY_FLATNESS = 1e-6


@dataclass(frozen=True, eq=False)
class DisplayPlane:
    """A display that is one flat rectangle under its whole image.

    corner : (3,) m
    normal : (3,) unit, to the front
    pixels, origin : (2, 3) px / m and (2,) px; a point p is at pixel xy = pixels (p - corner) +
        origin
    """

    corner: Floats
    normal: Floats
    pixels: Floats
    origin: Floats


def display_pixel(display: Display) -> float:
    """Approximate side of a display's smallest pixel, m."""
    return min(
        float(np.linalg.norm(np.ptp(one.mesh.bounds, axis=0)) / np.hypot(one.width, one.height))
        for one in display.parts
    )


def uv_islands(mesh: Mesh) -> Ints:
    """Label (t,) of each triangle's UV island.

    Triangles are joined if an edge is shared in UV as well as in space.
    """
    edges = find_edges(mesh.triangles)
    first, second = edge_corners(mesh.uv, edges)
    joined = (first == second).all(axis=(1, 2))
    return components(len(mesh.triangles), edges.first[joined], edges.second[joined])


def uv_area(uv: Floats) -> float:
    """Area of triangles (t, 3, 2) in UV, each counted positive."""
    a = uv[:, 1] - uv[:, 0]
    b = uv[:, 2] - uv[:, 0]
    return float(0.5 * np.abs(cross_2d(a, b)).sum())


def absorbing_axes(display: Display, surface: Surface) -> Floats:
    """Absorbing axis (t, 3) of the display's polariser at each triangle; 0 without one."""
    starts = np.cumsum([0, *(len(one.mesh.triangles) for one in display.parts)])
    axes = np.zeros((starts[-1], 3))
    for one, start in zip(display.parts, starts, strict=False):
        if one.polarised is not None:
            some = slice(start, start + len(one.mesh.triangles))
            axes[some] = axes_of(one.mesh, surface.normals[some], one.polarised + np.pi / 2)
    return axes


def affine_fit(places: Floats, values: Floats) -> tuple[Floats, float]:
    """The affine map (3, k) nearest to values (n, k) at places (n, 2), and its largest error.

    Rows: the derivatives of the values along both axes, and the value at 0.
    """
    system = np.column_stack([places, np.ones(len(places))])
    fit, *_ = np.linalg.lstsq(system, values, rcond=None)
    return fit, float(np.abs(system @ fit - values).max())


def display_plane(display: Display, surface: Surface) -> DisplayPlane | None:
    """The plane of a flat rectangular display; None for any other."""
    corner = surface.corners[0, 0]
    normal = surface.normals[0]
    inside = surface.corners.reshape(-1, 3) - corner

    uv = display.mesh.uv.reshape(-1, 2)
    size = np.ptp(inside, axis=0).max()
    is_whole = (
        np.ptp(surface.patch) == 0
        and np.abs(uv.min(axis=0)).max() < DISPLAY_FLATNESS
        and abs(uv_area(display.mesh.uv) - 1) < DISPLAY_FLATNESS
    )
    is_flat = (
        np.abs(surface.normals - normal).max() < DISPLAY_FLATNESS
        and np.abs(inside @ normal).max() < DISPLAY_FLATNESS * size
    )
    if not (is_whole and is_flat and np.abs(uv.max(axis=0) - 1).max() < DISPLAY_FLATNESS):
        return None

    right = normalise(inside[1])
    axes = np.stack([right, np.cross(normal, right)])

    # relative to its size: far from 1 m the columns would differ so much in scale that the fit
    # loses digits
    fit, missed = affine_fit(inside @ axes.T / size, uv)
    if missed > DISPLAY_FLATNESS:
        return None

    scale = np.array([display.width, -display.height])
    return DisplayPlane(
        corner=corner,
        normal=normal,
        pixels=scale[:, None] * (fit[:2].T @ axes) / size,
        origin=np.array([0, display.height]) + scale * fit[2],
    )
