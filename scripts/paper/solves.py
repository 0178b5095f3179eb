"""Solves from nothing, as the paper's pictures need them."""

from __future__ import annotations

from dataclasses import replace

from kiriko.core.base.steps import finish
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution

# of a converged solve: viewer pixels each way times as many, tolerance in display px
FINER = 2
FINEST = 1e-3


def solve(rig: Rig, **settings: float) -> Solution:
    """A solve from nothing."""
    return finish(Session().solve(rig, Settings(**settings)))


def converged(rig: Rig) -> Solution:
    """The rig solved far finer than it is shown."""
    viewer = rig.viewer
    viewer = replace(viewer, width=FINER * viewer.width, height=FINER * viewer.height)
    return solve(replace(rig, viewers=(viewer,)), tolerance=FINEST)
