"""Percentages, errors and shares as text, the same in every sentence, label and report."""

from .messages import Message, as_message
from .numbers import number

NO_PLATE = Message("Without a plate, the display")  # start of a sentence


def percent(share: float) -> str:
    """A share, 0..1, as a percentage.

    A share above 0 never reads as 0 %, and one below 1 never as 100 %.
    """
    value = 100 * round(share, 6)  # less is rounding error
    for digits in (0, 1, 2):
        text = f"{value:.{digits}f}"
        if not ((float(text) == 0 and value > 0) or (float(text) == 100 and value < 100)):
            return f"{text} %"
    return Message("under 0.01 %") if value < 50 else Message("over 99.99 %")


def pixels(error: float) -> Message:
    """An error in pixels as text."""
    if error < 1e-3:
        return Message("under 0.001 px")
    return Message("about {number} px", number=number(error))


def arcmin(angle: float) -> Message:
    """An angle in minutes of arc as text."""
    return Message("{angle} arcmin", angle=number(angle))


def shares_in_words(misses: dict[str, float]) -> list[Message]:
    """Shares with their reasons, largest first."""
    by_size = sorted(misses.items(), key=lambda miss: -miss[1])
    return [
        Message("{share} {reason}", share=percent(share), reason=as_message(word))
        for word, share in by_size
        if round(share, 6) > 0
    ]


def listed(misses: dict[str, float]) -> Message:
    """Shares by reason, largest first, as one list of clauses."""
    clauses = shares_in_words(misses)
    whole = clauses[0] if clauses else as_message("")
    for clause in clauses[1:]:
        whole = Message("{clauses}, {clause}", clauses=whole, clause=clause)
    return whole


def summary(
    coverage: float, misses: dict[str, float], display: str = Message("The display")
) -> Message:
    """One sentence on how much of the picture the viewer sees on a display, and why the rest is
    lost.
    """
    share, lost = percent(coverage), listed(misses)
    if not lost:
        return Message("{display} shows {share} of the picture.", display=display, share=share)
    return Message(
        "{display} shows {share} of the picture; {lost}.", display=display, share=share, lost=lost
    )
