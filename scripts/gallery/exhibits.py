"""The exhibits of the gallery: a glass, its picture, its rig and the view of it. Lengths in m."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy

from gallery import drawings, glasses
from gallery.room import Look, Place, block, lacquer, rounded, wood
from kiriko.core.base.arrays import Floats

SLAB = 0.0716, 0.0078, 0.1476  # a phone
CORNER = 0.008  # radius of its corners
FOOT = 0.004  # height of its lower edge


@dataclass(frozen=True)
class Exhibit:
    """One render of the gallery.

    Parameters
    ----------
    glass : makes the glass, on a table at z = 0
    drawing : makes the picture
    at, size : middle of the picture; width and height
    look : camera of the viewer
    back : y of the table's far edge, in front of the plate; light below it is blocked
    rig : options of Add Rig
    is_fitted : whether the display gets the size of the light; else Add Rig's is used
    light : brightness of the display, in the picture's white
    has_glare : False: light outside the picture is suppressed
    furnish : adds furniture of its own
    """

    glass: Callable[[], bpy.types.Object]
    drawing: Callable[[], Floats]
    at: Place
    size: tuple[float, float]
    look: Look
    back: float = 0.10
    rig: dict[str, object] = field(default_factory=dict)
    is_fitted: bool = True
    light: float = 1.3
    has_glare: bool = True
    furnish: Callable[[], None] = lambda: None


def phone() -> None:
    """Set the display upright on the table, in the body of a phone."""
    display = next(t for t in bpy.context.scene.objects if t.kiriko.role == "DISPLAY")
    display.location.z = FOOT + SLAB[2] / 2
    x, y, z = display.location
    wide, deep, high = SLAB
    body = rounded("Phone", SLAB, CORNER, lacquer("Metal", (0.55, 0.56, 0.60)))
    body.location = x, y + deep / 2 + 0.0005, z
    front = (wide - 0.002, 0.0004, high - 0.002)
    glass = rounded("Front", front, CORNER - 0.001, lacquer("Front", (0.004, 0.004, 0.005)))
    glass.location = x, y + 0.0003, z
    block("Foot", (0.09, 0.03, 0.012), (x, y + 0.016, 0.006), wood())


EXHIBITS = {
    "goblet": Exhibit(
        glasses.goblet, drawings.goldfish, (0.0, 0.0, 0.0665), (0.054, 0.054),
        Look((0.0, 0.0, 0.055), 0.17, 6.0),
    ),
    "crystal": Exhibit(
        glasses.crystal, drawings.snowflake, (0.0, 0.0, 0.036), (0.048, 0.048),
        Look((0.0, 0.0, 0.038), 0.13, 6.0),
    ),
    "bottle": Exhibit(
        glasses.bottle, drawings.ship, (-0.034, 0.0, 0.041), (0.084, 0.056),
        Look((0.004, 0.0, 0.042), 0.27, 5.0), back=0.045, light=1.2,
    ),
    "phone": Exhibit(
        glasses.lens, drawings.clock, (0.0, 0.0226, 0.0375), (0.056, 0.056),
        Look((0.0, 0.0, 0.072), 0.235, 8.0), back=0.5,
        rig={
            "kind": "BEHIND_GLASS", "distance": 0.007, "look_down": math.radians(8),
            "display_size": 0.0645, "display_resolution": (1170, 2532),
        },
        is_fitted=False, light=1.2, has_glare=False, furnish=phone,
    ),
    "text": Exhibit(
        glasses.letters, drawings.sunset, (0.0, 0.0, 0.0195), (0.22, 0.055),
        Look((0.0, 0.0, 0.026), 0.25, 6.0), back=0.03,
        # as small as the picture, or light of the bevels would show between the letters
        rig={"picture_size": 0.21, "display_size": 0.224, "display_resolution": (1920, 480)},
        is_fitted=False, light=1.2, has_glare=False,
    ),
    "cube": Exhibit(
        glasses.cube, drawings.planet, (0.0, 0.0, 0.025), (0.040, 0.040),
        Look((0.0, 0.0, 0.027), 0.115, 9.0), light=1.0,
    ),
}  # fmt: skip
