"""The errors of a bench, by the places at which a lattice is seen in a photograph."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Floats
from ..errors import RigError
from ..steps import within
from .misalignment import FEWEST, ITERATIONS, Bench

# of the sum of squares, in noise, or of one: the gain of a step when there is nothing more to gain
ENOUGH = 1e-5
HOPELESS = 1e8  # damping
UNLIKELY = 6.0  # times the noise: points that stay so far from a fit are none of this bench's
LEAST_USED = 0.5  # of the measured points have to be seen in the fitted rig
# times the median distance; share of the points that may be left out for it
STRANGE = 5.0
MOST_STRANGE = 0.1
ALIKE = 0.99  # cosine between movements from which on they are called alike


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
        length = np.linalg.norm(self.movements, axis=0)
        left = [int(k) for k in np.argsort(-length) if length[k] >= 1]
        groups = []
        while left:
            cosine = (
                self.movements[:, left[0]]
                @ self.movements[:, left]
                / (length[left[0]] * length[left])
            )
            like = [k for k, c in zip(left, cosine, strict=True) if abs(c) > ALIKE]
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
    tolerances = np.asarray(tolerances, float)
    measured = np.array(measured, float)
    is_measured = np.isfinite(measured).all(axis=1)
    if is_measured.sum() < FEWEST:
        raise RigError(
            "Only {n_measured} points were measured: a fit takes {least} or more.",
            n_measured=is_measured.sum(),
            least=FEWEST,
        )
    amounts = np.zeros(len(tolerances))
    at = bench.view
    done = 0.0
    away = measured - at
    before = _rms(away[is_measured].ravel())

    def strangers(distance: Floats) -> Bools:
        """Which points (m,) are much further off, in noise, than the others? None if
        they are many.
        """
        far = distance > max(UNLIKELY, STRANGE * np.nanmedian(distance))
        return far & ((left_out | far).sum() <= MOST_STRANGE * is_measured.sum())

    left_out = np.zeros(len(measured), bool)
    # to begin with, against the others' displacement: far ones
    # would draw the fit to where it finds no end
    left_out = strangers(np.linalg.norm(away - np.nanmedian(away, axis=0), axis=1) / noise)
    measured[left_out] = np.nan
    while True:
        steps = _settle(bench, measured, tolerances, noise, amounts, at)
        amounts, off, at, used, movements = yield from within(steps, done, 0.5 + 0.5 * done)
        done = 0.5 + 0.5 * done
        distance = np.full(len(measured), np.nan)
        distance[used] = np.linalg.norm(off.reshape(-1, 2), axis=1)
        strange = strangers(distance)
        if not strange.any():
            break
        left_out |= strange
        measured[strange] = np.nan
    after = _rms(off * noise)
    n_left = int((is_measured & ~left_out).sum())
    if used.sum() < max(FEWEST, LEAST_USED * n_left):
        raise RigError(
            "Only {n_used} of {n_left} measured points can be followed to the display: they"
            " may be swapped or those of another rig, or the glass has too many flat faces.",
            n_used=used.sum(),
            n_left=n_left,
        )
    if after >= UNLIKELY * noise:
        raise RigError(
            "The points lie {off:.3g} pixels from where the rig can show them, whatever is"
            " off: they may be swapped, or those of another rig.",
            off=after,
        )
    covariance = covariance_of(movements)
    deviation = np.sqrt(np.diag(covariance))
    return Fit(
        amounts,
        deviation * tolerances,
        covariance / np.outer(deviation, deviation),
        condition_of(movements),
        before,
        after,
        used,
        left_out,
        int(is_measured.sum()),
        movements,
    )


def _settle(
    bench: Bench, measured: Floats, tolerances: Floats, noise: float, amounts: Floats, at: Floats
) -> Generator[float, None, tuple[Floats, Floats, Floats, Bools, Floats]]:
    """The fit of all points that are measured, from amounts
    (p,) on, where they are seen about at (m, 2).

    Returns amounts (p,); residuals (2 k,) over the noise; where all points are
    seen (m, 2); which k were used (m,); movements (2 k, p) as in Fit.
    """
    n = len(tolerances)
    n_measured = int(np.isfinite(measured).all(axis=1).sum())

    def state(amounts: Floats, start: Floats) -> tuple[float, Floats, Floats, Bools]:
        """The sum to be made small, residuals, and where which points are seen."""
        try:
            at = bench.seen(amounts, start)
        except RigError:  # no such bench can be made
            return np.inf, np.empty(0), start, np.zeros(len(start), bool)
        used = np.isfinite(measured - at).all(axis=1)
        off = (measured - at)[used].ravel() / noise
        # points that are not seen count as the others do on
        # average: else to lose the worst would seem to help
        data = off @ off * n_measured / used.sum() if used.sum() >= FEWEST else np.inf
        return float(data + ((amounts / tolerances) ** 2).sum()), off, at, used

    def movements(
        amounts: Floats, at: Floats, used: Bools
    ) -> Generator[float, None, Floats | None]:
        """Of residuals (2 k,) for each tolerance (p,); None where no such rig can be made."""
        try:
            found = yield from bench.sensitivities(amounts, at)
        except RigError:
            return None
        return np.nan_to_num(found[:, used].reshape(n, -1).T * tolerances / noise)

    damping = 1e-3
    cost, off, at, used = state(amounts, at)
    d = yield from within(movements(amounts, at, used), 0.0, 0.2)
    for k in range(ITERATIONS):
        normal = d.T @ d + np.eye(n)
        step = np.linalg.solve(
            normal + damping * np.diag(np.diag(normal)), d.T @ off - amounts / tolerances
        )
        tried = amounts + step * tolerances
        value, *found = state(tried, at)
        # how many steps it takes is not known: each gets a part of the rest
        done = 1 - 0.8 ** (k + 1), 1 - 0.8 ** (k + 2)
        there = (yield from within(movements(tried, *found[1:]), *done)) if value <= cost else None
        if there is None:
            damping *= 10
            if damping > HOPELESS:
                return amounts, off, at, used, d
            continue
        is_at_end = cost - value < ENOUGH * max(cost, 1.0)
        amounts = tried
        cost = value
        (off, at, used) = found
        d = there
        damping = damping / 10
        if is_at_end:
            return amounts, off, at, used, d
    raise RigError(
        "After {steps} steps the fit still changes: look for points that are wrong or"
        " counted in another way, compare the lattice with the picture, or expect less to"
        " be off.",
        steps=ITERATIONS,
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
