"""Temporary data of a preview."""

from typing import Any

import bpy

TEMPORARY = "kiriko_temporary"  # marks such data


def mark(block: Any) -> Any:
    """Mark a datablock as a preview's own."""
    block[TEMPORARY] = True
    return block


def remove_leftovers() -> None:
    """Remove everything made by a preview, also by an interrupted one."""
    for group in ("scenes", "objects", "cameras", "meshes", "materials", "node_groups", "images"):
        blocks = [block for block in getattr(bpy.data, group) if block.get(TEMPORARY)]
        if blocks:
            bpy.data.batch_remove(blocks)
