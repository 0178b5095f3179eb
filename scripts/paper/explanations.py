"""Amounts of suspects that turn the simulated displacements into those of the photographs.

Derivatives only say where to look; the amounts are found by re-tracing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from kiriko.core.base.arrays import Floats

from .experiment import Experiment
from .published import PAPER_DX
from .suspects import CONDITIONS, Suspect

TARGET = np.array([PAPER_DX[condition] for condition in CONDITIONS])
NEAR = 1.0  # px: so far from the paper's three numbers is as good as on them
SHARP = 0.01  # px, against tolerances: how much a miss counts where amounts are to be small
FARTHEST = 50.0  # tolerances, by derivatives: more than that is not re-traced
ITERATIONS = 8
HALVINGS = 3  # of a step that would lose dots
WITHIN = 0.02  # px: the change by a step when there is nothing more to find
# combinations that are re-traced, of those that look best by derivatives
TRIED = 6
LOOKED_AT = 100
SHOWN = 5


def means(moves: Floats) -> Floats:
    """Mean dx (3,) of the conditions; NaN where a dot is missing."""
    return moves[..., 0].mean(axis=1)


def summary(moves: Floats) -> Floats:
    """Mean dx, mean dy and the standard deviation of dx over the dots (3, 3), by condition."""
    return np.stack([means(moves), moves[..., 1].mean(axis=1), moves[..., 0].std(axis=1)])


def columns(experiment: Experiment, some: Sequence[Suspect], amount: float = 1.0) -> Floats:
    """Change (n, 3, 3) of the summary by an amount in tolerances, re-traced.

    Of the means half of that from less to more, or where less is none (a half cube that would sink
    into the display) that from none to more, as it is of the spread, which may grow both ways.
    """
    planned = summary(experiment.moves(experiment.planned))
    found = []
    for suspect in some:
        more, less = (
            summary(experiment.off([suspect], [sign * amount])) - planned for sign in (1, -1)
        )
        has_less = np.abs(less).max() > 1e-6
        found.append([*((more - less) / 2 if has_less else more)[:2], more[2]])
    return np.array(found)


@dataclass(frozen=True, eq=False)
class Explanation:
    """Amounts of suspects that bring the displacements as
    near to the paper's as these suspects can.

    amounts : (n,) in tolerances; moves : (3, 49, 2) displacements then, px
    """

    suspects: tuple[Suspect, ...]
    amounts: Floats
    moves: Floats

    @property
    def size(self) -> float:
        """Root of the sum of squares, in tolerances."""
        return float(np.linalg.norm(self.amounts))

    @property
    def miss(self) -> float:
        """The largest distance of a mean dx from the paper's, px."""
        return float(np.abs(means(self.moves) - TARGET).max())

    @property
    def cost(self) -> float:
        return float(np.sum(((means(self.moves) - TARGET) / SHARP) ** 2) + self.size**2)

    @property
    def words(self) -> str:
        """The largest amounts, each in its own unit."""
        order = np.argsort(-np.abs(self.amounts))[:SHOWN]
        return "; ".join(_amount(self.suspects[k], self.amounts[k]) for k in order)


def _amount(suspect: Suspect, amount: float) -> str:
    return f"{suspect.title} {amount * suspect.tolerance:+.3g} {suspect.unit}".strip()


def smallest(matrix: Floats, missing: Floats) -> Floats:
    """The smallest amounts (..., n), in tolerances, that move by
    the missing px (3,) or as near to that as they can.

    matrix : (..., 3, n) px for a tolerance
    """
    # ridge regression, in the form that inverts 3 x 3 however many amounts there are
    transposed = np.swapaxes(matrix, -1, -2)
    square = matrix @ transposed + SHARP**2 * np.eye(len(missing))
    return (
        transposed
        @ np.linalg.solve(square, np.broadcast_to(missing[:, None], (*square.shape[:-1], 1)))
    )[..., 0]


def explained(experiment: Experiment, some: Sequence[Suspect], matrix: Floats) -> Explanation:
    """The best found by re-tracing from amounts to better ones, until
    all that is left is small or dots would be lost.

    matrix : (3, n) px for a tolerance; where amounts are large
        it is learned from them (Broyden's method)
    """
    amounts = np.zeros(len(some))
    matrix = matrix.copy()
    moves = experiment.off(some, amounts)
    best = Explanation(tuple(some), amounts, moves)

    for _ in range(ITERATIONS):
        change = smallest(matrix, TARGET - means(moves) + matrix @ amounts) - amounts
        there = experiment.off(some, amounts + change)
        for _ in range(HALVINGS):
            if np.isfinite(there).all():
                break
            change = change / 2
            there = experiment.off(some, amounts + change)
        if not np.isfinite(there).all():
            break
        amounts = amounts + change
        gained = means(there) - means(moves)
        moves = there
        matrix = matrix + np.outer(gained - matrix @ change, change) / max(change @ change, 1e-30)
        best = min(best, Explanation(tuple(some), amounts, moves), key=lambda found: found.cost)
        if np.abs(gained).max() < WITHIN:
            break

    return best


def best_of(
    experiment: Experiment, some: Sequence[Suspect], matrix: Floats, n: int
) -> list[Explanation]:
    """Combinations of n suspects, re-traced, the smallest first of
    those that come near and the nearest of the others.

    By derivatives all are looked at, and the first TRIED that lose no dots are re-traced.
    """
    index = np.array(list(combinations(range(len(some)), n)))
    each = np.moveaxis(matrix[:, index], 0, 1)
    missing = TARGET - means(experiment.moves(experiment.planned))
    amounts = smallest(each, missing)
    excess = np.maximum(
        np.abs(missing - (each @ amounts[..., None])[..., 0]).max(axis=1) - NEAR, 0.0
    )
    order = np.lexsort((np.linalg.norm(amounts, axis=1), excess.round()))

    found = []
    for c in order[np.abs(amounts[order]).max(axis=1) < FARTHEST][:LOOKED_AT]:
        mine = [some[k] for k in index[c]]
        if len(found) < TRIED and np.isfinite(experiment.off(mine, amounts[c])).all():
            found.append(explained(experiment, mine, matrix[:, index[c]]))

    return sorted(found, key=lambda one: (max(one.miss - NEAR, 0.0), one.size))
