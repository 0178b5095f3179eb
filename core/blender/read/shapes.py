"""The meshes of objects, kept while their objects stay as they are."""

from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, frozen
from ...base.fingerprint import fingerprint
from ...image.tone import Tone
from ...rig.rig import ROLES, Mesh
from ..data.colour import rec709_from_working
from ..data.image_file import notes_on
from ..data.moving import Reel, at_frame, stamp_of
from ..materials.texture import Texture, read_texture
from .plane import chosen_image
from .read_mesh import LocalMesh, in_world, mesh_of, read_local, sharpen_creases, used_slots
from .scene_picture import check_readable, decoded, stored_pixels

MAPPED = {role.name for role in ROLES if role.is_mapped}  # roles whose UV map counts
CURVED = {role.name for role in ROLES if role.is_curved}  # roles whose surface may be curved


@dataclass(eq=False)
class Shape:
    """An object's mesh as read, and the mesh in the world where it was last put.

    slots : indices of material slots on the faces, most faces first
    """

    local: LocalMesh
    slots: tuple[int, ...]
    texture: Texture | None = None
    matrix: Floats | None = None
    placed: tuple[Mesh, int] | None = None

    @cached_property
    def fingerprint(self) -> str:
        """Tells the mesh as read from all others, wherever it stands."""
        return fingerprint(self.local)

    def at(self, matrix: Floats, surface: str) -> tuple[Mesh, int]:
        """The mesh in the world by a matrix (4, 4), and its triangles without area.

        The same object if unmoved.
        """
        if self.matrix is None or not np.array_equal(self.matrix, matrix):
            self.matrix, self.placed = matrix, in_world(self.local, matrix, surface.lower())
        return self.placed


@dataclass(eq=False)
class CachedPixels:
    """The pixels of an image as the painter has them, and all that tells whether they still are.

    settings : of the image and the picture, by which they were decoded
    stored : fingerprint of the pixels as Blender keeps them
    pixels : (h, w, 4), which nobody can write to: the same array is the same picture
    notes : on what the file says and Blender ignores
    """

    settings: tuple[object, ...]
    stored: str
    pixels: NDArray[np.float32]
    notes: list[str]

    @cached_property
    def fingerprint(self) -> str:
        """Tells the picture from all others."""
        return fingerprint(self.pixels)


class ShapeCache:
    """Shapes and pixels kept from one reading to the next, by
    session uid; no datablock, which undo could take away.

    Whoever keeps them has to hand on Blender's news of
    changes (`notice`), and forget all after undo.
    """

    def __init__(self) -> None:
        self._shapes: dict[tuple[int, str, str], Shape] = {}
        self._met: dict[tuple[int, str, str], Shape] = {}
        self._pixels: dict[int, CachedPixels] = {}  # by session uid of the image
        self._asked: set[int] = set()  # of these, those that this reading asked for
        self._compared: set[int] = set()  # and those of which there was no news since
        self._n_kept = 0  # shapes that the last reading asked for
        self.reel: Reel | None = None  # where one is kept, which its owner has to close

    @property
    def is_whole(self) -> bool:
        """Is nothing known to have changed but places and
        settings, so that the next reading is short?
        """
        return self._are_compared and len(self._shapes) == self._n_kept > 0

    @property
    def _are_compared(self) -> bool:
        """Are all pixels known to be as they were read?"""
        return bool(self._pixels) and self._pixels.keys() <= self._compared

    def notice(self, depsgraph: bpy.types.Depsgraph, ours: Container[int] = ()) -> None:
        """Take note of a depsgraph's updates, but for pixels of
        datablocks with the session uids `ours`.
        """
        anew = {thing.session_uid for thing in reshaped(depsgraph)}
        if anew:
            self._shapes = {key: one for key, one in self._shapes.items() if key[0] not in anew}

        # a material, too: an image that is loaded again does not tell itself
        if any(map(depsgraph.id_type_updated, ("IMAGE", "MATERIAL"))):
            blocks = (update.id.original for update in depsgraph.updates)
            images = (one for one in blocks if one.id_type in {"IMAGE", "MATERIAL"})
            if any(one.session_uid not in ours for one in images):
                self._compared.clear()

    def shape(self, instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object) -> Shape:
        """Of the object an iterator stands on. Instances are read each time: several
        share one uid.
        """
        if instance.is_instance or owner.kiriko.role in MAPPED:
            return read_shape(instance.object, owner)
        key = (instance.object.original.session_uid, owner.kiriko.role, owner.kiriko.surface)
        self._met[key] = self._shapes.get(key) or read_shape(instance.object, owner)
        return self._met[key]

    def pixels(
        self,
        image: bpy.types.Image,
        owner: str,
        tone: Tone | None = None,
        number: int | None = None,
    ) -> NDArray[np.float32]:
        """As by `read_pixels`, as light as a tone has them; the
        same array as before while the image holds the same numbers.

        number : the frame of an image that moves
        """
        tone = tone or Tone()
        if number is None:
            check_readable(image, owner)
        space, matrix = image.colorspace_settings, rec709_from_working()
        numbers = (
            (tuple(image.size), image.is_float)
            if number is None
            else (image.filepath, number, stamp_of(image, number))
        )
        settings = (
            image.session_uid,
            space.name,
            space.is_data,
            image.alpha_mode,
            None if matrix is None else matrix.tobytes(),
            tone,
            *numbers,
        )
        uid = image.session_uid
        before = self._pixels.get(uid)
        if before is None or before.settings != settings or uid not in self._compared:
            with at_frame(image, number, owner, self.reel) as shown:
                stored = stored_pixels(shown, owner)
                # in the order of memory: else it is copied. Each frame of a picture that moves is
                # new, so that it pays only where the same one is read again
                is_same_frame = before is not None and before.settings == settings
                content = "" if number is not None else fingerprint(stored[::-1])
                if not (is_same_frame and content and before.stored == content):
                    pixels = frozen(tone.of(decoded(shown, stored, owner)))
                    if not (is_same_frame and np.array_equal(pixels, before.pixels)):
                        self._pixels[uid] = CachedPixels(settings, content, pixels, notes_on(shown))

        self._asked.add(uid)
        self._compared.add(uid)
        return self._pixels[uid].pixels

    def notes_on(self, image: bpy.types.Image) -> list[str]:
        """Notes on the file of an image whose pixels were asked for."""
        return self._pixels[image.session_uid].notes

    def fingerprint_of(self, pixels: NDArray[np.float32]) -> str:
        """Of pixels that were read; kept while they are the same array."""
        known = (one for one in self._pixels.values() if one.pixels is pixels)
        one = next(known, None)
        return fingerprint(pixels) if one is None else one.fingerprint

    def end(self) -> None:
        """All shapes of a reading were asked for: drop the others, and the pixels that the reading
        before did not ask for. Those of this one follow.
        """
        self._shapes, self._met = self._met, {}
        self._n_kept = len(self._shapes)
        self._pixels = {uid: one for uid, one in self._pixels.items() if uid in self._asked}
        self._asked.clear()


def reshaped(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Objects whose shape Blender has evaluated anew. The others may be thousands, as while a scene
    is dragged or played, and are asked for nothing else.
    """
    anew = (update.id.original for update in depsgraph.updates if update.is_updated_geometry)
    return [block for block in anew if block.id_type == "OBJECT"]


def used_materials(
    shown: bpy.types.Object, order: tuple[int, ...]
) -> tuple[bpy.types.Material | None, ...]:
    """Materials of an evaluated object's slots, in this
    order. A slot may override the mesh's material.
    """
    slots = shown.material_slots
    own = shown.data.materials
    last = max(len(slots), len(own)) - 1
    materials = []

    for k in (min(k, last) for k in order):  # Blender clamps an index beyond the slots
        is_overridden = 0 <= k < len(slots) and slots[k].link == "OBJECT"
        materials.append(
            slots[k].material if is_overridden else own[k] if 0 <= k < len(own) else None
        )

    return tuple(dict.fromkeys(materials))


def read_shape(shown: bpy.types.Object, owner: bpy.types.Object) -> Shape:
    """Triangles, material slots and texture of an evaluated object with its owner's role."""
    role = owner.kiriko.role
    with mesh_of(shown) as mesh:
        if owner.kiriko.surface != "FACETS" and role in CURVED:
            sharpen_creases(mesh, shown.original)

        slots = used_slots(mesh)
        textures = (
            (read_texture(m) for m in used_materials(shown, slots)) if role == "PICTURE" else ()
        )
        texture = next((t for t in textures if t is not None), None)
        is_shown = texture is not None and chosen_image(owner) in (None, texture.image)
        local = read_local(
            mesh,
            has_normals=role in CURVED,
            has_uv=role in MAPPED,
            uv_map=texture.uv_map if is_shown else "",
        )

    return Shape(local, slots, texture)
