"""Linked objects and rigs: settings on them last in this file only through library overrides."""

from collections.abc import Iterable, Iterator

import bpy
from bpy.app.handlers import persistent

from ...base.errors import RigError
from .changes import change, value_of

OVERRIDE = {"LIBRARY_OVERRIDABLE"}
# one setting of each group of an object, and of a rig's collection
OF_GROUPS = (
    "kiriko.role",
    "kiriko.plate.pitch",
    "kiriko.element.reflectance",
    "kiriko.picture.gamma",
    "kiriko.display.gamma",
    "kiriko.views.overlap",
)
OF_RIG = (
    "kiriko.is_rig",
    "kiriko.picture.gamma",
    "kiriko.calibration.offset",
    "kiriko.result.notes",
)


def be_overridable(cls: type) -> None:
    """Make all properties of a class overridable, before it is registered."""
    for declared in cls.__annotations__.values():
        is_list = declared.function is bpy.props.CollectionProperty
        declared.keywords["override"] = OVERRIDE | ({"USE_INSERTION"} if is_list else set())


def overridden(
    scene: bpy.types.Scene, things: tuple[bpy.types.Object, ...]
) -> tuple[bpy.types.Object, ...]:
    """Local objects themselves, and library overrides in place of linked ones.

    Raises RigError if an object cannot be replaced, as in a linked collection.
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
    """Have new overrides use this scene's earlier ones as parent and in modifiers and constraints;
    Blender itself only redirects earlier ones to new ones.
    """
    ours = {
        one.override_library.reference: one
        for one in scene.objects
        if one.library is None and one.override_library is not None
    }
    for one in new:
        stays = one.matrix_parent_inverse.copy()  # setting a parent may clear it
        for owner in (one, *one.modifiers, *one.constraints):
            for name, used in _objects_of(owner):
                if used in ours:
                    setattr(owner, name, ours[used])
        one.matrix_parent_inverse = stays


def _objects_of(owner: bpy.types.bpy_struct) -> Iterator[tuple[str, bpy.types.Object]]:
    """Names and values of an owner's object settings."""
    for setting in owner.bl_rna.properties:
        if setting.type != "POINTER" or setting.is_readonly:
            continue
        used = getattr(owner, setting.identifier)
        if isinstance(used, bpy.types.Object):
            yield setting.identifier, used


def take_away(overrides: Iterable[bpy.types.Object]) -> None:
    """Replace overrides by their linked objects, with the same selection."""
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
    """Give overrides and their originals the same groups of settings. If only one of both has a
    group, Blender 5 neither saves nor reloads its settings.
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
    """Have an override name each setting instead of whole groups, which Blender cannot apply: it
    does so if only one side has a group.
    """
    of_groups = {path.rpartition(".")[0] for path in paths}
    rules = [rule for rule in override.properties if rule.rna_path in of_groups]
    for rule in rules:
        override.properties.remove(rule)
    if rules:
        override.operations_update()


@persistent
def _on_files(*_: object) -> None:
    """Data that Blender reads from another file has no groups, each time again."""
    have_same_groups([*bpy.data.objects, *bpy.data.collections])


def _handlers() -> list[list]:
    """Blender's handlers for files; 4.2, which keeps all settings, lacks the last one."""
    names = ("save_pre", "load_post", "blend_import_post")
    return [getattr(bpy.app.handlers, name) for name in names if hasattr(bpy.app.handlers, name)]


def register() -> None:
    """Preserve settings of overrides whenever files are read and written."""
    for handlers in _handlers():
        handlers.append(_on_files)


def unregister() -> None:
    """Remove the handlers."""
    for handlers in _handlers():
        if _on_files in handlers:
            handlers.remove(_on_files)
