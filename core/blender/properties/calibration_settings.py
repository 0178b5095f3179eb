"""Settings of a calibration: measurements of a real bench."""

from math import radians

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, IntVectorProperty, StringProperty

from ...bench.offset import TOLERANCES
from ..data.paths import RELATIVE_PATH

LATTICES = (
    ("DOTS", "Dots", "Bright dots on black"),
    ("GRID", "Grid", "Bright lines on black; their crossings are measured"),
)
RESULT_USES = (
    (
        "OFFSET",
        "As Offset",
        "Solve for the fitted rig from now on; the objects stay in place",
    ),
    ("SCENE", "In the Scene", "Move the objects and set their optical properties as fitted"),
    ("NONE", "Not at All", "Only report the result"),
)


class KirikoCalibration(bpy.types.PropertyGroup):
    """Measurements of a real bench, its likely errors, and the result.

    found : the last calibration's result, JSON
    offset : the rig's deviations by name, a set for each calibration, JSON
    """

    columns: IntProperty(name="Columns", default=7, min=2, max=99)
    rows: IntProperty(name="Rows", default=7, min=2, max=99)
    margin: FloatProperty(
        name="Border",
        description="Distance from the picture's border to the outermost points, as a fraction of"
        " its width and height",
        default=1 / 14,  # as in the picture of Add Rig
        min=0.0,
        max=0.45,
        subtype="FACTOR",
    )
    style: EnumProperty(
        name="Style",
        items=LATTICES,
        default="DOTS",
    )
    filepath: StringProperty(
        name="Measured",
        description="Photograph of the lattice, or a CSV of its points with the columns column,"
        " row, x, y or only x, y",
        default="",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    size: IntVectorProperty(
        name="Pixels",
        description="Width and height of the photograph the CSV was measured in; 0 = the viewer's"
        " resolution",
        size=2,
        default=(0, 0),
        min=0,
        max=1 << 16,
    )
    noise: FloatProperty(
        name="Noise",
        description="Likely error of a measured point, in pixels of the photograph",
        default=0.3,
        min=1e-3,
        soft_max=5.0,
        max=1000.0,
        precision=2,
        subtype="PIXEL",
    )
    shift: FloatProperty(
        name="Shift",
        description="Likely error of a part's position; 0 = exact",
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
        description="Likely error of a part's rotation; 0 = exact",
        default=radians(TOLERANCES["turn"]),
        min=0.0,
        max=radians(30.0),
        precision=3,
        step=10,
        subtype="ANGLE",
    )
    index: FloatProperty(
        name="Index",
        default=TOLERANCES["index"],
        min=0.0,
        max=0.5,
        precision=4,
        step=0.1,
    )
    focal: FloatProperty(
        name="Focal Length",
        default=TOLERANCES["focal"],
        min=0.0,
        max=20.0,
        precision=2,
        step=10,
        subtype="PERCENTAGE",
    )
    crossing: FloatProperty(
        name="Crossing",
        description="Likely error of the right angle between a plate's layers; 0 = exact",
        default=radians(TOLERANCES["crossing"]),
        min=0.0,
        max=radians(5.0),
        precision=3,
        step=1,
        subtype="ANGLE",
    )
    mirror: FloatProperty(
        name="Mirror Height",
        default=TOLERANCES["mirror"],
        min=0.0,
        max=10.0,
        precision=3,
        step=1,
        unit="CAMERA",
    )
    keep: EnumProperty(
        name="Keep",
        items=RESULT_USES,
        default="OFFSET",
    )
    found: StringProperty()
    offset: StringProperty()
