"""Scenes with and without the parts that they do not need: the rules
of the plan, for their test and for the bench.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kiriko.core.light import ray_engine
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.light.plan import Plan
from kiriko.core.rig.rig import Glass, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.channel import out_of_sight

from .reference_rigs import box, cube_rig, mean_normals, rig, uv_ellipsoid


@dataclass(frozen=True)
class Rule:
    """A rig, its plan by the rule, and the same plan as if there were no such rule."""

    rig: Callable[[], Rig]
    obeyed: Callable[[Rig], Plan]
    broken: Callable[[Rig], Plan]


def ellipsoid_rig(pixels: int = 256) -> Rig:
    return rig(mean_normals(uv_ellipsoid((0.025, 0.02, 0.015), 128, 64)), pixels=pixels)


def turned(a_rig: Rig) -> Rig:
    """The rig with its glass turned and moved a little."""
    a = 0.3
    rotation = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    glass = a_rig.glasses[0]
    mesh = replace(
        glass.mesh,
        vertices=glass.mesh.vertices @ rotation.T + np.array([1e-3, 2e-3, -1e-3]),
        corner_normals=glass.mesh.corner_normals @ rotation.T,
    )
    return replace(a_rig, glasses=(replace(glass, mesh=mesh),))


def plan(a_rig: Rig) -> Plan:
    return compile_plan(a_rig, Settings())


def traced_beyond(a_rig: Rig) -> Plan:
    """A plan that traces light that leaves the plate, whatever is there."""
    made = plan(a_rig)
    nowhere = np.zeros_like(made.parts.is_clear)
    return replace(made, parts=replace(made.parts, is_clear=nowhere))


def with_engine(a_rig: Rig) -> Plan:
    """A plan whose every layer has a ray engine."""
    few = ray_engine.FEW_TRIANGLES
    ray_engine.FEW_TRIANGLES = 0
    try:
        made = compile_plan(a_rig, Settings())
        assert all(held.layer.has_engine for held in made.layers)
        always = tuple(replace(held, layer=Always(held.layer)) for held in made.layers)
        return replace(made, layers=always)
    finally:
        ray_engine.FEW_TRIANGLES = few


class Always:
    """A layer that asks its ray engine, few triangles or not."""

    def __init__(self, layer: ray_engine.Layer) -> None:
        self._layer = layer

    def __getattr__(self, name: str) -> object:
        return getattr(self._layer, name)

    @property
    def has_engine(self) -> bool:
        return True


class After:
    """Plans of a rig when that of another was made before."""

    def __init__(self, first: Callable[[], Rig]) -> None:
        self._first = first
        self._kept: MeshCache | None = None

    def __call__(self, a_rig: Rig) -> Plan:
        if self._kept is None:
            self._kept = MeshCache()
            compile_plan(self._first(), Settings(), self._kept)
        return compile_plan(a_rig, Settings(), self._kept)


def moved_viewer(a_rig: Rig) -> Rig:
    viewer = a_rig.viewer
    return replace(
        a_rig, viewers=(replace(viewer, position=viewer.position + np.array([0.01, 0, 0.02])),)
    )


def with_another_aside() -> Rig:
    """The rig with a second ellipsoid, far to the side."""
    a_rig = ellipsoid_rig()
    glass = a_rig.glasses[0]
    mesh = replace(glass.mesh, vertices=glass.mesh.vertices + np.array([0.5, 0, 0]))
    return replace(a_rig, glasses=(glass, replace(glass, name="aside", mesh=mesh)))


def without_the_other(a_rig: Rig) -> Plan:
    return compile_plan(a_rig, Settings(), deferred=out_of_sight(a_rig, a_rig.viewer))


def two_boxes() -> Rig:
    boxes = (
        Glass(name, box([0.02, 0.02, 0.05], (x, 0, 0))) for name, x in (("a", -0.012), ("b", 0.012))
    )
    return rig(tuple(boxes), pixels=256)


RULES = {
    "few flat faces build no ray engine": Rule(lambda: cube_rig(pixels=256), plan, with_engine),
    "disjoint solids share a layer and a bit": Rule(
        two_boxes, plan, lambda a_rig: compile_plan(touching(a_rig), Settings())
    ),
    "nothing is traced beyond the plate but a flat display": Rule(
        ellipsoid_rig, plan, traced_beyond
    ),
    "without brightness there is no Fresnel": Rule(
        ellipsoid_rig, plan, lambda a_rig: compile_plan(a_rig, Settings(brightness=True))
    ),
    "glass that no light comes near is not made ready": Rule(
        with_another_aside, without_the_other, plan
    ),
    "flat glass has no curved faces": Rule(
        lambda: cube_rig(pixels=256),
        plan,
        lambda a_rig: compile_plan(marked_smooth(a_rig), Settings()),
    ),
    "a moved viewer builds nothing": Rule(
        lambda: moved_viewer(ellipsoid_rig()), After(ellipsoid_rig), plan
    ),
    "a mesh that moved is only moved": Rule(
        lambda: turned(ellipsoid_rig()), After(ellipsoid_rig), plan
    ),
}


def touching(a_rig: Rig) -> Rig:
    """The rig with a third box, out of all rays' way, that
    overlaps the first: a cluster with masks of two bits.
    """
    far = Glass("c", box([0.001, 0.001, 0.04], (-0.012, 0, 0.04)), a_rig.glasses[0].ior)
    return replace(a_rig, glasses=(*a_rig.glasses, far))


def marked_smooth(a_rig: Rig) -> Rig:
    """The rig with its flat faces shaded smooth, their normals their own: smooth in name only."""
    glass = a_rig.glasses[0]
    corners = glass.mesh.corners
    own = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    mesh = replace(
        glass.mesh,
        corner_normals=np.repeat(own[:, None], 3, axis=1),
        is_smooth=np.ones(len(corners), bool),
    )
    return replace(a_rig, glasses=(replace(glass, mesh=mesh),))
