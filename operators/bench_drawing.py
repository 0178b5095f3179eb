"""Bench drawing: the bench to scale, for building it."""

from pathlib import Path

import bpy

from ..core.base.messages import Message
from ..core.files import disk
from ..core.image.flat_picture import flat_mapping
from ..core.lab.calibrate.drawn import Lattice
from ..core.lab.drawing.bench import draw_bench, draw_seen
from ..core.rig.rig import Rig
from . import folder, needed, reporting, work
from .to_file import ToFile

NAME = "bench.svg"
PAPERS = (
    ("A4", "A4", "297 x 210 mm"),
    ("A3", "A3", "420 x 297 mm"),
)


def seen_name(name: str) -> str:
    """Name of the second sheet, next to the first."""
    return f"{Path(name).stem}_seen.svg"


def drawings(rig: Rig, lattice: Lattice, paper: str, name: str = NAME) -> dict[str, str]:
    """Sheets of a bench by file name; only one without a flat picture, since the lattice has no
    place.
    """
    sheets = {name: draw_bench(rig, rig.viewer, paper)}
    place = rig.picture_place
    if place.mesh is not None and flat_mapping(place, rig.viewer) is not None:
        sheets[seen_name(name)] = draw_seen(rig, rig.viewer, lattice, paper)
    return sheets


def write(place: Path, sheets: dict[str, str]) -> None:
    """Write sheets to a folder, all or none."""
    with disk.together(place) as new:
        for name, svg in sheets.items():
            (new / name).write_text(svg, encoding="utf-8")


def lattice_of(scene: bpy.types.Scene) -> Lattice:
    """The lattice a scene is calibrated with."""
    ours = scene.kiriko.calibration
    return Lattice(ours.columns, ours.rows, ours.margin)


class KIRIKO_OT_bench_drawing(ToFile, bpy.types.Operator):
    """Draw the bench to scale, for building it"""

    bl_description = (
        "Draw the bench to scale, with distances and angles, and a second sheet with all corners"
    )
    bl_idname = "kiriko.bench_drawing"
    bl_label = "Bench Drawing"
    bl_options = {"REGISTER"}

    default_name = NAME

    paper: bpy.props.EnumProperty(name="Paper", items=PAPERS)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "paper")
        layout.prop(self, "overwrite")

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            self.end_with(context)
            path = self.path()
            rig = work.read(context).rig
            rig.check()
            sheets = drawings(rig, lattice_of(context.scene), self.paper, path.name)

            # The dialogue confirmed the first name; the second one follows it.
            is_agreed = self.is_in_dialogue and disk.is_there(path)
            if not (self.overwrite or is_agreed):
                folder.refuse_existing(path.parent, sheets, Message("turn on Overwrite"))

            with folder.made(path.parent):
                write(path.parent, sheets)

            reporting.report(
                self,
                "INFO",
                Message(
                    "Wrote {names} to '{folder}'.", names=", ".join(sheets), folder=path.parent
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}
