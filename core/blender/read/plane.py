"""A picture's plane: the image it shows, which is the solved one, and its proportions."""

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...base.words import percent
from ..data.moving import Timing, at_frame, is_moving, number_at, set_timing, whole
from ..data.rectangle import sides
from ..data.rigs import keep
from ..materials import shaders
from ..materials.texture import Texture, find_texture, read_texture
from .layout import axis_factors, laid_out, size_of
from .read_mesh import used_slots
from .resize import RESIZED_WITHIN, refuse_held, rescale
from .scene_picture import UNREADABLE, check_at, check_readable

MATERIAL = "Kiriko Picture"
UNSEEN_SQUEEZE = 0.005  # fraction of a side: less squeezing is invisible
FIT_BUTTON = Message("press Fit to Image in the Kiriko tab")


def own_materials(thing: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials in an object's own slots that its faces use, the most used first.

    All of them if only modifiers make faces, as of a Screw profile.
    """
    slots = thing.material_slots
    has_faces = thing.type == "MESH" and len(thing.data.polygons) > 0
    # panels are redrawn often, so faces of a single slot are not counted
    order = used_slots(thing.data) if has_faces and len(slots) > 1 else range(len(slots))
    materials = (
        dict.fromkeys(slots[min(k, len(slots) - 1)].material for k in order) if slots else {}
    )
    return [material for material in materials if material is not None]


def own_texture(thing: bpy.types.Object) -> Texture | None:
    """The image texture of an object's own materials; None if there is none."""
    textures = map(read_texture, own_materials(thing))
    return next((texture for texture in textures if texture is not None), None)


def texture_showing(thing: bpy.types.Object, image: bpy.types.Image | None) -> Texture | None:
    """The image texture of an object's own materials, if it has this image."""
    texture = own_texture(thing)
    return texture if texture is not None and texture.image == image else None


def chosen_image(thing: bpy.types.Object) -> bpy.types.Image | None:
    """The image chosen for a plane; None if none was, and its material alone defines the picture.

    Once the plane's own material shows the chosen image, only the material counts: changing its
    image changes the picture.
    """
    texture = own_texture(thing) if thing.kiriko.is_image_shown else None
    return thing.kiriko.image if texture is None else texture.image


def image_of(thing: bpy.types.Object) -> bpy.types.Image | None:
    """The picture of a plane, from the object itself."""
    image = chosen_image(thing)
    texture = own_texture(thing)
    return texture.image if image is None and texture is not None else image


def show(thing: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Make an object's own material show an image; returns whether this is possible.

    A material with other users is copied first, and the copy linked to the object.
    """
    data = thing.data
    if image.type in UNREADABLE or not thing.is_editable or not hasattr(data, "materials"):
        return False

    if not thing.material_slots:
        if not data.is_editable:
            return False
        data.materials.append(None)

    for is_empty in (False, True):
        for material in own_materials(thing):
            if find_texture(material, is_empty=is_empty) is not None:
                node = _own_node(thing, material, is_empty)
                old, node.image = node.image, image
                set_timing(node.image_user, image)
                _keep(old)
                return True

    _give_material(thing, image)
    return True


def set_shown_timing(thing: bpy.types.Object, image: bpy.types.Image, timing: Timing) -> None:
    """Set the timing of a moving image in an object's own material, if it shows the image."""
    for material in own_materials(thing):
        found = find_texture(material)
        if found is not None and found[0].image == image:
            set_timing(found[0].image_user, image, timing)
            return


def _own_node(
    thing: bpy.types.Object, material: bpy.types.Material, is_empty: bool
) -> bpy.types.Node:
    """The image texture node of an object's material, after copying the material and node groups
    with other users.
    """
    own = {thing, thing.data} if thing.data.users == 1 else {thing}
    if not material.is_editable or bpy.data.user_map(subset=[material])[material] - own:
        shared = material
        material = material.copy()
        for slot in thing.material_slots:
            if slot.material == shared:
                slot.link = "OBJECT"
                slot.material = material

    while True:
        node, groups, _ = find_texture(material, is_empty=is_empty)
        shared = next(
            (g for g in groups if g.node_tree.users > 1 or not g.node_tree.is_editable), None
        )
        if shared is None:
            return node
        shared.node_tree = shared.node_tree.copy()


def _give_material(thing: bpy.types.Object, image: bpy.types.Image) -> None:
    """Give an object a material that shows an image.

    Its own materials stay in the mesh and in the file.
    """
    material = bpy.data.materials.new(MATERIAL)
    try:
        shaders.show_picture(material, image)
    except BaseException:
        bpy.data.materials.remove(material)
        raise

    for slot in thing.material_slots:
        if slot.material is not None:
            keep(slot.material)
        slot.link = "OBJECT"
        slot.material = material


def _keep(image: bpy.types.Image | None) -> None:
    """Keep an image without users in the file if it has no other file."""
    if (
        image is not None
        and not image.users
        and (image.packed_file or image.is_dirty or not image.filepath)
    ):
        keep(image)


def squeeze(size: tuple[float, float] | None, image_size: tuple[int, int]) -> float:
    """Ratio of an image's width on a plane to its right width, for the same height; 1 if unknown.

    size : width and height of the whole image on the plane
    image_size : width and height of the image, px
    """
    width, height = image_size
    return (
        1.0 if size is None or not min(width, height, *size) else size[0] / size[1] * height / width
    )


def squeezed_words(factor: float) -> str:
    """Words after 'is' for a squeezed image; '' if the squeezing is invisible."""
    if abs(factor - 1) <= UNSEEN_SQUEEZE:
        return ""
    if factor < 1:
        return Message("squeezed to {share} of its width", share=percent(factor))
    return Message("squeezed to {share} of its height", share=percent(1 / factor))


def fit(context: bpy.types.Context, thing: bpy.types.Object) -> float:
    """Scale a picture's plane to the proportions of its image, with the same area; returns the
    earlier `squeeze`.

    Raises
    ------
    RigError : the reason, as a clause; everything is as before
    ImageError : the image has no pixels, a whole sentence
    """
    image_size = _image_size(thing, context.scene)
    points, axes = laid_out(context, thing, _uv_map(thing))

    def factor(matrix: Floats) -> float:
        return squeeze(sides(axes @ matrix[:3, :3].T), image_size)

    before = factor(np.array(thing.matrix_world, float))
    if squeezed_words(before):
        refuse_held(thing)
        factor_of_height = np.sqrt(before)
        factors = axis_factors(axes, np.array([1 / factor_of_height, factor_of_height]))
        rescale(
            context, thing, points, factors, lambda after: abs(factor(after) - 1) <= RESIZED_WITHIN
        )

    return before


def shown_as(context: bpy.types.Context, thing: bpy.types.Object) -> float:
    """The `squeeze` of a picture's plane; raises as `fit` does."""
    image_size = _image_size(thing, context.scene)
    return squeeze(plane_size(context, thing), image_size)


def plane_size(context: bpy.types.Context, thing: bpy.types.Object) -> tuple[float, float]:
    """Width and height in the world of the whole image on a plane.

    Raises RigError, a clause for a sentence.
    """
    return size_of(context, thing, _uv_map(thing))


def _uv_map(thing: bpy.types.Object) -> str:
    """The UV map of a plane's picture; '' for the one used in renders."""
    texture = texture_showing(thing, image_of(thing))
    return "" if texture is None else texture.uv_map


def check_shown(thing: bpy.types.Object, image: bpy.types.Image, scene: bpy.types.Scene) -> None:
    """Raise ImageError if a plane's image is missing at the scene's frame.

    Nothing is changed, since the checklist calls this while panels are drawn.
    """
    check_at(image, _frame_shown(thing, image, scene), _owner(thing))


def _frame_shown(
    thing: bpy.types.Object, image: bpy.types.Image, scene: bpy.types.Scene
) -> int | None:
    """The frame of a plane's image at the scene's frame; None for a still image."""
    if not is_moving(image):
        return None
    texture = texture_showing(thing, image)
    return number_at(image, texture and texture.timing, scene.frame_current)


def film_of(thing: bpy.types.Object) -> tuple[bpy.types.Image, Timing] | None:
    """The movie on a plane and its timing; None if there is none."""
    image = image_of(thing)
    if image is None or image.source != "MOVIE" or image.frame_duration < 2:  # a still GIF
        return None
    texture = texture_showing(thing, image)
    return image, whole(image) if texture is None else texture.timing


def _image_size(thing: bpy.types.Object, scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height of a plane's image, px, at the scene's frame."""
    image = image_of(thing)
    if image is None:
        raise RigError("it shows no image")
    owner = _owner(thing)
    with at_frame(image, _frame_shown(thing, image, scene), owner) as shown:
        check_readable(shown, owner)
        return tuple(shown.size)


def _owner(thing: bpy.types.Object) -> Message:
    return Message("the picture '{picture}'", picture=thing.name)
