"""The mirror array plate as a node group for Cycles: the formulas of core/light/plate.py as nodes,
without geometry.
"""

import math
from typing import Any, NamedTuple

import bpy

from ...rig.rig import MOST_CROSSING_ERROR, MirrorArray
from .shaders import cleared


class Value:
    """A number or a vector in a node tree, with operators for formulas."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.tree = socket, socket.id_data

    @property
    def is_vector(self) -> bool:
        return self.socket.type == "VECTOR"

    def node(self, operation: str, *others: "Value | float") -> "Value":
        """The result of a Math or Vector Math node for this value and others."""
        values = (self, *others)
        is_vector = any(isinstance(value, Value) and value.is_vector for value in values)
        node = self.tree.nodes.new("ShaderNodeVectorMath" if is_vector else "ShaderNodeMath")
        node.operation = operation
        sockets = [s for s in node.inputs if s.enabled]

        # unused inputs keep their defaults
        for socket, value in zip(sockets, values, strict=False):
            if isinstance(value, Value):
                self.tree.links.new(value.socket, socket)
            else:
                socket.default_value = value

        return Value(next(s for s in node.outputs if s.enabled))

    def __add__(self, other: "Value | float") -> "Value":
        return self.node("ADD", other)

    def __sub__(self, other: "Value | float") -> "Value":
        return self.node("SUBTRACT", other)

    def __rsub__(self, other: float) -> "Value":
        return (self * -1.0).node("ADD", other)

    def __mul__(self, other: "Value | float") -> "Value":
        if isinstance(other, Value) and other.is_vector:
            return other.node("SCALE", self)
        return self.node("SCALE" if self.is_vector else "MULTIPLY", other)

    __rmul__ = __mul__

    def __truediv__(self, other: "Value | float") -> "Value":
        return self.node("DIVIDE", other)

    def dot(self, other: "Value") -> "Value":
        return self.node("DOT_PRODUCT", other)

    def cross(self, other: "Value") -> "Value":
        return self.node("CROSS_PRODUCT", other)

    def normalised(self) -> "Value":
        return self.node("NORMALIZE")


class Input(NamedTuple):
    """An input of the plate's node group."""

    name: str
    subtype: str
    default: float
    lowest: float
    highest: float
    tooltip: str


_MMAP = MirrorArray()
PLATE_INPUTS = (
    Input("Pitch", "DISTANCE", _MMAP.pitch, 1e-9, 1e3,
    "Distance between mirrors; a larger one blurs the image"),
    Input("Height", "DISTANCE", _MMAP.height, 0.0, 1e3,
    "Height of one layer's mirrors; high ones image steep light"),
    Input("IOR", "NONE", _MMAP.ior, 1.0, 100.0,
    "Index of refraction of the glass between the mirrors"),
    Input("Reflectance", "FACTOR", _MMAP.reflectance, 0.0, 1.0,
    "Fraction of light left after each reflection"),
    Input(
        "Crossing Error", "ANGLE", 0.0, -MOST_CROSSING_ERROR, MOST_CROSSING_ERROR,
        "Deviation of the layers from 90 degrees, which blurs the image",
    ),
    Input("Phase 1", "NONE", 0.0, -1.0, 1.0,
    "Offset of the first mirrors from the origin, in pitches"),
    Input("Phase 2", "NONE", 0.0, -1.0, 1.0,
    "Offset of the second mirrors from the origin, in pitches"),
    Input("Fresnel", "FACTOR", 1.0, 0.0, 1.0,
    "Reflections at the plate's two faces; 1 = as of glass, 0 = none"),
)  # fmt: skip
LIGHT_INPUTS = (
    Input("Image", "FACTOR", 1.0, 0.0, 1.0, "Visibility of the mid-air image"),
    Input(
        "Stray 1",
        "FACTOR",
        1.0,
        0.0,
        1.0,
        "Visibility of light reflected only by the first mirrors",
    ),
    Input(
        "Stray 2",
        "FACTOR",
        1.0,
        0.0,
        1.0,
        "Visibility of light reflected only by the second mirrors",
    ),
    Input("Through", "FACTOR", 1.0, 0.0, 1.0, "Visibility of objects straight behind the plate"),
    Input("Reflected", "FACTOR", 1.0, 0.0, 1.0, "Visibility of reflections at the plate's face"),
)


_PLATE_GROUPS = {
    "crossed": "Kiriko Mirror Array",
    "holes": "Kiriko Mirror Array DCRA",
    "radial": "Kiriko Mirror Array Radial",
}
# sine of the angle to the plate, in single precision, below which light is in its plane
_GRAZING = 1e-6


class _Layer(NamedTuple):
    """One direction of mirrors: unit normal, phase in pitches, and an offset along the normal."""

    normal: Value
    phase: Value
    offset: Value | float = 0.0


class _PlateNodes:
    """The formulas of core/light/plate.py as nodes, in the world's axes."""

    def __init__(self, tree: Any, layout: str) -> None:
        self.tree, self.layout = tree, layout
        self.input = {s.name: Value(s) for s in tree.nodes.new("NodeGroupInput").outputs if s.name}
        geometry = self.outputs("ShaderNodeNewGeometry")
        self.position = geometry["Position"]
        self.facing = geometry["True Normal"]  # towards the viewer, on either side
        self.is_back = geometry["Backfacing"]  # 1 if the ray travels along the plate's normal
        self.cosine = geometry["Incoming"].dot(self.facing).node("MAXIMUM", _GRAZING)
        self.along = self.facing * self.cosine - geometry["Incoming"]
        self.normal = self.facing * (1.0 - 2.0 * self.is_back)
        self.x, self.y = self.axes()
        ior = self.input["IOR"]
        self.depth = (
            (1.0 - self.along.dot(self.along) / (ior * ior)).node("MAXIMUM", _GRAZING).node("SQRT")
        )
        self.path_length = self.input["Height"] / (ior * self.depth)
        self.half = self.input["Height"] * (1.0 if layout == "crossed" else 0.5)

        # from the hit, on the middle plane, to the face
        self.entry = self.along * (-1.0 * self.half / self.cosine)
        self.from_centre = self.position - self.outputs("ShaderNodeObjectInfo")["Location"]

    def outputs(self, kind: str) -> dict[str, Value]:
        """Outputs of a new node, by name."""
        return {socket.name: Value(socket) for socket in self.tree.nodes.new(kind).outputs}

    def axes(self) -> tuple[Value, Value]:
        """The plate's axes: the object's x axis in its plane (y if x is normal to it), and the
        perpendicular one.
        """
        own = []
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
            turn = self.tree.nodes.new("ShaderNodeVectorTransform")
            turn.vector_type = "VECTOR"
            turn.convert_from = "OBJECT"
            turn.convert_to = "WORLD"
            turn.inputs[0].default_value = axis
            own.append(Value(turn.outputs[0]).normalised())

        is_upright = own[0].dot(self.facing).node("ABSOLUTE").node("GREATER_THAN", 0.99)
        side = own[0] * (1.0 - is_upright) + own[1] * is_upright
        x = (side - self.facing * side.dot(self.facing)).normalised()
        return x, self.normal.cross(x)

    def layers(self) -> tuple[_Layer, _Layer]:
        """The two directions of mirrors."""
        phases = self.input["Phase 1"], self.input["Phase 2"]
        right = self.x
        up = self.y
        offset = 0.0

        if self.layout == "radial":
            place = self.from_centre + self.entry
            x = place.dot(self.x)
            y = place.dot(self.y)
            right = (self.x * x + self.y * y).normalised()
            up = self.normal.cross(right)
            width = self.input["Pitch"] * math.sqrt(2.0)
            ring = width * ((x * x + y * y).node("SQRT") / width).node("ROUND")
            offset = ring * y.node("ARCTAN2", x) * math.sqrt(0.5)

        first = (right + up) * math.sqrt(0.5)
        second = (up - right) * math.sqrt(0.5)

        if self.layout == "crossed":
            error = self.input["Crossing Error"]
            second = second * error.node("COSINE") - first * error.node("SINE")

        return _Layer(first, phases[0], offset), _Layer(second, phases[1], offset)

    def fold(self, layer: _Layer, shift: Value, along: Value) -> tuple[Value, Value, Value, Value]:
        """The path through one layer: shift from the hit, direction, number of reflections, and
        whether it is odd.
        """
        pitch = self.input["Pitch"]
        normal = layer.normal
        speed = along.dot(normal)
        q = ((self.from_centre + shift).dot(normal) + layer.offset) / pitch - layer.phase
        entered = q.node("FRACT")
        unfolded = entered + speed * self.path_length / pitch
        slit = unfolded.node("FLOOR")
        inside = unfolded - slit
        n_reflections = slit.node("ABSOLUTE")
        is_odd = n_reflections.node("MODULO", 2.0)
        moved = inside + is_odd * (1.0 - 2.0 * inside) - entered
        shift = shift + normal * (moved * pitch)

        # a layer of slits lets light drift along its mirrors, holes do not
        if self.layout == "crossed":
            shift = shift + (along - normal * speed) * self.path_length

        return shift, along - normal * (2.0 * speed * is_odd), n_reflections, is_odd

    def crossed(self) -> tuple[Value, Value, Value, Value, Value]:
        """The path through both layers: shift, direction along the plate, number of reflections,
        and whether those of layers 1 and 2 are odd.
        """
        first, second = self.layers()
        if self.layout != "crossed":  # two directions in one layer are independent
            shift, along, n_first, is_odd_1 = self.fold(first, self.entry, self.along)
            shift, along, n_second, is_odd_2 = self.fold(second, shift, along)
            return shift, along, n_first + n_second, is_odd_1, is_odd_2

        ahead = self.is_back
        behind = 1.0 - self.is_back
        near, far = (
            _Layer(*(a * ahead + b * behind for a, b in zip(pair[0][:2], pair[1][:2], strict=True)))
            for pair in ((first, second), (second, first))
        )
        shift, along, n_near, is_odd_near = self.fold(near, self.entry, self.along)
        shift, along, n_far, is_odd_far = self.fold(far, shift, along)
        is_odd_1 = is_odd_near * ahead + is_odd_far * behind
        is_odd_2 = is_odd_far * ahead + is_odd_near * behind

        return shift, along, n_near + n_far, is_odd_1, is_odd_2

    def reflected_share(self) -> Value:
        """Unpolarised Fresnel reflectance of a face."""
        ior = self.input["IOR"]
        bent = ior * self.depth
        straight = ior * self.cosine
        s = (self.cosine - bent) / (self.cosine + bent)
        p = (straight - self.depth) / (straight + self.depth)
        return (s * s + p * p) * 0.5 * self.input["Fresnel"]

    def portal(self, shift: Value, direction: Value, colour: Value) -> Any:
        """A shader that continues light from a place next to the hit."""
        values = {"Color": colour, "Position": self.position + shift, "Direction": direction}
        node = self.tree.nodes.new("ShaderNodeBsdfRayPortal")
        for name, value in values.items():
            self.tree.links.new(value.socket, node.inputs[name])
        return node

    def build(self) -> None:
        """Add everything up to the group's output.

        Light continues from the face it leaves, clear of the plane.
        """
        shift, along, n_reflections, odd_1, odd_2 = self.crossed()
        share = self.reflected_share()
        light = self.input

        # layer 1 odd, for both parities of layer 2
        image = light["Stray 1"] + odd_2 * (light["Image"] - light["Stray 1"])
        others = light["Through"] + odd_2 * (light["Stray 2"] - light["Through"])
        seen = others + odd_1 * (image - others)
        colour = (
            (1.0 - share) * (1.0 - share) * light["Reflectance"].node("POWER", n_reflections) * seen
        )
        # transmitted light, and light reflected at the face
        across = self.facing * self.cosine
        face = self.facing * self.half
        beyond = self.portal(shift - face, (along - across).normalised(), colour)
        back = self.portal(
            self.entry + face, (self.along + across).normalised(), share * light["Reflected"]
        )
        both, output = (
            self.tree.nodes.new(kind) for kind in ("ShaderNodeAddShader", "NodeGroupOutput")
        )
        self.tree.links.new(beyond.outputs[0], both.inputs[0])
        self.tree.links.new(back.outputs[0], both.inputs[1])
        self.tree.links.new(both.outputs[0], output.inputs[0])


def plate_group(layout: str) -> bpy.types.NodeTree:
    """New node group: a mirror array plate for Cycles, whose mirrors fold rays and have no
    geometry.

    For any flat mesh. Mirrors are counted from the object's origin, at 45 degrees to its x axis, as
    in plate.ArrayFrame. Lengths are in Blender units.

    Parameters
    ----------
    layout : as in rig.MirrorArray
    """
    tree = bpy.data.node_groups.new(_PLATE_GROUPS[layout], "ShaderNodeTree")
    tree.interface.new_socket("Plate", in_out="OUTPUT", socket_type="NodeSocketShader")
    panel = tree.interface.new_panel(
        "Light", description="Visible kinds of light; turn stray light off here"
    )
    inputs = [i for i in PLATE_INPUTS if layout == "crossed" or i.name != "Crossing Error"]
    for wanted, parent in (*((i, None) for i in inputs), *((i, panel) for i in LIGHT_INPUTS)):
        socket = tree.interface.new_socket(
            wanted.name,
            description=wanted.tooltip,
            in_out="INPUT",
            socket_type="NodeSocketFloat",
            parent=parent,
        )
        socket.subtype = wanted.subtype
        socket.min_value = wanted.lowest
        socket.max_value = wanted.highest
        socket.default_value = wanted.default

    _PlateNodes(tree, layout).build()
    _arrange(tree)
    return tree


def _arrange(tree: Any) -> None:
    """Arrange nodes in columns, each to the right of its inputs."""
    column: dict[Any, int] = {}
    # nodes are created in the order of the formulas, inputs first
    for node in tree.nodes:
        needed = [link.from_node for socket in node.inputs for link in socket.links]
        column[node] = 1 + max((column[other] for other in needed), default=-1)

    used: dict[int, int] = {}
    for node, n in column.items():
        node.hide = node.bl_idname in {"ShaderNodeMath", "ShaderNodeVectorMath"}
        node.location = (180 * n, -used.get(n, 0))
        used[n] = used.get(n, 0) + (40 if node.hide else 300)


def be_mirror_array(
    material: bpy.types.Material, array: MirrorArray, metres: float = 1.0
) -> bpy.types.NodeTree:
    """Mirror array plate with all its light in Cycles.

    Returns its new node group. `metres` is a Blender unit.
    """
    tree, output = cleared(material)
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = plate_group(array.layout)
    values = {
        "Pitch": array.pitch / metres,
        "Height": array.height / metres,
        "IOR": array.ior,
        "Reflectance": array.reflectance,
        "Phase 1": math.fmod(array.phase[0], 1.0),  # whole pitches have no effect
        "Phase 2": math.fmod(array.phase[1], 1.0),
        "Fresnel": float(array.has_fresnel),
    }
    if array.layout == "crossed":
        values["Crossing Error"] = array.crossing_error
    for name, value in values.items():
        group.inputs[name].default_value = value

    tree.links.new(group.outputs[0], output.inputs["Surface"])
    group.location = (-220, 0)
    group.width = 200
    return group.node_tree
