"""The last result: percentage shown, error and time; its image and all other numbers in Details."""

from collections.abc import Iterator

import bpy

from ..core.base.messages import Message, as_message, joined
from ..core.base.numbers import number
from ..core.base.words import percent, pixels, shares_in_words
from ..core.blender.data.stored_records import Sentences, StoredNumbers
from ..core.blender.read.elements import DEFAULT, OVERRIDE
from ..core.blender.result.result_images import images_of, is_missing_numbers
from ..core.solve.legibility import READABLE
from ..operators import live, needed, proposal, watch, work
from ..operators.reporting import in_words
from ..operators.wrapping import MARGIN, sentence
from .object import index_words
from .panel_text import OfRig

WHOLE = 0.999  # share of the picture, above which no remedy is offered
ICON = 20.0  # px, the width of an icon at a scale of 1
LARGEST = 16.0  # icons, the width of the largest image


def draw_remedies(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The proposal, or the remedies if a part of the picture is lost."""
    scene = context.scene
    proposed = proposal.current(scene)
    if proposed is not None:
        sentence(layout, context, proposed.text, icon="QUESTION")
        row = layout.row(align=True)
        row.operator_context = "EXEC_DEFAULT"  # no question: the panel shows the sentence
        row.operator("kiriko.take_proposal", icon="CHECKMARK")
        row.operator("kiriko.drop_proposal", icon="X")
    elif not needed.unsolved(scene) and scene.kiriko.result.coverage < WHOLE:
        row = layout.row(align=True)  # the checklist has those that fit a part
        row.operator("kiriko.best_place")
        row.operator("kiriko.turn_back")


class VIEW3D_PT_kiriko_result(OfRig, bpy.types.Panel):
    """The last result: the percentage shown, error and time, and trouble with it."""

    bl_label = "Result"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        result = context.scene.kiriko.result
        sentences = Sentences.read(result.sentences)
        is_unmeasured = is_missing_numbers(result)
        if result.is_coarse or is_unmeasured:
            if work.is_busy() or watch.is_followed(context.scene):
                text, icon = needed.MEASURING if is_unmeasured else needed.COMING, "INFO"
            else:
                reason = needed.NUMBERLESS if is_unmeasured else needed.COARSE
                text, icon = Message("{reason}.", reason=reason), "ERROR"
            sentence(layout, context, text, icon=icon)
        elif not result.summary:
            layout.label(text="Not solved yet.")
            return

        # numbers of an older scene or image keep their place, greyed out
        is_changed = watch.is_reported_changed(context.scene)
        column = layout.column()
        column.active = not (result.is_coarse or is_changed or live.is_ahead(context.scene))
        if result.summary:
            sentence(column, context, sentences.message(result.summary))
        draw_legibility(column, context, result, is_only_low=True)
        draw_cost(column, context, StoredNumbers.read(result.details).by_name)
        for note in notes_of(result)[0]:
            sentence(column, context, sentences.message(note), icon="ERROR")
        if is_changed:
            sentence(layout, context, watch.CHANGED, icon="ERROR")
        draw_remedies(layout, context)
        if result.source is not None:
            is_on = context.window_manager.kiriko.show_comparison
            layout.operator("kiriko.before_after", icon="ARROW_LEFTRIGHT", depress=is_on)


def draw_image(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The image of the result, and a menu of several."""
    result = context.scene.kiriko.result
    image = result.shown or result.source
    if image is None:
        return
    layout.template_icon(image.preview_ensure().icon_id, scale=icons_across(context))
    if images_of(result) != [image]:
        menu = VIEW3D_MT_kiriko_result_images.bl_idname
        layout.menu(menu, text=image.name, translate=False, icon="IMAGE_DATA")


class VIEW3D_MT_kiriko_result_images(bpy.types.Menu):
    """The images of the result."""

    bl_idname = "VIEW3D_MT_kiriko_result_images"
    bl_label = "Show Image"

    def draw(self, context: bpy.types.Context) -> None:
        for image in images_of(context.scene.kiriko.result):
            self.layout.operator(
                "kiriko.show_image", text=image.name, translate=False, icon="IMAGE_DATA"
            ).image = image.name


def draw_legibility(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    result: bpy.types.PropertyGroup,
    is_only_low: bool = False,
) -> None:
    """The legibility of the picture in the last result, or only if it is low."""
    found = StoredNumbers.read(result.details).by_name.get("legibility")
    if found is None or result.is_coarse or (is_only_low and found >= READABLE):
        return
    icon = "INFO" if found >= READABLE else "ERROR"
    sentence(layout, context, Message("Legibility: {share}", share=percent(found)), icon=icon)


def icons_across(context: bpy.types.Context) -> float:
    """The width of the sidebar in icons."""
    width = context.region.width / context.preferences.system.ui_scale
    return min(max((width - MARGIN / 2) / ICON, 1.0), LARGEST)


def notes_of(result: bpy.types.PropertyGroup) -> tuple[list[str], list[str]]:
    """Notes on lost or stray light, and all other notes."""
    warnings = StoredNumbers.read(result.details).by_name.get("warnings", ())
    notes = result.notes.splitlines()
    return [n for n in notes if n in warnings], [n for n in notes if n not in warnings]


def draw_cost(layout: bpy.types.UILayout, context: bpy.types.Context, details: dict) -> None:
    """The error and the time of the solve."""
    if "total_seconds" not in details:
        return

    if details["tessellation_error"]:
        text = Message("Mesh error: {error}", error=pixels(details["tessellation_error"]))
        sentence(layout, context, text, icon="DRIVER_DISTANCE")
    if details["map_error"] and details["map_error"]["percentile"]:
        text = Message("Map error: {error}", error=pixels(details["map_error"]["percentile"]))
        sentence(layout, context, text, icon="DRIVER_DISTANCE")
    text = Message("Solved in {seconds} s", seconds=number(details["total_seconds"]))
    sentence(layout, context, text, icon="TIME")


def draw_forecast(layout: bpy.types.UILayout, context: bpy.types.Context, details: dict) -> None:
    """Brightness and blur by the plate, and the time for another tolerance."""
    if details.get("plate"):
        sentence(layout, context, plate_words(details["plate"]), icon="MESH_GRID")
    for name in ("half", "twice"):
        if name in details.get("cost", ()):
            other = details["cost"][name]
            text = Message(
                "Tolerance {tolerance:.3g} px: about {seconds} s",
                tolerance=other["tolerance"],
                seconds=number(other["seconds"]),
            )
            sentence(layout, context, text, icon="TIME")


def plate_words(plate: dict) -> str:
    """Brightness and blur by a plate's mirrors, with their standard errors."""
    words = Message(
        "Plate: {brightness} (+- {error}) of the light, {least} to {most}",
        brightness=percent(plate["brightness"]),
        error=percent(plate["brightness_error"]),
        least=percent(plate["least"]),
        most=percent(plate["most"]),
    )
    if plate["blur"] is None:
        return words

    return Message(
        "{words}; blur {blur} (+- {error:.1g}) viewer px",
        words=words,
        blur=number(plate["blur"]),
        error=plate["blur_error"] or 0,
    )


class VIEW3D_PT_kiriko_details(OfRig, bpy.types.Panel):
    """The image and the numbers of the result, and notes on the scene."""

    bl_label = "Details"
    bl_parent_id = "VIEW3D_PT_kiriko_result"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.kiriko.result.source is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        result = context.scene.kiriko.result
        details = StoredNumbers.read(result.details).by_name
        sentences = Sentences.read(result.sentences)
        draw_image(layout, context)
        draw_legibility(layout, context, result)
        for note in notes_of(result)[1]:
            sentence(layout, context, sentences.message(note), icon="INFO")
        if result.seen is not None and result.seen_summary:
            sentence(layout, context, sentences.message(result.seen_summary), icon="IMAGE_DATA")
        if "materials" not in details:  # Add Rig computes only the legibility
            return

        draw_shares(layout, details)
        draw_forecast(layout, context, details)
        if details.get("sharpened"):
            for words in sharpened_words(details["sharpened"]):
                sentence(layout, context, words, icon="SHARPCURVE")
        draw_white(layout, context, details)
        for read in details["materials"]:
            sentence(layout, context, material_words(read, sentences), icon="MATERIAL")

        draw_work(layout, details)
        if details["left_out"]:
            parts = joined(map(sentences.message, details["left_out"]), ", ")
            sentence(layout, context, Message("Left out: {parts}.", parts=parts))


def sharpened_words(found: dict) -> Iterator[Message]:
    """The view before and after Sharpen."""
    before, after = found["before"], found["after"]
    if before["psnr"] is not None and after["psnr"] is not None:
        yield Message(
            "Sharpen: {before} to {after} dB from the picture, SSIM {similar} to {more_similar}",
            before=number(before["psnr"]),
            after=number(after["psnr"]),
            similar=number(before["ssim"]),
            more_similar=number(after["ssim"]),
        )
    yield Message("Ringing: {share} of white", share=percent(after["ringing"]))


def draw_shares(layout: bpy.types.UILayout, details: dict) -> None:
    """The percentages of the picture shown and lost, 100 % in all."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    coverage = percent(details.get("picture_coverage", 0.0))
    column.label(text=in_words(Message("{share} of the picture is shown", share=coverage)))
    for words in shares_in_words(details.get("misses", {})):
        column.label(text=in_words(words))


def draw_white(layout: bpy.types.UILayout, context: bpy.types.Context, details: dict) -> None:
    """The luminance of the display's white, seen through the plate without the glass."""
    plate = details.get("plate")
    # with Brightness the source image compensates for the plate
    share = 1.0 if plate is None or context.scene.kiriko.brightness else plate["brightness"]
    for display in needed.parts(context.scene).get("DISPLAY", {}):
        luminance = number(share * display.kiriko.display.white)
        text = Message(
            "White is seen at about {luminance} cd/m\N{SUPERSCRIPT TWO}", luminance=luminance
        )
        sentence(layout, context, text, icon="LIGHT")


def material_words(read: dict, sentences: Sentences) -> Message:
    """The index of a glass in the solve, and its source."""
    has_own = read["source"] not in {DEFAULT, OVERRIDE}
    material = read["material_name"] if has_own else ""
    words = index_words(read["ior"], material, sentences.message(read["source"]))
    return Message("{part}: {amount}", part=read["object_name"], amount=words)


def draw_work(layout: bpy.types.UILayout, details: dict) -> None:
    """Seconds of each step, rays, and glare."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for part, seconds in details["seconds"].items():
        text = Message(
            "{part}: {seconds:.2f} s", part=as_message(part.capitalize()), seconds=seconds
        )
        column.label(text=in_words(text))

    column.label(text=in_words(Message("Rays: {rays}", rays=details["rays"])))
    if details.get("glare"):
        share = percent(details["glare"]["share"])
        column.label(text=in_words(Message("Glare: {share}", share=share)))
    if details.get("split"):
        brightness, stray = (percent(details["split"][name]) for name in ("brightness", "stray"))
        text = Message("Brightness: {share}; stray light: {stray}", share=brightness, stray=stray)
        column.label(text=in_words(text))
