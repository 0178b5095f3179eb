"""The settings of an object as a part of the rig: in Properties > Object, and in Advanced."""

import bpy

from ..core.base.messages import Message, as_message, as_sentence
from ..core.blender.checks.chosen_product import (
    display_product,
    glass_product,
    index_in_use,
    plate_product,
)
from ..core.blender.checks.inspect_scene import has_own_faces, is_flat, sides_of
from ..core.blender.data.bodies import bodiless, no_part
from ..core.blender.data.camera_viewer import frame_of
from ..core.blender.read.plane import image_of
from ..core.blender.read.scene_picture import UNREADABLE
from ..core.blender.result.result_images import images_of
from ..operators import needed
from ..operators.make_glass import can_be_given
from ..operators.part_verbs import name_part
from ..operators.reporting import in_words
from ..operators.wrapping import sentence
from .panel_text import Closed, with_labels

CHOOSE = Message("Choose Your Picture")
PRODUCTS = {
    "GLASS": ("kiriko.glass_preset", lambda _, thing: glass_product(thing)),
    "DISPLAY": ("kiriko.display_preset", display_product),
    "PLATE": ("kiriko.plate_preset", plate_product),
}

ELEMENT_SETTINGS = {
    "GLASS": ("reflects", "prefers"),
    "HALF_MIRROR": ("reflectance", "absorption", "prefers", "polarising"),
    "LENS": ("focal_length",),
    "POLARISER": ("angle", "extinction"),
    "WAVE_PLATE": ("retardance", "angle"),
    "DISPLAY": ("is_polarised", "angle"),
    "RETROREFLECTOR": ("spread", "pitch"),
}
# settings that need another one
NEEDS = {("GLASS", "prefers"): "reflects", ("DISPLAY", "angle"): "is_polarised"}


class VIEW3D_MT_kiriko_images(bpy.types.Menu):
    """Images of the file, to choose the picture from."""

    bl_idname = "VIEW3D_MT_kiriko_images"
    bl_label = "Image"

    def draw(self, context: bpy.types.Context) -> None:
        made = images_of(context.scene.kiriko.result)

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


class VIEW3D_PT_kiriko_views(Closed, bpy.types.Panel):
    """The views of the rig's display."""

    bl_label = "Views"
    bl_parent_id = "VIEW3D_PT_kiriko_rig"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and _display(context) is not None

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(_display(context).kiriko.views, "use", text="")

    def draw(self, context: bpy.types.Context) -> None:
        _draw_views(with_labels(self.layout), _display(context).kiriko.views)


def _display(context: bpy.types.Context) -> bpy.types.Object | None:
    """The rig's only display; None if there are several, or screens."""
    found = needed.parts(context.scene)
    displays = list(found.get("DISPLAY", ()))
    return displays[0] if len(displays) == 1 and not found.get("SCREEN") else None


class OBJECT_PT_kiriko(bpy.types.Panel):
    """All settings of the active object, also before there is a rig."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_label = "Kiriko"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.object is not None

    def draw(self, context: bpy.types.Context) -> None:
        draw_object(with_labels(self.layout), context, context.object)


def draw_object(
    layout: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
) -> None:
    """The role of an object, the settings of that role, and problems with them."""
    ours = thing.kiriko
    if thing.type == "CAMERA":
        draw_resolution(layout, context, thing)

    why = bodiless(thing)
    if why and ours.role == "NONE" and thing.type != "CAMERA":
        sentence(layout, context, as_sentence(why), icon="INFO")
        return

    layout.prop(ours, "role")
    if why and ours.role != "NONE":
        sentence(layout, context, no_part(thing), icon="ERROR")
        return

    _draw_role(layout, context, thing)


def _draw_role(
    layout: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
) -> None:
    """The settings of a part, by its role."""
    ours = thing.kiriko
    if ours.role in PRODUCTS:
        draw_product(labelled(layout, "Product"), context, thing)
    if ours.role == "GLASS":
        _draw_glass(layout, context, thing)
    for name in ELEMENT_SETTINGS.get(ours.role, ()):
        needs = NEEDS.get((ours.role, name))
        if needs is None or getattr(ours.element, needs):
            layout.prop(ours.element, name)
    if ours.role in {"GLASS", "MIRROR", "HALF_MIRROR"}:
        layout.prop(ours, "surface")
    elif ours.role == "PLATE":
        _draw_plate(layout, ours.plate)
    elif ours.role == "DISPLAY":
        layout.prop(ours, "resolution")
        layout.operator("kiriko.fit_display", icon="FULLSCREEN_ENTER")
        _draw_light_of(layout, ours.display)
        layout.prop(ours.views, "use")
        _draw_views(layout, ours.views)
    elif ours.role == "SCREEN":
        layout.prop(ours, "resolution")
    elif ours.role == "PICTURE":
        _draw_picture(layout, thing)


def draw_resolution(
    layout: bpy.types.UILayout, context: bpy.types.Context, camera: bpy.types.Object
) -> None:
    """The pixels of a camera as the viewer."""
    ours = camera.kiriko
    layout.prop(ours, "use_resolution")

    if ours.use_resolution:
        layout.prop(ours, "resolution")
    else:
        width, height = frame_of(camera, context.scene.render).size
        text = Message("Same as the render: {width} x {height} px", width=width, height=height)
        layout.label(text=in_words(text), icon="BLANK1")


def _draw_glass(
    layout: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
) -> None:
    """The index in use, and trouble with the shape or the material."""
    ours = thing.kiriko
    found = index_in_use(thing)
    if found is not None and not ours.use_ior:
        text = index_words(*found)
        labelled(layout, "IOR").label(text=in_words(text), translate=False)
    row = layout.row(heading="Override IOR")
    row.prop(ours, "use_ior", text="")
    if ours.use_ior:
        row.prop(ours, "ior", text="")
    layout.prop(ours, "dispersion")
    if ours.dispersion == "ABBE":
        layout.prop(ours, "abbe")
    row = layout.row(heading="Override Tint")
    row.prop(ours, "use_tint", text="")
    if ours.use_tint:
        row.prop(ours, "tint", text="")
    layout.prop(ours, "priority")

    if has_own_faces(context.scene, thing) and is_flat(sides_of(context.scene, thing)):
        text = Message("'{name}' is flat. Glass needs a thickness.", name=thing.name)
        sentence(layout, context, text, icon="ERROR")
    if can_be_given(thing) and not ours.use_ior:
        text = Message("The material of '{name}' isn't glass.", name=thing.name)
        sentence(layout, context, text, icon="ERROR")
        layout.operator("kiriko.make_glass", icon="MATSPHERE")


def index_words(ior: float, material: str, source: str = "default") -> Message:
    """An index of refraction, and its material, or its source if it has none."""
    if material:
        return Message("{ior:.4f} from '{material}'", ior=ior, material=material)
    return Message("{ior:.4f} ({source})", ior=ior, source=as_message(source))


def _draw_picture(layout: bpy.types.UILayout, picture: bpy.types.Object) -> None:
    """The image in use, in a menu of all images."""
    image = image_of(picture)
    row = labelled(layout, "Image")
    name = in_words(CHOOSE) if image is None else image.name
    menu = VIEW3D_MT_kiriko_images.bl_idname
    row.menu(menu, text=name, translate=False, icon="IMAGE_DATA")
    layout.operator("kiriko.fit_picture", icon="FULLSCREEN_EXIT")
    layout.operator("kiriko.fit_picture_size", icon="FULLSCREEN_ENTER")
    draw_tone(layout, picture.kiriko.picture)


def draw_tone(layout: bpy.types.UILayout, ours: bpy.types.PropertyGroup) -> None:
    """Brightness and contrast of a picture."""
    column = layout.column(align=True)
    column.use_property_split = False  # half of a narrow sidebar would cut the names
    for name in ("brightness", "gamma", "black_level"):
        column.prop(ours, name)


def _draw_light_of(layout: bpy.types.UILayout, display: bpy.types.PropertyGroup) -> None:
    """The light of a display."""
    column = layout.column(align=True)
    column.prop(display, "white")
    column.prop(display, "black_level")
    column.prop(display, "encoding")
    if display.encoding == "POWER":
        column.prop(display, "gamma")
    layout.prop(display, "primaries")
    if display.primaries == "CUSTOM":
        layout.prop(display, "wavelengths", text="nm")


def _draw_views(layout: bpy.types.UILayout, views: bpy.types.PropertyGroup) -> None:
    """The number and the angles of a display's views."""
    if not views.use:
        return
    layout.prop(views, "columns")
    layout.prop(views, "rows")
    layout.prop(views, "cone", index=-1 if views.rows > 1 else 0)
    layout.prop(views, "overlap")
    layout.prop(views, "distance")


def _draw_plate(layout: bpy.types.UILayout, plate: bpy.types.PropertyGroup) -> None:
    """The size and the mirrors of a plate."""
    layout.operator("kiriko.fit_plate", icon="FULLSCREEN_ENTER")
    layout.prop(plate, "model")
    if plate.model == "IDEAL":
        return

    column = layout.column(align=True)
    for name in ("pitch", "height", "ior", "reflectance"):
        column.prop(plate, name)
    if plate.model == "CROSSED":
        column.prop(plate, "crossing_error")

    layout.prop(plate, "fresnel")
    layout.prop(plate, "phase")


def labelled(layout: bpy.types.UILayout, text: str) -> bpy.types.UILayout:
    """A row with a label before it, aligned with the properties."""
    line = layout.split(factor=0.4)
    label = line.row()
    label.alignment = "RIGHT"
    label.label(text=in_words(text), translate=False)
    return line.row(align=True)


def draw_product(
    row: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object
) -> None:
    """A menu of products, with the name of the product matching the part's values."""
    operator, product_of = PRODUCTS[thing.kiriko.role]
    product = product_of(context, thing)
    name = Message("Custom") if product is None else as_message(product.name)
    menu = row.operator_menu_enum(
        operator, "preset", text=in_words(name), translate=False, icon="PRESET"
    )
    name_part(menu, thing)
