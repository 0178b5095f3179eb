"""What helps where some of a picture is lost."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.numbers import millimetres
from kiriko.core.base.steps import run_steps
from kiriko.core.bench import measured_remedies
from kiriko.core.bench.measured_remedies import Help, find_remedies
from kiriko.core.bench.part_sizes import Fitted, fit_plate
from kiriko.core.bench.picture_light import outline_of
from kiriko.core.rig.rig import ConstantIndex, Glass
from known.proposed_rigs import plan_of, rig_around
from known.reference_rigs import box

SLAB = Glass("slab", box((0.1, 0.02, 0.1)), ConstantIndex(1.0))


def test_each_remedy_is_told_with_its_amount() -> None:
    """A display too small by 5 mm: it may be 5 mm larger, the picture smaller by as much; no place
    is better than the middle.
    """
    found = run_steps(find_remedies(rig_around(SLAB, picture=0.025, display=0.02), plan_of()))
    assert found.share == pytest.approx((0.02 / 0.025) ** 2, abs=0.04)  # 32 rays
    assert list(found.lost) == ["missed the display"]
    assert {help.operator for help in found.helps} == {
        "kiriko.fit_display",
        "kiriko.fit_picture_size",
    }
    assert all(help.after > 0.999 for help in found.helps)
    words = {str(help.sentence(millimetres)) for help in found.helps}
    assert words == {"make the display 5.3 mm larger", "make the picture 20 mm wide"}


def test_a_plate_that_is_too_small_is_named() -> None:
    """With the amount that its own button gives it; a picture beside the display may move, too."""
    rig = rig_around(SLAB, picture=0.02, display=0.03, plate=0.02)
    found = run_steps(find_remedies(rig, plan_of()))
    fitted = run_steps(fit_plate(rig, plan_of()))
    help = next(help for help in found.helps if help.operator == "kiriko.fit_plate")
    assert help.amount == pytest.approx(fitted.more, rel=1e-2)

    rig = rig_around(SLAB, picture=0.02, display=0.03)
    plane = outline_of(rig.picture_place.mesh, np.array([1.0, 0, 0]), "It")
    moved = plane.changed(rig.picture_place.mesh, 1.0, np.array([0.009, 0, 0]))
    rig = replace(rig, pictures=(replace(rig.picture_place, mesh=moved),))
    found = run_steps(find_remedies(rig, plan_of()))
    assert "kiriko.best_place" in {help.operator for help in found.helps}
    help = next(help for help in found.helps if help.operator == "kiriko.best_place")
    assert help.sentence(millimetres) == "move it"


@pytest.mark.parametrize(("gain", "is_told"), [(0.05, False), (0.9, True)])
def test_no_part_grows_without_end_for_little(
    monkeypatch: pytest.MonkeyPatch, gain: float, is_told: bool
) -> None:
    """A plate four times as large is told where it brings back most of what missed it, and not for
    a twentieth, as of glass that scatters; one that is a little larger is, for any gain.
    """

    def fitted(size: float) -> Fitted:
        share = run_steps(find_remedies(rig, plan_of())).share
        return Fitted(size, size * 0.02, np.zeros(3), share, share + gain * (1 - share), {})

    rig = rig_around(SLAB, picture=0.02, display=0.03, plate=0.02)
    for size, is_expected in ((4.0, is_told), (1.5, True)):
        found = fitted(size)

        def fit(*_: object, found: Fitted = found) -> Iterator[float]:
            yield 0.5
            return found

        with monkeypatch.context() as patched:
            patched.setattr(measured_remedies, "fit_plate", fit)
            told = {help.operator for help in run_steps(find_remedies(rig, plan_of())).helps}
        assert ("kiriko.fit_plate" in told) == is_expected


def test_where_all_arrives_nothing_is_told() -> None:
    """No remedy for a picture that is whole."""
    found = run_steps(find_remedies(rig_around(SLAB, picture=0.02, display=0.03), plan_of()))
    assert (found.share, found.lost, found.helps) == (1.0, {}, ())


def test_a_remedy_that_leaves_some_lost_says_how_much_arrives() -> None:
    """A picture that a plate of any size serves in part alone."""
    told = Help("kiriko.fit_plate", 0.02, 0.98).sentence(millimetres)
    assert told == "make the plate 20 mm larger (98 % arrives)"


def test_it_takes_no_longer_than_it_may() -> None:
    """The seconds are over before the first remedy, and it says so."""
    found = run_steps(
        find_remedies(rig_around(SLAB, picture=0.025, display=0.02), plan_of(), seconds=0.0)
    )
    assert (found.helps, found.is_whole) == ((), False)
    assert "missed the display" in found.lost
