"""What the interface shows of a rig. Neither scenes nor results depend on it."""

import bpy
from bpy.props import BoolProperty

IMAGES = (
    ("BEFORE", "Uncompensated", "Seen through the glass while the display shows the plain picture"),
    ("AFTER", "Corrected", "Seen through the glass while the display shows the source image"),
    ("IDEAL", "Ideal", "The picture as it would be seen with no glass in the way"),
    ("SOURCE", "Source", "The source image, as the display shows it"),
)


class KirikoView(bpy.types.PropertyGroup):
    """What the interface shows of a rig."""

    # show_overlay, left, right and wipe: see `register`
    show_comparison: BoolProperty(
        name="Before and After",
        description="Show what the viewer sees with and without compensation over the camera view",
    )


def redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Have all viewports drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
