"""Reads a camera as a Viewer: the pixel grid of its render, in float64."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...rig.rig import Rig, Viewer
from .rigs import RIG_MARK

MOST_SHEAR = 1e-4  # axes further from perpendicular are not float32 noise
SAME_SHAPE = 1e-3  # ratio of width to height: a smaller difference is invisible
LEAST_F_STOP = 1e-3  # Blender allows 0
PROJECTIONS = {"PERSP": "perspective", "ORTHO": "orthographic"}


class Frame(NamedTuple):
    """Resolution of a viewer's image as in render settings: full size, percentage, pixel aspect."""

    width: int
    height: int
    percentage: int = 100
    aspect_x: float = 1.0
    aspect_y: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels; Blender truncates the percentage."""
        return max(self.width * self.percentage // 100, 1), max(
            self.height * self.percentage // 100, 1
        )

    def has_shape_of(self, other: "Frame") -> bool:
        """Whether two images have the same ratio of width to height."""
        own, its = (f.width * f.aspect_x / (f.height * f.aspect_y) for f in (self, other))
        return abs(own - its) < SAME_SHAPE * its


def no_camera() -> RigError:
    """The error on an entry of the viewer list without a camera."""
    return RigError("An entry in the viewer list has no camera. Choose one, or remove the entry.")


def frame_of(camera: bpy.types.Object, render: bpy.types.RenderSettings) -> Frame:
    """The camera's own resolution, in square pixels, or the scene's."""
    ours = camera.original.kiriko
    if ours.use_resolution:
        return Frame(*ours.resolution)
    return frame_of_render(render)


def frame_of_render(render: bpy.types.RenderSettings) -> Frame:
    """The resolution of a scene's render."""
    return Frame(
        width=render.resolution_x,
        height=render.resolution_y,
        percentage=render.resolution_percentage,
        aspect_x=render.pixel_aspect_x,
        aspect_y=render.pixel_aspect_y,
    )


def image_window(
    lens: bpy.types.Camera, frame: Frame, metres: float
) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the image, for `Viewer.window`.

    Source: BKE_camera_params_compute_viewplane in Blender's camera.cc, in float64. `metres` is the
    length of a Blender unit. An AUTO fit lays the sensor's *width* along the longer side of the
    image, only VERTICAL uses its height.
    """
    width, height = frame.size
    across = width * frame.aspect_x
    along = height * frame.aspect_y
    is_horizontal = lens.sensor_fit == "HORIZONTAL" or (
        lens.sensor_fit == "AUTO" and across >= along
    )

    if lens.type == "ORTHO":
        size = lens.ortho_scale * metres
    else:
        size = (
            lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width
        ) / lens.lens

    # sizes on the plane at unit distance, or on the camera's plane if orthographic
    pixel = size / (across if is_horizontal else along)
    half_x = 0.5 * across * pixel
    half_y = 0.5 * along * pixel
    x = lens.shift_x * size
    y = lens.shift_y * size

    return x - half_x, x + half_x, y - half_y, y + half_y


def orthonormal_axes(matrix: Floats, name: str) -> Floats:
    """Rows right, up, forward of a camera with this world matrix (4, 4); its scale is ignored, as
    in Blender.

    The nearest orthonormal frame (polar decomposition), which spreads float32 noise evenly.
    """
    columns = matrix[:3, :3] / np.maximum(
        np.linalg.norm(matrix[:3, :3], axis=0), np.finfo(float).tiny
    )
    if not np.abs(columns.T @ columns - np.eye(3)).max() < MOST_SHEAR:
        raise RigError(
            "The viewer '{name}' is sheared or has no size. Clear its scale and the uneven scale"
            " of its parents.",
            name=name,
        )

    left, _, right = np.linalg.svd(columns)
    return (left @ right).T * np.array([[1.0], [1.0], [-1.0]])


class Seat(NamedTuple):
    """A viewer of the scene: its camera, None if deleted, its weight, and its own image if it has
    one.
    """

    camera: bpy.types.Object | None
    weight: float = 1.0
    image: bpy.types.Image | None = None


def camera_at(scene: bpy.types.Scene, number: int) -> bpy.types.Object | None:
    """The camera of an entry of the scene's viewers.

    The first entry is the chosen viewer, else the camera of an instanced rig, as after Link, else
    the scene's camera.
    """
    ours = scene.kiriko
    own = ours.viewers[number].camera if number < len(ours.viewers) else None
    if own or number > 0:
        return own
    return ours.viewer or next((camera for camera, _ in instanced_viewers(scene)), scene.camera)


def instanced_viewers(
    scene: bpy.types.Scene,
) -> Iterator[tuple[bpy.types.Object, bpy.types.Object]]:
    """Cameras of rigs instanced in a scene, each with the instancing object."""
    for rig in bpy.data.collections:
        if not rig.kiriko.is_rig:
            continue
        cameras = [one for one in rig.all_objects if one.type == "CAMERA" and RIG_MARK in one]
        for thing in rig.users_dupli_group if cameras else ():
            if scene in thing.users_scene:
                yield from ((camera, thing) for camera in cameras)


def is_deleted(camera: bpy.types.Object) -> bool:
    """Whether a camera is in no collection any longer, and only its users keep it.

    A camera in an instanced collection is in no scene either, but not deleted.
    """
    return not camera.users_collection and camera.library is None


def seats_of(scene: bpy.types.Scene) -> list[Seat]:
    """The scene's viewers in use, in their order."""
    listed = scene.kiriko.viewers
    if not len(listed):
        camera = camera_at(scene, 0)
        return [] if camera is None else [Seat(camera)]
    return [
        Seat(camera_at(scene, n), one.weight, one.image)
        for n, one in enumerate(listed)
        if one.is_on
    ]


def own_images(scene: bpy.types.Scene) -> list[bpy.types.Image]:
    """The own images of viewers in use, in their order."""
    return [seat.image for seat in seats_of(scene) if seat.image is not None]


def number_shown(scene: bpy.types.Scene) -> int:
    """The chosen entry of the list of viewers; a script may have set it beyond the end."""
    return min(scene.kiriko.viewer_shown, max(len(scene.kiriko.viewers) - 1, 0))


def viewer_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The camera of the visible viewer: the chosen one, or the first that is on."""
    number = number_shown(scene)
    is_on = [n for n, one in enumerate(scene.kiriko.viewers) if one.is_on]
    return camera_at(scene, number if number in is_on else (is_on or [number])[0])


def shown_first(rig: Rig, scene: bpy.types.Scene) -> Rig:
    """The rig with its visible viewer first, since core reports the first one."""
    camera = viewer_of(scene)
    if camera is None or len(rig.viewers) < 2:
        return rig
    return replace(rig, viewers=tuple(sorted(rig.viewers, key=lambda v: v.name != camera.name)))


def read_viewer(
    camera: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    render: bpy.types.RenderSettings,
    metres: float,
) -> Viewer:
    """Read the viewer from an evaluated camera.

    Parameters
    ----------
    camera : the camera object; parents, constraints and animation count
    render : the scene's render settings, for a camera without its own resolution
    metres : length of a Blender unit in m

    Raises
    ------
    RigError : the object is not a camera, or a panoramic or sheared one
    """
    if camera.type != "CAMERA":  # Blender accepts any object as the scene's camera
        raise RigError(
            "The viewer '{viewer}' is not a camera. Choose a camera.", viewer=camera.name
        )

    evaluated = camera.evaluated_get(depsgraph)
    lens = evaluated.data
    if lens.type not in PROJECTIONS:
        raise RigError(
            "The viewer '{viewer}' is a panoramic or custom camera. Make it perspective or"
            " orthographic.",
            viewer=camera.name,
        )

    matrix = np.array(evaluated.matrix_world, dtype=float)
    for one, thing in instanced_viewers(depsgraph.scene.original):
        if one == camera:
            to_place = np.array(thing.evaluated_get(depsgraph).matrix_world, dtype=float)
            matrix[:3, 3] -= np.array(thing.instance_collection.instance_offset)
            matrix = to_place @ matrix
            break
    frame = frame_of(camera, render)
    width, height = frame.size
    pupil, focus = _pupil_of(camera.original.kiriko, lens, matrix, metres)

    return Viewer(
        name=camera.name,
        projection=PROJECTIONS[lens.type],
        position=matrix[:3, 3] * metres,
        axes=orthonormal_axes(matrix, camera.name),
        window=image_window(lens, frame, metres),
        width=width,
        height=height,
        pupil=pupil,
        focus=focus,
    )


def _pupil_of(
    ours: bpy.types.PropertyGroup, lens: bpy.types.Camera, matrix: Floats, metres: float
) -> tuple[float, float | None]:
    """Diameter of a camera's pupil, and the distance of its focus, m; None for the picture's.

    With depth of field the diameter is the focal length divided by the f-number, in thousandths of
    a Blender unit as in Cycles, and an object's distance counts along the view (blender_camera.cpp
    in Cycles, BKE_camera_object_dof_distance in Blender's camera.cc).
    """
    if not ours.use_dof:
        return 1e-3 * ours.pupil, None
    distance = lens.dof.focus_distance
    if lens.dof.focus_object is not None:
        place = np.array(lens.dof.focus_object.matrix_world.translation)
        distance = abs((place - matrix[:3, 3]) @ matrix[:3, 2])
    return 1e-3 * lens.lens / max(lens.dof.aperture_fstop, LEAST_F_STOP) * metres, (
        float(distance) * metres
    )
