"""The first picture: a rig seen by viewers of few pixels is solved in a fraction of the time."""

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import replace
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.errors import KirikoError
from ..base.steps import hold_progress, run_steps
from ..light.mesh_cache import MeshCache
from ..rig.rig import Display, Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .session import Session
from .solution import Solution

Sized = TypeVar("Sized", Viewer, Display)

# Through a ball a viewer of 36 pixels is off by 0.006 rms, in linear values, and one of 64 by
# 0.003; through a bottle both by 0.09, and 64 take twice as long.
VIEWER_PX = 36  # longer side of one viewer; several share its pixels
LEAST_VIEWER_PX = 12
DISPLAY_PX = 512  # longer side at most; a display of half the resolution is off by 0.03 rms
TOLERANCE_PX = 2.0
SAVES = 4  # a rig less than so many times finer, each way, has none
WAIT_S = 0.2  # work of the solve, after the glass is ready, before it is made: a ball is done


def has_coarse(rig: Rig) -> bool:
    """Is the first picture of a rig so much coarser that it saves time?"""
    return max(map(_longer_side, rig.viewers)) >= SAVES * _viewer_side(rig)


def coarser(rig: Rig, settings: Settings, side: int | None = None) -> tuple[Rig, Settings]:
    """The rig and the settings of its first picture.

    side : longer side of each viewer, px; None: that of a first picture
    """
    side = side or _viewer_side(rig)
    n = -(-_longer_side(rig.display) // DISPLAY_PX)
    coarse_rig = replace(
        rig,
        viewers=tuple(_shrunk(one, -(-_longer_side(one) // side)) for one in rig.viewers),
        displays=tuple(_shrunk(one, n) for one in rig.displays),
    )
    return coarse_rig, replace(
        settings,
        tolerance=max(settings.tolerance, TOLERANCE_PX),
        margin=-(-settings.margin // n),
    )


def _viewer_side(rig: Rig) -> int:
    """Longer side of each viewer in it, px."""
    return max(LEAST_VIEWER_PX, round(VIEWER_PX / len(rig.viewers) ** 0.5))


def _longer_side(part: Viewer | Display) -> int:
    return max(part.width, part.height)


def _shrunk(part: Sized, n: int) -> Sized:
    """A viewer or a display with one pixel in the place of n, each way."""
    return replace(part, width=-(-part.width // n), height=-(-part.height // n))


def enlarged(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """An image (h, w, c) with as many pixels as the display:
    each is that of the coarse one it lies in.
    """
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels if pixels.shape[:2] == (height, width) else pixels[rows[:, None], columns]


def check_light(kept: MeshCache, rig: Rig, settings: Settings) -> None:
    """Raise the error with which a rig that stays dark, or shows nothing of the picture, would not
    be solved. It is solved only if a coarse one fails.

    kept : glass that is made ready, for the next look

    Raises
    ------
    RigError, MeshError : as by Session.solve
    """
    session = Session(kept)
    try:
        run_steps(session.glance(*coarser(rig, settings)))
    except KirikoError:  # in words of its own, and a coarse rig may miss light
        run_steps(session.solve(rig, settings))


def solve_in_sight(
    session: Session, rig: Rig, settings: Settings, show: Callable[[NDArray[np.float32]], None]
) -> Generator[float, None, Solution]:
    """The same as `session.solve`, for somebody who waits: `show` gets a coarse source image of
    the display's size.

    The rig itself is begun first, so that nothing is shown of one that cannot be solved, and rests
    while the coarse one is. None is made if nothing has to be traced: it would not be faster.
    """
    with closing(session.solve(rig, settings)) as solving:
        progress = next(solving)  # the glass is ready
        is_due = has_coarse(rig)
        worked = 0.0
        try:
            while True:
                yield progress
                if is_due and session.is_tracing and worked >= WAIT_S:
                    is_due = False
                    yield from _shown(session, rig, settings, show, progress)
                started = perf_counter()
                progress = next(solving)
                worked += perf_counter() - started
        except StopIteration as done:
            return done.value


def _shown(
    session: Session,
    rig: Rig,
    settings: Settings,
    show: Callable[[NDArray[np.float32]], None],
    progress: float,
) -> Generator[float, None, None]:
    """Show the first picture, unless it fails: coarse viewers may miss light of the rig's own."""
    try:
        source = yield from hold_progress(progress, session.glance(*coarser(rig, settings)))
    except (KirikoError, MemoryError):
        return
    show(enlarged(source, rig.display.width, rig.display.height))
    yield progress
