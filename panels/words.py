"""Shared by the panels: their place, and sentences broken into lines as wide as the sidebar."""

import textwrap

import bpy

from ..operators.telling import in_words

LETTER = 6.2  # px at a scale of 1, a little more than the mean of Blender's font
MARGIN = 60  # px beside the text: borders, icon


class Sidebar:
    """Where all of Kiriko's panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Kiriko"


def sentence(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a sentence over as many lines as it takes; the icon stands at the first."""
    scale = context.preferences.system.ui_scale
    columns = max(16, int((context.region.width / scale - MARGIN) / LETTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for n, line in enumerate(textwrap.wrap(in_words(text), columns)):
        column.label(text=line, icon=icon if n == 0 else ("NONE" if icon == "NONE" else "BLANK1"))
