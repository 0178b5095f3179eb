"""The table of `dev.py ablation` in Markdown."""

from __future__ import annotations

import ast
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from environments import ROOT

from .ablation_rows import ELSEWHERE, ROOMS, Row

GAIN = 0.1  # less than this, of the error or of CPU seconds, is no gain
ENOUGH = 3  # glasses on which a heuristic has to gain
N_GLASSES = 16

HEAD = """# Ablation

`python3 scripts/dev.py ablation` makes this file. Each heuristic and option is switched off, or set
to its neutral value, one at a time. The numbers are ratios: a solve without it to a solve with it,
on the same glass in the same run. Above 1 the heuristic gains. For each number the table has the
median and the largest ratio of the glasses measured. *Error* is the RMSE of the source image. Rows
of `glass` are judged by the surface that was meant, if it is known. *As seen* weights each display
pixel by its light. *Gains* counts the glasses on which error, error as seen or CPU seconds are
larger by {gain:.0%} without it. *Loses* counts those on which CPU seconds fall by {gain:.0%}.

A heuristic that gains on fewer than {enough} of {n} glasses goes, unless it protects rows of other
benches. Verdicts:

- **stays**: it gains on {enough} glasses or more, or the solver fails without it.
- **goes**: it can no longer gain on {enough} of {n} glasses.
- **goes so far**: it gains on none of {few} glasses or more. The other glasses may still save it.
- **protected**: it does not gain here. The rows that it protects decide.
- **open**: too few glasses are measured.

`docs/ablation.json` has the numbers of each glass, without the heuristic and with it: error, error
as seen, rays, CPU seconds, and both errors against the surface meant.
"""
FEW = 6
COLUMNS = (
    "switched off", "neutral value", "error x", "as seen x", "rays x", "CPU x",
    "gains", "loses", "protects", "verdict",
)  # fmt: skip


def table(rows: Sequence[Row], results: dict[str, dict[str, list]], machine: str) -> str:
    """All of `docs/ablation.md`."""
    text = [HEAD.format(gain=GAIN, enough=ENOUGH, n=N_GLASSES, few=FEW)]
    noise = _noise(results)
    if noise:
        text.append(f"{machine}, one thread of a busy machine: {noise}\n")
    for room in dict.fromkeys(row.room for row in rows):
        text.append(f"## {room}\n\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
        text += [line_of(row, results.get(row.name, {})) for row in rows if row.room == room]
        text.append("")
    text += _removed(rows, results)
    text.append("## Options without a row\n")
    text.append(
        "Batch sizes, rounding, scales without a neutral value, and other benches' options.\n"
    )
    text += list(_without_row(rows))
    return "\n".join(text) + "\n"


def line_of(row: Row, found: dict[str, list]) -> str:
    """The line of a row, by its numbers or fault on each glass."""
    ratios = judged(row, found)
    cells = [_spread([one[k] for one in ratios]) for k in range(4)]
    gains, loses = count_gains(ratios)
    n = len(ratios)
    counted = [f"{gains} of {n}", f"{loses} of {n}"] if n else ["", ""]
    columns = [row.name, row.why, *cells, *counted, row.protects, verdict_of(row, found)]
    return f"| {' | '.join(columns)} |"


def judged(row: Row, found: dict[str, list]) -> list[tuple[float, float, float, float]]:
    """The ratios on each glass that has a judge: a surface that changes is judged by the one that
    was meant alone.
    """
    return [
        ratios_of(*both)
        for both in found.values()
        if not isinstance(both, str)
        and not (row.is_fit and both[1][4] is None and both[0][:2] != both[1][:2])
    ]


def ratios_of(off: list, on: list) -> tuple[float, float, float, float]:
    """Error, error as seen, rays and CPU seconds without the heuristic, by those with it."""
    error, seen = (4, 5) if on[4] is not None else (0, 1)
    return tuple(off[k] / on[k] if on[k] else 1.0 for k in (error, seen, 2, 3))


def count_gains(ratios: Sequence[tuple[float, ...]]) -> tuple[int, int]:
    """On how many glasses a heuristic gains, and on how many it costs CPU seconds."""
    gains = sum(max(one[0], one[1], one[3]) >= 1 + GAIN for one in ratios)
    loses = sum(one[3] <= 1 - GAIN for one in ratios)
    return gains, loses


def verdict_of(row: Row, found: dict[str, list]) -> str:
    """What the numbers so far say of a row."""
    faults = [both for both in found.values() if isinstance(both, str)]
    if faults:
        return f"stays: {faults[0]}"
    if not found:
        return "numpy only, not measured" if row.by_numpy else "not measured"
    ratios = judged(row, found)
    gains, _ = count_gains(ratios)
    if gains >= ENOUGH:
        return "stays"
    is_hopeless = gains + N_GLASSES - len(ratios) < ENOUGH
    if is_hopeless or (gains == 0 and len(ratios) >= FEW):
        return "protected" if row.protects else "goes" if is_hopeless else "goes so far"
    return "open"


def _spread(values: Sequence[float]) -> str:
    """Median and largest of some ratios."""
    return f"{statistics.median(values):.2f} / {max(values):.2f}" if values else ""


def _noise(results: dict[str, dict[str, list]]) -> str:
    """How far CPU seconds of the solver as it is differ from one solve to the next."""
    by_glass: dict[str, list[float]] = {}
    for found in results.values():
        for glass, both in found.items():
            if not isinstance(both, str):
                by_glass.setdefault(glass, []).append(both[1][3])
    spreads = [
        statistics.pstdev(seconds) / statistics.mean(seconds)
        for seconds in by_glass.values()
        if len(seconds) > 2
    ]
    return (
        f"CPU seconds of one solve vary by {statistics.median(spreads):.0%} rms." if spreads else ""
    )


def _removed(rows: Sequence[Row], results: dict[str, dict[str, list]]) -> Iterator[str]:
    """The numbers on which heuristics were removed: of the results that have no row."""
    columns = "removed", *COLUMNS[2:8]
    yield f"## Removed\n\n| {' | '.join(columns)} |\n|{'---|' * len(columns)}"
    for name in sorted(set(results) - {row.name for row in rows}):
        ratios = [ratios_of(*both) for both in results[name].values() if not isinstance(both, str)]
        cells = [_spread([one[k] for one in ratios]) for k in range(4)]
        counted = [f"{n} of {len(ratios)}" for n in count_gains(ratios)]
        yield f"| {' | '.join([name, *cells, *counted])} |"
    yield ""


def _without_row(rows: Sequence[Row]) -> Iterator[str]:
    """The options of records that no row changes, by record; `bench` and `lab` in one line."""
    changed = {
        (change.target, name) for row in rows for change in row.changes for name in change.fields
    }
    yield "| record | options | measured by |\n|---|---|---|"
    n_bench = []
    for room in (*ROOMS, "bench", "lab"):
        for path in sorted((ROOT / "core" / room).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT / "core").with_suffix("").parts)
            for record, constant, fields in records_of(path):
                left = [name for name in fields if (f"{module}.{constant}", name) not in changed]
                if room in ("bench", "lab"):
                    n_bench.append(len(left))
                elif left:
                    judge = ELSEWHERE.get(f"{module}.{record}", "")
                    yield f"| `{module}.{record}` | {', '.join(left)} | {judge} |"
    records = f"{len(n_bench)} records of `bench` and `lab`"
    yield f"| {records} | {sum(n_bench)} options | {ELSEWHERE['bench']} |"


def records_of(path: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Option records of a file: class, constant, and fields that have a default."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    constants = {
        node.value.func.id: node.targets[0].id
        for node in body
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Call)
        and isinstance(node.value.func, ast.Name)
        and isinstance(node.targets[0], ast.Name)
    }
    for node in body:
        if isinstance(node, ast.ClassDef) and node.name in constants:
            fields = [
                one.target.id
                for one in node.body
                if isinstance(one, ast.AnnAssign) and one.value and isinstance(one.target, ast.Name)
            ]
            yield node.name, constants[node.name], fields
