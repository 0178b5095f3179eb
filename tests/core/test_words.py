import pytest

from kiriko.core.base.numbers import millimetres, number
from kiriko.core.base.words import percent, pixels, summary


@pytest.mark.parametrize(
    ("share", "text"),
    [
        *((0.0, "0 %"), (1.0, "100 %"), (1e-9, "0 %"), (1 - 1e-9, "100 %"), (0.5, "50 %")),
        *(
            (0.004, "0.4 %"),
            (0.9996, "99.96 %"),
            (1e-5, "under 0.01 %"),
            (1 - 1e-5, "over 99.99 %"),
        ),
    ],
)
def test_a_share_reads_as_nothing_or_all_only_when_it_is(share: float, text: str) -> None:
    """0 % and 100 % are exact to rounding; a share close to them gets more digits."""
    assert percent(share) == text


def test_summary_names_the_losses_largest_first() -> None:
    """One sentence: the share that is shown, then the lost one and why."""
    text = summary(0.9, {"blocked": 0.02, "missed the plate": 0.08, "lost inside the glass": 0.0})
    assert text == "The display shows 90 % of the picture; 8 % missed the plate, 2 % blocked."


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.25e-5, "0.000013"),
        (0.0312, "0.031"),
        (1.0, "1"),
        (2.449, "2.4"),
        (137.0, "140"),
        (2.2e4, "22000"),
    ],
)
def test_numbers_have_two_digits_and_no_exponent(value: float, text: str) -> None:
    """However small or large."""
    assert number(value) == text
    assert pixels(max(value, 1.0)) == f"about {number(max(value, 1.0))} px"
    assert millimetres(1e-3 * value) == f"{text} mm"
