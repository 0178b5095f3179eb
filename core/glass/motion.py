"""Rigid motion from one mesh to another, for reuse of all work on a mesh that only moved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Floats
from ..base.products import turn
from ..rig.rig import Mesh

FITTED = 64  # vertices used to find a motion; all others must follow it
# relative loss in products of doubles
PRODUCT_ROUNDING = 1e-13
# largest difference of rotated normals, per component
NORMAL_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """Rigid motion of points p to rotation p + shift.

    rotation (3, 3) orthonormal, not mirroring; shift (3,) m
    """

    rotation: Floats
    shift: Floats

    @cached_property
    def is_shift(self) -> bool:
        """Whether nothing rotates: products with the rotation would give the same numbers."""
        return np.array_equal(self.rotation, np.eye(3))

    def points(self, at: Floats) -> Floats:
        """Points (..., 3) after the motion."""
        return self.directions(at) + self.shift

    def directions(self, directions: Floats) -> Floats:
        """Directions (..., 3) after the motion; the same array if nothing rotates."""
        return directions if self.is_shift else turn(self.rotation, directions)

    def back(self, at: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Points and directions (..., 3) before the motion."""
        if self.is_shift:
            return at - self.shift, directions
        back = self.rotation.T
        return turn(back, at - self.shift), turn(back, directions)


def size_of(mesh: Mesh) -> tuple[float, float]:
    """Length of a mesh, m, unchanged by motions, and its `loss`: one mesh can be another after a
    motion only if their lengths differ by at most both losses.

    The length is the distance from the mean of all vertices to the furthest one. If vertices are
    off by `allowed` of `find_motion` in each component, it is off by 2 sqrt(3) times as much.
    """
    from_mean = mesh.vertices - mesh.vertices.mean(axis=0)
    loss = 4 * (PRODUCT_ROUNDING * np.abs(mesh.vertices).max() + 4 * mesh.rounding)
    return float(np.linalg.norm(from_mean, axis=1).max()), float(loss)


def find_motion(before: Mesh, after: Mesh) -> Motion | None:
    """Motion from one mesh to another; None if they differ by more than a motion and rounding."""
    if any(
        getattr(before, name) != getattr(after, name) for name in ("surface", "has_mean_normals")
    ) or not all(
        _is_same(getattr(before, name), getattr(after, name))
        for name in ("triangles", "is_smooth", "polygon")
    ):
        return None

    a = before.vertices
    b = after.vertices
    if a.shape != b.shape or (before.corner_normals is None) != (after.corner_normals is None):
        return None

    # the best rotation for some of the vertices
    some = np.linspace(0, len(a) - 1, min(len(a), FITTED)).astype(int)
    from_middle = a[some].mean(axis=0)
    to_middle = b[some].mean(axis=0)

    # Kabsch, A solution for the best rotation to relate two sets
    # of vectors (Acta Crystallographica A 32, 1976)
    u, _, v = np.linalg.svd((b[some] - to_middle).T @ (a[some] - from_middle))
    if np.linalg.det(u) * np.linalg.det(v) < 0:
        u[:, 2] *= -1  # for a flat mesh the mirror image is the same; others will not fit

    rotation = u @ v
    if np.abs(rotation - np.eye(3)).max() < PRODUCT_ROUNDING:
        rotation = np.eye(3)  # rounding must not rotate a mesh that only shifted

    motion = Motion(rotation, to_middle - rotation @ from_middle)

    scale = max(np.abs(a).max(), np.abs(b).max())
    allowed = PRODUCT_ROUNDING * scale + 4 * max(before.rounding, after.rounding)
    if np.abs(motion.points(a) - b).max() > allowed:
        return None

    if after.corner_normals is not None:
        rotated = motion.directions(before.corner_normals)
        if not np.abs(rotated - after.corner_normals).max() < NORMAL_TOLERANCE:
            return None

    return motion


def _is_same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))
