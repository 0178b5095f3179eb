"""Triangles of a part, as plain data."""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, convert
from ..base.errors import MeshError, check_choice
from ..base.fingerprint import fingerprint

# radians: closer corner normals join faces to one patch (float32 noise is 1e-7 to 1e-6)
SAME_NORMAL = 1e-5
SurfaceChoice = Literal["automatic", "smooth", "facets"]

# m, the largest float32, Blender's type for vertices; products of four such lengths, as in areas,
# fit in float64
FURTHEST = float(np.finfo(np.float32).max)

# relative to its size: glass thinner than this, or than rounding, encloses nothing
FLAT_THICKNESS = 1e-9


# type of each array, and its shape after the number of vertices or triangles
ARRAYS = {
    "vertices": (np.float64, (3,)),
    "triangles": (np.int64, (3,)),
    "corner_normals": (np.float64, (3, 3)),
    "is_smooth": (np.bool_, ()),
    "uv": (np.float64, (3, 2)),
    "polygon": (np.int64, ()),
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in world coordinates. Arrays must not change, because derived values are cached;
    arrays of another type are converted.

    Parameters
    ----------
    vertices : (v, 3) float64, m
    triangles : (t, 3) int, indices into vertices, counterclockwise seen from the front (outside of
        a solid)
    corner_normals : (t, 3, 3) float64 or None, unit, world; used on smooth triangles only
    is_smooth : (t,) bool or None (all flat). A flat triangle refracts by its own plane.
    uv : (t, 3, 2) float64 or None, Blender's UV: origin bottom left
    surface : of smooth triangles: "smooth", the intended curved surface; "facets", flat facets with
        interpolated normals; "automatic", whichever of the two, or mean of both, the mesh shows to
        be nearer to the intended surface
    has_mean_normals : corner normals are averages over adjacent faces, Blender's default; they only
        mark the smooth surface, whose normals are derived from the vertices
    rounding : m, rounding error of vertices
    polygon : (t,) int or None, the polygon of each triangle; edges within a polygon are its
        diagonals. None: each triangle is a polygon
    """

    vertices: NDArray[Any]
    triangles: NDArray[Any]
    corner_normals: NDArray[Any] | None = None
    is_smooth: NDArray[Any] | None = None
    uv: NDArray[Any] | None = None
    surface: SurfaceChoice = "smooth"
    has_mean_normals: bool = False
    rounding: float = 0.0
    polygon: NDArray[Any] | None = None

    def __post_init__(self) -> None:
        for name, (kind, _) in ARRAYS.items():
            convert(self, partial(np.asarray, dtype=kind), name)

    def flat(self) -> "Mesh":
        """The same triangles, each flat regardless of shading."""
        return replace(self, corner_normals=None, is_smooth=None, polygon=None)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of its content, cached because it takes as long as reading all of it."""
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
        """Vertices (n, 3) used by a triangle, m."""
        is_used = np.zeros(len(self.vertices), bool)
        is_used[self.triangles] = True
        return self.vertices[is_used]

    @cached_property
    def is_flat(self) -> bool:
        """Whether all corners lie in one plane, up to rounding."""
        points = self._used_vertices()
        points = points - points.mean(axis=0)

        # without the threads of BLAS (core/base/products.py); the first axis has the least spread
        _, axes = np.linalg.eigh(np.einsum("ni,nj->ij", points, points))
        thick, _, wide = np.ptp(np.einsum("ni,ij->nj", points, axes), axis=0)

        return bool(thick <= FLAT_THICKNESS * wide + 4 * self.rounding)

    @cached_property
    def n_curved(self) -> int:
        """Number of triangles on a curved surface; flat faces shaded smooth do not count."""
        if self.is_smooth is None or self.corner_normals is None or self.surface == "facets":
            return 0
        first, *others = self.corner_normals[self.is_smooth].swapaxes(0, 1)
        is_bent = [(np.abs(normal - first) > SAME_NORMAL).any(axis=1) for normal in others]
        return int(np.logical_or(*is_bent).sum())

    def check(self, owner: str) -> None:
        """Raise MeshError if the mesh is empty, an array has the wrong shape, or a coordinate is
        not finite or beyond FURTHEST.
        """
        if len(self.triangles) == 0:
            raise MeshError(
                "{owner} has no faces with an area: add some, or set its role to None.",
                owner=owner,
            )

        for name, (_, shape) in ARRAYS.items():
            values = getattr(self, name)
            shape = len(self.vertices if name == "vertices" else self.triangles), *shape
            if values is not None and values.shape != shape:
                raise MeshError(
                    "{owner} has {name} of shape {found}: give it the shape {shape}.",
                    owner=owner,
                    name=name,
                    found=values.shape,
                    shape=shape,
                )
        check_choice(owner, "surface", self.surface, SurfaceChoice)

        if self.triangles.min() < 0 or self.triangles.max() >= len(self.vertices):
            raise MeshError(
                "{owner} has faces with missing vertices: number vertices from 0.",
                owner=owner,
            )

        if not (np.abs(self.vertices) <= FURTHEST).all():
            raise MeshError(
                "{owner} has vertices that are not finite, or further than {furthest:.2g} m from"
                " the origin: move or remove them.",
                owner=owner,
                furthest=FURTHEST,
            )

    def check_uv(self, owner: str) -> None:
        """Raise MeshError without a UV map suitable for an image."""
        is_mapped = self.uv is not None and np.isfinite(self.uv).all()
        if not (is_mapped and np.ptp(self.uv.reshape(-1, 2), axis=0).all()):
            raise MeshError("{owner} has no UV map with an area: unwrap it.", owner=owner)
