"""The triangle each ray hits first: a ray engine's answer, refined in float64.

The engine (float32) only identifies the triangle. The hit is computed in float64 from the original
ray. `layer_hits.find_missed_hits` recovers rays lost by the engine.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

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
class LeavingOptions:
    """When a ray through the bounding shell is only leaving it; repeated in the kernel's layers.c.

    Tuned for time: results are unchanged, and most such rays skip the test of curved faces
    (tests/core/test_curved.py, `test_leaving_the_hull_early_changes_nothing`).

    steep : cosine to the shell's normal
    near : relative to a triangle's size
    """

    steep: float = 0.5
    near: float = 0.1


LEAVING = LeavingOptions()


@dataclass(frozen=True, eq=False)
class EngineTriangles:
    """Triangles of a ray engine: n_whole flat ones of a layer, then the bounding shell of its
    curved faces.

    corners : (p, 3, 3) from the layer's centre, in units of its radius
    owner : (p,) the layer's triangle
    places : (p - n_whole, 3, 2) u, v of the shell triangles' corners in their face
    """

    corners: NDArray[np.float32]
    owner: Ints
    n_whole: int
    places: NDArray[np.float32]

    @cached_property
    def engine(self) -> Engine:
        """The ray engine, made on first use."""
        return make_engine(self.corners)

    def engine_steps(self) -> Steps[None]:
        """Make the ray engine, with pauses, unless it exists."""
        if "engine" not in vars(self):
            vars(self)["engine"] = yield from engine_steps(self.corners)

    def spots(self, found: EngineHits, chosen: Bools) -> Spots:
        """Places (n,) on the layer's triangles, for chosen hits of the engine."""
        prim = found.triangle[chosen].astype(np.int64)
        u, v = (column[chosen].astype(float) for column in (found.u, found.v))
        in_parts = np.flatnonzero(prim >= self.n_whole)
        if len(in_parts):
            part = take(self.places, prim[in_parts] - self.n_whole).astype(float)
            u[in_parts], v[in_parts] = interpolate(part, u[in_parts], v[in_parts]).T
        return Spots(self.owner[prim], u, v)

    def are_left(self, found: EngineHits, directions: Floats, far: Floats) -> Bools:
        """Whether rays (n,) are only leaving the bounding shell, having left the faces behind it.

        far : (n,) distances of the triangles, in units of the engine

        Outside the glass, such a ray is within a fraction of the triangle's size of its steep exit
        from the shell. It cannot enter a face on the way, because the faces turn much less over a
        triangle than the ray is steep.
        """
        normal = found.normal.T
        area = np.sqrt(product(normal, normal))  # twice the area, in units of the engine
        is_steep = product(normal, directions.T) > LEAVING.steep * area
        is_near = far**2 < LEAVING.near**2 * area
        return is_steep & is_near & (found.triangle >= self.n_whole)


FEW_TRIANGLES = 32  # up to here all triangles are tested in float64, without a ray engine


class Layer:
    """Triangles searched together for the first hit of each ray.

    Solids of one layer do not touch, so coincident hits are found in different layers. Triangles
    are stored before the layer's motion; rays and hits are in the moved place.
    """

    def __init__(
        self, corners: Floats, curved: CurvedFaces | None = None, shell: BoundingShell | None = None
    ) -> None:
        """A layer of triangles (t, 3, 3), m; `shell` is the bounding shell of its curved faces, if
        already made.
        """
        self.motion: Motion | None = None
        self.corners = corners
        self.frames = Frames.of(corners)
        self.curved = curved
        self.n_triangles = len(corners)

        # curved faces are enclosed by a shell, with several triangles for each
        owner = np.arange(len(corners))
        n_whole = len(corners)
        places = np.empty((0, 3, 2), np.float32)
        if curved is not None:
            shell = shell or run_steps(bounding_shell_steps(curved))
            flat = np.flatnonzero(curved.row < 0)
            owner = np.concatenate([flat, shell.triangle])
            places = shell.places
            n_whole = len(flat)
            corners = np.concatenate([corners[flat], shell.corners])

        # origin and unit with the least float32 rounding
        self.bounds = box_of(corners)
        self.centre = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(self.bounds[1] - self.centre)) or 1.0
        self.tolerance = 4 * FLOAT32 * self.radius
        self.engine_triangles = EngineTriangles(
            ((corners - self.centre) / self.radius).astype(np.float32), owner, n_whole, places
        )

    def moved(self, motion: Motion) -> "Layer":
        """The same layer and engine after a motion: rays are transformed back to the original
        place.
        """
        other = copy(self)
        other.motion = motion
        return other

    def bent(self, curved: CurvedFaces | None) -> "Layer":
        """The same layer with slightly different curved faces; the engine's triangles are
        unchanged.
        """
        other = copy(self)
        other.curved = curved
        return other

    @property
    def has_engine(self) -> bool:
        """Whether it needs a ray engine: it has many or curved faces."""
        return self.n_triangles > FEW_TRIANGLES or self.curved is not None

    def on_facets(self, k: Ints, origins: Floats, directions: Floats) -> Hits:
        """Intersections of rays with the planes of triangles k; not finite if parallel."""
        t = self.frames.distance(k, origins, directions)
        with np.errstate(invalid="ignore"):
            u, v = self.frames.barycentric(k, origins + t[..., None] * directions)
        slope = dot(directions, normalise(self.frames.normal[k]))
        return Hits(t, k, u, v, enters=slope < 0, cosine=np.abs(slope))

    def on_curved(
        self, spots: Spots, lines: RayLines, leaves: Bools | None, is_last: bool = False
    ) -> tuple[Hits, Bools]:
        """Intersections of rays with curved faces, starting from places on them; and whether they
        exist.
        """
        found = find_roots(self.curved, spots, lines, leaves, self.tolerance, is_last)
        hits = Hits(
            *(found.distance, found.triangle, found.u, found.v, found.enters),
            cosine=np.abs(dot(lines.directions, normalise(found.facing))),
            facing=found.facing,
            normal=self.curved.given_normals(found.facing, *found.spots),
        )
        return hits, found.is_met

    def is_on_face(self, hits: Hits) -> Bools:
        """Whether hits lie within their faces; hits on curved faces always do."""
        is_flat_hit = is_within(hits.u, hits.v)
        if self.curved is None:
            return is_flat_hit
        return is_flat_hit | (self.curved.row[hits.triangle] >= 0)

    def shoot(self, lines: RayLines, start: Floats) -> tuple[EngineHits, Floats]:
        """The engine's first triangles beyond `start`, and their distances from the rays'
        origins.
        """
        origins, directions = lines
        moved = (origins + start[:, None] * directions - self.centre) / self.radius
        found = self.engine_triangles.engine.shoot(
            moved.astype(np.float32), directions.astype(np.float32)
        )
        return found, start + found.distance.astype(float) * self.radius

    def refine(
        self, found: EngineHits, chosen: Bools, lines: RayLines, leaves: Bools | None
    ) -> tuple[Hits, Bools]:
        """Refine chosen engine hits to float64 (n,), and whether they exist."""
        spots = self.engine_triangles.spots(found, chosen)
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
