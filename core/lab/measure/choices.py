"""The cost or gain of Ghosts and Suppress Glare on a rig, by
how near the seen image comes to the ideal one.
"""

from collections.abc import Generator
from dataclasses import replace
from typing import NamedTuple

from ...base.steps import within
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...solve.session import Session
from .image_errors import psnr

GLARES = (0.0, 0.5, 1.0)


class Choice(NamedTuple):
    """One way to settle the colours of display pixels that
    are seen several times, or beside the glass.

    seen_psnr : dB, white is 1: all of the viewer's image, light beside the glass
        included, against the ideal image; None where they are the same
    """

    ghosts: str
    suppress_glare: float
    seen_psnr: float | None


def measure_choices(rig: Rig, settings: Settings) -> Generator[float, None, tuple[Choice, ...]]:
    """Solve a rig both ways of Ghosts, and with some
    weights of Suppress Glare; yields progress 0..1.

    Glare is left out where light beside the glass carries the picture, too.
    """
    glares = GLARES if settings.only_through_glass else ()
    ways = dict.fromkeys([
        *((ghosts, settings.suppress_glare if glares else 0.0) for ghosts in ("mean", "strongest")),
        *((settings.ghosts, glare) for glare in glares),
    ])  # fmt: skip
    ways = sorted(ways, key=lambda way: -way[1])

    session = Session()
    found = []
    first = None

    for n, (ghosts, glare) in enumerate(ways):
        here = replace(settings, ghosts=ghosts, suppress_glare=glare)
        solution = yield from within(session.solve(rig, here), n / len(ways), (n + 0.9) / len(ways))
        first = first or solution  # its map knows light beside the glass: all are seen through that
        seen = first.seen(solution.source, beside=True)
        found.append(Choice(ghosts, glare, psnr(seen - first.ideal())))

    return tuple(sorted(found))
