"""The first picture: a coarse source image, solved for few viewer pixels in a fraction of the
time.
"""

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

# Through a ball, a viewer of 36 px has an rms error of 0.006 in linear values and one of 64 px
# 0.003. Through a bottle both have 0.09, and 64 px take twice as long.
VIEWER_PX = 36  # longer side of one viewer; several viewers share its pixels
LEAST_VIEWER_PX = 12
DISPLAY_PX = 512  # longest side; half of a display's resolution costs an rms error of 0.03
TOLERANCE_PX = 2.0
SAVES = 4  # least ratio of resolutions, each way, that is worth a first picture
WAIT_S = 0.2  # work of the solve before a first picture: a ball is finished by then


def has_coarse(rig: Rig) -> bool:
    """Whether a rig's first picture is coarse enough to save time."""
    return max(map(_longer_side, rig.viewers)) >= SAVES * _viewer_side(rig)


def coarser(rig: Rig, settings: Settings, side: int | None = None) -> tuple[Rig, Settings]:
    """Rig and settings of the first picture.

    side : longer side of each viewer, px; None for the default
    """
    side = side or _viewer_side(rig)
    n = -(-max(map(_longer_side, rig.lit)) // DISPLAY_PX)
    coarse_rig = replace(
        rig.joined,
        viewers=tuple(_shrunk(one, -(-_longer_side(one) // side)) for one in rig.viewers),
        displays=(_shrunk(rig.display, n),),
    )
    return coarse_rig, replace(
        settings,
        tolerance=max(settings.tolerance, TOLERANCE_PX),
        margin=-(-settings.margin // n),
    )


def _viewer_side(rig: Rig) -> int:
    """Longer side of each viewer of the first picture, px."""
    return max(LEAST_VIEWER_PX, round(VIEWER_PX / len(rig.viewers) ** 0.5))


def _longer_side(part: Viewer | Display) -> int:
    return max(part.width, part.height)


def _shrunk(part: Sized, n: int) -> Sized:
    """A viewer or a display with 1/n of its pixels each way."""
    return replace(part, width=-(-part.width // n), height=-(-part.height // n))


def enlarged(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """An image (h, w, c) enlarged to the display's pixels by its nearest pixels."""
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels if pixels.shape[:2] == (height, width) else pixels[rows[:, None], columns]


def check_light(cache: MeshCache, rig: Rig, settings: Settings) -> None:
    """Refuse a rig whose display stays dark or shows nothing of the picture.

    The full rig is solved only if a coarse solve fails.

    cache : cache of prepared glass

    Raises
    ------
    RigError, MeshError : from Session.solve
    """
    session = Session(cache)
    try:
        run_steps(session.solve_preview(*coarser(rig, settings)))
    except KirikoError:  # a coarse rig may miss light, and the full one reports its own reason
        run_steps(session.solve(rig, settings))


def solve_in_sight(
    session: Session, rig: Rig, settings: Settings, show: Callable[[NDArray[np.float32]], None]
) -> Generator[float, None, Solution]:
    """`session.solve` with a preview: `show` gets a coarse source image of the display's size.

    The full solve starts first, so that no preview appears for a rig that cannot be solved; it
    pauses while the coarse one runs. If nothing has to be traced there is no preview.
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
    """Show the first picture unless it fails: coarse viewers may miss light."""
    try:
        source = yield from hold_progress(progress, session.solve_preview(*coarser(rig, settings)))
    except (KirikoError, MemoryError):
        return
    show(enlarged(source, *rig.display.image_size))
    yield progress
