"""Datablocks missing from their library file, and their users. Blender substitutes empty
placeholders.
"""

from collections.abc import Iterable, Iterator

import bpy

from ...base.errors import RigError
from ...base.messages import Message, quoted

Lost = dict[bpy.types.ID, bpy.types.ID]


def find_lost() -> Lost:
    """A placeholder that each datablock of the file needs, directly or indirectly.

    An object needs its mesh, materials, modifiers, parents and instanced collection, but not the
    data of other objects.
    """
    if not bpy.data.libraries:
        return {}
    users = bpy.data.user_map()
    found: Lost = {}
    todo = [(one, one) for one in users if one.is_missing and one.id_type != "LIBRARY"]
    while todo:
        block, placeholder = todo.pop()
        if block in found:
            continue
        found[block] = placeholder
        is_whole_object = block.id_type == "OBJECT" and not block.is_missing
        for user in users[block] if block.id_type != "SCENE" else ():
            if not (is_whole_object and user.id_type == "OBJECT"):
                todo.append((user, placeholder))
    return found


def on_lost(lost: Lost, things: Iterable[bpy.types.ID | None]) -> Iterator[tuple[Message, str]]:
    """A sentence for each placeholder that some datablocks need, and the library's name."""
    needs: Lost = {}
    for thing in things:
        if thing in lost:
            needs.setdefault(lost[thing], thing)
    for placeholder, thing in needs.items():
        name = quoted([placeholder.name])
        if thing.name != placeholder.name:
            name = Message("'{part}' of '{name}'", part=placeholder.name, name=thing.name)
        text = Message(
            "{name} is missing from the library '{file}'. Restore the file, or relocate the"
            " library (Outliner > Blender File).",
            name=name,
            file=bpy.path.abspath(placeholder.library.filepath),
        )
        yield text, placeholder.library.name


def refuse_lost(lost: Lost, things: Iterable[bpy.types.ID | None]) -> None:
    """Raise RigError for the first datablock with a missing one."""
    for text, _ in on_lost(lost, things):
        raise RigError(text.template, **text.values)


def placeholders_of(scene: bpy.types.Scene) -> list[bpy.types.ID]:
    """Placeholders among a scene's objects and collections: any of them may have had a role."""
    return [one for one in (*scene.objects, *scene.collection.children_recursive) if one.is_missing]
