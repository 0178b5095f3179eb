"""The parts of a rig, made one by one, so that Make Part can replace a deleted one.

Frames (4, 4) and lengths are in Blender units, unless noted.
"""

from functools import cache

import bpy

from ...base.arrays import Floats
from ...base.messages import Message
from ...bench.placement import lattice
from ...files.encoding import quantised
from ...files.png import encoded
from ..data.image import packed_image
from ..data.made_objects import Workbench
from ..materials import shaders
from ..view.viewport_look import be_seen_as_plate, be_seen_as_screen
from .eyes import EYES

PLATE_NAME = Message("Kiriko Plate")


def make_plate(made: Workbench, frame: Floats, side: float) -> bpy.types.Object:
    """A square plate."""
    return be_plate(made, made.rectangle(PLATE_NAME, frame, side, side))


def be_plate(made: Workbench, plate: bpy.types.Object) -> bpy.types.Object:
    """Turn an object into an ideal plate."""
    plate.kiriko.role = "PLATE"
    plate.data.materials.append(made.material("Kiriko Ideal Plate", be_seen_as_plate))
    return plate


def make_picture(made: Workbench, frame: Floats, side: float) -> bpy.types.Object:
    """A square picture, of the lattice."""
    return be_picture(made, made.rectangle("Kiriko Picture", frame, side, side))


def make_lattice(made: Workbench) -> bpy.types.Image:
    """The default picture's image."""
    return made.keep(packed_image("Kiriko Lattice", lattice_file()))


def be_picture(made: Workbench, picture: bpy.types.Object) -> bpy.types.Object:
    """Turn an object into a picture of the lattice."""
    picture.kiriko.role, picture.show_in_front = "PICTURE", True
    image = make_lattice(made)
    picture.data.materials.append(
        made.material("Kiriko Picture", lambda m: shaders.show_picture(m, image))
    )

    for kind in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        # a guide: in the artist's own renders the light itself is there
        setattr(picture, f"visible_{kind}", False)
    return picture


@cache
def lattice_file() -> bytes:
    """The default picture as a PNG file: the same for all rigs, so made once."""
    return encoded(quantised(lattice(), "uint8"))


def make_display(
    made: Workbench, frame: Floats, width: float, pixels: tuple[int, int]
) -> bpy.types.Object:
    """A display with square pixels, as many across and down."""
    columns, rows = pixels
    display = made.rectangle("Kiriko Display", frame, width, width * rows / columns)
    return be_display(made, display, pixels)


def be_display(
    made: Workbench, display: bpy.types.Object, pixels: tuple[int, int]
) -> bpy.types.Object:
    """Turn an object into a display."""
    display.kiriko.role, display.kiriko.resolution = "DISPLAY", pixels
    display.data.materials.append(made.material("Kiriko Display", be_seen_as_screen))
    return display


def make_viewer(
    made: Workbench, frame: Floats, distance: float, field: float, metres: float
) -> bpy.types.Object:
    """A camera that sees a field so wide at a distance, both m."""
    viewer = made.camera("Kiriko Viewer", frame, distance / metres, field / metres)
    viewer.data.stereo.interocular_distance = EYES / metres
    return viewer


def in_units(frame: Floats, metres: float) -> Floats:
    """A frame (4, 4), m, in Blender units."""
    scaled = frame.copy()
    scaled[:3, 3] /= metres
    return scaled
