"""The progress bar of a solve: fixed shares of its stages, moved by the work that is counted."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base import stages
from kiriko.core.base.stages import AFTER, SHARES, TRACING, section, spans
from kiriko.core.map import points, view_map
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, bottle, cube_rig, icosphere, rig, wavy_slab

RIGS = {
    "ball": lambda: ball_rig(4, pixels=128, display_pixels=256),
    "cube": lambda: cube_rig(pixels=64),
    "bottle": lambda: rig(bottle(), pixels=64, display_pixels=96),
    "facets": lambda: rig(icosphere(0.025, 3, smooth=False), pixels=48, display_pixels=48),
    # large squares fail their checks after smaller ones were traced
    "wavy": lambda: rig(wavy_slab(96, thickness=0.03, amplitude=0.003), pixels=128),
}


def progress_of(a_rig, session=None, **settings):
    """Each progress that a solve yields."""
    return np.array(list((session or Session()).solve(a_rig, Settings(**settings))))


def viewers(a_rig, *sideways):
    """The rig with viewers that stand so far aside."""
    places = [a_rig.viewer.position + np.array([x, 0, 0]) for x in sideways]
    made = [replace(a_rig.viewer, name=str(n), position=at) for n, at in enumerate(places)]
    return replace(a_rig, viewers=tuple(made))


def test_the_shares_are_those_of_one_whole_solve():
    assert len(SHARES) == 8
    assert tuple(SHARES) == TRACING + sum(AFTER, ())
    assert sum(SHARES.values()) == pytest.approx(1)
    assert min(SHARES.values()) > 0


def test_spans_follow_one_another_from_0_to_1(monkeypatch):
    """In proportion to their shares; a part without a stage takes nothing."""
    monkeypatch.setattr(stages, "SHARES", {"a": 0.5, "b": 0.2, "c": 0.3})
    assert spans(("a",), ("b", "c")) == [(0.0, 0.5), (0.5, 1.0)]
    first, none, last = spans(("b",), (), ("c",))
    assert first == pytest.approx((0, 0.4))
    assert none == pytest.approx((0.4, 0.4))
    assert last == pytest.approx((0.4, 1))
    assert section((0.2, 0.8), 1, 3) == pytest.approx((0.4, 0.6))


@pytest.mark.parametrize("name", RIGS)
def test_a_solve_yields_the_progress_of_its_stages(name):
    """From 0 to 1, never back; each stage that takes rays or shares begins at its place."""
    told = progress_of(RIGS[name]())
    assert told[0] == 0
    assert told[-1] == 1
    assert (np.diff(told) >= 0).all()
    starts = dict(zip(SHARES, spans(*((stage,) for stage in SHARES)), strict=True))
    if name in ("ball", "cube", "wavy"):
        del starts["samples"]
    for start, _ in starts.values():
        assert np.abs(told - start).min() < 1e-12


@pytest.mark.parametrize("stage", ["squares", "borders", "samples", "painting", "measuring"])
def test_a_stage_moves_the_bar_by_what_it_counts(stage, monkeypatch):
    """Rays of squares and samples, rounds of borders, pieces that are painted."""
    monkeypatch.setattr(view_map, "QUADS_AT_ONCE", 1 << 10)
    start, end = spans(*((one,) for one in SHARES))[list(SHARES).index(stage)]
    monkeypatch.setattr(points, "TRACED_AT_ONCE", 1 << 12)
    told = progress_of(RIGS["facets" if stage == "samples" else "ball"]())
    inside = np.unique(told[(told > start + 1e-9) & (told < end - 1e-9)])
    assert len(inside) >= 2
    assert inside[-1] - inside[0] > 0.3 * (end - start)


@pytest.mark.parametrize("settings", [{}, {"ghosts": "strongest"}, {"disagreement": "sharp"}])
def test_viewers_share_the_tracing_equally(settings):
    """Also where the paths, or the places that they ask for, are looked for first."""
    told = progress_of(viewers(RIGS["cube"](), -0.02, 0.0, 0.02), **settings)
    assert (np.diff(told) >= 0).all()
    (_, end), *_ = spans(TRACING, *AFTER)
    for k in (1, 2, 3):
        assert np.abs(told - end * k / 3).min() < 1e-12


def test_a_coarse_picture_has_a_bar_of_its_own():
    """Of tracing and painting."""
    told = np.array(list(Session().solve_preview(RIGS["ball"](), Settings())))
    assert told[0] == 0
    assert (np.diff(told) >= 0).all()
    (_, end), _ = spans(TRACING, ("painting",))
    assert np.abs(told - end).min() < end / 10
    assert 0.9 < told[-1] <= 1
