"""Settings, viewers and result of a rig: on its collection, or on the scene if roles were set by
hand.
"""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..data.paths import RELATIVE_PATH
from .calibration_settings import KirikoCalibration
from .light import KirikoPicture
from .result_record import KirikoResult
from .viewers import KirikoViewer

PICTURE_SOURCES = (
    ("PLANE", "Plane", "The object with the role Picture"),
    (
        "IMAGE",
        "Image",
        "An image in the viewer's own pixels, such as a render from the same camera",
    ),
)
GHOSTS = (
    (
        "MEAN",
        "Mean",
        "Mean of the colours for all these places; each shows a ghost of the others",
    ),
    (
        "STRONGEST",
        "Strongest Path",
        "Colour for the place where the pixel appears largest; sharp there, wrong elsewhere",
    ),
)
DISAGREEMENTS = (
    (
        "SHARP",
        "Sharp",
        "Picture at the weighted mean of the places needed; sharp, but slightly displaced for"
        " each viewer",
    ),
    (
        "BLENDED",
        "Blended",
        "Weighted mean of the colours needed; nothing is displaced, but each viewer sees ghosts",
    ),
)
CODECS = (
    ("H264", "H.264", "Plays everywhere; needs an even width and height"),
    ("H265", "H.265", "Half the size, for newer players; needs an even width and height"),
    ("AV1", "AV1", "As small as H.265, royalty-free; needs an even width and height"),
    ("PRORES", "ProRes", "For editing: large, 10 bit"),
    ("FFV1", "FFV1", "Lossless"),
)
EXPORT_FORMATS = (
    ("PNG8", "PNG 8 bit", "Encoded for the display, 256 steps per channel"),
    ("PNG16", "PNG 16 bit", "Encoded for the display, 65536 steps per channel"),
    ("TIFF16", "TIFF 16 bit", "Encoded for the display, 65536 steps per channel"),
    ("EXR_HALF", "OpenEXR half", "Linear light, 16-bit floating point"),
    ("EXR_FLOAT", "OpenEXR float", "Linear light, 32-bit floating point"),
)


def is_camera(_settings: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """Whether an object can be the viewer: only cameras can."""
    return candidate.type == "CAMERA"


class KirikoSight(bpy.types.PropertyGroup):
    """Clip Start or Clip End (`path`) of the 3D views of a screen, before and after Add Rig."""

    screen: StringProperty(options={"HIDDEN"})
    path: StringProperty(options={"HIDDEN"})
    before: FloatProperty(options={"HIDDEN"})
    after: FloatProperty(options={"HIDDEN"})


class KirikoRig(bpy.types.PropertyGroup):
    """Settings of a rig for solving and export, its viewers and its result.

    is_rig : Add Rig made the collection
    has_plate : the rig has a plate, which is missing if it is deleted
    views : 3D views changed by Add Rig
    viewers : the first entry is the rig's viewer; empty if there is only one
    viewer_shown : number of the visible and simulated viewer
    """

    is_rig: BoolProperty(options={"HIDDEN"})
    has_plate: BoolProperty(options={"HIDDEN"})
    views: CollectionProperty(type=KirikoSight)

    # viewer: see `register`
    viewers: CollectionProperty(type=KirikoViewer)
    viewer_shown: IntProperty(min=0, options={"HIDDEN"})
    picture_source: EnumProperty(
        name="Picture",
        items=PICTURE_SOURCES,
        default="PLANE",
    )
    picture_image: PointerProperty(
        name="Picture Image",
        description="Picture in the viewer's own pixels, filling the camera frame",
        type=bpy.types.Image,
    )
    picture: PointerProperty(type=KirikoPicture)
    tolerance: FloatProperty(
        name="Tolerance",
        description="Allowed error in display pixels; smaller is slower",
        default=0.1,
        min=1e-6,
        soft_min=1e-3,
        soft_max=2.0,
        max=100.0,
        precision=3,
        step=1,
        subtype="PIXEL",
    )
    max_events: IntProperty(
        name="Max Events",
        description="Surfaces a ray may meet before it counts as lost; raise it for long paths of"
        " total reflection",
        default=32,
        min=1,
        max=10000,
        soft_max=256,
    )
    effort: IntProperty(
        name="Effort",
        description="Rays per viewer pixel where light is chaotic, a square number; 4 times as"
        " many remove up to a third of the error and take up to 4 times as long",
        default=16,
        min=1,
        max=4096,
        soft_max=256,
    )
    only_through_glass: BoolProperty(
        name="Only Through Glass",
        description="Use only rays through the glass; others would draw ghost lines",
        default=True,
    )
    only_through_plate: BoolProperty(
        name="Only Through Plate",
        description="Use only rays through a plate; has no effect in a rig without a plate",
        default=True,
    )
    suppress_glare: FloatProperty(
        name="Suppress Glare",
        description="Darken glare next to the glass; 1 is strongest",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    ghosts: EnumProperty(
        name="Ghosts",
        description="Colour of a display pixel seen in several places",
        items=GHOSTS,
        default="MEAN",
    )
    disagreement: EnumProperty(
        name="Disagreement",
        description="Display pixels for which viewers need different places of the picture",
        items=DISAGREEMENTS,
        default="SHARP",
    )
    brightness: BoolProperty(
        name="Brightness",
        description="Brighten parts of the picture dimmed by the surfaces in the light's path",
        default=False,
    )
    sharpen: BoolProperty(
        name="Sharpen",
        description="Change the source image until every viewer sees it as close to the picture as"
        " possible, through the blur of its pupil and of the display's pixels; takes several times"
        " as long",
        default=False,
    )
    margin: IntProperty(
        name="Margin",
        description="Extra pixels around the visible part of the display",
        default=0,
        min=0,
        max=1024,
        soft_max=64,
        subtype="PIXEL",
    )
    export_path: StringProperty(
        name="File",
        description="File to write; the format sets its extension",
        default="//source.png",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    export_format: EnumProperty(
        name="Format",
        description="File format; displays show 8 bit, more keeps gradients smooth",
        items=EXPORT_FORMATS,
        default="PNG8",
    )
    animation_path: StringProperty(
        name="Frames",
        description="Files of an animation's source images; each # is a digit of the frame number",
        default="//frames/source_####",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    animation_anew: BoolProperty(
        name="Solve Again",
        description="Solve frames again even if their files exist; otherwise they are skipped, so"
        " a stopped run continues",
        default=False,
    )
    animation_placeholders: BoolProperty(
        name="Placeholders",
        description="Create an empty file for each frame while it is solved, so other machines"
        " skip this frame",
        default=False,
    )
    movie_path: StringProperty(
        name="Movie",
        description="File to write; the format sets its extension",
        default="//source",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    movie_codec: EnumProperty(name="Codec", items=CODECS, default="H264")
    movie_card: FloatProperty(
        name="Test Card",
        description="Seconds of test card at the movie's start: lattice, steps of grey, the"
        " display's name and size",
        default=0.0,
        min=0.0,
        max=3600.0,
        soft_max=30.0,
        subtype="TIME_ABSOLUTE",
        unit="TIME_ABSOLUTE",
    )
    report_folder: StringProperty(
        name="Folder",
        description="Where to write",
        default="//report",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
    )
    result: PointerProperty(type=KirikoResult)
    calibration: PointerProperty(type=KirikoCalibration)


class KirikoScene(bpy.types.PropertyGroup):
    """The active rig of a scene, and the settings of a scene without a rig.

    looking : settings to restore after Look Through Viewer, JSON
    """

    rig: PointerProperty(type=bpy.types.Collection, options={"HIDDEN"})
    own: PointerProperty(type=KirikoRig)
    looking: StringProperty(options={"HIDDEN"})
