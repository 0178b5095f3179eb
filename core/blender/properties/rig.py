"""A rig that Add Rig made, and what it changed of things that were there before."""

import bpy
from bpy.props import BoolProperty, StringProperty


class KirikoRig(bpy.types.PropertyGroup):
    """A collection that is a rig's. Objects and materials keep changes of theirs themselves,
    so that these are found whatever name they have by then.
    """

    key: StringProperty(
        name="Key",
        description="Tells the rig from others, by which it marks its parts; empty: no rig",
        options={"HIDDEN"},
    )
    changed: StringProperty(
        name="Changed",
        description="Settings of the scene that Add Rig changed, as JSON",
        options={"HIDDEN"},
    )
    has_plate: BoolProperty(
        name="Has Plate",
        description="Has the rig a plate, so that it is missed where it was deleted?",
        options={"HIDDEN"},
    )
    views: StringProperty(
        name="Views",
        description="Settings of 3D views that Add Rig changed, by screen, as JSON",
        options={"HIDDEN"},
    )
    settings: StringProperty(
        name="Settings",
        description="The rig's settings when the file was saved, which it brings to other files, as"
        " JSON",
        options={"HIDDEN"},
    )


class KirikoMaterial(bpy.types.PropertyGroup):
    """What Kiriko keeps of a material."""

    changed: StringProperty(
        name="Changed",
        description="Settings of the material that Add Rig changed, as JSON",
        options={"HIDDEN"},
    )
