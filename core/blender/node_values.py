"""Formulas made of nodes, written as formulas."""

from typing import Any


class Value:
    """A number or a vector in a node tree: with these,
    formulas made of nodes are written as formulas.
    """

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

        # one or two of three are left where not asked for
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
