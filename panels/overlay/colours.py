"""The colours of all that Kiriko draws in viewports, as sRGB, and the widths of its lines."""

ARRIVES = (0.25, 0.85, 0.35)
LOST = (0.95, 0.25, 0.2)
AERIAL = (0.3, 0.65, 1.0)  # the aerial plane, and the picture's own outline
CONTOUR = (0.95, 0.97, 1.0)  # of the glass, seen through the viewer
DIMENSION = (0.8, 0.8, 0.8)
SHADOW = (0.0, 0.0, 0.0)  # behind words and lines, so that they are read on any ground

OF_STATE = {"arrives": ARRIVES, "lost": LOST, "aerial": AERIAL, "picture": AERIAL}

# px at a scale of the interface of 1
WAY_PX = 1.5
OUTLINE_PX = 1.25
DIMENSION_PX = 1.0
HATCH_PX = 1.25
SHADOW_PX = 2.0  # a line's shadow is wider by this much
TEXT_PX = 12

HATCH_ALPHA = 0.75
CONTOUR_ALPHA = 0.6
SHADOW_ALPHA = 0.35
FAINT = 0.3  # of all alphas: of the scene as it was


def lighter(colour: tuple[float, float, float]) -> tuple[float, ...]:
    """A colour for words, which are thin: halfway to white."""
    return tuple((1 + part) / 2 for part in colour)
