"""Lateral colour: the distance between the images that a viewer sees in the display's primaries.

Glass bends each colour by its own index. If light of all primaries that a viewer sees at a place
leaves from nearly the same place of the display, one map serves all colours. Otherwise each colour
has a map of its own, and the source image is displaced from colour to colour the opposite way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.fingerprint import fingerprint
from ..base.messages import Message
from ..base.numbers import number
from ..base.steps import Steps, run_steps
from ..light.compile_plan import compile_plan_steps
from ..light.mesh_cache import MeshCache
from ..light.plan import Plan
from ..light.rays import main_landings
from ..light.trace import trace_all
from ..map.view_map import ViewMap
from ..rig.rig import Rig, Viewer
from ..rig.settings import Settings

N_RAYS = 1024  # through each viewer's image
# of two coordinates, from ray to ray, as evenly spread as it gets; no ray is on a corner of cells,
# where maps are exact. Source: Roberts, The unreasonable effectiveness of quasirandom sequences
SPREAD = 0.7548776662466927, 0.5698402909980532
STEP_PX = 0.01  # viewer px, between rays whose landings give a derivative
MOST_ROUNDS = 8  # of Newton's method
MOST_UNLIKE = 0.01  # fraction of rays that pass other surfaces in another colour, as at rims
SETTLED_PX = 1e-6  # viewer px, the last move


@dataclass(frozen=True)
class Distances:
    """Distances between the images of the outer primaries, over the places seen in all colours.

    mean_px, largest_px : viewer px
    mean_arcmin, largest_arcmin : None for a viewer without perspective
    """

    mean_px: float
    largest_px: float
    mean_arcmin: float | None
    largest_arcmin: float | None


@dataclass(frozen=True)
class LateralColour:
    """Lateral colour of the first viewer; None for distances if no place is seen in all colours.

    apart : display px, largest distance between landings of the primaries, over all viewers; None
        if they land by different paths
    is_one_map : one map serves all primaries; its distances are not measured
    before : with one map, of the middle primary
    after : with a map for each primary
    """

    apart: float | None
    is_one_map: bool = False
    before: Distances | None = None
    after: Distances | None = None


def landings_apart(rig: Rig, settings: Settings, cache: MeshCache) -> Steps[float]:
    """Largest distance, display px, between landings of light of the display's primaries that a
    viewer sees at one place, by one path; from a sample of rays. Infinite if this is within the
    tolerance, but a hundredth of the rays land by different paths, or in some colours only.

    Raises
    ------
    RigError, MeshError : from compile_plan
    """
    plans = []
    for wavelength in rig.display.primaries:
        here = replace(settings, wavelength=wavelength)
        plans.append((yield from compile_plan_steps(rig, here, cache)))

    apart, is_unlike = 0.0, False
    for viewer in rig.viewers:
        xy = _sample(viewer)
        found = [_landed(plan.seen_by(viewer), xy) for plan in plans]
        yield 0
        same = _are_alike(found)
        is_seen = np.any([path != 0 for _, path in found], axis=0)
        is_unlike |= (is_seen & ~same).sum() > MOST_UNLIKE * is_seen.sum()
        places = np.stack([at[same] for at, _ in found])
        between = np.linalg.norm(places[:, None] - places[None], axis=-1)
        apart = max(apart, float(between.max(initial=0.0)))
    return np.inf if is_unlike and apart <= settings.tolerance else apart


MAP_EACH = Message("a map for each colour")


def why_one_map(colour: LateralColour | None) -> tuple[Message, ...]:
    """Why a solve has one map for all colours."""
    reason = Message("no dispersion")
    if colour is not None:
        reason = Message("one serves all: at most {px} px apart", px=number(colour.apart))
    return (Message("{name} ({reason})", name=MAP_EACH, reason=reason),)


class Colours:
    """Decides how many maps the colours of a rig need; caches its last answers."""

    def __init__(self, cache: MeshCache) -> None:
        self._cache = cache
        self._apart = "", 0.0  # key of the light, and display px
        self._lateral: tuple[tuple[str, ...], LateralColour] | None = None  # by keys of maps

    def needed(self, rig: Rig, settings: Settings) -> Steps[tuple[Rig, float | None]]:
        """The rig, in one colour if one map serves all, and the distance between the colours'
        landings, display px; None without dispersion.
        """
        if not rig.disperses:
            return rig, None
        if self._apart[0] != _light_key(rig, settings):
            apart = yield from landings_apart(rig, settings, self._cache)
            self._apart = _light_key(rig, settings), apart
        return self.cached(rig, settings), self._apart[1]

    def cached(self, rig: Rig, settings: Settings) -> Rig | None:
        """The rig of `needed` if it is known without tracing."""
        if not rig.disperses:
            return rig
        key, apart = self._apart
        if key != _light_key(rig, settings):
            return None
        return rig.in_one_colour(settings.wavelength) if apart <= settings.tolerance else rig

    def lateral(
        self,
        plans: Sequence[Plan],
        maps: Sequence[ViewMap],
        keys: tuple[str, ...],
        apart: float | None,
    ) -> LateralColour | None:
        """Lateral colour of the first viewer; None without dispersion.

        plans, maps, keys : of all channels, by viewer
        apart : from `needed`
        """
        if apart is None:
            return None
        if not plans[0].rig.disperses:
            return LateralColour(apart, is_one_map=True)
        n = len(plans) // len(plans[0].rig.viewers)
        if self._lateral is None or self._lateral[0] != keys:
            self._lateral = keys, lateral_colour(plans[:n], maps[:n], apart)
        return self._lateral[1]


def _light_key(rig: Rig, settings: Settings) -> str:
    """Key of the light of all viewers in the colours of the display."""
    return fingerprint(rig.light_keys, rig.display.primaries, settings.of_optics)


def lateral_colour(plans: Sequence[Plan], maps: Sequence[ViewMap], apart: float) -> LateralColour:
    """Lateral colour of the viewer of plans and maps, one for each primary.

    A point that the source image shows in a colour at a place of the display is seen where a ray
    of this colour lands there, by Newton's method.
    """
    viewer = plans[0].viewer
    xy = _sample(viewer)
    found = [_landed(plan, xy) for plan in plans]
    xy = xy[_are_alike(found)]
    middle = run_steps(maps[len(maps) // 2].lookup.by_cells(xy))
    outer = [(plans[k], maps[k]) for k in (0, -1)]
    before = [_seen_at(plan, middle, xy) for plan, _ in outer]
    after = [_seen_at(plan, run_steps(one.lookup.by_cells(xy)), xy) for plan, one in outer]
    return LateralColour(
        apart if np.isfinite(apart) else None,
        before=_distances(viewer, *before),
        after=_distances(viewer, *after),
    )


def _sample(viewer: Viewer) -> Floats:
    """Viewer px (n, 2) of rays spread over the image."""
    part = (0.5 + np.arange(N_RAYS)[:, None] * SPREAD) % 1
    return part * (viewer.width, viewer.height)


def _landed(plan: Plan, xy: Floats) -> tuple[Floats, np.ndarray]:
    """Landings (n, 2), display px, of rays through viewer px (n, 2), and their branches; NaN and 0
    without one.
    """
    landings = main_landings(trace_all(plan, *plan.viewer.rays(xy)), len(xy))
    has_arrived = landings.has_arrived
    at = np.where(has_arrived[:, None], landings.xy, np.nan)
    return at, np.where(has_arrived, landings.branch, np.uint64(0))


def _are_alike(found: Sequence[tuple[Floats, np.ndarray]]) -> Bools:
    """Rays (n,) that land by one path in all colours."""
    branch = np.stack([one for _, one in found])
    return (branch[0] != 0) & (branch == branch[0]).all(axis=0)


def _seen_at(plan: Plan, targets: Floats, start: Floats) -> Floats:
    """Viewer px (n, 2), near a start, whose rays land on targets (n, 2), display px; NaN if there
    are none by the same path.
    """
    at, path = start.copy(), _landed(plan, start)[1]
    last = np.full(at.shape, np.nan)
    for _ in range(MOST_ROUNDS):
        landed, branch = _landed(plan, at)
        sides = [_landed(plan, at + STEP_PX * np.eye(2)[k])[0] - landed for k in (0, 1)]
        (a, c), (b, d) = (side.T / STEP_PX for side in sides)
        x, y = np.where((branch == path)[:, None], targets - landed, np.nan).T
        with np.errstate(invalid="ignore", divide="ignore"):
            move = np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None]
        last = np.linalg.norm(move, axis=1)
        at = at + move
        if not (last > SETTLED_PX).any():
            break
    return np.where((last <= SETTLED_PX)[:, None], at, np.nan)


def _distances(viewer: Viewer, one: Floats, other: Floats) -> Distances | None:
    """Distances between places (n, 2), viewer px, without those that are NaN."""
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    if not known.any():
        return None
    length = np.linalg.norm(one[known] - other[known], axis=1)
    pixels = float(length.mean()), float(length.max())
    if viewer.projection != "perspective":
        return Distances(*pixels, None, None)
    angle = viewer.arcmin_between(one[known], other[known])
    return Distances(*pixels, float(angle.mean()), float(angle.max()))
