"""Laws of optics: refraction, reflection, Fresnel, plane symmetry.

Directions are unit vectors of travel (n, 3).
"""

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.vectors import dot


def reflect(directions: Floats, normals: Floats) -> Floats:
    """Mirror directions (n, 3) at planes with unit normals (n, 3) of either sign."""
    return directions - 2.0 * dot(directions, normals)[..., None] * normals


def plane_symmetry(directions: Floats, normals: Floats) -> Floats:
    """Direction behind an ideal plate: the tangential component is reversed, the normal one is
    unchanged.

    Source: Kiuchi & Koizumi 2021 (doi 10.1016/j.cag.2021.02.007), eq. 3.
    """
    return -reflect(directions, normals)


def refract(
    directions: Floats, normals: Floats, n1: Floats, n2: Floats
) -> tuple[Floats, Bools, Floats]:
    """Refract by Snell's law.

    Parameters
    ----------
    directions : (n, 3) unit
    normals : (n, 3) unit, against the ray (negative scalar product)
    n1, n2 : (n,) incident and transmitted index

    Returns
    -------
    refracted : (n, 3) unit; the reflected direction if `is_tir`
    is_tir : (n,) total internal reflection
    transmittance : (n,) unpolarised Fresnel transmittance of power; 1 if `is_tir`

    Notes
    -----
    With eta = n1 / n2, k = c^2 + (1 - eta)(1 + eta)|i_t|^2 avoids cancellation for eta near 1, and
    returns the direction bit for bit at eta = 1. The difference uses the indices, because rounding
    eta hides total reflection for indices 1e-12 apart. Near the critical angle the error grows as
    eps / sqrt(k) in any form.
    """
    eta = n1 / n2
    c = -dot(directions, normals)
    tangential = directions + c[:, None] * normals
    k = c * c + (n2 - n1) / n2 * (1.0 + eta) * dot(tangential, tangential)
    is_tir = k < 0
    root = np.sqrt(np.where(is_tir, 0.0, k))
    refracted = eta[:, None] * directions + (eta * c - root)[:, None] * normals
    refracted = np.where(is_tir[:, None], reflect(directions, normals), refracted)

    return refracted, is_tir, np.where(is_tir, 1.0, transmittance(c, root, eta))


def transmittance(c1: Floats, c2: Floats, eta: Floats | float) -> Floats:
    """Unpolarised Fresnel transmittance of power (n,), from the cosines before and behind a face; 0
    at grazing incidence.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (eta * c1 - c2) / (eta * c1 + c2)
        p = (c1 - eta * c2) / (c1 + eta * c2)
    s, p = (np.where(np.isnan(x), 1.0, x) for x in (s, p))
    return 1.0 - 0.5 * (s**2 + p**2)
