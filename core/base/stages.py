"""The stages of a solve and their shares of its progress bar.

The shares are fixed. Within a stage, the bar follows the work counted.
"""

from itertools import accumulate, pairwise

from .steps import between

# Mean time fractions on ball, cube, wine glass, bottle and text (`dev.py bench --stages`).
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
    """Start and end, 0..1, of parts of a solve, each a group of stages."""
    ends = [0.0, *accumulate(sum(SHARES[stage] for stage in stages) for stages in parts)]
    return [(start / ends[-1], end / ends[-1]) for start, end in pairwise(ends)]


def section(span: Span, k: int, n: int) -> Span:
    """Section k of n equal sections of a span."""
    return between(*span, k / n), between(*span, (k + 1) / n)
