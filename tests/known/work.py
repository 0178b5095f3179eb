"""Runs the generators that core's long work is made of, and tells where their map is exact."""

import numpy as np

from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session


def drain(generator):
    """Run to the end; progress has to rise from 0 to 1."""
    last = 0.0
    while True:
        try:
            progress = next(generator)
        except StopIteration as done:
            return done.value
        assert last <= progress <= 1.0 + 1e-12
        last = progress


def solve(rig, session=None, **settings):
    return drain((session or Session()).solve(rig, Settings(**settings)))


def is_sampled(view_map, at):
    """Do viewer px (n, 2) lie in pixels that are known by samples?"""
    sampled = {tuple(pixel) for pixel in np.floor(view_map.points.view[view_map.samples])}
    return np.array([tuple(pixel) in sampled for pixel in np.floor(at)])
