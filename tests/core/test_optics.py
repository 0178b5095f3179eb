"""The laws of core/light/optics.py against the invariants of physics.

Test_judge.py holds them to fifty digits.
"""

import numpy as np

from kiriko.core.light.optics import plane_symmetry, reflect, refract


def random_pairs(n, seed=1):
    """Unit directions and unit normals turned against them, all angles up to grazing."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.cross(normals, random.normal(size=(n, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.pi / 2 * (1 - 10.0 ** -random.uniform(0, 7, n))
    directions = np.sin(angle)[:, None] * across - np.cos(angle)[:, None] * normals
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), normals


def test_equal_indices_leave_the_direction_bit_for_bit():
    """At eta = 1 nothing is refracted, nothing reflected, at any angle."""
    directions, normals = random_pairs(10_000)
    out, is_tir, transmittance = refract(directions, normals, *np.full((2, len(directions)), 1.49))
    assert np.array_equal(out, directions)
    assert not is_tir.any()
    assert np.array_equal(transmittance, np.ones(len(directions)))


def test_fresnel_equals_the_textbook_and_is_the_same_both_ways():
    """T = 1 - (Rs + Rp) / 2 with the angle form of Fresnel's
    equations; T(1 -> 2) = T(2 -> 1) along the same path.
    """
    angle = np.linspace(0.001, 1.55, 200)
    normals = np.tile([0.0, 0.0, 1.0], (200, 1))
    directions = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)
    out, _, forth = refract(directions, normals, np.ones(200), np.full(200, 1.49))
    inside = np.arcsin(np.sin(angle) / 1.49)
    rs = (np.sin(angle - inside) / np.sin(angle + inside)) ** 2
    rp = (np.tan(angle - inside) / np.tan(angle + inside)) ** 2
    np.testing.assert_allclose(forth, 1 - (rs + rp) / 2, atol=1e-12)
    _, _, back = refract(-out, -normals, np.full(200, 1.49), np.ones(200))
    np.testing.assert_allclose(back, forth, atol=1e-12)


def test_plane_symmetry_keeps_the_normal_part_and_turns_the_rest():
    """o.n = i.n and o + i is along n; and it undoes itself."""
    directions, normals = random_pairs(1000)
    out = plane_symmetry(directions, normals)
    np.testing.assert_allclose((out * normals).sum(1), (directions * normals).sum(1), atol=1e-15)
    assert np.abs(np.cross(out + directions, normals)).max() < 4e-16 * 2
    np.testing.assert_allclose(plane_symmetry(out, normals), directions, atol=1e-15)
    np.testing.assert_allclose(out, -reflect(directions, normals), atol=0)
