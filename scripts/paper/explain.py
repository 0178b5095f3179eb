"""What would turn the displacements simulated of the
cube's lattice into those of the paper's photographs.

Each photograph is a bench and what its display shows; what may be off ("suspects") changes one or
both. Dots are found by re-tracing, so amounts may be large; derivatives only say where to look.
Part of `dev.py misalignment`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from kiriko.core.arrays import Floats
from kiriko.core.bench.misalignment import Bench
from kiriko.core.bench.offset import Parameter, moved, parameters
from kiriko.core.errors import RigError
from kiriko.core.glass.motion import Motion
from kiriko.core.image.ideal_image import ideal_image
from kiriko.core.image.seen_image import lattice_shift
from kiriko.core.light.planning import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig import WAVELENGTH, PicturePlace, Rig
from kiriko.core.settings import Settings
from kiriko.core.solve.solution import without_glass

from .results import (
    GAP,
    HALF,
    PAPER_DX,
    PLAIN,
    SOURCE,
    Table,
    face_of,
    half_before,
    infloasion,
    mirrored,
    solve,
)

CONDITIONS = PLAIN, HALF, SOURCE
TARGET = np.array([PAPER_DX[condition] for condition in CONDITIONS])
ACROSS = 1165  # viewer px from the first to the last dot
DOTS = 7  # each way
NEAR = 1.0  # px: so far from the paper's three numbers is as good as on them
SHARP = 0.01  # px, against tolerances: how much a miss counts where amounts are to be small
FARTHEST = 50.0  # tolerances, by derivatives: more than that is not re-traced
UNMOVED = 0.1  # px for a tolerance: less is nothing
# of the largest: conditions whose dx differ by less move alike, and one that moves by less stays
ALIKE = 0.1
ITERATIONS = 8
PIXELS = 971  # of images in which dots are measured: half of the photographs' do
HALVINGS = 3  # of a step that would lose dots
WITHIN = 0.02  # px: what a step changes when there is nothing more to find
# combinations that are re-traced, of those that look best by derivatives
TRIED = 6
LOOKED_AT = 100
SHOWN = 5
PUBLISHED = "published"
PART = "half cube"
BENCH = "bench"
PROGRAM = "program"
MEASUREMENT = "photograph"
TOUCHED = tuple(f"{condition} only" for condition in CONDITIONS)
KINDS = (
    (BENCH,),
    (BENCH, PART),
    (BENCH, PROGRAM),
    (BENCH, PUBLISHED),
    (BENCH, PART, PROGRAM),
    (PUBLISHED, PART, PROGRAM, MEASUREMENT),
    (PUBLISHED, PART, BENCH, PROGRAM, MEASUREMENT),
)


@dataclass(frozen=True, eq=False)
class Photograph:
    """A bench, and the rig for which what its display shows was made."""

    bench: Rig
    made_for: Rig


@dataclass(frozen=True, eq=False)
class Setup:
    """The three photographs, and the scale at which they are measured."""

    photographs: tuple[Photograph, ...]
    scale: float = 1.0


@dataclass(frozen=True)
class Suspect:
    """Something that may be off.

    where : whom it concerns. `bench`: all three photographs; `half cube`: InFloasion's glass;
        `program`: what the authors' program took for true when it made the source image;
        `published`: bench and program alike are not as the paper says; `photograph`: its
        measurement; `... only`: the bench, while one of the photographs was taken
    tolerance : amount to expect, in the unit
    """

    where: str
    name: str
    unit: str
    tolerance: float
    changed: Callable[[Setup, float], Setup]

    @property
    def title(self) -> str:
        return self.name if self.where == BENCH else f"{self.where}: {self.name}"


# What may be off


def suspects(rig: Rig, tolerance: Callable[[Parameter], float]) -> list[Suspect]:
    """All that may be off in three photographs of a rig,
    in the order in which it has to be applied.

    tolerance : the amount to expect of a parameter
    """
    own = parameters(rig)
    own.append(Parameter(f"{rig.glasses[0].name}: size", "%", 0.1, _resized))
    glass = [p for p in own if p.name.startswith(f"{rig.glasses[0].name}: ")]
    distance = Parameter(f"{rig.viewer.name}: distance", "mm", 1.0, _seen_from)
    thickness = Parameter("thickness", "mm", 0.1, _as_it_is)
    scale = Parameter("scale", "%", 0.1, _as_it_is)
    found = [_suspect(PUBLISHED, p, tolerance, _on_all) for p in (*glass, distance)]
    found.append(_suspect(PART, thickness, tolerance, _cut_thicker))
    found += [_suspect(PART, p, tolerance, _on_half) for p in half_parameters(rig)]
    found += [_suspect(BENCH, p, tolerance, _on_benches) for p in own]
    found += [_suspect(PROGRAM, p, tolerance, _on_program) for p in own]
    found.append(_suspect(MEASUREMENT, scale, tolerance, _at_scale))
    for number, where in enumerate(TOUCHED):
        found += [
            _suspect(where, p, tolerance, partial(_on_one, number)) for p in own if p not in glass
        ]
    return found


def half_parameters(rig: Rig) -> list[Parameter]:
    """Poses and index of the half cube that stands on the
    display: no part of it can sink into that.
    """
    name = f"{infloasion(rig).glasses[1].name}: "
    return [
        replace(p, name=p.name.removeprefix(name), applied=partial(_on_the_display, p))
        for p in parameters(_with_halves(rig))
        if p.name.startswith(name)
    ]


def _on_the_display(parameter: Parameter, rig: Rig, amount: float) -> Rig:
    rig = parameter.applied(rig, amount)
    glass, half = rig.glasses
    display, front = face_of(rig.display.mesh)
    lift = max(GAP - ((half.mesh.corners.reshape(-1, 3) - display) @ front).min(), 0.0)
    return replace(rig, glasses=(glass, moved(half, Motion(np.eye(3), lift * front))))


def _as_it_is(rig: Rig, amount: float) -> Rig:
    return rig


def _resized(rig: Rig, percent: float) -> Rig:
    """The first glass larger, about its middle."""
    glass, *others = rig.glasses
    middle = glass.mesh.bounds.mean(axis=0)
    vertices = middle + (1 + percent / 100) * (glass.mesh.vertices - middle)
    return replace(
        rig, glasses=(replace(glass, mesh=replace(glass.mesh, vertices=vertices)), *others)
    )


def _seen_from(rig: Rig, mm: float) -> Rig:
    """The viewer further away, with the picture as large in its image as before."""
    viewer = rig.viewer
    picture = rig.picture.mesh.bounds.mean(axis=0)
    forward = viewer.axes[2]
    before = (picture - viewer.position) @ forward
    window = tuple(x * before / (before + 1e-3 * mm) for x in viewer.window)
    return replace(
        rig,
        viewers=(replace(viewer, position=viewer.position - 1e-3 * mm * forward, window=window),),
    )


def _suspect(
    where: str, parameter: Parameter, tolerance: Callable[[Parameter], float], change: Callable
) -> Suspect:
    return Suspect(
        where, parameter.name, parameter.unit, tolerance(parameter), partial(change, parameter)
    )


def _on_all(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    return as_planned(parameter.applied(setup.photographs[2].made_for, amount))


def _cut_thicker(parameter: Parameter, setup: Setup, mm: float) -> Setup:
    """The half cube with its cut elsewhere."""
    plain, half, source = setup.photographs
    rig = half.made_for
    (glass, piece) = half.bench.glasses
    display, front = face_of(rig.display.mesh)
    beside = piece.mesh.vertices[0] - infloasion(rig).glasses[1].mesh.vertices[0]
    whole = mirrored(rig.glasses[0].mesh, *face_of(rig.plates[0].mesh))
    mesh = half_before(whole, display + (GAP - 1e-3 * mm) * front, front)
    piece = moved(replace(piece, mesh=mesh), Motion(np.eye(3), beside + 1e-3 * mm * front))
    half = replace(half, bench=replace(half.bench, glasses=(glass, piece)))
    return replace(setup, photographs=(plain, half, source))


def _on_half(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    plain, half, source = setup.photographs
    half = replace(half, bench=parameter.applied(half.bench, amount))
    return replace(setup, photographs=(plain, half, source))


def _on_benches(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    photographs = (
        replace(p, bench=_with_half(parameter, p.bench, amount)) for p in setup.photographs
    )
    return replace(setup, photographs=tuple(photographs))


def _on_one(number: int, parameter: Parameter, setup: Setup, amount: float) -> Setup:
    photographs = list(setup.photographs)
    one = photographs[number]
    photographs[number] = replace(one, bench=_with_half(parameter, one.bench, amount))
    return replace(setup, photographs=tuple(photographs))


def _with_half(parameter: Parameter, bench: Rig, amount: float) -> Rig:
    """A bench with something off; a half cube goes where the display goes that it stands on."""
    changed = parameter.applied(bench, amount)
    halves = [
        parameter.applied(replace(bench, displays=(half,)), amount).display
        for half in bench.glasses[1:]
    ]
    return replace(changed, glasses=(changed.glasses[0], *halves))


def _on_program(parameter: Parameter, setup: Setup, amount: float) -> Setup:
    plain, half, source = setup.photographs
    source = replace(source, made_for=parameter.applied(source.made_for, amount))
    return replace(setup, photographs=(plain, half, source))


def _at_scale(parameter: Parameter, setup: Setup, percent: float) -> Setup:
    return replace(setup, scale=setup.scale * (1 + percent / 100))


# What is seen


def as_planned(rig: Rig) -> Setup:
    """The three photographs of a bench on which nothing is off."""
    bare = without_glass(rig)
    return Setup((Photograph(rig, bare), Photograph(_with_halves(rig), bare), Photograph(rig, rig)))


def _with_halves(rig: Rig) -> Rig:
    """InFloasion's bench. Mirrors of some height image beside where
    the plate's plane would: there the half stands.
    """
    bare = without_glass(rig)
    by_plane = replace(bare, plates=tuple(replace(plate, array=None) for plate in rig.plates))
    rays = rig.viewer.rays(rig.viewer.project(rig.picture.mesh.bounds.mean(axis=0)[None]))
    places = [
        trace_all(make_plan(r, Settings(only_through_glass=False)), *rays).positions
        for r in (bare, by_plane)
    ]
    both = infloasion(rig)
    halves = (
        moved(half, Motion(np.eye(3), (places[0] - places[1])[0])) for half in both.glasses[1:]
    )
    return replace(both, glasses=(*rig.glasses, *halves))


def framed(rig: Rig) -> Rig:
    """The rig, its viewer's image of such a size that the dots
    are ACROSS pixels from the first to the last.
    """
    viewer = rig.viewer
    across = np.ptp(viewer.project(dots(rig.picture_place))[:, 0])
    width = round(viewer.width * ACROSS / across)
    return replace(
        rig,
        viewers=(replace(viewer, width=width, height=round(width * viewer.height / viewer.width)),),
    )


def dots(place: PicturePlace) -> Floats:
    """Places (49, 3) of the dots of the lattice on a flat picture, m.

    Row by row from the top left.
    """
    at = (np.arange(DOTS) + 0.5) / DOTS
    u, v = (x.ravel() for x in np.meshgrid(at, 1 - at))
    uv = place.mesh.uv.reshape(-1, 2)
    places = place.mesh.corners.reshape(-1, 3)
    affine, *_ = np.linalg.lstsq(np.column_stack([uv, np.ones(len(uv))]), places, rcond=None)
    return np.column_stack([u, v, np.ones(len(u))]) @ affine


class Experiment:
    """Three photographs of the lattice, re-traced.

    Parameters
    ----------
    rig : as planned, with the lattice as its picture

    Attributes
    ----------
    planned : what it is when nothing is off
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = framed(rig)
        self.dots = dots(rig.picture_place)
        self.wanted = self.rig.viewer.project(self.dots)
        self.planned = as_planned(self.rig)
        self._start = [self.wanted] * len(CONDITIONS)
        self._kept = {}
        self._start = [
            self._seen(k, photograph) for k, photograph in enumerate(self.planned.photographs)
        ]

    def moves(self, setup: Setup) -> Floats:
        """Displacement (3, 49, 2) of the dots, viewer px; NaN
        where one is not seen or leaves its way.
        """
        found = []
        for k, photograph in enumerate(setup.photographs):
            if (k, photograph) not in self._kept:
                self._kept[k, photograph] = self._seen(k, photograph)
            found.append(self._kept[k, photograph] - self.wanted)
        return setup.scale * np.stack(found)

    def changed(self, some: Sequence[Suspect], amounts: Sequence[float]) -> Setup:
        """With amounts of suspects, in tolerances."""
        setup = self.planned
        for suspect, amount in zip(some, amounts, strict=True):
            setup = suspect.changed(setup, float(amount * suspect.tolerance)) if amount else setup
        return setup

    def off(self, some: Sequence[Suspect], amounts: Sequence[float]) -> Floats:
        """Displacement (3, 49, 2), NaN all over where there is no such bench."""
        try:
            return self.moves(self.changed(some, amounts))
        except RigError:
            return np.full((len(CONDITIONS), len(self.wanted), 2), np.nan)

    def _seen(self, k: int, photograph: Photograph) -> Floats:
        """Where the dots (49, 2) of one photograph are seen: first
        the middle one, then all from where that went.
        """
        made_for = photograph.made_for
        middle = [len(self.wanted) // 2]
        plan = make_plan(made_for, Settings(only_through_glass=False))
        shown = trace_all(plan, *made_for.viewer.rays(made_for.viewer.project(self.dots))).xy
        start = self._start[k]
        start = start + _found(photograph.bench, start[middle], shown[middle]) - start[middle]
        return _found(photograph.bench, start, shown)

    def photographed(self, setup: Setup, pixels: int = PIXELS) -> Floats:
        """Displacement (3, 49, 2) of the dots' centroids in images
        of what is seen, as `dev.py paper` measures it.

        The images are of so many pixels in width, and what is
        found counts in those of the photographs.
        """
        wanted = ideal_image(self.rig.picture, _coarse(self.rig, pixels).viewer)
        found = []
        for photograph in setup.photographs:
            is_bare = all(glass.ior.at(WAVELENGTH) == 1 for glass in photograph.made_for.glasses)
            source = solve(
                _coarse(photograph.made_for, pixels), only_through_glass=not is_bare
            ).source
            seen = solve(_coarse(photograph.bench, pixels)).seen(source)
            found.append(lattice_shift(seen, wanted).shift.reshape(-1, 2))
        return setup.scale * self.rig.viewer.width / pixels * np.stack(found)


def _coarse(rig: Rig, pixels: int) -> Rig:
    """Its viewer's image, as large as before, of so many pixels in width."""
    height = round(pixels * rig.viewer.height / rig.viewer.width)
    return replace(rig, viewers=(replace(rig.viewer, width=pixels, height=height),))


def _found(bench: Rig, start: Floats, shown: Floats) -> Floats:
    """Where points shown at display px (n, 2) are seen (n, 2), from viewer px (n, 2) on."""
    return Bench(bench, Settings(), start, []).seen(np.empty(0), display=shown)


def taken_for_ideal(setup: Setup) -> Setup:
    """The same benches, with all that is shown made for a plate without mirrors."""

    def ideal(rig: Rig) -> Rig:
        return replace(rig, plates=tuple(replace(plate, array=None) for plate in rig.plates))

    return replace(
        setup, photographs=tuple(replace(p, made_for=ideal(p.made_for)) for p in setup.photographs)
    )


# What would explain the paper


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
    what is missing (3,) or as near to that as they can.

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


# Tables


@dataclass(frozen=True, eq=False)
class Findings:
    """What was found, as tables by their headings, and the smallest explanations."""

    tables: dict[str, Table]
    one_bench: Explanation
    touched: Explanation


def explain(rig: Rig, tolerance: Callable[[Parameter], float]) -> Findings:
    """Ask of all that may be off on a bench whether it makes the paper's numbers.

    rig : as planned, with one glass and the lattice as its picture
    tolerance : the amount to expect of a parameter
    """
    experiment = Experiment(rig)
    planned = experiment.moves(experiment.planned)
    every = suspects(experiment.rig, tolerance)
    single = [s for s in every if s.where not in TOUCHED]
    change = columns(experiment, single)
    able = np.abs(change[:, 0]).max(axis=1) > UNMOVED
    capable = [s for s, is_able in zip(single, able, strict=True) if is_able]
    matrix = change[able, 0].T
    missing = TARGET - means(planned)
    near = [
        k for k in range(len(capable)) if np.abs(smallest(matrix[:, [k]], missing)).max() < FARTHEST
    ]
    alone = [explained(experiment, [capable[k]], matrix[:, [k]]) for k in near]
    pairs, triples = (best_of(experiment, capable, matrix, n) for n in (2, 3))
    also, wider = _touched(every, capable, matrix)
    with_touched = best_of(experiment, also, wider, 2)
    tables = {
        "Three photographs": _photographs(experiment, planned),
        "What a tolerance does": _tolerances(single, change),
        "What can move what": _abilities(single, change),
        "One alone": _alone(alone),
        "All of a kind, by derivatives": _kinds(single, change[:, 0].T, missing),
        "Two, on a bench that stays as it is": _combinations(pairs),
        "Three, on a bench that stays as it is": _combinations(triples),
        "Two, on a bench that is touched between the photographs": _combinations(with_touched),
        "In images, as dev.py paper measures them": _checked(
            experiment, (triples[0], with_touched[0])
        ),
    }
    return Findings(tables, triples[0], with_touched[0])


def _touched(
    every: Sequence[Suspect], capable: Sequence[Suspect], matrix: Floats
) -> tuple[list[Suspect], Floats]:
    """The capable suspects and what may be touched, with its
    columns: those of the bench, in one photograph only.
    """
    column = {s.name: matrix[:, k] for k, s in enumerate(capable) if s.where == BENCH}
    others = [s for s in every if s.where in TOUCHED and s.name in column]
    more = [column[s.name] * (np.array(TOUCHED) == s.where) for s in others]
    return [*capable, *others], np.column_stack([matrix, *more])


def _three(numbers: Iterable[float], digits: int = 1) -> str:
    return ", ".join(f"{number:z.{digits}f}" for number in numbers)


def _photographs(experiment: Experiment, planned: Floats) -> Table:
    table = [["what is shown", *(f"{name}, px" for name in ("mean dx", "mean dy", "spread of dx"))]]
    ideal = experiment.moves(taken_for_ideal(experiment.planned))
    for name, moves in (("made for the mirror array", planned), ("made for an ideal plate", ideal)):
        table.append([name, *(_three(row) for row in summary(moves))])
    return [*table, ["the paper's photographs", _three(TARGET), "not given", "not given"]]


def _tolerances(some: Sequence[Suspect], change: Floats) -> Table:
    head = ["off", "by", "mean dx, px", "mean dy, px", "spread of dx, px", "what it can"]
    return [head] + [
        [s.title, f"{s.tolerance:g} {s.unit}", *(_three(row, 2) for row in found), ability(found)]
        for s, found in zip(some, change, strict=True)
    ]


def ability(found: Floats) -> str:
    """In words, what a suspect does to the means (3, 3) by a tolerance."""
    dx = found[0]
    dy = found[1]
    size = np.abs(dx).max()
    if size <= UNMOVED:
        return "dy only" if np.abs(dy).max() > UNMOVED else "nothing"
    if (np.sign(dx) == np.sign(dx[0])).all() and np.ptp(dx) < ALIKE * size:
        return "all alike"
    moved_ones = [
        name for name, value in zip(CONDITIONS, dx, strict=True) if abs(value) > ALIKE * size
    ]
    return " and ".join(moved_ones)


def _abilities(some: Sequence[Suspect], change: Floats) -> Table:
    """The suspects by what they can."""
    words = [ability(one) for one in change]
    table = [["moves", "off", "mean dx by a tolerance, px"]]
    for word in sorted(set(words), key=words.count):
        mine = [k for k, other in enumerate(words) if other == word]
        size = np.abs(change[mine, 0]).max(axis=1)
        table.append(
            [word, "; ".join(some[k].title for k in mine), f"{size.min():.2f} to {size.max():.2f}"]
        )
    return table


def _alone(found: Sequence[Explanation]) -> Table:
    table = [["off", "amount", "tolerances", "mean dx, px", "largest miss, px"]]
    for one in sorted(found, key=lambda one: one.miss):
        (suspect,), (amount,) = one.suspects, one.amounts
        row = [
            suspect.title,
            f"{amount * suspect.tolerance:.3g} {suspect.unit}".strip(),
            f"{abs(amount):.1f}",
        ]
        table.append([*row, _three(means(one.moves)), f"{one.miss:.1f}"])
    return table


def _kinds(some: Sequence[Suspect], matrix: Floats, missing: Floats) -> Table:
    """How large all amounts of some kinds together have to be, at least."""
    table = [["may be off", "suspects", "smallest size, tolerances", "largest of it"]]
    for kinds in KINDS:
        mine = [k for k, s in enumerate(some) if s.where in kinds]
        found = smallest(matrix[:, mine], missing)
        words = Explanation(tuple(some[k] for k in mine), found, np.empty(0)).words
        table.append([", ".join(kinds), str(len(mine)), f"{np.linalg.norm(found):.1f}", words])
    return table


def _combinations(found: Sequence[Explanation]) -> Table:
    head = [
        "off",
        "size, tolerances",
        "mean dx, px",
        "mean dy, px",
        "spread of dx, px",
        "largest miss, px",
    ]
    return [head] + [
        [
            one.words,
            f"{one.size:.1f}",
            *(_three(row) for row in summary(one.moves)),
            f"{one.miss:.2f}",
        ]
        for one in found[:SHOWN]
    ]


def _checked(experiment: Experiment, found: Sequence[Explanation]) -> Table:
    table = [["off", "re-traced: mean dx, px", "in images: mean dx, px", "dots"]]
    for one in found:
        seen = experiment.photographed(experiment.changed(one.suspects, one.amounts))
        n_seen = np.isfinite(seen[..., 0]).sum(axis=1)
        shift = np.nanmean(seen[..., 0], axis=1)
        table.append(
            [one.words, _three(means(one.moves)), _three(shift), ", ".join(map(str, n_seen))]
        )
    return table
