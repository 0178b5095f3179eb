"""Tables of explanations: which errors of a bench would make the paper's displacements.

Part of `dev.py misalignment`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.bench.offset import Parameter
from kiriko.core.rig.rig import Rig

from .experiment import Experiment
from .explanations import (
    FARTHEST,
    SHOWN,
    TARGET,
    Explanation,
    best_of,
    columns,
    explained,
    means,
    smallest,
    summary,
)
from .suspects import (
    BENCH,
    CONDITIONS,
    MEASUREMENT,
    PART,
    PROGRAM,
    PUBLISHED,
    TOUCHED,
    Suspect,
    suspects,
    taken_for_ideal,
)
from .tables import Table

UNMOVED = 0.1  # px for a tolerance: less is nothing
# of the largest: conditions whose dx differ by less move alike, and one that moves by less stays
ALIKE = 0.1
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
