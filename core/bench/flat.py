"""A flat part as an outline in its own plane: how large has it to be for places to lie within?"""

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.errors import RigError
from ..base.vectors import cross_2d, normalise
from ..glass.meshes import areas_of, geometric_normals
from ..rig.mesh import Mesh

IS_FLAT = 1e-4  # of its size, by which a part may be off its plane


@dataclass(frozen=True, eq=False)
class Outline:
    """The outline of a flat part.

    middle : (3,) m, world, of its extents along the axes
    axes : (2, 3) unit, along its sides
    edges : (e, 2, 2) m along the axes, from the middle
    half : (2,) m, half of its width and height
    """

    middle: Floats
    axes: Floats
    edges: Floats
    half: Floats

    def across(self, places: Floats) -> Floats:
        """Places (n, 3) along the axes, (n, 2) m from the middle."""
        return (places - self.middle) @ self.axes.T

    def reach(self, across: Floats, about: Floats) -> Floats:
        """How many times as large (n,) the outline would have to be to
        reach places (n, 2), if its middle stood at (2,).
        """
        start, end = np.moveaxis(self.edges, 1, 0)
        along = end - start
        p = (across - about)[:, None]
        steep = cross_2d(p, along[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            # the ray t p meets the edge at start + s along
            t = cross_2d(start, along) / steep
            s = cross_2d(np.broadcast_to(start, (len(p), *start.shape)), p) / steep
            is_met = (t > 0) & (s >= -IS_FLAT) & (s <= 1 + IS_FLAT)
            outermost = np.where(is_met, t, 0.0).max(axis=1)
            return np.where(outermost > 0, 1 / outermost, 0.0)

    def changed(self, mesh: Mesh, size: float, shift: Floats) -> Mesh:
        """Its mesh so many times as large about the middle, and moved by (3,) m."""
        return replace(mesh, vertices=self.middle + size * (mesh.vertices - self.middle) + shift)


def outline_of(mesh: Mesh, along: Floats, owner: str) -> Outline:
    """The outline of a flat mesh.

    Parameters
    ----------
    along : (3,) world, along one of its sides
    owner : the part at the beginning of a sentence

    Raises
    ------
    RigError : it is not flat
    """
    normal = geometric_normals(mesh.corners)[areas_of(mesh.corners).argmax()]
    x = normalise(along - (along @ normal) * normal)
    axes = np.stack([x, np.cross(normal, x)])
    origin = mesh.corners[0, 0]
    points = mesh.corners.reshape(-1, 3) - origin
    across = points @ axes.T
    size = np.ptp(across, axis=0).max()
    if np.ptp(points @ normal) > IS_FLAT * size:
        raise RigError("{owner} is not flat: its size is for you to choose.", owner=owner)

    middle = across.min(axis=0) / 2 + across.max(axis=0) / 2
    vertices = (mesh.vertices - origin) @ axes.T - middle
    return Outline(
        middle=origin + middle @ axes,
        axes=axes,
        edges=vertices[_borders(mesh)],
        half=np.ptp(across, axis=0) / 2,
    )


def _borders(mesh: Mesh) -> Ints:
    """Edges (e, 2) of one triangle alone, by their vertices."""
    pairs = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, counts = np.unique(pairs, axis=0, return_counts=True)
    return edges[counts == 1]
