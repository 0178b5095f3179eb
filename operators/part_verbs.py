"""Select or show a part of the rig from the panel's list."""

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.data.visibility import is_visible, show
from . import needed, reporting


class NamesPart:
    """Mix-in for an operator on an object named by its button.

    Names are unique within a file only, so a linked object also needs its library.
    """

    part: bpy.props.StringProperty(name="Part", options={"SKIP_SAVE"})
    library: bpy.props.StringProperty(
        options={"SKIP_SAVE", "HIDDEN"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if context.mode == "OBJECT" else [needed.LEAVE_EDIT_MODE])

    def found(self, context: bpy.types.Context) -> bpy.types.Object:
        """The object; RigError if it is gone."""
        thing = bpy.data.objects.get((self.part, self.library or None))
        if thing is None:
            raise RigError("'{name}' isn't in the rig now.", name=self.part)
        return thing


def name_part(button: bpy.types.OperatorProperties, thing: bpy.types.Object) -> None:
    """Set the object of such an operator's button."""
    button.part = thing.name
    button.library = "" if thing.library is None else thing.library.filepath


class KIRIKO_OT_select_part(NamesPart, bpy.types.Operator):
    """Select only this object"""

    bl_idname = "kiriko.select_part"
    bl_label = "Select Part"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            thing = _selectable(context, self.found(context))

            for other in context.selected_objects:
                other.select_set(False)
            thing.select_set(True)
            context.view_layer.objects.active = thing
            return {"FINISHED"}

        return {"CANCELLED"}


def _selectable(context: bpy.types.Context, thing: bpy.types.Object) -> bpy.types.Object:
    """A visible object, or the one that shows it as an instance."""
    shown = [other for other in context.view_layer.objects if is_visible(other)]
    makers = [
        other
        for other in shown
        if other.instance_collection is not None
        and thing in set(other.instance_collection.all_objects)
    ]
    if thing in shown:
        return thing
    if not makers:
        raise RigError("'{name}' is hidden: show it first.", name=thing.name)
    return makers[0]


class KIRIKO_OT_show_part(NamesPart, bpy.types.Operator):
    """Show this object and its collections"""

    bl_idname = "kiriko.show_part"
    bl_label = "Show Part"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            thing = self.found(context)
            show(thing, context.scene, context.view_layer)
            text = Message("'{name}' is now visible.", name=thing.name)
            reporting.report(self, "INFO", text)
            return {"FINISHED"}

        return {"CANCELLED"}
