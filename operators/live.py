"""Live: follow every change of the rig with a new source image, coarse first and then finer.

The work is done in turns of a timer of the application, and not by a modal operator: such a timer
also runs while objects are dragged, whose operator takes all events of its window; it belongs to no
window, and holds up neither undo nor auto-save. One turn is a matter of `live_follower.py`.
"""

import bpy
from bpy.app.handlers import persistent

from ..core.base.messages import Message
from ..core.blender.result.conflict import pack_conflict
from ..core.blender.result.result_images import lacks_numbers
from ..core.blender.result.write_result import pack_source
from . import live_follower, needed, telling, work
from .windows import redraw

_lives: list[live_follower.Live] = []
_last_words: list[str] = []  # why it stopped by itself
# session uids of what was followed as a file began to be loaded, and is its image unpacked?
_left: dict[int, bool] = {}


def followed() -> live_follower.Live | None:
    """The one scene that is followed, if any."""
    return _lives[0] if _lives else None


def is_on() -> bool:
    """Is a scene followed?"""
    return bool(_lives)


def _scene_of(live: live_follower.Live) -> bpy.types.Scene | None:
    """The scene that is followed, if it is there."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == live.uid), None)


def follows(scene: bpy.types.Scene) -> bool:
    """Is it this scene that is followed? Another window may show another one."""
    return bool(_lives) and _lives[0].uid == scene.session_uid


def status(scene: bpy.types.Scene | None = None) -> tuple[str, bool]:
    """A sentence on how it stands, '' for none, and whether it names a problem: to whoever looks at
    a scene, which may be another one than it follows.
    """
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
    if live.phrase:  # the same as in the status bar
        return Message("Live: {phrase}...", phrase=live.phrase), False
    if live.is_working or not live.has_read:
        return Message("Live: updating..."), False
    if live.seconds is None:  # what was there is that of the scene
        return Message("Live: up to date."), False

    # one line, as while it works: else all below would move up and down with each change
    return Message("Live: up to date after {seconds:.1f} s.", seconds=live.seconds[1]), False


def is_ahead(scene: bpy.types.Scene) -> bool:
    """Is a result on its way for a scene that is another by now than its result is of?"""
    return follows(scene) and _lives[0].is_of_another(scene.kiriko.result.solved_for)


def start(scene: bpy.types.Scene) -> live_follower.Live:
    """Follow a scene from now on."""
    stop()
    _lives.append(live_follower.Live(scene))
    work.listen(HANDLERS)
    bpy.app.timers.register(tick, first_interval=live_follower.PAUSE)
    return _lives[0]


def stop(last_words: str = "") -> None:
    """Follow no scene any more; may be called at any time."""
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
    """Why Live stopped by itself is no news any more, once the artist has gone on."""
    if not _lives:
        _last_words.clear()


def pack_if_needed(live: live_follower.Live) -> None:
    """Save the image within the file, which takes too long to be done with each update; what is
    told beside it is of no other.
    """
    scene = _scene_of(live)
    if live.is_unpacked and scene is not None:
        live.leave_picture(scene)
        pack_source(scene)
        pack_conflict(scene)
        live.is_unpacked = False


def push_undo(scene: bpy.types.Scene) -> None:
    """Make an undo step of a whole result that Live has written since the last one, to which undo
    of the next change returns: the step before has the result of an older scene.
    """
    result = scene.kiriko.result
    if not follows(scene) or result.is_coarse or lacks_numbers(result) or is_ahead(scene):
        return
    if _lives[0].n_pushed < _lives[0].n_pictures:
        _lives[0].n_pushed = _lives[0].n_pictures
        pack_if_needed(_lives[0])
        bpy.ops.ed.undo_push(message="Live")


def settle(scene: bpy.types.Scene) -> None:
    """Leave the scene's result as a whole one before another takes its place."""
    followed_scene = followed()
    if followed_scene is not None and followed_scene.uid == scene.session_uid:
        pack_if_needed(followed_scene)
        followed_scene.start_over()


def tick() -> float | None:
    """Called by the timer."""
    if not _lives:
        return None

    try:
        wait = _lives[0].turn()
    except (Exception, KeyboardInterrupt) as error:
        stop(telling.sentence(error, Message("Live")))
        return None

    if wait is None:
        stop(Message("Live stopped: its scene is no longer open."))

    return wait


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Blender evaluated a change or another frame.

    Whether it counts shows when the scene is read.
    """
    for live in _lives:
        live.kept.notice(depsgraph, live.ours)
        live.touch()


@persistent
def on_undo(*_: object) -> None:
    """The work under way is dropped and begun anew from the
    scene as it is now: an artist undoes often.
    """
    for live in _lives:
        live.start_over()


@persistent
def on_save(*_: object) -> None:
    """The file is about to be saved, and the image has to be in it."""
    for live in _lives:
        pack_if_needed(live)


@persistent
def on_load(*_: object) -> None:
    """Another file takes the place of all that was followed, or the same one as it was saved, so
    nothing need be packed.

    Reports on the file before are of no use in the next.
    """
    _left.clear()
    for live in _lives:
        _left[live.uid] = live.is_unpacked
        live.is_unpacked = False
    stop(Message("Live stopped: a file was loaded.") if _lives else "")


@persistent
def on_load_failed(*_: object) -> None:
    """There is no such file, or none that Blender reads: all is as before, and Live goes on."""
    for scene in bpy.data.scenes:
        if scene.session_uid in _left:
            start(scene).is_unpacked = _left[scene.session_uid]
    _left.clear()


def register() -> None:
    """From now on forget with each file the reports on the one before."""
    work.listen(OF_FILES)


def unregister() -> None:
    """Stop, and hear of no file any more."""
    stop()
    work.stop_listening(OF_FILES)


# @persistent, so that it is `stop` that removes them, and not the file that is loaded
HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may stand elsewhere
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("save_pre", on_save),
)
OF_FILES = (("load_pre", on_load), ("load_post_fail", on_load_failed))


class KIRIKO_OT_live(bpy.types.Operator):
    """Update the source image after every change; press again to stop"""

    bl_idname = "kiriko.live"
    bl_label = "Live"
    bl_options = {"REGISTER"}  # whether it is on is no part of the file, its result is

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        reasons = (needed.linked, needed.missing_parts, needed.pictureless)
        lacks = [] if follows(scene) else [one for why in reasons for one in why(scene)]
        return needed.can_run(cls, lacks)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if follows(context.scene):
            push_undo(context.scene)
            stop()
        else:
            start(context.scene)
        return {"FINISHED"}
