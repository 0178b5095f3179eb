"""The table of `dev.py ablation` in Markdown."""

from __future__ import annotations

import ast
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from environments import ROOT

from .ablation_rows import ELSEWHERE, ROOMS, Row

GAIN = 0.1  # a smaller change of the error or of CPU seconds is no gain
ENOUGH = 3  # glasses on which a heuristic has to gain
N_GLASSES = 16

HEAD = """# Ablation

`python3 scripts/dev.py ablation` switches off one heuristic or option at a time and solves the
sixteen glasses. Each number is the value without the heuristic divided by the value with it, as
median / largest over the glasses measured: above 1, the heuristic helps. *Error* is the RMSE of the
source image, in the rows of `glass` against the intended surface. *As seen* weights display pixels
by their light. *Gains* counts glasses on which error, error as seen or CPU seconds are {gain:.0%}
larger without it.

A heuristic that helps on fewer than {enough} of {n} glasses is removed, unless results of other
benches depend on it. Its verdict is **open** until enough glasses are measured, and **goes so far**
(to be removed, as far as measured) if it helps on none of {few} or more.

`scripts/bench/ablation_rows.py` has the neutral values and the protected rows, `docs/ablation.json`
the numbers of each glass. `--table` prints the options without a row.
"""
FEW = 6
COLUMNS = "switched off", "error", "as seen", "CPU", "gains", "verdict"


def table(rows: Sequence[Row], results: dict[str, dict[str, list]], machine: str) -> str:
    """The text of `docs/ablation.md`."""
    text = [HEAD.format(gain=GAIN, enough=ENOUGH, n=N_GLASSES, few=FEW)]
    noise = _noise(results)
    if noise:
        text.append(f"{machine}, one thread of a busy machine: {noise}\n")
    for room in dict.fromkeys(row.room for row in rows):
        text.append(f"## {room}\n\n{_head(COLUMNS)}")
        text += [line_of(row, results.get(row.name, {})) for row in rows if row.room == room]
        text.append("")
    text += _removed(rows, results)
    return "\n".join(text)


def _head(columns: Sequence[str]) -> str:
    """The first two lines of a table."""
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"


def line_of(row: Row, found: dict[str, list]) -> str:
    """The line of a row, by its numbers or fault on each glass."""
    ratios = judged(row, found)
    return f"| {' | '.join([row.name, *_cells(ratios), verdict_of(row, found)])} |"


def _cells(ratios: Sequence[tuple[float, ...]]) -> list[str]:
    """Error, error as seen, CPU seconds and gains, over all glasses."""
    gains, _ = count_gains(ratios)
    spreads = [_spread([one[k] for one in ratios]) for k in (0, 1, 3)]
    return [*spreads, f"{gains} of {len(ratios)}" if ratios else ""]


def judged(row: Row, found: dict[str, list]) -> list[tuple[float, float, float, float]]:
    """The ratios on each glass with a judge. A changed surface is judged only by the intended
    surface.
    """
    return [
        ratios_of(*both)
        for both in found.values()
        if not isinstance(both, str)
        and not (row.is_fit and both[1][4] is None and both[0][:2] != both[1][:2])
    ]


def ratios_of(off: list, on: list) -> tuple[float, float, float, float]:
    """Ratios without and with the heuristic: error, error as seen, rays and CPU seconds."""
    error, seen = (4, 5) if on[4] is not None else (0, 1)
    return tuple(off[k] / on[k] if on[k] else 1.0 for k in (error, seen, 2, 3))


def count_gains(ratios: Sequence[tuple[float, ...]]) -> tuple[int, int]:
    """On how many glasses a heuristic gains, and on how many it costs CPU seconds."""
    gains = sum(max(one[0], one[1], one[3]) >= 1 + GAIN for one in ratios)
    loses = sum(one[3] <= 1 - GAIN for one in ratios)
    return gains, loses


def verdict_of(row: Row, found: dict[str, list]) -> str:
    """The verdict on a row from the numbers so far."""
    faults = [both for both in found.values() if isinstance(both, str)]
    if faults:
        return f"stays: {faults[0]}"
    if not found:
        return "by numpy: not measured" if row.by_numpy else "not measured"
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
    """Lines of removed heuristics: results without a row."""
    yield f"## Removed\n\n{_head(('removed', *COLUMNS[1:5]))}"
    for name in sorted(set(results) - {row.name for row in rows}):
        ratios = [ratios_of(*both) for both in results[name].values() if not isinstance(both, str)]
        yield f"| {' | '.join([name, *_cells(ratios)])} |"
    yield ""


def without_row(rows: Sequence[Row]) -> Iterator[str]:
    """Lines of options without a row, by record; `bench` and `lab` in one line."""
    changed = {
        (change.target, name) for row in rows for change in row.changes for name in change.fields
    }
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
                    yield f"{module}.{record}: {', '.join(left)}" + (f" ({judge})" if judge else "")
    yield f"bench and lab: {len(n_bench)} records, {sum(n_bench)} options ({ELSEWHERE['bench']})"


def records_of(path: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Option records of a file: class, constant, and fields with a default."""
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
