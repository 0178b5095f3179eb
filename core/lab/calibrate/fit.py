"""The errors of a bench, by the places at which a lattice is seen in a photograph.

Wanted are the amounts p that make |measured - seen(p)|^2 / noise^2 + |p / tolerance|^2 least, by
damped least squares (Levenberg's): each step solves (J^T J + 1 + damping) dp = J^T off - p, in
tolerances. The second term is the knowledge of before: without it amounts that move the points
alike cannot be told apart at all.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.steps import within
from .least_squares import State, Task, settle
from .misalignment import FEWEST, Bench


@dataclass(frozen=True)
class Fitting:
    """Which points are believed, and when a fit is; held to simulated benches by
    tests/core/test_misalignment.py and `dev.py paper`.

    unlikely : times the noise: points that stay so far from a fit are none of this bench's
    least_used : share of the measured points that have to be seen in the fitted rig
    strange : times the median distance, from which on a point may be left out
    most_strange : share of the points that may be left out for it
    alike : cosine between movements from which on they are called alike
    """

    unlikely: float = 6.0
    least_used: float = 0.5
    strange: float = 5.0
    most_strange: float = 0.1
    alike: float = 0.99


FITTING = Fitting()


@dataclass(frozen=True, eq=False)
class Fit:
    """The errors that a bench seems to have.

    Parameters
    ----------
    amounts : (p,) of the bench's parameters
    errors : (p,) their standard deviations: where they are near
        the tolerances the points tell nothing of them
    correlation : (p, p) of these errors; near 1 or -1 two amounts cannot be told apart
    condition : largest by smallest singular value of the points'
        movements, each for its tolerance, over the noise
    before, after : rms distance of the points from where they were
        to be seen, and from where the fit has them, px
    used, left_out : (m,) points that were fitted, and measured ones
        that are too far from where the others have them
    n_measured : points that were measured
    movements : (2 k, p) of the coordinates of the k used points, for
        the tolerance of each parameter, over the noise
    """

    amounts: Floats
    errors: Floats
    correlation: Floats
    condition: float
    before: float
    after: float
    used: Bools
    left_out: Bools
    n_measured: int
    movements: Floats

    @property
    def n_points(self) -> int:
        return int(self.used.sum())

    def groups(self) -> tuple[list[list[int]], list[int]]:
        """Groups of parameters that move the points almost alike.

        And those that, within tolerance, hardly move any.
        """
        # by their lengths, the longest first
        length = np.linalg.norm(self.movements, axis=0)
        left = [int(k) for k in np.argsort(-length) if length[k] >= 1]

        # each takes with it those that move the points almost as it does
        groups = []
        while left:
            cosine = (
                self.movements[:, left[0]]
                @ self.movements[:, left]
                / (length[left[0]] * length[left])
            )
            like = [k for k, c in zip(left, cosine, strict=True) if abs(c) > FITTING.alike]
            left = [k for k in left if k not in like]
            if len(like) > 1:
                groups.append(like)

        return groups, np.flatnonzero(length < 1).tolist()


def fit(
    bench: Bench, measured: Floats, tolerances: Floats, noise: float = 0.3
) -> Generator[float, None, Fit]:
    """Find the errors from points that were measured (m, 2),
    viewer px, NaN where they were not. Yields progress.

    Damped least squares (Levenberg's), with the knowledge of before: each amount is likely to be
    within its tolerance. A few points that stay far from where all others have them, by glare or a
    speck of dust, are left out.

    Parameters
    ----------
    tolerances : (p,) standard deviations to expect of the parameters, above 0
    noise : standard deviation of a measured coordinate, viewer px

    Raises
    ------
    RigError : too few points were measured, they are none of this bench's, or the fit finds no end
    """
    measured = np.array(measured, float)
    is_measured = np.isfinite(measured).all(axis=1)
    n_measured = int(is_measured.sum())
    if n_measured < FEWEST:
        raise RigError(
            "Only {n_measured} points were measured: a fit takes {least} or more.",
            n_measured=n_measured,
            least=FEWEST,
        )

    # to begin with, against the others' displacement: far ones
    # would draw the fit to where it finds no end
    away = measured - bench.view
    before = _rms(away[is_measured].ravel())
    left_out = np.zeros(len(measured), bool)
    far = np.linalg.norm(away - np.nanmedian(away, axis=0), axis=1) / noise
    left_out |= _strangers(far, left_out, n_measured)
    measured[left_out] = np.nan

    task = Task(bench, measured, np.asarray(tolerances, float), noise)
    state = yield from _without_strangers(task, left_out, n_measured)
    after = _rms(state.off * noise)
    _check(state.used, n_measured - int((is_measured & left_out).sum()), after, noise)

    covariance = covariance_of(state.movements)
    deviation = np.sqrt(np.diag(covariance))
    return Fit(
        amounts=state.amounts,
        errors=deviation * task.tolerances,
        correlation=covariance / np.outer(deviation, deviation),
        condition=condition_of(state.movements),
        before=before,
        after=after,
        used=state.used,
        left_out=left_out,
        n_measured=n_measured,
        movements=state.movements,
    )


def _without_strangers(
    task: Task, left_out: Bools, n_measured: int
) -> Generator[float, None, State]:
    """The fit of a task without points that are far from it, which are left out (m,), too."""
    state = task.at(np.zeros(len(task.tolerances)), task.bench.view)
    done = 0.0

    while True:
        state = yield from within(settle(task, state), done, 0.5 + 0.5 * done)
        done = 0.5 + 0.5 * done

        far = np.full(len(task.measured), np.nan)
        far[state.used] = np.linalg.norm(state.off.reshape(-1, 2), axis=1)
        strange = _strangers(far, left_out, n_measured)
        if not strange.any():
            return state

        left_out |= strange
        task.measured[strange] = np.nan
        state = task.at(state.amounts, state.at)


def _strangers(distance: Floats, left_out: Bools, n_measured: int) -> Bools:
    """Which points (m,) are much further off, in noise, than the others? None if
    they are many, with those left out before.
    """
    far = distance > max(FITTING.unlikely, FITTING.strange * np.nanmedian(distance))
    return far & ((left_out | far).sum() <= FITTING.most_strange * n_measured)


def _check(used: Bools, n_left: int, after: float, noise: float) -> None:
    """Raise RigError where too few of the points that are left were used (m,), or they are
    too far off, px.
    """
    if used.sum() < max(FEWEST, FITTING.least_used * n_left):
        raise RigError(
            "Only {n_used} of {n_left} measured points can be followed to the display: look"
            " for swapped points, for points of another rig, or for glass with many flat"
            " faces.",
            n_used=used.sum(),
            n_left=n_left,
        )
    if after >= FITTING.unlikely * noise:
        raise RigError(
            "The points lie {off:.3g} pixels from every place where the rig can show them:"
            " look for swapped points, or for points of another rig.",
            off=after,
        )


def condition_of(movements: Floats) -> float:
    """Largest by smallest singular value; infinite for fewer rows than columns."""
    singular = np.linalg.svd(movements, compute_uv=False)
    is_known = len(movements) >= movements.shape[1] and singular[-1] > 0
    return float(singular[0] / singular[-1]) if is_known else float("inf")


def _rms(distances: Floats) -> float:
    """Rms length of vectors whose components (2 n,) these are."""
    return float(np.sqrt(2 * (distances**2).mean())) if len(distances) else float("nan")


def covariance_of(movements: Floats) -> Floats:
    """Covariance (p, p), in tolerances, of amounts that are fitted to points that move so."""
    return np.linalg.inv(movements.T @ movements + np.eye(movements.shape[1]))
