"""A rig in Blender from a rig of core: an object for each part, all or none."""

from typing import Any

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.vectors import normalise
from ...glass.meshes import box_of
from ...rig.rig import ROLES, WAVELENGTH, Rig, Role, Viewer
from ..data.made_objects import Workbench
from ..data.translation_context import data_name
from ..data.units import length_of_unit
from ..properties.object_settings import ELEMENT
from ..read.elements import give_mirrors
from ..read.part_roles import Studio, in_blender
from ..read.role_display import give_views
from ..view.viewport_look import be_seen_as, be_seen_as_glass
from .listed_viewers import add
from .new_rig import new_collection
from .rig_objects import be_display, be_picture, be_plate, in_units, make_lattice, make_viewer

MILLIMETRES = {"focal_length", "pitch"}  # settings of elements with this unit


def make_rig_from(scene: bpy.types.Scene, rig: Rig) -> bpy.types.Collection:
    """Make objects of the parts of a rig, in a new collection that becomes the active rig.

    The picture shows the lattice, whatever its pixels. Viewers have square pixels.
    """
    metres = length_of_unit(scene)
    with new_collection(scene, bool(rig.plates)) as made:
        ours = made.collection.kiriko
        ours.only_through_glass = bool(rig.glasses)
        aim = (rig.pictures[0].mesh or rig.lit[0].mesh).bounds.mean(axis=0)
        for role in (role for role in ROLES if role.number is not None):
            for part in rig.of(role):
                if isinstance(part, Viewer):
                    _make_camera(made, part, aim, metres).kiriko.role = role.name
                elif part.mesh is None:  # a picture in the viewer's pixels
                    ours.picture_source, ours.picture_image = "IMAGE", make_lattice(made)
                else:
                    _make_part(made, rig, role, part, metres)
        _make_viewers(scene, made, rig, aim, metres)
    return made.collection


def _make_part(made: Workbench, rig: Rig, role: Role, part: Any, metres: float) -> None:
    """The object of a part with a mesh."""
    thing = made.drawn(f"Kiriko {part.name}", part.mesh, _frame(part), metres)
    _be_part(made, thing, role, part)
    ours = thing.kiriko
    ours.role, ours.surface = role.name, part.mesh.surface.upper()
    if thing.material_slots:
        return

    looks, _ = in_blender(role.name).looks(rig)
    look = None if looks is None else looks[part.name]

    def build(material: bpy.types.Material) -> None:
        in_blender(role.name).shade(material, look, Studio(None, True, metres, made.keep))
        be_seen_as(material, role.name)

    thing.data.materials.append(made.material(f"Kiriko {role.label}", build))


def _frame(part: Any) -> Floats:
    """The frame (4, 4) of a part's object, m: of a flat part along its first edge and its normal,
    in the middle; of a plate along its mirrors.
    """
    frame = np.eye(4)
    mesh = part.mesh
    if mesh.is_flat:
        a, b, c = mesh.corners[0]
        normal = normalise(np.cross(b - a, c - a))
        side = getattr(part, "side", None)
        along = b - a if side is None else side - (side @ normal) * normal
        x = normalise(along)
        frame[:3, :3] = np.stack([x, np.cross(normal, x), normal], axis=1)
    middle = box_of(mesh.vertices @ frame[:3, :3]).mean(axis=0)
    centre = getattr(part, "centre", None)
    frame[:3, 3] = frame[:3, :3] @ middle if centre is None else centre
    return frame


def _be_part(made: Workbench, thing: bpy.types.Object, role: Role, part: Any) -> None:
    """Give an object the settings of a part, and the material of a part that Add Rig makes, too."""
    ours = thing.kiriko
    if role.name == "PICTURE":
        be_picture(made, thing)
    elif role.name in {"DISPLAY", "SCREEN"}:
        be_display(made, thing, (part.width, part.height))
        ours.display.black_level = part.black_level
        ours.element.is_polarised = part.polarised is not None
        ours.element.angle = part.polarised or 0.0
        if part.views is not None:
            give_views(ours.views, part.views)
    elif role.name == "PLATE":
        be_plate(made, thing)
        if part.array is not None:
            give_mirrors(ours.plate, part.array)
    elif role.name == "GLASS":
        ours.priority = part.priority
        index = part.ior.at(WAVELENGTH)
        thing.data.materials.append(
            made.material("Kiriko Glass", lambda m: be_seen_as_glass(m, index))
        )
    for name in ELEMENT:
        value = getattr(part, name, None)
        # glass has an absorption for each colour, which is its Tint
        if value is not None and not isinstance(value, tuple):
            value = 1e3 * value if name in MILLIMETRES else value
            setattr(ours.element, name, value.upper() if isinstance(value, str) else value)


def _make_viewers(
    scene: bpy.types.Scene, made: Workbench, rig: Rig, aim: Floats, metres: float
) -> None:
    """The viewers' cameras, and the list of several."""
    cameras = [_make_camera(made, one, aim, metres) for one in rig.viewers]
    scene.kiriko.viewer = cameras[0]
    scene.camera = scene.camera or cameras[0]
    if len(cameras) > 1:
        add(scene, cameras[1:])
        scene.kiriko.viewer_shown = 0
        for entry, one in zip(scene.kiriko.viewers, rig.viewers, strict=True):
            entry.weight = one.weight


def _make_camera(made: Workbench, viewer: Viewer, aim: Floats, metres: float) -> bpy.types.Object:
    """A camera with the pixels of a viewer, and its window as lens and shift.

    aim : (3,) m, where its eyes converge
    """
    left, right, bottom, top = viewer.window
    size = max(right - left, top - bottom)
    distance = float(np.linalg.norm(aim - viewer.position))
    frame = np.eye(4)
    frame[:3, :3] = (viewer.axes * [[1.0], [1.0], [-1.0]]).T
    frame[:3, 3] = viewer.position
    is_flat = viewer.projection == "orthographic"
    field = size if is_flat else size * distance
    thing = make_viewer(made, in_units(frame, metres), distance, field, metres)
    lens = thing.data
    thing.name = lens.name = data_name(f"Kiriko {viewer.name}")
    if is_flat:
        lens.type, lens.ortho_scale = "ORTHO", size / metres
    lens.shift_x, lens.shift_y = (left + right) / 2 / size, (bottom + top) / 2 / size
    thing.kiriko.use_resolution, thing.kiriko.resolution = True, (viewer.width, viewer.height)
    return thing
