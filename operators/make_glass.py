"""Make It Glass: give glass a refractive material."""

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message, as_message, joined, quoted
from ..core.blender.checks.inspect_scene import (
    has_own_faces,
    materials_as_shown,
    refracts_as_shown,
)
from ..core.blender.lifecycle.given_glass import give, has_place, set_by_modifier
from ..core.blender.view.viewport_look import be_seen_as_glass
from ..core.rig.catalogue import GLASSES
from . import needed, reporting
from .part_verbs import NamesPart

NAME = "Kiriko Glass"
NOTHING = Message("Select opaque glass")
GLASS_TIPS = {
    name: Message("Index of refraction {ior:g}", ior=product.ior)
    for name, product in GLASSES.items()
}


def can_be_given(thing: bpy.types.Object) -> bool:
    """Whether an object is glass without a refractive material, and can get another one."""
    is_glass = thing.kiriko.role == "GLASS" and thing.is_editable and has_place(thing)
    scene = bpy.context.scene
    return is_glass and not refracts_as_shown(scene, thing) and has_own_faces(scene, thing)


def _chosen(context: bpy.types.Context) -> list[bpy.types.Object]:
    things = dict.fromkeys([context.active_object, *context.selected_objects])
    return [thing for thing in things if thing is not None and can_be_given(thing)]


def _is_any(scene: bpy.types.Scene) -> bool:
    return any(map(can_be_given, needed.parts(scene).get("GLASS", ())))


def _setting_their_own(
    context: bpy.types.Context, things: list[bpy.types.Object]
) -> dict[bpy.types.Object, list[bpy.types.Modifier]]:
    """The active modifiers of objects whose modifiers assign other materials than the slots, by
    object.
    """
    context.view_layer.update()
    return {
        thing: [one for one in thing.modifiers if one.show_viewport]
        for thing in things
        if not refracts_as_shown(context.scene, thing)
    }


def make_glass(context: bpy.types.Context, things: list[bpy.types.Object], product: str) -> Message:
    """Give objects the clear material of a product: one for those with the same materials before,
    else each its own. Returns the report.
    """
    before: dict[tuple, list[bpy.types.Object]] = {}
    for thing in things:
        shown = tuple(materials_as_shown(context.scene, thing))
        before.setdefault(shown or (thing,), []).append(thing)

    texts = [_give_one(context, alike, product) for alike in before.values()]
    result = context.scene.kiriko.result
    prefixes = tuple(
        Message("The material of '{name}' isn't glass", name=thing.name) for thing in things
    )
    result.notes = "\n".join(
        note for note in result.notes.splitlines() if not note.startswith(prefixes)
    )
    return joined(texts)


def _give_one(context: bpy.types.Context, things: list[bpy.types.Object], product: str) -> Message:
    """Give objects one new material. Returns the report."""
    glass, ior = bpy.data.materials.new(NAME), GLASSES[product].ior
    try:
        be_seen_as_glass(glass, ior)
    except BaseException:
        bpy.data.materials.remove(glass)
        raise

    for thing in things:
        give(thing, glass)
    own = _setting_their_own(context, things)
    for thing in own:
        set_by_modifier(thing, glass)
    text = Message(
        "{names}: now {product}, index {ior:g} (material '{glass}').",
        names=quoted(thing.name for thing in things),
        product=as_message(product),
        ior=ior,
        glass=glass.name,
    )
    return joined([text, Message("A new modifier assigns it.")]) if own else text


class KIRIKO_OT_make_glass(NamesPart, bpy.types.Operator):
    """Give the glass a clear material; Remove Rig restores the original one"""

    bl_idname = "kiriko.make_glass"
    bl_label = "Make It Glass"
    bl_options = {"REGISTER", "UNDO"}

    product: bpy.props.EnumProperty(
        name="Product",
        items=[(name, name, tip) for name, tip in GLASS_TIPS.items()],
        default="Acrylic",  # the index assumed for opaque glass: results do not change
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = _chosen(context) or _is_any(context.scene)
        return needed.can_run(cls, [] if is_there else [NOTHING])

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            things = [self.found(context)] if self.part else _chosen(context)
            if not things or not all(map(can_be_given, things)):
                raise RigError("{reason}.", reason=NOTHING)

            text = make_glass(context, things, self.product)
            reporting.report(self, "INFO", text)

            return {"FINISHED"}

        return {"CANCELLED"}
