"""The viewers of the rig: the list of them, and what each sees of the last result."""

from typing import Any

import bpy

from ..core.base.messages import Message
from ..core.blender.data.camera_viewer import camera_at, number_shown, own_images, seats_of
from ..core.blender.data.stored_records import Sentences, StoredNumbers
from ..operators import viewer_reports
from ..operators.telling import in_words
from ..operators.wrapping import sentence
from .panel_text import OfRig

ROWS = 4


class KIRIKO_UL_viewers(bpy.types.UIList):
    """Viewers, each with its weight, and whether it is on."""

    def draw_item(  # noqa: PLR0913, Blender's
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: bpy.types.PropertyGroup,
        item: bpy.types.PropertyGroup,
        icon: int,
        active_data: bpy.types.PropertyGroup,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        """One line of the list; Blender's own arguments."""
        camera = camera_at(context.scene, index)
        layout.use_property_split = False  # or half of each line stays empty
        row = layout.row(align=True)
        row.prop(item, "is_on", text="")
        name = row.row(align=True)
        name.active = item.is_on
        text = in_words(Message("No camera")) if camera is None else camera.name
        shown = "ERROR" if camera is None else "NONE"  # where the weight needs the room
        name.label(text=text, icon=shown, translate=False)
        # where all have one, it would take the names' room and tell nothing
        if item.image is not None and are_some_missing(context.scene):
            name.label(text="", icon="IMAGE_DATA")
        weight = name.row(align=True)
        weight.ui_units_x = 5  # or "1.00" is cut
        weight.prop(item, "weight", text="", emboss=False)


def are_some_missing(scene: bpy.types.Scene) -> bool:
    """Has a viewer who is on no image of its own, where each should have one?"""
    is_asked = scene.kiriko.picture_source == "IMAGE"
    return is_asked and any(seat.image is None for seat in seats_of(scene))


class VIEW3D_MT_kiriko_scenes(bpy.types.Menu):
    """The other scenes of the file, to be rendered for each viewer."""

    bl_idname = "VIEW3D_MT_kiriko_scenes"
    bl_label = "Render Pictures"

    def draw(self, context: bpy.types.Context) -> None:
        for scene in bpy.data.scenes:
            if scene != context.scene:
                choice = self.layout.operator(
                    "kiriko.render_pictures", text=scene.name, translate=False, icon="SCENE_DATA"
                )
                choice.scene = scene.name


def draw_viewers(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The viewer; the list and the chosen one's camera where there are several."""
    ours = context.scene.kiriko
    listed = ours.viewers
    if len(listed):
        row = layout.row()
        row.template_list(
            KIRIKO_UL_viewers.__name__, "", ours, "viewers", ours, "viewer_shown", rows=ROWS
        )
        side = row.column(align=True)
        side.operator("kiriko.add_viewer", text="", icon="ADD")
        side.operator("kiriko.remove_viewer", text="", icon="REMOVE")
        side.operator("kiriko.move_viewer", text="", icon="TRIA_UP").step = -1
        side.operator("kiriko.move_viewer", text="", icon="TRIA_DOWN").step = 1

        chosen = number_shown(context.scene)
        is_own = chosen == 0 and listed[0].camera is None
        layout.prop(*((ours, "viewer") if is_own else (listed[chosen], "camera")))
    else:
        layout.prop(ours, "viewer")


def draw_images(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The picture in the viewers' own pixels: of all of them, and the chosen one's own."""
    ours = context.scene.kiriko
    if len(bpy.data.scenes) > 1:
        layout.menu(VIEW3D_MT_kiriko_scenes.bl_idname, icon="RENDER_STILL")
    if not len(ours.viewers):
        layout.template_ID(ours, "picture_image", open="image.open")
        return
    shared = layout.column()
    shared.active = not own_images(context.scene)
    shared.template_ID(ours, "picture_image", open="image.open", text="Of All")
    chosen = ours.viewers[number_shown(context.scene)]
    layout.template_ID(chosen, "image", open="image.open", text="Own Image")
    layout.operator("kiriko.open_pictures", icon="FILE_FOLDER")


def draw_more(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Buttons that make several viewers of one, and how their disagreement is settled."""
    ours = context.scene.kiriko
    if len(ours.viewers):
        layout.prop(ours, "disagreement")
    else:
        layout.operator("kiriko.add_viewer", icon="ADD")
    row = layout.row(align=True)
    row.operator("kiriko.two_eyes", icon="CAMERA_STEREO")
    row.operator("kiriko.viewer_grid", icon="LIGHTPROBE_VOLUME")


class VIEW3D_PT_kiriko_seen_by(OfRig, bpy.types.Panel):
    """What each of several viewers sees of the last result, the worst first."""

    bl_label = "Viewers"
    bl_parent_id = "VIEW3D_PT_kiriko_result"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(told_of(context))

    def draw(self, context: bpy.types.Context) -> None:
        for one in told_of(context):
            sentence(self.layout, context, viewer_reports.of_viewer(one), icon="OUTLINER_OB_CAMERA")
        conflict = told_of(context, "conflict")
        if conflict:
            text = viewer_reports.of_conflict(conflict)
            sentence(self.layout, context, text, icon="IMAGE_DATA")
        # of edges on the picture's plane, for which it is solved anew
        if any(one.get("largest_px") is not None for one in told_of(context)):
            text = Message("Report tells how sharp each sees it, Sharp and Blended")
            sentence(self.layout, context, text, icon="BLANK1")
        pair = told_of(context, "two_eyes")
        if pair:
            depth, *more = viewer_reports.of_pair(context.scene, pair)
            sentence(self.layout, context, depth, icon="CAMERA_STEREO")
            for text in more:
                sentence(self.layout, context, text, icon="BLANK1")
            if viewer_reports.is_tiring(pair):
                text = viewer_reports.tiring(pair)
                sentence(self.layout, context, text, icon="ERROR")
        why = told_of(context, "no_pair")
        if why:
            text = Sentences.read(context.scene.kiriko.result.sentences).message(why)
            sentence(self.layout, context, text, icon="INFO")


def told_of(context: bpy.types.Context, name: str = "viewers") -> Any:
    """What the last result tells of each of several viewers, or of two eyes; None for nothing."""
    return StoredNumbers.read(context.scene.kiriko.result.details).by_name.get(name)
