"""Watch: tells when the scene is no longer the one that
the result was solved for, and when it is again. So it does of surfaces that were made for a rig.

Handlers only note that something may have changed. A timer of the application waits until nothing
has changed for a while and no work is under way, and then reads the scene as
`core/blender/result/scene_fingerprint.py` does, which puts no mesh into the world. Nothing is read
if there is no result and no such surface. Only numbers and session uids are remembered.
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
from ..core.blender.result.result_images import images_of, read_images_anew
from ..core.solve.solved_for import SolvedFor, from_text
from . import chosen, live, telling, windows, work
from . import outdated_surfaces as surfaces

CHANGED = Message("The scene has changed: solve again.")
QUIET = 0.4  # s without a change before the scene is read
TICK = 0.2  # s between two looks
# times as long as the last reading of its kind took it has to be quiet before the next one
SHARE = 5.0
# s after which an operator that only waits, as some add-ons' do, is no reason not to read
PATIENCE = 10.0


@dataclass(eq=False)
class Watched:
    """A scene that has a result, or a surface.

    verdicts : scenes that results were solved for, and rigs that surfaces were made for, as text,
        and whether they have changed since: of each rig's, by the last look while it was active
    changed_at : when the last change was noticed; None where all has been looked at
    lasted : s that the last reading took, where only places and settings had changed, and else
    """

    kept: ShapeCache = field(default_factory=ShapeCache)
    ours: frozenset[int] = frozenset()
    polled: chosen.Polled = field(default_factory=chosen.Polled)
    verdicts: dict[str, bool] = field(default_factory=dict)
    changed_at: float | None = field(default_factory=monotonic)
    lasted: dict[bool, float] = field(default_factory=dict)

    def poll(self, scene: bpy.types.Scene) -> None:
        """Compare the parts that Blender does not tell of: settings, and the result itself."""

        def read() -> tuple[object, ...]:
            made_for = surfaces.rigs_made_for(scene)
            return scene.kiriko.result.solved_for, made_for, chosen.chosen_settings(scene)

        if self.polled.have_changed(read):
            self.touch()

    def touch(self) -> None:
        """Something has changed that may count."""
        self.changed_at = monotonic()

    @property
    def is_due(self) -> bool:
        """Has it been quiet for long enough after a change?"""
        wait = max(QUIET, SHARE * self.lasted.get(self.kept.is_whole, 0.0))
        return self.changed_at is not None and monotonic() - self.changed_at >= wait


_watched: dict[int, Watched] = {}  # by session uid of the scene


def has_changed(context: bpy.types.Context, kept: ShapeCache | None = None) -> bool:
    """Is the scene, read now, another one than the result was solved for?

    A result that does not know its scene is taken as it is. A scene that
    cannot be read has changed, for when it was solved it could be read.
    """
    return is_another(context.scene.kiriko.result.solved_for, work.scene_now, context, kept)


def has_rig_changed(
    context: bpy.types.Context, made_for: str, kept: ShapeCache | None = None
) -> bool:
    """Is the rig, read now, another one than a surface was made for? As `has_changed`."""
    return is_another(made_for, work.rig_now, context, kept)


def is_another(
    text: str,
    now: Callable[[bpy.types.Context, ShapeCache | None], SolvedFor],
    context: bpy.types.Context,
    kept: ShapeCache | None,
) -> bool:
    """Is the scene another one than that of a fingerprint? No, where the text is no fingerprint."""
    before = from_text(text)
    if before is None:
        return False
    try:
        return not before.is_same(now(context, kept))
    except KirikoError:
        return True


def is_reported_changed(scene: bpy.types.Scene) -> bool:
    """The panels' verdict, by the last look.

    While Live follows the scene its results are of the scene as it is.
    """
    watched = _watched.get(scene.session_uid)
    if watched is None or is_followed(scene):
        return False
    return watched.verdicts.get(scene.kiriko.result.solved_for, False)


def is_reported_outdated(scene: bpy.types.Scene, name: str) -> bool:
    """The panels' verdict on a surface, by the last look: was it made for another rig?"""
    watched = _watched.get(scene.session_uid)
    made_for = surfaces.made_for(scene, name)
    return watched is not None and bool(made_for) and watched.verdicts.get(made_for, False)


def is_followed(scene: bpy.types.Scene) -> bool:
    """Does Live follow the scene, and can?"""
    return live.follows(scene) and not live.followed().problem


def tick() -> float:
    """Called by the timer."""
    try:
        check_result()
    except Exception as error:
        telling.sentence(
            error, Message("The scene check")
        )  # which prints errors that were not foreseen
        _watched.clear()
        return PATIENCE
    return TICK


def check_result() -> None:
    """Read one scene that is shown, has a result and may have changed; if it is time to."""
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
    """Is something at work or in the user's hands that reading the scene would hold up?"""
    shown = windows.all_windows()
    if work.is_busy() or any(window.screen.is_animation_playing for window in shown):
        return True
    is_held = any(len(window.modal_operators) for window in shown)
    return is_held and monotonic() - watched.changed_at < PATIENCE


def check(watched: Watched, window: bpy.types.Window) -> None:
    """Read the scene that a window shows, and compare."""
    with bpy.context.temp_override(window=window):
        context = bpy.context
        started = perf_counter()
        context.view_layer.update()
        watched.changed_at = None  # the change that the update above told of is in the reading
        is_short = watched.kept.is_whole
        result = context.scene.kiriko.result
        others = (rig.kiriko.result.solved_for for rig in rigs(context.scene))
        kept = {text: watched.verdicts[text] for text in others if text in watched.verdicts}
        verdicts = {**kept, result.solved_for: has_changed(context, watched.kept)}
        for text in surfaces.rigs_made_for(context.scene):
            verdicts[text] = has_rig_changed(context, text, watched.kept)
        context.view_layer.update()
        watched.changed_at = None  # this one told of what reading itself made and removed
        watched.lasted[is_short] = perf_counter() - started
    if verdicts != watched.verdicts:
        watched.verdicts = verdicts
        windows.redraw()


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Blender evaluated a change; whether it counts shows when the scene is read."""
    for watched in _watched.values():
        watched.kept.notice(depsgraph, watched.ours)
        watched.touch()


@persistent
def on_undo(*_: object) -> None:
    """Shapes and pixels that are kept may have been put back."""
    work.forget_written()
    for watched in _watched.values():
        watched.kept = ShapeCache()
        watched.touch()
    read_images_anew()


@persistent
def on_load(*_: object) -> None:
    """Another file, whose result is looked at anew: it is whole if its image was saved with it."""
    work.forget_written()
    for scene in bpy.data.scenes:
        source = scene.kiriko.result.source
        if source is not None and source.packed_file and not is_out_of_date(source):
            work.note_written(scene)
    _watched.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may stand elsewhere
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Begin to watch."""
    work.follow(tick, TICK, HANDLERS)


def unregister() -> None:
    """Watch no more."""
    work.stop_following(tick, HANDLERS)
    _watched.clear()
