"""Has a scene any light but its display's?"""

import bpy

from .visibility import is_visible


def is_dark(scene: bpy.types.Scene) -> bool:
    """Are there no lights, and is the world black? Objects that shine are not asked."""
    if any(thing.type == "LIGHT" and is_visible(thing) for thing in scene.objects):
        return False
    return scene.world is None or _is_black(scene.world)


def _is_black(world: bpy.types.World) -> bool:
    """Does a world give no light? One that is made of more nodes than a background may."""
    has_nodes = bpy.app.version >= (5, 0) or world.use_nodes
    if not has_nodes or world.node_tree is None:
        return not any(world.color)

    output = world.node_tree.get_output_node("CYCLES")
    links = () if output is None else output.inputs["Surface"].links
    if not links:
        return True
    node = links[0].from_node
    if node.type != "BACKGROUND":
        return False

    color, strength = node.inputs["Color"], node.inputs["Strength"]
    is_off = not strength.is_linked and strength.default_value == 0
    return is_off or (not color.is_linked and not any(color.default_value[:3]))
