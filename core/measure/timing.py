"""Time and memory that work takes."""

import sys
from collections.abc import Callable, Generator
from statistics import median
from time import perf_counter
from typing import TypeVar

Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds that a call takes, and its result."""
    clock = perf_counter()
    result = work()
    return perf_counter() - clock, result


def median_seconds(work: Callable[[], object], runs: int) -> float:
    """Median of so many calls."""
    return median(timed(work)[0] for _ in range(runs))


def clocked(
    work: Generator[float, None, Result], spent: float, budget: float
) -> Generator[float, None, tuple[float, Result]]:
    """Seconds of the steps of long work, and its result.

    Yields how much of the budget (s) is spent, 0..1.
    """
    seconds = 0.0
    while True:
        clock = perf_counter()
        try:
            next(work)
        except StopIteration as done:
            return seconds + perf_counter() - clock, done.value
        seconds += perf_counter() - clock
        yield min((spent + seconds) / budget, 1.0)


def peak_memory() -> int | None:
    """Bytes that this process has held at most so far; None
    where the system does not tell (Windows).
    """
    try:
        import resource  # Unix only
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )
