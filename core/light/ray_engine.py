"""Which triangle a ray meets first: a ray engine's answer, with the hit refined in float64.

The engine (float32) only says *which* triangle; where the ray meets it is computed in float64 from
the unmoved ray. Rays that it loses are looked for again in `rescue`.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import FLOAT32, Bools, Floats, Ints, take
from ..base.steps import Steps, run_steps
from ..base.vectors import dot, normalise
from ..glass.bounding_shell import BoundingShell, bounding_shell_steps
from ..glass.curved import CurvedFaces
from ..glass.curved_hits import RayLines, Spots, find_roots
from ..glass.meshes import Frames, box_of, interpolate
from ..glass.motion import Motion
from ..glass.quartics import product
from .engines import Engine, EngineHits, engine_steps, make_engine
from .hits import Hits, is_within


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
class EngineTriangles:
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

    def engine_steps(self) -> Steps[None]:
        """Make the ray engine, with pauses, unless it is there."""
        if self.given is None and "engine" not in vars(self):
            vars(self)["engine"] = yield from engine_steps(self.corners)

    def spots(self, found: EngineHits, chosen: Bools) -> Spots:
        """Places (n,) on the layer's triangles, of the chosen ones that the engine found."""
        prim = found.triangle[chosen].astype(np.int64)
        u, v = (column[chosen].astype(float) for column in (found.u, found.v))
        in_parts = np.flatnonzero(prim >= self.n_whole)
        if len(in_parts):
            part = take(self.places, prim[in_parts] - self.n_whole).astype(float)
            u[in_parts], v[in_parts] = interpolate(part, u[in_parts], v[in_parts]).T
        return Spots(self.owner[prim], u, v)

    def are_left(self, found: EngineHits, directions: Floats, far: Floats) -> Bools:
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


FEW_TRIANGLES = 32  # up to here all triangles are tested in float64 and no ray engine is built


class Layer:
    """Triangles that are asked together for the first hit of each ray.

    Solids of one layer do not touch one another, so that hits at the same place are found in
    different layers. Its triangles are those it was made of; questions and answers are in the place
    it was moved to.
    """

    def __init__(
        self, corners: Floats, curved: CurvedFaces | None = None, hull: BoundingShell | None = None
    ) -> None:
        """A layer of triangles (t, 3, 3), m; the hull of its curved faces may be there already."""
        self.motion: Motion | None = None
        self.corners = corners
        self.frames = Frames.of(corners)
        self.curved = curved
        self.n_triangles = len(corners)

        # curved faces are hidden behind triangles just in front of them, several for each
        owner = np.arange(len(corners))
        n_whole = len(corners)
        places = np.empty((0, 3, 2), np.float32)
        if curved is not None:
            hull = hull or run_steps(bounding_shell_steps(curved))
            flat = np.flatnonzero(curved.row < 0)
            owner = np.concatenate([flat, hull.triangle])
            places = hull.places
            n_whole = len(flat)
            corners = np.concatenate([corners[flat], hull.corners])

        # in units and from a place in which float32 loses least
        self.bounds = box_of(corners)
        self.centre = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(self.bounds[1] - self.centre)) or 1.0
        self.tolerance = 4 * FLOAT32 * self.radius
        self.asked = EngineTriangles(
            ((corners - self.centre) / self.radius).astype(np.float32), owner, n_whole, places
        )

    def moved(self, motion: Motion) -> "Layer":
        """The same layer elsewhere, with the same engine: rays are taken to where it was made."""
        other = copy(self)
        other.motion = motion
        return other

    def bent(self, curved: CurvedFaces | None) -> "Layer":
        """The same layer with slightly other curved faces; the triangles in the engine stay."""
        other = copy(self)
        other.curved = curved
        return other

    @property
    def has_engine(self) -> bool:
        """Few flat triangles need no ray engine."""
        return self.n_triangles > FEW_TRIANGLES or self.curved is not None

    def on_facets(self, k: Ints, origins: Floats, directions: Floats) -> Hits:
        """Where rays meet the planes of triangles k; not finite where they are parallel."""
        t = self.frames.distance(k, origins, directions)
        with np.errstate(invalid="ignore"):
            u, v = self.frames.barycentric(k, origins + t[..., None] * directions)
        slope = dot(directions, normalise(self.frames.normal[k]))
        return Hits(t, k, u, v, enters=slope < 0, cosine=np.abs(slope))

    def on_curved(
        self, spots: Spots, lines: RayLines, leaves: Bools | None, is_last: bool = False
    ) -> tuple[Hits, Bools]:
        """Where rays meet curved faces, beginning at places on them; and whether they do."""
        found = find_roots(self.curved, spots, lines, leaves, self.tolerance, is_last)
        hits = Hits(
            *(found.distance, found.triangle, found.u, found.v, found.enters),
            cosine=np.abs(dot(lines.directions, normalise(found.facing))),
            facing=found.facing,
            normal=self.curved.given_normals(found.facing, *found.spots),
        )
        return hits, found.is_met

    def is_on_face(self, hits: Hits) -> Bools:
        """Are hits within their faces? On curved ones that are met they are."""
        is_flat_hit = is_within(hits.u, hits.v)
        if self.curved is None:
            return is_flat_hit
        return is_flat_hit | (self.curved.row[hits.triangle] >= 0)

    def shoot(self, lines: RayLines, start: Floats) -> tuple[EngineHits, Floats]:
        """The triangles that the engine finds from `start` on,
        and its distance as the engine has it.
        """
        origins, directions = lines
        moved = (origins + start[:, None] * directions - self.centre) / self.radius
        found = self.asked.engine.shoot(moved.astype(np.float32), directions.astype(np.float32))
        return found, start + found.distance.astype(float) * self.radius

    def refine(
        self, found: EngineHits, chosen: Bools, lines: RayLines, leaves: Bools | None
    ) -> tuple[Hits, Bools]:
        """Hits (n,) in float64 of what the engine has found, some of which may come to nothing."""
        spots = self.asked.spots(found, chosen)
        k = spots.triangle
        if self.curved is None:
            return self.on_facets(k, *lines), np.ones(len(k), bool)

        is_curved = self.curved.row[k] >= 0
        if is_curved.all():
            return self.on_curved(spots, lines, leaves)

        hits = Hits.none(len(k), self.curved)
        is_met = np.ones(len(k), bool)
        flat = np.flatnonzero(~is_curved)
        bent = np.flatnonzero(is_curved)
        hits.put(flat, self.on_facets(k[flat], *lines.at(flat)))
        of_bent = None if leaves is None else leaves[bent]
        some, is_met[bent] = self.on_curved(spots.at(bent), lines.at(bent), of_bent)
        hits.put(bent, some)
        return hits, is_met
