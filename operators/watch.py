"""Watches whether the scene still matches its result, and surfaces their rig.

Handlers only note a possible change. A timer waits until nothing has changed for a while and no
work is under way, then reads the scene like `core/blender/result/scene_fingerprint.py`, which
transforms no mesh. Nothing is read without a result or a surface. Only numbers and session uids are
stored.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic, perf_counter

import bpy
from bpy.app.handlers import persistent

from ..core.base.errors import KirikoError
from ..core.base.messages import Message
from ..core.blender.data.image import is_out_of_date
from ..core.blender.data.rigs import rigs
from ..core.blender.read.shapes import ShapeCache
from ..core.blender.result.result_images import images_of, read_images_again
from ..core.solve.solved_for import SolvedFor, from_text
from . import chosen, live, reporting, windows, work
from . import outdated_surfaces as surfaces

CHANGED = Message("The scene has changed: solve again.")
QUIET = 0.4  # s without a change before the scene is read
TICK = 0.2  # s between checks
# required quiet time, relative to the last reading of its kind
SHARE = 5.0
# s after which an operator that only waits, as in some add-ons, no longer prevents reading
PATIENCE = 10.0


@dataclass(eq=False)
class Watched:
    """A scene with a result or a surface.

    verdicts : by the text of a result's scene or a surface's rig, whether it has changed since; as
        last checked while the rig was active
    changed_at : time of the last noticed change; None once checked
    lasted : s of the last reading, if only places and settings had changed, and otherwise
    """

    shapes: ShapeCache = field(default_factory=ShapeCache)
    ours: frozenset[int] = frozenset()
    polled: chosen.Polled = field(default_factory=chosen.Polled)
    verdicts: dict[str, bool] = field(default_factory=dict)
    changed_at: float | None = field(default_factory=monotonic)
    lasted: dict[bool, float] = field(default_factory=dict)

    def poll(self, scene: bpy.types.Scene) -> None:
        """Poll what Blender does not report: settings, and the result itself."""

        def read() -> tuple[object, ...]:
            made_for = surfaces.rigs_made_for(scene)
            return scene.kiriko.result.solved_for, made_for, chosen.chosen_settings(scene)

        if self.polled.have_changed(read):
            self.touch()

    def touch(self) -> None:
        """Note a change that may matter."""
        self.changed_at = monotonic()

    @property
    def is_due(self) -> bool:
        """Whether it has been quiet for long enough after a change."""
        wait = max(QUIET, SHARE * self.lasted.get(self.shapes.is_whole, 0.0))
        return self.changed_at is not None and monotonic() - self.changed_at >= wait


_watched: dict[int, Watched] = {}  # by session uid of the scene


def has_changed(context: bpy.types.Context, shapes: ShapeCache | None = None) -> bool:
    """Whether the scene, read now, differs from the one the result was solved for.

    A result without a record counts as current. A scene that cannot be read has changed.
    """
    return is_another(context.scene.kiriko.result.solved_for, work.scene_now, context, shapes)


def has_rig_changed(
    context: bpy.types.Context, made_for: str, shapes: ShapeCache | None = None
) -> bool:
    """Whether the rig, read now, differs from the one a surface was made for; like
    `has_changed`.
    """
    return is_another(made_for, work.rig_now, context, shapes)


def is_another(
    text: str,
    now: Callable[[bpy.types.Context, ShapeCache | None], SolvedFor],
    context: bpy.types.Context,
    shapes: ShapeCache | None,
) -> bool:
    """Whether the scene differs from a fingerprint; False if the text is not a fingerprint."""
    before = from_text(text)
    if before is None:
        return False
    try:
        return not before.is_same(now(context, shapes))
    except KirikoError:
        return True


def is_reported_changed(scene: bpy.types.Scene) -> bool:
    """Verdict for panels, from the last check.

    While Live follows the scene, its results are current.
    """
    watched = _watched.get(scene.session_uid)
    if watched is None or is_followed(scene):
        return False
    return watched.verdicts.get(scene.kiriko.result.solved_for, False)


def is_reported_outdated(scene: bpy.types.Scene, name: str) -> bool:
    """Verdict on a surface for panels, from the last check."""
    watched = _watched.get(scene.session_uid)
    made_for = surfaces.made_for(scene, name)
    return watched is not None and bool(made_for) and watched.verdicts.get(made_for, False)


def is_followed(scene: bpy.types.Scene) -> bool:
    """Whether Live follows the scene without a problem."""
    return live.follows(scene) and not live.followed().problem


def tick() -> float:
    """Timer callback."""
    try:
        check_result()
    except Exception as error:
        reporting.sentence(error, Message("The scene check"))  # prints unexpected errors
        _watched.clear()
        return PATIENCE
    return TICK


def check_result() -> None:
    """Read one visible scene with a result that may have changed, if it is time."""
    shown = {window.scene.session_uid: window for window in reversed(windows.all_windows())}
    for gone in set(_watched) - set(shown):
        del _watched[gone]

    for uid, window in shown.items():
        scene = window.scene
        result = scene.kiriko.result
        is_solved = result.source is not None and result.solved_for
        if not is_solved and not surfaces.rigs_made_for(scene):
            _watched.pop(uid, None)
            continue

        watched = _watched.setdefault(uid, Watched())
        watched.ours = frozenset(map(chosen.uid, images_of(result)))
        watched.poll(scene)

        if watched.is_due and not is_followed(scene) and not is_busy(watched):
            check(watched, window)
            return


def is_busy(watched: Watched) -> bool:
    """Whether work or the user would be held up by reading the scene."""
    shown = windows.all_windows()
    if work.is_busy() or any(window.screen.is_animation_playing for window in shown):
        return True
    is_held = any(len(window.modal_operators) for window in shown)
    return is_held and monotonic() - watched.changed_at < PATIENCE


def check(watched: Watched, window: bpy.types.Window) -> None:
    """Read the scene of a window, and compare."""
    with bpy.context.temp_override(window=window):
        context = bpy.context
        started = perf_counter()
        context.view_layer.update()
        watched.changed_at = None  # the reading includes the change that triggered it
        is_short = watched.shapes.is_whole
        result = context.scene.kiriko.result
        others = (rig.kiriko.result.solved_for for rig in rigs(context.scene))
        unchanged = {text: watched.verdicts[text] for text in others if text in watched.verdicts}
        verdicts = {**unchanged, result.solved_for: has_changed(context, watched.shapes)}
        for text in surfaces.rigs_made_for(context.scene):
            verdicts[text] = has_rig_changed(context, text, watched.shapes)
        context.view_layer.update()
        watched.changed_at = None  # triggered by objects that reading itself made and removed
        watched.lasted[is_short] = perf_counter() - started
    if verdicts != watched.verdicts:
        watched.verdicts = verdicts
        windows.redraw()


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note a change evaluated by Blender; reading decides whether it matters."""
    for watched in _watched.values():
        watched.shapes.notice(depsgraph, watched.ours)
        watched.touch()


@persistent
def on_undo(*_: object) -> None:
    """Handle undo, which may restore cached shapes and pixels."""
    work.forget_written()
    for watched in _watched.values():
        watched.shapes = ShapeCache()
        watched.touch()
    read_images_again()


@persistent
def on_load(*_: object) -> None:
    """Handle another file: its result is complete if its image was saved with it."""
    work.forget_written()
    for scene in bpy.data.scenes:
        source = scene.kiriko.result.source
        if source is not None and source.packed_file and not is_out_of_date(source):
            work.note_written(scene)
    _watched.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may have moved
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Start watching."""
    work.follow(tick, TICK, HANDLERS)


def unregister() -> None:
    """Stop watching."""
    work.stop_following(tick, HANDLERS)
    _watched.clear()
