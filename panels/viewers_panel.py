"""The viewers: their list and settings, visible range and eye box, and the result of each."""

from typing import Any

import bpy

from ..core.base.messages import Message
from ..core.base.numbers import number
from ..core.blender.data.camera_viewer import (
    camera_at,
    number_shown,
    own_images,
    seats_of,
    viewer_of,
)
from ..core.blender.data.stored_records import Sentences, StoredNumbers
from ..operators import viewer_reports, watch
from ..operators.eye_box import box_of, of_blended, served_in_words, ways_in_words
from ..operators.outdated_surfaces import EYE_BOX, LABELS, RANGE, looked_up
from ..operators.reporting import in_words
from ..operators.wrapping import sentence
from .object import draw_resolution, draw_tone
from .panel_text import Closed, OfRig, with_labels

ROWS = 4


class KIRIKO_UL_viewers(bpy.types.UIList):
    """Viewers, with their weights and switches."""

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
        """Draw one line of the list."""
        camera = camera_at(context.scene, index)
        layout.use_property_split = False  # or half of each line stays empty
        row = layout.row(align=True)
        row.prop(item, "is_on", text="")
        name = row.row(align=True)
        name.active = item.is_on
        text = in_words(Message("No camera")) if camera is None else camera.name
        shown = (
            "ERROR" if camera is None else "NONE"
        )  # no icon otherwise: the weight needs the room
        name.label(text=text, icon=shown, translate=False)
        # an icon on every line would say nothing
        if item.image is not None and are_some_missing(context.scene):
            name.label(text="", icon="IMAGE_DATA")
        weight = name.row(align=True)
        weight.ui_units_x = 5  # or "1.00" is cut
        weight.prop(item, "weight", text="", emboss=False)


def are_some_missing(scene: bpy.types.Scene) -> bool:
    """Whether some viewers have no image of their own but need one."""
    return scene.kiriko.picture_source == "IMAGE" and any(
        seat.image is None for seat in seats_of(scene)
    )


class VIEW3D_MT_kiriko_scenes(bpy.types.Menu):
    """The other scenes of the file, for Render Pictures."""

    bl_idname = "VIEW3D_MT_kiriko_scenes"
    bl_label = "Render Pictures"

    def draw(self, context: bpy.types.Context) -> None:
        for scene in bpy.data.scenes:
            if scene != context.scene:
                choice = self.layout.operator(
                    "kiriko.render_pictures", text=scene.name, translate=False, icon="SCENE_DATA"
                )
                choice.scene = scene.name


class VIEW3D_PT_kiriko_viewers(Closed, bpy.types.Panel):
    """The viewers with their pixels and pictures, the visible range and the eye box."""

    bl_label = "Viewers"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        ours = context.scene.kiriko
        column = layout.column()
        draw_viewers(column, context)
        draw_frame(column, context)
        draw_more(column, context)
        column.prop(ours, "picture_source")
        if ours.picture_source == "IMAGE":
            draw_images(column, context)
            draw_tone(column, ours.picture)

        row = layout.row(align=True)
        row.operator("kiriko.visible_range", icon="HIDE_OFF")
        row.operator("kiriko.remove_visible_range", text="", icon="X")
        draw_if_old(layout, context, RANGE)
        draw_eye_box(layout, context)


class VIEW3D_PT_kiriko_pupil(Closed, bpy.types.Panel):
    """The pupil of the chosen viewer."""

    bl_label = "Pupil"
    bl_parent_id = "VIEW3D_PT_kiriko_viewers"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        viewer = viewer_of(context.scene)
        if viewer is None or viewer.type != "CAMERA":
            return
        ours = viewer.kiriko
        layout.prop(ours, "use_dof")
        if not ours.use_dof:
            layout.prop(ours, "pupil")
            return
        dof = viewer.data.dof
        layout.prop(dof, "aperture_fstop")
        layout.prop(dof, "focus_object")
        row = layout.row()
        row.active = dof.focus_object is None
        row.prop(dof, "focus_distance")


def draw_frame(column: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The viewer's pixels, and a button if Numpad 0 shows another camera."""
    scene = context.scene
    viewer = viewer_of(scene)
    if viewer is None:
        return

    draw_resolution(column, context, viewer)
    if scene.camera != viewer:
        switch = column.operator(
            "wm.context_set_id", text="Set as Scene Camera", icon="OUTLINER_OB_CAMERA"
        )
        switch.data_path, switch.value = "scene.camera", viewer.name


def draw_viewers(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The viewer, or the list of several with the camera of the chosen one."""
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
    """The picture in the viewers' own pixels: the shared image, and that of the chosen viewer."""
    ours = context.scene.kiriko
    if len(bpy.data.scenes) > 1:
        layout.menu(VIEW3D_MT_kiriko_scenes.bl_idname, icon="RENDER_STILL")
    if not len(ours.viewers):
        layout.template_ID(ours, "picture_image", open="image.open")
        return
    shared = layout.column()
    shared.active = not own_images(context.scene)
    shared.template_ID(ours, "picture_image", open="image.open", text="Shared")
    chosen = ours.viewers[number_shown(context.scene)]
    layout.template_ID(chosen, "image", open="image.open", text="Own Image")
    layout.operator("kiriko.open_pictures", icon="FILE_FOLDER")


def draw_more(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Buttons that add viewers, and the choice between Sharp and Blended."""
    ours = context.scene.kiriko
    if len(ours.viewers):
        layout.prop(ours, "disagreement")
    else:
        layout.operator("kiriko.add_viewer", icon="ADD")
    row = layout.row(align=True)
    row.operator("kiriko.two_eyes", icon="CAMERA_STEREO")
    row.operator("kiriko.viewer_grid", icon="LIGHTPROBE_VOLUME")


def draw_eye_box(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The button of the eye box, and the last one's extent."""
    row = layout.row(align=True)
    row.operator("kiriko.eye_box", icon="MOD_LATTICE")
    row.operator("kiriko.remove_eye_box", text="", icon="X")
    box = box_of(looked_up(context.scene, EYE_BOX))
    if box is None:
        return

    column = layout.column(align=True)
    text = Message(
        "Within {limit} arcmin, the head of '{viewer}' may move:",
        limit=number(box["limit"]),
        viewer=box["viewer"],
    )
    sentence(column, context, text, icon="INFO")
    for extent in ways_in_words(context.scene, box):
        sentence(column, context, extent, icon="BLANK1")
    for k, line in enumerate(served_in_words(box)):
        sentence(column, context, line, icon="BLANK1" if k else "LIGHTPROBE_VOLUME")
    for line in of_blended(context.scene):
        sentence(column, context, line, icon="BLANK1")
    draw_if_old(column, context, EYE_BOX)


def draw_if_old(layout: bpy.types.UILayout, context: bpy.types.Context, name: str) -> None:
    """A sentence if the rig has changed since a surface was made."""
    if watch.is_reported_outdated(context.scene, name):
        text = Message(
            "{label} is outdated: press it again.",
            label=LABELS[name],
        )
        sentence(layout, context, text, icon="ERROR")


class VIEW3D_PT_kiriko_seen_by(OfRig, bpy.types.Panel):
    """The last result as each of several viewers sees it, the worst first."""

    bl_label = "Seen By"
    bl_parent_id = "VIEW3D_PT_kiriko_result"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(reported_on(context))

    def draw(self, context: bpy.types.Context) -> None:
        for one in reported_on(context):
            sentence(self.layout, context, viewer_reports.of_viewer(one), icon="OUTLINER_OB_CAMERA")
        conflict = reported_on(context, "conflict")
        if conflict:
            text = viewer_reports.of_conflict(conflict)
            sentence(self.layout, context, text, icon="IMAGE_DATA")
        pair = reported_on(context, "two_eyes")
        if pair:
            depth, *more = viewer_reports.of_pair(context.scene, pair)
            sentence(self.layout, context, depth, icon="CAMERA_STEREO")
            for text in more:
                sentence(self.layout, context, text, icon="BLANK1")
            if viewer_reports.is_tiring(pair):
                text = viewer_reports.tiring(pair)
                sentence(self.layout, context, text, icon="ERROR")
        why = reported_on(context, "no_pair")
        if why:
            text = Sentences.read(context.scene.kiriko.result.sentences).message(why)
            sentence(self.layout, context, text, icon="INFO")


def reported_on(context: bpy.types.Context, name: str = "viewers") -> Any:
    """An entry of the last result on several viewers or two eyes; None if there is none."""
    return StoredNumbers.read(context.scene.kiriko.result.details).by_name.get(name)
