"""The first panel: Add Rig; with a rig its main buttons, and below them the checklist.

The checklist changes its height, so no button is drawn below it in this panel. The line above it
is one row high in every state.
"""

import bpy

from ..core.base.messages import Message, as_message
from ..core.blender.checks.to_do import Entry, is_first
from ..core.blender.data.rigs import RIG_MARK
from ..core.blender.read.plane import image_of
from ..operators import live, look_over, look_through, needed, watch, work
from ..operators.add_rig import KINDS
from ..operators.reporting import in_words
from ..operators.wrapping import sentence
from .add_menu import add_rig, labels_of
from .object import CHOOSE
from .panel_text import Sidebar, have_room, side_by_side
from .rig_panel import draw_rigs

FIRST = Message(
    "Select your glass, then press Add Rig. Kiriko adds a display, a picture and a camera, and a"
    " mirror plate for a picture inside the glass."
)
READY = Message("Ready.")
SOLVE = Message("Ready: press Solve.")
CHECKING = Message("Checking the glass...")
EDITED = Message("Checked when you leave Edit Mode.")
BEFORE = Message("Before you solve:")
LARGE = 1.25  # scale of the main buttons


class VIEW3D_PT_kiriko_main(Sidebar, bpy.types.Panel):
    """The first step, or the main buttons and the checklist."""

    bl_label = "Kiriko"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """The rig's name and the choice of another one; without a rig, the manual."""
        if needed.has_rig(context.scene):
            draw_rigs(self.layout, context)
        else:
            self.layout.operator("kiriko.open_manual", text="", icon="HELP", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        if needed.has_rig(context.scene):
            draw_buttons(self.layout, context)
            draw_checklist(self.layout, context)
        else:
            draw_first_step(self.layout, context)


def draw_first_step(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Add Rig, and the examples."""
    sentence(layout, context, FIRST)
    column = layout.column(align=True)
    column.scale_y = 1.5
    labels = labels_of("Add Rig")
    if not all(have_room(context, [label]) for label in labels):
        # Blender cuts a label in its middle, and both would read alike
        labels = [in_words(as_message(label)) for _, label, _ in KINDS]
    add_rig(column, labels)
    layout.operator_menu_enum("kiriko.open_example", "example")
    if work.running():
        draw_progress(layout)


def draw_buttons(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Solve, Live, Look Through Viewer, and the picture."""
    column = layout.column(align=True)
    column.scale_y = LARGE
    row = column.row(align=True)
    row.operator("kiriko.solve", icon="LIGHT_SUN")
    is_on = live.follows(context.scene)
    row.operator("kiriko.live", icon="PAUSE" if is_on else "PLAY", depress=is_on)
    is_looking = bool(context.scene.kiriko_scene.looking)
    column.operator("kiriko.look_through", icon="VIEW_CAMERA", depress=is_looking)
    draw_picture(layout, context)


def draw_picture(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The button that opens the picture, with the picture's name."""
    ours = context.scene.kiriko
    if ours.picture_source == "IMAGE":
        layout.template_ID(ours, "picture_image", open="image.open")
        return
    picture = needed.the_picture(context)
    image = None if picture is None else image_of(picture)
    is_own = image is not None and RIG_MARK not in image
    text = image.name if is_own else in_words(CHOOSE)
    layout.operator("kiriko.open_picture", text=text, icon="FILE_FOLDER", translate=False)


def draw_checklist(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The state in one row, the things to do, and problems of Live or the view."""
    scene = context.scene
    found = look_over.found(context)
    draw_state(layout.row(), context, found)

    column = layout.column()
    column.enabled = not look_over.have_moved(scene)
    # Solve is above, and Result says why it is due
    shown = [entry for entry in found if not entry.asks_to_solve]
    for entry in sorted(shown, key=lambda entry: not is_first(entry)):
        draw_entry(column, context, entry)

    text, is_problem = live.status(scene)
    if text and (is_problem or not live.follows(scene)):
        sentence(layout, context, text, icon="ERROR" if is_problem else "INFO")
    otherwise = look_through.otherwise(scene)
    if otherwise is not None:
        sentence(layout, context, otherwise, icon="ERROR")


def draw_state(row: bpy.types.UILayout, context: bpy.types.Context, found: list[Entry]) -> None:
    """Progress of the running work, or a short text. The buttons below stay if it changes."""
    text, is_problem = live.status(context.scene)
    is_followed = live.follows(context.scene) and not is_problem
    progress = live.followed().progress if is_followed else None
    if work.running():
        draw_progress(row)
    elif progress is not None:
        row.progress(factor=progress, text=in_words(text))
    elif is_followed:
        row.label(text=in_words(text), icon="PLAY")
    else:
        text, icon = _state_of(context, found)
        row.label(text=in_words(text), icon=icon)


def draw_progress(layout: bpy.types.UILayout) -> None:
    """The progress of an operator's long work."""
    operator = work.running()
    text = Message(
        "{button} {percent:.0f} % ({stop})",
        button=as_message(operator.bl_label),
        percent=100 * operator.progress,
        stop=Message("Esc stops"),
    )
    layout.progress(factor=min(max(operator.progress, 0.0), 1.0), text=in_words(text))


def _state_of(context: bpy.types.Context, found: list[Entry]) -> tuple[Message, str]:
    """A short text on the checklist, and its icon."""
    if needed.edited(context):
        return EDITED, "INFO"
    if any(map(is_first, found)):
        return BEFORE, "ERROR"
    if look_over.is_looking(context.scene):
        return CHECKING, "INFO"
    is_next = not all(one.can_wait for one in found) or is_unsolved(context.scene)
    return SOLVE if is_next else READY, "CHECKMARK"


def is_unsolved(scene: bpy.types.Scene) -> bool:
    """Whether there is no result and none is under way."""
    return scene.kiriko.result.source is None and not watch.is_followed(scene)


def draw_entry(layout: bpy.types.UILayout, context: bpy.types.Context, entry: Entry) -> None:
    """A sentence, and its buttons below it."""
    column = layout.column(align=True)
    sentence(column, context, entry.text, icon=entry.icon)
    labels = [in_words(button.label) for button in entry.buttons]
    row = column if len(labels) > 2 else side_by_side(column, context, labels)
    for button, label in zip(entry.buttons, labels, strict=True):
        made = row.operator(button.operator, text=label, icon=button.icon)
        for name, value in button.properties:
            setattr(made, name, value)
