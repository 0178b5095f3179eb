"""The extreme cases of `dev.py extremes` at small size, each within its own bound."""

import sys
from dataclasses import replace

import pytest

from bench import extremes, runner
from known.extremes.cases import (
    LIMIT,
    REFUSED,
    WRONG,
    Case,
    exact,
    limit,
    refused,
    slab_rig,
    within,
)


@pytest.mark.parametrize("case", extremes.CASES, ids=lambda case: f"{case.group}: {case.name}")
def test_extreme_case(case):
    """Right within its bound, or refused with the reason.

    And every known limit names the case to avoid.
    """
    rows = list(case.rows(True))
    assert rows
    assert [row for row in rows if row.verdict == WRONG] == []
    assert all(row.avoid for row in rows if row.verdict == LIMIT)


def test_what_is_off_is_wrong():
    """Above its bound, no number, not told or not refused: no such row passes."""
    good = slab_rig(pixels=16, display_pixels=16)
    for row in (
        within("", 2.0, 1.0),
        exact("", float("nan")),
        limit("", 0.0, 1.0, "px", "it", told=False),
    ):
        assert row.verdict == WRONG
    assert refused(good, "dark").verdict == WRONG
    assert refused(slab_rig(pixels=16, display=1e-9), "no ray reaches the plate").verdict == WRONG
    assert (
        refused(slab_rig(pixels=16, display=1e-9), "no ray reaches the display").verdict == REFUSED
    )


@pytest.mark.parametrize(("error", "code"), [(2.0, True), (0.5, False)], ids=["wrong", "right"])
def test_the_command_fails_when_an_expectation_does(error, code, monkeypatch, capsys):
    """Exit code 1 and the word WRONG for a row off its bound, 0 without one."""
    case = Case("group", "name", lambda quick: iter([within("it", error, 1.0)]))
    monkeypatch.setattr(sys, "argv", ["extremes.py"])
    with pytest.raises(SystemExit) as ended:
        runner.run(
            "",
            "",
            replace(extremes.BENCH, cases={"it": case}),
            runner.option("--quick", default=True),
        )
    assert bool(ended.value.code) == code
    assert (WRONG in capsys.readouterr().out) == code
