"""Tone settings of pictures, and settings of the light of displays."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty

ENCODINGS = (
    ("SRGB", "sRGB", "The curve of most displays and image files"),
    ("POWER", "Power", "A power curve, for displays calibrated to a fixed gamma"),
    ("P3", "Display P3", "The curve of sRGB with wider primaries, for most phones and tablets"),
    ("PQ", "PQ", "High dynamic range in absolute luminance (SMPTE ST 2084), from White"),
    ("HLG", "HLG", "High dynamic range relative to the display's white (ITU-R BT.2100)"),
)
PRIMARIES = (
    ("SRGB", "sRGB", "Red 611, green 549 and blue 464 nm, as most displays"),
    ("P3", "Display P3", "Red 615, green 544 and blue 464 nm, as displays of a wide gamut"),
    ("CUSTOM", "Custom", "Wavelengths of your own"),
)


class KirikoPicture(bpy.types.PropertyGroup):
    """Tone of a picture."""

    brightness: FloatProperty(
        name="Picture Brightness",
        description="Factor for the picture's light; lower it if the source image exceeds the"
        " display's white",
        default=1.0,
        min=0.0,
        max=10.0,
        soft_max=2.0,
        precision=3,
        step=1,
    )
    gamma: FloatProperty(
        name="Picture Gamma",
        description="Values above 1 lighten the mid-tones, values below 1 darken them",
        default=1.0,
        min=0.1,
        soft_min=0.3,
        soft_max=3.0,
        max=10.0,
        precision=3,
        step=1,
    )
    black_level: FloatProperty(
        name="Picture Black Level",
        description="Light mapped to black; the rest is spread up to white",
        default=0.0,
        min=0.0,
        soft_max=0.5,
        max=0.99,
        precision=4,
        step=1,
        subtype="FACTOR",
    )


class KirikoDisplay(bpy.types.PropertyGroup):
    """Light of a display."""

    encoding: EnumProperty(
        name="Encoding",
        description="Curve from values in the exported file to light; OpenEXR is always linear",
        items=ENCODINGS,
        default="SRGB",
    )
    gamma: FloatProperty(
        name="Gamma",
        description="Exponent from values in the file to light",
        default=2.2,
        min=1.0,
        max=4.0,
        soft_min=1.8,
        soft_max=2.6,
        precision=2,
        step=1,
    )
    primaries: EnumProperty(
        name="Primaries",
        description="Dominant wavelengths of red, green and blue, for glass with dispersion",
        items=PRIMARIES,
        default="SRGB",
    )
    wavelengths: FloatVectorProperty(
        name="Wavelengths (nm)",
        description="Dominant wavelengths of red, green and blue",
        default=(611.0, 549.0, 464.0),
        min=360.0,
        max=830.0,
        precision=1,
        step=100,
    )
    black_level: FloatProperty(
        name="Black Level",
        description="Light of a black pixel relative to white: 0.001 for a contrast of 1000 to 1",
        default=0.0,
        min=0.0,
        soft_max=0.1,
        max=0.9,
        precision=4,
        step=1,
        subtype="FACTOR",
    )
    white: FloatProperty(
        name="White (cd/m\N{SUPERSCRIPT TWO})",
        description="Luminance of a white pixel, from which the picture's brightness is computed",
        default=250.0,
        min=0.1,
        soft_min=50.0,
        soft_max=2000.0,
        max=100000.0,
        precision=0,
        step=1000,
    )


class KirikoViews(bpy.types.PropertyGroup):
    """Views of a display, as `core.rig.views.Views`; `use` for a display that has them."""

    use: BoolProperty(
        name="Views",
        description="Show another image in each direction, as a light-field display does, so that"
        " several viewers each see their own picture",
        default=False,
    )
    columns: IntProperty(
        name="Columns",
        description="Number of views from left to right",
        default=45,
        min=1,
        soft_max=128,
        max=1024,
    )
    rows: IntProperty(
        name="Rows",
        description="Number of views from top to bottom; 1 for a display whose image only changes"
        " sideways",
        default=1,
        min=1,
        soft_max=32,
        max=1024,
    )
    cone: FloatVectorProperty(
        name="Cone",
        description="Horizontal and vertical angle between the outermost views",
        size=2,
        default=(0.6981317, 0.6981317),
        min=0.0,
        max=3.1241393,
        subtype="NONE",
        unit="ROTATION",
    )
    overlap: FloatProperty(
        name="Overlap",
        description="Part of the distance between two views over which one fades into the next;"
        " more hides the borders between views, but mixes the viewers' pictures",
        default=0.0,
        min=0.0,
        max=1.0,
        precision=3,
        subtype="FACTOR",
    )
    distance: FloatProperty(
        name="Distance",
        description="Distance from the display at which the eye sees one view over all of it,"
        " always in millimetres; 0 for views that are the same angle everywhere",
        default=0.0,
        min=0.0,
        soft_max=5000.0,
        precision=1,
        step=1000,
        unit="CAMERA",
    )


VIEWS = tuple(KirikoViews.__annotations__)  # names of its properties
