"""Objects and rigs of other files: what is set on them stays in this file only where they are
library overrides.
"""

from collections.abc import Iterable, Iterator

import bpy
from bpy.app.handlers import persistent

from ...base.errors import RigError
from .changes import change, value_of

OVERRIDE = {"LIBRARY_OVERRIDABLE"}
# one setting of each group that an object, and a rig's collection, has
OF_GROUPS = ("kiriko.role", "kiriko.plate.pitch", "kiriko.picture.gamma", "kiriko.display.gamma")
OF_RIG = (
    "kiriko.is_rig",
    "kiriko.picture.gamma",
    "kiriko.calibration.offset",
    "kiriko.result.notes",
)


def be_overridable(cls: type) -> None:
    """Have Blender keep all properties of a class on overrides, before it is registered."""
    for declared in cls.__annotations__.values():
        is_list = declared.function is bpy.props.CollectionProperty
        declared.keywords["override"] = OVERRIDE | ({"USE_INSERTION"} if is_list else set())


def overridden(
    scene: bpy.types.Scene, things: tuple[bpy.types.Object, ...]
) -> tuple[bpy.types.Object, ...]:
    """Objects of this file themselves, and library overrides in place of linked ones.

    Raises RigError where none can take an object's place, as in a collection that is linked, too.
    """
    made: dict[bpy.types.Object, bpy.types.Object] = {}
    for thing in things:
        if thing.library is None:
            continue

        override = thing.override_create(remap_local_usages=True)
        if override is not None:
            made[thing] = override
        shown = set(scene.objects)
        if override not in shown or thing in shown:
            take_away(made.values())
            raise RigError(
                "'{name}' is linked from another file. Make it a library override first (Object >"
                " Library Override > Make).",
                name=thing.name,
            )
    _use_overrides(scene, made.values())
    own = tuple(made.get(thing, thing) for thing in things)
    have_same_groups(own)
    return own


def _use_overrides(scene: bpy.types.Scene, new: Iterable[bpy.types.Object]) -> None:
    """Have new overrides use those of this scene that were made before them, as their parent and in
    modifiers and constraints: Blender has the others use the new ones.
    """
    ours = {
        one.override_library.reference: one
        for one in scene.objects
        if one.library is None and one.override_library is not None
    }
    for one in new:
        stays = one.matrix_parent_inverse.copy()  # where setting a parent clears it
        for owner in (one, *one.modifiers, *one.constraints):
            for name, used in _objects_of(owner):
                if used in ours:
                    setattr(owner, name, ours[used])
        one.matrix_parent_inverse = stays


def _objects_of(owner: bpy.types.bpy_struct) -> Iterator[tuple[str, bpy.types.Object]]:
    """Names of settings that are an object, and the objects."""
    for setting in owner.bl_rna.properties:
        if setting.type != "POINTER" or setting.is_readonly:
            continue
        used = getattr(owner, setting.identifier)
        if isinstance(used, bpy.types.Object):
            yield setting.identifier, used


def take_away(overrides: Iterable[bpy.types.Object]) -> None:
    """Have linked objects in place of overrides of them, selected and active as these are."""
    for one in overrides:
        theirs = one.override_library.reference
        layers = [layer for scene in one.users_scene for layer in scene.view_layers]
        selected = [layer for layer in layers if one.select_get(view_layer=layer)]
        active = [layer for layer in layers if layer.objects.active == one]
        one.override_library.destroy()
        for layer in selected:
            theirs.select_set(True, view_layer=layer)
        for layer in active:
            layer.objects.active = theirs


def have_same_groups(things: Iterable[bpy.types.Object | bpy.types.Collection]) -> None:
    """Have overrides and what they override have the same groups of settings: Blender 5 neither
    saves nor reloads the settings of a group that one of both alone has.
    """
    for thing in things:
        override = thing.override_library
        if override is None or override.reference is None or not thing.is_property_set("kiriko"):
            continue
        paths = OF_GROUPS if isinstance(thing, bpy.types.Object) else OF_RIG
        for one in (thing, override.reference):
            change(one, {path: value_of(one, path) for path in paths})
        if thing.library is None:
            _have_rules_of_settings(override, paths)


def _have_rules_of_settings(override: bpy.types.IDOverrideLibrary, paths: tuple[str, ...]) -> None:
    """Have an override name each setting instead of whole groups, which Blender cannot set: so it
    does while one of both alone has a group.
    """
    of_groups = {path.rpartition(".")[0] for path in paths}
    rules = [rule for rule in override.properties if rule.rna_path in of_groups]
    for rule in rules:
        override.properties.remove(rule)
    if rules:
        override.operations_update()


@persistent
def _on_files(*_: object) -> None:
    """What Blender reads of another file has no groups, each time anew."""
    have_same_groups([*bpy.data.objects, *bpy.data.collections])


def _handlers() -> list[list]:
    """Blender's lists for files; 4.2, which keeps all settings, has no last one."""
    names = ("save_pre", "load_post", "blend_import_post")
    return [getattr(bpy.app.handlers, name) for name in names if hasattr(bpy.app.handlers, name)]


def register() -> None:
    """Have overrides keep their settings whenever files are read and written."""
    for handlers in _handlers():
        handlers.append(_on_files)


def unregister() -> None:
    """Leave them alone again."""
    for handlers in _handlers():
        if _on_files in handlers:
            handlers.remove(_on_files)
