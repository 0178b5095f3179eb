"""Display options of the interface. Neither scenes nor results depend on them."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...base.messages import CONTEXT
from ..data.rigs import rigs

IMAGES = (
    ("BEFORE", "Uncompensated", "View through the glass with the plain picture on the display"),
    ("AFTER", "Corrected", "View through the glass with the source image on the display"),
    ("IDEAL", "Ideal", "The picture as seen without glass"),
    ("SOURCE", "Source", "The source image, as the display shows it"),
)


class KirikoView(bpy.types.PropertyGroup):
    """Display options of the interface."""

    # show_overlay, left, right, wipe and show_rig: see `add`
    show_comparison: BoolProperty(options={"HIDDEN"})


def redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Redraw all viewports."""
    _redraw(context, "VIEW_3D")


def redraw_shows(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Redraw all show windows, which are text editors."""
    _redraw(context, "TEXT_EDITOR")


def _redraw(context: bpy.types.Context, kind: str) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == kind:
                area.tag_redraw()


def names_of_rigs(
    _settings: bpy.types.PropertyGroup, context: bpy.types.Context, text: str
) -> list[str]:
    """The scene's rigs whose names contain a text."""
    names = [rig.name for rig in rigs(context.scene)]
    return [name for name in names if text.casefold() in name.casefold()]


def add() -> None:
    """Add the properties with callbacks by hand, as for objects and scenes."""
    KirikoView.show_overlay = BoolProperty(
        name="Kiriko Light Path",
        description="Draw light paths from the picture's corners and centre while the Kiriko tab"
        " is open: green if light arrives, red if it is lost",
        default=True,
        update=redraw,
    )
    KirikoView.left = EnumProperty(
        name="Left",
        translation_context=CONTEXT,
        items=IMAGES,
        default="BEFORE",
        update=redraw,
    )
    KirikoView.right = EnumProperty(
        name="Right",
        translation_context=CONTEXT,
        items=IMAGES,
        default="AFTER",
        update=redraw,
    )
    KirikoView.wipe = FloatProperty(
        name="Wipe",
        description="Position of the handle, from left to right",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=redraw,
    )
    KirikoView.show_rig = StringProperty(
        name="Shown Rig",
        translation_context=CONTEXT,
        description="Rig shown in the show window; the active one if empty",
        search=names_of_rigs,
        update=redraw_shows,
    )


def take_away() -> None:
    """Remove these properties."""
    for name in ("show_rig", "wipe", "right", "left", "show_overlay"):
        delattr(KirikoView, name)
