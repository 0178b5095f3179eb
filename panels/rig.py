"""The rig: each object's role, and the parts that are still missing."""

import bpy

from ..core.blender.bodies import bodiless
from ..core.blender.chosen_product import display_product, glass_product, plate_product
from ..core.blender.elements import DEFAULT_IOR
from ..core.blender.picture import UNREADABLE
from ..core.blender.plane import image_of
from ..core.blender.properties.objects import ROLE_ITEMS
from ..core.blender.viewer import frame_of, frame_of_render
from ..core.catalogue import DisplayProduct, GlassProduct, PlateProduct
from ..core.messages import Message
from ..operators import needed
from ..operators.make_glass import can_be_given
from ..operators.telling import in_words
from .words import Sidebar, sentence


class VIEW3D_MT_kiriko_images(bpy.types.Menu):
    """Images of the file, to be chosen as the picture."""

    bl_idname = "VIEW3D_MT_kiriko_images"
    bl_label = "Image"

    def draw(self, context: bpy.types.Context) -> None:
        result = context.scene.kiriko.result
        made = {result.source, result.seen, result.preview}

        for image in bpy.data.images:
            if image.type not in UNREADABLE and image not in made:
                choice = self.layout.operator(
                    "kiriko.choose_picture",
                    text=image.name,
                    icon_value=self.layout.icon(image),
                    translate=False,
                )
                choice.image = image.name
                choice.library = "" if image.library is None else image.library.filepath

        self.layout.separator()
        self.layout.operator("kiriko.open_picture", icon="FILE_FOLDER")


class VIEW3D_PT_kiriko_rig(Sidebar, bpy.types.Panel):
    """Each object's role, and the parts that the rig still lacks."""

    bl_label = "Rig"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.operator("kiriko.add_rig", icon="ADD")
        if context.active_object is not None:
            self._draw_object(layout.box(), context, context.active_object)

        ours = context.scene.kiriko
        column = layout.column()
        column.prop(ours, "viewer")
        self._draw_viewer(column, context)
        column.prop(ours, "picture_source")
        if ours.picture_source == "IMAGE":
            column.template_ID(ours, "picture_image", open="image.open")

        self._draw_parts(layout.column(align=True), context)
        layout.operator("kiriko.visible_range", icon="HIDE_OFF")

    def _draw_viewer(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """The viewer's pixels, and whether Blender's own view is the same."""
        scene = context.scene
        viewer = scene.kiriko.viewer or scene.camera
        if viewer is None:
            return
        if viewer != context.active_object:  # whose settings stand above
            self._draw_resolution(column, context, viewer)

        if scene.camera != viewer:
            shown = "no camera" if scene.camera is None else f"'{scene.camera.name}'"
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

    def _draw_resolution(
        self, layout: bpy.types.UILayout, context: bpy.types.Context, camera: bpy.types.Object
    ) -> None:
        ours = camera.kiriko
        layout.prop(ours, "use_resolution")

        if ours.use_resolution:
            layout.prop(ours, "resolution")
        else:
            width, height = frame_of(camera, context.scene.render).size
            layout.label(
                text=in_words(
                    Message("As the render: {width} x {height} px", width=width, height=height)
                ),
                icon="BLANK1",
            )

    def _draw_object(
        self, box: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
    ) -> None:
        ours = thing.kiriko
        box.label(text=thing.name, icon="OBJECT_DATA")
        if thing.type == "CAMERA":
            self._draw_resolution(box, context, thing)

        why = bodiless(thing)
        if why and ours.role == "NONE":
            if thing.type != "CAMERA":
                sentence(
                    box,
                    context,
                    Message(
                        "{first}{rest}, and can be no part of the rig.",
                        first=why[:1].upper(),
                        rest=why[1:],
                    ),
                    icon="INFO",
                )
            return

        box.prop(ours, "role")
        if why:
            sentence(
                box,
                context,
                Message(
                    "{first}{rest}: set the role to None.", first=why[:1].upper(), rest=why[1:]
                ),
                icon="ERROR",
            )
            return

        if ours.role == "GLASS":
            self._draw_glass(box, context, thing)
        if ours.role == "PLATE":
            _draw_product(box, "kiriko.plate_preset", plate_product(context, thing))
            self._draw_plate(box, ours.plate)

        if ours.role in {"GLASS", "MIRROR"}:
            box.prop(ours, "surface")
        elif ours.role == "DISPLAY":
            _draw_product(box, "kiriko.display_preset", display_product(context, thing))
            box.prop(ours, "resolution")
        elif ours.role == "PICTURE":
            self._draw_picture(box, thing)

    def _draw_glass(
        self, box: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
    ) -> None:
        """The index of a glass, and the trouble with its shape or its material."""
        ours = thing.kiriko
        if thing.data is not None and min(thing.dimensions) == 0:
            text = (
                "It is flat: give it a thickness, as by a Solidify modifier, or set the role to"
                " None."
            )
            sentence(box, context, text, icon="ERROR")

        if can_be_given(thing) and not ours.use_ior:
            sentence(
                box,
                context,
                Message(
                    "Its material does not refract: an index of {ior} is used.",
                    ior=DEFAULT_IOR,
                ),
                icon="ERROR",
            )
            box.operator("kiriko.make_glass", icon="MATSPHERE")

        _draw_product(box, "kiriko.glass_preset", glass_product(thing))
        row = box.row(heading="Override IOR")
        row.prop(ours, "use_ior", text="")
        value = row.row()
        value.active = ours.use_ior
        value.prop(ours, "ior", text="")
        box.prop(ours, "priority")

    def _draw_picture(self, box: bpy.types.UILayout, picture: bpy.types.Object) -> None:
        """The image that is solved, wherever it was chosen.

        Choosing another here fits the plane to it.
        """
        image = image_of(picture)
        row = _labelled(box, "Image")
        name = "Choose Image" if image is None else image.name
        row.menu(VIEW3D_MT_kiriko_images.bl_idname, text=name, icon="IMAGE_DATA")
        row.operator("kiriko.open_picture", text="", icon="FILE_FOLDER")
        box.operator("kiriko.fit_picture", icon="FULLSCREEN_EXIT")

    def _draw_plate(self, box: bpy.types.UILayout, plate: bpy.types.PropertyGroup) -> None:
        box.prop(plate, "model")
        if plate.model == "IDEAL":
            return

        column = box.column(align=True)
        for name in ("pitch", "height", "ior", "reflectance"):
            column.prop(plate, name)
        if plate.model == "CROSSED":
            column.prop(plate, "crossing_error")

        box.prop(plate, "fresnel")
        box.prop(plate, "phase")

    def _draw_parts(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        found = needed.parts(context.scene)
        for role, name, _, icon, _ in ROLE_ITEMS:
            if role == "PICTURE" and context.scene.kiriko.picture_source == "IMAGE":
                continue  # the plane is not used, and the image stands above

            things = found.get(role, {})
            shown = [thing.name for thing, by in things.items() if not by]
            if shown:
                column.label(text=f"{name}: {', '.join(shown)}", icon=icon)

            hidden = [thing.name for thing, by in things.items() if by]
            if hidden:
                row = column.row()
                row.active = False
                row.label(
                    text=in_words(
                        Message("{name}, hidden: {names}", name=name, names=", ".join(hidden))
                    ),
                    icon="HIDE_ON",
                )

        for phrase in needed.missing(context.scene):
            sentence(column, context, Message("{reason}.", reason=phrase), icon="ERROR")


def _labelled(box: bpy.types.UILayout, text: str) -> bpy.types.UILayout:
    """A row with a label before it, as Blender splits properties, for things that are none."""
    line = box.split(factor=0.4)
    label = line.row()
    label.alignment = "RIGHT"
    label.label(text=text)
    return line.row(align=True)


def _draw_product(
    box: bpy.types.UILayout,
    operator: str,
    product: PlateProduct | DisplayProduct | GlassProduct | None,
) -> None:
    """The product that a part is by its values, as a menu of all others."""
    name = "Custom" if product is None else product.name
    _labelled(box, "Product").operator_menu_enum(operator, "preset", text=name, icon="PRESET")
