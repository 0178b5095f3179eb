"""Stiff and extreme cases, each against something independent: right, or refused with a reason.

`python3 scripts/dev.py extremes`; tests run `--quick`, with fewer triangles, pixels and
reflections. `avoid`: how to avoid the case of a known limit.
"""

import argparse
import contextlib
from collections.abc import Iterator
from time import process_time

from kiriko.core.base.errors import KirikoError
from known.extremes import bench as extreme_bench  # noqa: F401 - puts its cases among the others
from known.extremes import cases as extreme_cases
from known.extremes import light as extreme_light  # noqa: F401 - likewise
from known.extremes.cases import GROUPS, REFUSED, Case
from known.extremes.cases import Row as Found

from . import runner

# without Blender, as in the tests of core, its scenes are left out
with contextlib.suppress(ModuleNotFoundError):
    from known.extremes import scenes as extreme_scenes  # noqa: F401 - likewise

CASES = sorted(extreme_cases.CASES, key=lambda case: GROUPS.index(case.group))


def measure(_: str, case: Case, arguments: argparse.Namespace) -> Iterator[runner.Row]:
    """The rows of a case, with the seconds of processor time each took."""
    started = process_time()
    try:
        for found in case.rows(arguments.quick):
            yield row_of(found, process_time() - started)
            started = process_time()
    except KirikoError as error:
        found = Found(f'refused: "{error}"', float("inf"), "", 0.0, REFUSED)
        yield row_of(found, process_time() - started)


def row_of(found: Found, seconds: float) -> runner.Row:
    """Error and bound with their unit, seconds, verdict."""
    row = {"measured": found.measured, "verdict": found.verdict, "avoid": found.avoid, "s": seconds}
    if found.kept != REFUSED:
        numbers = {"error": found.error, "bound": found.bound}
        row |= {name: f"{value:.2g} {found.unit}".strip() for name, value in numbers.items()}
    return row


BENCH = runner.Bench(
    {f"{case.group}: {case.name}": case for case in CASES},
    {"error": ">14", "bound": ">14", "s": ".2f", "verdict": "", "measured": "", "avoid": ""},
    measure,
)

if __name__ == "__main__":
    quick = runner.option("--quick", action="store_true", help="as small as in the tests")
    runner.run(__doc__, "bench.extremes", BENCH, quick)
