"""Long work is a generator that yields its progress, 0..1, and returns its result.

Work deep within it yields how many rays were traced since, 0
where it only pauses, so that the work can be stopped.
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
    """Progress at a part, 0..1, of the way from start to stop: rounding never takes it further."""
    return min(start + (stop - start) * part, stop)


def subprogress(
    work: Generator[float, None, Result], start: float, stop: float
) -> Generator[float, None, Result]:
    """Hand on the progress of one part of the work, from start to stop of the whole."""
    while True:
        try:
            yield between(start, stop, next(work))
        except StopIteration as done:
            return done.value


def hold_progress(progress: float, work: Steps[Result]) -> Generator[float, None, Result]:
    """Hand on the pauses of a part of the work during which no progress is told."""
    while True:
        try:
            next(work)
            yield progress
        except StopIteration as done:
            return done.value
