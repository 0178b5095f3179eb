"""Glass preset: give the selected glass the index of refraction of a material by its name."""

import bpy

from ..core.base.messages import Message, joined
from ..core.blender.chosen_product import give_glass
from ..core.rig.catalogue import GLASSES
from . import needed, telling

TIPS = {
    name: Message("Index of refraction {ior:g}", ior=product.ior)
    for name, product in GLASSES.items()
}


def _chosen(context: bpy.types.Context) -> list[bpy.types.Object]:
    things = dict.fromkeys([context.active_object, *context.selected_objects])
    return [t for t in things if t is not None and t.kiriko.role == "GLASS" and t.is_editable]


class KIRIKO_OT_glass_preset(bpy.types.Operator):
    """Give the selected glass an index by name: in its material, or else as its Override IOR"""

    bl_idname = "kiriko.glass_preset"
    bl_label = "Glass Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="The material whose index of refraction the selected glass gets",
        items=[(name, name, tip) for name, tip in TIPS.items()],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls,
            [] if _chosen(context) else [Message("Select glass: an object whose role is Glass")],
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            given = give_glass(_chosen(context), GLASSES[self.preset])
            telling.report(self, "INFO", joined([one.text for one in given]))
            return {"FINISHED"}

        return {"CANCELLED"}
