"""Bench drawing: the bench to scale, for whoever builds it."""

from pathlib import Path

import bpy

from ..core import disk
from ..core.bench.drawing.bench import draw_bench
from ..core.bench.drawing.seen import draw_seen
from ..core.bench.lattice.drawn import Lattice
from ..core.blender.paths import RELATIVE_PATH, absolute
from ..core.errors import ImageError
from ..core.messages import Message
from ..core.rig import Rig
from . import folder, needed, telling, work

NAME = "bench.svg"
PAPERS = (
    ("A4", "A4", "297 x 210 mm"),
    ("A3", "A3", "420 x 297 mm"),
)


def seen_name(name: str) -> str:
    """The name of the second sheet, beside the first one's."""
    return f"{Path(name).stem}_seen.svg"


def drawings(rig: Rig, lattice: Lattice, paper: str, name: str = NAME) -> dict[str, str]:
    """The sheets of a bench by their files' names. Without a picture's plane there is only one."""
    sheets = {name: draw_bench(rig, rig.viewer, paper)}
    if rig.picture_place.mesh is not None:
        sheets[seen_name(name)] = draw_seen(rig, rig.viewer, lattice, paper)
    return sheets


def write(place: Path, sheets: dict[str, str]) -> None:
    """Write sheets to a folder, all of them or none."""
    with disk.together(place) as new:
        for name, svg in sheets.items():
            (new / name).write_text(svg, encoding="utf-8")


def lattice_of(scene: bpy.types.Scene) -> Lattice:
    """The lattice that a scene is calibrated by."""
    ours = scene.kiriko.calibration
    return Lattice(ours.columns, ours.rows, ours.margin)


class KIRIKO_OT_bench_drawing(bpy.types.Operator):
    """Draw the bench to scale, side view and plan, with distances and angles for whoever builds it.
    A second sheet has all corners, and where the dots of the lattice should be seen
    """

    bl_idname = "kiriko.bench_drawing"
    bl_label = "Bench Drawing"
    bl_options = {"REGISTER"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="Where the first sheet is written; the second one stands beside it",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    paper: bpy.props.EnumProperty(
        name="Paper", description="Size of the sheets, which lie on their side", items=PAPERS
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace the files if there are some already",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    # the file dialogue asks an operator for these
    check_existing: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})
    filter_glob: bpy.props.StringProperty(default="*.svg", options={"SKIP_SAVE", "HIDDEN"})

    is_in_dialogue = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.lacking(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or NAME
        self.is_in_dialogue = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, context: bpy.types.Context) -> bool:
        """Called by the file dialogue: complete the name, so that one that is taken is red."""
        named = bpy.path.ensure_ext(self.filepath, ".svg")
        is_other = named != self.filepath
        self.filepath = named
        return is_other

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            if not self.filepath:
                raise ImageError("The drawing has no path: choose a file.")
            path = absolute(bpy.path.ensure_ext(self.filepath, ".svg"))
            rig = work.read(context).rig
            rig.check()
            sheets = drawings(rig, lattice_of(context.scene), self.paper, path.name)

            if not self.overwrite:
                # the dialogue showed the first name in red
                names = [n for n in sheets if not (self.is_in_dialogue and n == path.name)]
                folder.refuse_existing(path.parent, names, "set Overwrite")

            with folder.made(path.parent):
                write(path.parent, sheets)

            telling.report(
                self,
                "INFO",
                Message(
                    "Wrote {names} to '{folder}'.", names=", ".join(sheets), folder=path.parent
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}
