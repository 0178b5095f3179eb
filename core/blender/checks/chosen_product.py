"""Products of the catalogue on objects: gives an object a product's values, and recognises a
product by them.

No object stores the name of a product, so a shown name is never out of date.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import bpy
import numpy as np

from ...base.errors import RigError
from ...base.messages import Message, as_message, joined
from ...rig.catalogue import DISPLAYS, GLASSES, PLATES, DisplayProduct, GlassProduct, PlateProduct
from ..data.bodies import shows_instances_alone
from ..data.units import length_of_unit, length_text
from ..materials.material import is_refractive, material_output, read_refraction, shaders
from ..read.elements import DEFAULT_IOR, give_mirrors, mirrors
from ..read.layout import give_size, size_of
from ..read.resize import RESIZED_WITHIN, give_side, has_side
from ..read.role_display import give_views
from .inspect_scene import each_material, evaluated, materials_as_shown

SAME_NUMBER = 1e-5  # relative: numbers in single precision are closer
SAME_INDEX = 5e-5  # half the last displayed digit


@dataclass(frozen=True)
class Given:
    """The sentence on an object with a new product.

    is_whole : the object has the product's size, too
    """

    text: Message
    is_whole: bool = True


def give_plate(context: bpy.types.Context, plate: bpy.types.Object, product: PlateProduct) -> Given:
    """Give a plate the mirrors of a product and, about its centre, the size."""
    side = length_text(context.scene, product.side)
    size = Message("{width} x {height}", width=side, height=side)
    try:
        give_side(context, plate, product.side / length_of_unit(context.scene))
    except RigError as error:
        given = _given(plate, product.name, size, error)
    else:
        given = _given(plate, product.name, size)

    give_mirrors(plate.kiriko.plate, product.array)
    return given


def _given(
    thing: bpy.types.Object,
    preset: str,
    size: Message,
    error: RigError | None = None,
    pixels: Message | None = None,
) -> Given:
    """The sentence on an object with a new product; `error` if it could not be resized."""
    if error is None:
        size = size if pixels is None else joined([size, pixels], ", ")
        return Given(
            Message("'{name}' is now {preset} ({size}).", name=thing.name, preset=preset, size=size)
        )
    if pixels is not None:
        preset = Message("{name} ({reason})", name=preset, reason=pixels)
    text = Message(
        "'{name}' is now {preset}, but could not be resized to {size}: {why}.",
        name=thing.name,
        preset=preset,
        size=size,
        why=error,
    )
    return Given(text, is_whole=False)


def plate_product(context: bpy.types.Context, plate: bpy.types.Object) -> PlateProduct | None:
    """The product with a plate's mirrors and size; None if there is none.

    A piece of a product may be crossed and cut differently: crossing error and phase do not count.
    """
    if plate.kiriko.plate.model == "IDEAL":
        return None

    array = mirrors(plate.kiriko.plate)
    metres = length_of_unit(context.scene)
    for product in PLATES.values():
        other = product.array
        numbers = (array.pitch, array.height, array.ior, array.reflectance)
        wanted = (other.pitch, other.height, other.ior, other.reflectance)
        is_same = np.allclose(numbers, wanted, rtol=SAME_NUMBER, atol=0)
        is_made_alike = (array.layout, array.has_fresnel) == (other.layout, other.has_fresnel)
        if is_same and is_made_alike and has_side(context, plate, product.side / metres):
            return product
    return None


def give_display(
    context: bpy.types.Context,
    display: bpy.types.Object,
    product: DisplayProduct,
    is_upright: bool = False,
) -> Given:
    """Give a display a product's resolution, its size about the display's centre, and its luminance
    if the maker states it.

    is_upright : the longer side goes up, along the UV map's v
    """
    turn = -1 if is_upright and product.views is None else 1
    size, pixels = product.size[::turn], product.pixels[::turn]
    metres = length_of_unit(context.scene)
    size_text = Message(
        "{width} x {height}",
        width=length_text(context.scene, size[0]),
        height=length_text(context.scene, size[1]),
    )
    pixels_text = Message("{width} x {height} px", width=pixels[0], height=pixels[1])

    try:
        give_size(context, display, (size[0] / metres, size[1] / metres))
    except RigError as error:
        given = _given(display, product.name, size_text, error, pixels_text)
    else:
        given = _given(display, product.name, size_text, pixels=pixels_text)

    display.kiriko.resolution = pixels
    give_views(display.kiriko.views, product.views)
    if product.luminance is not None:
        display.kiriko.display.white = product.luminance
    return given


def display_product(context: bpy.types.Context, display: bpy.types.Object) -> DisplayProduct | None:
    """The product with a display's resolution and size; None if there is none."""
    pixels = tuple(display.kiriko.resolution)
    views = display.kiriko.views
    n = views.columns * views.rows if views.use else 1
    alike = [
        p
        for p in DISPLAYS.values()
        if pixels in (p.pixels, p.pixels[::-1]) and n == (1 if p.views is None else p.views.n)
    ]
    if not alike:
        return None

    try:
        size = np.array(size_of(context, display)) * length_of_unit(context.scene)
    except RigError:
        return None

    for product in alike:
        wanted = np.array(product.size[:: 1 if pixels == product.pixels else -1])
        if np.abs(size / wanted - 1).max() <= RESIZED_WITHIN:
            return product
    return None


def give_glass(glasses: Sequence[bpy.types.Object], product: GlassProduct) -> list[Given]:
    """Give glasses the index of a product: in their materials if no other object uses them and
    their index is a plain number, else as an override.
    """
    reasons = {thing: _why_override(thing, glasses) for thing in glasses}
    given = []

    for thing, why in reasons.items():
        is_override = bool(why) or thing.kiriko.use_ior
        setting = Message("Override IOR") if is_override else Message("IOR")
        index = Message("{setting} {value}", setting=setting, value=f"{product.ior:g}")
        if is_override:
            thing.kiriko.use_ior, thing.kiriko.ior = True, product.ior
        else:
            shown = materials_as_shown(bpy.context.scene, thing)
            materials = [m for m in shown if _index_of(m) is not None]
            for material in materials:
                _index_of(material).default_value = product.ior
                material.node_tree.update_tag()
        thing.kiriko.dispersion = "MATERIAL" if product.dispersion is None else product.name
        text = Message(
            "'{name}' is now {preset} ({size}).",
            name=thing.name,
            preset=as_message(product.name),
            size=joined([index, why], ": ") if why else index,
        )
        given.append(Given(text))

    return given


def index_in_use(glass: bpy.types.Object) -> tuple[float, str] | None:
    """The index of a glass, and the name of its material, '' for the override or the default; None
    for instances, which each have their own.
    """
    ours, scene = glass.kiriko, bpy.context.scene
    if ours.use_ior:
        return ours.ior, ""
    shown = each_material(scene, glass)  # lazily: the first refractive one is enough
    first = next(shown, None)
    if first is None and shows_instances_alone(evaluated(scene, glass)):
        return None
    for material in () if first is None else chain([first], shown):
        found = read_refraction(material)
        if found is not None:
            return found.ior, material.name
    return DEFAULT_IOR, ""


def glass_product(glass: bpy.types.Object) -> GlassProduct | None:
    """The product with a glass's index; None if there is none, or if no material refracts and no
    index is set.
    """
    found = index_in_use(glass)
    if found is None or not (found[1] or glass.kiriko.use_ior):
        return None
    near = (p for p in GLASSES.values() if abs(p.ior - found[0]) < SAME_INDEX)
    return next(near, None)


def _why_override(glass: bpy.types.Object, chosen: Sequence[bpy.types.Object]) -> str:
    """Why materials cannot give a glass its index, a clause; '' if they can, or if the override
    is on.
    """
    if glass.kiriko.use_ior:
        return ""

    shown = materials_as_shown(bpy.context.scene, glass)
    materials = [m for m in shown if read_refraction(m) is not None]
    if not materials:
        return Message("no material of its own refracts")

    parts = [part for thing in chosen for part in (thing.data, *_nodes_of(thing)) if part]
    own = {*chosen, *(part for part in parts if part.users == 1)}
    for material in materials:
        if (
            _index_of(material) is None
            or material.node_tree.animation_data is not None
            or not material.is_editable
            or bpy.data.user_map(subset=[material])[material] - own
        ):
            return Message(
                "'{material}' is shared, linked or driven by nodes", material=material.name
            )
    return ""


def _nodes_of(thing: bpy.types.Object) -> list[bpy.types.NodeTree | None]:
    """The geometry nodes of an object's modifiers, which may set its material."""
    return [modifier.node_group for modifier in thing.modifiers if modifier.type == "NODES"]


def _index_of(material: bpy.types.Material) -> bpy.types.NodeSocket | None:
    """The input for the index of refraction among a material's own nodes; None if there is none,
    several, or a linked one.
    """
    output = material_output(material)
    if output is None:
        return None

    found = [
        (node, groups)
        for node, groups in shaders(output.inputs["Surface"], ())
        if is_refractive(node, groups)
    ]
    if len(found) != 1:
        return None

    node, groups = found[0]
    socket = node.inputs["IOR"]
    return None if groups or socket.is_linked else socket
