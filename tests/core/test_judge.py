"""Core held to mpmath at fifty digits, on random cases with hard
ones among them: `dev.py extremes` takes 1e5 of each.

The marks: 1e-12 where k > 1e-6, 4 eps / sqrt k below, and
never the wrong class where it can be known.
"""

import numpy as np
import pytest

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass
from kiriko.core.rig.settings import Settings
from known.judges import (
    JUDGES,
    judge_arrays,
    judge_balls,
    judge_landings,
    judge_prisms,
    judge_refraction,
    judge_stacks,
    refraction,
)
from known.judges.light import OUT_OF_THE_WAY
from known.judges.prisms import Prism
from known.judges.verdicts import EXACT
from known.reference_rigs import rig

CASES = {
    judge_refraction: 3000,
    judge_balls: 1500,
    judge_stacks: 2000,
    judge_landings: 800,
    judge_prisms: 1000,
    judge_arrays: 1200,
}


def test_nothing_is_left_out():
    """Each judge is asked."""
    assert set(CASES) == set(JUDGES)


@pytest.mark.parametrize("ask", CASES, ids=lambda ask: ask.__name__)
def test_the_marks_are_kept(ask):
    """Every case is within its mark and of the right class."""
    for verdict in ask(CASES[ask], seed=1):
        assert verdict.n_cases > 0.7 * CASES[ask]
        assert verdict.error < EXACT
        assert verdict.is_kept, (
            f"{verdict.what}: {verdict.part:.3g} of the mark, {verdict.n_wrong} wrong:"
            f" {verdict.where}"
        )


def rounded(directions, normals, n1, n2):
    """Refraction by the ratio of the indices alone, as it
    was: right for the ratio, not for the indices.
    """
    return core_refract(directions, normals, n1 / n2, np.ones(len(n1)))


def cancelling(directions, normals, n1, n2):
    """Refraction by the form that subtracts near-equal numbers, 1 - eta^2 (1 - c^2)."""
    eta = n1 / n2
    c = -(directions * normals).sum(axis=1)
    k = 1 - eta**2 * (1 - c**2)
    root = np.sqrt(np.where(k < 0, np.nan, k))
    return eta[:, None] * directions + (eta * c - root)[:, None] * normals, k < 0, np.ones(len(k))


core_refract = refraction.refract


@pytest.mark.parametrize("other", [rounded, cancelling])
def test_the_judge_tells_a_worse_refraction(other, monkeypatch):
    """Forms that lose digits near the critical angle of
    near-equal indices are found out, by the class of light.
    """
    monkeypatch.setattr(refraction, "refract", other)
    verdict = judge_refraction(2000)[0]
    assert verdict.n_wrong > 0
    assert not verdict.is_kept


def test_light_that_leaves_close_to_an_edge_does_not_enter_again():
    """4 nm and 0.1 nm beside the edge of a prism light goes in by
    one face and out by the other, and meets no more.

    Within a hundredth of that, faces are wider than drawn, so that no ray is lost between them.
    """
    half = 0.03
    at = half * np.array([[-1, -1], [1, -1], [-1, 1]])
    glass = Glass("prism", Prism(at, 0.1, 1.0).mesh, ConstantIndex(0.6))
    plan = compile_plan(rig((glass,), **OUT_OF_THE_WAY), Settings())
    d = np.array([[0.1, 1.0, 0.0]]) / np.sqrt(1.01)
    for beside, met in ((4e-9, True), (1e-10, True), (-4e-9, False), (-1e-10, False)):
        landings = trace_all(plan, np.array([[half - beside, -half, 0.0]]) - 0.5 * d, d)
        assert landings.n_events.tolist() == [2 if met else 0]
        assert landings.reason.tolist() == [Reason.MISSED_PLATE if met else Reason.MISSED_GLASS]
