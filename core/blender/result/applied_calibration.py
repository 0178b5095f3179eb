"""Applies a calibration's result to the scene's objects and settings, all or nothing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...base.errors import RigError
from ...base.messages import Message
from ...bench.offset import along_with, part_motions, with_offset
from ...image.flat_picture import view_of_picture
from ...light.display import display_pixel
from ...rig.rig import ROLES, WAVELENGTH, Display, Rig
from ...rig.viewer import Viewer
from ..data.stored_records import Offset
from ..read.resize import is_animated
from ..read.scene import Reading, length_of_unit, object_matrix

# px of display and viewer: allowed deviation from the fitted values, in single precision
FITTED_WITHIN_PX = 0.1
FLOAT32_ERROR = 1e-6  # error of numbers of about 1 in single precision
HELD = Message("a constraint, a parent or shared data holds it")
PLACE = ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale")


@contextmanager
def put_into_scene(
    scene: bpy.types.Scene, reading: Reading, read: Callable[[], Reading]
) -> Iterator[None]:
    """Make the scene show the rig of a reading including its offset, and clear the offset. Undone
    if the enclosed code fails.

    Parameters
    ----------
    read : reads the scene again; unless it gives the same rig, nothing is changed

    Raises
    ------
    RigError : a part is gone, or held by a constraint, an animation or a parent
    """
    _, unknown = with_offset(reading.drawn, Offset.read(scene.kiriko.calibration.offset).sets)
    if unknown:
        raise RigError(
            "The calibration's offset names '{name}', which is not in this rig. Calibrate again,"
            " or remove the offset.",
            name=unknown[0],
        )

    undo = _Undo()
    try:
        _move(scene, reading, undo)
        _change(reading, undo)
        undo.set(scene.kiriko.calibration, "offset", "")
        _compare(read().rig, reading.rig)
        yield
    except BaseException:
        undo.all()
        bpy.context.view_layer.update()  # a script then sees the objects in their places
        raise


class _Undo:
    """Earlier values, to restore in reverse order."""

    def __init__(self) -> None:
        self._before: list[tuple[Any, str, Any]] = []

    def keep(self, owner: Any, *names: str) -> None:
        for name in names:
            value = getattr(owner, name)
            self._before.append((owner, name, value[:] if hasattr(value, "__len__") else value))

    def set(self, owner: Any, name: str, value: Any) -> None:
        self.keep(owner, name)
        setattr(owner, name, value)

    def all(self) -> None:
        for owner, name, value in reversed(self._before):
            setattr(owner, name, value)


def _object(name: str) -> bpy.types.Object:
    thing = bpy.data.objects.get(name)
    if thing is None:
        raise _held(name, Message("it is an instance"))

    for block in (thing, thing.data):
        if block is not None and not block.is_editable:
            raise _held(name, Message("it is linked from another file"))

        if block is not None and is_animated(block):
            raise _held(name, Message("it is animated"))

    return thing


def _move(scene: bpy.types.Scene, reading: Reading, undo: _Undo) -> None:
    """Move the objects of deviating parts, and the picture.

    Parents come first, since their children move with them.
    """
    motions = part_motions(reading.drawn, reading.rig)
    moves = {name: (motion.rotation, motion.shift) for name, motion in motions.items()}

    # the picture moves with the viewer
    for a, b in zip(reading.drawn.pictures, reading.rig.pictures, strict=True):
        if a.mesh is not b.mesh:
            moves[b.name] = along_with(reading.drawn.viewers[0], reading.rig.viewers[0])

    targets = []
    for name, (linear, shift) in moves.items():
        thing = _object(name)
        matrix = object_matrix(linear, shift, length_of_unit(scene))
        depth, parent = 0, thing.parent
        while parent is not None:
            depth, parent = depth + 1, parent.parent
        targets.append((depth, name, thing, Matrix(matrix @ np.array(thing.matrix_world, float))))

    for _, _, thing, target in sorted(targets, key=lambda entry: entry[:2]):
        undo.keep(thing, *PLACE)
        thing.matrix_world = target
        bpy.context.view_layer.update()


def _change(reading: Reading, undo: _Undo) -> None:
    """Set changed indices, plate settings and focal lengths."""
    for a, b in zip(reading.drawn.glasses, reading.rig.glasses, strict=True):
        if a.ior.at(WAVELENGTH) != b.ior.at(WAVELENGTH):
            ours = _object(b.name).kiriko
            undo.set(ours, "use_ior", True)
            undo.set(ours, "ior", b.ior.at(WAVELENGTH))

    for a, b in zip(reading.drawn.plates, reading.rig.plates, strict=True):
        if a.array != b.array:
            ours = _object(b.name).kiriko.plate
            undo.set(ours, "crossing_error", b.array.crossing_error)
            undo.set(ours, "height", b.array.height / b.array.pitch)

    for a, b in zip(reading.drawn.viewers, reading.rig.viewers, strict=True):
        drawn, fitted = (np.ptp(viewer.window[:2]) for viewer in (a, b))
        if drawn == fitted:
            continue
        lens = _object(b.name).data
        if lens.type == "ORTHO":
            undo.set(lens, "ortho_scale", lens.ortho_scale * fitted / drawn)
        else:
            undo.set(lens, "lens", lens.lens * drawn / fitted)


def _compare(found: Rig, wanted: Rig) -> None:
    """Raise RigError for a part off its wanted values by more than a tenth of a pixel."""
    pixel = display_pixel(wanted.display)

    # place and settings of parts
    for role in (role for role in ROLES if role.kind is not None):
        for a, b in zip(found.of(role), wanted.of(role), strict=True):
            if np.abs(
                a.mesh.vertices - b.mesh.vertices
            ).max() > FITTED_WITHIN_PX * pixel or not _is_made_like(a, b):
                raise _held(b.name)

    for a, b in zip(found.viewers, wanted.viewers, strict=True):
        if not _is_viewer_like(a, b, wanted.display):
            raise _held(b.name)

    # the picture's corners, as seen by the viewer
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
    for a, b in zip(found.pictures, wanted.pictures, strict=True):
        seen = view_of_picture(a.place, found.viewers[0], uv)
        off = seen - view_of_picture(b.place, wanted.viewers[0], uv)
        if np.abs(off).max() > FITTED_WITHIN_PX:
            raise _held(b.name)


def _is_viewer_like(found: Viewer, wanted: Viewer, display: Display) -> bool:
    """Whether two viewers have the same place and image, to a tenth of a pixel."""
    # size of a viewer pixel at unit distance, or on its plane
    across = np.ptp(wanted.window[:2]) / wanted.width
    reach = (
        1.0
        if wanted.projection == "perspective"
        else np.abs(display.mesh.vertices - wanted.position).max()
    )
    off = np.abs(found.position - wanted.position).max()
    turned = np.abs(found.axes - wanted.axes).max() * reach
    zoomed = np.abs(np.subtract(found.window, wanted.window)).max()
    return not (
        off > FITTED_WITHIN_PX * display_pixel(display)
        or max(turned, zoomed) > FITTED_WITHIN_PX * across
    )


def _held(name: str, why: str = HELD) -> RigError:
    return RigError(
        "'{name}' cannot be changed: {why}. Keep the offset instead.", name=name, why=why
    )


def _is_made_like(a: Any, b: Any) -> bool:
    """Whether two parts have the same index, or mirrors, to single precision."""
    if hasattr(a, "ior"):
        return abs(a.ior.at(WAVELENGTH) - b.ior.at(WAVELENGTH)) < FLOAT32_ERROR
    if getattr(a, "array", None) is not None:
        return abs(a.array.crossing_error - b.array.crossing_error) < FLOAT32_ERROR and (
            abs(a.array.height - b.array.height) < FLOAT32_ERROR * a.array.pitch
        )
    return True


@contextmanager
def keep_offset(scene: bpy.types.Scene, offset: list[dict[str, float]]) -> Iterator[None]:
    """Store the results of calibrations, amounts by parameter name. Undone if the enclosed code
    fails.
    """
    ours = scene.kiriko.calibration
    before = ours.offset
    ours.offset = Offset(offset).text()
    try:
        yield
    except BaseException:
        ours.offset = before
        raise
