"""Reads materials: the index of refraction, nodes that are
not followed, and the image of a picture plane.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy

from ..messages import Message
from .moving import Timing, timing_of

REFRACTIVE = {
    "BSDF_GLASS": "Glass BSDF",
    "BSDF_REFRACTION": "Refraction BSDF",
    "BSDF_PRINCIPLED": "Principled BSDF",
}
# inputs that are not followed: what a sentence calls each, and the value at which it does nothing
NEUTRAL = {
    "Roughness": (Message("roughness"), 0.0),
    "Metallic": (Message("metallic"), 0.0),
    "Alpha": (Message("alpha"), 1.0),
    "Transmission Weight": (Message("transmission weight"), 1.0),
    "Subsurface Weight": (Message("subsurface weight"), 0.0),
    "Coat Weight": (Message("coat weight"), 0.0),
    "Sheen Weight": (Message("sheen weight"), 0.0),
    "Emission Strength": (Message("emission strength"), 0.0),
    "Thin Film Thickness": (Message("thin film thickness"), 0.0),
}
OUTPUTS = {"Volume": Message("volume"), "Displacement": Message("displacement")}  # beside surfaces

Bends = Callable[[bpy.types.Material | None], bool]
Groups = tuple[bpy.types.Node, ...]  # the group nodes entered on the way, outermost first


@dataclass(frozen=True)
class Refraction:
    """The index of refraction of a material, the shader it
    comes from, and its settings that are not followed.
    """

    ior: float
    source: str
    ignored: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Texture:
    """The image on a surface, the UV map that places it
    ('' for the one used in renders), remarks, and when it shows which frame where it moves.
    """

    image: bpy.types.Image
    uv_map: str
    notes: tuple[str, ...]
    timing: Timing


def material_output(material: bpy.types.Material | None) -> bpy.types.Node | None:
    """The output node Cycles uses, or None for a material without nodes."""
    if material is None or material.node_tree is None:
        return None
    if bpy.app.version < (5, 0, 0) and not material.use_nodes:  # later versions always use them
        return None
    return material.node_tree.get_output_node("CYCLES")


def twin(
    sockets: bpy.types.bpy_prop_collection, socket: bpy.types.NodeSocket
) -> bpy.types.NodeSocket | None:
    """The socket with the same identifier: how a group node and
    the group's own input and output nodes correspond.
    """
    return next((other for other in sockets if other.identifier == socket.identifier), None)


def step_back(
    output: bpy.types.NodeSocket, groups: Groups
) -> tuple[bpy.types.NodeSocket | None, Groups]:
    """The input an output merely passes on (reroute, muted node,
    in and out of a group), or None for a real node.
    """
    node = output.node
    if node.mute:
        return next(
            (link.from_socket for link in node.internal_links if link.to_socket == output), None
        ), groups

    if node.type == "REROUTE":
        return node.inputs[0], groups

    if node.type == "GROUP" and node.node_tree is not None:
        inner = next(
            (n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output),
            None,
        )
        return (None if inner is None else twin(inner.inputs, output)), (*groups, node)

    if node.type == "GROUP_INPUT" and groups:
        return twin(groups[-1].inputs, output), groups[:-1]

    return None, groups


def feeding(socket: bpy.types.NodeSocket, groups: Groups) -> tuple[bpy.types.NodeSocket, Groups]:
    """The node output that feeds an input, or the unlinked input whose own value counts."""
    while True:
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return socket, groups
        before, entered = step_back(link.from_socket, groups)
        if before is None:
            return link.from_socket, groups
        socket, groups = before, entered


def number(socket: bpy.types.NodeSocket, groups: Groups) -> tuple[float, bool]:
    """Value of an input, and whether it is known: not when anything but a Value node feeds it."""
    end, _ = feeding(socket, groups)
    if not end.is_output or end.node.type == "VALUE":
        return float(end.default_value), True
    return float(socket.default_value), False


def shaders(
    socket: bpy.types.NodeSocket, groups: Groups
) -> Iterator[tuple[bpy.types.Node, Groups]]:
    """The shaders that feed a shader input, through Mix and Add, with the groups they stand in."""
    end, groups = feeding(socket, groups)
    if not end.is_output:
        return

    node = end.node
    if node.type not in {"MIX_SHADER", "ADD_SHADER"}:
        yield node, groups
        return

    parts = [s for s in node.inputs if s.type == "SHADER"]
    if node.type == "MIX_SHADER":
        share, is_known = number(node.inputs[0], groups)
        if is_known and share in (0.0, 1.0):
            parts = [parts[int(share)]]

    for part in parts:
        yield from shaders(part, groups)


def is_refractive(node: bpy.types.Node, groups: Groups) -> bool:
    """Does the shader let light through with a bend?"""
    if node.type == "BSDF_PRINCIPLED":
        weight, is_known = number(node.inputs["Transmission Weight"], groups)
        return weight > 0 or not is_known
    return node.type in REFRACTIVE


def is_linked(node: bpy.types.Node, name: str, groups: Groups) -> bool:
    """Does a node feed this input?"""
    socket = node.inputs.get(name)
    return socket is not None and feeding(socket, groups)[0].is_output


def not_followed(node: bpy.types.Node, groups: Groups) -> Iterator[str]:
    """The settings of a refractive shader that Kiriko does not follow."""
    for name, (setting, neutral) in NEUTRAL.items():
        socket = node.inputs.get(name)
        if socket is None:
            continue
        value, is_known = number(socket, groups)
        if not is_known:
            yield Message("{setting} from nodes", setting=setting)
        elif value != neutral:
            yield Message("{setting} {value:.3g}", setting=setting, value=value)

    colour = node.inputs.get("Base Color") or node.inputs.get("Color")
    end, _ = feeding(colour, groups)
    if end.is_output or min(end.default_value[:3]) != 1.0 or max(end.default_value[:3]) != 1.0:
        yield Message("colour tint")
    if is_linked(node, "Normal", groups):
        yield Message("normal map")


def read_refraction(material: bpy.types.Material | None) -> Refraction | None:
    """Index of refraction of a material: of the first refractive
    shader on its surface, or None if it has none.
    """
    output = material_output(material)
    if output is None:
        return None

    found = list(shaders(output.inputs["Surface"], ()))
    node, groups = next(((n, g) for n, g in found if is_refractive(n, g)), (None, ()))
    if node is None:
        return None

    ior, is_known = number(node.inputs["IOR"], groups)
    notes = (
        ()
        if is_known
        else (
            Message(
                "The IOR of '{material}' is driven by nodes: using {ior:.4g}.",
                material=material.name,
                ior=ior,
            ),
        )
    )
    ignored = list(not_followed(node, groups))
    ignored += [
        Message("mixed with {bl_label}", bl_label=other.bl_label)
        for other, _ in found
        if other != node
    ]
    ignored += [word for name, word in OUTPUTS.items() if is_linked(output, name, ())]

    return Refraction(ior, REFRACTIVE[node.type], tuple(ignored), notes)


def read_texture(material: bpy.types.Material | None) -> Texture | None:
    """The image texture nearest to the surface of a material,
    colours before numbers; None if there is none.
    """
    node, groups, is_altered = find_texture(material) or (None, (), False)
    return None if node is None else texture_of(node, groups, material.name, is_altered)


def find_texture(
    material: bpy.types.Material | None, *, is_empty: bool = False
) -> tuple[bpy.types.Node, Groups, bool] | None:
    """The node of that texture, the groups it stands in, and whether other nodes alter its colours.

    is_empty : look for one that has no image instead
    """
    output = material_output(material)
    if output is None:
        return None

    queue = deque([(output.inputs["Surface"], (), False)])
    asked = set()

    while queue:
        socket, groups, is_altered = queue.popleft()
        end, groups = feeding(socket, groups)
        if not end.is_output or (end.node, groups) in asked:
            continue

        node = end.node
        asked.add((node, groups))
        if node.type == "TEX_IMAGE" and (node.image is None) == is_empty:
            return node, groups, is_altered

        altered = is_altered or not any(s.type == "SHADER" for s in node.outputs)
        inputs = [s for s in node.inputs if s.enabled and s.type in {"SHADER", "RGBA"}]
        queue.extend((s, groups, altered) for s in inputs)

    return None


def texture_of(node: bpy.types.Node, groups: Groups, name: str, is_altered: bool) -> Texture:
    """The texture of an Image Texture node, with the changes to it that Kiriko does not follow."""
    notes = []
    uv_map = ""

    if is_altered:
        notes.append(
            Message(
                "The material '{name}' alters the colours of '{image}': using the plain image.",
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
                "The material '{name}' places '{image}' by nodes: using the plane's UV map.",
                name=name,
                image=node.image.name,
            )
        )

    return Texture(node.image.original, uv_map, tuple(notes), timing_of(node.image_user))


def bends_light(material: bpy.types.Material | None) -> bool:
    """Does a material let light through with a bend?"""
    return read_refraction(material) is not None


def refracts(thing: bpy.types.Object, bends: Bends = bends_light) -> bool:
    """Does any material of an object bend light, by `bends_light` or what is kept of it?"""
    return any(bends(slot.material) for slot in thing.material_slots)
