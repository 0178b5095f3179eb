"""Display preset: make the active display one that can be bought, its pixels and its size."""

from itertools import groupby

import bpy

from ..core.blender.chosen_product import give_display
from ..core.catalogue import DISPLAYS, DisplayProduct
from ..core.messages import Message
from . import needed, telling


def _tip(product: DisplayProduct) -> Message:
    width, height = product.size
    columns, rows = product.pixels
    return Message(
        "{columns} x {rows} pixels on {width:.1f} x {height:.1f} mm",
        columns=columns,
        rows=rows,
        width=1e3 * width,
        height=1e3 * height,
    )


def _items() -> list[tuple[str, str, str]]:
    """The products, each kind under its heading."""
    items = []
    for kind, products in groupby(DISPLAYS.values(), key=lambda product: product.kind):
        items.append(("", kind, ""))
        items += [(product.name, product.name, _tip(product)) for product in products]
    return items


class KIRIKO_OT_display_preset(bpy.types.Operator):
    """Make the active display one that can be bought: its pixels and its size, about its middle"""

    bl_idname = "kiriko.display_preset"
    bl_label = "Display Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="The display whose pixels and size the active one gets",
        items=_items(),
        default=next(iter(DISPLAYS)),
    )
    is_upright: bpy.props.BoolProperty(
        name="Upright",
        description="Stand it on its shorter side, as a phone is held",
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = context.active_object
        reasons = []
        if thing is None or thing.kiriko.role != "DISPLAY":
            reasons.append("Select a display: an object whose role is Display")
        elif not thing.is_editable:
            reasons.append("The display is linked from another file: choose its preset there")
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            product = DISPLAYS[self.preset]
            given = give_display(context, context.active_object, product, self.is_upright)
            telling.report(self, "INFO" if given.is_whole else "WARNING", given.text)
            return {"FINISHED"}

        return {"CANCELLED"}
