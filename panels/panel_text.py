"""Shared by the panels: their place, and buttons beside each other as far as they have room."""

import blf
import bpy

from ..operators import needed
from ..operators.wrapping import FONT, points_of

BESIDE, BUTTON = 50, 24  # px beside buttons, and within one beside its label


class Sidebar:
    """Where all of Kiriko's panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Kiriko"


class OfRig(Sidebar):
    """A panel that is there once there is a rig."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.has_rig(context.scene)


def side_by_side(
    layout: bpy.types.UILayout, context: bpy.types.Context, labels: list[str]
) -> bpy.types.UILayout:
    """A row for buttons with these labels; a column where some label would be cut in a row."""
    is_cut = len(labels) > 1 and not have_room(context, labels)
    return layout.column(align=True) if is_cut else layout.row(align=True)


def have_room(context: bpy.types.Context, labels: list[str]) -> bool:
    """Is the sidebar wide enough for buttons of one width with these labels beside each other?"""
    width = context.region.width / context.preferences.system.ui_scale - BESIDE
    blf.size(FONT, points_of(context))
    widest = max((blf.dimensions(FONT, label)[0] for label in labels), default=0.0)
    return (widest + BUTTON) * len(labels) <= width
