"""The rig, or the active one of several: its viewer, its picture, and its parts, selected here."""

import bpy

from ..core.base.messages import Message, quoted
from ..core.base.numbers import number
from ..core.blender.data.camera_viewer import frame_of, frame_of_render, viewer_of
from ..core.blender.data.rigs import active_rig, rigs
from ..core.blender.properties.object_settings import ROLE_ITEMS
from ..operators import needed, watch
from ..operators.eye_box import box_of, of_blended, served_in_words, ways_in_words
from ..operators.outdated_surfaces import EYE_BOX, LABELS, RANGE, looked_up
from ..operators.part_verbs import name_part
from ..operators.wrapping import sentence
from .object import draw_resolution, draw_tone, labelled
from .panel_text import OfRig
from .viewers_panel import draw_images, draw_more, draw_viewers


class VIEW3D_PT_kiriko_rig(OfRig, bpy.types.Panel):
    """The settings of the rig as a whole, and its parts."""

    bl_label = "Rig"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False

        ours = context.scene.kiriko
        column = layout.column()
        draw_viewers(column, context)
        self._draw_viewer(column, context)
        draw_more(column, context)
        column.prop(ours, "picture_source")
        if ours.picture_source == "IMAGE":
            draw_images(column, context)
            draw_tone(column, ours.picture)

        self._draw_parts(layout.column(align=True), context)
        row = layout.row(align=True)
        row.operator("kiriko.visible_range", icon="HIDE_OFF")
        row.operator("kiriko.remove_visible_range", text="", icon="X")
        draw_if_old(layout, context, RANGE)
        draw_eye_box(layout, context)
        layout.operator("kiriko.remove_rig", icon="TRASH")

    def _draw_viewer(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """The viewer's pixels, and whether Blender's own view is the same."""
        scene = context.scene
        viewer = viewer_of(scene)
        if viewer is None:
            return

        draw_resolution(column, context, viewer)
        if scene.camera != viewer:
            camera = scene.camera
            shown = Message("no camera") if camera is None else quoted([camera.name])
            sentence(
                column,
                context,
                Message("Numpad 0 shows {shown}, not '{viewer}'.", shown=shown, viewer=viewer.name),
                icon="INFO",
            )
            switch = column.operator(
                "wm.context_set_id", text="Make It the Scene's Camera", icon="OUTLINER_OB_CAMERA"
            )
            switch.data_path, switch.value = "scene.camera", viewer.name

            return

        shown = frame_of_render(scene.render)
        if not frame_of(viewer, scene.render).has_shape_of(shown):
            text = Message(
                "Numpad 0 shows it in the shape of the render, {width} x {height} px.",
                width=shown.size[0],
                height=shown.size[1],
            )
            sentence(column, context, text, icon="INFO")

    def _draw_parts(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """One line a part: its role, and a button that selects it."""
        found = needed.parts(context.scene)
        viewer = viewer_of(context.scene)
        if viewer is not None:
            draw_part(column, context, "Viewer", viewer, "OUTLINER_OB_CAMERA")

        for role, name, _, icon, _ in ROLE_ITEMS:
            if role == "PICTURE" and context.scene.kiriko.picture_source == "IMAGE":
                continue  # the plane is not used, and the image stands above
            for thing, by in found.get(role, {}).items():
                draw_part(column, context, name, thing, icon, by)


def draw_eye_box(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The button, and below it how far the head may go, as last found."""
    row = layout.row(align=True)
    row.operator("kiriko.eye_box", icon="MOD_LATTICE")
    row.operator("kiriko.remove_eye_box", text="", icon="X")
    box = box_of(looked_up(context.scene, EYE_BOX))
    if box is None:
        return

    column = layout.column(align=True)
    text = Message(
        "Within {limit} arcmin the head of '{viewer}' may go:",
        limit=number(box["limit"]),
        viewer=box["viewer"],
    )
    sentence(column, context, text, icon="INFO")
    for way in ways_in_words(context.scene, box):
        sentence(column, context, way, icon="BLANK1")
    for k, line in enumerate(served_in_words(box)):
        sentence(column, context, line, icon="BLANK1" if k else "LIGHTPROBE_VOLUME")
    for line in of_blended(context.scene):
        sentence(column, context, line, icon="BLANK1")
    draw_if_old(column, context, EYE_BOX)


def draw_if_old(layout: bpy.types.UILayout, context: bpy.types.Context, name: str) -> None:
    """A sentence where the rig is another than a surface was made for."""
    if watch.is_reported_outdated(context.scene, name):
        text = Message(
            "The scene has changed since '{label}' looked at it: press it again.",
            label=LABELS[name],
        )
        sentence(layout, context, text, icon="ERROR")


def draw_part(
    column: bpy.types.UILayout,
    context: bpy.types.Context,
    role: str,
    thing: bpy.types.Object,
    icon: str,
    by: str = "",
) -> None:
    """A part's line: pressed where it is active, and grey where it is hidden."""
    row = labelled(column, role)
    one = row.row(align=True)
    one.active = not by
    button = one.operator(
        "kiriko.select_part",
        text=thing.name,
        icon="HIDE_ON" if by else icon,
        depress=thing == context.active_object,
        translate=False,
    )
    name_part(button, thing)
    if thing.kiriko.role == "PICTURE" and not by:
        row.operator("kiriko.open_picture", text="", icon="FILE_FOLDER")
    if by:
        name_part(row.operator("kiriko.show_part", text="", icon="HIDE_OFF"), thing)


class VIEW3D_MT_kiriko_rigs(bpy.types.Menu):
    """Rigs of the scene, to be shown."""

    bl_idname = "VIEW3D_MT_kiriko_rigs"
    bl_label = "Choose Rig"

    def draw(self, context: bpy.types.Context) -> None:
        active = active_rig(context.scene)
        for rig in rigs(context.scene):
            icon = "RADIOBUT_ON" if rig == active else "RADIOBUT_OFF"
            choice = self.layout.operator(
                "kiriko.choose_rig", text=rig.name, icon=icon, translate=False
            )
            choice.rig = rig.name


def draw_rigs(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The rig that is shown, by its collection's name, others to be chosen, and one to be added."""
    found, active = rigs(context.scene), active_rig(context.scene)
    if not found:
        return

    row = layout.row(align=True)
    if len(found) > 1:
        row.menu(VIEW3D_MT_kiriko_rigs.bl_idname, text="", icon="OUTLINER_COLLECTION")
    if active is not None:
        row.prop(active, "name", text="")
    row.operator_menu_enum("kiriko.add_rig", "kind", text="", icon="ADD")
