"""Look Through Viewer: a 3D view switches to the viewer's camera and back.

The scene's stored text decides: after undo or a file change the views follow it.
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
from . import compared, framing, live, make_glass, needed, reporting, work
from .windows import all_windows, redraw, view_of

_entered: dict[int, str] = {}  # stored text of the changed views, by session uid of the scene
_windows: dict[int, int] = {}  # address of the view's window, by the same key
_rigs: dict[int, int] = {}  # session uid of the viewer's rig, by the same key
_paused: dict[int, tuple[str, list, list]] = {}  # text, views and objects, during a save or load
_turned: list[tuple] = []  # views of Before and After, during a save or load
_live_began: list[int] = []  # scenes with Live started by this button


def scenes() -> Iterator[bpy.types.Scene]:
    """Scenes with a view through the viewer."""
    return (scene for scene in bpy.data.scenes if scene.kiriko_scene.looking)


def enter(context: bpy.types.Context) -> None:
    """Switch the view and start Live."""
    scene = context.scene
    _enter_area(scene, view_of(context))
    if not live.follows(scene):
        live.start(scene)
        _live_began.append(scene.session_uid)


def _enter_area(scene: bpy.types.Scene, area: bpy.types.Area) -> None:
    """Switch a 3D view to the visible viewer."""
    screen, _ = place_of(area)
    looking_through.enter(scene, screen.name, area.spaces.active, framing.window_of(area))
    _entered[scene.session_uid] = scene.kiriko_scene.looking
    _rigs[scene.session_uid] = rig_uid(scene)
    window = window_showing(area.spaces.active)
    if window is not None:  # else the view belongs to another workspace
        _windows[scene.session_uid] = window.as_pointer()


@contextmanager
def apart(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the 3D view for a while, then switch it to the viewer visible by then, unless the
    view shows another camera.
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
    """Switch the view to the chosen one of several viewers, unless it shows another camera."""
    views = looking_through.views(scene) if scene.kiriko_scene.looking else []
    viewer = viewer_of(scene)
    if not views or viewer is None or any(camera in (None, viewer) for _, camera in views):
        return
    with apart(scene):
        pass


def is_lost(scene: bpy.types.Scene) -> bool:
    """Whether a view's rig was deleted or its window closed."""
    if not scene.kiriko_scene.looking:
        return False
    window = _windows.get(scene.session_uid)  # None for a copied scene
    if window is not None and window not in [one.as_pointer() for one in all_windows()]:
        return True
    viewer = viewer_of(scene)
    if viewer is None or scene.objects.get(viewer.name) != viewer:
        return True
    return _rigs.get(scene.session_uid) not in (None, rig_uid(scene))


def leave(scene: bpy.types.Scene) -> None:
    """Restore everything. Live stops if this button started it."""
    looking_through.leave(scene)
    _forget(scene)


def _forget(scene: bpy.types.Scene) -> None:
    _entered.pop(scene.session_uid, None)
    _windows.pop(scene.session_uid, None)
    _rigs.pop(scene.session_uid, None)
    compared.put_views_back()  # views handed over by the comparison
    if scene.session_uid in _live_began:
        _live_began.remove(scene.session_uid)
        if live.follows(scene):
            live.stop()


def _show_comparison(scene: bpy.types.Scene) -> None:
    """Show the comparison in a view restored by undo; otherwise its pressed button would have no
    effect.
    """
    window = next((window for window in all_windows() if window.scene == scene), None)
    if window is not None and compared.is_shown(scene):
        with bpy.context.temp_override(window=window):
            compared.enter_view(bpy.context)


def follow() -> None:
    """Update views and settings after undo or a new file has changed the scenes' texts."""
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
    """Update views later: settings must not change before undo is over."""
    if (_entered or any(scenes())) and not bpy.app.timers.is_registered(follow):
        bpy.app.timers.register(follow, first_interval=0.0)


@persistent
def on_load(*_: object) -> None:
    """Restore the settings in a file saved without notice, for example by auto-save."""
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
    """Restore settings and views before a save, so that the file has the artist's own, or before
    another file is opened, which may leave views open.
    """
    for scene in list(scenes()):
        views, things = looking_through.views(scene), looking_through.things(scene)
        _paused[scene.session_uid] = scene.kiriko_scene.looking, views, things
        looking_through.leave(scene)
    _turned[:] = turned_views.pause()  # possibly the previous state of the views


@persistent
def go_on(*_: object) -> None:
    """Switch the view again after a save, or after a file failed to open."""
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
    """Start following undo and files."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Restore everything and stop following."""
    for scene in list(scenes()):
        leave(scene)
    if bpy.app.timers.is_registered(follow):
        bpy.app.timers.unregister(follow)
    work.stop_listening(HANDLERS)


def otherwise(scene: bpy.types.Scene) -> Message | None:
    """A sentence on glass that Cycles renders differently from Kiriko, from the last reading of
    Live; None if there is none.
    """
    followed = live.followed() if scene.kiriko_scene.looking and live.follows(scene) else None
    if followed is None or followed.problem or not followed.otherwise:
        return None
    return Message(
        "Cycles renders the glass differently ({reasons}). Before and After shows Kiriko's view.",
        reasons=joined(followed.otherwise, "; "),
    )


class KIRIKO_OT_look_through(bpy.types.Operator):
    """Show the viewer's view in Cycles, with Live on; press again to return"""

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
            reasons.insert(0, needed.NO_CYCLES)
        if view_of(context) is None:
            reasons.append(Message("Open a 3D view"))
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            scene = context.scene
            if scene.kiriko_scene.looking:
                leave(scene)
                if compared.is_shown(scene):
                    compared.enter_view(context)  # visible only in a view of its own
                return {"FINISHED"}

            enter(context)
            glasses = needed.parts(scene).get("GLASS", ())
            opaque = [thing.name for thing in glasses if make_glass.can_be_given(thing)]
            if opaque:  # short: the status bar cuts off long texts
                text = Message("{opaque} is opaque. Press Make It Glass.", opaque=quoted(opaque))
                reporting.report(self, "WARNING", text)
            return {"FINISHED"}
        return {"CANCELLED"}
