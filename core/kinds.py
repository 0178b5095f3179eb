"""The kinds of parts of a rig, by their effect on light."""

from enum import IntEnum


class Kind(IntEnum):
    """The effect of a surface on a ray."""

    GLASS = 0
    PLATE = 1
    MIRROR = 2
    BLOCKER = 3
    DISPLAY = 4
