"""The image texture of a picture plane's material."""

from collections import deque
from dataclasses import dataclass

import bpy

from ...base.messages import Message
from ..data.moving import Timing, timing_of
from .material import Groups, feeding, material_output


@dataclass(frozen=True)
class Texture:
    """The image on a surface, its UV map ('' for the one used in renders), notes, and its timing if
    it moves.
    """

    image: bpy.types.Image
    uv_map: str
    notes: tuple[str, ...]
    timing: Timing


def read_texture(material: bpy.types.Material | None) -> Texture | None:
    """The image texture closest to a material's surface, colours before numbers; None if there is
    none.
    """
    node, groups, is_altered = find_texture(material) or (None, (), False)
    return None if node is None else texture_of(node, groups, material.name, is_altered)


def find_texture(
    material: bpy.types.Material | None, *, is_empty: bool = False
) -> tuple[bpy.types.Node, Groups, bool] | None:
    """The node of this texture, its groups, and whether other nodes change its colours.

    is_empty : look for a node without an image instead
    """
    output = material_output(material)
    if output is None:
        return None

    queue = deque([(output.inputs["Surface"], (), False)])
    visited = set()

    while queue:
        socket, groups, is_altered = queue.popleft()
        end, groups = feeding(socket, groups)
        if not end.is_output or (end.node, groups) in visited:
            continue

        node = end.node
        visited.add((node, groups))
        if node.type == "TEX_IMAGE" and (node.image is None) == is_empty:
            return node, groups, is_altered

        altered = is_altered or not any(s.type == "SHADER" for s in node.outputs)
        inputs = [s for s in node.inputs if s.enabled and s.type in {"SHADER", "RGBA"}]
        queue.extend((s, groups, altered) for s in inputs)

    return None


def texture_of(node: bpy.types.Node, groups: Groups, name: str, is_altered: bool) -> Texture:
    """The texture of an Image Texture node, with notes on ignored changes."""
    notes = []
    uv_map = ""

    if is_altered:
        notes.append(
            Message(
                "The material '{name}' changes the colours of '{image}'; Kiriko uses the plain"
                " image.",
                name=name,
                image=node.image.name,
            )
        )

    end, _ = feeding(node.inputs["Vector"], groups)
    if end.is_output and end.node.type == "UVMAP":
        uv_map = end.node.uv_map
    elif end.is_output and not (end.node.type == "TEX_COORD" and end.name == "UV"):
        notes.append(
            Message(
                "Nodes of the material '{name}' place '{image}'; Kiriko uses the plane's UV map.",
                name=name,
                image=node.image.name,
            )
        )

    return Texture(node.image.original, uv_map, tuple(notes), timing_of(node.image_user))
