"""Ray engines, which find in float32 the first triangle on a ray: Embree, or else Blender's BVH.

Both are built from triangles with corners (t, 3, 3) float32, about unit size; their modules are
imported on construction. Rays have origins and unit directions (n, 3) float32, and hit triangles
from either side.
"""

from importlib import import_module
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Ints
from ..base.errors import RigError
from ..base.steps import Steps, run_steps
from ..glass.meshes import Frames

# Blender's BVH boxes treat smaller direction components as 0
ALONG_AXIS = 1.01 * 2.0**-23


class EngineHits(NamedTuple):
    """The first triangles hit by n rays.

    triangle : (n,), -1 for a miss, which leaves the other fields undefined
    distance : (n,)
    u, v : (n,) barycentric
    normal : (n, 3) of the triangle, not unit
    """

    triangle: Ints
    distance: NDArray[np.floating]
    u: NDArray[np.floating]
    v: NDArray[np.floating]
    normal: NDArray[np.floating]


class Embree:
    """Intel's Embree, all rays in one call."""

    name = "Embree"
    modules = "embreex", "embreex.rtcore_scene", "embreex.mesh_construction"

    def __init__(self, corners: NDArray[np.float32]) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, corners)

    def shoot(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> EngineHits:
        found = self._scene.run(origins, directions, output=True)
        return EngineHits(*(found[name] for name in ("primID", "tfar", "u", "v", "Ng")))


class BlenderBvh:
    """Blender's tree of boxes, each a float32 step larger than its triangles: one ray a call."""

    name = "Blender's BVH"
    modules = ("mathutils.bvhtree",)

    def __init__(self, corners: NDArray[np.float32]) -> None:
        from mathutils.bvhtree import BVHTree

        self._corners = corners
        triangles = np.arange(3 * len(corners)).reshape(-1, 3)
        self._tree = BVHTree.FromPolygons(
            corners.reshape(-1, 3).tolist(), triangles.tolist(), all_triangles=True
        )

    def shoot(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> EngineHits:
        cast = self._tree.ray_cast
        # as the BVH's boxes do, or triangles would see another direction and edges at box borders
        # be missed
        directions = np.where(np.abs(directions) < ALONG_AXIS, np.float32(0), directions)
        rays = zip(origins.tolist(), directions.tolist(), strict=True)
        met = np.array([cast(*ray)[2:] for ray in rays], float).reshape(-1, 2)  # NaN for its None
        is_met = np.isfinite(met[:, 0])
        triangle, distance = np.where(is_met[:, None], met, (-1, 0)).T
        triangle = triangle.astype(np.int64)
        frames = Frames.of(self._corners[triangle].astype(float))
        u, v = frames.barycentric(slice(None), origins + distance[:, None] * directions)

        return EngineHits(triangle, distance, u, v, frames.normal)


Engine = Embree | BlenderBvh


def engine_kind() -> type[Engine]:
    """Embree if it can be imported, else Blender's BVH; Embree if neither can."""
    for kind in (Embree, BlenderBvh):
        try:
            for module in kind.modules:
                import_module(module)
        except ImportError:
            continue
        return kind
    return Embree


def make_engine(corners: NDArray[np.float32]) -> Engine:
    """An engine for triangles with corners (t, 3, 3); RigError if none is available."""
    return run_steps(engine_steps(corners))


def engine_steps(corners: NDArray[np.float32]) -> Steps[Engine]:
    """Make an engine as `make_engine`, with pauses."""
    try:
        engine = engine_kind()(corners)
    except ImportError:
        raise RigError(
            "This Python has nothing to trace rays with: install {kernel} or {embreex} with pip.",
            kernel="kiriko-kernel",
            embreex="embreex",
        ) from None
    yield 0
    # Embree builds its tree on the first query
    no_rays = np.empty((0, 3), np.float32)
    engine.shoot(no_rays, no_rays)
    yield 0
    return engine
