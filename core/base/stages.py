"""The stages of a solve and their shares of its progress bar.

The shares are fixed: no work is timed, and none is estimated before it is done. A stage moves the
bar by the work that it can count.
"""

from itertools import accumulate, pairwise

from .steps import between

# Mean parts of the time on ball, cube, wine glass, bottle and text (`dev.py bench --stages`).
SHARES = {
    "plan": 0.19,
    "squares": 0.14,
    "borders": 0.28,
    "samples": 0.02,
    "spread": 0.05,
    "painting": 0.22,
    "coverage": 0.03,
    "measuring": 0.07,
}
MAP = "squares", "borders", "samples"
TRACING = "plan", *MAP, "spread"
AFTER = ("painting",), ("coverage",), ("measuring",)

Span = tuple[float, float]


def spans(*parts: tuple[str, ...]) -> list[Span]:
    """Start and end, 0..1, of each of some parts of a solve, which consist of stages."""
    ends = [0.0, *accumulate(sum(SHARES[stage] for stage in stages) for stages in parts)]
    return [(start / ends[-1], end / ends[-1]) for start, end in pairwise(ends)]


def section(span: Span, k: int, n: int) -> Span:
    """The section k of n equal ones of a span."""
    return between(*span, k / n), between(*span, (k + 1) / n)
