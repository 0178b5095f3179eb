"""Shared by the panels: their place in the sidebar, their layout, and buttons in one row."""

import blf
import bpy

from ..operators import needed
from ..operators.wrapping import FONT, points_of

MARGIN, BUTTON = 50, 24  # px left and right of all buttons, and within each around its label


class Sidebar:
    """The place of all panels."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Kiriko"


class OfRig(Sidebar):
    """A panel that needs a rig."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.has_rig(context.scene)


class Closed(OfRig):
    """A panel that is closed at first."""

    bl_options = {"DEFAULT_CLOSED"}


def with_labels(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """The layout, with each property's name in a column of its own."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def side_by_side(
    layout: bpy.types.UILayout, context: bpy.types.Context, labels: list[str]
) -> bpy.types.UILayout:
    """A row for buttons with these labels, or a column if a row would cut some label."""
    is_cut = len(labels) > 1 and not have_room(context, labels)
    return layout.column(align=True) if is_cut else layout.row(align=True)


def have_room(context: bpy.types.Context, labels: list[str]) -> bool:
    """Whether the sidebar is wide enough for a row of equal buttons with these labels."""
    width = context.region.width / context.preferences.system.ui_scale - MARGIN
    blf.size(FONT, points_of(context))
    widest = max((blf.dimensions(FONT, label)[0] for label in labels), default=0.0)
    return (widest + BUTTON) * len(labels) <= width
