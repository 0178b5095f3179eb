"""Long work as generators, which yield progress and return their result.

Outer work yields progress, 0..1. Inner work (`Steps`) yields the number of rays traced since its
last yield; 0 is a pause at which the work can be stopped.
"""

from collections.abc import Generator
from typing import TypeVar

Result = TypeVar("Result")
Steps = Generator[int, None, Result]


def run_steps(steps: Generator[object, None, Result]) -> Result:
    """Run long work, such as a solve, to its end and return its result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def between(start: float, stop: float, part: float) -> float:
    """Interpolate progress from start to stop at a fraction `part`, 0..1; rounding never exceeds
    `stop`.
    """
    return min(start + (stop - start) * part, stop)


def subprogress(
    work: Generator[float, None, Result], start: float, stop: float
) -> Generator[float, None, Result]:
    """Yield the progress of one part of the work, scaled to start..stop of the whole."""
    while True:
        try:
            yield between(start, stop, next(work))
        except StopIteration as done:
            return done.value


def hold_progress(progress: float, work: Steps[Result]) -> Generator[float, None, Result]:
    """Yield a constant progress at each pause of a part of the work."""
    while True:
        try:
            next(work)
            yield progress
        except StopIteration as done:
            return done.value
