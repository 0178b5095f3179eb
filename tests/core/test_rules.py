"""Leaving out parts that a scene does not need changes landings by rounding at most."""

import numpy as np
import pytest

from kiriko.core.light.trace import trace_all
from known.rules import RULES


@pytest.mark.parametrize("name", RULES)
def test_a_rule_changes_nothing_but_rounding(name):
    """The same reasons and branches for all rays, and landings within 1e-9 of the display."""
    rule = RULES[name]
    a_rig = rule.rig()
    w = a_rig.viewer.width
    h = a_rig.viewer.height
    rays = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, (w, h), (20_000, 2)))
    obeyed, broken = (trace_all(make(a_rig), *rays) for make in (rule.obeyed, rule.broken))
    assert obeyed.has_arrived.sum() > 4_000
    assert np.array_equal(obeyed.reason, broken.reason)
    landed = obeyed.has_arrived
    assert np.abs(obeyed.xy - broken.xy)[landed].max() < 1e-9 * a_rig.display.width
