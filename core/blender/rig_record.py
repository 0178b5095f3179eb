"""The record of a rig as it is made: its parts are marked,
and changes of things that were there before are kept.
"""

from secrets import token_hex
from typing import Any

import bpy

from .active_rig import begin, keep_as, replace
from .changes import Change, change, put_back
from .rigs import RIG_MARK, active_rig, is_copy, let_go, mark, take_in
from .stored_records import Changed
from .viewer_list import bring_back, have_viewer, set_aside

OF_GLASS = ("rigs", "taken_as", "changed")  # marks of an object that a rig has taken in
KEPT_MARK = "kiriko_kept"  # on what a rig made and Kiriko itself, not the artist, keeps in the file


class Record:
    """Of the rig in a new collection. Changes are kept where Remove Rig will find them."""

    def __init__(self, scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
        self._scene, self._collection = scene, collection
        self._before, self._key = active_rig(scene), scene.kiriko.rig
        self.rig = collection.kiriko
        self.rig.key = token_hex(8)
        self._done: list[tuple[Any, Any, str, list[Change]]] = []
        self._taken: list[tuple[bpy.types.Object, dict[str, str]]] = []
        self._has_viewers = True

        # the first rig takes the scene's settings as they are
        if self._before is not None:
            keep_as(scene, self._before.kiriko.key)
            begin(scene, collection)
        elif scene.kiriko.is_of_rig:  # of one whose collection is gone
            keep_as(scene, self._key)
            replace(scene, None)
        scene.kiriko.rig = self.rig.key

    def take_in(self, thing: bpy.types.Object) -> None:
        """Have an object of the artist's be a part of the rig. A copy of
        glass leaves the rig of that glass.
        """
        ours = thing.kiriko
        self._taken.append((thing, {name: getattr(ours, name) for name in OF_GLASS}))
        if is_copy(self._scene, thing):
            ours.rigs = ""
            if ours.changed:
                ours.changed = Changed(self.rig.key, Changed.read(ours.changed).changes).text()
        take_in(thing, self._collection)

    def change(self, owner: bpy.types.ID, values: dict[str, Any]) -> None:
        """Give settings of an object, a material or the scene other values, by their paths."""
        has_own = isinstance(owner, bpy.types.Object | bpy.types.Material)
        keeper = owner.kiriko if has_own else self.rig
        before = keeper.changed
        changes = change(owner, values)
        self._done.append((owner, keeper, before, changes))

        # an earlier rig that is gone may have left its own
        kept = Changed.read(before).changes
        if changes:
            keeper.changed = Changed(self.rig.key, [*kept, *map(list, changes)]).text()

    def add_view(self, screen: str, changes: list[Change]) -> None:
        """Note changes of a 3D view, which are made already."""
        kept = Changed.read(self.rig.views).changes
        added = [[screen, *one] for one in changes]
        if added:
            self.rig.views = Changed(self.rig.key, [*kept, *added]).text()

    def set_viewers_aside(self) -> None:
        """Have the scene have no viewers, until the rig goes: they may not see it."""
        set_aside(self._scene)
        self._has_viewers = False

    def take_back(self) -> None:
        """Put everything back, as if there had been no rig."""
        if not self._has_viewers:
            have_viewer(self._scene.kiriko, self._scene.kiriko.viewer_before)
            bring_back(self._scene)
        while self._done:
            owner, keeper, before, changes = self._done.pop()
            put_back(owner, changes)
            keeper.changed = before

        for thing, before in self._taken:
            let_go(thing, self._collection)
            for name, value in before.items():
                if value:
                    setattr(thing.kiriko, name, value)
        if self._before is not None:
            replace(self._scene, self._before)
        if self._key:
            self._scene.kiriko.rig = self._key
        else:
            self._scene.kiriko.property_unset("rig")

    def mark(self, made: list[bpy.types.ID]) -> None:
        """Mark datablocks as the rig's own."""
        mark_made(made, self._collection)


def mark_made(made: list[bpy.types.ID], rig: bpy.types.Collection) -> None:
    """Mark datablocks as those of a rig."""
    for block in made:
        mark(block, rig.kiriko.key)


def keep(block: bpy.types.ID) -> None:
    """Keep a datablock in the file that gives way to another one."""
    if RIG_MARK in block and not block.use_fake_user:
        block[KEPT_MARK] = True
    block.use_fake_user = True
