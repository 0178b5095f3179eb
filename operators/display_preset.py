"""Display preset: make the active display one that can be bought, its pixels and its size."""

from itertools import groupby

import bpy

from ..core.base.messages import Message
from ..core.blender.chosen_product import Given, give_display
from ..core.rig.catalogue import DISPLAYS, DisplayProduct
from .preset import GivesProduct


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


TIPS = {name: _tip(product) for name, product in DISPLAYS.items()}


def _items() -> list[tuple[str, str, str]]:
    """The products, each kind under its heading."""
    items = []
    for kind, products in groupby(DISPLAYS.values(), key=lambda product: product.kind):
        items.append(("", kind, ""))
        items += [(product.name, product.name, TIPS[product.name]) for product in products]
    return items


class KIRIKO_OT_display_preset(GivesProduct, bpy.types.Operator):
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

    role = "DISPLAY"

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        return give_display(context, thing, DISPLAYS[self.preset], self.is_upright)
