"""Lengths in and out of the scene: metres in core, the scene's unit in Blender and in sentences."""

import bpy
import numpy as np

from ...base.messages import Message

# metres and symbol of each unit of a scene
LENGTH_UNITS = {
    "KILOMETERS": (1e3, "km"),
    "METERS": (1.0, "m"),
    "CENTIMETERS": (1e-2, "cm"),
    "MILLIMETERS": (1e-3, "mm"),
    "MICROMETERS": (1e-6, "\N{MICRO SIGN}m"),
    "MILES": (1609.344, "mi"),
    "FEET": (0.3048, "ft"),
    "INCHES": (0.0254, "in"),
    "THOU": (2.54e-5, "thou"),
}
DIGITS = 3  # of a length in a sentence
READABLE = 0.01, 1e5  # other numbers are shown in a more suitable unit


def length_of_unit(scene: bpy.types.Scene) -> float:
    """Metres in a Blender unit.

    As in Blender, the unit scale counts only with a unit system.
    """
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else float(units.scale_length)


def length_text(scene: bpy.types.Scene, metres: float) -> str:
    """A length, m, in the unit of the scene's fields if the number is readable in it."""
    units = scene.unit_settings
    if units.system == "NONE":
        return Message("{number} units", number=_plain(metres))

    size, symbol = LENGTH_UNITS.get(units.length_unit, (0.0, ""))
    if size and (metres == 0 or READABLE[0] <= abs(metres) / size < READABLE[1]):
        return f"{_plain(metres / size)} {symbol}"

    text = bpy.utils.units.to_string(units.system, "LENGTH", metres, precision=DIGITS)
    # Blender rounds a micrometre to 0
    is_lost = metres != 0 and not any(digit in text for digit in "123456789")
    return f"{_plain(metres)} m" if is_lost else text


def _plain(number: float) -> str:
    """A number of DIGITS digits, without an exponent."""
    return np.format_float_positional(float(f"{number:.{DIGITS}g}"), trim="-")
