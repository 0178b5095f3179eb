"""Data that must not outlive a preview."""

from typing import Any

import bpy

TEMPORARY = "kiriko_temporary"  # marks such data


def mark(block: Any) -> Any:
    """Note that a datablock is a preview's own."""
    block[TEMPORARY] = True
    return block


def remove_leftovers() -> None:
    """Remove everything a preview made, also of one that was cut short."""
    for group in ("scenes", "objects", "cameras", "meshes", "materials", "node_groups", "images"):
        blocks = [block for block in getattr(bpy.data, group) if block.get(TEMPORARY)]
        if blocks:
            bpy.data.batch_remove(blocks)
