"""Open Example: a ready rig as a new, unsaved file."""

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ..core.bench.systems import SYSTEMS
from . import framing, needed, reporting, work
from .windows import all_windows

FOLDER = Path(__file__).resolve().parent.parent / "assets"
# items without an identifier are headings of columns
EXAMPLES = (
    ("", "Glass", "", "NONE", -1),
    ("BALL", "Ball", "A solid ball of glass, the reference", "MESH_UVSPHERE", 0),
    ("GOBLET", "Goblet", "A wine glass made with Screw, Solidify and Subdivision", "MATSPHERE", 1),
    ("CUT_CUBE", "Cut Cube", "A cube with facets cut along its edges", "MESH_CUBE", 2),
    ("BOTTLE", "Bottle", "A hollow bottle made with Screw and Subdivision", "MESH_CYLINDER", 3),
    ("", "Systems", "", "NONE", -2),
    *(
        (kind, system.label, system.tip, "NONE", 4 + number)
        for number, (kind, system) in enumerate(SYSTEMS.items())
    ),
)
MADE_ACTIVE = "GLASS", "DISPLAY", "SCREEN"  # the first of these roles
WAIT = 0.1  # s until the new file's windows can be framed
_requested: list[str] = []  # the example to open after the artist has confirmed


def path_of(example: str) -> Path:
    """File of an example."""
    return FOLDER / f"example_{example.lower()}.blend"


def _frame() -> None:
    """Show the whole rig in each window's 3D view."""
    for window in all_windows():
        with bpy.context.temp_override(window=window):
            if needed.has_rig(window.scene):
                framing.frame_rig(bpy.context)


@persistent
def on_load(path: str, *_: object) -> None:
    """Handle a loaded example, after the question whether to save changes.

    It has no file name, like a new file.
    """
    is_example = bool(_requested) and not path
    _requested.clear()
    if not is_example:
        return
    for scene in bpy.data.scenes:
        by_role = {thing.kiriko.role: thing for thing in reversed(scene.objects)}
        part = next((by_role[role] for role in MADE_ACTIVE if role in by_role), None)
        for layer in scene.view_layers:
            if part is not None and layer.objects.active is None:
                layer.objects.active = part
                part.select_set(True, view_layer=layer)
    frame_soon()


def frame_soon() -> None:
    """Frame the rig once there are windows."""
    if not bpy.app.background:
        bpy.app.timers.register(_frame, first_interval=WAIT)


HANDLERS = (("load_post", on_load),)


class KIRIKO_OT_open_example(bpy.types.Operator):
    """Open an example rig as a new, unsaved file"""

    bl_idname = "kiriko.open_example"
    bl_label = "Open Example"
    bl_options = {"INTERNAL"}

    example: bpy.props.EnumProperty(name="Example", items=EXAMPLES, options={"SKIP_SAVE"})

    @classmethod
    def description(
        cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        tip = next(tip for name, _, tip, *_ in EXAMPLES if name == properties.example)
        return bpy.app.translations.pgettext_tip(tip)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._open("EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self._open("INVOKE_DEFAULT")  # asks whether to save changes

    def _open(self, how: str) -> set[str]:
        path = path_of(self.example)
        with reporting.errors_reported(self):
            # As a startup file: Save asks for a name, so the example stays unchanged.
            _requested[:] = [self.example]
            bpy.ops.wm.read_homefile(how, filepath=str(path), load_ui=False)
            return {"FINISHED"}
        return {"CANCELLED"}


def register() -> None:
    """Start listening for new files."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Stop listening."""
    work.stop_listening(HANDLERS)
    _requested.clear()
