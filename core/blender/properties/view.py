"""What the interface shows of a rig. Neither scenes nor results depend on it."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...base.messages import CONTEXT
from ..data.rigs import rigs

IMAGES = (
    ("BEFORE", "Uncompensated", "Seen through the glass while the display shows the plain picture"),
    ("AFTER", "Corrected", "Seen through the glass while the display shows the source image"),
    ("IDEAL", "Ideal", "The picture as it would be seen with no glass in the way"),
    ("SOURCE", "Source", "The source image, as the display shows it"),
)


class KirikoView(bpy.types.PropertyGroup):
    """What the interface shows of a rig."""

    # show_overlay, left, right, wipe and show_rig: see `add`
    show_comparison: BoolProperty(
        name="Before and After",
        description="Show what the viewer sees with and without compensation over the camera view",
    )


def redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Have all viewports drawn again."""
    _redraw(context, "VIEW_3D")


def redraw_shows(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Have all show windows drawn again, which are text editors."""
    _redraw(context, "TEXT_EDITOR")


def _redraw(context: bpy.types.Context, kind: str) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == kind:
                area.tag_redraw()


def names_of_rigs(
    _settings: bpy.types.PropertyGroup, context: bpy.types.Context, text: str
) -> list[str]:
    """The scene's rigs whose names have a text in them."""
    names = [rig.name for rig in rigs(context.scene)]
    return [name for name in names if text.casefold() in name.casefold()]


def add() -> None:
    """Add the properties that have callbacks, by hand as those of objects and scenes are."""
    KirikoView.show_overlay = BoolProperty(
        name="Kiriko Light Path",
        description="Draw the light's way over the viewport while the Kiriko tab is open: of the"
        " picture's corners and middle, green where it arrives, red where it is lost",
        default=True,
        update=redraw,
    )
    KirikoView.left = EnumProperty(
        name="Left",
        translation_context=CONTEXT,
        description="Image left of the handle",
        items=IMAGES,
        default="BEFORE",
        update=redraw,
    )
    KirikoView.right = EnumProperty(
        name="Right",
        translation_context=CONTEXT,
        description="Image right of the handle",
        items=IMAGES,
        default="AFTER",
        update=redraw,
    )
    KirikoView.wipe = FloatProperty(
        name="Wipe",
        description="Where the handle stands, from left to right",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=redraw,
    )
    KirikoView.show_rig = StringProperty(
        name="Shown Rig",
        translation_context=CONTEXT,
        description="The rig whose source image the show window shows; the active one when empty",
        search=names_of_rigs,
        update=redraw_shows,
    )


def take_away() -> None:
    """Take them away again."""
    for name in ("show_rig", "wipe", "right", "left", "show_overlay"):
        delattr(KirikoView, name)
