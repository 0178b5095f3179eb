"""The last solve's result."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty


class KirikoResult(bpy.types.PropertyGroup):
    """The last solve's result; written by the operator, shown by the panel."""

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
