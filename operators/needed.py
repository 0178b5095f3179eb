"""Parts of a rig that exist or are missing, and reasons why a button is disabled."""

from time import monotonic

import bpy

from ..core.base.messages import Message, as_sentence
from ..core.blender.checks.checklist import SINGLE, too_many
from ..core.blender.checks.inspect_scene import CHECKED, why_no_own_image, why_no_picture
from ..core.blender.data.bodies import NO_PART, bodiless, no_part
from ..core.blender.data.camera_viewer import instanced_viewers, is_deleted, own_images, viewer_of
from ..core.blender.data.rigs import active_rig, elsewhere, mark_of
from ..core.blender.data.visibility import VisibleObjects, instance_hidden_by, is_visible
from ..core.blender.lifecycle.rig_objects import PLATE_NAME
from ..core.blender.read.scene_parts import GLASS_REMEDY, LeftOut, hidden_words
from ..core.blender.result.result_images import is_missing_numbers
from ..core.rig.rig import ROLES
from ..languages import in_all
from .reporting import in_words

REMEDIES = {role.name: role.remedy for role in ROLES} | {"GLASS": GLASS_REMEDY}
NEEDED = {
    role.name: Message("No {noun}: {remedy}", noun=role.noun, remedy=REMEDIES[role.name])
    for role in ROLES
    if REMEDIES[role.name]
}
MISSED = {role.name for role in ROLES if role.is_missed}
NO_PLATE = Message("The rig's plate is missing: make a new one, or remove it from the rig")
NO_STRAY_LIGHT = Message(
    "Nothing to simulate, such as a plate, a half mirror or a pupil: use Preview"
)
UNSOLVED = Message("No source image yet: solve first")
NO_RIG = Message("Add a rig first")
NO_CYCLES = Message("Enable the add-on Cycles Render Engine")
NOTHING = Message("There is nothing to apply or remove")
NO_PLANE = Message("The picture is an image without a plane: set Picture to Plane")
NO_IMAGE = Message("No picture: choose an image, or set Picture to Plane")
LEAVE_EDIT_MODE = Message("Leave Edit Mode first")
LEAVE_SCULPT_MODE = Message("Leave Sculpt Mode first")
AT_WORK = Message("Kiriko is busy: wait, or press Esc")
COARSE = Message("The source image isn't final: press Solve, or let Live finish")
COMING = Message("Rough preview; still solving...")
NUMBERLESS = Message("The source image isn't final: press Solve, or let Live finish")
MEASURING = Message("Final image; still measuring...")
LINKED = Message("The scene is linked: open its file, or make it local")
LONG = 1e-3  # s: a slower search for a rig is not repeated at once
RESTING = 30.0  # pause, relative to the time of the search
_answers: dict[int, tuple[bool, float]] = {}  # by session uid of the scene, with an expiry time
# names of possible parts at the last complete search, by session uid of the scene
_met: dict[int, list[str]] = {}
Parts = dict[str, dict[bpy.types.Object, str]]  # by role, each with what hides it
MAKERS = {"NODES", "PARTICLE_SYSTEM"}  # modifiers that instance objects


def parts(scene: bpy.types.Scene, is_left_out: LeftOut | None = None) -> Parts:
    """Objects of the active rig by role, with what hides each ('' if visible).

    Objects of instanced collections are included; objects that can have no role are under NO_PART.

    is_left_out : predicate for objects to skip; None skips those of other rigs
    """
    things = [thing for thing in scene.objects if may_be_part(thing)]
    _met[scene.session_uid] = [thing.name for thing in things]
    return _parts_among(things, scene, is_left_out)


def the_picture(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object if it is this rig's picture, otherwise the rig's only one."""
    active = context.active_object
    is_picture = active is not None and active.kiriko.role == "PICTURE"
    if is_picture and not elsewhere(context.scene)(active):
        return active
    pictures = list(parts(context.scene).get("PICTURE", ()))
    return pictures[0] if len(pictures) == 1 else None


def parts_met(scene: bpy.types.Scene) -> Parts:
    """Visible parts among those of the last complete search, which is slow with thousands of
    objects.
    """
    layer = layer_of(scene)
    things = map(bpy.data.objects.get, _met.get(scene.session_uid, ()))
    return _parts_among([one for one in things if one and is_visible(one, layer)], scene)


def has_part(scene: bpy.types.Scene, role: str) -> bool:
    """Whether any part of the active rig has this role."""
    return role in parts_met(scene) or role in parts(scene)


def may_be_part(thing: bpy.types.Object) -> bool:
    """Whether an object has a role, or shows a collection whose objects may have one."""
    return thing.kiriko.role != "NONE" or thing.instance_collection is not None


def _parts_among(
    candidates: list[bpy.types.Object], scene: bpy.types.Scene, is_left_out: LeftOut | None = None
) -> Parts:
    is_left_out = is_left_out or elsewhere(scene)
    found: Parts = {}
    shown = VisibleObjects(scene, layer_of(scene))
    seen: set[tuple[bpy.types.Object, bool]] = set()
    todo = [(thing, True, "") for thing in candidates]
    while todo:
        thing, is_itself, by = todo.pop()
        if not may_be_part(thing):
            continue
        if is_itself and is_left_out(thing):
            continue

        by = by or (shown.hidden_by(thing) if is_itself else instance_hidden_by(thing))
        if (thing, not by) in seen:
            continue

        seen.add((thing, not by))
        if thing.kiriko.role != "NONE":
            role = NO_PART if bodiless(thing) else thing.kiriko.role
            things = found.setdefault(role, {})
            things[thing] = by and things.get(thing, by)  # one visible instance is enough

        if thing.instance_collection is not None:
            todo.extend((other, False, by) for other in thing.instance_collection.all_objects)

    return found


def has_rig(scene: bpy.types.Scene) -> bool:
    """Whether there is a part of a rig, or at least a result.

    Every panel asks at each mouse move. With a rig, one of the first objects answers; a slow answer
    among thousands of objects is cached for a while.
    """
    if scene.kiriko.result.source is not None:
        return True

    answer, until = _answers.get(scene.session_uid, (False, 0.0))
    if monotonic() < until:
        return answer

    started = monotonic()
    answer = any(thing.kiriko.role != "NONE" for thing in scene.objects) or any(
        other.kiriko.role != "NONE"
        for thing in scene.objects
        if thing.instance_collection is not None
        for other in thing.instance_collection.all_objects
    )
    lasted = monotonic() - started
    _answers[scene.session_uid] = answer, started + (RESTING * lasted if lasted > LONG else 0.0)
    return answer


def layer_of(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer in which a scene is edited."""
    return bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]


def missing(scene: bpy.types.Scene) -> list[str]:
    """One phrase for each part that is missing or hidden."""
    return list(missing_by_role(scene).values())


def _is_there(viewer: bpy.types.Object | None, scene: bpy.types.Scene) -> bool:
    """Whether a viewer is among a scene's objects.

    A deleted camera stays chosen, and the scene's own camera may be in another scene.
    """
    if viewer is None or is_deleted(viewer):
        return False
    if viewer == scene.camera or any(viewer == one for one, _ in instanced_viewers(scene)):
        return True
    # The name alone may find an object of another file.
    found = scene.objects.get(viewer.name)
    return found is not None and (viewer == found or bool(found.library or viewer.library))


def has_lost_plate(scene: bpy.types.Scene) -> bool:
    """Whether the plate of the active rig was deleted; with the role None it was only switched off.

    Its name is in the language of its creation.
    """
    rig = active_rig(scene)
    if rig is None or not rig.kiriko.has_plate:
        return False
    is_elsewhere = elsewhere(scene)
    names = [mark_of(thing) for thing in scene.objects if not is_elsewhere(thing)]
    return not any(plate in name for plate in in_all(PLATE_NAME) for name in names)


def missing_by_role(scene: bpy.types.Scene) -> dict[str, str]:
    """Missing parts by role, each with a phrase.

    Every button asks at each redraw. If the parts found last are complete, no other object can
    change the answer; a role that is missing when all of it is hidden has to be among them.
    """
    return missing_of(scene, _parts_to_report(scene))


def _parts_to_report(scene: bpy.types.Scene) -> Parts:
    """The parts found last if none is missing, otherwise all."""
    met = parts_met(scene)
    return met if met.keys() >= MISSED and not missing_of(scene, met) else parts(scene)


def missing_of(scene: bpy.types.Scene, found: Parts) -> dict[str, str]:
    """Missing parts of a rig whose parts were found."""
    ours = scene.kiriko
    there = {role for role, things in found.items() if not all(things.values())}
    if "SCREEN" in there:
        there.add("DISPLAY")
    # with several viewers, reading reports the missing one
    if len(ours.viewers) or _is_there(viewer_of(scene), scene):
        there.add("VIEWER")

    if not ours.only_through_glass:
        there.add("GLASS")

    phrases = {role: phrase for role, phrase in NEEDED.items() if role not in there}
    phrases |= {
        role: hidden_words(*next(iter(found[role].items())))
        for role in (*phrases, *(MISSED - there))
        if role in found
    }

    if "PLATE" not in found and has_lost_plate(scene):
        phrases["PLATE"] = NO_PLATE
    if ours.picture_source == "IMAGE":
        phrases.pop("PICTURE", None)
        if ours.picture_image is None and not own_images(scene):
            phrases["IMAGE"] = NO_IMAGE
        elif why := why_no_own_image(scene):
            phrases["IMAGE"] = why

    return phrases


def missing_parts(scene: bpy.types.Scene) -> list[str]:
    """Problems with parts: missing ones, surplus ones, and objects that cannot be parts.

    A part is not missing if modifiers may instance it from elsewhere in the file.
    """
    found = _parts_to_report(scene)
    phrases = missing_of(scene, found)
    if phrases and has_makers(scene):
        elsewhere = {thing.kiriko.role for thing in bpy.data.objects}
        phrases = {role: phrase for role, phrase in phrases.items() if role not in elsewhere}
    shown = {role: [one for one, by in things.items() if not by] for role, things in found.items()}
    doubled = [too_many(role, n) for role in SINGLE if (n := len(shown.get(role, ()))) > 1]
    return [*phrases.values(), *doubled, *map(no_part, shown.get(NO_PART, ()))]


def pictureless(scene: bpy.types.Scene) -> list[str]:
    """Reason why the picture's plane shows no picture."""
    planes = parts_met(scene).get("PICTURE", {})
    return [why for thing in planes if (why := why_no_picture(scene, thing))]


def edited(context: bpy.types.Context) -> bool:
    """Whether glass is in Edit Mode, so that its shape is unknown."""
    thing = context.active_object
    return thing is not None and thing.mode == "EDIT" and thing.kiriko.role in CHECKED


def sculpting(context: bpy.types.Context) -> list[str]:
    """Reason for an unknown shape during sculpting."""
    thing = context.active_object
    is_sculpted = thing is not None and thing.mode == "SCULPT" and thing.kiriko.role != "NONE"
    return [LEAVE_SCULPT_MODE] if is_sculpted else []


def no_stray_light(scene: bpy.types.Scene) -> list[str]:
    """Reason to disable Simulate if no part sends light astray."""
    is_split = any(thing.kiriko.element.reflects for thing in parts_met(scene).get("GLASS", ()))
    camera = viewer_of(scene)
    is_split |= camera is not None and (camera.kiriko.use_dof or camera.kiriko.pupil > 0)
    is_split |= any(has_part(scene, role) for role in ("PLATE", "HALF_MIRROR", "RETROREFLECTOR"))
    return [] if is_split or has_makers(scene) else [NO_STRAY_LIGHT]


def has_makers(scene: bpy.types.Scene) -> bool:
    """Whether any object has a modifier that may instance parts from elsewhere in the file."""
    return any(m.type in MAKERS for thing in scene.objects for m in thing.modifiers)


def linked(scene: bpy.types.Scene) -> list[str]:
    """Reason why a scene from another file cannot be changed."""
    return [] if scene.is_editable else [LINKED]


def unsolved(scene: bpy.types.Scene) -> list[str]:
    """Reason to disable functions of the source image if there is none."""
    result = scene.kiriko.result
    if result.source is None:
        return [UNSOLVED]
    if is_missing_numbers(result):
        return [NUMBERLESS]
    return [COARSE] if result.is_coarse else []


def can_run(operator: type[bpy.types.Operator], reasons: list[str]) -> bool:
    """Result of `poll`: whether there are no reasons against it; the first reason becomes the
    tooltip.

    Operators that change the scene, and can be undone, do not work in a scene of another file.
    """
    if "UNDO" in getattr(operator, "bl_options", ()):
        reasons = [*linked(bpy.context.scene), *reasons]
    if reasons:
        operator.poll_message_set(in_words(as_sentence(reasons[0])))
    return not reasons
