"""The fingerprint of the present scene, computed without transforming any mesh."""

from collections.abc import Container
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.fingerprint import counted
from ...rig.rig import Mesh, Picture, Rig, Viewer
from ...rig.settings import Settings
from ...solve.solved_for import SolvedFor, solved_for
from ..read.scene import read_drawn
from ..read.shapes import Shape, ShapeCache

# a direction that gives any two places different coordinates
SLANTED = np.sqrt([2.0, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37])


class _Unplaced:
    """Replaces `ShapeCache` in a reading: meshes keep local coordinates, and their places are
    recorded.
    """

    def __init__(self, cache: ShapeCache) -> None:
        self.end, self.pixels, self.notes_on = cache.end, cache.pixels, cache.notes_on
        self._cache = cache
        self.drawn: dict[int, tuple[Mesh, Shape, Floats]] = {}

    def shape(self, instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object) -> Any:
        return _Unmoved(self._cache.shape(instance, owner), self)


class _Unmoved:
    """Replaces a Shape."""

    def __init__(self, shape: Shape, notes: _Unplaced) -> None:
        self.slots, self.texture = shape.slots, shape.texture
        self._shape, self._notes = shape, notes

    def at(self, matrix: Floats, surface: str) -> tuple[Mesh, int]:
        local = self._shape.local
        mesh = Mesh(
            vertices=local.vertices,
            triangles=local.triangles,
            corner_normals=None,
            is_smooth=None,
            uv=local.uv,
            surface=surface.lower(),
        )
        # keeps the mesh alive, so no other gets its id
        self._notes.drawn[id(mesh)] = mesh, self._shape, matrix
        return mesh, 0


def scene_now(
    depsgraph: bpy.types.Depsgraph,
    scene: bpy.types.Scene,
    settings: Settings,
    cache: ShapeCache | None = None,
    has_pixels: bool = True,
) -> SolvedFor:
    """The fingerprint for a solve of the present scene; raises as `scene.read` does.

    has_pixels : include the picture's pixels, not only its place
    """
    cache = cache or ShapeCache()
    notes = _Unplaced(cache)
    drawn = read_drawn(depsgraph, scene, notes)
    offset = scene.kiriko.calibration.offset
    rig = drawn.rig if offset else _in_any_order(drawn.rig)
    if not settings.sharpen:  # the source image does not depend on pupils
        rig = replace(rig, viewers=tuple(one.pinhole for one in rig.viewers))
    if not has_pixels:
        rig = replace(rig, pictures=tuple(one.place for one in rig.pictures))
    things = [_thing(part, notes, cache) for _, part in rig.parts()]
    return solved_for(things, (settings, offset))


def _in_any_order(rig: Rig) -> Rig:
    """The rig with its viewers, which may differ only by place, in an order independent of the
    list's.
    """
    viewers = sorted(rig.viewers, key=lambda one: float(_place_of(one).ravel() @ SLANTED))
    number = {viewer.name: n for n, viewer in enumerate(viewers)}
    pictures = [
        replace(one, own=tuple(sorted(one.own, key=lambda image: number[image.name])))
        for one in rig.pictures
    ]
    return replace(rig, viewers=tuple(viewers), pictures=tuple(pictures))


def _place_of(viewer: Viewer) -> Floats:
    return np.column_stack([viewer.axes.T, viewer.position])


def _thing(part: Any, notes: _Unplaced, cache: ShapeCache) -> tuple[object, Floats]:
    """A part's content, with fingerprints for large arrays, and its place (3, 4)."""
    if hasattr(part, "axes"):  # a viewer
        content = fields_of(part, {"name", "axes", "position"})
        return content, _place_of(part)

    images = ()
    if isinstance(part, Picture):
        images, part = tuple(map(cache.fingerprint_of, part.images)), part.place
    # a picture in the viewer's pixels, or an empty mesh
    if part.mesh is None or id(part.mesh) not in notes.drawn:
        return (part, images), np.eye(3, 4)

    mesh, shape, matrix = notes.drawn[id(part.mesh)]
    # the remaining fields of a plate repeat its place
    content = fields_of(part, {"name", "mesh", "side", "centre"})
    return (content, images, shape.fingerprint, mesh.surface), matrix[:3]


def fields_of(part: Any, without: Container[str]) -> tuple[object, ...]:
    """The fields of a part except some, with their names."""
    named = (f.name for f in counted(part) if f.name not in without)
    return (type(part).__name__, *((name, getattr(part, name)) for name in named))
