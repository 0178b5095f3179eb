"""Calibration: find the errors of a real bench by a photograph of the lattice."""

from pathlib import Path

import bpy

from ..core.base.messages import Message, as_message, joined
from ..core.blender.data.stored_records import Offset, Sentences, StoredNumbers
from ..operators.calibrate import DETERMINED, TEXTS
from ..operators.wrapping import sentence
from .panel_text import Closed, OfRig, with_labels

MOST = 5  # errors in the list


class VIEW3D_PT_kiriko_calibration(Closed, bpy.types.Panel):
    """Show a lattice, and fit the rig to a photograph of it."""

    bl_label = "Calibration"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        ours = context.scene.kiriko.calibration
        column = layout.column(align=True)
        column.prop(ours, "columns")
        column.prop(ours, "rows")
        layout.prop(ours, "margin")
        layout.prop(ours, "style")
        layout.operator("kiriko.lattice_picture", icon="LIGHTPROBE_VOLUME")

        layout.separator()
        layout.prop(ours, "filepath")
        if Path(ours.filepath).suffix.lower() in TEXTS:  # a photograph has its own size
            layout.prop(ours, "size")
        layout.prop(ours, "keep")
        buttons = layout.column(align=True)
        buttons.enabled = bool(ours.filepath)
        buttons.scale_y = 1.3
        buttons.operator("kiriko.calibrate", icon="TRACKER")
        if ours.offset:
            n = len(Offset.read(ours.offset).sets)
            text = Message(
                "Calibrations applied: {n}. The solved rig differs slightly from the drawn one.",
                n=n,
            )
            sentence(layout, context, text, icon="INFO")
            row = layout.row(align=True)
            row.operator("kiriko.apply_calibration")
            row.operator("kiriko.remove_calibration")


class VIEW3D_PT_kiriko_expected(Closed, bpy.types.Panel):
    """The likely size of each error of the bench."""

    bl_label = "Expected Errors"
    bl_parent_id = "VIEW3D_PT_kiriko_calibration"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        ours = context.scene.kiriko.calibration
        for name in ("shift", "turn", "index", "focal", "crossing", "mirror", "noise"):
            layout.prop(ours, name)


class VIEW3D_PT_kiriko_found(OfRig, bpy.types.Panel):
    """The result of the last calibration."""

    bl_label = "Measured Errors"
    bl_parent_id = "VIEW3D_PT_kiriko_calibration"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = context.scene.kiriko.calibration.found
        return super().poll(context) and bool(StoredNumbers.read(found).by_name)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        found = StoredNumbers.read(context.scene.kiriko.calibration.found).by_name
        text = Message(
            "'{file}', {n} of {n_all} points: {before:.3g} px off, {after:.2g} with the fit.",
            file=found["measured"],
            n=found["points"],
            n_all=found["of"],
            before=found["before_viewer_px"],
            after=found["after_viewer_px"],
        )
        sentence(layout, context, text, icon="DRIVER_DISTANCE")

        if found["left_out"]:
            text = Message("Outliers left out: {points}.", points=", ".join(found["left_out"]))
            sentence(layout, context, text, icon="ERROR")

        amounts = sorted(found["amounts"], key=lambda entry: entry["error"] / entry["tolerance"])
        for entry in amounts[:MOST]:
            text = Message(
                "{name}: {amount:+.2g} (+- {error:.1g}) {unit}",
                name=amount_words(entry["name"]),
                amount=entry["amount"],
                error=entry["error"],
                unit=as_message(entry["unit"]),
            )
            sentence(layout, context, text, icon="DOT")

        n_measured = sum(entry["error"] < DETERMINED * entry["tolerance"] for entry in amounts)
        text = Message(
            "The photograph measures {n} of {n_all} errors.", n=n_measured, n_all=len(amounts)
        )
        sentence(layout, context, text, icon="INFO")
        if found["extra_photographs"]:
            sentence(layout, context, advice(found), icon="OUTLINER_OB_CAMERA")


class VIEW3D_PT_kiriko_not_separated(Closed, bpy.types.Panel):
    """The errors that one photograph does not show or cannot separate."""

    bl_label = "Undetermined Errors"
    bl_parent_id = "VIEW3D_PT_kiriko_found"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        found = StoredNumbers.read(context.scene.kiriko.calibration.found).by_name
        for group in found["alike"]:
            sentence(
                layout,
                context,
                Message(
                    "Not determined: {amounts}.", amounts=joined(map(amount_words, group), ", ")
                ),
                icon="DUPLICATE",
            )

        if found["still"]:
            amounts = joined(map(amount_words, found["still"]), ", ")
            text = Message("Not determined: {amounts}.", amounts=amounts)
            sentence(layout, context, text, icon="HIDE_ON")


def advice(found: dict) -> Message:
    """The next photograph that would measure most."""
    extra = found["extra_photographs"][0]
    where = Sentences.read(extra.get("said", "")).message(extra["where"])
    return Message("A photograph from {where} would help most.", where=where)


def amount_words(name: str) -> Message:
    """The name of an error: that of its part, and its kind."""
    part, _, kind = name.rpartition(": ")
    return Message("{part}: {amount}", part=part, amount=as_message(kind))
