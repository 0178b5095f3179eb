"""Triangles of a part, as plain data."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import MeshError
from ..base.fingerprint import fingerprint

# radians: corner normals closer than this join faces to one patch (float32 noise is 1e-7 to 1e-6)
SAME_NORMAL = 1e-5
SurfaceChoice = Literal["automatic", "smooth", "facets"]

# m, the largest number of float32, in which Blender keeps vertices: products
# of four such lengths, as those of areas, are still numbers of float64
FURTHEST = float(np.finfo(np.float32).max)

FLAT_THICKNESS = (
    1e-9  # of its size: glass no thicker than that, and than rounding makes it, encloses nothing
)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in world coordinates. Arrays stay as they are once it is made: what is found for
    them is kept. A mesh that differs is another one.

    Parameters
    ----------
    vertices : (v, 3) float64, m
    triangles : (t, 3) int, indices into vertices, counterclockwise
        seen from the front (outside of a solid)
    corner_normals : (t, 3, 3) float64 or None, unit, world. Used on smooth triangles only.
    is_smooth : (t,) bool or None (all flat). A flat triangle refracts by its own plane.
    uv : (t, 3, 2) float64 or None, Blender's UV: origin bottom left
    surface : that of smooth triangles: the curved one that was meant ("smooth"), or the facets as
        drawn, on which only the normal is interpolated ("facets"), or whichever the mesh shows to
        be nearer to the one meant, or a mean of both ("automatic")
    has_mean_normals : corner normals are means over the faces around, as Blender makes them where
        the artist gave none; they only say where the surface is smooth, and its own normals are
        found from the vertices
    rounding : m, by which vertices may be off because they were rounded
    polygon : (t,) int or None, the polygon that each triangle is a part of: edges between two of
        one polygon are its diagonals, which nobody drew. None: each triangle is one of its own
    """

    vertices: Floats
    triangles: Ints
    corner_normals: Floats | None = None
    is_smooth: Bools | None = None
    uv: Floats | None = None
    surface: SurfaceChoice = "smooth"
    has_mean_normals: bool = False
    rounding: float = 0.0
    polygon: Ints | None = None

    def flat(self) -> "Mesh":
        """The same triangles, each flat whatever its shading."""
        return replace(self, corner_normals=None, is_smooth=None, polygon=None)

    @cached_property
    def fingerprint(self) -> str:
        """Tells it from all others; found once, for it takes as long as reading all of it."""
        return fingerprint(self)

    @property
    def corners(self) -> Floats:
        """Corner positions (t, 3, 3), m."""
        return self.vertices[self.triangles]

    @cached_property
    def bounds(self) -> Floats:
        """Lower and upper corner of the axis-aligned box (2, 3), m."""
        used = self._used_vertices()
        return np.stack([used.min(axis=0), used.max(axis=0)])

    def _used_vertices(self) -> Floats:
        """Vertices (n, 3) at which a triangle has a corner, m."""
        is_used = np.zeros(len(self.vertices), bool)
        is_used[self.triangles] = True
        return self.vertices[is_used]

    @cached_property
    def is_flat(self) -> bool:
        """Do all corners lie in one plane, but for rounding?"""
        points = self._used_vertices()
        points = points - points.mean(axis=0)

        # without the threads of BLAS (core/base/products.py); the first
        # axis is the one along which they spread least
        _, axes = np.linalg.eigh(np.einsum("ni,nj->ij", points, points))
        thick, _, wide = np.ptp(np.einsum("ni,ij->nj", points, axes), axis=0)

        return bool(thick <= FLAT_THICKNESS * wide + 4 * self.rounding)

    @cached_property
    def n_curved(self) -> int:
        """How many triangles stand for a curved surface; a flat
        face that is shaded smooth does not.
        """
        if self.is_smooth is None or self.corner_normals is None or self.surface == "facets":
            return 0
        first, *others = self.corner_normals[self.is_smooth].swapaxes(0, 1)
        is_bent = [(np.abs(normal - first) > SAME_NORMAL).any(axis=1) for normal in others]
        return int(np.logical_or(*is_bent).sum())

    def check(self, owner: str) -> None:
        """Raise MeshError when there is nothing to trace, or a coordinate is not finite
        or beyond FURTHEST.
        """
        if len(self.triangles) == 0:
            raise MeshError(
                "{owner} has no faces with an area: give it some, or set its role to None.",
                owner=owner,
            )

        if self.triangles.min() < 0 or self.triangles.max() >= len(self.vertices):
            raise MeshError(
                "{owner} has faces whose corners are none of its vertices: number them from 0.",
                owner=owner,
            )

        if not np.isfinite(self.vertices).all():
            raise MeshError(
                "{owner} has vertices that are not finite numbers: repair or remove them.",
                owner=owner,
            )

        if np.abs(self.vertices).max() > FURTHEST:
            raise MeshError(
                "{owner} has vertices further than {furthest:.2g} m from the origin: move them"
                " nearer or remove them.",
                owner=owner,
                furthest=FURTHEST,
            )

    def check_uv(self, owner: str) -> None:
        """Raise MeshError when there is no UV map that an image can be put on."""
        if self.uv is None:
            raise MeshError(
                "{owner} has no UV map: unwrap it, so that pixels have a place.", owner=owner
            )

        if not np.isfinite(self.uv).all():
            raise MeshError(
                "{owner} has a UV map with numbers that are not finite: unwrap it again.",
                owner=owner,
            )

        if not np.ptp(self.uv.reshape(-1, 2), axis=0).all():
            raise MeshError("{owner} has a UV map without area: unwrap it again.", owner=owner)
