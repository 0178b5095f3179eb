"""What the last solve found."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty


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
