"""Blender's side of the display."""

from math import inf

import bpy
import numpy as np

from ...base.messages import Message
from ...rig.dispersion import P3_PRIMARIES, SRGB_PRIMARIES, Primaries
from ...rig.joined_display import sections_of, size_of
from ...rig.rig import Display, Rig
from ...rig.views import Views
from ..data.rectangle import flat_size
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache

NO_POLARISATION = Message(
    "The preview differs from Kiriko's result: {why}.",
    why=Message("Cycles has no polarisation, so its brightness is another"),
)


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A display with its resolution, black level and primaries."""
    ours = part.owner.kiriko
    polarised = ours.element.angle if ours.element.is_polarised else None
    light = ours.display.black_level, polarised, primaries_of(ours.display)
    display = Display(part.name, part.mesh, *ours.resolution, *light, views_of(ours.views))
    return FoundPart(display, [], [])


def primaries_of(ours: bpy.types.PropertyGroup) -> Primaries:
    """Wavelengths, m, of a display's settings."""
    own = tuple(1e-9 * nm for nm in ours.wavelengths)
    return {"SRGB": SRGB_PRIMARIES, "P3": P3_PRIMARIES}.get(ours.primaries, own)


def views_of(ours: bpy.types.PropertyGroup) -> Views | None:
    """The views of a display's settings; None if they are off, or one for all directions."""
    if not ours.use or ours.columns == ours.rows == 1:
        return None
    distance = 1e-3 * ours.distance or inf
    return Views(ours.columns, ours.rows, tuple(ours.cone), ours.overlap, distance)


def give_views(ours: bpy.types.PropertyGroup, views: Views | None) -> None:
    """Set a display's views; the inverse of `views_of`."""
    ours.use = views is not None
    if views is not None:
        for name in ("columns", "rows", "cone", "overlap"):
            setattr(ours, name, getattr(views, name))
        ours.distance = 0.0 if views.distance == inf else 1e3 * views.distance


def looks(rig: Rig) -> tuple[dict[str, shaders.ImageLook], list[str]]:
    """The looks of all displays and screens."""
    sections = sections_of(rig.outputs)
    size = size_of(sections) if sections else (1, 1)
    return {
        part.name: look_of(part, section.window(size))
        for part, section in zip(rig.lit, sections, strict=False)
    }, [NO_POLARISATION] if rig.is_polarised else []


def look_of(
    display: Display, window: tuple[float, float, float], is_two_sided: bool = False
) -> shaders.ImageLook:
    """How a display shows its window of an image, or its views."""
    look = shaders.ImageLook(display.black_level, *window, is_two_sided)
    views, size = display.views, flat_size(display.mesh)
    if views is None or views.n == 1 or size is None:
        return look
    per_view = 1 / views.spacing
    across, down = views.tiling(display.size)
    return look._replace(
        columns=views.columns,
        rows=views.rows,
        overlap=views.overlap,
        across=across,
        down=down,
        slopes=tuple(per_view.tolist()),
        places=tuple((np.array(size) / views.distance * per_view).tolist()),
    )


def shade(material: bpy.types.Material, look: shaders.ImageLook, studio: Studio) -> None:
    """Show the source image over the black level, or its coordinates."""
    shaders.show(material, studio.source, look)


IN_BLENDER = InBlender(read, shade, looks)
