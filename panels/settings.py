"""What the user sets: roles on objects, settings and the last result on the scene."""

from math import radians

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ..core.bench.offset import TOLERANCES
from ..core.blender.plane import show
from ..core.rig import MOST_CROSSING_ERROR, PRESETS
from ..operators.export import RELATIVE_PATH

ROLES = (
    ("NONE", "None", "No part of the rig: light passes as if it were not there", "X", 0),
    ("GLASS", "Glass", "Bends the light; closed surfaces, an inner one is a cavity", "MATSPHERE", 1),
    ("PLATE", "Plate", "Flat imaging plate: sends light to the mirror image of where it came from", "MESH_GRID", 2),
    ("MIRROR", "Mirror", "Reflects light on both sides", "MOD_MIRROR", 3),
    ("DISPLAY", "Display", "Shows the source image on its front, laid out by its UV map", "RESTRICT_VIEW_OFF", 4),
    ("PICTURE", "Picture", "Textured plane that the viewer shall see undistorted", "IMAGE_DATA", 5),
    ("BLOCKER", "Blocker", "Stops light", "CANCEL", 6),
)
PLATE_MODELS = (
    ("IDEAL", "Ideal", "A law without mirrors: every ray goes to the mirror image of where it came from"),
    ("CROSSED", "Two Layers (MMAP)", "Two layers of mirrors, crossed at right angles, as in ASKA3D plates"),
    ("HOLES", "Square Holes (DCRA)", "Holes with mirrors in both directions on their walls, in one layer"),
    ("RADIAL", "Radial Holes (DCRA)", "Such holes, turned with the azimuth about the plate's origin"),
)
SURFACES = (
    (
        "AUTOMATIC",
        "Automatic",
        "Smooth where the mesh is regular enough to tell the curved surface, as drawn elsewhere, face by face",
        "NONE",
        2,
    ),
    (
        "SMOOTH",
        "Smooth",
        "The curved surface that smooth shading stands for; flat faces and sharp edges stay as drawn",
        "NONE",
        0,
    ),
    (
        "FACETS",
        "As Drawn",
        "The facets of the mesh as they are: smooth shading only interpolates their normals",
        "NONE",
        1,
    ),
)
PICTURE_SOURCES = (
    ("PLANE", "Plane", "The object with the role Picture, where it stands in the scene"),
    ("IMAGE", "Image", "An image in the viewer's own pixels, such as a render of another scene from the same camera"),
)
GHOSTS = (
    ("MEAN", "Mean", "The mean of what these places ask for: each shows a ghost of the others"),
    ("STRONGEST", "Strongest Path", "What the place asks for that sees most of it: sharp there, wrong in the others"),
)
EXPORT_FORMATS = (
    ("PNG8", "PNG 8 bit", "Encoded for an sRGB display, 256 steps a channel"),
    ("PNG16", "PNG 16 bit", "Encoded for an sRGB display, 65536 steps a channel"),
    ("TIFF16", "TIFF 16 bit", "Encoded for an sRGB display, 65536 steps a channel"),
    ("EXR_HALF", "OpenEXR half", "Linear light, 16-bit floating point"),
    ("EXR_FLOAT", "OpenEXR float", "Linear light, 32-bit floating point"),
)
LATTICES = (
    ("DOTS", "Dots", "Bright dots on black"),
    ("GRID", "Grid", "Bright lines on black; where they cross is measured"),
)
KEPT = (
    ("OFFSET", "As Offset", "Solve for the fitted rig from now on; the objects stay where they are"),
    ("SCENE", "In the Scene", "Move the objects, and set what they are made of, as fitted"),
    ("NONE", "Not at All", "Only tell what was found"),
)


def is_camera(_settings: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """Only cameras can be the viewer."""
    return candidate.type == "CAMERA"


def show_image(ours: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """What is chosen as the picture is shown by the plane, too. The plane's size is left to whoever chooses."""
    ours.is_image_shown = False
    if ours.image is not None and ours.role == "PICTURE":
        ours.is_image_shown = show(ours.id_data, ours.image)


class KirikoPlate(bpy.types.PropertyGroup):
    """What a plate is made of."""

    model: EnumProperty(
        name="Model",
        description="What the plate is made of: mirrors bring stray light, dimness and blur",
        items=PLATE_MODELS,
        default="IDEAL",
    )
    pitch: FloatProperty(
        name="Pitch",
        description="From mirror to mirror, in millimetres whatever the scene's unit",
        default=1e3 * PRESETS["ASKA3D-488"].pitch,
        min=1e-3,
        soft_min=0.1,
        soft_max=5.0,
        precision=3,
        step=1,
        unit="CAMERA",
    )
    height: FloatProperty(
        name="Height",
        description="Of the mirrors of one layer, in pitches: it sets the angle at which the plate is brightest",
        default=2.5,
        min=0.01,
        soft_max=10.0,
        max=1000.0,
        precision=2,
        step=1,
    )
    ior: FloatProperty(
        name="IOR",
        description="Index of refraction of the glass between the mirrors",
        default=1.52,
        min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=3,
        step=1,
    )
    reflectance: FloatProperty(
        name="Reflectance",
        description="Share of light that a mirror reflects",
        default=0.87,
        min=0.001,
        max=1.0,
        subtype="FACTOR",
    )
    crossing_error: FloatProperty(
        name="Crossing Error",
        description="By how much the second layer is turned further than 90 degrees; the image turns by twice as much",
        default=0.0,
        min=-MOST_CROSSING_ERROR,
        max=MOST_CROSSING_ERROR,
        precision=4,
        step=1,
        subtype="ANGLE",
    )
    fresnel: BoolProperty(
        name="Glass Reflections",
        description="The plate's two faces reflect a part of the light",
        default=True,
    )
    phase: FloatVectorProperty(
        name="Phase",
        description="By how many pitches the mirrors of each direction stand beside the object's origin",
        size=2,
        default=(0.0, 0.0),
        soft_min=0.0,
        soft_max=1.0,
    )


class KirikoObject(bpy.types.PropertyGroup):
    """What an object is in the rig."""

    role: EnumProperty(
        name="Role",
        description="What this object is in the rig",
        items=ROLES,
        default="NONE",
    )
    use_ior: BoolProperty(
        name="Override IOR",
        description="Bend light by the index below instead of the one in the material",
        default=False,
    )
    ior: FloatProperty(
        name="IOR",
        description="Index of refraction: the higher, the more the glass bends the picture (acrylic 1.49, N-BK7 1.517)",
        default=1.49,
        min=0.1,
        soft_min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=4,
        step=1,
    )
    priority: IntProperty(
        name="Priority",
        description="Where two glass objects overlap, the higher number is the glass that is there; among equals the "
        "smaller object",
        default=0,
        min=-1000,
        max=1000,
        soft_min=-10,
        soft_max=10,
    )
    plate: PointerProperty(name="Plate", description="What the plate is made of", type=KirikoPlate)
    surface: EnumProperty(
        name="Surface",
        description="What smooth-shaded faces stand for; facets bend the picture where a curved surface was meant",
        items=SURFACES,
        default="AUTOMATIC",
    )
    use_resolution: BoolProperty(
        name="Own Resolution",
        description="The viewer has these pixels, which are square, and not those of the scene's render, whose shape"
        " the camera's frame in the viewport keeps",
        default=False,
    )
    resolution: IntVectorProperty(
        name="Resolution",
        description="Width and height in pixels: of the display, and so of the source image, or of the viewer's image",
        size=2,
        default=(1024, 1024),
        min=1,
        max=32768,
    )
    # image: see `register`
    is_image_shown: BoolProperty(
        name="Image Is Shown",
        description="The plane's own material shows the image that was chosen, and tells the picture from then on",
        options={"HIDDEN"},
    )


class KirikoResult(bpy.types.PropertyGroup):
    """What the last solve found; written by the operator, shown by the panel."""

    source: PointerProperty(
        name="Source Image",
        description="What the display has to show so that the viewer sees the picture undistorted",
        type=bpy.types.Image,
    )
    is_coarse: BoolProperty(
        name="Coarse", description="The source image is a first, coarse one, whose final one is still to come"
    )
    solved_for: StringProperty(
        name="Solved For", description="What tells the scene that was solved from others, as JSON; empty: not known"
    )
    summary: StringProperty(name="Summary", description="The last result in one sentence")
    seen: PointerProperty(
        name="Seen Image", description="What the viewer sees, as last simulated", type=bpy.types.Image
    )
    seen_summary: StringProperty(
        name="Seen", description="What the last simulation of this result found, in one sentence"
    )
    preview: PointerProperty(
        name="Preview", description="What the viewer sees, as last rendered by Cycles", type=bpy.types.Image
    )
    coverage: FloatProperty(
        name="Coverage",
        description="Share of the picture that the viewer gets to see from the display",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    details: StringProperty(name="Details", description="Numbers of the last result as JSON")
    ladder: StringProperty(
        name="Ladder", description="Tolerances and the seconds they took, as the last report measured, as JSON"
    )
    notes: StringProperty(name="Notes", description="What was read from the scene but not followed, one remark a line")


class KirikoCalibration(bpy.types.PropertyGroup):
    """What is measured of a real bench, what may be off, and what was found."""

    columns: IntProperty(name="Columns", description="Points of the lattice across", default=7, min=2, max=99)
    rows: IntProperty(name="Rows", description="Points of the lattice down", default=7, min=2, max=99)
    margin: FloatProperty(
        name="Margin",
        description="From the picture's borders to the first and last points, as a share of its width and height",
        default=1 / 14,  # as in the picture of Add Rig
        min=0.0,
        max=0.45,
        subtype="FACTOR",
    )
    style: EnumProperty(name="Style", description="What the lattice's picture shows", items=LATTICES, default="DOTS")
    filepath: StringProperty(
        name="Measured",
        description="Photograph of the lattice as seen, or CSV of its points: column, row, x, y, or only x, y",
        default="",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    size: IntVectorProperty(
        name="Pixels",
        description="Width and height of the photograph that a CSV's positions are of; 0: the viewer's own pixels",
        size=2,
        default=(0, 0),
        min=0,
        max=1 << 16,
    )
    noise: FloatProperty(
        name="Noise",
        description="By how many pixels of the photograph a measured position is likely to be off",
        default=0.3,
        min=1e-3,
        soft_max=5.0,
        max=1000.0,
        precision=2,
        subtype="PIXEL",
    )
    shift: FloatProperty(
        name="Shift",
        description="By how many millimetres a part is likely to stand elsewhere; 0: none does",
        default=TOLERANCES["shift"],
        min=0.0,
        soft_max=10.0,
        max=1e4,
        precision=3,
        step=10,
        unit="CAMERA",
    )
    turn: FloatProperty(
        name="Turn",
        description="By how much a part is likely to be turned; 0: none is",
        default=radians(TOLERANCES["turn"]),
        min=0.0,
        max=radians(30.0),
        precision=3,
        step=10,
        subtype="ANGLE",
    )
    index: FloatProperty(
        name="Index",
        description="By how much a glass's index of refraction is likely to be another; 0: it is known",
        default=TOLERANCES["index"],
        min=0.0,
        max=0.5,
        precision=4,
        step=0.1,
    )
    focal: FloatProperty(
        name="Focal Length",
        description="By how many per cent the camera's focal length is likely to be another; 0: it is known",
        default=TOLERANCES["focal"],
        min=0.0,
        max=20.0,
        precision=2,
        step=10,
        subtype="PERCENTAGE",
    )
    crossing: FloatProperty(
        name="Crossing",
        description="By how much a plate's layers are likely to be crossed wrong; 0: they are not",
        default=radians(TOLERANCES["crossing"]),
        min=0.0,
        max=radians(5.0),
        precision=3,
        step=1,
        subtype="ANGLE",
    )
    mirror: FloatProperty(
        name="Mirror Height",
        description="By how many millimetres a plate's mirrors are likely to be higher or lower; 0: they are not",
        default=TOLERANCES["mirror"],
        min=0.0,
        max=10.0,
        precision=3,
        step=1,
        unit="CAMERA",
    )
    keep: EnumProperty(name="Keep", description="What becomes of the fitted rig", items=KEPT, default="OFFSET")
    found: StringProperty(name="Found", description="What the last calibration found, as JSON")
    offset: StringProperty(
        name="Offset", description="Amounts by which the rig is off, by name, one set for each calibration, as JSON"
    )


class KirikoScene(bpy.types.PropertyGroup):
    """How the scene's rig is solved and exported."""

    # viewer: see `register`
    picture_source: EnumProperty(
        name="Picture",
        description="Where the picture comes from that the viewer shall see",
        items=PICTURE_SOURCES,
        default="PLANE",
    )
    picture_image: PointerProperty(
        name="Picture Image",
        description="Picture in the viewer's own pixels: what the viewer shall see, over the whole camera frame",
        type=bpy.types.Image,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="By how many display pixels the result may be off: smaller takes longer",
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
        description="Surfaces a ray may meet before it counts as lost: more follow longer paths of total reflection",
        default=32,
        min=1,
        max=10000,
        soft_max=256,
    )
    effort: IntProperty(
        name="Effort",
        description="Most rays for a viewer pixel where light is chaotic, a square number: four times as many halve the"
        " noise there, and take up to four times as long",
        default=16,
        min=1,
        max=4096,
        soft_max=256,
    )
    only_through_glass: BoolProperty(
        name="Only Through Glass",
        description="Only rays that went through glass carry the picture: those beside it would draw ghost lines",
        default=True,
    )
    suppress_glare: FloatProperty(
        name="Suppress Glare",
        description="How much it counts that light beside the glass shall be dark: at 1 as much as the picture does."
        " Pixels of the display that are seen both ways get darker",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    ghosts: EnumProperty(
        name="Ghosts",
        description="What a pixel of the display shows where the viewer sees it in several places",
        items=GHOSTS,
        default="MEAN",
    )
    brightness: BoolProperty(
        name="Brightness",
        description="Weigh light by what each surface lets through, so that dim parts of the picture are made brighter",
        default=False,
    )
    margin: IntProperty(
        name="Margin",
        description="Pixels by which the source image is grown past the part of the display that the viewer can see",
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
        description="File format of the source image: 8 bit is what displays show, more keeps smooth gradients",
        items=EXPORT_FORMATS,
        default="PNG8",
    )
    export_overwrite: BoolProperty(
        name="Overwrite",
        description="Replace a file that is already there",
        default=False,
    )
    report_folder: StringProperty(
        name="Folder",
        description="Where the report on accuracy and time is written",
        default="//report",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
    )
    result: PointerProperty(name="Result", description="What the last solve found", type=KirikoResult)
    calibration: PointerProperty(
        name="Calibration", description="What is measured of a real bench", type=KirikoCalibration
    )


classes = (KirikoPlate, KirikoObject, KirikoResult, KirikoCalibration, KirikoScene)


def register() -> None:
    """Give objects and scenes their Kiriko settings."""
    for cls in classes:
        bpy.utils.register_class(cls)
    # An annotation with a Python callback crashes the 4.2 module at exit, even when the class has been unregistered;
    # a property that is added and taken away by hand does not.
    KirikoObject.image = PointerProperty(
        name="Image",
        description="The picture, which the plane's material shows, too",
        type=bpy.types.Image,
        update=show_image,
    )
    KirikoScene.viewer = PointerProperty(
        name="Viewer",
        description="Camera from which the picture shall look undistorted; the scene's camera when empty",
        type=bpy.types.Object,
        poll=is_camera,
    )
    bpy.types.Object.kiriko = PointerProperty(
        name="Kiriko", description="What this object is in the rig", type=KirikoObject
    )
    bpy.types.Scene.kiriko = PointerProperty(
        name="Kiriko", description="How the scene's rig is solved and exported", type=KirikoScene
    )


def unregister() -> None:
    """Take the settings away again."""
    del bpy.types.Scene.kiriko
    del bpy.types.Object.kiriko
    del KirikoScene.viewer
    del KirikoObject.image
    for cls in reversed(classes):
        bpy.utils.unregister_class(cls)
