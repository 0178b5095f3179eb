"""First pictures: a rig seen by a viewer of few pixels is solved in a fraction of the time."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .plan import Settings
from .rig import Rig

# On the ball rig a viewer of 64 pixels paints a display of 512 to 0.006 rms of the full result, in linear values, at
# once; a display of half the resolution is off by 0.03. So the viewer is what a first picture saves on.
COARSE_VIEWER, FINER = 64, 4  # px of the longer side; how much finer each picture is than the one before
COARSE_DISPLAY = 512  # px of the longer side
COARSE_TOLERANCE = 1.0  # display px


def coarser(rig: Rig, settings: Settings, side: int) -> tuple[Rig, Settings]:
    """The rig seen by a viewer of about `side` pixels, for a first picture."""
    viewer, display = rig.viewer, rig.display
    n = -(-max(viewer.width, viewer.height) // side)
    m = -(-max(display.width, display.height) // COARSE_DISPLAY)
    return (
        replace(
            rig,
            viewers=(replace(viewer, width=-(-viewer.width // n), height=-(-viewer.height // n)),),
            displays=(replace(display, width=-(-display.width // m), height=-(-display.height // m)),),
        ),
        replace(settings, tolerance=max(settings.tolerance, COARSE_TOLERANCE), margin=-(-settings.margin // m)),
    )


def ladder(rig: Rig, settings: Settings) -> list[tuple[Rig, Settings]]:
    """What to solve, one after the other: the last is the rig itself, those before take a fraction of its time."""
    rungs, side = [], COARSE_VIEWER
    while 2 * side < max(rig.viewer.width, rig.viewer.height):
        rungs.append(coarser(rig, settings, side))
        side *= FINER
    return [*rungs, (rig, settings)]


def enlarged(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """An image (h, w, c) with as many pixels as the display: each is that of the coarse one it lies in."""
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels if pixels.shape[:2] == (height, width) else pixels[rows[:, None], columns]
