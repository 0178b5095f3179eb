"""Numbers as people read them, the same in every sentence, label and report."""

import numpy as np

NO_PLATE = "The display, seen with no plate in between,"  # the beginning of a sentence


def number(value: float) -> str:
    """A number of two digits, never with an exponent."""
    return np.format_float_positional(float(f"{value:.2g}"), trim="-")


def percent(share: float) -> str:
    """A share as people read it.

    A share above nothing does not read as nothing, nor one below all as all.
    """
    value = 100 * round(share, 6)  # less is rounding, not light
    for digits in (0, 1, 2):
        text = f"{value:.{digits}f}"
        if not ((float(text) == 0 and value > 0) or (float(text) == 100 and value < 100)):
            return f"{text} %"
    return "under 0.01 %" if value < 50 else "over 99.99 %"


def pixels(error: float) -> str:
    """An error in pixels as people read it."""
    return f"about {number(error)} px" if error >= 1e-3 else "under 0.001 px"


def millimetres(length: float) -> str:
    """A length, m, where no scene says which unit its people read."""
    return f"{number(1e3 * length)} mm"


def shares_in_words(misses: dict[str, float]) -> list[str]:
    """Shares with their reasons, the largest first."""
    by_size = sorted(misses.items(), key=lambda miss: -miss[1])
    return [f"{percent(share)} {word}" for word, share in by_size if round(share, 6) > 0]


def listed(misses: dict[str, float]) -> str:
    """Shares by reason, the largest first."""
    return ", ".join(shares_in_words(misses))


def summary(coverage: float, misses: dict[str, float], display: str = "The display") -> str:
    """One sentence on how much of the picture the viewer gets
    to see of a display, and on the fate of the rest.
    """
    lost = listed(misses)
    return (
        f"{display} shows {percent(coverage)} of the picture" + (f"; {lost}" if lost else "") + "."
    )
