"""First pictures: a rig seen by a viewer of few pixels is solved in a fraction of the time."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.errors import KirikoError, RigError
from ..base.steps import at, finish
from ..light.mesh_cache import Kept
from ..rig.rig import Display, Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .picture_coverage import check_seen
from .session import Session
from .solution import Solution

Sized = TypeVar("Sized", Viewer, Display)


@dataclass(frozen=True)
class Coarse:
    """How coarse a first picture is, and when it is made.

    A display of half the resolution is off by 0.03 rms, in linear values, through a ball; a viewer
    of 36 pixels by 0.006, and of 64 by 0.003. Through a bottle both are off by 0.09, and 64 pixels
    take twice as long. So a first picture saves on the viewer, and quarters no pixel: 24 that were
    quartered twice where borders cross them took a bottle twice as long, and erred as much. A rig
    done before its first picture would be made needs none: the ball's is.

    Of three viewers or more the one in the middle tells most, and the others light what it does not
    see. Nine that shared its pixels took more than twice as long, and erred more. Two do share.

    viewer_px : of the longer side of one viewer, or the one in the middle; else, and in later
        pictures, several share the pixels that it would have
    beside_px : of the longer side of those around it, and of all that share at the least
    beside_weight : they count so many times less than the one in the middle
    most_viewers : in a first picture, those furthest apart
    display_px : of the longer side
    finer : how much finer each picture is than the one before
    saves : how much finer the rig itself is, at the least, each way
    tracing_s, painting_s : work after the build that the rig itself gets before its first picture
        is made, while it traces and while it paints images larger than coarse ones
    """

    viewer_px: int = 36
    beside_px: int = 12
    beside_weight: float = 0.01
    most_viewers: int = 5
    display_px: int = 512
    tolerance_px: float = 2.0
    finer: int = 8
    saves: int = 4
    tracing_s: float = 0.2
    painting_s: float = 0.4


COARSE = Coarse()


def coarser(rig: Rig, settings: Settings, side: int) -> tuple[Rig, Settings]:
    """The rig seen by viewers of about `side` pixels, for a first picture."""
    # how many pixels of the display, each way, become one
    display = rig.display
    n = -(-max(display.width, display.height) // COARSE.display_px)

    coarse_rig = replace(
        rig,
        viewers=tuple(_of_side(viewer, side) for viewer in rig.viewers),
        displays=(_with_fewer_pixels(display, n),),
    )

    coarse_settings = replace(
        settings,
        tolerance=max(settings.tolerance, COARSE.tolerance_px),
        margin=-(-settings.margin // n),
    )
    return coarse_rig, coarse_settings


def coarsest(rig: Rig, settings: Settings) -> tuple[Rig, Settings]:
    """The rig and the settings of the first picture.

    Where one viewer counts more than all others by far, there is
    nothing to settle that they disagree about.
    """
    if len(rig.viewers) < 3:
        return coarser(rig, settings, shared_side(rig))

    beside, settings = coarser(rig, settings, COARSE.beside_px)
    middle, *others = _spread(rig.viewers)
    blind = {k for k, viewer in enumerate(beside.viewers) if not _is_seen(rig, viewer)}

    # none is left out that the rig would be refused for
    chosen = blind.union(others[: COARSE.most_viewers - 1]) - {middle}
    viewers = [
        replace(beside.viewers[k], weight=COARSE.beside_weight * beside.viewers[k].weight)
        for k in sorted(chosen)
    ]
    viewers.append(_of_side(rig.viewers[middle], COARSE.viewer_px))
    return replace(beside, viewers=tuple(viewers)), replace(settings, disagreement="blended")


def _spread(viewers: Sequence[Viewer]) -> list[int]:
    """Numbers of viewers: first the one next to the middle of all, as they
    count, then always the one that is furthest from all before.
    """
    places = np.array([viewer.position for viewer in viewers])
    middle = np.average(places, axis=0, weights=[viewer.weight for viewer in viewers])
    found = [int(np.linalg.norm(places - middle, axis=1).argmin())]
    away = np.full(len(places), np.inf)
    while len(found) < len(places):
        away = np.minimum(away, np.linalg.norm(places - places[found[-1]], axis=1))
        away[found] = -1.0
        found.append(int(away.argmax()))
    return found


def _is_seen(rig: Rig, viewer: Viewer) -> bool:
    """Does a viewer see the picture, with no glass in the way?"""
    try:
        check_seen(rig.place_of(viewer), viewer)
    except RigError:
        return False
    return True


def _of_side(viewer: Viewer, side: int) -> Viewer:
    """A viewer of about `side` pixels."""
    return _with_fewer_pixels(viewer, -(-_longer_side(viewer) // side))


def _with_fewer_pixels(part: Sized, n: int) -> Sized:
    """A viewer or a display with one pixel in the place of n, each way."""
    return replace(part, width=-(-part.width // n), height=-(-part.height // n))


def _longer_side(part: Viewer | Display) -> int:
    """Of the image of a viewer or a display, px."""
    return max(part.width, part.height)


def shared_side(rig: Rig) -> int:
    """Of viewers that share the pixels of one of a first picture, px."""
    return max(COARSE.beside_px, round(COARSE.viewer_px / len(rig.viewers) ** 0.5))


def ladder(rig: Rig, settings: Settings) -> list[tuple[Rig, Settings]]:
    """The rigs to solve, one after the other: the last is the rig
    itself, those before take a fraction of its time.
    """
    rungs = []
    side = shared_side(rig)
    while COARSE.saves * side <= max(map(_longer_side, rig.viewers)):
        rungs.append(coarser(rig, settings, side) if rungs else coarsest(rig, settings))
        side *= COARSE.finer
    return [*rungs, (rig, settings)]


def enlarged(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """An image (h, w, c) with as many pixels as the display:
    each is that of the coarse one it lies in.
    """
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels if pixels.shape[:2] == (height, width) else pixels[rows[:, None], columns]


def check_light(kept: Kept, rig: Rig, settings: Settings) -> None:
    """Raise the error with which a rig that stays dark, or shows nothing of the picture, would not
    be solved. It is solved only where a coarse one cannot be.

    kept : glass that is made ready, for the next look

    Raises
    ------
    RigError, MeshError : as by Session.solve
    """
    session = Session(kept)
    try:
        finish(session.glance(*coarser(rig, settings, shared_side(rig))))
    except KirikoError:  # in words of its own, and a coarse rig may miss light
        finish(session.solve(rig, settings))


def solve_in_sight(
    session: Session, rig: Rig, settings: Settings, show: Callable[[NDArray[np.float32]], None]
) -> Generator[float, None, Solution]:
    """The same as `session.solve`, for somebody who waits:
    `show` gets coarse source images of the display's size.

    The rig itself is begun first, so that nothing is shown where it cannot be solved; it rests
    while a coarse picture is made. The next one, which takes `finer`^2 times as long, comes after
    as many times the work. None is made where nothing has to be traced, since nothing coarse is
    faster.
    """
    is_large = max(map(_longer_side, (*rig.viewers, rig.display))) > COARSE.display_px
    worked, patience = 0.0, 1

    with closing(session.solve(rig, settings)) as solving:
        progress = next(solving)  # the glass is made ready
        rungs = ladder(rig, settings)[:-1] if session.is_tracing else []

        try:
            while True:
                yield progress
                is_tracing = session.is_tracing
                enough = COARSE.tracing_s if is_tracing else COARSE.painting_s
                if rungs and (is_tracing or is_large) and worked >= patience * enough:
                    patience *= COARSE.finer**2
                    yield from _shown(session, *rungs.pop(0), rig, show, progress)

                started = perf_counter()
                progress = next(solving)
                worked += perf_counter() - started
        except StopIteration as done:
            return done.value


def _shown(
    session: Session,
    rig: Rig,
    settings: Settings,
    whole: Rig,
    show: Callable[[NDArray[np.float32]], None],
    progress: float,
) -> Generator[float, None, None]:
    """Show a coarse picture of the whole rig, unless it fails, as
    where its viewer misses light of the whole one's.
    """
    try:
        source = yield from at(progress, session.glance(rig, settings))
    except (KirikoError, MemoryError):
        return
    show(enlarged(source, whole.display.width, whole.display.height))
    yield progress
