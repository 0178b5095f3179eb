"""Puts what a calibration found into the scene: objects moved, settings changed. All of it, or nothing."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .blender_scene import Reading, length_of_unit
from .errors import RigError
from .misalignment import along_with, part_motions
from .rig import WAVELENGTH, Floats, Rig

SAME = 1e-6  # of the rig's size: what Blender's single precision leaves of a place


@contextmanager
def put_into_scene(scene: bpy.types.Scene, reading: Reading, read: Callable[[], Reading]) -> Iterator[None]:
    """Make the scene show the rig that a reading has with its offset; the offset goes. Undone if what is within fails.

    Parameters
    ----------
    read : reads the scene again; what it finds has to be that rig, or nothing is changed

    Raises
    ------
    RigError : something else holds a part where it is: a constraint, an animation, a parent, an instance
    """
    undo = _Undo()
    try:
        _move(scene, reading, undo)
        _change(reading, undo)
        undo.set(scene.kiriko.calibration, "offset", "")
        _compare(read().rig, reading.rig)
        yield
    except BaseException:
        undo.all()
        raise


class _Undo:
    """Values as they were, to put back in the reverse order."""

    def __init__(self) -> None:
        self._before: list[tuple[Any, str, Any]] = []

    def set(self, owner: Any, name: str, value: Any) -> None:
        before = getattr(owner, name)
        self._before.append((owner, name, before.copy() if isinstance(before, Matrix) else before))
        setattr(owner, name, value)

    def all(self) -> None:
        for owner, name, value in reversed(self._before):
            setattr(owner, name, value)


def _object(name: str) -> bpy.types.Object:
    thing = bpy.data.objects.get(name)
    if thing is None or not thing.is_editable:
        raise RigError(f"'{name}' is an instance or linked, and cannot be moved alone: keep the offset instead.")
    if thing.animation_data is not None and (thing.animation_data.action or thing.animation_data.drivers):
        raise RigError(f"'{name}' is animated, and would not stay where it is put: keep the offset instead.")
    return thing


def _move(scene: bpy.types.Scene, reading: Reading, undo: _Undo) -> None:
    """Move objects of parts that are off, and the picture; parents first, for they take their children along."""
    motions = part_motions(reading.drawn, reading.rig)
    moves = {name: (motion.rotation, motion.shift) for name, motion in motions.items()}
    for a, b in zip(reading.drawn.pictures, reading.rig.pictures, strict=True):
        if a.mesh is not b.mesh:
            moves[b.name] = along_with(reading.drawn.viewer, reading.rig.viewer)
    targets = []
    for name, (linear, shift) in moves.items():
        thing, matrix = _object(name), np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = linear, shift / length_of_unit(scene)
        depth, parent = 0, thing.parent
        while parent is not None:
            depth, parent = depth + 1, parent.parent
        targets.append((depth, name, thing, Matrix(matrix @ np.array(thing.matrix_world, float))))
    for _, _, thing, target in sorted(targets, key=lambda entry: entry[:2]):
        undo.set(thing, "matrix_basis", thing.matrix_basis)
        thing.matrix_world = target
        bpy.context.view_layer.update()


def _change(reading: Reading, undo: _Undo) -> None:
    """Set indices, what plates are made of, and the focal length, where they are not as the scene has them."""
    for a, b in zip(reading.drawn.glasses, reading.rig.glasses, strict=True):
        if a.ior(WAVELENGTH) != b.ior(WAVELENGTH):
            ours = _object(b.name).kiriko
            undo.set(ours, "use_ior", True)
            undo.set(ours, "ior", b.ior(WAVELENGTH))
    for a, b in zip(reading.drawn.plates, reading.rig.plates, strict=True):
        if a.array != b.array:
            ours = _object(b.name).kiriko.plate
            undo.set(ours, "crossing_error", b.array.crossing_error)
            undo.set(ours, "height", b.array.height / b.array.pitch)
    drawn, fitted = (np.ptp(rig.viewer.window[:2]) for rig in (reading.drawn, reading.rig))
    if drawn != fitted:
        lens = _object(reading.rig.viewer.name).data
        undo.set(lens, "lens", lens.lens * drawn / fitted)
        undo.set(lens, "ortho_scale", lens.ortho_scale * fitted / drawn)


def _compare(found: Rig, wanted: Rig) -> None:
    """Raise RigError where a part is not as it is wanted."""
    scale = max(np.abs(part.mesh.vertices).max() for part in (*wanted.glasses, *wanted.plates, *wanted.displays))
    scale = max(scale, np.abs(wanted.viewer.position).max())
    for kind in ("glasses", "plates", "displays", "pictures", "viewers"):
        for a, b in zip(getattr(found, kind), getattr(wanted, kind), strict=True):
            if not _is_same(a, b, scale):
                raise RigError(
                    f"'{b.name}' does not come to be as fitted (a constraint, a parent or shared data holds it): keep"
                    " the offset instead."
                )


def _is_same(a: Any, b: Any, scale: float) -> bool:
    if hasattr(a, "axes"):
        pairs = [(a.position, b.position, scale), (a.axes, b.axes, 1.0), (a.window, b.window, 1.0)]
    else:
        pairs = [] if a.mesh is None else [(a.mesh.vertices, b.mesh.vertices, scale)]
    if hasattr(a, "ior"):
        pairs.append((a.ior(WAVELENGTH), b.ior(WAVELENGTH), 1.0))
    if getattr(a, "array", None) is not None:
        pairs += [
            (a.array.crossing_error, b.array.crossing_error, 1.0),
            (a.array.height, b.array.height, a.array.pitch),
        ]
    return all(_close(x, y, size) for x, y, size in pairs)


def _close(a: Floats | float, b: Floats | float, size: float) -> bool:
    return bool(np.abs(np.subtract(a, b)).max() <= SAME * size)


@contextmanager
def add_offset(scene: bpy.types.Scene, amounts: dict[str, float]) -> Iterator[None]:
    """Keep what a calibration found, by the parameters' names, beside earlier ones'. Undone if what is within fails."""
    ours = scene.kiriko.calibration
    before = ours.offset
    ours.offset = json.dumps([*json.loads(before or "[]"), amounts])
    try:
        yield
    except BaseException:
        ours.offset = before
        raise
