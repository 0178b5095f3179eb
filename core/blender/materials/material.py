"""Reads materials: the index of refraction, and ignored settings."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import bpy

from ...base.messages import Message, as_message
from ...rig.parts import CLEAR

REFRACTIVE = {
    "BSDF_GLASS": "Glass BSDF",
    "BSDF_REFRACTION": "Refraction BSDF",
    "BSDF_PRINCIPLED": "Principled BSDF",
}
# inputs of shaders, of the material's output and of glTF's group that change how much light passes
# clear glass, or its direction; all are ignored. Each has no effect at its number, or unlinked if
# None
NEUTRAL: dict[str, float | None] = {
    "Base Color": 1.0,
    "Color": 1.0,
    "Roughness": 0.0,
    "Metallic": 0.0,
    "Alpha": 1.0,
    "Thin Wall": 0.0,
    "Normal": None,
    "Specular Tint": 1.0,
    "Transmission Weight": 1.0,
    "Coat Weight": 0.0,
    "Sheen Weight": 0.0,
    "Emission Strength": 0.0,
    "Thin Film Thickness": 0.0,
    "Volume": None,
    "Displacement": None,
    "Dispersion": 0.0,
}
READ = {"Dispersion"}  # their numbers are not ignored
DISPERSION_OF_ABBE = 20.0  # dispersion times Abbe number, in glTF's KHR_materials_dispersion
# inputs without effect while others of their shader have these values
IDLE: dict[str, dict[str, float]] = {
    "Emission Strength": {"Emission Color": 0.0},
    "Sheen Weight": {"Sheen Tint": 0.0},
    "Coat Weight": {"Coat IOR": 1.0, "Coat Tint": 1.0},
    "Thin Film Thickness": {"Thin Film IOR": 1.0},
}
CONSTANT = {"VALUE", "RGB"}  # nodes with a single constant value
OF_GLTF = "glTF Material Output"  # group made by Blender's importer for inputs missing in shaders

Bends = Callable[[bpy.types.Material | None], bool]
Groups = tuple[bpy.types.Node, ...]  # the enclosing group nodes, outermost first


@dataclass(frozen=True)
class Refraction:
    """The index of refraction of a material, its shader, and ignored settings.

    abbe : Abbe number; None without dispersion
    absorption : of red, green and blue, per Blender unit
    """

    ior: float
    source: str
    ignored: tuple[str, ...]
    notes: tuple[str, ...]
    abbe: float | None = None
    absorption: tuple[float, float, float] = CLEAR


def material_output(material: bpy.types.Material | None) -> bpy.types.Node | None:
    """The output node for Cycles; None for a material without nodes."""
    if material is None or material.node_tree is None:
        return None
    if bpy.app.version < (5, 0, 0) and not material.use_nodes:  # later versions always use them
        return None
    return material.node_tree.get_output_node("CYCLES")


def twin(
    sockets: bpy.types.bpy_prop_collection, socket: bpy.types.NodeSocket
) -> bpy.types.NodeSocket | None:
    """The socket with the same identifier, which links a group node with the group's input and
    output nodes.
    """
    return next((other for other in sockets if other.identifier == socket.identifier), None)


def step_back(
    output: bpy.types.NodeSocket, groups: Groups
) -> tuple[bpy.types.NodeSocket | None, Groups]:
    """The input passed on by an output (reroute, muted node, in and out of a group); None for a
    real node.
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
    """The node output that feeds an input, or the unlinked input itself."""
    while True:
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return socket, groups
        before, entered = step_back(link.from_socket, groups)
        if before is None:
            return link.from_socket, groups
        socket, groups = before, entered


def number(socket: bpy.types.NodeSocket, groups: Groups) -> tuple[float, bool]:
    """Value of an input, and whether it is certain: only a Value node may feed it."""
    end, _ = feeding(socket, groups)
    if not end.is_output or end.node.type == "VALUE":
        return float(end.default_value), True
    return float(socket.default_value), False


def shaders(
    socket: bpy.types.NodeSocket, groups: Groups
) -> Iterator[tuple[bpy.types.Node, Groups]]:
    """The shaders behind a shader input, through Mix and Add, each with its groups."""
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
    """Whether a shader refracts light."""
    if node.type == "BSDF_PRINCIPLED":
        weight, is_known = number(node.inputs["Transmission Weight"], groups)
        return (weight > 0 or not is_known) and not is_thin_wall(node, groups)
    return node.type in REFRACTIVE


def is_thin_wall(node: bpy.types.Node, groups: Groups) -> bool:
    """Whether a shader passes light straight through, like a window; from Blender 5.2 on."""
    socket = node.inputs.get("Thin Wall")
    return socket is not None and number(socket, groups) == (1.0, True)


def on_thin_walls(materials: Iterable[bpy.types.Material | None]) -> Iterator[Message]:
    """A sentence on each material with Thin Wall on."""
    for material in materials:
        output = material_output(material)
        found = () if output is None else shaders(output.inputs["Surface"], ())
        if any(is_thin_wall(node, groups) for node, groups in found):
            yield Message(
                "Light goes straight through the material '{material}'. Turn Thin Wall off.",
                material=material.name,
            )


def is_at(node: bpy.types.Node, name: str, value: float, groups: Groups) -> bool:
    """Whether an input of a node has this value; for a colour, in each of red, green and blue."""
    if name not in node.inputs:
        return False
    end, _ = feeding(node.inputs[name], groups)
    if end.is_output and end.node.type not in CONSTANT:
        return False
    numbers = end.default_value[:3] if end.type == "RGBA" else [end.default_value]
    return all(number == value for number in numbers)


def not_followed(node: bpy.types.Node, groups: Groups) -> Iterator[str]:
    """A node's settings ignored by Kiriko."""
    for name, neutral in NEUTRAL.items():
        idle = IDLE.get(name, {})
        is_idle = idle and all(is_at(node, *other, groups) for other in idle.items())
        if name not in node.inputs or is_idle:
            continue
        end, within = feeding(node.inputs[name], groups)
        if end.is_output and _is_absorption(end.node, within):
            continue
        if end.is_output and end.node.type not in CONSTANT:
            yield Message("{setting} from nodes", setting=as_message(name))
        elif neutral is None or name in READ or is_at(node, name, neutral, groups):
            continue
        elif end.type == "RGBA":
            yield as_message(name)
        else:
            value = f"{end.default_value:.3g}"
            yield Message("{setting} {value}", setting=as_message(name), value=value)


def read_refraction(material: bpy.types.Material | None) -> Refraction | None:
    """Index of refraction of the first refractive shader on a material's surface; None if there is
    none.
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
                "Nodes set the IOR of '{material}'; Kiriko uses {ior:.4g}.",
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
    inside = (one for one in material.node_tree.nodes if one.type == "GROUP" and one.node_tree)
    of_gltf = [one for one in inside if one.node_tree.name.startswith(OF_GLTF)]
    for holder in (output, *of_gltf):
        ignored += not_followed(holder, ())

    sockets = [one.inputs["Dispersion"] for one in of_gltf if "Dispersion" in one.inputs]
    dispersion = max((number(one, ())[0] for one in sockets), default=0.0)
    abbe = DISPERSION_OF_ABBE / dispersion if dispersion > 0 else None
    absorption = _absorption(output.inputs["Volume"])
    return Refraction(ior, REFRACTIVE[node.type], tuple(ignored), notes, abbe, absorption)


def _absorption(socket: bpy.types.NodeSocket) -> tuple[float, float, float]:
    """Absorption by a Volume Absorption shader with constant inputs, as in Cycles: density * (1 -
    colour) per Blender unit; 0 for other shaders.
    """
    end, groups = feeding(socket, ())
    if not (end.is_output and _is_absorption(end.node, groups)):
        return CLEAR
    colour, _ = feeding(end.node.inputs["Color"], groups)
    density = max(number(end.node.inputs["Density"], groups)[0], 0.0)
    return tuple(density * max(1.0 - part, 0.0) for part in colour.default_value[:3])


def _is_absorption(node: bpy.types.Node, groups: Groups) -> bool:
    """Whether a shader only absorbs light, everywhere alike."""
    if node.type != "VOLUME_ABSORPTION":
        return False
    ends = [feeding(node.inputs[name], groups)[0] for name in ("Color", "Density")]
    return all(not end.is_output or end.node.type in CONSTANT for end in ends)


def bends_light(material: bpy.types.Material | None) -> bool:
    """Whether a material refracts light."""
    return read_refraction(material) is not None


def refracts(thing: bpy.types.Object, bends: Bends = bends_light) -> bool:
    """Whether any material of an object refracts, by `bends_light` or a cached version of it."""
    return any(bends(slot.material) for slot in thing.material_slots)
