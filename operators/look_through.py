"""Look through viewer: a 3D view shows what the viewer sees, and shows again what it showed.

The scene's text is the truth: where undo or another file changes it, the views follow.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
from bpy.app.handlers import persistent

from ..core.base.messages import Message, joined, quoted
from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.data.rigs import rig_uid
from ..core.blender.data.screens import place_of, window_showing
from ..core.blender.view import looking_through, turned_views
from . import compared, framing, live, make_glass, needed, telling, work
from .windows import all_windows, redraw, view_of

_entered: dict[int, str] = {}  # by session uid of the scene: the text of its views that are changed
_windows: dict[int, int] = {}  # by the same: address of the window with that view
_rigs: dict[int, int] = {}  # by the same: session uid of the rig that is looked through
_paused: dict[int, tuple[str, list, list]] = {}  # text, views and things, during a save or load
_turned: list[tuple] = []  # views of Before and After, during the same
_live_began: list[int] = []  # scenes whose Live was begun here


def scenes() -> Iterator[bpy.types.Scene]:
    """Scenes that a view looks at through the viewer."""
    return (scene for scene in bpy.data.scenes if scene.kiriko_scene.looking)


def enter(context: bpy.types.Context) -> None:
    """Look through, and begin Live."""
    scene = context.scene
    _enter_area(scene, view_of(context))
    if not live.follows(scene):
        live.start(scene)
        _live_began.append(scene.session_uid)


def _enter_area(scene: bpy.types.Scene, area: bpy.types.Area) -> None:
    """Have a 3D view look through the viewer that is shown."""
    screen, _ = place_of(area)
    looking_through.enter(scene, screen.name, area.spaces.active, framing.window_of(area))
    _entered[scene.session_uid] = scene.kiriko_scene.looking
    _rigs[scene.session_uid] = rig_uid(scene)
    window = window_showing(area.spaces.active)
    if window is not None:  # else the view is in another workspace of the same one
        _windows[scene.session_uid] = window.as_pointer()


@contextmanager
def apart(scene: bpy.types.Scene) -> Iterator[None]:
    """Have no 3D view look through the viewer for a while, and then through the one that is shown
    by then; one that shows something else by now stays.
    """
    views = looking_through.views(scene) if scene.kiriko_scene.looking else []
    shown = [space for space, _ in views]
    areas = [
        area
        for screen in bpy.data.screens
        for area in screen.areas
        if area.type == "VIEW_3D" and area.spaces.active in shown
    ]
    if areas:
        looking_through.leave(scene)
    try:
        yield
    finally:
        if areas:
            _enter_area(scene, areas[0])


def turn_to_chosen(scene: bpy.types.Scene) -> None:
    """Have a 3D view that looks through one of several viewers look through the chosen one; one
    that shows something else by now stays.
    """
    views = looking_through.views(scene) if scene.kiriko_scene.looking else []
    viewer = viewer_of(scene)
    if not views or viewer is None or any(camera in (None, viewer) for _, camera in views):
        return
    with apart(scene):
        pass


def is_lost(scene: bpy.types.Scene) -> bool:
    """Is a scene looked at through the viewer of a rig that was deleted meanwhile, or in a window
    that was closed?
    """
    if not scene.kiriko_scene.looking:
        return False
    window = _windows.get(scene.session_uid)  # None of a copy of a scene
    if window is not None and window not in [one.as_pointer() for one in all_windows()]:
        return True
    viewer = viewer_of(scene)
    if viewer is None or scene.objects.get(viewer.name) != viewer:
        return True
    return _rigs.get(scene.session_uid) not in (None, rig_uid(scene))


def leave(scene: bpy.types.Scene) -> None:
    """Put everything back; Live stops where it was begun here."""
    looking_through.leave(scene)
    _forget(scene)


def _forget(scene: bpy.types.Scene) -> None:
    _entered.pop(scene.session_uid, None)
    _windows.pop(scene.session_uid, None)
    _rigs.pop(scene.session_uid, None)
    compared.put_views_back()  # those that were left to this look
    if scene.session_uid in _live_began:
        _live_began.remove(scene.session_uid)
        if live.follows(scene):
            live.stop()


def _show_comparison(scene: bpy.types.Scene) -> None:
    """Have a view that undo took the look from go on with the comparison, as by the button: else
    that one's button would be pressed with nothing to be seen.
    """
    window = next((window for window in all_windows() if window.scene == scene), None)
    if window is not None and compared.is_shown(scene):
        with bpy.context.temp_override(window=window):
            compared.enter_view(bpy.context)


def follow() -> None:
    """Have views and settings follow the scenes' texts, which undo or a file may have changed."""
    for scene in bpy.data.scenes:
        text = _entered.get(scene.session_uid, "")
        if scene.kiriko_scene.looking and scene.kiriko_scene.looking != text:
            leave(scene)
        elif text and not scene.kiriko_scene.looking:
            looking_through.put_views_back(scene, text)
            _forget(scene)
            _show_comparison(scene)
    redraw()


@persistent
def on_undo(*_: object) -> None:
    """Settings may not be changed before undo is over."""
    if (_entered or any(scenes())) and not bpy.app.timers.is_registered(follow):
        bpy.app.timers.register(follow, first_interval=0.0)


@persistent
def on_load(*_: object) -> None:
    """A file that was saved by force, as by auto-save, may have the settings in it."""
    _entered.clear()
    _windows.clear()
    _rigs.clear()
    _paused.clear()
    _turned.clear()
    _live_began.clear()
    for scene in list(scenes()):
        looking_through.leave(scene, is_loaded=True)


@persistent
def pause(*_: object) -> None:
    """The artist's own settings are saved; and the views, which may stay when another file is
    opened, show what they showed before.
    """
    for scene in list(scenes()):
        views, things = looking_through.views(scene), looking_through.things(scene)
        _paused[scene.session_uid] = scene.kiriko_scene.looking, views, things
        looking_through.leave(scene)
    _turned[:] = turned_views.pause()  # which may be what the views looked like before


@persistent
def go_on(*_: object) -> None:
    """The view goes on, after a save or a file that could not be opened."""
    turned_views.go_on(_turned)
    _turned.clear()
    for scene in bpy.data.scenes:
        if scene.session_uid in _paused:
            looking_through.enter_again(scene, *_paused.pop(scene.session_uid))


HANDLERS = (
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_pre", pause),
    ("load_post", on_load),
    ("load_post_fail", go_on),
    ("save_pre", pause),
    ("save_post", go_on),
    ("save_post_fail", go_on),
)


def register() -> None:
    """Follow undo and files."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Put everything back, and follow no more."""
    for scene in list(scenes()):
        leave(scene)
    if bpy.app.timers.is_registered(follow):
        bpy.app.timers.unregister(follow)
    work.stop_listening(HANDLERS)


def otherwise(scene: bpy.types.Scene) -> Message | None:
    """A sentence on glass that Cycles shows otherwise than Kiriko follows it, if there is some: by
    what Live has read, once it comes to rest.
    """
    followed = live.followed() if scene.kiriko_scene.looking and live.follows(scene) else None
    if followed is None or followed.problem or not followed.otherwise:
        return None
    return Message(
        "Cycles shows the glass otherwise than it is, for {reasons}: press Before and After to"
        " see it as it is followed.",
        reasons=joined(followed.otherwise, "; "),
    )


class KIRIKO_OT_look_through(bpy.types.Operator):
    """Show what the viewer sees, in Cycles, with Live on; press again to have your view back"""

    bl_idname = "kiriko.look_through"
    bl_label = "Look Through Viewer"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        if scene.kiriko_scene.looking:
            return True

        reasons = list(needed.missing_parts(scene))
        if not hasattr(scene, "cycles"):
            reasons.insert(0, Message("It needs Cycles: enable the add-on Cycles Render Engine"))
        if view_of(context) is None:
            reasons.append(Message("It needs a 3D view: open one"))
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.errors_reported(self):
            scene = context.scene
            if scene.kiriko_scene.looking:
                leave(scene)
                if compared.is_shown(scene):
                    compared.enter_view(context)  # it is seen there alone
                return {"FINISHED"}

            enter(context)
            glasses = needed.parts(scene).get("GLASS", ())
            opaque = [thing.name for thing in glasses if make_glass.can_be_given(thing)]
            if opaque:  # short, for the status bar cuts off what is longer
                text = Message(
                    "Nothing is seen through {opaque}: press Make It Glass.", opaque=quoted(opaque)
                )
                telling.report(self, "WARNING", text)
            return {"FINISHED"}
        return {"CANCELLED"}
