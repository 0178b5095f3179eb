"""Damped least squares over a bench: from a state to the amounts that fit measured points best."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.steps import within
from .misalignment import FEWEST, Bench


@dataclass(frozen=True)
class Damping:
    """How least squares are damped; held to simulated benches by tests/core/test_misalignment.py
    and `dev.py paper`.

    most_steps : of least squares
    first, step : of the normal equations' diagonal; times more where a
        step does not help, less where it does
    most : at which no step helps any more
    enough : of the sum of squares, in noise, or of one: the gain of
        a step when there is nothing more to gain
    """

    most_steps: int = 30
    first: float = 1e-3
    step: float = 10
    most: float = 1e8
    enough: float = 1e-5


DAMPING = Damping()


@dataclass(frozen=True, eq=False)
class State:
    """A bench with amounts (p,) off, and how well it fits.

    cost : the sum to be made small
    off : (2 k,) residuals over the noise
    at : (m, 2) viewer px at which the points are seen
    used : (m,) which k of them are measured and seen
    movements : (2 k, p) as in Fit; None until they are asked for, or where there is no such rig
    """

    amounts: Floats
    cost: float
    off: Floats
    at: Floats
    used: Bools
    movements: Floats | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """A bench that is fitted to measured points (m, 2), NaN where they are not."""

    bench: Bench
    measured: Floats
    tolerances: Floats
    noise: float

    def at(self, amounts: Floats, start: Floats) -> State:
        """The state with amounts (p,), whose points are seen about at (m, 2)."""
        try:
            at = self.bench.seen(amounts, start)
        except RigError:  # no such bench can be made
            return State(amounts, np.inf, np.empty(0), start, np.zeros(len(start), bool))

        used = np.isfinite(self.measured - at).all(axis=1)
        off = (self.measured - at)[used].ravel() / self.noise

        # points that are not seen count as the others do on
        # average: else to lose the worst would seem to help
        n_measured = int(np.isfinite(self.measured).all(axis=1).sum())
        data = off @ off * n_measured / used.sum() if used.sum() >= FEWEST else np.inf
        cost = float(data + ((amounts / self.tolerances) ** 2).sum())
        return State(amounts, cost, off, at, used)

    def with_movements(self, state: State) -> Generator[float, None, State]:
        """The state with its movements, where such a rig can be made."""
        try:
            found = yield from self.bench.sensitivities(state.amounts, state.at)
        except RigError:
            return state

        by_parameter = found[:, state.used].reshape(len(self.tolerances), -1)
        movements = np.nan_to_num(by_parameter.T * self.tolerances / self.noise)
        return replace(state, movements=movements)


def settle(task: Task, state: State) -> Generator[float, None, State]:
    """The fit of all points that are measured, from a state on."""
    tolerances = task.tolerances
    damping = DAMPING.first
    state = yield from within(task.with_movements(state), 0.0, 0.2)

    for k in range(DAMPING.most_steps):
        d = state.movements
        normal = d.T @ d + np.eye(len(tolerances))
        step = np.linalg.solve(
            normal + damping * np.diag(np.diag(normal)),
            d.T @ state.off - state.amounts / tolerances,
        )

        tried = task.at(state.amounts + step * tolerances, state.at)
        if tried.cost <= state.cost:
            # how many steps it takes is not known: each gets a part of the rest
            done = 1 - 0.8 ** (k + 1), 1 - 0.8 ** (k + 2)
            tried = yield from within(task.with_movements(tried), *done)

        if tried.movements is None:
            damping *= DAMPING.step
            if damping > DAMPING.most:
                return state
            continue

        gain = state.cost - tried.cost
        is_at_end = gain < DAMPING.enough * max(state.cost, 1.0)
        state = tried
        damping = damping / DAMPING.step
        if is_at_end:
            return state

    raise RigError(
        "The fit still changes after {steps} steps: look for wrong or swapped points,"
        " compare the lattice with the picture, or lower the tolerances.",
        steps=DAMPING.most_steps,
    )
