"""Lengths of operators that are automatic while they are 0: a checkbox stands before each, and the
length that is taken beside it, so that no field reads 0 m.
"""

import bpy

from ..core.base.messages import as_message
from ..core.blender.data.units import length_of_unit, length_text
from .telling import in_words

LEAST = 0.01  # Blender units: a length that nothing is known of
Taken = dict[str, float]  # Blender units: automatic lengths that were taken last, by property


def length(name: str, description: str) -> bpy.props.FloatProperty:
    """A length that is automatic while it is 0: that of one rig, so that none is kept for the next.
    A drag ends before 0, where the field would go.
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
    """The checkbox of a length, named `auto_` and the length's name.

    Without it the length begins with the one that was taken last.
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
    """A length with its checkbox, and the length taken while that is on."""
    heading = in_words(as_message(operator.rna_type.properties[name].name))
    row = layout.row(heading=heading, translate=False)
    row.prop(operator, f"auto_{name}", text="Automatic")
    if getattr(operator, name):
        row.prop(operator, name, text="")
    elif name in taken:
        metres = taken[name] * length_of_unit(context.scene)
        row.label(text=in_words(length_text(context.scene, metres)), translate=False)
