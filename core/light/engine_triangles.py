"""The triangles that a ray engine is asked about, and the places on a layer found by them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.steps import Pauses
from ..glass.curved_roots import Spots
from ..glass.meshes import interpolate
from ..glass.quartics import product
from .engines import Engine, Found, make_engine, making_engine


@dataclass(frozen=True)
class LeavingKnobs:
    """When a ray only leaves the hull that has left the faces; the kernel's layers.c has the same.

    Tuned for time: nothing changes, and most such rays are not asked about curved faces
    (tests/core/test_curved.py, `test_leaving_the_hull_early_changes_nothing`).

    steep : cosine to the hull's normal
    near : part of a triangle's size
    """

    steep: float = 0.5
    near: float = 0.1


LEAVING = LeavingKnobs()


@dataclass(frozen=True, eq=False)
class Asked:
    """Triangles that are asked for hits: n_whole whole ones of a
    layer, then the others in parts.

    corners (p, 3, 3) in units of the layer's radius, from its centre; owner (p,): the layer's
    triangle; places (p - n_whole, 3, 2): u, v of the corners of parts in their triangle
    """

    corners: NDArray[np.float32]
    owner: Ints
    n_whole: int
    places: NDArray[np.float32]
    given: Any = None  # a ray engine that is there already

    @cached_property
    def engine(self) -> Engine:
        """The ray engine, made when it is first asked."""
        return make_engine(self.corners) if self.given is None else self.given

    def making_engine(self) -> Pauses[None]:
        """Make the ray engine, with pauses, unless it is there."""
        if self.given is None and "engine" not in vars(self):
            vars(self)["engine"] = yield from making_engine(self.corners)

    def spots(self, found: Found, chosen: Bools) -> Spots:
        """Places (n,) on the layer's triangles, of the chosen ones that the engine found."""
        prim = found.triangle[chosen].astype(np.int64)
        u, v = (column[chosen].astype(float) for column in (found.u, found.v))
        in_parts = np.flatnonzero(prim >= self.n_whole)
        if len(in_parts):
            part = taken(self.places, prim[in_parts] - self.n_whole).astype(float)
            u[in_parts], v[in_parts] = interpolate(part, u[in_parts], v[in_parts]).T
        return Spots(self.owner[prim], u, v)

    def are_left(self, found: Found, directions: Floats, far: Floats) -> Bools:
        """Do the triangles found tell that rays (n,) only come out of the hull, having left the
        faces just behind it?

        far : (n,) distances of the triangles, in units of the engine

        Such a ray, where it is outside of the glass, has but a short way, a part of the triangle's
        size, to where it steeply leaves the hull. It can enter nothing on that way: the faces turn
        much less over a triangle than the ray is steep.
        """
        normal = found.normal.T
        area = np.sqrt(product(normal, normal))  # twice the area, in units of the engine
        is_steep = product(normal, directions.T) > LEAVING.steep * area
        is_near = far**2 < LEAVING.near**2 * area
        return is_steep & is_near & (found.triangle >= self.n_whole)
