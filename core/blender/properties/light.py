"""How light a picture is wanted, and how a display shines."""

import bpy
from bpy.props import EnumProperty, FloatProperty

ENCODINGS = (
    ("SRGB", "sRGB", "The curve that most displays have, and expect of image files"),
    ("POWER", "Power", "A power of the light, as displays have that are calibrated so"),
)


class KirikoPicture(bpy.types.PropertyGroup):
    """How light a picture is wanted."""

    brightness: FloatProperty(
        name="Picture Brightness",
        description="Times the light of the image: lower it where the source image would be"
        " brighter than the display's white",
        default=1.0,
        min=0.0,
        max=10.0,
        soft_max=2.0,
        precision=3,
        step=1,
    )
    gamma: FloatProperty(
        name="Picture Gamma",
        description="Above 1 the tones between black and white get lighter, below 1 darker",
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
        description="Light of the image that becomes black; the rest is spread up to white",
        default=0.0,
        min=0.0,
        soft_max=0.5,
        max=0.99,
        precision=4,
        step=1,
        subtype="FACTOR",
    )


class KirikoDisplay(bpy.types.PropertyGroup):
    """How a display shines."""

    encoding: EnumProperty(
        name="Encoding",
        description="The curve from numbers in an exported file to light; OpenEXR has linear light",
        items=ENCODINGS,
        default="SRGB",
    )
    gamma: FloatProperty(
        name="Gamma",
        description="Light is the number in the file to this power",
        default=2.2,
        min=1.0,
        max=4.0,
        soft_min=1.8,
        soft_max=2.6,
        precision=2,
        step=1,
    )
    black_level: FloatProperty(
        name="Black Level",
        description="Share of white's light that a black pixel shines all the same: 0.001 on a"
        " display with a contrast of 1000 to 1",
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
        description="Luminance of a white pixel: by it the result tells how bright the picture is",
        default=250.0,
        min=0.1,
        soft_min=50.0,
        soft_max=2000.0,
        max=100000.0,
        precision=0,
        step=1000,
    )
