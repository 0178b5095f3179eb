"""Rigs without a plate, as an artist sets them up in Blender: a glass ball over a telephone,
a faceted crystal before a tablet, an aquarium before a monitor. Lengths in m.
"""

import bpy
import numpy as np

TELEPHONE = {"display_size": 0.0645, "display_resolution": (1170, 2532)}
TABLET = {"display_size": 0.1788, "display_resolution": (1668, 2388)}
MONITOR = {"display_size": 0.5977, "display_resolution": (2560, 1440)}


def glass(name: str, vertices: np.ndarray, faces: list[list[int]], ior: float) -> None:
    """A body of flat faces that look outward, selected, with its index."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices, float).tolist(), [], faces)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.use_ior, thing.kiriko.ior = True, ior
    thing.select_set(True)


def ball_over_telephone(**options: object) -> None:
    """A ball of 25 mm radius stands 50 mm over a telephone that lies flat, seen from above at 70
    degrees: so far off each place of the telephone is seen once.
    """
    add_behind(
        TELEPHONE,
        **{"look_down": np.radians(70), "distance": 0.05, "field": 0.03, "picture_size": 0.02}
        | options,
    )


def crystal(sides: int = 6) -> tuple[np.ndarray, list[list[int]]]:
    """A cut crystal that looks along -y: a table, crown facets at 40 degrees, a girdle, a flat
    back.
    """
    angle = 2 * np.pi * (np.arange(sides) + 0.2) / sides
    around = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    depths = 0.012, 0.0, -0.014 * np.tan(np.radians(40))
    rings = [r * around + [0, y, 0] for r, y in zip((0.03, 0.03, 0.016), depths, strict=True)]
    n = np.arange(sides)
    faces = [n[::-1].tolist(), (n + 2 * sides).tolist()]
    for low in (0, sides):
        faces += [
            [low + k, low + (k + 1) % sides, low + sides + (k + 1) % sides, low + sides + k]
            for k in n.tolist()
        ]
    return np.concatenate(rings), faces


def crystal_before_tablet(**options: object) -> None:
    """A faceted crystal before a tablet, of which each facet shows another part."""
    glass("Crystal", *crystal(), 1.52)
    add_behind(TABLET, **{"distance": 0.19, "field": 0.06, "picture_size": 0.046} | options)


def block(size: tuple[float, float, float], inset: float = 0.0) -> tuple[np.ndarray, list]:
    """A box that stands on the ground, its faces nearer to its middle by some way."""
    ground = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    wide, deep, high = size
    corners = [
        [x * (wide - 2 * inset), y * (deep - 2 * inset), z]
        for z in (inset, high - inset)
        for x, y in ground
    ]
    around = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    return np.array(corners), [[3, 2, 1, 0], [4, 5, 6, 7], *around]


def aquarium_before_monitor(**options: object) -> None:
    """A closed glass box full of water before a monitor, seen from the side at 20 degrees.

    The water is drawn as a body within a body of glass: Cycles cannot follow faces that touch.
    """
    size = 0.2, 0.1, 0.15
    glass("Aquarium", *block(size), 1.52)
    glass("Water", *block(size, 0.005), 1.333)
    add_behind(MONITOR, **{"azimuth": np.radians(20), "field": 0.1, "picture_size": 0.08} | options)


def add_behind(display: dict[str, object], **options: object) -> None:
    assert bpy.ops.kiriko.add_rig(kind="BEHIND_GLASS", **{**display, **options}) == {"FINISHED"}


RIGS = {
    "telephone": ball_over_telephone,
    "tablet": crystal_before_tablet,
    "aquarium": aquarium_before_monitor,
}
