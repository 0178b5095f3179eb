"""The last solve's result."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty


class KirikoResult(bpy.types.PropertyGroup):
    """The last solve's result; written by the operator, shown by the panel."""

    source: PointerProperty(
        name="Source Image",
        description="The image that the display has to show so that the viewer sees the picture"
        " undistorted",
        type=bpy.types.Image,
    )
    is_coarse: BoolProperty(
        name="Coarse",
        description="The source image is a first, coarse one, whose final one is still to come",
    )
    solved_for: StringProperty(
        name="Solved For",
        description="Fingerprint of the scene that was solved, as JSON; empty: not known",
    )
    summary: StringProperty(name="Summary", description="The last result in one sentence")
    for_most: FloatProperty(
        name="For Most of the Light",
        description="Longest side, m, at which the display of a new rig takes nearly all of its"
        " light; 0: hardly smaller than for all of it",
        options={"HIDDEN"},
    )
    seen: PointerProperty(
        name="Seen Image", description="The viewer's image, as last simulated", type=bpy.types.Image
    )
    seen_summary: StringProperty(
        name="Seen", description="The last simulation of this result, in one sentence"
    )
    preview: PointerProperty(
        name="Preview",
        description="The viewer's image, as last rendered by Cycles",
        type=bpy.types.Image,
    )
    conflict: PointerProperty(
        name="Conflict",
        description="How far apart is what several viewers ask of each pixel of the display: from"
        " dark for 0 to bright for the largest",
        type=bpy.types.Image,
    )
    shown: PointerProperty(
        name="Shown Image",
        description="The image of this result that is shown",
        type=bpy.types.Image,
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
        name="Ladder",
        description="Tolerances and the seconds they took, as the last report measured, as JSON",
    )
    notes: StringProperty(
        name="Notes",
        description="Settings of the scene that were read and not followed, one remark a line",
    )
    sentences: StringProperty(
        name="Sentences",
        description="Templates and values of the result's sentences, by which they are told in"
        " another language, as JSON",
    )
