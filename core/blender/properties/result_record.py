"""The record of the last solve's result."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty


class KirikoResult(bpy.types.PropertyGroup):
    """The last solve's result; written by the operator, shown by the panel.

    source, seen, preview, conflict : images of the display, the simulation, Cycles, and the
        viewers' disagreement
    shown : the visible one of these images
    is_coarse : the source image is a rough one; the final one is still to come
    solved_for : fingerprint of the solved scene, JSON; '' if unknown
    summary, seen_summary : result and simulation in one sentence
    for_most : m, longest side of a new rig's display for nearly all light; 0 if hardly smaller
    coverage : fraction of the picture visible on the display
    details, ladder, sentences : figures, measured tolerances with their seconds, and templates of
        the sentences, JSON
    notes : one remark a line
    """

    source: PointerProperty(type=bpy.types.Image, options={"HIDDEN"})
    is_coarse: BoolProperty(options={"HIDDEN"})
    solved_for: StringProperty()
    summary: StringProperty()
    for_most: FloatProperty(options={"HIDDEN"})
    seen: PointerProperty(type=bpy.types.Image, options={"HIDDEN"})
    seen_summary: StringProperty()
    preview: PointerProperty(type=bpy.types.Image, options={"HIDDEN"})
    conflict: PointerProperty(type=bpy.types.Image, options={"HIDDEN"})
    shown: PointerProperty(type=bpy.types.Image, options={"HIDDEN"})
    coverage: FloatProperty(default=0.0, min=0.0, max=1.0, subtype="FACTOR", options={"HIDDEN"})
    details: StringProperty()
    ladder: StringProperty()
    notes: StringProperty()
    sentences: StringProperty()
