"""Cache of objects' meshes and images' pixels, from one reading of the scene to the next."""

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

MAPPED = {role.name for role in ROLES if role.is_mapped}  # roles whose UV map is read
CURVED = {role.name for role in ROLES if role.is_curved}  # roles whose surface may be curved


@dataclass(eq=False)
class Shape:
    """An object's mesh as read, and its last mesh in the world.

    slots : indices of material slots on the faces, the most used first
    """

    local: LocalMesh
    slots: tuple[int, ...]
    texture: Texture | None = None
    matrix: Floats | None = None
    placed: tuple[Mesh, int] | None = None

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the mesh as read, independent of its place."""
        return fingerprint(self.local)

    def at(self, matrix: Floats, surface: str) -> tuple[Mesh, int]:
        """The mesh in the world by a matrix (4, 4), and its number of triangles without area.

        The same object if unmoved.
        """
        if self.matrix is None or not np.array_equal(self.matrix, matrix):
            self.matrix, self.placed = matrix, in_world(self.local, matrix, surface.lower())
        return self.placed


@dataclass(eq=False)
class CachedPixels:
    """The pixels of an image for the painter, and their cache keys.

    settings : of the image and the picture, used for decoding
    stored : fingerprint of the pixels as Blender stores them
    pixels : (h, w, 4), read-only: the same array is the same picture
    notes : on properties of the file that Blender ignores
    """

    settings: tuple[object, ...]
    stored: str
    pixels: NDArray[np.float32]
    notes: list[str]

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the picture."""
        return fingerprint(self.pixels)


class ShapeCache:
    """Shapes and pixels from earlier readings, by session uid; no datablocks, which undo could
    remove.

    The owner passes on Blender's updates (`notice`), and drops the cache after undo.
    """

    def __init__(self) -> None:
        self._shapes: dict[tuple[int, str, str], Shape] = {}
        self._met: dict[tuple[int, str, str], Shape] = {}
        self._pixels: dict[int, CachedPixels] = {}  # by session uid of the image
        self._used: set[int] = set()  # images used by this reading
        self._compared: set[int] = set()  # images without updates since they were compared
        self._n_used = 0  # shapes used by the last reading
        self.reel: Reel | None = None  # an open reel, which its owner closes

    @property
    def is_whole(self) -> bool:
        """Whether only places and settings have changed, so that the next reading is short."""
        return self._are_compared and len(self._shapes) == self._n_used > 0

    @property
    def _are_compared(self) -> bool:
        """Whether all pixels are unchanged."""
        return bool(self._pixels) and self._pixels.keys() <= self._compared

    def notice(self, depsgraph: bpy.types.Depsgraph, ours: Container[int] = ()) -> None:
        """Process a depsgraph's updates, except pixels of datablocks with session uids `ours`."""
        changed = {thing.session_uid for thing in reshaped(depsgraph)}
        if changed:
            self._shapes = {key: one for key, one in self._shapes.items() if key[0] not in changed}

        # a material, too, since a reloaded image gives no update of its own
        if any(map(depsgraph.id_type_updated, ("IMAGE", "MATERIAL"))):
            blocks = (update.id.original for update in depsgraph.updates)
            images = (one for one in blocks if one.id_type in {"IMAGE", "MATERIAL"})
            if any(one.session_uid not in ours for one in images):
                self._compared.clear()

    def shape(self, instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object) -> Shape:
        """The shape of an iterator's current object. Instances are read each time: several share
        one uid.
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
        """Pixels as by `read_pixels`, with a tone applied; the same array as before while the image
        has the same numbers.

        number : the frame of a moving image
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
                # in memory order, which avoids a copy. A moving picture has new pixels at each
                # frame, so comparing pays only if the same one is read again
                is_same_frame = before is not None and before.settings == settings
                content = "" if number is not None else fingerprint(stored[::-1])
                if not (is_same_frame and content and before.stored == content):
                    pixels = frozen(tone.of(decoded(shown, stored, owner)))
                    if not (is_same_frame and np.array_equal(pixels, before.pixels)):
                        self._pixels[uid] = CachedPixels(settings, content, pixels, notes_on(shown))

        self._used.add(uid)
        self._compared.add(uid)
        return self._pixels[uid].pixels

    def notes_on(self, image: bpy.types.Image) -> list[str]:
        """Notes on the file of an image whose pixels were read."""
        return self._pixels[image.session_uid].notes

    def fingerprint_of(self, pixels: NDArray[np.float32]) -> str:
        """Fingerprint of read pixels; cached while they are the same array."""
        matching = (one for one in self._pixels.values() if one.pixels is pixels)
        one = next(matching, None)
        return fingerprint(pixels) if one is None else one.fingerprint

    def end(self) -> None:
        """End a reading's shapes: drop unused ones, and pixels that the reading before did not use.
        This reading's pixels follow.
        """
        self._shapes, self._met = self._met, {}
        self._n_used = len(self._shapes)
        self._pixels = {uid: one for uid, one in self._pixels.items() if uid in self._used}
        self._used.clear()


def reshaped(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Objects whose shape Blender has re-evaluated. Others may be thousands, as while a scene is
    dragged or played, and cost one test each.
    """
    changed = (update.id.original for update in depsgraph.updates if update.is_updated_geometry)
    return [block for block in changed if block.id_type == "OBJECT"]


def used_materials(
    shown: bpy.types.Object, order: tuple[int, ...]
) -> tuple[bpy.types.Material | None, ...]:
    """Materials of an evaluated object's slots, in this order. A slot may override the mesh's
    material.
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
