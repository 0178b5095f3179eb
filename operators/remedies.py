"""Remedies for an incomplete result, with their amounts, for the checklist."""

from collections.abc import Generator

from ..core.base.fingerprint import fingerprint
from ..core.base.steps import subprogress
from ..core.bench.measured_remedies import Help, Remedies, find_remedies, legible_by
from ..core.blender.checks.checklist import REMEDIES, WORTH
from ..core.light.mesh_cache import MeshCache
from ..core.rig.rig import Rig
from ..core.rig.settings import Settings
from ..core.solve.legibility import READABLE, card_legibility
from ..core.solve.solution import Solution
from . import work

SECONDS = 4.0  # s of the search; most take one


def remedies_for(
    rig: Rig, settings: Settings, solution: Solution
) -> Generator[float, None, Remedies | None]:
    """Remedies for the light a solution lost; None if the loss is too small. Yields progress
    0..1.
    """
    if not any(solution.misses.get(reason, 0.0) >= WORTH for reason in REMEDIES):
        return None
    session = work.session()
    return (yield from find_remedies(rig, lambda rig: session.plan(rig, settings), SECONDS))


def legible(
    rig: Rig, settings: Settings, is_watched: bool
) -> Generator[float, None, tuple[float, tuple[Help, ...]]]:
    """Legibility of the picture, 0..1, and measured remedies if it is low; yields progress 0..1.

    Remedies are measured only if somebody sees the checklist.
    """
    key = fingerprint(rig.light_keys, rig.picture_place, settings.of_optics, is_watched)
    known = work.legible()
    if key not in known:  # legibility does not depend on the picture
        cache, helps = MeshCache(), ()
        work.session().lend(cache)
        found = yield from subprogress(card_legibility(rig, settings, cache), 0.0, 0.2)
        if found < READABLE and is_watched:
            helps = yield from subprogress(legible_by(rig, settings, found, cache), 0.2, 1.0)
        known.clear()
        known[key] = found, helps
    return known[key]
