"""The laws of core/optics.py against mpmath and against what physics keeps."""

import mpmath
import numpy as np
import pytest

from kiriko.core.optics import plane_symmetry, reflect, refract


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


@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.49), (1.49, 1.0), (1.0, 1 + 1e-9), (1.33, 1.5), (4.0, 1.0)])
def test_refraction_agrees_with_fifty_digits(n1, n2):
    """The refracted direction is within 4 eps / sqrt(k) of mpmath's, and TIR is the same where |k| > 1e-14."""
    directions, normals = random_pairs(300)
    out, is_tir, _ = refract(directions, normals, np.full(len(directions), n1 / n2))
    with mpmath.workdps(50):
        eta = mpmath.mpf(n1 / n2)
        for i, m, t, tir in zip(directions.tolist(), normals.tolist(), out.tolist(), is_tir.tolist(), strict=True):
            i, m = [mpmath.mpf(x) for x in i], [mpmath.mpf(x) for x in m]
            length = mpmath.sqrt(sum(x * x for x in m))  # float64 normals are unit to 1e-16 only
            m = [x / length for x in m]
            c = -sum(a * b for a, b in zip(i, m, strict=True))
            square = sum(x * x for x in i)
            k = square - eta**2 * (square - c * c)
            if abs(k) < 1e-14:
                continue
            assert (k < 0) == tir
            if tir:
                continue
            exact = [eta * a + (eta * c - mpmath.sqrt(k)) * b for a, b in zip(i, m, strict=True)]
            error = max(abs(float(a - b)) for a, b in zip(exact, t, strict=True))
            assert error < 4 * 2.2e-16 * max(1, n1 / n2) ** 2 / float(mpmath.sqrt(k)) + 1e-15


def test_equal_indices_leave_the_direction_bit_for_bit():
    """At eta = 1 nothing is refracted, nothing reflected, at any angle."""
    directions, normals = random_pairs(10_000)
    out, is_tir, transmittance = refract(directions, normals, np.ones(len(directions)))
    assert np.array_equal(out, directions)
    assert not is_tir.any()
    assert np.array_equal(transmittance, np.ones(len(directions)))


def test_fresnel_equals_the_textbook_and_is_the_same_both_ways():
    """T = 1 - (Rs + Rp) / 2 with the angle form of Fresnel's equations; T(1 -> 2) = T(2 -> 1) along the same path."""
    angle = np.linspace(0.001, 1.55, 200)
    normals = np.tile([0.0, 0.0, 1.0], (200, 1))
    directions = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)
    out, _, forth = refract(directions, normals, np.full(200, 1 / 1.49))
    inside = np.arcsin(np.sin(angle) / 1.49)
    rs = (np.sin(angle - inside) / np.sin(angle + inside)) ** 2
    rp = (np.tan(angle - inside) / np.tan(angle + inside)) ** 2
    np.testing.assert_allclose(forth, 1 - (rs + rp) / 2, atol=1e-12)
    _, _, back = refract(-out, -normals, np.full(200, 1.49))
    np.testing.assert_allclose(back, forth, atol=1e-12)


def test_plane_symmetry_keeps_the_normal_part_and_turns_the_rest():
    """o.n = i.n and o + i is along n; and it undoes itself."""
    directions, normals = random_pairs(1000)
    out = plane_symmetry(directions, normals)
    np.testing.assert_allclose((out * normals).sum(1), (directions * normals).sum(1), atol=1e-15)
    assert np.abs(np.cross(out + directions, normals)).max() < 4e-16 * 2
    np.testing.assert_allclose(plane_symmetry(out, normals), directions, atol=1e-15)
    np.testing.assert_allclose(out, -reflect(directions, normals), atol=0)
