"""The rest of a solve as it is told, by a clock that the tests set."""

import pytest

from kiriko.core.light.planning import make_plan
from kiriko.core.map.ray_guess import Rays, RaysAhead
from kiriko.core.settings import Settings
from kiriko.core.solve import progress
from kiriko.core.solve.progress import Ahead, Bar
from known.reference_rigs import cube_rig


def test_while_nothing_new_is_told_the_rest_of_the_time_passes(monkeypatch):
    """Second by second at first, then ever more slowly: it never ends so. A part
    that is done by half when half of its time is over has the other half to go.
    """
    now = [0.0]
    monkeypatch.setattr(progress, "perf_counter", lambda: now[0])

    def silent():
        for _ in range(80):
            now[0] += 0.01
            yield 0.0
        now[0] = 1.0
        yield 0.5

    told = list(Bar().during(silent(), expected=2.0, after=0.0))
    seconds = [0.01 * (k + 1) for k in range(80)]
    rests = [at / part - at for at, part in zip(seconds, told, strict=False)]
    assert rests == sorted(rests, reverse=True)
    assert rests[0] == pytest.approx(2.0 - 0.01, rel=1e-3)
    assert 2.0 - 0.8 < rests[-1] < 2.0
    assert told[-1] == pytest.approx(0.5)


def test_a_search_that_has_ended_tells_how_long_the_next_will_take(monkeypatch):
    """Rays of 1 ms, then 1000 that are searched with and take 10 ms: so will the next 1000.

    While it is under way the first, many at once, do not tell that it is fast.
    """
    monkeypatch.setattr(progress, "times_slower", lambda: 1.0)
    ahead = Ahead(make_plan(cube_rig(pixels=64), Settings()))
    rays = RaysAhead(0)
    rays.count(1000)
    rays.expect(Rays(2000, 2000, searches=2))
    expected = ahead._to_trace(rays, 1.0)

    rays.is_searching = True
    rays.count(1)
    ahead._to_trace(rays, 1.0)
    rays.count(899)
    assert ahead._to_trace(rays, 1.01) == pytest.approx(expected * 1100 / 2000, rel=0.02)

    rays.count(100)
    rays.is_searching = False
    rays.to_come = rays.to_come._replace(searches=1)
    assert ahead._to_trace(rays, 11.0) == pytest.approx(10.0, rel=0.02)
