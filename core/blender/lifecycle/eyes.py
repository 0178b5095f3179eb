"""Makes cameras for more viewers of the active rig: two eyes, or a grid of heads. They move with
the viewer they surround.
"""

from collections.abc import Iterator
from math import isclose
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from ...base.arrays import Floats
from ...rig.viewer import Viewer
from ..data.camera_viewer import orthonormal_axes
from ..data.rigs import active_rig, all_settings, held_by, mark_made, stem
from ..data.screens import spaces
from ..data.translation_context import data_name
from ..read.scene import object_matrix
from .listed_viewers import add, take_out

EYES = 0.065  # m, between human eyes
EYE_MARK = "kiriko_eye"  # on cameras made here, which later ones may replace


class EyePlace(NamedTuple):
    """A camera to make: its name, world matrix, focal length in mm, and lens shift."""

    name: str
    matrix: Matrix
    length: float
    shift_x: float


def two_eyes(viewer: bpy.types.Object) -> Iterator[EyePlace]:
    """The eyes of a camera by its stereo settings, half of their distance to either side.

    The eyes look parallel, shift their images at the convergence distance (off-axis), or rotate
    towards it (toe-in).
    """
    lens, stereo = viewer.data, viewer.data.stereo
    half = stereo.interocular_distance / 2
    slope = half / stereo.convergence_distance
    sensor = lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width

    for name, side in ((data_name("Kiriko Left Eye"), -1), (data_name("Kiriko Right Eye"), 1)):
        shift, turn = 0.0, Matrix()
        if stereo.convergence_mode == "OFFAXIS":
            shift = -side * slope * lens.lens / sensor
        elif stereo.convergence_mode == "TOE":
            turn = Matrix.Rotation(side * np.arctan(slope), 4, "Y")
        place = _unscaled(viewer) @ Matrix.Translation((side * half, 0, 0)) @ turn
        yield EyePlace(name, place, lens.lens, lens.shift_x + shift)


def keep_eyes_apart(scene: bpy.types.Scene, before: float, after: float) -> None:
    """Keep a rig's own viewer's eyes at their distance when the scene's unit, m, changes."""
    viewer = scene.kiriko.viewer
    if viewer is not None and viewer.type == "CAMERA" and viewer.data.is_editable:
        stereo = viewer.data.stereo
        if isclose(stereo.interocular_distance * before, EYES, rel_tol=1e-5):
            stereo.interocular_distance = EYES / after


def heads(
    viewer: bpy.types.Object, own: Viewer, others: list[Viewer], metres: float
) -> Iterator[EyePlace]:
    """Cameras like a viewer's in use by other viewers.

    own : the camera's own appearance
    """
    lens = viewer.data
    for other in others:
        zoom = np.ptp(own.window[:2]) / np.ptp(other.window[:2])
        place = _looking(other.axes, other.position / metres)
        yield EyePlace(data_name("Kiriko Head"), place, lens.lens * zoom, lens.shift_x)


def make_viewers(
    scene: bpy.types.Scene, viewer: bpy.types.Object, places: list[EyePlace]
) -> list[bpy.types.Object]:
    """Make cameras like a viewer's, and list them in place of it and of earlier ones, whose weights
    and images they inherit if their names and numbers match.
    """
    earlier: dict[str, list[tuple[float, bpy.types.Image | None]]] = {}
    for one in _made(scene):
        earlier.setdefault(stem(one.camera[EYE_MARK]), []).append((one.weight, one.image))
    own = next(((one.weight, one.image) for one in scene.kiriko.viewers), (1.0, None))
    shared = scene.kiriko.picture_image
    remove_made(scene)
    made = [_like(scene, viewer, place) for place in places]
    add(scene, made)

    entries = list(scene.kiriko.viewers)
    entries[0].is_on = False
    entries[0].weight, entries[0].image = own
    # a temporary single entry made its image the common one
    scene.kiriko.picture_image = shared
    news: dict[str, list[bpy.types.PropertyGroup]] = {}
    for place, one in zip(places, entries[-len(made) :], strict=True):
        news.setdefault(place.name, []).append(one)
    for name, of_name in news.items():
        if len(earlier.get(name, [])) == len(of_name):
            for one, before in zip(of_name, earlier[name], strict=True):
                one.weight, one.image = before
    return made


def _made(scene: bpy.types.Scene) -> list[bpy.types.PropertyGroup]:
    """The entries of the list whose cameras were made here."""
    return [one for one in scene.kiriko.viewers if one.camera and EYE_MARK in one.camera]


def remove_made(scene: bpy.types.Scene) -> None:
    """Take cameras made here, and empty entries, out of the list; delete these cameras and earlier
    unlisted ones unless they are in use.
    """
    made = [one.camera for one in _made(scene)]
    take_out(scene, [*made, None])
    made = list(dict.fromkeys([*made, *_left_over(scene)]))
    users = bpy.data.user_map(subset=made)
    going = [
        thing
        for thing in made
        if all(isinstance(user, bpy.types.Scene | bpy.types.Collection) for user in users[thing])
        and not _is_used(scene, thing)
    ]
    data = [thing.data for thing in going]
    bpy.data.batch_remove(going)
    bpy.data.batch_remove([lens for lens in dict.fromkeys(data) if lens.users == 0])


def _left_over(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Cameras made here for the active rig, listed or not, without copies of them."""
    rig = active_rig(scene)
    things = scene.objects if rig is None else held_by(rig)
    return [thing for thing in things if thing.get(EYE_MARK) == thing.name]


def _is_copy(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Whether a camera is a copy of one made here, or renamed, and so the artist's own.

    A full copy of a scene adds numbers to all names.
    """
    mark = thing[EYE_MARK]
    return mark != thing.name and (mark in scene.objects or stem(mark) != stem(thing.name))


def _is_used(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Whether the artist uses a camera made here: as a copy, or as the camera of a scene, marker,
    view or other rig.
    """
    if _is_copy(scene, thing) or len(thing.users_scene) > 1:
        return True
    for ours in all_settings():
        if thing in (ours.viewer, *(entry.camera for entry in ours.viewers)):
            return True
    for other in bpy.data.scenes:
        if thing in (other.camera, *(marker.camera for marker in other.timeline_markers)):
            return True
    views = (view for screen in bpy.data.screens for view in spaces(screen.name))
    return any(view.camera == thing for view in views)


def _like(scene: bpy.types.Scene, viewer: bpy.types.Object, place: EyePlace) -> bpy.types.Object:
    """A camera like a viewer's at another place, which moves with it."""
    lens = viewer.data.copy()
    lens.animation_data_clear()
    lens.name = place.name
    lens.lens, lens.shift_x = place.length, place.shift_x
    thing = bpy.data.objects.new(place.name, lens)
    ours, its = thing.kiriko, viewer.kiriko
    ours.use_resolution, ours.resolution = its.use_resolution, its.resolution
    ours.pupil, ours.use_dof = its.pupil, its.use_dof

    thing.parent = viewer
    thing.matrix_parent_inverse = viewer.matrix_world.inverted()
    thing.matrix_basis = place.matrix
    thing[EYE_MARK] = thing.name  # missing on copies
    _take_in(scene, viewer, thing)
    return thing


def _take_in(scene: bpy.types.Scene, viewer: bpy.types.Object, thing: bpy.types.Object) -> None:
    """Link a new camera to the active rig, or else next to the viewer."""
    rig = active_rig(scene)
    if rig is None or not rig.is_editable:
        (next(iter(viewer.users_collection), None) or scene.collection).objects.link(thing)
        return
    rig.objects.link(thing)
    mark_made((thing, thing.data))


def _unscaled(viewer: bpy.types.Object) -> Matrix:
    """The transform in the world without scale and mirroring, which a camera ignores."""
    matrix = np.array(viewer.matrix_world, dtype=float)
    return _looking(orthonormal_axes(matrix, viewer.name), matrix[:3, 3])


def _looking(axes: Floats, position: Floats) -> Matrix:
    """The world matrix of a camera with rows right, up, forward, at a place in Blender units."""
    linear = (axes * [[1.0], [1.0], [-1.0]]).T
    return Matrix(object_matrix(linear, position, 1.0))
