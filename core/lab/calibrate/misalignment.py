"""The view of a bench whose parts do not stand, or are not made, as planned.

A dot of the source image stays where it is on the display; the viewer sees it where a ray lands on
it. With y the map from viewer to display and p the errors, dx = -J^-1 dy/dp: by the view map's own
derivatives, with no dot looked for.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Floats
from ...base.steps import run_steps
from ...bench.offset import Parameter, parameters, with_part
from ...light.compile_plan import compile_plan
from ...light.mesh_cache import MeshCache
from ...light.plan import Plan
from ...light.rays import Words, main_landings
from ...light.trace import trace_all
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...rig.viewer import Viewer

FEWEST = 4  # points: eight numbers, as many as a picture in perspective has


@dataclass(frozen=True)
class Newton:
    """How a dot of the display is found in the viewer's image; held to traced benches by
    tests/core/test_misalignment.py.

    step_px : viewer px, for derivatives of the view map
    most_steps : of Newton's method
    farthest_px : viewer px, in one of them
    converged_px : display px
    found_px : display px, by which a dot may be missed that counts as found
    """

    step_px: float = 0.02
    most_steps: int = 30
    farthest_px: float = 40.0
    converged_px: float = 1e-7
    found_px: float = 1e3 * 1e-7


NEWTON = Newton()


class Bench:
    """A planned rig and the points of the picture that are looked at.

    Parameters
    ----------
    rig, settings : as planned
    view : (m, 2) viewer px at which the points are seen as long as nothing is off
    among : the parameters that may be off; by default all

    Attributes
    ----------
    display : (m, 2) display px at which the display shows the
        points; NaN where the viewer does not see them
    """

    def __init__(
        self, rig: Rig, settings: Settings, view: Floats, among: list[Parameter] | None = None
    ) -> None:
        # a point that is seen beside the glass is none of those that are seen in it
        self.rig = rig
        self.settings = replace(settings, suppress_glare=0.0)
        self.view = np.asarray(view, float)
        self.parameters = parameters(rig) if among is None else among
        self._kept = MeshCache()
        self._off = np.zeros(len(self.parameters)), rig
        self.display, self._branch = self._land(self.plan(), self.view)

    @property
    def viewer(self) -> Viewer:
        """The one in whose image the points are: the rig's first."""
        return self.rig.viewers[0]

    def plan(self, amounts: Floats | None = None) -> Plan:
        """Of the bench, with amounts (p,) of its parameters."""
        amounts = np.zeros(len(self.parameters)) if amounts is None else np.array(amounts, float)
        return compile_plan(self._rig(amounts), self.settings, self._kept)

    def _rig(self, amounts: Floats) -> Rig:
        """The rig with amounts (p,) off.

        Parts that are off as they were in the last one are the same objects, of which plans keep
        what they know: of two that differ in one amount all but one part is made ready already.
        """
        before, rig = self._off
        places = {self.parameters[k].part for k in np.flatnonzero(amounts != before)}

        for place in places:
            other = self.rig
            for parameter, amount in zip(self.parameters, amounts, strict=True):
                if amount and parameter.part == place:
                    other = parameter.applied(other, float(amount))

            kind, number = place
            rig = with_part(rig, place, getattr(other, kind)[number])

        self._off = amounts, rig
        return rig

    def shown(self, amounts: Floats) -> Floats:
        """Display px (m, 2) at which the points have to be
        shown when amounts (p,) are known to be off.
        """
        return self._on_branch(self.plan(amounts), self.view)

    def seen(
        self, amounts: Floats, start: Floats | None = None, display: Floats | None = None
    ) -> Floats:
        """Where the points are seen (m, 2), viewer px, with amounts
        (p,) off; NaN where they are not, or not found.

        By Newton's method from `start` (m, 2), by default from where they are planned to be
        seen. The points are shown where that was planned, or at display px (m, 2).
        """
        wanted = self.display if display is None else display
        plan = self.plan(amounts)
        at = self.view.copy() if start is None else np.array(start, float)

        for _ in range(NEWTON.most_steps):
            y, j = self._derivatives(plan, at)
            missing = wanted - y
            step = _solved(j, missing)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            with np.errstate(invalid="ignore", divide="ignore"):
                at = at + step * np.minimum(1.0, NEWTON.farthest_px / length)
            if not np.nanmax(np.abs(missing), initial=0.0) > NEWTON.converged_px:
                break

        # not found
        y, _ = self._land(plan, at, self._branch)
        with np.errstate(invalid="ignore"):
            at[~(np.abs(y - wanted) <= NEWTON.found_px).all(axis=1)] = np.nan

        return at

    def sensitivity(self, amounts: Floats | None = None, at: Floats | None = None) -> Floats:
        """How the points move (p, m, 2), viewer px for a unit of
        each parameter, by the view map's derivatives.

        amounts (p,) and at (m, 2): the errors, and where the
        points are seen then; by default nothing, as planned
        """
        return run_steps(self.sensitivities(amounts, at))

    def sensitivities(
        self, amounts: Floats | None = None, at: Floats | None = None
    ) -> Generator[float, None, Floats]:
        """The same in steps; yields progress 0..1."""
        amounts = np.zeros(len(self.parameters)) if amounts is None else np.asarray(amounts, float)
        at = self.view if at is None else at
        _, j = self._derivatives(self.plan(amounts), at)

        found = np.empty((len(self.parameters), len(at), 2))
        for k, parameter in enumerate(self.parameters):
            ends = []
            for sign in (1.0, -1.0):
                off = amounts.copy()
                off[k] += sign * parameter.step
                ends.append(self._on_branch(self.plan(off), at))

            # a dot stays where it is on the display: the viewer's image gives way
            found[k] = -_solved(j, (ends[0] - ends[1]) / (2 * parameter.step))
            yield (k + 1) / len(self.parameters)

        return found

    def _derivatives(self, plan: Plan, at: Floats) -> tuple[Floats, Floats]:
        """Landings (m, 2), and the view map's derivatives (m, 2, 2) there."""
        steps = NEWTON.step_px * np.array([[0.0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
        y = self._on_branch(plan, (at + steps[:, None]).reshape(-1, 2)).reshape(5, -1, 2)
        return y[0], np.stack([y[1] - y[2], y[3] - y[4]], axis=2) / NEWTON.step_px

    def _land(
        self, plan: Plan, at: Floats, expected: Words | None = None
    ) -> tuple[Floats, np.ndarray]:
        """Display px (n, 2), also beside a flat display, and
        branch (n,) of viewer px (n, 2); NaN for none.

        Where light goes several ways the one on the expected branch (n,) counts.
        """
        is_there = np.isfinite(at).all(axis=1)
        xy = np.full(at.shape, np.nan)
        branch = np.zeros(len(at), np.uint64)

        found = trace_all(plan, *plan.viewer.rays(at[is_there]))
        wanted = None if expected is None else expected[is_there]
        landings = main_landings(found, int(is_there.sum()), wanted)
        xy[is_there] = landings.xy
        branch[is_there] = landings.branch

        return xy, branch

    def _on_branch(self, plan: Plan, at: Floats) -> Floats:
        """Landings (k m, 2) of viewer px; NaN where light takes
        another way than as planned to the same point.
        """
        planned = np.tile(self._branch, len(at) // len(self.view))
        xy, branch = self._land(plan, at, planned)
        xy[branch != planned] = np.nan
        return xy


def _solved(j: Floats, b: Floats) -> Floats:
    """x (m, 2) with j x = b, for matrices (m, 2, 2); NaN where they are singular or unknown."""
    det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (j[:, 1, 1] * b[:, 0] - j[:, 0, 1] * b[:, 1]) / det
        y = (j[:, 0, 0] * b[:, 1] - j[:, 1, 0] * b[:, 0]) / det
    return np.stack([x, y], axis=1)


def spread(sensitivity: Floats, tolerances: Floats, n: int = 1000, seed: int = 0) -> Floats:
    """Mean lengths (n,), viewer px, by which the points move on random benches, to first order.

    Parameters
    ----------
    sensitivity : (p, m, 2) as Bench.sensitivity gives it
    tolerances : (p,) standard deviations of the parameters
    """
    amounts = np.random.default_rng(seed).standard_normal((n, len(tolerances))) * tolerances
    moved = np.tensordot(amounts, sensitivity, 1)
    return np.linalg.norm(moved, axis=2).mean(axis=1)
