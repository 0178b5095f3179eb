"""Random indices, angles and frames, hard ones among them."""

from __future__ import annotations

import numpy as np

from .. import closed_forms


def random_indices(random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of indices (n,): air and glass, up to 4, and such that differ by 1e-12 to 1e-3.

    Either way round.
    """
    low = np.where(random.random(n) < 0.5, 1.0, random.uniform(1, 2, n))
    ratio = np.select(
        [np.arange(n) % 3 == 0, np.arange(n) % 3 == 1],
        [random.uniform(1.3, 1.9, n), 1 + 10 ** random.uniform(-12, -3, n)],
        4 ** random.random(n),
    )
    pair = np.stack([low, np.minimum(low * ratio, 4.0)], axis=1)
    return tuple(random.permuted(pair, axis=1).T)


def random_angles(random: np.random.Generator, n1: np.ndarray, n2: np.ndarray) -> np.ndarray:
    """Angles of incidence (n,) rad: any, near the critical one, grazing, near normal and normal."""
    n = len(n1)
    nearly = 10 ** random.uniform(-15, -3, n) * random.choice([-1, 1], n)
    grazing = np.pi / 2 - np.radians(10 ** random.uniform(-6, -1, n))
    critical = np.where(n1 > n2, np.arcsin(np.minimum(n2 / n1, 1)) + nearly, grazing)
    normal = np.where(random.random(n) < 0.5, 0.0, 10 ** random.uniform(-16, -3, n))
    angle = np.choose(
        random.integers(0, 4, n), [np.arccos(random.random(n)), critical, grazing, normal]
    )
    return np.clip(angle, 0, np.radians(90 - 1e-6))


def random_frames(random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) and unit vectors across them."""
    normals = closed_forms.unit(random.normal(size=(n, 3)))
    return normals, closed_forms.unit(np.cross(normals, random.normal(size=(n, 3))))


PER_RIG = 400  # rays
# a plate and a display of rigs in which light is judged where it leaves the glass
OUT_OF_THE_WAY = {"distance": 1e3, "plate": 1e-5, "display": 1e-5}
