"""The judge of refraction and of Fresnel's equations, at given normals."""

from __future__ import annotations

import mpmath
import numpy as np

from kiriko.core.light.optics import refract

from .. import closed_forms
from .light import random_angles, random_frames, random_indices
from .verdicts import DIGITS, Verdict, asin, atan2, dot, exactly, far_from, sqrt, unit, verdict


def snell(
    d: np.ndarray, normals: np.ndarray, n1: np.ndarray, n2: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Refraction of exact d at exact normals against it, by angles.

    Returns the direction (n, 3), NaN where light is totally reflected, cos^2 behind the face (n,),
    negative there, and by how much the angle is beyond the critical one (n,), rad.
    """
    across = d + (-dot(d, normals))[:, None] * normals
    cosine = -dot(d, normals)
    sine = sqrt(dot(across, across))
    behind = n1 / n2 * sine
    k = (1 - behind) * (1 + behind)
    is_through = k >= 0
    depth = sqrt(np.where(is_through, k, 0 * k))
    out = (n1 / n2)[:, None] * across - depth[:, None] * normals
    out[~is_through] = mpmath.nan

    # sines beyond 1 have no angle; the critical angle is then 90 degrees and more away
    critical = asin(np.where(n2 < n1, n2 / n1, 1 + 0 * n1))
    beyond = np.where(n2 < n1, atan2(sine, cosine) - critical, -mpmath.pi)
    return out, k, beyond.astype(float)


def transmitted(
    cos1: np.ndarray, cos2: np.ndarray, sin1: np.ndarray, sin2: np.ndarray
) -> np.ndarray:
    """Fresnel's equations in their form with sines and tangents: unpolarised transmittance.

    Not at normal incidence.
    """
    sin_sum = sin1 * cos2 + cos1 * sin2
    sin_less = sin1 * cos2 - cos1 * sin2
    cos_sum = cos1 * cos2 - sin1 * sin2
    cos_less = cos1 * cos2 + sin1 * sin2
    s = (sin_less / sin_sum) ** 2
    p = s * (cos_sum / cos_less) ** 2
    return 1 - (s + p) / 2


def judge_refraction(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.optics.refract: direction, class, transmittance."""
    random = np.random.default_rng(seed)
    n1, n2 = random_indices(random, n)
    angle = random_angles(random, n1, n2)
    normals, across = random_frames(random, n)
    directions = closed_forms.unit(
        np.sin(angle)[:, None] * across - np.cos(angle)[:, None] * normals
    )
    out, is_tir, transmittance = refract(directions, normals, n1, n2)

    def describe(i: int) -> str:
        return f"n {n1[i]:.17g} to {n2[i]:.17g} at {np.degrees(angle[i]):.17g} deg"

    with mpmath.workdps(DIGITS):
        m1 = exactly(n1)
        m2 = exactly(n2)
        d = unit(exactly(directions))
        m = unit(exactly(normals))
        exact, k, beyond = snell(d, m, m1, m2)
        error = far_from(exact, out)
        found = verdict(
            "refraction", error, k.astype(float), describe, is_tir != (k < 0), np.abs(beyond)
        )
        some = np.flatnonzero(~is_tir & (k > 0))
        d = d[some]
        m = m[some]
        m1 = m1[some]
        m2 = m2[some]
        cos1 = -dot(d, m)
        cos2 = sqrt(k[some])
        along = d + cos1[:, None] * m
        sin1 = sqrt(dot(along, along))
        given = sin1 > 0
        sin1 = np.where(given, sin1, sin1 + 1)
        fresnel = transmitted(cos1, cos2, sin1, sin1 * m1 / m2)
        plain = 1 - ((m1 - m2) / (m1 + m2)) ** 2
        # the transmittance's own slope against the cosine
        # behind the face, which alone is held to the mark
        slope = 2 * (m1 / m2 + m2 / m1) / cos1
        error = np.abs(
            ((np.where(given, fresnel, plain) - transmittance[some]) / (1 + slope)).astype(float)
        )

    return [
        found,
        verdict("transmittance", error, k[some].astype(float), lambda i: describe(some[i])),
    ]
