"""Comparisons of before and after, by scene, and their place in the camera view.

They are stored outside Blender's data, since neither file nor undo needs them, together with what
each view showed before.
"""

from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Matrix, Vector

from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.data.units import length_of_unit
from ..core.blender.view import looking_through, turned_views
from ..core.rig.rig import Rig, Viewer
from ..core.rig.settings import Settings
from ..core.solve.comparison import Comparer, Comparison
from ..core.solve.solution import Solution
from . import framing, map_drawing, work
from .windows import camera_of, view_of


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison, and the camera of its view.

    corners : upper left, upper right, lower right and lower left of the viewer's image, in the
        camera's space
    """

    comparison: Comparison
    camera: int
    corners: tuple[Vector, ...]


_comparer: list[Comparer] = []
_found: dict[int, Compared] = {}  # by session uid of the scene


def is_shown(scene: bpy.types.Scene) -> bool:
    """Whether a scene's comparison is shown in the camera view."""
    return bpy.context.window_manager.kiriko.show_comparison and scene.session_uid in _found


def found(scene: bpy.types.Scene) -> Compared | None:
    """The last comparison of a scene."""
    return _found.get(scene.session_uid)


def comparing(
    scene: bpy.types.Scene,
    rig: Rig,
    solution: Solution,
    settings: Settings,
    is_for_file: bool = False,
) -> Generator[float, None, Compared]:
    """Compare a solution, and store it for the scene; yields progress 0..1.

    is_for_file : files are always painted
    """
    if not _comparer:
        _comparer.append(Comparer())
    # Blender's data may be gone after a pause.
    of_scene = scene.session_uid
    camera = viewer_of(scene)
    of_camera, corners = camera.session_uid, _corners(rig.viewer, camera, scene)
    is_drawn = not is_for_file and map_drawing.has_shaders() and map_drawing.is_faithful(solution)
    artist = map_drawing if is_drawn else None
    comparison = yield from _comparer[0].compare(solution, rig, settings, artist)
    _found[of_scene] = made = Compared(comparison, of_camera, corners)
    return made


def _corners(
    viewer: Viewer, camera: bpy.types.Object, scene: bpy.types.Scene
) -> tuple[Vector, ...]:
    """Corners of the viewer's image in its camera's space."""
    width, height = viewer.width, viewer.height
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    origins, directions = viewer.rays(pixels)
    unit = length_of_unit(scene)
    points = (origins + unit * directions) / unit
    to_camera: Matrix = camera.matrix_world.inverted()
    return tuple(to_camera @ Vector(point) for point in points)


def frame_in_region(context: bpy.types.Context, scene: bpy.types.Scene) -> np.ndarray | None:
    """Corners (4, 2), region px, of the viewer's image in a 3D view; None in any other view.

    The order is upper left, upper right, lower right, lower left.
    """
    made = _found.get(scene.session_uid)
    space, view = context.space_data, context.region_data
    if made is None or view is None or view.view_perspective != "CAMERA":
        return None

    camera = camera_of(space, scene)
    if camera is None or camera.session_uid != made.camera:
        return None
    world = camera.matrix_world
    places = [
        location_3d_to_region_2d(context.region, view, world @ corner) for corner in made.corners
    ]
    return None if None in places else np.array(places)


def enter_view(context: bpy.types.Context) -> None:
    """Turn the active 3D view to the viewer's camera and fit its image, unless a view shows it
    already.
    """
    area = view_of(context)
    camera = viewer_of(context.scene)
    if area is None or camera is None:
        return

    if area.spaces.active in _looking():
        return

    turned_views.turn(area, context.scene, camera, framing.window_of(area))


def leave() -> None:
    """Hide the comparison; views that were turned to the camera are restored."""
    bpy.context.window_manager.kiriko.show_comparison = False
    put_views_back()


def put_views_back() -> None:
    """Restore views after a comparison ends.

    A view that looks through the viewer by now keeps the camera until that ends too.
    """
    if bpy.context.window_manager.kiriko.show_comparison:
        return
    turned_views.put_back(_looking().__contains__)


def _looking() -> list[bpy.types.SpaceView3D]:
    """Views that look through a viewer."""
    scenes = [scene for scene in bpy.data.scenes if scene.kiriko_scene.looking]
    return [space for scene in scenes for space, _ in looking_through.views(scene)]


def forget() -> None:
    """Drop all comparisons."""
    _found.clear()
    _comparer.clear()


@persistent
def on_load(*_: object) -> None:
    """Handle another file: its scenes are not compared.

    A file saved by force, such as by auto-save, may have turned views.
    """
    forget()
    leave()


HANDLERS = (("load_post", on_load),)


def register() -> None:
    """Start listening for file loads."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Restore views and stop listening."""
    leave()
    work.stop_listening(HANDLERS)
    forget()
