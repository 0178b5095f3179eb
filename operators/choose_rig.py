"""Active rig of a scene: it follows the selection, or is chosen by name.

An application timer watches the active object, since neither drawing nor undo handlers may write.
"""

from collections.abc import Iterator

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message, as_message, quoted
from ..core.blender.data.rigs import active_rig, rig_of, rig_uid, rigs
from ..core.blender.lifecycle.copies import is_doubled, meant_copies, part_copies
from . import live, look_over, look_through, needed, proposal, reporting, sketcher, work
from .viewer_reports import ALL
from .windows import all_windows, redraw

TICK = 0.1  # s between checks of the active object
PATIENCE = 10.0  # s of rest after an unexpected error
# by session uid of the scene: session uid of the object whose rig was last looked up
_followed: dict[int, int] = {}


def is_new(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bool:
    """Whether an object differs from the one last looked up."""
    return thing is not None and thing.session_uid != _followed.get(scene.session_uid)


def follow(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bpy.types.Collection | None:
    """The rig to activate for a newly active object; None if it is active already.

    The object is remembered, so that a rig chosen by hand stays until another object is selected.
    """
    if not is_new(scene, thing):
        return None
    is_first = scene.session_uid not in _followed
    _followed[scene.session_uid] = thing.session_uid
    rig = rig_of(scene, thing)
    return None if is_first or rig == active_rig(scene) else rig


def choose(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Make a rig of the scene active; Live goes on with it."""
    live.settle(scene)
    proposal.drop()
    scene.kiriko_scene.rig = rig
    look_over.inspect_again(scene)
    sketcher.erase(scene)
    redraw()


def tick() -> float:
    """Timer callback."""
    try:
        follow_selection()
    except Exception as error:
        reporting.sentence(error, "The choice of the rig")  # prints unexpected errors
        return PATIENCE
    return TICK


def follow_selection() -> None:
    """Activate the rig of the active object in each visible scene.

    If windows show a scene in several view layers, the first one counts. A rig that is looked
    through stays active, with any of its viewers, and so does the one being worked on.
    """
    if work.is_busy():
        return

    for scene in filter(look_through.is_lost, bpy.data.scenes):
        look_through.leave(scene)
        redraw()
    shown = {window.scene: window.view_layer for window in reversed(all_windows())}
    for scene, layer in shown.items():
        look_through.turn_to_chosen(scene)
        if scene.is_editable and not scene.kiriko_scene.looking:
            rig = follow(scene, layer.objects.active)
            if rig is not None:
                choose(scene, rig)


class KIRIKO_OT_choose_rig(bpy.types.Operator):
    """Switch to another rig of the scene"""

    bl_idname = "kiriko.choose_rig"
    bl_label = "Choose Rig"
    bl_options = {"REGISTER", "UNDO"}

    rig: bpy.props.StringProperty(name="Rig", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = [] if rigs(context.scene) else [needed.NO_RIG]
        if work.is_busy():
            reasons.append(needed.AT_WORK)
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            choose_by_name(context, self.rig)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_part_copies(bpy.types.Operator):
    """Make a rig of the selected copies of this rig's parts, with the same settings"""

    bl_idname = "kiriko.part_copies"
    bl_label = "Duplicate Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        rig = active_rig(context.scene)
        has_copies = rig is not None and rig.is_editable and is_doubled(context.scene)
        message = Message("Select copies of the rig's display and picture first")
        reasons = [] if has_copies else [message]
        if work.is_busy():
            reasons.append(needed.AT_WORK)
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            rig = active_rig(context.scene)
            context.view_layer.update()  # grouped by their places
            things = meant_copies(context.scene, rig, context.selected_objects)
            name = part_copies(rig, things)
            choose_by_name(context, name)
            message = Message("The copies are now the rig '{name}'. Press Solve.", name=name)
            reporting.report(self, "INFO", message)
            return {"FINISHED"}
        return {"CANCELLED"}


def choose_by_name(context: bpy.types.Context, name: str) -> None:
    """Choose a rig by its collection's name, until another object is selected; RigError if not
    found.
    """
    scene = context.scene
    found = {rig.name: rig for rig in rigs(scene)}
    if name not in found:
        raise RigError(
            "The scene has no rig '{name}', only {names}.",
            name=name,
            names=quoted(found) or Message("none"),
        )
    if scene.kiriko_scene.looking and found[name] != active_rig(scene):
        look_through.leave(scene)
    choose(scene, found[name])
    if context.active_object is not None and len(found) > 1:
        _followed[scene.session_uid] = context.active_object.session_uid


class EndsWithRig:
    """Mix-in for an operator that ends later, by a dialogue or a render: it keeps its scene and
    rig.

    Another rig may have become active in between.
    """

    _began_with: tuple[int, int] | None = None  # session uids of the scene and its rig

    def begin_with(self, scene: bpy.types.Scene) -> None:
        """Remember the scene and its active rig."""
        self._began_with = scene.session_uid, rig_uid(scene)

    def end_with(self, context: bpy.types.Context | None = None) -> None:
        """Make the remembered rig active again; does nothing for an operator that ran in one go.

        context : must show the remembered scene; None for any

        Raises
        ------
        RigError
            The rig or the scene is gone, or another scene is shown.
        """
        if self._began_with is None:
            return
        scene, (_, uid) = self.own_scene(), self._began_with
        if context is not None and context.scene != scene:
            raise self._interrupted()
        if rig_uid(scene) == uid:
            return
        rig = next((rig for rig in rigs(scene) if rig.session_uid == uid), None)
        if rig is None:
            raise self._interrupted()
        choose(scene, rig)

    def _interrupted(self) -> RigError:
        return RigError(
            "{button} stopped because its scene or rig was switched or deleted: start it again.",
            button=as_message(self.bl_label),
        )

    def own_scene(self) -> bpy.types.Scene:
        """The remembered scene; RigError if it is gone."""
        uid = self._began_with[0]
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)
        if scene is None:
            raise self._interrupted()
        return scene


def find_scene(context: bpy.types.Context, rig: str | None) -> Iterator[str]:
    """Switch to the only scene with the wanted rig if the saved one has none; yields a line on it.

    RigError if several scenes have one.
    """

    def has_it(scene: bpy.types.Scene) -> bool:
        names = [one.name for one in rigs(scene)]
        return needed.has_rig(scene) if rig is None else rig in names or bool(rig == ALL and names)

    found = [scene for scene in bpy.data.scenes if has_it(scene)]
    if context.scene in found or not found:
        return
    windows = context.window_manager.windows
    if len(found) > 1 or not windows:
        raise RigError(
            "The scene '{name}' has no such rig, but there is one in {names}: choose a scene with"
            " --scene, before --command.",
            name=context.scene.name,
            names=quoted(scene.name for scene in found),
        )
    windows[0].scene = found[0]
    yield Message("scene '{name}'", name=found[0].name)


def register() -> None:
    """Start the timer."""
    work.follow(tick, TICK, ())


def unregister() -> None:
    """Stop the timer."""
    work.stop_following(tick, ())
