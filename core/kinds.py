"""What the parts of a rig do to light."""

from enum import IntEnum


class Kind(IntEnum):
    """What a surface does to a ray."""

    GLASS = 0
    PLATE = 1
    MIRROR = 2
    BLOCKER = 3
    DISPLAY = 4
