"""Looking for lost rays in float64 takes little memory and
short steps, however many faces they may meet.
"""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.glass.curved_hits import RayLines
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light import layer_hits
from kiriko.core.light.hits import Hits, Question
from kiriko.core.light.ray_engine import Layer
from known.reference_rigs import lathed


def test_lost_rays_are_looked_for_in_pieces():
    """5000 rays within a lathe, among all its curved faces: under
    60 MB at once, in many steps, most of them found.
    """
    s = np.linspace(0, 1, 29)
    radius = np.where((s > 0) & (s < 1), 0.014 + 0.007 * np.sin(7 * s + 0.3), 0)
    surface = make_surface(lathed(radius, 0.05 * (s - 0.5)))
    layer = Layer(surface.corners, surface.curved)
    random = np.random.default_rng(0)
    origins = random.uniform(-0.006, 0.006, (5000, 3))
    away = random.normal(size=(5000, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    hits = Hits.none(5000, surface.curved)
    rays = np.arange(5000)

    def accept(i, found):
        return ~found.enters & (found.distance > 1e-9), np.zeros(len(i), bool)

    question = Question(RayLines(origins, away), accept, leaves=np.ones(5000, bool))
    tracemalloc.start()
    try:
        steps = sum(1 for _ in layer_hits.search_all_triangles(layer, question, rays, hits))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert peak < 60e6
    assert steps > 50
    assert (hits.triangle >= 0).mean() > 0.9


@pytest.mark.parametrize("pairs_at_once", [1, 50, 1 << 13])
def test_of_faces_in_one_place_the_first_by_number_is_met(monkeypatch, pairs_at_once):
    """However many pairs are tested together, and whichever rays are asked with a ray."""
    monkeypatch.setattr(
        layer_hits, "MISSED_HITS", replace(layer_hits.MISSED_HITS, near_at_once=pairs_at_once)
    )
    random = np.random.default_rng(0)
    some = random.normal(size=(40, 3, 3))
    layer = Layer(np.concatenate([some, some[::-1]]))
    towards = some.mean(axis=1)
    origins = random.normal(size=(40, 3))
    away = (towards - origins) / np.linalg.norm(towards - origins, axis=1, keepdims=True)

    def accept(i, found):
        return np.ones(len(i), bool), np.zeros(len(i), bool)

    def met(rays):
        hits = Hits.none(40, None)
        question = Question(RayLines(origins, away), accept)
        for _ in layer_hits.search_all_triangles(layer, question, rays, hits):
            pass
        return hits.triangle[rays]

    together = met(np.arange(40))
    assert (together >= 0).all()
    assert (together < 40).all()
    assert [met(np.array([ray]))[0] for ray in range(40)] == together.tolist()
