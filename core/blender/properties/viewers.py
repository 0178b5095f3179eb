"""Settings of one of several viewers of a rig."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty


def turn_on(ours: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Turn on the rig's viewer in the list of viewers, and show it."""
    if ours.viewer is not None and len(ours.viewers):
        ours.viewers[0].is_on = True
        ours.viewer_shown = 0


class KirikoViewer(bpy.types.PropertyGroup):
    """An entry of the list of viewers."""

    # camera: see `register`
    weight: FloatProperty(
        name="Weight",
        description="Weight of this viewer where viewers disagree",
        default=1.0,
        soft_min=0.01,
        soft_max=10.0,
        precision=2,
        step=10,
    )
    is_on: BoolProperty(
        name="Use",
        description="Solve for this viewer as well",
        default=True,
    )
    image: PointerProperty(
        name="Own Image",
        description="Picture for this viewer alone, in its own pixels",
        type=bpy.types.Image,
    )
