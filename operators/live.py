"""Live: follow every change of the rig with a new source image, first a coarse one, then the final
one.

An application timer does the work, not a modal operator. Such a timer also runs while objects are
dragged, though the drag takes all events of its window. It belongs to no window, and delays neither
undo nor auto-save. `live_follower.py` does the work of one turn.
"""

import bpy
from bpy.app.handlers import persistent

from ..core.base.messages import Message
from ..core.blender.result.conflict import pack_conflict
from ..core.blender.result.result_images import is_missing_numbers
from ..core.blender.result.write_result import pack_source
from . import live_follower, needed, reporting, work
from .windows import redraw

_lives: list[live_follower.Live] = []
_last_words: list[str] = []  # reason why it stopped by itself
# Session uids of followed scenes when a file load began, and whether the image is unpacked.
_left: dict[int, bool] = {}


def followed() -> live_follower.Live | None:
    """The followed scene, if any; at most one."""
    return _lives[0] if _lives else None


def is_on() -> bool:
    """Whether any scene is followed."""
    return bool(_lives)


def _scene_of(live: live_follower.Live) -> bpy.types.Scene | None:
    """The followed scene, if it still exists."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == live.uid), None)


def follows(scene: bpy.types.Scene) -> bool:
    """Whether this scene is followed; another window may show another one."""
    return bool(_lives) and _lives[0].uid == scene.session_uid


def status(scene: bpy.types.Scene | None = None) -> tuple[str, bool]:
    """Status sentence for a viewer of the scene ('' for none), and whether it reports a problem."""
    if not _lives:
        return (_last_words[0], False) if _last_words else ("", False)

    live = _lives[0]
    if scene is not None and not follows(scene):
        other = _scene_of(live)
        name = "" if other is None else other.name
        return Message("Live follows the scene '{name}'.", name=name) if name else "", False
    if live.problem:
        return live.problem, True
    if needed.sculpting(bpy.context):
        return Message("Live: waiting for you to leave Sculpt Mode."), False
    if live.progress is not None:
        percent = 100 * live.progress
        return Message("Live: updating, {percent:.0f} %", percent=percent), False
    if live.phrase:  # same text as in the status bar
        return Message("Live: {phrase}...", phrase=live.phrase), False
    if live.is_working or not live.has_read:
        return Message("Live: {phrase}...", phrase=Message("reading the scene")), False
    if live.seconds is None:  # the existing result was up to date
        return Message("Live: up to date."), False

    # Always one line, so that nothing below it moves.
    return Message("Live: up to date after {seconds:.1f} s.", seconds=live.seconds[1]), False


def is_ahead(scene: bpy.types.Scene) -> bool:
    """Whether the scene has changed since its result and a new one is under way."""
    return follows(scene) and _lives[0].is_of_another(scene.kiriko.result.solved_for)


def start(scene: bpy.types.Scene) -> live_follower.Live:
    """Start following a scene."""
    stop()
    _lives.append(live_follower.Live(scene))
    work.listen(HANDLERS)
    bpy.app.timers.register(tick, first_interval=live_follower.PAUSE)
    return _lives[0]


def stop(last_words: str = "") -> None:
    """Stop following; may be called at any time."""
    _last_words[:] = [last_words] if last_words else []
    if not _lives:
        return

    live = _lives.pop()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)

    work.stop_listening(HANDLERS)
    live.close()
    pack_if_needed(live)
    redraw()


def forget_why() -> None:
    """Clear the reason why Live stopped, once the artist goes on."""
    if not _lives:
        _last_words.clear()


def pack_if_needed(live: live_follower.Live) -> None:
    """Pack the image into the file, which is too slow for every update."""
    scene = _scene_of(live)
    if live.is_unpacked and scene is not None:
        live.leave_picture(scene)
        pack_source(scene)
        pack_conflict(scene)
        live.is_unpacked = False


def push_undo(scene: bpy.types.Scene) -> None:
    """Push an undo step of a complete result that Live has written, if there is none yet.

    Undo of the next change then returns to it, not to the result of an older scene.
    """
    result = scene.kiriko.result
    if not follows(scene) or result.is_coarse or is_missing_numbers(result) or is_ahead(scene):
        return
    if _lives[0].n_pushed < _lives[0].n_pictures:
        _lives[0].n_pushed = _lives[0].n_pictures
        pack_if_needed(_lives[0])
        bpy.ops.ed.undo_push(message="Live")


def settle(scene: bpy.types.Scene) -> None:
    """Complete the scene's result before another replaces it."""
    followed_scene = followed()
    if followed_scene is not None and followed_scene.uid == scene.session_uid:
        pack_if_needed(followed_scene)
        followed_scene.start_over()


def tick() -> float | None:
    """Timer callback."""
    if not _lives:
        return None

    try:
        wait = _lives[0].turn()
    except (Exception, KeyboardInterrupt) as error:
        stop(reporting.sentence(error, Message("Live")))
        return None

    if wait is None:
        stop(Message("Live stopped: its scene isn't open."))

    return wait


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Handle a change or a new frame evaluated by Blender.

    Reading the scene decides whether it matters.
    """
    for live in _lives:
        live.shapes.notice(depsgraph, live.ours)
        live.touch()


@persistent
def on_undo(*_: object) -> None:
    """Drop the work under way and restart from the present scene, since artists undo often."""
    for live in _lives:
        live.start_over()


@persistent
def on_save(*_: object) -> None:
    """Pack the image before the file is saved."""
    for live in _lives:
        pack_if_needed(live)


@persistent
def on_load(*_: object) -> None:
    """Handle a file load: the followed scene is replaced, so nothing need be packed.

    Reports on the file before are dropped.
    """
    _left.clear()
    for live in _lives:
        _left[live.uid] = live.is_unpacked
        live.is_unpacked = False
    stop(Message("Live stopped: its scene isn't open.") if _lives else "")


@persistent
def on_load_failed(*_: object) -> None:
    """Continue as before: the file does not exist or cannot be read."""
    for scene in bpy.data.scenes:
        if scene.session_uid in _left:
            start(scene).is_unpacked = _left[scene.session_uid]
    _left.clear()


def register() -> None:
    """Start listening for file loads."""
    work.listen(OF_FILES)


def unregister() -> None:
    """Stop Live and stop listening."""
    stop()
    work.stop_listening(OF_FILES)


# @persistent, so that only `unregister` removes them, not a file load
HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may have moved
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("save_pre", on_save),
)
OF_FILES = (("load_pre", on_load), ("load_post_fail", on_load_failed))


class KIRIKO_OT_live(bpy.types.Operator):
    """Update the source image after every change; press again to stop"""

    bl_idname = "kiriko.live"
    bl_label = "Live"
    bl_options = {"REGISTER"}  # the file stores its result, not whether it is on

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        reasons = (needed.linked, needed.missing_parts, needed.pictureless)
        missing = [] if follows(scene) else [one for why in reasons for one in why(scene)]
        return needed.can_run(cls, missing)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if follows(context.scene):
            push_undo(context.scene)
            stop()
        else:
            start(context.scene)
        return {"FINISHED"}
