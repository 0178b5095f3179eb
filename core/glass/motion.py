"""Rigid motion: a mesh that was only moved or turned need not be made ready again."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Floats
from ..base.products import turn
from ..rig.rig import Mesh

FITTED = 64  # vertices from which a motion is found; all others have to follow it
# of the distances: the loss in products of doubles
PRODUCT_ROUNDING = 1e-13
# in each component: so far normals may be off that were turned along
TURNED_NORMAL = 1e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """Points p go to rotation p + shift. rotation (3, 3) orthonormal, not mirroring.

    Shift (3,) m.
    """

    rotation: Floats
    shift: Floats

    @cached_property
    def is_shift(self) -> bool:
        """Does nothing turn? Then products with the rotation would give the same numbers."""
        return np.array_equal(self.rotation, np.eye(3))

    def points(self, at: Floats) -> Floats:
        """Where points (..., 3) go."""
        return self.directions(at) + self.shift

    def directions(self, directions: Floats) -> Floats:
        """Where directions (..., 3) turn; the same array where nothing does."""
        return directions if self.is_shift else turn(self.rotation, directions)

    def back(self, at: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Where points and directions (..., 3) have come from."""
        if self.is_shift:
            return at - self.shift, directions
        back = self.rotation.T
        return turn(back, at - self.shift), turn(back, directions)


def size_of(mesh: Mesh) -> tuple[float, float]:
    """A length of a mesh that motions keep, m, and a number `loss`: one of two meshes may be the
    other one moved only if their lengths differ by no more than both losses.

    The length is the distance from the mean of all vertices to the furthest of them. Where each
    component of each vertex is off by `allowed` of `find_motion`, it is off by 2 sqrt(3) of it.
    """
    from_mean = mesh.vertices - mesh.vertices.mean(axis=0)
    loss = 4 * (PRODUCT_ROUNDING * np.abs(mesh.vertices).max() + 4 * mesh.rounding)
    return float(np.linalg.norm(from_mean, axis=1).max()), float(loss)


def find_motion(before: Mesh, after: Mesh) -> Motion | None:
    """The motion from one mesh to another; None where they
    differ by more than one and the vertices' rounding.
    """
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

    # a rotation that takes some of the vertices as near as any
    some = np.linspace(0, len(a) - 1, min(len(a), FITTED)).astype(int)
    from_middle = a[some].mean(axis=0)
    to_middle = b[some].mean(axis=0)

    # Kabsch, A solution for the best rotation to relate two sets
    # of vectors (Acta Crystallographica A 32, 1976)
    u, _, v = np.linalg.svd((b[some] - to_middle).T @ (a[some] - from_middle))
    if np.linalg.det(u) * np.linalg.det(v) < 0:
        u[:, 2] *= -1  # the mirror image of a flat mesh is the same; of others it will not fit

    rotation = u @ v
    if np.abs(rotation - np.eye(3)).max() < PRODUCT_ROUNDING:
        rotation = np.eye(3)  # so that a mesh that was only moved is not turned by rounding

    motion = Motion(rotation, to_middle - rotation @ from_middle)

    # all the others have to follow it
    scale = max(np.abs(a).max(), np.abs(b).max())
    allowed = PRODUCT_ROUNDING * scale + 4 * max(before.rounding, after.rounding)
    if np.abs(motion.points(a) - b).max() > allowed:
        return None

    if after.corner_normals is not None:
        turned = motion.directions(before.corner_normals)
        if not np.abs(turned - after.corner_normals).max() < TURNED_NORMAL:
            return None

    return motion


def _is_same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))
