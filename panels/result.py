"""The last result: the light that arrives, the scene as it was read."""

import bpy

from ..core.blender.kept import Numbers
from ..core.messages import Message
from ..core.words import number, percent, pixels
from ..operators import needed, watch
from ..operators.telling import in_words
from .words import Sidebar, sentence


class VIEW3D_PT_kiriko_result(Sidebar, bpy.types.Panel):
    """The last solve's result."""

    bl_label = "Result"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        result = context.scene.kiriko.result
        if result.is_coarse:
            sentence(layout, context, Message("{reason}.", reason=needed.COARSE), icon="ERROR")
        elif not result.summary:
            layout.label(text="Not solved yet.")
            return

        if watch.is_told_changed(context.scene):
            sentence(layout, context, watch.CHANGED, icon="ERROR")
        if result.summary:
            sentence(layout, context, result.summary)

        details = Numbers.read(result.details).by_name
        if result.source is not None:
            if result.summary:
                # not the property, which is rounded: the sentence above tells the same number
                coverage = details.get("picture_coverage", result.coverage)
                layout.progress(
                    factor=result.coverage,
                    text=in_words(Message("{coverage} of the picture", coverage=percent(coverage))),
                )
            layout.template_icon(result.source.preview_ensure().icon_id, scale=8.0)

        if result.seen is not None and result.seen_summary:
            sentence(layout, context, result.seen_summary, icon="IMAGE_DATA")
        if details:
            self.draw_cost(layout, context, details)

        warnings = details.get("warnings", ())  # a result of an earlier version has none
        for note in result.notes.splitlines():
            sentence(layout, context, note, icon="ERROR" if note in warnings else "INFO")

    def draw_cost(
        self, layout: bpy.types.UILayout, context: bpy.types.Context, details: dict
    ) -> None:
        """The error beside the time it took, and the time for another tolerance."""
        if "total_seconds" not in details:  # a result of an earlier version
            return

        errors = {"mesh": details["tessellation_error"]}
        if details["map_error"]:
            errors["map"] = details["map_error"]["percentile"]

        known = [f"{cause} {pixels(error)}" for cause, error in errors.items() if error]
        if known:
            sentence(
                layout,
                context,
                Message("Error: {errors}", errors=", ".join(known)),
                icon="DRIVER_DISTANCE",
            )

        plate = details.get("plate")
        if plate:
            sentence(layout, context, plate_words(plate), icon="MESH_GRID")

        sentence(
            layout,
            context,
            Message("Solved in {seconds} s", seconds=number(details["total_seconds"])),
            icon="TIME",
        )
        cost = details["cost"]

        for name in ("half", "twice"):
            if name in cost:
                other = cost[name]
                text = Message(
                    "Tolerance {tolerance:.3g} px: about {seconds} s",
                    tolerance=other["tolerance"],
                    seconds=number(other["seconds"]),
                )
                sentence(layout, context, text, icon="BLANK1")


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


class VIEW3D_PT_kiriko_details(Sidebar, bpy.types.Panel):
    """Its numbers."""

    bl_label = "Details"
    bl_parent_id = "VIEW3D_PT_kiriko_result"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.kiriko.result.details)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        details = Numbers.read(context.scene.kiriko.result.details).by_name
        for read in details["materials"]:
            where = (
                Message(" of '{material}'", material=read["material_name"])
                if read["source"] != "default"
                else ""
            )
            text = Message(
                "{name}: index {ior:.4f} ({source}{where})",
                name=read["object_name"],
                ior=read["ior"],
                source=read["source"],
                where=where,
            )
            sentence(layout, context, text, icon="MATERIAL")

        column = layout.column(align=True)
        column.scale_y = 0.8
        for part, seconds in details["seconds"].items():
            column.label(text=f"{part.capitalize()}: {seconds:.2f} s")

        column.label(text=in_words(Message("Rays: {rays}", rays=details["rays"])))
        if details.get("glare"):
            column.label(
                text=in_words(
                    Message(
                        "Light beside the glass: {share}", share=percent(details["glare"]["share"])
                    )
                )
            )

        if details.get("tessellation_error"):
            column.label(
                text=in_words(
                    Message("Tessellation: {error}", error=pixels(details["tessellation_error"]))
                )
            )

        sentence(layout, context, Message("Used: {parts}.", parts=", ".join(details["used"])))
        sentence(
            layout, context, Message("Left out: {parts}.", parts=", ".join(details["left_out"]))
        )
