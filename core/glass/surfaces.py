"""Surface of a mesh, ready to be traced: flat and curved faces, normals, patches."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints, greatest, take
from ..base.steps import Steps, run_steps
from ..base.vectors import normalise
from ..rig.mesh import SAME_NORMAL
from ..rig.rig import Mesh
from .curved import CurvedFaces
from .meshes import (
    Edges,
    box_of,
    components,
    find_edges,
    find_joined,
    geometric_normals,
    volume_of,
)
from .motion import Motion
from .surface_fit import Drawn, make_curved


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles ready to be traced.

    corners : (t, 3, 3) m
    normals : (t, 3) geometric, unit, to the front
    curved : curved faces over some triangles, or None
    corner_normals, is_bent : (t, 3, 3) or None, for the flat triangles with bent normals, (t,)
    patch : (t,) label within this surface
    n_open : edges without a neighbour
    n_contradicted : smooth triangles left flat because their normals contradict their shape
    n_doubted : because their curved faces would be no closer to the intended surface
    """

    corners: Floats
    normals: Floats
    curved: CurvedFaces | None
    corner_normals: Floats | None
    is_bent: Bools
    patch: Ints
    n_open: int
    n_contradicted: int
    n_doubted: int

    def moved(self, motion: Motion) -> "Surface":
        """The same surface after a rigid motion."""
        return replace(
            self,
            corners=motion.points(self.corners),
            normals=motion.directions(self.normals),
            curved=None if self.curved is None else self.curved.moved(motion),
            corner_normals=None
            if self.corner_normals is None
            else motion.directions(self.corner_normals),
        )

    @property
    def n_curved(self) -> int:
        """Triangles with a curved face."""
        return 0 if self.curved is None else len(self.curved.coefficients)

    @cached_property
    def bounds(self) -> Floats:
        return box_of(self.corners)

    @cached_property
    def reach(self) -> float:
        """Largest offset, m, of curved faces from their facets."""
        return 0.0 if self.curved is None else self.curved.reach

    @cached_property
    def volume(self) -> float:
        """Volume inside the facets, m^3, positive for a solid."""
        return volume_of(self.corners)


def make_surface(mesh: Mesh) -> Surface:
    """Surface of a mesh, without pauses."""
    return run_steps(surface_steps(mesh))


def _bent_normals(
    mesh: Mesh, chosen: Ints, corner_normals: Floats | None, normals: Floats
) -> tuple[Floats, Bools, int]:
    """Normals (t, 3, 3) at the corners of chosen triangles (the face's own if flat), a mask (t,) of
    bent ones, and the number of smooth ones with normals against their shape.
    """
    by_corner = np.broadcast_to(normals[:, None], (len(chosen), 3, 3))
    is_smooth = None if mesh.is_smooth is None else mesh.is_smooth[chosen]
    if corner_normals is None or is_smooth is None or not is_smooth.any():
        return by_corner, np.zeros(len(chosen), bool), 0

    with np.errstate(invalid="ignore", over="ignore"):
        corner_normals = normalise(corner_normals)
        # false for NaN
        is_usable = (np.einsum("tij,tj->ti", corner_normals, normals) > 0).all(axis=1)

    # a smooth-shaded face with its own normals is flat, and the geometric normal is more exact
    is_own = greatest(np.abs(corner_normals - by_corner)) <= SAME_NORMAL
    is_bent = is_smooth & is_usable & ~is_own
    by_corner = np.where(is_bent[:, None, None], corner_normals, by_corner)
    return by_corner, is_bent, int((is_smooth & ~is_usable).sum())


def surface_steps(
    mesh: Mesh,
    triangles: Ints | None = None,
    is_flipped: Bools | None = None,
    edges: Edges | None = None,
) -> Steps[Surface]:
    """Surface of a mesh, or of some of its triangles (indices), some with reversed winding.

    edges : of the triangles as wound here, if known
    """
    chosen = np.arange(len(mesh.triangles)) if triangles is None else triangles
    index = mesh.triangles[chosen]
    corner_normals = None if mesh.corner_normals is None else mesh.corner_normals[chosen]

    if is_flipped is not None and is_flipped.any():
        index = np.where(is_flipped[:, None], index[:, ::-1], index)
        if corner_normals is not None:
            corner_normals = np.where(
                is_flipped[:, None, None], -corner_normals[:, ::-1], corner_normals
            )

    corners = take(mesh.vertices, index)
    normals = geometric_normals(corners)
    if edges is None:
        edges = find_edges(index)
    yield 0

    by_corner, is_bent, n_contradicted = _bent_normals(mesh, chosen, corner_normals, normals)
    curved = None
    n_doubted = 0

    # curved faces, if normals turn by more than rounding
    is_joined = find_joined(by_corner, edges)
    yield 0
    if is_bent.any() and mesh.surface != "facets":
        turn = np.abs(by_corner - np.roll(by_corner, -1, axis=1)).max()
        # the slope error of faces through rounded vertices, against the error of bent normals
        slope = mesh.rounding / np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
        if turn > np.sqrt(8 * slope):
            drawn = Drawn(
                vertices=mesh.vertices,
                triangles=index,
                corner_normals=by_corner,
                facets=normals,
                edges=edges,
                is_joined=is_joined,
                polygon=None if mesh.polygon is None else mesh.polygon[chosen],
            )
            curved, n_doubted = yield from make_curved(
                drawn, is_bent, mesh.has_mean_normals, mesh.surface == "automatic"
            )
            if curved is not None:
                is_bent &= curved.row < 0

            n_contradicted += int(is_bent.sum()) - n_doubted

    return Surface(
        corners=corners,
        normals=normals,
        curved=curved,
        corner_normals=by_corner if is_bent.any() else None,
        is_bent=is_bent,
        patch=components(len(index), edges.first[is_joined], edges.second[is_joined]),
        n_open=edges.n_open,
        n_contradicted=n_contradicted,
        n_doubted=n_doubted,
    )
