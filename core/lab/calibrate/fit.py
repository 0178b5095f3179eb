"""The least-squares fit of a bench's errors to photographs, and the best further photograph."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...base.steps import subprogress
from ...bench.offset import moved, parameters, turned
from ...glass.motion import Motion
from ...rig.rig import Viewer
from .misalignment import FEWEST, Bench


@dataclass(frozen=True)
class Damping:
    """Damping of the least squares, verified on simulated benches in
    tests/core/test_misalignment.py and `dev.py paper`.

    most_steps : of the iteration
    first : initial damping of the normal equations' diagonal
    step : factor of the damping after a failed step, divisor after a successful one
    most : damping at which the fit ends
    enough : gain of a step that ends the fit, relative to the sum of squares in noise, or to 1
    """

    most_steps: int = 30
    first: float = 1e-3
    step: float = 10
    most: float = 1e8
    enough: float = 1e-5


DAMPING = Damping()


@dataclass(frozen=True, eq=False)
class State:
    """A bench with errors (p,), and the quality of its fit.

    cost : sum of squares to minimise
    off : (2 k,) residuals over the noise
    at : (m, 2) viewer px of the points
    used : (m,) mask of the k measured and visible points
    movements : (2 k, p) as in BenchFit; None before `with_movements`, or if the rig is invalid
    """

    amounts: Floats
    cost: float
    off: Floats
    at: Floats
    used: Bools
    movements: Floats | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """A fit of a bench to measured points (m, 2), NaN if not measured."""

    bench: Bench
    measured: Floats
    tolerances: Floats
    noise: float

    def at(self, amounts: Floats, start: Floats) -> State:
        """The state with errors (p,); `start` (m, 2) is the initial guess of the points."""
        try:
            at = self.bench.seen(amounts, start)
        except RigError:  # the errors make an invalid rig
            return State(amounts, np.inf, np.empty(0), start, np.zeros(len(start), bool))

        used = np.isfinite(self.measured - at).all(axis=1)
        off = (self.measured - at)[used].ravel() / self.noise

        # invisible points count as the average of the others, or losing the worst would seem to
        # help
        n_measured = int(np.isfinite(self.measured).all(axis=1).sum())
        data = off @ off * n_measured / used.sum() if used.sum() >= FEWEST else np.inf
        cost = float(data + ((amounts / self.tolerances) ** 2).sum())
        return State(amounts, cost, off, at, used)

    def with_movements(self, state: State) -> Generator[float, None, State]:
        """The state with its movements, if the rig is valid."""
        try:
            found = yield from self.bench.sensitivities(state.amounts, state.at)
        except RigError:
            return state

        by_parameter = found[:, state.used].reshape(len(self.tolerances), -1)
        movements = np.nan_to_num(by_parameter.T * self.tolerances / self.noise)
        return replace(state, movements=movements)


def settle(task: Task, state: State) -> Generator[float, None, State]:
    """Fit all measured points, from an initial state."""
    tolerances = task.tolerances
    damping = DAMPING.first
    state = yield from subprogress(task.with_movements(state), 0.0, 0.2)

    for k in range(DAMPING.most_steps):
        d = state.movements
        normal = d.T @ d + np.eye(len(tolerances))
        step = np.linalg.solve(
            normal + damping * np.diag(np.diag(normal)),
            d.T @ state.off - state.amounts / tolerances,
        )

        tried = task.at(state.amounts + step * tolerances, state.at)
        if tried.cost <= state.cost:
            # the number of steps is unknown: each gets a fraction of the rest
            done = 1 - 0.8 ** (k + 1), 1 - 0.8 ** (k + 2)
            tried = yield from subprogress(task.with_movements(tried), *done)

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
        "The fit has not converged after {steps} steps. Look for wrong or swapped points, compare"
        " the lattice with the picture, or lower the tolerances.",
        steps=DAMPING.most_steps,
    )


@dataclass(frozen=True)
class Fitting:
    """Outliers and acceptance of a fit, verified on simulated benches in
    tests/core/test_misalignment.py and `dev.py paper`.

    unlikely : times the noise; more distant points do not belong to the bench
    least_used : fraction of the measured points visible in the fitted rig
    strange : times the median distance; a more distant point may be an outlier
    most_strange : largest fraction of outliers
    alike : cosine between movements of indistinguishable parameters
    """

    unlikely: float = 6.0
    least_used: float = 0.5
    strange: float = 5.0
    most_strange: float = 0.1
    alike: float = 0.99


FITTING = Fitting()


@dataclass(frozen=True, eq=False)
class BenchFit:
    """The fitted errors of a bench.

    Parameters
    ----------
    amounts : (p,) of the bench's parameters
    errors : (p,) standard deviations of the amounts; near the tolerance, the points do not
        determine the parameter
    correlation : (p, p) of these errors; two amounts near 1 or -1 cannot be separated
    condition : ratio of the largest and smallest singular value of `movements`
    before : rms distance of the points from the planned ones, px
    after : rms distance of the points from the fitted ones, px
    used : (m,) mask of the fitted points
    left_out : (m,) mask of the outliers
    n_measured : number of measured points
    movements : (2 k, p) movement of the k used points for the tolerance of each parameter, over the
        noise
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
        """Groups of parameters with almost the same effect, and parameters with hardly any effect
        within their tolerances.
        """
        length = np.linalg.norm(self.movements, axis=0)
        left = [int(k) for k in np.argsort(-length) if length[k] >= 1]

        # each group begins with the parameter of the largest effect
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
) -> Generator[float, None, BenchFit]:
    """Fit the errors of a bench to measured points (m, 2), viewer px, NaN if not measured. Yields
    progress.

    Levenberg's damped least squares with a prior: each amount is likely within its tolerance. A few
    points far from the fit, such as glare or a speck of dust, are left out.

    Parameters
    ----------
    tolerances : (p,) expected standard deviations of the parameters, above 0
    noise : standard deviation of a measured coordinate, viewer px

    Raises
    ------
    RigError : too few points were measured, they do not belong to this bench, or the fit does not
        converge
    """
    measured = np.array(measured, float)
    is_measured = np.isfinite(measured).all(axis=1)
    n_measured = int(is_measured.sum())
    if n_measured < FEWEST:
        raise RigError(
            "Only {n_measured} points were measured. A fit needs {least} or more.",
            n_measured=n_measured,
            least=FEWEST,
        )

    # outliers of the common displacement are removed first, or the fit may not converge
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
    return BenchFit(
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
    """Fit a task repeatedly until it has no outliers; adds them to `left_out` (m,)."""
    state = task.at(np.zeros(len(task.tolerances)), task.bench.view)
    done = 0.0

    while True:
        state = yield from subprogress(settle(task, state), done, 0.5 + 0.5 * done)
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
    """Mask (m,) of the points much farther from the fit than the median, in noise. All False if
    there would be too many outliers, including earlier ones.
    """
    far = distance > max(FITTING.unlikely, FITTING.strange * np.nanmedian(distance))
    return far & ((left_out | far).sum() <= FITTING.most_strange * n_measured)


def _check(used: Bools, n_left: int, after: float, noise: float) -> None:
    """Raise RigError if too few of the remaining points were used (m,), or if they are too far off,
    px.
    """
    if used.sum() < max(FEWEST, FITTING.least_used * n_left):
        raise RigError(
            "Only {n_used} of {n_left} measured points can be traced to the display. Look for"
            " swapped points, points of another rig, or glass with many flat faces.",
            n_used=used.sum(),
            n_left=n_left,
        )
    if after >= FITTING.unlikely * noise:
        raise RigError(
            "The points are {off:.3g} pixels from the nearest possible positions in this rig. Look"
            " for swapped points, or points of another rig.",
            off=after,
        )


def condition_of(movements: Floats) -> float:
    """Ratio of the largest and smallest singular value; infinite for fewer rows than columns."""
    singular = np.linalg.svd(movements, compute_uv=False)
    is_determined = len(movements) >= movements.shape[1] and singular[-1] > 0
    return float(singular[0] / singular[-1]) if is_determined else float("inf")


def _rms(distances: Floats) -> float:
    """Rms length of vectors with components (2 n,)."""
    return float(np.sqrt(2 * (distances**2).mean())) if len(distances) else float("nan")


def covariance_of(movements: Floats) -> Floats:
    """Covariance (p, p), in tolerances, of amounts fitted to points with these movements."""
    return np.linalg.inv(movements.T @ movements + np.eye(movements.shape[1]))


ASIDE_DEGREES = 10.0  # angle of a further photograph
NEARER = 0.7  # distance of a further photograph, as a fraction of the distance to the glass


@dataclass(frozen=True, eq=False)
class Extra:
    """A possible further photograph of the same display, and its gain in information.

    where : its position, relative to the viewer
    errors : (p,) standard deviations of the amounts with it
    condition : of the movements in both photographs
    gain : bits of information on the errors, except the second viewer's own position
    """

    where: str
    errors: Floats
    condition: float
    gain: float


def extra_photographs(
    bench: Bench, found: BenchFit, tolerances: Floats, noise: float = 0.3
) -> Generator[float, None, list[Extra]]:
    """Positions for a further photograph, the most informative first. Yields progress.

    The second viewer's position is as uncertain as the first one's; its focal length is the same.
    """
    viewer = bench.viewer
    pivot = (bench.rig.glasses or bench.rig.displays)[0].mesh.bounds.mean(axis=0)
    away = viewer.axes[2]

    n = len(bench.parameters)
    own = np.array(
        [
            p.name.startswith(f"{viewer.name}: ") and p.unit in {"mm", "deg"}
            for p in bench.parameters
        ]
    )
    shared = np.flatnonzero(~own)

    # the second viewer's own position adds parameters
    first = np.hstack([found.movements, np.zeros((len(found.movements), own.sum()))])
    columns = np.arange(n)
    columns[own] = n + np.arange(own.sum())
    before = covariance_of(first)[np.ix_(shared, shared)]

    # approximate points, at the glass's distance
    origins, directions = viewer.rays(bench.view)
    points = origins + directions * ((pivot - origins) @ away / (directions @ away))[:, None]
    extras = []
    places = _places(viewer, pivot)
    for k, (where, motion) in enumerate(places.items()):
        try:
            there = _bench_from(bench, motion, points, own)
            d = yield from subprogress(
                there.sensitivities(), k / len(places), (k + 1) / len(places)
            )
        except RigError:  # nothing is visible from there
            continue

        used = np.isfinite(d).all(axis=(0, 2))
        if used.sum() < FEWEST:
            continue

        second = np.zeros((2 * used.sum(), first.shape[1]))
        second[:, columns] = d[:, used].reshape(n, -1).T * tolerances / noise
        both = np.vstack([first, second])

        covariance = covariance_of(both)
        after = covariance[np.ix_(shared, shared)]
        gain = 0.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]) / np.log(2)
        extras.append(
            Extra(
                where=where,
                errors=np.sqrt(np.diag(covariance))[:n] * tolerances,
                condition=condition_of(both),
                gain=float(gain),
            )
        )

    return sorted(extras, key=lambda extra: -extra.gain)


def _places(viewer: Viewer, pivot: Floats) -> dict[Message, Motion]:
    """Other positions of the viewer around a point (3,), m: their descriptions, and the motions
    there.
    """
    right, up, away = viewer.axes
    angle = ASIDE_DEGREES
    nearer = (1 - NEARER) * ((pivot - viewer.position) @ away) * away
    turns = (
        (Message("to the right"), turned(up, angle, pivot)),
        (Message("to the left"), turned(up, -angle, pivot)),
        (Message("up"), turned(right, -angle, pivot)),
        (Message("down"), turned(right, angle, pivot)),
    )
    return {
        **{
            Message("{angle:g} degrees {direction}", angle=angle, direction=direction): motion
            for direction, motion in turns
        },
        Message("{factor:g} times the distance", factor=NEARER): Motion(np.eye(3), nearer),
    }


def _bench_from(bench: Bench, motion: Motion, points: Floats, own: Bools) -> Bench:
    """A bench with a moved viewer that sees the points (m, 3), m.

    own : (p,) mask of the parameters of the viewer's own position, which shift and rotate it about
        its own axes
    """
    viewer = moved(bench.viewer, motion)
    rig = replace(bench.rig, viewers=(viewer, *bench.rig.viewers[1:]))
    theirs = {p.name: p for p in parameters(rig)}
    among = [
        theirs[p.name] if is_own else p for p, is_own in zip(bench.parameters, own, strict=True)
    ]
    there = Bench(rig, bench.settings, viewer.project(points), among)
    at = there.seen(np.zeros(len(among)), display=bench.display)

    return Bench(rig, bench.settings, at, among)
