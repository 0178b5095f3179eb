"""Shared by the presets that make the active part of the rig one that can be bought."""

import bpy

from ..core.base.messages import Message
from ..core.blender.chosen_product import Given
from ..core.rig.rig import ROLES
from . import needed, telling, work


class GivesProduct:
    """Mix-in for an operator that gives the active object, of a role, the values of a product."""

    role: str

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = context.active_object
        role = next(role for role in ROLES if role.name == cls.role)
        names = {"noun": role.noun, "label": role.label}
        reasons = []
        if thing is None or thing.kiriko.role != cls.role:
            reasons.append(Message("Select a {noun}: an object whose role is {label}", **names))
        elif not thing.is_editable:
            reasons.append(
                Message("The {noun} is linked from another file: choose its preset there", **names)
            )
        return needed.can_run(cls, reasons)

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        """Give the object the product that is chosen."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            given = self.given(context, context.active_object)
            work.forget_report(context.scene)
            telling.report(self, "INFO" if given.is_whole else "WARNING", given.text)
            return {"FINISHED"}

        return {"CANCELLED"}
