"""A layout that checks the items panels draw on it, and keeps them."""

from copy import copy
from types import SimpleNamespace

import bpy

ICONS = {
    item.identifier
    for item in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
}


def told(entries: list) -> list[str]:
    """The sentences of entries of the checklist."""
    return [str(entry.text) for entry in entries]


class Layout:
    """Takes the items of a panel: properties have to be there,
    and operators, with the properties of theirs.
    """

    def __init__(self) -> None:
        self.props: list[str] = []
        self.texts: list[str] = []
        self.icons: dict[str, str] = {}  # by the text they stand at
        self.operators: list[str] = []
        self.labels: list[str] = []
        self.menus: list[str] = []
        self.pressed: list[str] = []  # operators whose buttons are drawn as pressed
        self.faint: list[str] = []  # texts in grey
        self.grey: list[str] = []  # operators whose buttons cannot be pressed
        self.active = self.enabled = True
        self.is_faint = False

    def box(self, **options: object) -> "Layout":
        """A layout in this one, whose items are kept with its own."""
        inside = copy(self)
        inside.active, inside.is_faint = True, self.is_faint or not self.active
        return inside

    row = column = split = box

    def prop(self, data: bpy.types.bpy_struct, name: str, **options: object) -> None:
        assert name in data.bl_rna.properties
        self.props.append(name)

    def template_ID(self, data: bpy.types.bpy_struct, name: str, **options: object) -> None:  # noqa: N802, Blender's
        self.prop(data, name)

    def template_list(
        self, kind: str, name: str, data: object, prop: str, active: object, index: str, rows: int
    ) -> None:
        shown = getattr(bpy.types, kind)
        self.prop(data, prop)
        self.prop(active, index)
        for n, item in enumerate(getattr(data, prop)):
            shown.draw_item(None, bpy.context, self, data, item, 0, active, index, n)

    def operator(self, name: str, icon: str = "NONE", **options: object) -> SimpleNamespace:
        group, verb = name.split(".")
        getattr(getattr(bpy.ops, group), verb).get_rna_type()  # KeyError where there is none
        assert icon in ICONS
        self.operators.append(name)
        if not self.enabled:
            self.grey.append(name)
        self.labels.append(str(options.get("text", "")))
        self.icons[self.labels[-1]] = icon
        if options.get("depress"):
            self.pressed.append(name)
        return SimpleNamespace()  # takes values for the operator's properties

    def menu(self, name: str, text: str = "", icon: str = "NONE", **options: object) -> None:
        assert hasattr(bpy.types, name)
        assert icon in ICONS
        self.menus.append(name)
        self.texts.append(text)

    def separator(self) -> None:
        pass

    def icon(self, block: bpy.types.ID) -> int:
        return 0  # without a window

    def operator_menu_enum(
        self, name: str, prop: str, icon: str = "NONE", **options: object
    ) -> None:
        self.operator(name, icon, **options)
        group, verb = name.split(".")
        assert getattr(getattr(bpy.ops, group), verb).get_rna_type().properties[prop].type == "ENUM"

    def label(self, text: str = "", icon: str = "NONE", **options: object) -> None:
        assert icon in ICONS
        self.texts.append(text)
        self.icons[text] = icon
        if self.is_faint or not self.active:
            self.faint.append(text)

    def progress(self, factor: float, text: str) -> None:
        assert 0 <= factor <= 1
        self.texts.append(text)

    def template_icon(self, icon: int, scale: float) -> None:
        assert isinstance(icon, int)  # 0 without a window
