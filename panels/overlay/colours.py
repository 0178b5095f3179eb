"""Colours (sRGB) and line widths of everything Kiriko draws in viewports."""

ARRIVES = (0.25, 0.85, 0.35)
LOST = (0.95, 0.25, 0.2)
AERIAL = (0.3, 0.65, 1.0)  # mid-air image of the display, and outline of the picture
CONTOUR = (0.95, 0.97, 1.0)  # outline of the glass in Look Through Viewer
DIMENSION = (0.8, 0.8, 0.8)
SHADOW = (0.0, 0.0, 0.0)  # behind labels and lines, for any background

OF_STATE = {"arrives": ARRIVES, "lost": LOST, "aerial": AERIAL, "picture": AERIAL}

# px at an interface scale of 1
WAY_PX = 1.5
OUTLINE_PX = 1.25
DIMENSION_PX = 1.0
HATCH_PX = 1.25
SHADOW_PX = 2.0  # added to the width of a line's shadow
TEXT_PX = 12

HATCH_ALPHA = 0.75
CONTOUR_ALPHA = 0.6
SHADOW_ALPHA = 0.35
FAINT = 0.3  # factor on alpha while a drawing is out of date


def lighter(colour: tuple[float, float, float]) -> tuple[float, ...]:
    """A lighter colour for thin letters, halfway to white."""
    return tuple((1 + part) / 2 for part in colour)
