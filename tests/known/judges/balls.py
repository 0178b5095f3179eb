"""The judge of balls, in closed form and by refraction at their normals."""

from __future__ import annotations

import mpmath
import numpy as np

from kiriko.core.light.optics import refract

from .. import closed_forms
from .light import random_frames, random_indices
from .refraction import snell
from .verdicts import DIGITS, Verdict, dot, exactly, far_from, sqrt, unit, verdict


def through_ball(
    o: np.ndarray, d: np.ndarray, radius: np.ndarray, index: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Both roots of the ball's equation, the radius as normal: two
    places and two directions (n, 3); k, beyond (n,).
    """
    middle = -dot(o, d)
    first = o + (middle - sqrt(middle**2 - dot(o, o) + radius**2))[:, None] * d
    one = 0 * index + 1
    inside, k, beyond = snell(d, first / radius[:, None], one, index)
    last = first - 2 * dot(first, inside)[:, None] * inside
    out, k_out, _ = snell(inside, -last / radius[:, None], index, one)
    with np.errstate(
        invalid="ignore"
    ):  # light that is totally reflected has no place behind the ball: NaN
        return first, last, inside, out, np.fmin(k.astype(float), k_out.astype(float)), beyond


def judge_balls(n: int, seed: int = 0) -> list[Verdict]:
    """The tests' closed form of a ball, and optics.refract at
    its two normals, from 1.001 radii to 10 km away.
    """
    random = np.random.default_rng(seed)
    radius = 10 ** random.uniform(-3, 0, n)
    index = random_indices(random, n)
    index = index[0] / index[1]

    # anywhere, near the rim, near the middle, near total reflection
    which = random.integers(0, 4, n)
    anywhere = np.sqrt(random.random(n))
    grazing = 1 - 10 ** random.uniform(-12, -1, n)
    central = 10 ** random.uniform(-16, -3, n)
    critical = index * (1 + 10 ** random.uniform(-15, -3, n) * random.choice([-1, 1], n))
    beside = np.choose(which, [anywhere, grazing, central, np.clip(critical, 0, 1 - 1e-12)])
    d, across = random_frames(random, n)
    far = radius * np.maximum(1.001, 10 ** random.uniform(-3, 4, n) / radius)
    o = (beside * radius)[:, None] * across - far[:, None] * d
    scale = 1 + far / radius  # a rounding of where light comes from, in parts of the radius

    with mpmath.workdps(DIGITS):
        exact_o = exactly(o)
        exact_d = unit(exactly(d))
        r = exactly(radius)
        meets = dot(exact_o, exact_o) - dot(exact_o, exact_d) ** 2 < r**2

    o, d, radius, index, scale, exact_o, exact_d, r = (
        column[meets] for column in (o, d, radius, index, scale, exact_o, exact_d, r)
    )
    with np.errstate(invalid="ignore"):
        places, directions = closed_forms.through_ball(o, d, radius, index)

    def describe(i: int) -> str:
        return (
            f"ball {radius[i]:.17g}, index {index[i]:.17g}, from {o[i].tolist()} along"
            f" {d[i].tolist()}"
        )

    with mpmath.workdps(DIGITS):
        first, last, inside, out, k, beyond = through_ball(exact_o, exact_d, r, exactly(index))
        is_tir = k < 0
        is_wrong = np.isnan(places[:, 0]) != is_tir
        error = np.maximum(far_from(places, last) / radius, far_from(directions, out)) / scale
        # as a distance from the axis, which light from far away misses
        # by the more in angle the more it grazes
        off = np.abs(beyond) * np.sqrt(1 - np.minimum(index, 1) ** 2) / scale
        closed = verdict("ball, closed form", error, k, describe, is_wrong, off)
        one = np.ones(len(o))
        with np.errstate(invalid="ignore"):
            m1 = closed_forms.unit(first.astype(float))
            m2 = -closed_forms.unit(last.astype(float))
        within, is_mirrored, _ = refract(d, m1, one, index)
        m2[is_tir] = -within[is_tir]
        left, never, _ = refract(closed_forms.unit(within), m2, index, one)
        error = np.maximum(far_from(within, inside), far_from(left, out)) / scale
        is_wrong = (is_mirrored != is_tir) | never & ~is_tir
        refracted = verdict(
            "ball, refracted at its normals", error, k, describe, is_wrong, np.abs(beyond) / scale
        )

    return [closed, refracted]
