"""The record of a rig as it is made: its parts are marked,
and changes of things that were there before are kept.
"""

import json
from secrets import token_hex
from typing import Any

import bpy

from .changes import Change, change, put_back
from .kept import Changed

RIG_MARK = "kiriko_rig"  # on all that Add Rig makes: key of the rig, and the name it was given
KEPT_MARK = "kiriko_kept"  # on what a rig made and Kiriko itself, not the artist, keeps in the file


class Record:
    """Of the rig in a new collection. Changes are kept where Remove Rig will find them."""

    def __init__(self, collection: bpy.types.Collection) -> None:
        self.rig = collection.kiriko
        self.rig.key = token_hex(8)
        self._done: list[tuple[Any, Any, str, list[Change]]] = []

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

    def take_back(self) -> None:
        """Put everything back, as if there had been no rig."""
        while self._done:
            owner, keeper, before, changes = self._done.pop()
            put_back(owner, changes)
            keeper.changed = before

    def mark(self, made: list[bpy.types.ID]) -> None:
        """Mark datablocks as the rig's own."""
        for block in made:
            block[RIG_MARK] = json.dumps([self.rig.key, block.name])


def keep(block: bpy.types.ID) -> None:
    """Keep a datablock in the file that gives way to another one."""
    if RIG_MARK in block and not block.use_fake_user:
        block[KEPT_MARK] = True
    block.use_fake_user = True
