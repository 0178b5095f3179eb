"""What is seen of a bench whose parts do not stand, or are not made, as planned.

A dot of the source image stays where it is on the display; the viewer sees it where a ray lands on it. With y the map
from viewer to display and p what is off, dx = -J^-1 dy/dp: by the view map's own derivatives, with no dot looked for.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from .arrays import Bools, Floats
from .errors import RigError
from .motion import Motion, find_motion
from .plan import Kept, Plan, Settings, make_plan
from .products import turn
from .rig import WAVELENGTH, ConstantIndex, Mesh, Plate, Rig, Viewer
from .session import finish, within
from .trace import trace_all

STEP = 0.02  # viewer px, for derivatives of the view map
CONVERGED = 1e-7  # display px
ITERATIONS = 30
ENOUGH = 1e-5  # of the sum of squares, in noise, or of one: what a step gains when there is nothing more to gain
HOPELESS = 1e8  # damping
FEWEST = 4  # points: eight numbers, as many as a picture in perspective has
UNLIKELY = 6.0  # times the noise: points that stay so far from a fit are none of this bench's
LEAST_USED = 0.5  # of the measured points have to be seen in the fitted rig
STRANGE, MOST_STRANGE = 5.0, 0.1  # times the median distance; share of the points that may be left out for it
FARTHEST = 40.0  # viewer px in one step of Newton's method
# standard deviations to expect, in the parameters' units, of a bench that was set up with rulers and squares
TOLERANCES = {"shift": 0.5, "turn": 0.1, "index": 0.002, "crossing": 0.02, "mirror": 0.01, "focal": 0.1}
AXES = ("right", "up", "away")  # as the viewer of the planned rig looks
ALIKE = 0.99  # cosine between movements from which on they are called alike
ASIDE = 10.0  # degrees from which another photograph is considered
NEARER = 0.7  # of the distance to the glass, likewise


@dataclass(frozen=True)
class Parameter:
    """Something about a bench that may be off.

    name : part and what about it; unit : of amounts; step : amount for derivatives
    applied : the rig with an amount of it
    """

    name: str
    unit: str
    step: float
    applied: Callable[[Rig, float], Rig]

    @property
    def kind(self) -> str:
        """A key of TOLERANCES: what about a part may be off, whichever part and axis."""
        return self.name.rsplit(": ", 1)[-1].split()[0]


def parameters(rig: Rig) -> list[Parameter]:
    """All that may be off: place and angle of each part, indices of the glass, the plate's make, the camera's image."""
    found = []
    for kind in ("glasses", "plates", "displays", "viewers"):
        for number, part in enumerate(getattr(rig, kind)):
            found += _poses(rig, kind, number, part.name)
    for number, glass in enumerate(rig.glasses):
        found.append(Parameter(f"{glass.name}: index", "", 1e-4, _changed("glasses", number, _other_index)))
    for number, plate in enumerate(rig.plates):
        if plate.array is not None and plate.array.layout == "crossed":
            change = _changed("plates", number, _crossed_wrong)
            found.append(Parameter(f"{plate.name}: crossing angle", "deg", 1e-2, change))
        if plate.array is not None:
            found.append(Parameter(f"{plate.name}: mirror height", "mm", 1e-3, _changed("plates", number, _higher)))
    found.append(Parameter(f"{rig.viewer.name}: focal length", "%", 1e-2, _changed("viewers", 0, _zoomed)))
    return found


def with_amounts(rig: Rig, amounts: Mapping[str, float]) -> tuple[Rig, tuple[str, ...]]:
    """The rig with amounts by the names of its parameters, and those names that it does not have.

    The picture goes along with the viewer: what is wanted, and measured, is wanted in the viewer's own image.
    """
    planned, left = rig, {name: amount for name, amount in amounts.items() if amount}
    for parameter in parameters(rig):
        amount = left.pop(parameter.name, 0.0)
        if amount:
            rig = parameter.applied(rig, amount)
    if rig.viewer is not planned.viewer:
        linear, shift = along_with(planned.viewer, rig.viewer)
        pictures = tuple(
            p if p.mesh is None else replace(p, mesh=replace(p.mesh, vertices=turn(linear, p.mesh.vertices) + shift))
            for p in rig.pictures
        )
        rig = replace(rig, pictures=pictures)
    return rig, tuple(left)


def with_offset(rig: Rig, offset: Iterable[Mapping[str, float]]) -> tuple[Rig, tuple[str, ...]]:
    """The rig with several sets of amounts, one after the other, and the names that it does not have."""
    unknown: list[str] = []
    for amounts in offset:
        rig, names = with_amounts(rig, amounts)
        unknown += names
    return rig, tuple(unknown)


def along_with(before: Viewer, after: Viewer) -> tuple[Floats, Floats]:
    """Where points p go, linear (3, 3) @ p + shift (3,), that are seen in the same pixels, as far away, as before."""
    zoom = np.diag([*(np.ptp(after.window[k : k + 2]) / np.ptp(before.window[k : k + 2]) for k in (0, 2)), 1.0])
    linear = after.axes.T @ zoom @ before.axes
    return linear, after.position - linear @ before.position


def part_motions(before: Rig, after: Rig) -> dict[str, Motion]:
    """By name, how the parts moved from one rig to another that differs by amounts."""
    found = {}
    for kind in ("glasses", "plates", "displays"):
        for a, b in zip(getattr(before, kind), getattr(after, kind), strict=True):
            if a.mesh is not b.mesh:
                found[a.name] = find_motion(a.mesh, b.mesh)
    for a, b in zip(before.viewers, after.viewers, strict=True):
        if a.position is not b.position:
            rotation = b.axes.T @ a.axes
            found[a.name] = Motion(rotation, b.position - rotation @ a.position)
    return found


def _poses(rig: Rig, kind: str, number: int, name: str) -> Iterator[Parameter]:
    """Shifts of a part along the viewer's axes, in mm, and turns about these through its own middle, in degrees."""
    part = getattr(rig, kind)[number]
    middle = part.position if kind == "viewers" else part.mesh.bounds.mean(axis=0)
    for word, axis in zip(AXES, rig.viewer.axes, strict=True):
        shift = _changed(kind, number, lambda part, mm, axis=axis: moved(part, Motion(np.eye(3), 1e-3 * mm * axis)))
        yield Parameter(f"{name}: shift {word}", "mm", 1e-2, shift)
    for word, axis in zip(AXES, rig.viewer.axes, strict=True):
        turn = _changed(kind, number, lambda part, degrees, axis=axis: moved(part, turned(axis, degrees, middle)))
        yield Parameter(f"{name}: turn about {word}", "deg", 1e-2, turn)


def turned(axis: Floats, degrees: float, about: Floats) -> Motion:
    """Turn about an axis (3,), unit, through a point (3,)."""
    # Rodrigues' formula
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    a = np.radians(degrees)
    rotation = np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * (k @ k)
    return Motion(rotation, about - rotation @ about)


def moved(part, motion: Motion):
    """A glass, plate, display or viewer elsewhere."""
    if isinstance(part, Viewer):
        return replace(part, position=motion.points(part.position), axes=motion.directions(part.axes))
    mesh = _moved_mesh(part.mesh, motion)
    if not isinstance(part, Plate):
        return replace(part, mesh=mesh)
    side, centre = part.side, part.centre
    return replace(
        part,
        mesh=mesh,
        side=None if side is None else motion.directions(side),
        centre=None if centre is None else motion.points(centre),
    )


def _moved_mesh(mesh: Mesh, motion: Motion) -> Mesh:
    normals = None if mesh.corner_normals is None else motion.directions(mesh.corner_normals)
    return replace(mesh, vertices=motion.points(mesh.vertices), corner_normals=normals)


def _changed(kind: str, number: int, change: Callable) -> Callable[[Rig, float], Rig]:
    """Of a rig, with one part changed by an amount."""

    def applied(rig: Rig, amount: float) -> Rig:
        parts = list(getattr(rig, kind))
        parts[number] = change(parts[number], amount)
        return replace(rig, **{kind: tuple(parts)})

    return applied


def _other_index(glass, amount: float):
    return replace(glass, ior=ConstantIndex(glass.ior(WAVELENGTH) + amount))


def _crossed_wrong(plate: Plate, degrees: float) -> Plate:
    return replace(plate, array=replace(plate.array, crossing_error=plate.array.crossing_error + np.radians(degrees)))


def _higher(plate: Plate, mm: float) -> Plate:
    return replace(plate, array=replace(plate.array, height=plate.array.height + 1e-3 * mm))


def _zoomed(viewer: Viewer, percent: float) -> Viewer:
    return replace(viewer, window=tuple(x / (1 + percent / 100) for x in viewer.window))


class Bench:
    """A planned rig and the points of the picture that are looked at.

    Parameters
    ----------
    rig, settings : as planned
    view : (m, 2) viewer px at which the points are seen as long as nothing is off
    among : what may be off; by default all there is

    Attributes
    ----------
    display : (m, 2) display px at which the display shows the points; NaN where the viewer does not see them
    """

    def __init__(self, rig: Rig, settings: Settings, view: Floats, among: list[Parameter] | None = None) -> None:
        # a point that is seen beside the glass is none of those that are seen in it
        self.rig, self.settings = rig, replace(settings, suppress_glare=0.0)
        self.view = np.asarray(view, float)
        self.parameters = parameters(rig) if among is None else among
        self._kept = Kept()
        self.display, self._branch = self._land(self.plan(), self.view)

    def plan(self, amounts: Floats | None = None) -> Plan:
        """Of the bench, with amounts (p,) of what may be off."""
        rig = self.rig
        for parameter, amount in zip(self.parameters, () if amounts is None else amounts, strict=False):
            if amount:
                rig = parameter.applied(rig, float(amount))
        return make_plan(rig, self.settings, self._kept)

    def shown(self, amounts: Floats) -> Floats:
        """Display px (m, 2) at which the points have to be shown when amounts (p,) are known to be off."""
        return self._on_branch(self.plan(amounts), self.view)

    def seen(self, amounts: Floats, start: Floats | None = None, display: Floats | None = None) -> Floats:
        """Where the points are seen (m, 2), viewer px, with amounts (p,) off; NaN where they are not, or not found.

        By Newton's method from `start` (m, 2), by default from where they are planned to be seen. The points are shown
        where that was planned, or at display px (m, 2).
        """
        wanted = self.display if display is None else display
        plan = self.plan(amounts)
        at = self.view.copy() if start is None else np.array(start, float)
        for _ in range(ITERATIONS):
            y, j = self._derivatives(plan, at)
            missing = wanted - y
            step = _solved(j, missing)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            with np.errstate(invalid="ignore", divide="ignore"):
                at = at + step * np.minimum(1.0, FARTHEST / length)
            if not np.nanmax(np.abs(missing), initial=0.0) > CONVERGED:
                break
        y, _ = self._land(plan, at)
        with np.errstate(invalid="ignore"):
            at[~(np.abs(y - wanted) <= 1e3 * CONVERGED).all(axis=1)] = np.nan
        return at

    def sensitivity(self, amounts: Floats | None = None, at: Floats | None = None) -> Floats:
        """How the points move (p, m, 2), viewer px for a unit of each parameter, by the view map's derivatives.

        amounts (p,) and at (m, 2): what is off, and where the points are seen then; by default nothing, as planned
        """
        return finish(self.sensitivities(amounts, at))

    def sensitivities(self, amounts: Floats | None = None, at: Floats | None = None) -> Generator[float, None, Floats]:
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
            found[k] = -_solved(j, (ends[0] - ends[1]) / (2 * parameter.step))
            yield (k + 1) / len(self.parameters)
        return found

    def _derivatives(self, plan: Plan, at: Floats) -> tuple[Floats, Floats]:
        """Landings (m, 2), and the view map's derivatives (m, 2, 2) there."""
        steps = STEP * np.array([[0.0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
        y = self._on_branch(plan, (at + steps[:, None]).reshape(-1, 2)).reshape(5, -1, 2)
        return y[0], np.stack([y[1] - y[2], y[3] - y[4]], axis=2) / STEP

    def _land(self, plan: Plan, at: Floats) -> tuple[Floats, np.ndarray]:
        """Display px (n, 2), also beside a flat display, and branch (n,) of viewer px (n, 2); NaN for none."""
        is_there = np.isfinite(at).all(axis=1)
        xy, branch = np.full(at.shape, np.nan), np.zeros(len(at), np.uint64)
        landings = trace_all(plan, *plan.rig.viewer.rays(at[is_there]))
        xy[is_there], branch[is_there] = landings.xy, landings.branch
        return xy, branch

    def _on_branch(self, plan: Plan, at: Floats) -> Floats:
        """Landings (k m, 2) of viewer px; NaN where light takes another way than as planned to the same point."""
        xy, branch = self._land(plan, at)
        xy[branch != np.tile(self._branch, len(at) // len(self.view))] = np.nan
        return xy


def _solved(j: Floats, b: Floats) -> Floats:
    """x (m, 2) with j x = b, for matrices (m, 2, 2); NaN where they are singular or unknown."""
    det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (j[:, 1, 1] * b[:, 0] - j[:, 0, 1] * b[:, 1]) / det
        y = (j[:, 0, 0] * b[:, 1] - j[:, 1, 0] * b[:, 0]) / det
    return np.stack([x, y], axis=1)


@dataclass(frozen=True, eq=False)
class Fit:
    """What a bench seems to be off by.

    Parameters
    ----------
    amounts : (p,) of the bench's parameters
    errors : (p,) their standard deviations: where they are near the tolerances the points tell nothing of them
    correlation : (p, p) of these errors; near 1 or -1 two amounts cannot be told apart
    condition : largest by smallest singular value of the points' movements, each for its tolerance, over the noise
    before, after : rms distance of the points from where they were to be seen, and from where the fit has them, px
    used, left_out : (m,) points that were fitted, and measured ones that are too far from where the others have them
    n_measured : points that were measured
    movements : (2 k, p) of the coordinates of the k used points, for the tolerance of each parameter, over the noise
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
        """Groups of parameters that move the points almost alike; and those that, within tolerance, hardly move any."""
        length = np.linalg.norm(self.movements, axis=0)
        left, groups = [int(k) for k in np.argsort(-length) if length[k] >= 1], []
        while left:
            cosine = self.movements[:, left[0]] @ self.movements[:, left] / (length[left[0]] * length[left])
            like = [k for k, c in zip(left, cosine, strict=True) if abs(c) > ALIKE]
            left = [k for k in left if k not in like]
            if len(like) > 1:
                groups.append(like)
        return groups, np.flatnonzero(length < 1).tolist()


def fit(bench: Bench, measured: Floats, tolerances: Floats, noise: float = 0.3) -> Generator[float, None, Fit]:
    """Find what is off from where points were measured (m, 2), viewer px, NaN where they were not. Yields progress.

    Damped least squares (Levenberg's), with what is known before: each amount is likely to be within its tolerance.
    A few points that stay far from where all others have them, by glare or a speck of dust, are left out.

    Parameters
    ----------
    tolerances : (p,) standard deviations to expect of the parameters, above 0
    noise : standard deviation of a measured coordinate, viewer px

    Raises
    ------
    RigError : too few points were measured, they are none of this bench's, or the fit finds no end
    """
    tolerances, measured = np.asarray(tolerances, float), np.array(measured, float)
    is_measured = np.isfinite(measured).all(axis=1)
    if is_measured.sum() < FEWEST:
        raise RigError(f"Only {is_measured.sum()} points were measured: a fit takes {FEWEST} or more.")
    amounts, at, done = np.zeros(len(tolerances)), bench.view, 0.0
    away = measured - at
    before = _rms(away[is_measured].ravel())

    def strangers(distance: Floats) -> Bools:
        """Which points (m,) are much further off, in noise, than the others? None if they are many."""
        far = distance > max(UNLIKELY, STRANGE * np.nanmedian(distance))
        return far & ((left_out | far).sum() <= MOST_STRANGE * is_measured.sum())

    left_out = np.zeros(len(measured), bool)
    # to begin with, against the others' displacement: far ones would draw the fit to where it finds no end
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
            f"Only {used.sum()} of {n_left} measured points can be followed to the display: they may be swapped or"
            " those of another rig, or the glass has too many flat faces."
        )
    if after >= UNLIKELY * noise:
        raise RigError(
            f"The points lie {after:.3g} pixels from where the rig can show them, whatever is off: they may be swapped,"
            " or those of another rig."
        )
    covariance = _spread_of(movements)
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
    """The fit of all points that are measured, from amounts (p,) on, where they are seen about at (m, 2).

    Returns amounts (p,); residuals (2 k,) over the noise; where all points are seen (m, 2); which k were used (m,);
    movements (2 k, p) as in Fit.
    """
    n, n_measured = len(tolerances), int(np.isfinite(measured).all(axis=1).sum())

    def state(amounts: Floats, start: Floats) -> tuple[float, Floats, Floats, Bools]:
        """What is to be made small, residuals, and where which points are seen."""
        try:
            at = bench.seen(amounts, start)
        except RigError:  # no such bench can be made
            return np.inf, np.empty(0), start, np.zeros(len(start), bool)
        used = np.isfinite(measured - at).all(axis=1)
        off = (measured - at)[used].ravel() / noise
        # points that are not seen count as the others do on average: else to lose the worst would seem to help
        data = off @ off * n_measured / used.sum() if used.sum() >= FEWEST else np.inf
        return float(data + ((amounts / tolerances) ** 2).sum()), off, at, used

    def movements(amounts: Floats, at: Floats, used: Bools) -> Generator[float, None, Floats | None]:
        """Of residuals (2 k,) for each tolerance (p,); None at the end of what can be made."""
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
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), d.T @ off - amounts / tolerances)
        tried = amounts + step * tolerances
        value, *found = state(tried, at)
        # how many steps it takes is not known: each gets a part of what is left
        done = 1 - 0.8 ** (k + 1), 1 - 0.8 ** (k + 2)
        there = (yield from within(movements(tried, *found[1:]), *done)) if value <= cost else None
        if there is None:
            damping *= 10
            if damping > HOPELESS:
                return amounts, off, at, used, d
            continue
        is_at_end = cost - value < ENOUGH * max(cost, 1.0)
        amounts, cost, (off, at, used), d, damping = tried, value, found, there, damping / 10
        if is_at_end:
            return amounts, off, at, used, d
    raise RigError(
        f"After {ITERATIONS} steps the fit still changes: look for points that are wrong or counted in another way,"
        " compare the lattice with the picture, or expect less to be off."
    )


def condition_of(movements: Floats) -> float:
    """Largest by smallest singular value; infinite for fewer rows than columns."""
    singular = np.linalg.svd(movements, compute_uv=False)
    is_known = len(movements) >= movements.shape[1] and singular[-1] > 0
    return float(singular[0] / singular[-1]) if is_known else float("inf")


@dataclass(frozen=True, eq=False)
class Extra:
    """What another photograph, of the same display from another place, would tell beside the one that was fitted.

    where : the place, from the viewer
    errors : (p,) standard deviations of the amounts then
    condition : that of both photographs' movements together
    gain : bits that it tells of what is off, the second viewer's own place aside
    """

    where: str
    errors: Floats
    condition: float
    gain: float


def extra_photographs(
    bench: Bench, found: Fit, tolerances: Floats, noise: float = 0.3
) -> Generator[float, None, list[Extra]]:
    """Other places to take a photograph from, the most telling first; yields progress.

    The place of the second viewer is as uncertain as that of the first; its focal length is the same.
    """
    viewer, pivot = bench.rig.viewer, bench.rig.glasses[0].mesh.bounds.mean(axis=0)
    right, up, away = viewer.axes
    places = {
        f"{ASIDE:g} degrees further right": turned(up, ASIDE, pivot),
        f"{ASIDE:g} degrees further left": turned(up, -ASIDE, pivot),
        f"{ASIDE:g} degrees higher": turned(right, -ASIDE, pivot),
        f"{ASIDE:g} degrees lower": turned(right, ASIDE, pivot),
        f"{NEARER:g} times the distance": Motion(np.eye(3), (1 - NEARER) * ((pivot - viewer.position) @ away) * away),
    }
    n = len(bench.parameters)
    own = np.array([p.name.startswith(f"{viewer.name}: ") and p.unit in {"mm", "deg"} for p in bench.parameters])
    shared = np.flatnonzero(~own)
    first = np.hstack([found.movements, np.zeros((len(found.movements), own.sum()))])
    columns = np.arange(n)
    columns[own] = n + np.arange(own.sum())  # of the second viewer's own place
    # about where the points are: as far away as the glass
    origins, directions = viewer.rays(bench.view)
    points = origins + directions * ((pivot - origins) @ away / (directions @ away))[:, None]
    before = _spread_of(first)[np.ix_(shared, shared)]
    extras = []
    for k, (where, motion) in enumerate(places.items()):
        rig = replace(bench.rig, viewers=(moved(viewer, motion),))
        theirs = {p.name: p for p in parameters(rig)}  # the second viewer is shifted and turned about its own axes
        among = [theirs[p.name] if is_own else p for p, is_own in zip(bench.parameters, own, strict=True)]
        try:
            there = Bench(rig, bench.settings, rig.viewer.project(points), among)
            at = there.seen(np.zeros(n), display=bench.display)
            there = Bench(rig, bench.settings, at, among)
            d = yield from within(there.sensitivities(), k / len(places), (k + 1) / len(places))
        except RigError:  # nothing is seen from there
            continue
        used = np.isfinite(d).all(axis=(0, 2))
        if used.sum() < FEWEST:
            continue
        second = np.zeros((2 * used.sum(), first.shape[1]))
        second[:, columns] = d[:, used].reshape(n, -1).T * tolerances / noise
        both = np.vstack([first, second])
        covariance = _spread_of(both)
        after = covariance[np.ix_(shared, shared)]
        gain = 0.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]) / np.log(2)
        extras.append(Extra(where, np.sqrt(np.diag(covariance))[:n] * tolerances, condition_of(both), float(gain)))
    return sorted(extras, key=lambda extra: -extra.gain)


def _spread_of(movements: Floats) -> Floats:
    """Covariance (p, p), in tolerances, of what is fitted to points that move so."""
    return np.linalg.inv(movements.T @ movements + np.eye(movements.shape[1]))


def _rms(distances: Floats) -> float:
    """Rms length of vectors whose components (2 n,) these are."""
    return float(np.sqrt(2 * (distances**2).mean())) if len(distances) else float("nan")


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
