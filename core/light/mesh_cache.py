"""Cache of results reused from one plan to the next."""

from collections.abc import Callable
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Floats
from ..base.steps import Steps
from ..glass.motion import Motion, find_motion, size_of
from ..glass.solids import solid_steps
from ..glass.surfaces import Surface
from ..rig.rig import Mesh

Thing = TypeVar("Thing")


class MeshCache:
    """Results reused from one plan to the next, by fingerprint of their sources.

    Results used between two calls of `forget` stay; others are dropped.

    is_exact : do not reuse moved solids, so results are bit-identical whatever was solved before
    """

    def __init__(self, is_exact: bool = False) -> None:
        self._is_exact = is_exact
        self._old: dict[str, Any] = {}
        self._now: dict[str, Any] = {}
        self._sizes: tuple[list[str], Floats] | None = None  # of the old meshes, computed on demand
        # by mesh object, to skip the comparison
        self._places: WeakKeyDictionary[Mesh, tuple[str, Motion | None]] = WeakKeyDictionary()

    def get(self, key: str, make: Callable[[], Thing]) -> Thing:
        """The cached result of a key, else a new one."""
        if key not in self._now:
            self._now[key] = self._old[key] if key in self._old else make()
        return self._now[key]

    def get_steps(self, key: str, make: Callable[[], Steps[Thing]]) -> Steps[Thing]:
        """The cached result of a key, else a new one, made with pauses."""
        if key not in self._now:
            self._now[key] = self._old[key] if key in self._old else (yield from make())
        return self._now[key]

    def get_solids(self, mesh: Mesh) -> Steps[tuple[str, list[Surface], Motion | None]]:
        """Key and solids of a mesh, or of an earlier congruent one, and the motion from there to
        this mesh.
        """
        key, motion = self._places.get(mesh, (None, None))
        if key not in self._old and key not in self._now:
            key, motion = self._places[mesh] = yield from self._place(mesh)

        _, solids = self._now.setdefault(key, self._old.get(key))
        return key, solids, motion

    def _place(self, mesh: Mesh) -> Steps[tuple[str, Motion | None]]:
        """Key of a mesh's solids, and the motion from there; solids are made if necessary."""
        key = mesh.fingerprint
        if key not in self._old and key not in self._now:
            for other in () if self._is_exact else self._same_size(mesh):
                motion = find_motion(self._old[other][0], mesh)
                if motion is not None:
                    return other, motion
            self._now[key] = mesh, (yield from solid_steps(mesh))

        return key, None

    def _same_size(self, mesh: Mesh) -> list[str]:
        """Keys of old meshes of this one's size, to avoid comparing all of them."""
        if self._sizes is None:
            made = {key: one[0] for key, one in self._old.items() if isinstance(one, tuple)}
            sizes = np.array([size_of(one) for one in made.values()]).reshape(-1, 2)
            self._sizes = list(made), sizes
        keys, sizes = self._sizes
        size, loss = size_of(mesh)
        is_alike = np.abs(sizes[:, 0] - size) <= sizes[:, 1] + loss
        return [keys[i] for i in np.flatnonzero(is_alike)]

    def borrow(self, other: "MeshCache") -> None:
        """Add another cache's results; the other is unchanged."""
        self._old, self._sizes = {**other._old, **other._now, **self._old}, None

    def forget(self) -> None:
        """Drop results not used since the last call."""
        self._old, self._now, self._sizes = self._now, {}, None
