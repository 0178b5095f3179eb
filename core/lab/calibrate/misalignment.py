"""The view of a misaligned bench.

A dot of the source image stays at its display px, and the viewer sees it at the px whose ray lands
there. With the map y from viewer to display and errors p, the dot moves by dx = -J^-1 dy/dp. The
view map's derivatives are enough, without a search for each dot.
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

FEWEST = 4  # points: eight coordinates, as many as a perspective mapping has parameters


@dataclass(frozen=True)
class Newton:
    """Newton's method for a display dot in the viewer's image, verified on traced benches in
    tests/core/test_misalignment.py.

    step_px : viewer px, step of the finite differences
    most_steps : of Newton's method
    farthest_px : viewer px, longest step
    converged_px : display px, error that ends the iteration
    found_px : display px, largest error of a found dot
    """

    step_px: float = 0.02
    most_steps: int = 30
    farthest_px: float = 40.0
    converged_px: float = 1e-7
    found_px: float = 1e3 * 1e-7


NEWTON = Newton()


class Bench:
    """A planned rig and observed points of its picture.

    Parameters
    ----------
    rig, settings : as planned
    view : (m, 2) viewer px of the points on the planned bench
    among : parameters with errors, by default all

    Attributes
    ----------
    display : (m, 2) display px of the points; NaN if the viewer does not see them
    """

    def __init__(
        self, rig: Rig, settings: Settings, view: Floats, among: list[Parameter] | None = None
    ) -> None:
        # glare suppression is off: dots seen past the glass are not observed
        self.rig = rig
        self.settings = replace(settings, suppress_glare=0.0)
        self.view = np.asarray(view, float)
        self.parameters = parameters(rig) if among is None else among
        self._cache = MeshCache()
        self._off = np.zeros(len(self.parameters)), rig
        self.display, self._branch = self._land(self.plan(), self.view)

    @property
    def viewer(self) -> Viewer:
        """The viewer with the points in its image: the rig's first."""
        return self.rig.viewers[0]

    def plan(self, amounts: Floats | None = None) -> Plan:
        """The bench's plan with errors (p,)."""
        amounts = np.zeros(len(self.parameters)) if amounts is None else np.array(amounts, float)
        return compile_plan(self._rig(amounts), self.settings, self._cache)

    def _rig(self, amounts: Floats) -> Rig:
        """The rig with errors (p,).

        Parts with the same errors as in the last call are the same objects, so their compiled data
        are reused: between two rigs that differ in one amount, only one part is compiled.
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
        """Display px (m, 2) that show the points at their planned viewer px, on a bench with errors
        (p,).
        """
        return self._on_branch(self.plan(amounts), self.view)

    def seen(
        self, amounts: Floats, start: Floats | None = None, display: Floats | None = None
    ) -> Floats:
        """Viewer px (m, 2) of the points on a bench with errors (p,); NaN if invisible or not
        found.

        Newton's method starts at `start` (m, 2), by default the planned viewer px. The display
        shows the points at `display` px (m, 2), by default as planned.
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

        # remove points without convergence
        y, _ = self._land(plan, at, self._branch)
        with np.errstate(invalid="ignore"):
            at[~(np.abs(y - wanted) <= NEWTON.found_px).all(axis=1)] = np.nan

        return at

    def sensitivity(self, amounts: Floats | None = None, at: Floats | None = None) -> Floats:
        """Movement (p, m, 2) of the points, viewer px per unit of each parameter, from the view
        map's derivatives.

        amounts : (p,) errors, by default none
        at : (m, 2) viewer px of the points with these errors, by default as planned
        """
        return run_steps(self.sensitivities(amounts, at))

    def sensitivities(
        self, amounts: Floats | None = None, at: Floats | None = None
    ) -> Generator[float, None, Floats]:
        """`sensitivity` in steps; yields progress 0..1."""
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

            # the dot's display px is fixed, so its viewer px moves the opposite way
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
        """Display px (n, 2), also outside a flat display, and branch (n,) of viewer px (n, 2); NaN
        without a landing.

        If light splits, the landing on the expected branch (n,) counts.
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
        """Landings (k m, 2) of viewer px; NaN if light takes another branch than the planned one to
        the same point.
        """
        planned = np.tile(self._branch, len(at) // len(self.view))
        xy, branch = self._land(plan, at, planned)
        xy[branch != planned] = np.nan
        return xy


def _solved(j: Floats, b: Floats) -> Floats:
    """x (m, 2) with j x = b, for matrices (m, 2, 2); NaN for singular or NaN matrices."""
    det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (j[:, 1, 1] * b[:, 0] - j[:, 0, 1] * b[:, 1]) / det
        y = (j[:, 0, 0] * b[:, 1] - j[:, 1, 0] * b[:, 0]) / det
    return np.stack([x, y], axis=1)


def spread(sensitivity: Floats, tolerances: Floats, n: int = 1000, seed: int = 0) -> Floats:
    """Mean movements (n,) of the points on random benches, viewer px, to first order.

    Parameters
    ----------
    sensitivity : (p, m, 2) from Bench.sensitivity
    tolerances : (p,) standard deviations of the parameters
    """
    amounts = np.random.default_rng(seed).standard_normal((n, len(tolerances))) * tolerances
    moved = np.tensordot(amounts, sensitivity, 1)
    return np.linalg.norm(moved, axis=2).mean(axis=1)
