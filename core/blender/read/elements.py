"""Glass, plates and pictures of a rig, read from their objects and materials."""

from dataclasses import dataclass
from math import log

import bpy

from ...base.errors import RigError
from ...base.messages import Message, quoted
from ...base.vectors import normalise
from ...glass.meshes import geometric_normals
from ...image.tone import Tone
from ...rig.catalogue import GLASSES
from ...rig.dispersion import AbbeIndex, ConstantIndex, Index, ShiftedIndex
from ...rig.parts import CLEAR
from ...rig.rig import (
    ROLES,
    Glass,
    Mesh,
    MirrorArray,
    Picture,
    PicturePlace,
    Plate,
    owner,
)
from ..data.moving import Timing, at_frame, ended, number_at
from ..data.rectangle import flat_size
from ..materials.material import on_thin_walls, read_refraction
from .plane import FIT_BUTTON, chosen_image, squeeze, squeezed_words
from .scene_parts import WorldPart
from .shapes import ShapeCache

# cosine between a plate's normal and its x axis; above it the y axis is used
UPRIGHT = 0.99
OVERRIDE, DEFAULT = Message("override"), Message("default")  # sources of an index, like shaders
PICTURE = next(role for role in ROLES if role.name == "PICTURE")
CENTIMETRE = 0.01
DARKEST = 1e-6  # fraction of light left after 1 cm: black would absorb without limit
DEFAULT_IOR = GLASSES["Acrylic"].ior  # for glass without a refractive material


@dataclass(frozen=True)
class MaterialReading:
    """One material of a glass object, as read.

    source : the shader with the index, 'override' or 'default'
    ignored : settings of the material that Kiriko ignores
    own_ior : the material's index, used in renders
    abbe : the material's Abbe number; None without dispersion
    absorption : of red, green and blue, per Blender unit
    """

    object_name: str
    material_name: str
    ior: float
    source: str
    ignored: tuple[str, ...] = ()
    own_ior: float | None = None
    abbe: float | None = None
    absorption: tuple[float, float, float] = CLEAR


def read_glass(part: WorldPart) -> tuple[Glass, list[MaterialReading], list[str]]:
    """A glass with the index of its most used refractive material, or the override.

    Settings come from the original object: drivers and keyframes write to it, while the evaluated
    copy misses a script's changes.
    """
    settings = part.owner.kiriko
    readings, notes = _readings_of(part)
    if not readings:
        ior, source = (settings.ior, OVERRIDE) if settings.use_ior else (DEFAULT_IOR, DEFAULT)
        material = next((m.name for m in part.materials if m is not None), "")
        readings = [MaterialReading(part.owner.name, material, ior, source)]

        if source == DEFAULT:
            notes += on_thin_walls(part.materials)
            notes.append(
                Message(
                    "The material of '{name}' isn't glass; Kiriko uses an IOR of {ior}.",
                    name=part.owner.name,
                    ior=ior,
                )
            )

    notes += _notes_on_materials(part, readings)
    glass = Glass(
        part.name,
        part.mesh,
        _index_of(settings, readings[0]),
        settings.priority,
        settings.element.reflects,
        settings.element.prefers.lower(),
        _absorption_of(settings, readings[0], part.metres),
    )
    return glass, readings, notes


def _index_of(settings: bpy.types.PropertyGroup, reading: MaterialReading) -> Index:
    """The index read from a material, with the dispersion that its object's settings choose."""
    if settings.dispersion in GLASSES:
        return ShiftedIndex(GLASSES[settings.dispersion].dispersion, reading.ior)
    abbe = {"ABBE": settings.abbe, "MATERIAL": reading.abbe}.get(settings.dispersion)
    return ConstantIndex(reading.ior) if abbe is None else AbbeIndex(reading.ior, abbe)


def _absorption_of(
    settings: bpy.types.PropertyGroup, reading: MaterialReading, metres: float
) -> tuple[float, float, float]:
    """Absorption, 1/m, of red, green and blue, by the material or by the colour after 1 cm."""
    if not settings.use_tint:
        return tuple(one / metres for one in reading.absorption)
    return tuple(-log(max(part, DARKEST)) / CENTIMETRE for part in settings.tint)


def _readings_of(part: WorldPart) -> tuple[list[MaterialReading], list[str]]:
    """The refractive materials of a glass, with the override if there is one; their notes."""
    settings = part.owner.kiriko
    readings = []
    notes = []

    for material in part.materials:
        found = read_refraction(material)
        if found is None:
            continue

        notes += found.notes
        ior, source = (settings.ior, OVERRIDE) if settings.use_ior else (found.ior, found.source)
        readings.append(
            MaterialReading(
                object_name=part.owner.name,
                material_name=material.name,
                ior=ior,
                source=source,
                ignored=found.ignored,
                own_ior=found.ior,
                abbe=found.abbe,
                absorption=found.absorption,
            )
        )

    return readings, notes


def _notes_on_materials(part: WorldPart, readings: list[MaterialReading]) -> list[str]:
    """Notes on materials that do not refract, or disagree on the index."""
    name = part.owner.name
    notes = []

    plain = sorted(
        {m.name for m in part.materials if m is not None} - {r.material_name for r in readings}
    )
    if plain:
        listed = quoted(plain)
        notes.append(
            Message(
                "'{name}' has faces whose material isn't glass ({listed}); they count as glass.",
                name=name,
                listed=listed,
            )
        )

    others = {r.ior for r in readings} - {readings[0].ior}
    if others:
        listed = ", ".join(f"{ior:.4g}" for ior in sorted(others))
        notes.append(
            Message(
                "The materials of '{name}' have different IORs; Kiriko uses {ior:.4g} of"
                " '{material}', not {listed}.",
                name=name,
                ior=readings[0].ior,
                material=readings[0].material_name,
                listed=listed,
            )
        )

    return notes


def mirrors(ours: bpy.types.PropertyGroup) -> MirrorArray:
    """The mirrors of a plate's settings, for a model other than ideal."""
    return MirrorArray(
        layout=ours.model.lower(),
        pitch=1e-3 * ours.pitch,
        height=1e-3 * ours.pitch * ours.height,
        ior=ours.ior,
        reflectance=ours.reflectance,
        crossing_error=ours.crossing_error if ours.model == "CROSSED" else 0.0,
        has_fresnel=ours.fresnel,
        phase=tuple(ours.phase),
    )


def give_mirrors(ours: bpy.types.PropertyGroup, array: MirrorArray) -> None:
    """Set a plate's settings to mirrors; the inverse of `mirrors`."""
    ours.model = array.layout.upper()
    ours.pitch = 1e3 * array.pitch
    ours.height = array.height / array.pitch
    ours.ior = array.ior
    ours.reflectance = array.reflectance
    ours.crossing_error = array.crossing_error
    ours.fresnel = array.has_fresnel
    ours.phase = array.phase


def read_plate(part: WorldPart) -> Plate:
    """A plate with its mirrors, relative to the object's origin and x axis, or y if x is normal to
    the plate.
    """
    if part.owner.kiriko.plate.model == "IDEAL" or part.matrix is None:
        return Plate(part.name, part.mesh)

    x, y = normalise(part.matrix[:3, :2].T)
    corners = part.mesh.corners[:1]
    is_upright = len(corners) > 0 and abs(geometric_normals(corners)[0] @ x) > UPRIGHT
    return Plate(
        part.name,
        part.mesh,
        mirrors(part.owner.kiriko.plate),
        side=y if is_upright else x,
        centre=part.matrix[:3, 3],
    )


def shown_image(part: WorldPart) -> tuple[bpy.types.Image, Timing | None, list[str]]:
    """The solved image of a picture plane, its timing if a node gives one, and notes."""
    name = part.owner.name
    texture = part.texture
    notes = []
    image = chosen_image(part.owner)
    if image is None and texture is None:
        raise RigError(
            "'{name}' shows no image. Choose one.",
            name=name,
        )

    if image is None or (texture is not None and texture.image == image):
        image = texture.image
        notes = list(texture.notes)
    elif texture is not None:
        notes.append(
            Message(
                "'{name}' shows '{shown}', but Kiriko solves for '{image}'. Choose '{image}' again"
                " in the Kiriko tab to show it.",
                name=name,
                shown=texture.image.name,
                image=image.name,
            )
        )

    by_node = texture is not None and texture.image == image
    return image, texture.timing if by_node else None, notes


def tone_of(ours: bpy.types.PropertyGroup) -> Tone:
    """The tone of a picture's settings."""
    return Tone(ours.brightness, ours.gamma, ours.black_level)


def read_picture(part: WorldPart, cache: ShapeCache) -> tuple[Picture, list[str]]:
    """The picture plane with the pixels of its image.

    The mesh is checked first: without faces no material shows an image.
    """
    name = part.owner.name
    part.mesh.check(owner(PICTURE, part))
    image, timing, notes = shown_image(part)
    number = number_at(image, timing, part.frame)
    tone = tone_of(part.owner.kiriko.picture)
    pixels = cache.pixels(image, Message("the picture '{picture}'", picture=name), tone, number)
    notes += ended(image, timing, part.frame)

    if squeezed := squeezed_words(squeeze(flat_size(part.mesh), pixels.shape[1::-1])):
        notes.append(
            Message(
                "The image '{image}' is {squeezed} on '{name}': {remedy}.",
                image=image.name,
                squeezed=squeezed,
                name=name,
                remedy=FIT_BUTTON,
            )
        )

    place = PicturePlace(part.name, *pixels.shape[1::-1], part.mesh)
    return place.showing(pixels), notes + about(image) + cache.notes_on(image)


def place_of(
    image: bpy.types.Image, name: str, mesh: Mesh | None = None, number: int | None = None
) -> PicturePlace:
    """The place of a picture with this image; no pixels are read.

    number : the frame of a moving image, loaded if its size is not known yet
    """
    with at_frame(image, number if min(image.size) < 1 else None, name) as shown:
        width, height = shown.size
    return PicturePlace(name, width, height, mesh)


def about(image: bpy.types.Image) -> list[str]:
    """Notes on an image that was read only in part."""
    if image.source == "TILED":
        return [Message("Only the first tile of the image '{image}' is used.", image=image.name)]
    return []
