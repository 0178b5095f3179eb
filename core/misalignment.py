"""What is seen of a bench whose parts do not stand, or are not made, as planned.

A dot of the source image stays where it is on the display; the viewer sees it where a ray lands on it. With y the map
from viewer to display and p what is off, dx = -J^-1 dy/dp: by the view map's own derivatives, with no dot looked for.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from .errors import RigError
from .motion import Motion
from .plan import Kept, Plan, Settings, make_plan
from .rig import WAVELENGTH, Bools, ConstantIndex, Floats, Mesh, Plate, Rig, Viewer
from .trace import trace_all

STEP = 0.02  # viewer px, for derivatives of the view map
CONVERGED = 1e-7  # display px
ITERATIONS = 30
ENOUGH = 1e-5  # of the sum of squares: what a step gains when there is nothing more to gain
HOPELESS = 1e8  # damping
FEWEST = 4  # points: eight numbers, as many as a picture in perspective has
UNLIKELY = 6.0  # times the noise: points that stay so far from a fit are none of this bench's
FARTHEST = 40.0  # viewer px in one step of Newton's method
AXES = ("right", "up", "away")  # as the viewer of the planned rig looks


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
        self.rig, self.settings, self.view = rig, settings, np.asarray(view, float)
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
    n_points : that were used
    is_converged : nothing would get better by another step
    """

    amounts: Floats
    errors: Floats
    correlation: Floats
    condition: float
    before: float
    after: float
    n_points: int
    is_converged: bool


def fit(bench: Bench, measured: Floats, tolerances: Floats, noise: float = 0.3) -> Fit:
    """Find what is off from where points were measured (m, 2), viewer px, NaN where they were not.

    Damped least squares (Levenberg's), with what is known before: each amount is likely to be within its tolerance.

    Parameters
    ----------
    tolerances : (p,) standard deviations to expect of the parameters, above 0
    noise : standard deviation of a measured coordinate, viewer px

    Raises
    ------
    RigError : too few points were measured, or they are none of this bench's
    """
    tolerances = np.asarray(tolerances, float)
    n = len(tolerances)
    n_measured = int(np.isfinite(measured).all(axis=1).sum())
    if n_measured < FEWEST:
        raise RigError(f"Only {n_measured} points were measured: a fit takes {FEWEST} or more.")

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

    def movements(amounts: Floats, at: Floats, used: Bools) -> Floats | None:
        """Of residuals (2 m,) for each tolerance (p,); None at the end of what can be made."""
        try:
            found = bench.sensitivity(amounts, at)
        except RigError:
            return None
        return np.nan_to_num(found[:, used].reshape(n, -1).T * tolerances / noise)

    amounts, damping, is_converged = np.zeros(n), 1e-3, False
    cost, off, at, used = state(amounts, bench.view)
    before = _rms(off * noise)
    d = movements(amounts, at, used)
    for _ in range(ITERATIONS):
        if is_converged or damping > HOPELESS:
            break
        normal = d.T @ d + np.eye(n)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), d.T @ off - amounts / tolerances)
        tried = amounts + step * tolerances
        value, *found = state(tried, at)
        there = movements(tried, *found[1:]) if value <= cost else None
        if there is None:
            damping *= 10
            continue
        is_converged = cost - value < ENOUGH * cost
        amounts, cost, (off, at, used), d, damping = tried, value, found, there, damping / 10
    covariance = np.linalg.inv(d.T @ d + np.eye(n))
    deviation = np.sqrt(np.diag(covariance))
    singular = np.linalg.svd(d, compute_uv=False)
    after = _rms(off * noise)
    if not (used.sum() >= FEWEST and after < UNLIKELY * noise):
        raise RigError(
            f"The points lie {after:.3g} pixels from where the rig can show them, whatever is off: they may be swapped,"
            " or those of another rig."
        )
    return Fit(
        amounts,
        deviation * tolerances,
        covariance / np.outer(deviation, deviation),
        float(singular[0] / singular[-1]) if len(off) >= n and singular[-1] > 0 else float("inf"),
        before,
        after,
        int(used.sum()),
        bool(is_converged or damping > HOPELESS),
    )


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
