"""Reads a camera into a Viewer: the same pixel grid as a render from it, in float64."""

import bpy
import numpy as np

from .errors import RigError
from .rig import Floats, Viewer

SHEARED = 1e-4  # axes further from perpendicular than this are no float32 noise
PROJECTIONS = {"PERSP": "perspective", "ORTHO": "orthographic"}


def image_size(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of a render in pixels; Blender cuts the percentage down to whole pixels."""
    share = render.resolution_percentage
    return max(render.resolution_x * share // 100, 1), max(render.resolution_y * share // 100, 1)


def image_window(
    lens: bpy.types.Camera, render: bpy.types.RenderSettings, metres: float
) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the image as `Viewer.window` wants them.

    Source: BKE_camera_params_compute_viewplane in Blender's camera.cc, in float64. `metres` is the length of a Blender
    unit. An AUTO fit lays the sensor's *width* along the longer side of the image, only VERTICAL uses its height.
    """
    width, height = image_size(render)
    across, along = width * render.pixel_aspect_x, height * render.pixel_aspect_y
    is_horizontal = lens.sensor_fit == "HORIZONTAL" or (lens.sensor_fit == "AUTO" and across >= along)
    if lens.type == "ORTHO":
        size = lens.ortho_scale * metres
    else:
        size = (lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width) / lens.lens
    pixel = size / (across if is_horizontal else along)
    half_x, half_y = 0.5 * across * pixel, 0.5 * along * pixel
    x, y = lens.shift_x * size, lens.shift_y * size
    return x - half_x, x + half_x, y - half_y, y + half_y


def orthonormal_axes(matrix: Floats, name: str) -> Floats:
    """Rows right, up, forward of a camera with this world matrix (4, 4); its scale is ignored, as Blender does.

    The nearest orthonormal frame (polar decomposition), so that float32 noise is shared out evenly.
    """
    columns = matrix[:3, :3] / np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), np.finfo(float).tiny)
    if not np.abs(columns.T @ columns - np.eye(3)).max() < SHEARED:
        raise RigError(f"The viewer '{name}' is sheared or has no size: undo the uneven scale of it or of its parents.")
    left, _, right = np.linalg.svd(columns)
    return (left @ right).T * np.array([[1.0], [1.0], [-1.0]])


def read_viewer(
    camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph, render: bpy.types.RenderSettings, metres: float
) -> Viewer:
    """Read the viewer from an evaluated camera.

    Parameters
    ----------
    camera : the camera object; parents, constraints and animation count
    metres : length of a Blender unit in m

    Raises
    ------
    RigError : it is no camera, or a panoramic or sheared one
    """
    if camera.type != "CAMERA":  # Blender takes any object as the scene's camera
        raise RigError(f"The viewer '{camera.name}' is no camera: choose one.")
    evaluated = camera.evaluated_get(depsgraph)
    lens = evaluated.data
    if lens.type not in PROJECTIONS:
        raise RigError(
            f"The viewer '{camera.name}' is a panoramic or custom camera, whose image is no flat window: "
            "make it perspective or orthographic."
        )
    matrix = np.array(evaluated.matrix_world, dtype=float)
    width, height = image_size(render)
    return Viewer(
        camera.name,
        PROJECTIONS[lens.type],
        matrix[:3, 3] * metres,
        orthonormal_axes(matrix, camera.name),
        image_window(lens, render, metres),
        width,
        height,
    )
