"""Stiff and extreme cases, each against something independent: right, or refused with a reason.

`python3 scripts/dev.py extremes [--only NAME ...] [--quick] [--markdown]`.

Exits with 1 when an expectation does not hold. `--quick` is what
the tests run: fewer triangles, pixels, reflections.
"""

import argparse
import contextlib
import sys
from collections.abc import Iterator
from time import process_time

from kiriko.core.base.errors import KirikoError
from known.extremes import bench as extreme_bench  # noqa: F401 - puts its cases among the others
from known.extremes import cases as extreme_cases
from known.extremes import light as extreme_light  # noqa: F401 - likewise
from known.extremes.cases import GROUPS, LIMIT, REFUSED, WRONG, Case, Row

# without Blender, as in the tests of core, its scenes are left out
with contextlib.suppress(ModuleNotFoundError):
    from known.extremes import scenes as extreme_scenes  # noqa: F401 - likewise

CASES = sorted(extreme_cases.CASES, key=lambda case: GROUPS.index(case.group))
HEADING = f"| case | measured | error | bound | s | verdict |\n|{'---|' * 6}"


def run(cases: list[Case], quick: bool) -> Iterator[tuple[Case, Row, float]]:
    """Rows of cases, one after the other, with the seconds of processor time each took."""
    for case in cases:
        started = process_time()
        try:
            for row in case.rows(quick):
                now = process_time()
                yield case, row, now - started
                started = process_time()
        except KirikoError as error:
            yield (
                case,
                Row(f'refused: "{error}"', float("inf"), "", 0.0, REFUSED),
                process_time() - started,
            )


def columns(row: Row, seconds: float) -> tuple[str, str, str, str]:
    """Error and bound with their unit, seconds, verdict."""
    is_number = row.kept != REFUSED
    error, bound = (
        f"{value:.2g} {row.unit}".strip() if is_number else "" for value in (row.error, row.bound)
    )
    return error, bound, f"{seconds:.2f}", row.verdict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only",
        nargs="+",
        default=[""],
        metavar="NAME",
        help="cases and groups with this in a name",
    )
    parser.add_argument("--quick", action="store_true", help="as small as in the tests")
    parser.add_argument("--markdown", action="store_true", help="as the tables in docs/measured.md")
    arguments = parser.parse_args()
    chosen = [c for c in CASES if any(word in f"{c.group}: {c.name}" for word in arguments.only)]
    if not chosen:
        parser.error(f"no case has a name with {' or '.join(arguments.only)}")
    counts: dict[str, int] = {}
    avoid: dict[str, str] = {}
    last, group = "", ""

    for case, row, seconds in run(chosen, arguments.quick):
        counts[row.verdict] = counts.get(row.verdict, 0) + 1
        if row.verdict == LIMIT:
            avoid.setdefault(row.avoid, case.name)
        if arguments.markdown:
            if case.group != group:
                print(f"\n### {case.group.capitalize()}\n\n{HEADING}")
            name = case.name if case.name != last else ""
            print(f"| {' | '.join((name, row.measured, *columns(row, seconds)))} |", flush=True)
        else:
            if case.name != last:
                print(f"{case.group}: {case.name}")
            error, bound, time, verdict = columns(row, seconds)
            print(
                f"  {row.measured:<96} {error:>14} {bound:>14} {time:>7} s  {verdict}", flush=True
            )
        last, group = case.name, case.group

    print("\n" + ", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    if avoid:
        print("\n### What to avoid\n" if arguments.markdown else "what to avoid:")
        for sentence, name in avoid.items():
            print(f"- {name}: {sentence}")

    sys.exit(WRONG in counts)


if __name__ == "__main__":
    main()
