"""Common parts of all benches: options, processes, timing in turns, a table, and the exit code.

A bench is data: a `Bench` has cases by name, the columns of its table, and a function that measures
one case. A module may have several tables; the option with a table's name chooses it.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from environments import as_module, machine, quiet
from kiriko.core.native import loading

Row = dict[str, Any]
MISSED = "MISSED"  # a row with this value in it, or WRONG, ends the bench with 1


@dataclass(frozen=True)
class Bench:
    """A table.

    cases : by name, whatever `measure` needs of one
    columns : the format of each number of a row, by the column's head; empty: words
    measure : the rows of a case, by its name, the case and the options
    is_apart : measure each case in a process of its own
    mean : name of a last row with the means, or nothing
    """

    cases: Mapping[str, Any]
    columns: Mapping[str, str]
    measure: Callable[[str, Any, argparse.Namespace], Iterable[Row]]
    is_apart: bool = False
    mean: str = ""


def option(*names: str, **more: Any) -> tuple[tuple[str, ...], dict[str, Any]]:
    """A further option of a bench, as `add_argument` takes it."""
    return names, more


def run(about: str, module: str, main: Bench, *options: tuple, **tables: Bench) -> None:
    """Read the options, measure, print, and leave with 1 where a mark is missed."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", "--glass", nargs="+", default=[], metavar="NAME", help="cases of these names"
    )
    parser.add_argument("--rounds", type=int, default=1, help="of each; medians are shown")
    parser.add_argument("--threads", type=int, default=0, help="of the kernel; 0: all")
    parser.add_argument("--numpy", action="store_true", help="without the compiled kernel")
    parser.add_argument("--json", action="store_true", help="a line of JSON for each row")
    parser.add_argument("--markdown", action="store_true", help="as the tables in docs/")
    for name in tables:
        parser.add_argument(
            f"--{name.replace('_', '-')}", action="store_true", help="this table instead"
        )
    for names, more in options:
        parser.add_argument(*names, **more)
    arguments = parser.parse_args()

    bench = next((table for name, table in tables.items() if getattr(arguments, name)), main)
    names = chosen(bench.cases, arguments.only)
    if not names:
        parser.error(f"no case is called so: there are {', '.join(bench.cases)}")
    loading.use_threads(arguments.threads)
    with loading.off() if arguments.numpy else nullcontext():
        rows = measured(bench, module, names, arguments)
        shown = print_json(rows) if arguments.json else print_table(bench, rows, arguments.markdown)
    sys.exit(is_missed(shown))


def is_missed(rows: Iterable[Row]) -> bool:
    """Whether a row says that a mark is missed, or that something is wrong."""
    return any({MISSED, "WRONG"} & {*map(str, row.values())} for row in rows)


def chosen(cases: Mapping[str, Any], words: list[str]) -> list[str]:
    """The cases of these names, or cases with one of these words in their names."""
    exact = [name for word in words for name in cases if name == word]
    return exact or [name for name in cases if all(word in name for word in words)]


def measured(
    bench: Bench, module: str, names: list[str], arguments: argparse.Namespace
) -> Iterator[Row]:
    """The rows of some cases."""
    for name in names:
        if bench.is_apart and len(names) > 1:
            command = [sys.executable, *as_module(module), *sys.argv[1:], "--json", "--only", name]
            answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
            rows = [json.loads(line) for line in answer.stdout.splitlines() if line[:1] == "{"]
            if answer.returncode and not is_missed(rows):
                sys.exit(answer.returncode)
            yield from rows
        else:
            with quiet():
                rows = list(bench.measure(name, bench.cases[name], arguments))
            yield from ({"case": name, **row} for row in rows)


def print_json(rows: Iterable[Row]) -> list[Row]:
    """Print a line for each row; all of them."""
    shown = []
    for row in rows:
        shown.append(row)
        print(json.dumps(row, default=float), flush=True)
    return shown


def print_table(bench: Bench, rows: Iterable[Row], in_markdown: bool) -> list[Row]:
    """Print the rows under their heads; all of them."""
    first = max(map(len, [*bench.cases, bench.mean])) + 2

    def show(row: Row) -> None:
        cells = {head: written(row.get(head), form) for head, form in bench.columns.items()}
        if in_markdown:
            print(f"| {' | '.join([row['case'], *cells.values()])} |", flush=True)
            return
        line = "".join(
            f"{cell:>{max(len(head), 7) + 2}}" if bench.columns[head] else f"  {cell:<36}"
            for head, cell in cells.items()
        )
        print(f"{row['case']:{first}}{line}".rstrip(), flush=True)

    print(f"{machine()}.\n")
    show({"case": "", **{head: head for head in bench.columns}})
    if in_markdown:
        print("|" + "---|" * (1 + len(bench.columns)))
    shown = []
    for row in rows:
        shown.append(row)
        show(row)
    if bench.mean and shown:
        show({"case": bench.mean, **means(shown)})
    return shown


def written(value: Any, form: str) -> str:
    """A cell: text unchanged, empty for None."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return value if isinstance(value, str) else f"{value:{form}}"


def proof(what: str, found: str, is_kept: bool) -> Row:
    """A row with a verdict, right or wrong."""
    return {"what": what, "found": found, "kept": "yes" if is_kept else MISSED}


def means(rows: list[Row]) -> Row:
    """The mean of each number."""
    numbers = [head for head, value in rows[0].items() if isinstance(value, (int, float))]
    return {head: statistics.fmean(row[head] for row in rows) for head in numbers}


def in_turns(
    works: Mapping[str, Callable[[], Any]], rounds: int, clock: Callable[[], float] = perf_counter
) -> tuple[dict[str, float], dict[str, Any]]:
    """Median seconds of functions run in turns, and the last result of each."""
    seconds: dict[str, list[float]] = {name: [] for name in works}
    made = {}
    for _ in range(rounds):
        for name, work in works.items():
            started = clock()
            made[name] = work()
            seconds[name].append(clock() - started)
    return {name: statistics.median(times) for name, times in seconds.items()}, made
