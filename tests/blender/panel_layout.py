"""A layout that checks the items panels draw on it, and stores them with their places."""

from collections.abc import Iterator
from copy import copy
from types import SimpleNamespace
from typing import NamedTuple

import bpy

ICONS = {
    item.identifier
    for item in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
}


def told(entries: list) -> list[str]:
    """The sentences of entries of the checklist."""
    return [str(entry.text) for entry in entries]


ROW = 20.0  # px, the height of a button at a scale of 1


class Place(NamedTuple):
    """An item of a panel: its name, its upper end and its height, px."""

    name: str
    top: float
    height: float


class Layout:
    """Stores the items of a panel: properties, operators and their properties have to exist.

    buttons, fields : names of items that can be pressed, and of values that can be changed; a
        menu that shows its value is a field
    """

    def __init__(self) -> None:
        self.children: list[Layout | str] = []
        self.is_row, self.scale_y = False, 1.0
        self.buttons: list[str] = []
        self.fields: list[str] = []
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

    def column(self, **options: object) -> "Layout":
        """A layout in this one, whose items are stored with its own."""
        inside = copy(self)
        inside.active, inside.is_faint = True, self.is_faint or not self.active
        inside.children, inside.is_row, inside.scale_y = [], False, 1.0
        self.children.append(inside)
        return inside

    box = column

    def row(self, **options: object) -> "Layout":
        inside = self.column()
        inside.is_row = True
        return inside

    split = row

    def places(self, top: float = 0.0, scale: float = 1.0) -> Iterator[Place]:
        """All items from the top down."""
        scale *= self.scale_y
        for child in self.children:
            if isinstance(child, Layout):
                found = list(child.places(top, scale))
                height = max((p.top + p.height - top for p in found), default=0.0)
                yield from found
            else:
                height = ROW * scale
                yield Place(child, top, height)
            top += 0.0 if self.is_row else height

    def prop(self, data: bpy.types.bpy_struct, name: str, **options: object) -> None:
        assert name in data.bl_rna.properties
        self.props.append(name)
        self.fields.append(name)
        self.children.append(name)

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
        self.buttons.append(name)
        self.children.append(name)
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
        self.buttons.append(name)
        self.children.append(name)
        self.texts.append(text)

    def separator(self) -> None:
        pass

    def icon(self, block: bpy.types.ID) -> int:
        return 0  # without a window

    def operator_menu_enum(
        self, name: str, prop: str, icon: str = "NONE", **options: object
    ) -> SimpleNamespace:
        made = self.operator(name, icon, **options)
        self.fields.append(self.buttons.pop())
        group, verb = name.split(".")
        assert getattr(getattr(bpy.ops, group), verb).get_rna_type().properties[prop].type == "ENUM"
        return made

    def label(self, text: str = "", icon: str = "NONE", **options: object) -> None:
        assert icon in ICONS
        self.texts.append(text)
        self.children.append(f"label {text}")
        self.icons[text] = icon
        if self.is_faint or not self.active:
            self.faint.append(text)

    def progress(self, factor: float, text: str) -> None:
        assert 0 <= factor <= 1
        self.texts.append(text)
        self.children.append("progress")

    def template_icon(self, icon: int, scale: float) -> None:
        assert isinstance(icon, int)  # 0 without a window
        self.children += ["image"] * int(scale)
