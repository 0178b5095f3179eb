"""The errors of a bench that fit photographs best, by damped least squares.

Also the further photograph that would reduce their uncertainty most.
"""

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
            # how many steps it takes is not known: each gets a part of the rest
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
        "The fit still changes after {steps} steps: look for wrong or swapped points,"
        " compare the lattice with the picture, or lower the tolerances.",
        steps=DAMPING.most_steps,
    )


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
class BenchFit:
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
) -> Generator[float, None, BenchFit]:
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
    """The fit of a task without points that are far from it, which are left out (m,), too."""
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


ASIDE_DEGREES = 10.0  # from which another photograph is considered
NEARER = 0.7  # of the distance to the glass, likewise


@dataclass(frozen=True, eq=False)
class Extra:
    """Another photograph, of the same display from another place, and the knowledge it would add.

    where : the place, from the viewer
    errors : (p,) standard deviations of the amounts then
    condition : that of both photographs' movements together
    gain : bits that it tells of the errors, the second viewer's own place aside
    """

    where: str
    errors: Floats
    condition: float
    gain: float


def extra_photographs(
    bench: Bench, found: BenchFit, tolerances: Floats, noise: float = 0.3
) -> Generator[float, None, list[Extra]]:
    """Other places to take a photograph from, the most telling first; yields progress.

    The place of the second viewer is as uncertain as that
    of the first; its focal length is the same.
    """
    viewer = bench.viewer
    pivot = bench.rig.glasses[0].mesh.bounds.mean(axis=0)
    away = viewer.axes[2]

    n = len(bench.parameters)
    own = np.array(
        [
            p.name.startswith(f"{viewer.name}: ") and p.unit in {"mm", "deg"}
            for p in bench.parameters
        ]
    )
    shared = np.flatnonzero(~own)

    # the second viewer's own place is a parameter more
    first = np.hstack([found.movements, np.zeros((len(found.movements), own.sum()))])
    columns = np.arange(n)
    columns[own] = n + np.arange(own.sum())
    before = covariance_of(first)[np.ix_(shared, shared)]

    # about where the points are: as far away as the glass
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
        except RigError:  # nothing is seen from there
            continue

        used = np.isfinite(d).all(axis=(0, 2))
        if used.sum() < FEWEST:
            continue

        # with the movements of both photographs
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
    """Other places of the viewer around a point (3,), m, in words, and how it gets there."""
    right, up, away = viewer.axes
    angle = ASIDE_DEGREES
    nearer = (1 - NEARER) * ((pivot - viewer.position) @ away) * away
    return {
        Message("{angle:g} degrees further right", angle=angle): turned(up, angle, pivot),
        Message("{angle:g} degrees further left", angle=angle): turned(up, -angle, pivot),
        Message("{angle:g} degrees higher", angle=angle): turned(right, -angle, pivot),
        Message("{angle:g} degrees lower", angle=angle): turned(right, angle, pivot),
        Message("{factor:g} times the distance", factor=NEARER): Motion(np.eye(3), nearer),
    }


def _bench_from(bench: Bench, motion: Motion, points: Floats, own: Bools) -> Bench:
    """A bench whose viewer stands elsewhere and sees the points (m, 3), m, that it shows.

    own (p,) : parameters of the viewer's own place: the second is shifted
        and turned about its own axes
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
