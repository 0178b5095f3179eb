"""Shows a hidden object: switches on whatever hides it, and nothing else."""

from collections.abc import Iterator

import bpy
from bpy_extras import anim_utils

from ..base.errors import RigError
from ..base.messages import Message
from .visibility import Shown, ways_to

Switch = tuple[bpy.types.bpy_struct, str, str]  # its owner, its name, the words for it

IS_ON = 1e-6  # a curve this close to 1 switches on, as Blender rounds


def show(
    thing: bpy.types.Object, scene: bpy.types.Scene, layer: bpy.types.ViewLayer
) -> list[Message]:
    """Show an object in viewport and renders; returns what was switched on.

    Of several collections that hold it, those are opened in which the fewest are closed. An object
    that is shown only as an instance is shown by whatever makes the instance.

    Raises
    ------
    RigError : it stays hidden, since it is linked or driven, or is hidden again by its animation;
        everything is as it was
    """
    before: list[tuple[bpy.types.bpy_struct, str, bool]] = []
    words: list[Message] = []
    try:
        for shown in _to_show(thing, scene):
            _refuse_animated(shown, scene)
            for owner, name, text in [*_of_collections(shown, layer), *_of_object(shown)]:
                before.append((owner, name, True))
                setattr(owner, name, False)
                words.append(text)
            words += _open_eye(shown, layer, before)

        layer.update()
        by = Shown(scene, layer).hidden_by(thing)
        if by:
            raise RigError(
                "'{name}' stays hidden{by}: it is linked from another file, or driven.",
                name=thing.name,
                by=by,
            )
    except BaseException:
        for owner, name, value in reversed(before):
            if name == "":
                owner.hide_set(value, view_layer=layer)
            else:
                setattr(owner, name, value)
        layer.update()
        raise

    return words


def _refuse_animated(thing: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Raise RigError for an object that its keyframes hide in this frame: they would hide it again
    when it is rendered, or another frame is shown.
    """
    frame = scene.frame_current_final
    for path in ("hide_viewport", "hide_render"):
        value, strip = _animated(thing, path, frame)
        if value < 1 - IS_ON:
            continue
        if strip is not None:
            raise RigError(
                "'{name}' stays hidden, for the strip '{strip}' of its nonlinear animation hides it"
                " in frame {frame}: mute the strip, or go to a frame in which it is shown.",
                name=thing.name,
                strip=strip.name,
                frame=f"{frame:g}",
            )
        raise RigError(
            "'{name}' stays hidden, for its keyframes hide it in frame {frame}: delete the"
            " keyframes of its monitor or camera symbol, or go to a frame in which it is shown.",
            name=thing.name,
            frame=f"{frame:g}",
        )


def _animated(
    thing: bpy.types.Object, path: str, frame: float
) -> tuple[float, bpy.types.NlaStrip | None]:
    """The value that animation gives a property in a frame, 0 where it does not, and the strip that
    gives it: None where it is the object's own action, which goes over all strips.
    """
    data = thing.animation_data
    if data is None:
        return 0.0, None
    for curve in _curves(data.action, getattr(data, "action_slot", None)):
        if curve.data_path == path and not curve.mute:
            return curve.evaluate(frame), None

    tracks = list(data.nla_tracks) if data.use_nla else []
    alone = [track for track in tracks if track.is_solo]
    for track in reversed(alone or [track for track in tracks if not track.mute]):
        strip, time = _strip_at(track, frame)
        if strip is None or strip.mute:
            continue
        for curve in _curves(strip.action, getattr(strip, "action_slot", None)):
            if curve.data_path == path and not curve.mute:
                return curve.evaluate(time), strip
    return 0.0, None


def _strip_at(track: bpy.types.NlaTrack, frame: float) -> tuple[bpy.types.NlaStrip | None, float]:
    """The strip of a track that acts in a frame, and its action's frame then.

    A strip may hold its last value until the next one, and the first one its first value before.
    """
    strips = [strip for strip in track.strips if strip.type == "CLIP"]
    before = [strip for strip in strips if strip.frame_start <= frame]
    if not before:
        first = strips[0] if strips and strips[0].extrapolation == "HOLD" else None
        return first, 0.0 if first is None else _action_frame(first, first.frame_start)
    within = [strip for strip in before if frame <= strip.frame_end]
    last = (within or before[::-1])[0]
    if frame > last.frame_end and last.extrapolation == "NOTHING":
        return None, 0.0
    return last, _action_frame(last, min(frame, last.frame_end))


def _action_frame(strip: bpy.types.NlaStrip, frame: float) -> float:
    """The frame of a strip's action in a frame of the scene within the strip."""
    if strip.use_animated_time:
        return strip.strip_time
    start, end = strip.action_frame_start, strip.action_frame_end
    length = (end - start) * strip.scale
    done = frame - strip.frame_start
    turns = done / length if length else 0.0
    # at the very end of whole repeats it is at its end, and not at its start again
    is_at_end = turns > 0 and abs(turns - round(turns)) < IS_ON and frame >= strip.frame_end - IS_ON
    along = end - start if is_at_end else (done % length) / strip.scale if length else 0.0
    return end - along if strip.use_reverse else start + along


def _curves(
    action: bpy.types.Action | None, slot: "bpy.types.ActionSlot | None"
) -> list[bpy.types.FCurve]:
    """The curves of an action, or of its part for one user."""
    if action is None:
        return []
    if bpy.app.version < (5, 0):
        return list(action.fcurves)
    found = anim_utils.action_get_channelbag_for_slot(action, slot) if slot is not None else None
    return [] if found is None else list(found.fcurves)


def _to_show(thing: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The object, and where it is in the scene as an instance alone also what makes that."""
    if thing.name not in scene.objects or scene.objects[thing.name] != thing:
        for maker in scene.objects:
            collection = maker.instance_collection
            if collection is not None and thing in set(collection.all_objects):
                yield from _to_show(maker, scene)
    yield thing


def _of_object(thing: bpy.types.Object) -> Iterator[Switch]:
    """The switches of its own that hide an object."""
    if thing.hide_viewport:
        yield thing, "hide_viewport", Message("its monitor symbol is on")
    if thing.hide_render:
        yield thing, "hide_render", Message("its camera symbol is on")


def _open_eye(
    thing: bpy.types.Object, layer: bpy.types.ViewLayer, before: list
) -> Iterator[Message]:
    """Open an object's eye, which it has in the view layer, once it is in there."""
    layer.update()
    if thing in set(layer.objects) and thing.hide_get(view_layer=layer):
        before.append((thing, "", True))
        thing.hide_set(False, view_layer=layer)
        yield Message("its eye symbol is on")


def _of_collections(thing: bpy.types.Object, layer: bpy.types.ViewLayer) -> list[Switch]:
    """The switches of collections that hide an object, along the way with the fewest."""
    ways = [list(_of_way(way)) for way in ways_to(thing, layer.layer_collection)]
    return min(ways, key=len, default=[])


def _of_way(way: tuple[bpy.types.LayerCollection, ...]) -> Iterator[Switch]:
    """The switches that hide what is in the last of a chain of collections."""
    for level in way:
        name = level.collection.name
        if level.exclude:
            yield (
                level,
                "exclude",
                Message("the collection '{name}' is in the view layer", name=name),
            )
        if level.hide_viewport:
            yield level, "hide_viewport", Message("the eye of '{name}' is on", name=name)
        if level.collection.hide_viewport:
            yield (
                level.collection,
                "hide_viewport",
                Message("the monitor symbol of '{name}' is on", name=name),
            )
        if level.collection.hide_render:
            yield (
                level.collection,
                "hide_render",
                Message("the camera symbol of '{name}' is on", name=name),
            )
