"""Materials with which Cycles obeys the laws of Kiriko's tracer."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy

from ..data.moving import set_timing


def cleared(material: bpy.types.Material) -> tuple[Any, Any]:
    """Empty node tree of a material, and its new output node."""
    if bpy.app.version < (5, 0, 0):  # always on, and deprecated, from 5.0
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    return tree, tree.nodes.new("ShaderNodeOutputMaterial")


def _black(tree: Any) -> Any:
    """A shader without emission or reflection."""
    node = tree.nodes.new("ShaderNodeEmission")
    node.inputs["Strength"].default_value = 0.0
    return node


def _front_only(tree: Any, output: Any, shader: Any) -> None:
    """Show `shader` on the front of the surface and black on its back."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(geometry.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(_black(tree).outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    for column, node in enumerate((geometry, shader, mix, output)):
        node.location = (220 * column - 440, 0)


class ImageLook(NamedTuple):
    """How a display shows its section of an image.

    black_level : light of a black texel relative to white
    width, height, below : window of its UV map in that of the image, from u = 0
    is_two_sided : also on its back
    columns, rows, overlap : of its views, as in `core.rig.views.Views`; 1 and 1 for none
    across, down : tiles of their quilt, which is then the image
    slopes, places : views for each unit of the tangent of light's angle to the right and upward,
        and of u and v
    """

    black_level: float = 0.0
    width: float = 1.0
    height: float = 1.0
    below: float = 0.0
    is_two_sided: bool = False
    columns: int = 1
    rows: int = 1
    overlap: float = 0.0
    across: int = 1
    down: int = 1
    slopes: tuple[float, float] = (0.0, 0.0)
    places: tuple[float, float] = (0.0, 0.0)

    @property
    def numbers(self) -> list[float]:
        """All of its values."""
        return list(map(float, (*self[:-2], *self.slopes, *self.places)))

    def uv(self, tree: Any) -> Any:
        """A socket with the UV of the image. The map is unnamed: the one used in renders, which
        Kiriko reads.
        """
        uv = tree.nodes.new("ShaderNodeUVMap")
        uv.location = (-740, -220)
        if (self.width, self.height) == (1, 1):
            return uv.outputs["UV"]
        window = tree.nodes.new("ShaderNodeVectorMath")
        window.operation = "MULTIPLY_ADD"
        tree.links.new(uv.outputs["UV"], window.inputs[0])
        window.inputs[1].default_value = self.width, self.height, 1.0
        window.inputs[2].default_value = 0.0, self.below, 0.0
        window.location = (-640, -420)
        return window.outputs["Vector"]

    def put(self, tree: Any, output: Any, shader: Any) -> None:
        """Show a shader on the sides that shine."""
        if self.is_two_sided:
            tree.links.new(shader.outputs[0], output.inputs["Surface"])
        else:
            _front_only(tree, output, shader)


WHOLE = ImageLook()


def show(material: bpy.types.Material, image: bpy.types.Image | None, look: ImageLook) -> None:
    """Show an image, or the image's coordinates without one."""
    if image is None:
        show_coordinates(material, look)
    else:
        show_image(material, image, look)


def show_image(
    material: bpy.types.Material, image: bpy.types.Image, look: ImageLook = WHOLE
) -> None:
    """Make a material emit the texels of an image like the pixels of a screen: square and sharp."""
    tree, output = cleared(material)
    emission = tree.nodes.new("ShaderNodeEmission")
    if look.columns * look.rows > 1:
        colour = _views(tree, image, look)
    else:
        colour = _texels(tree, image, look.uv(tree), look.black_level)

    tree.links.new(colour, emission.inputs["Color"])
    look.put(tree, output, emission)
    material.cycles.emission_sampling = "NONE"  # only mirror paths carry light to the viewer


def _texels(tree: Any, image: bpy.types.Image, place: Any, black_level: float) -> Any:
    """The light of an image's texels at a socket's place."""
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.interpolation = "Closest"
    texture.extension = "CLIP"
    texture.location = (-520, -220)
    tree.links.new(place, texture.inputs["Vector"])
    if not black_level:
        return texture.outputs["Color"]
    raised = tree.nodes.new("ShaderNodeVectorMath")
    raised.operation = "MULTIPLY_ADD"
    tree.links.new(texture.outputs["Color"], raised.inputs[0])
    raised.inputs[1].default_value = (1 - black_level,) * 3
    raised.inputs[2].default_value = (black_level,) * 3
    raised.location = (-300, -220)
    return raised.outputs["Vector"]


def _views(tree: Any, image: bpy.types.Image, look: ImageLook) -> Any:
    """The light of a quilt by its direction, Cycles' Incoming, as `core.rig.views.Views` shows it:
    the sum over up to two views on each axis.

    The axes are those of the UV map, so they follow the object.
    """
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    tangent = tree.nodes.new("ShaderNodeTangent")
    tangent.direction_type = "UV_MAP"
    incoming, normal = geometry.outputs["Incoming"], geometry.outputs["True Normal"]
    right = tangent.outputs[0]
    up = _vector(tree, "CROSS_PRODUCT", normal, right)
    depth = _vector(tree, "DOT_PRODUCT", incoming, normal)
    uv = look.uv(tree)
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(uv, split.inputs[0])

    axes = []
    for k, (axis, n) in enumerate(((right, look.columns), (up, look.rows))):
        slope = _math(tree, "DIVIDE", _vector(tree, "DOT_PRODUCT", incoming, axis), depth)
        place = _math(tree, "MULTIPLY_ADD", split.outputs[k], look.places[k], (n - 1) / 2)
        place = _math(tree, "SUBTRACT", place, look.places[k] / 2)
        beam = _math(tree, "MULTIPLY_ADD", slope, look.slopes[k], place)
        axes.append(_on_axis(tree, beam, n, look.overlap))

    total: Any = (0.0, 0.0, 0.0)
    for column, part in axes[0]:
        for row, other in axes[1]:
            view = _math(tree, "MULTIPLY_ADD", row, float(look.columns), column)
            tile = tree.nodes.new("ShaderNodeCombineXYZ")
            down = _math(tree, "FLOOR", _math(tree, "DIVIDE", view, float(look.across)))
            tree.links.new(down, tile.inputs["Y"])
            left = _math(tree, "MULTIPLY_ADD", down, -float(look.across), view)
            tree.links.new(left, tile.inputs["X"])
            place = _vector(tree, "ADD", uv, tile.outputs[0])
            place = _vector(tree, "MULTIPLY", place, (1 / look.across, 1 / look.down, 0.0))
            light = _texels(tree, image, place, look.black_level)
            weight = tree.nodes.new("ShaderNodeCombineXYZ")
            for socket in weight.inputs:
                tree.links.new(_math(tree, "MULTIPLY", part, other), socket)
            total = _vector(tree, "MULTIPLY_ADD", light, weight.outputs[0], total)
    return total


def _on_axis(tree: Any, beam: Any, n: int, overlap: float) -> list[tuple[Any, Any]]:
    """Sockets of the views of a beam on an axis of n views, and of their weights; 0 outside."""
    ends = [-overlap / 2, overlap / 2] if overlap and n > 1 else [0.0]
    views = [_math(tree, "FLOOR", _math(tree, "ADD", beam, 0.5 + end)) for end in ends]
    weights: list[Any] = [1.0]
    if len(ends) == 2:
        into = _math(tree, "SUBTRACT", _math(tree, "ADD", views[0], 0.5), beam)
        first = _math(tree, "MULTIPLY_ADD", into, 1 / overlap, 0.5)
        first = _math(tree, "MINIMUM", first, 1.0)
        weights = [first, _math(tree, "SUBTRACT", 1.0, first)]
    found = []
    for view, weight in zip(views, weights, strict=True):
        is_right = _math(tree, "GREATER_THAN", view, -0.5)
        is_left = _math(tree, "LESS_THAN", view, n - 0.5)
        weight = _math(tree, "MULTIPLY", _math(tree, "MULTIPLY", is_right, is_left), weight)
        found.append((view, weight))
    return found


def _math(tree: Any, operation: str, *values: Any) -> Any:
    """The socket of an operation on sockets or numbers."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values, strict=False):
        if isinstance(value, float | int):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def show_picture(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Make a material show an image as it is, unlit, on both sides.

    Its alpha makes it transparent: over black its colours are the solved ones.
    """
    tree, output = cleared(material)
    emission = tree.nodes.new("ShaderNodeEmission")
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    mix = tree.nodes.new("ShaderNodeMixShader")
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.extension = image, "CLIP"
    set_timing(texture.image_user, image)
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    tree.links.new(texture.outputs["Alpha"], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    texture.location = (-740, 0)
    emission.location = (-440, -100)
    clear.location = (-440, 60)
    mix.location = (-220, 0)
    tree.nodes.active = texture  # solid view shows it as the object's texture


def show_coordinates(material: bpy.types.Material, look: ImageLook = WHOLE) -> None:
    """Make a material emit (u, v, 1), so a render gives the landing of each viewer pixel on the
    display.
    """
    tree, output = cleared(material)
    emission = tree.nodes.new("ShaderNodeEmission")
    combine = tree.nodes.new("ShaderNodeCombineXYZ")
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    combine.inputs["Z"].default_value = 1.0
    tree.links.new(look.uv(tree), split.inputs[0])
    tree.links.new(split.outputs["X"], combine.inputs["X"])
    tree.links.new(split.outputs["Y"], combine.inputs["Y"])
    tree.links.new(combine.outputs[0], emission.inputs["Color"])
    look.put(tree, output, emission)
    material.cycles.emission_sampling = "NONE"


def be_plate(material: bpy.types.Material) -> None:
    """Ideal plane-symmetric plate: light leaves along o = -i + 2 (i.n) n (Kiuchi & Koizumi 2021,
    eq. 3).

    Cycles' Incoming is -i, so the law is its reflection about the normal.
    """
    tree, output = cleared(material)
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    turned = _vector(tree, "REFLECT", geometry.outputs["Incoming"], geometry.outputs["True Normal"])
    _send(tree, output, geometry, turned)


def be_retroreflector(material: bpy.types.Material) -> None:
    """Light leaves along -i, Cycles' Incoming."""
    tree, output = cleared(material)
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    _send(tree, output, geometry, geometry.outputs["Incoming"])


def be_lens(material: bpy.types.Material, centre: Sequence[float], focal_length: float) -> None:
    """Thin lens: light leaves along i / |i.n| - (p - centre) / f.

    centre, focal_length : Blender units, world
    """
    tree, output = cleared(material)
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    incoming = geometry.outputs["Incoming"]
    cosine = _vector(tree, "DOT_PRODUCT", incoming, geometry.outputs["True Normal"])
    size = tree.nodes.new("ShaderNodeMath")
    size.operation = "ABSOLUTE"
    tree.links.new(cosine, size.inputs[0])
    slopes = _vector(tree, "DIVIDE", incoming, size.outputs[0])
    away = _vector(tree, "SUBTRACT", geometry.outputs["Position"], tuple(centre))
    away = _vector(tree, "DIVIDE", away, (-focal_length,) * 3)
    direction = _vector(tree, "NORMALIZE", _vector(tree, "SUBTRACT", away, slopes))
    _send(tree, output, geometry, direction)


def _vector(tree: Any, operation: str, *values: Any) -> Any:
    """The socket of a vector operation on sockets or constants."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values, strict=False):
        if isinstance(value, tuple):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]


def _send(tree: Any, output: Any, geometry: Any, direction: Any) -> None:
    """Let light go on from where it is, in a direction, by a ray portal."""
    portal = tree.nodes.new("ShaderNodeBsdfRayPortal")
    tree.links.new(direction, portal.inputs["Direction"])
    tree.links.new(geometry.outputs["Position"], portal.inputs["Position"])
    tree.links.new(portal.outputs[0], output.inputs["Surface"])
    for column, node in enumerate((geometry, direction.node, portal, output)):
        node.location = (220 * column - 440, 0)


def tint_in_eevee(
    material: bpy.types.Material, colour: tuple[float, float, float], opacity: float
) -> None:
    """Have EEVEE draw a material as a tinted pane, without changing Cycles."""
    tree = material.node_tree
    for node in tree.nodes:
        if node.type == "OUTPUT_MATERIAL":
            node.target = "CYCLES"

    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = "EEVEE"
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    tint = tree.nodes.new("ShaderNodeEmission")
    mix = tree.nodes.new("ShaderNodeMixShader")
    tint.inputs["Color"].default_value = (*colour, 1.0)
    mix.inputs[0].default_value = opacity
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(tint.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    for node, at in zip((clear, tint, mix, output), (-220, -220, 0, 220), strict=True):
        node.location = (at, -300)
    tint.location = (-220, -400)


def be_glass(material: bpy.types.Material, ior: float, fresnel: bool) -> None:
    """Smooth clear glass. Without Fresnel all light is either refracted or totally reflected, which
    avoids noise.
    """
    tree, output = cleared(material)
    glass = _clear(tree, "ShaderNodeBsdfGlass", ior) if fresnel else _unparted(tree, ior)
    tree.links.new(glass.outputs[0], output.inputs["Surface"])
    glass.location = (-220, 0)


def absorb(material: bpy.types.Material, absorption: Sequence[float]) -> None:
    """Absorb red, green and blue, per Blender unit: density * (1 - colour) in Cycles."""
    tree = material.node_tree
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    density = max(absorption)
    volume.inputs["Density"].default_value = density
    volume.inputs["Color"].default_value = (*(1 - one / density for one in absorption), 1.0)
    output = tree.get_output_node("ALL")
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    volume.location = (-220, -200)


def _unparted(tree: Any, ior: float) -> Any:
    """A shader for total refraction or total reflection."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    refracted = _clear(tree, "ShaderNodeBsdfRefraction", ior)
    mirrored = _clear(tree, "ShaderNodeBsdfAnisotropic")
    tree.links.new(_is_totally_reflected(tree, ior), mix.inputs[0])
    tree.links.new(refracted.outputs[0], mix.inputs[1])
    tree.links.new(mirrored.outputs[0], mix.inputs[2])
    refracted.location, mirrored.location = (-440, -100), (-440, -300)
    return mix


def _clear(tree: Any, name: str, ior: float | None = None) -> Any:
    """A shader without roughness or absorption."""
    node = tree.nodes.new(name)
    node.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    node.inputs["Roughness"].default_value = 0.0
    if ior is not None:
        node.inputs["IOR"].default_value = ior
    return node


def _is_totally_reflected(tree: Any, ior: float) -> Any:
    """A socket that is 1 for total reflection at an interface, else 0: the squared sine of the
    incidence angle exceeds the critical angle's, on the side of the incoming light.
    """
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    cosine = tree.nodes.new("ShaderNodeVectorMath")
    square, sine, limit, found = (tree.nodes.new("ShaderNodeMath") for _ in range(4))
    cosine.operation = "DOT_PRODUCT"
    square.operation, sine.operation = "MULTIPLY", "SUBTRACT"
    limit.operation, found.operation = "MULTIPLY_ADD", "GREATER_THAN"

    tree.links.new(geometry.outputs["Incoming"], cosine.inputs[0])
    tree.links.new(geometry.outputs["Normal"], cosine.inputs[1])
    for k in range(2):
        tree.links.new(cosine.outputs["Value"], square.inputs[k])
    sine.inputs[0].default_value = 1.0
    tree.links.new(square.outputs[0], sine.inputs[1])

    tree.links.new(geometry.outputs["Backfacing"], limit.inputs[0])
    # a sine is at most 1: a larger limit would only cost the smaller one its digits
    front, back = min(ior, 1.0) ** 2, min(1 / ior, 1.0) ** 2
    limit.inputs[1].default_value = back - front
    limit.inputs[2].default_value = front
    tree.links.new(sine.outputs[0], found.inputs[0])
    tree.links.new(limit.outputs[0], found.inputs[1])

    row = (geometry, cosine, square, sine, limit, found)
    for column, node in enumerate(row):
        node.location = (220 * (column - len(row)) - 440, 0)
    return found.outputs[0]


def glow(material: bpy.types.Material, colour: tuple[float, float, float]) -> None:
    """Make a material emit a colour, linear, in any light."""
    tree, output = cleared(material)
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = material.diffuse_color = (*colour, 1.0)
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    emission.location = (-220, 0)


def be_mirror(material: bpy.types.Material) -> None:
    """A mirror without loss."""
    tree, output = cleared(material)
    glossy = _clear(tree, "ShaderNodeBsdfAnisotropic")
    tree.links.new(glossy.outputs[0], output.inputs["Surface"])


def be_half_mirror(material: bpy.types.Material, reflectance: float, transmittance: float) -> None:
    """A thin surface with shares of reflected and of transmitted light, 0..1."""
    tree, output = cleared(material)
    add = tree.nodes.new("ShaderNodeAddShader")
    glossy = _clear(tree, "ShaderNodeBsdfAnisotropic")
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    for k, (node, share) in enumerate(((glossy, reflectance), (clear, transmittance))):
        node.inputs["Color"].default_value = (share, share, share, 1.0)
        tree.links.new(node.outputs[0], add.inputs[k])
        node.location = (-440, -200 * k)
    tree.links.new(add.outputs[0], output.inputs["Surface"])


def be_blocker(material: bpy.types.Material) -> None:
    """Black on both sides."""
    tree, output = cleared(material)
    tree.links.new(_black(tree).outputs[0], output.inputs["Surface"])
