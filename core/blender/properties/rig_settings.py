"""How a rig is solved and exported, its viewers and its result: on its collection, or on the scene
for a rig whose parts got their roles by hand.
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
    ("PLANE", "Plane", "The object with the role Picture, where it stands in the scene"),
    (
        "IMAGE",
        "Image",
        "An image in the viewer's own pixels, such as a render of another scene"
        " from the same camera",
    ),
)
GHOSTS = (
    (
        "MEAN",
        "Mean",
        "The mean of the colours that these places ask for: each shows a ghost of the others",
    ),
    (
        "STRONGEST",
        "Strongest Path",
        "The colour for the place that sees most of the pixel: sharp there, wrong in the others",
    ),
)
DISAGREEMENTS = (
    (
        "SHARP",
        "Sharp",
        "The picture at the weighted mean of the places that the viewers ask for: each sees it"
        " sharp and a little displaced",
    ),
    (
        "BLENDED",
        "Blended",
        "The weighted mean of the colours that the viewers ask for: nothing is displaced, and each"
        " sees ghosts of the others' picture",
    ),
)
CODECS = (
    ("H264", "H.264", "Plays everywhere; even sides"),
    ("H265", "H.265", "Half the size, for newer players; even sides"),
    ("AV1", "AV1", "As small, free of licences; even sides"),
    ("PRORES", "ProRes", "For editing: large, 10 bit"),
    ("FFV1", "FFV1", "Lossless: the source image's very numbers"),
)
EXPORT_FORMATS = (
    ("PNG8", "PNG 8 bit", "Encoded for an sRGB display, 256 steps a channel"),
    ("PNG16", "PNG 16 bit", "Encoded for an sRGB display, 65536 steps a channel"),
    ("TIFF16", "TIFF 16 bit", "Encoded for an sRGB display, 65536 steps a channel"),
    ("EXR_HALF", "OpenEXR half", "Linear light, 16-bit floating point"),
    ("EXR_FLOAT", "OpenEXR float", "Linear light, 32-bit floating point"),
)


def is_camera(_settings: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """Only cameras can be the viewer."""
    return candidate.type == "CAMERA"


class KirikoSight(bpy.types.PropertyGroup):
    """How near or far a 3D view saw before Add Rig, and sees since."""

    screen: StringProperty(name="Screen", description="Whose 3D views see so", options={"HIDDEN"})
    path: StringProperty(name="Path", description="Clip Start or Clip End", options={"HIDDEN"})
    before: FloatProperty(name="Before", description="Without the rig", options={"HIDDEN"})
    after: FloatProperty(name="After", description="With the rig", options={"HIDDEN"})


class KirikoRig(bpy.types.PropertyGroup):
    """How a rig is solved and exported, its viewers and its result."""

    is_rig: BoolProperty(
        name="Is Rig",
        description="Add Rig made the collection",
        options={"HIDDEN"},
    )
    has_plate: BoolProperty(
        name="Has Plate",
        description="The rig has a plate, which is missed if it is deleted",
        options={"HIDDEN"},
    )
    views: CollectionProperty(
        name="Views", description="3D views that Add Rig changed", type=KirikoSight
    )

    # viewer: see `register`
    viewers: CollectionProperty(
        name="Viewers",
        description="All that look at the display; the first entry is the rig's viewer. Empty:"
        " there is no other",
        type=KirikoViewer,
    )
    viewer_shown: IntProperty(
        name="Viewer Shown",
        description="Entry of the list of viewers whose view is shown, simulated and told of",
        min=0,
        options={"HIDDEN"},
    )
    picture_source: EnumProperty(
        name="Picture",
        description="Source of the picture that the viewer shall see",
        items=PICTURE_SOURCES,
        default="PLANE",
    )
    picture_image: PointerProperty(
        name="Picture Image",
        description="Picture in the viewer's own pixels, over the whole camera frame",
        type=bpy.types.Image,
    )
    picture: PointerProperty(
        name="Picture",
        description="How light the picture image is wanted",
        type=KirikoPicture,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Error of the result that is allowed, in display pixels: a smaller one"
        " takes longer",
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
        description="Surfaces a ray may meet before it counts as lost: more follow longer paths of"
        " total reflection",
        default=32,
        min=1,
        max=10000,
        soft_max=256,
    )
    effort: IntProperty(
        name="Effort",
        description="Rays for a viewer pixel of chaotic light, a square number; up to 3.25 times as"
        " many where the display is faint, at most 24 times unless the display is finer. Less is"
        " rougher; 4 times as many take up to a third off the error, in up to 4 times the time",
        default=16,
        min=1,
        max=4096,
        soft_max=256,
    )
    only_through_glass: BoolProperty(
        name="Only Through Glass",
        description="Only rays that went through glass carry the picture: those beside it would"
        " draw ghost lines",
        default=True,
    )
    only_through_plate: BoolProperty(
        name="Only Through Plate",
        description="Only rays that met a plate carry the picture. In a rig that has no plate"
        " light goes straight to the display, whatever is set here",
        default=True,
    )
    suppress_glare: FloatProperty(
        name="Suppress Glare",
        description="Weight of darkness beside the glass: at 1 it counts as much as the"
        " picture. Pixels of the display that are seen both ways get darker",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    ghosts: EnumProperty(
        name="Ghosts",
        description="The colour of a display pixel that the viewer sees in several places",
        items=GHOSTS,
        default="MEAN",
    )
    disagreement: EnumProperty(
        name="Disagreement",
        description="What a display pixel shows for which viewers ask for different places of the"
        " picture",
        items=DISAGREEMENTS,
        default="SHARP",
    )
    brightness: BoolProperty(
        name="Brightness",
        description="Weigh light by the part that surfaces let through, so that dim parts of the"
        " picture are brighter",
        default=False,
    )
    margin: IntProperty(
        name="Margin",
        description="Pixels by which the source image is grown past the part of the display that"
        " the viewer can see",
        default=0,
        min=0,
        max=1024,
        soft_max=64,
        subtype="PIXEL",
    )
    export_path: StringProperty(
        name="File",
        description="Where the source image is written; the ending is set by the format",
        default="//source.png",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    export_format: EnumProperty(
        name="Format",
        description="File format of the source image: displays show 8 bit, more keeps gradients"
        " smooth",
        items=EXPORT_FORMATS,
        default="PNG8",
    )
    export_overwrite: BoolProperty(
        name="Overwrite",
        description="Replace files that are there already, whatever is exported: of maps also those"
        " that are not written again. Frames of an animation are left, but for Solve Anew",
        default=False,
    )
    animation_path: StringProperty(
        name="Frames",
        description="Where the source images of an animation's frames are written: # are digits of"
        " the frame's number",
        default="//frames/source_####",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    animation_anew: BoolProperty(
        name="Solve Anew",
        description="Solve frames anew whose files are there; else they stay, and a run that was"
        " stopped goes on where it was",
        default=False,
    )
    animation_placeholders: BoolProperty(
        name="Placeholders",
        description="Make an empty file for each frame while it is solved, so that other machines"
        " leave it out",
        default=False,
    )
    movie_path: StringProperty(
        name="Movie",
        description="Where the movie is written; the ending is set by the codec",
        default="//source",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    movie_codec: EnumProperty(
        name="Codec", description="Encoder of the movie", items=CODECS, default="H264"
    )
    movie_card: FloatProperty(
        name="Test Card",
        description="Seconds for which the movie begins with a test card: a lattice, steps of grey,"
        " the display's name and size",
        default=0.0,
        min=0.0,
        max=3600.0,
        soft_max=30.0,
        subtype="TIME_ABSOLUTE",
        unit="TIME_ABSOLUTE",
    )
    report_folder: StringProperty(
        name="Folder",
        description="Where the report on accuracy and time is written",
        default="//report",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
    )
    result: PointerProperty(name="Result", description="The last solve's result", type=KirikoResult)
    calibration: PointerProperty(
        name="Calibration", description="Measurements of a real bench", type=KirikoCalibration
    )


class KirikoScene(bpy.types.PropertyGroup):
    """Which rig of a scene is active, and the settings of a scene without Add Rig."""

    rig: PointerProperty(
        name="Active Rig",
        description="The rig that panels and buttons are about",
        type=bpy.types.Collection,
        options={"HIDDEN"},
    )
    own: PointerProperty(
        name="Own",
        description="Settings and result while Add Rig has made no rig in the scene",
        type=KirikoRig,
    )
    looking: StringProperty(
        name="Looking",
        description="Settings that Look Through Viewer changed and will put back, as JSON",
        options={"HIDDEN"},
    )
