"""Remedies where a result lacks some of the picture, with their amounts, for the checklist."""

from collections.abc import Generator

from ..core.bench.helps import Helps, what_helps
from ..core.blender.checklist import REMEDIES, WORTH
from ..core.rig import Rig
from ..core.settings import Settings
from ..core.solve.solution import Solution
from . import work

SECONDS = 4.0  # that the search may take: most take one


def remedies_for(
    rig: Rig, settings: Settings, solution: Solution
) -> Generator[float, None, Helps | None]:
    """Remedies for the light that a solution lost, None where it is not worth one; yields
    progress 0..1.
    """
    if not any(solution.misses.get(reason, 0.0) >= WORTH for reason in REMEDIES):
        return None
    session = work.session()
    return (yield from what_helps(rig, lambda rig: session.plan(rig, settings), SECONDS))
