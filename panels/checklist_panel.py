"""The things to do, each with a button that does it: in the first panel those that come before
Solve, and below that button the advice, which is known a moment after a change, or by a result.
Above it the advice would move the button away as it is pressed.
"""

import bpy

from ..core.base.messages import Message, as_message
from ..core.blender.checks.to_do import Entry, is_first
from ..operators import look_over, needed, watch
from ..operators.add_rig import KINDS
from ..operators.telling import in_words
from ..operators.wrapping import sentence
from .add_menu import add_rig, labels_of
from .panel_text import OfRig, Sidebar, have_room, side_by_side
from .rig_panel import draw_rigs

FIRST = Message(
    "Select your glass and press Add Rig: display, picture and viewer are placed around it, and a"
    " plate where the picture is to be in the glass."
)

READY = Message("Ready.")
SOLVE = Message("Ready: press Solve.")
LOOKING = Message("Looking at the shape.")
EDITED = Message("What is to mend in the shape is told as you leave edit mode.")


class VIEW3D_PT_kiriko_checklist(Sidebar, bpy.types.Panel):
    """The first step, or the things to do before Solve."""

    bl_label = "Kiriko"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """The manual; and is the light's way drawn over the viewport?"""
        row = self.layout.row(align=True)
        if needed.has_rig(context.scene):
            shown = context.window_manager.kiriko
            row.prop(shown, "show_overlay", text="", icon="OVERLAY", emboss=False)
        row.operator("kiriko.open_manual", text="", icon="HELP", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if not needed.has_rig(context.scene):
            sentence(layout, context, FIRST)
            column = layout.column(align=True)
            column.scale_y = 1.5
            labels = labels_of("Add Rig")
            if not all(have_room(context, [label]) for label in labels):
                # Blender cuts a label in its middle, so that both would read alike
                labels = [in_words(as_message(label)) for _, label, _ in KINDS]
            add_rig(column, labels)
            layout.operator_menu_enum("kiriko.open_example", "example", text="Examples")
            return

        draw_rigs(layout, context)
        found = look_over.found(context)
        layout = layout.column()
        layout.enabled = not look_over.have_moved(context.scene)
        before = list(filter(is_first, found))
        for entry in before:
            draw_entry(layout, context, entry)
        if needed.edited(context):
            sentence(layout, context, EDITED, icon="INFO")
        elif not before and look_over.is_looking(context.scene):
            sentence(layout, context, LOOKING, icon="INFO")
        elif not before:
            # one line, as the other: else Solve would move with each change
            is_next = not all(one.can_wait for one in found) or is_unsolved(context.scene)
            sentence(layout, context, SOLVE if is_next else READY, icon="CHECKMARK")
        # the lattice of Add Rig is nobody's picture; it stays, for no button below is to move
        layout.operator("kiriko.open_picture", icon="FILE_FOLDER")


class VIEW3D_PT_kiriko_advice(OfRig, bpy.types.Panel):
    """What can be done after Solve as well; there is none where there is nothing to tell."""

    bl_label = "Advice"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and bool(advice(context))

    def draw(self, context: bpy.types.Context) -> None:
        for entry in advice(context):
            draw_entry(self.layout, context, entry)


def advice(context: bpy.types.Context) -> list[Entry]:
    """Entries that stand below Solve."""
    return [entry for entry in look_over.found(context) if entry.can_wait]


def is_unsolved(scene: bpy.types.Scene) -> bool:
    """Is there no result, and none to come by itself?"""
    return scene.kiriko.result.source is None and not watch.is_followed(scene)


def draw_entry(layout: bpy.types.UILayout, context: bpy.types.Context, entry: Entry) -> None:
    """A sentence, and under it the buttons that do what it asks for."""
    column = layout.column(align=True)
    sentence(column, context, entry.text, icon=entry.icon)
    labels = [in_words(button.label) for button in entry.buttons]
    row = column if len(labels) > 2 else side_by_side(column, context, labels)
    for button, label in zip(entry.buttons, labels, strict=True):
        made = row.operator(button.operator, text=label, icon=button.icon)
        for name, value in button.properties:
            setattr(made, name, value)
