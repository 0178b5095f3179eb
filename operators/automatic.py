"""Operator lengths that are automatic at 0: each has a checkbox and shows the automatic length."""

import bpy

from ..core.base.messages import as_message
from ..core.blender.data.units import length_of_unit, length_text
from .reporting import in_words

LEAST = 0.01  # Blender units: initial value of an unknown length
Taken = dict[str, float]  # Blender units: last automatic lengths, by property


def length(name: str, description: str) -> bpy.props.FloatProperty:
    """A length that is automatic at 0; it is not remembered for the next rig.

    Dragging stops before 0.
    """
    return bpy.props.FloatProperty(
        name=name,
        description=description,
        subtype="DISTANCE",
        default=0.0,
        min=0.0,
        soft_min=1e-4,
        precision=4,
        options={"SKIP_SAVE"},
    )


def checkbox(
    name: str,
    taken: Taken,
    description: str = "As the glass and the picture's light ask for",
) -> bpy.props.BoolProperty:
    """Checkbox of a length, named `auto_` plus the length's name.

    Turning it off starts at the last automatic length.
    """

    def set_automatic(ours: bpy.types.OperatorProperties, is_on: bool) -> None:
        setattr(ours, name, 0.0 if is_on else taken.get(name, LEAST))

    return bpy.props.BoolProperty(
        name="Automatic",
        description=description,
        get=lambda ours: getattr(ours, name) == 0,
        set=set_automatic,
        options={"SKIP_SAVE", "HIDDEN"},
    )


def draw(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    operator: bpy.types.Operator,
    name: str,
    taken: Taken,
) -> None:
    """Draw a length with its checkbox, or the automatic length."""
    heading = in_words(as_message(operator.rna_type.properties[name].name))
    row = layout.row(heading=heading, translate=False)
    row.prop(operator, f"auto_{name}", text="Automatic")
    if getattr(operator, name):
        row.prop(operator, name, text="")
    elif name in taken:
        metres = taken[name] * length_of_unit(context.scene)
        row.label(text=in_words(length_text(context.scene, metres)), translate=False)
