"""Polarised light, backward: the row Stokes vector of what a viewer sees, and its change by parts.

Light with Stokes vector S, in the order of travel from the display, reaches the viewer with the
intensity row S; a part with Mueller matrix M turns the row into row M. All parts are diagonal in a
frame of their own: two complex amplitudes, along and across an axis perpendicular to the ray.

A row's reference is its frame's first axis; the second one is reference x direction of the backward
ray. Phases grow along the light, exp(i k z).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.vectors import cross_2d, dot, length_of, normalise
from ..rig.rig import Mesh

Amplitudes = NDArray[np.complex128] | Floats | complex

# sine of the angle between a ray and a normal below which their plane is arbitrary: the error is of
# second order
ALONG_NORMAL = 1e-8


class Passed(NamedTuple):
    """Light of rays (n,) after a part.

    share : (n,) of the light, 0..1; of the polarisation that passes best
    row : (n, 4) Stokes, scaled to a share of 1; None if the plan is not polarised
    reference : (n, 3) unit
    """

    share: Floats
    row: Floats | None = None
    reference: Floats | None = None

    def at(self, some: NDArray) -> "Passed":
        """The light of some rays."""
        return Passed(*(None if column is None else column[some] for column in self))


def begin(directions: Floats) -> tuple[Floats, Floats]:
    """Rows (n, 4) and references (n, 3) of rays at a viewer, who sees all polarisations alike."""
    least = np.abs(directions).argmin(axis=1)
    reference = normalise(np.cross(directions, np.eye(3)[least]))
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(directions), 1)), reference


def passed(
    row: Floats,
    reference: Floats,
    directions: Floats,
    others: Floats,
    along: Amplitudes,
    over: Amplitudes,
) -> Passed:
    """Light of rays (n,) after a part, with one amplitude along the axis perpendicular to the ray
    and to another vector (n, 3), and one across it; the reference is the axis if both are parallel.
    """
    axis = np.cross(directions, others)
    is_defined = length_of(axis) > ALONG_NORMAL
    axis = np.where(is_defined[:, None], normalise(axis), reference)
    turn = dot(reference, axis) + 1j * dot(np.cross(reference, directions), axis)
    i, v = row[:, 0], row[:, 3]
    linear = (row[:, 1] + 1j * row[:, 2]) * np.conj(turn / np.abs(turn)) ** 2
    q, u = linear.real, linear.imag

    powers = np.abs(along) ** 2, np.abs(over) ** 2
    mean, half = (powers[0] + powers[1]) / 2, (powers[0] - powers[1]) / 2
    rest = (u + 1j * v) * along * np.conj(over)
    row = np.stack([mean * i + half * q, half * i + mean * q, rest.real, rest.imag], axis=1)
    share = row[:, 0] + length_of(row[:, 1:])
    return Passed(share, row / np.where(share > 0, share, 1.0)[:, None], axis)


def reflection(
    directions: Floats, normals: Floats, n1: Floats, n2: Floats
) -> tuple[Amplitudes, Amplitudes]:
    """Fresnel's amplitudes (n,) of reflected light, s and p, with phases in total reflection.

    Parameters as for `optics.refract`.
    """
    eta = n1 / n2
    c = -dot(directions, normals)
    root = np.sqrt((c * c + (n2 - n1) / n2 * (1 + eta) * (1 - c * c)).astype(complex))
    with np.errstate(invalid="ignore", divide="ignore"):
        s, p = (eta * c - root) / (eta * c + root), (c - eta * root) / (c + eta * root)
    return np.nan_to_num(s, nan=-1.0), np.nan_to_num(p, nan=-1.0)


def axes_of(mesh: Mesh, normals: Floats, angle: float) -> Floats:
    """For each triangle, the unit vector (t, 3) at an angle, rad, from the UV map's u axis, or from
    its first edge without a map; counterclockwise seen from the front.

    normals : (t, 3)
    """
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    along = edges[:, 0]
    if mesh.uv is not None:
        first, second = (mesh.uv[:, 1:] - mesh.uv[:, :1]).swapaxes(0, 1)
        u_axis = second[:, 1:] * edges[:, 0] - first[:, 1:] * edges[:, 1]
        u_axis *= np.sign(cross_2d(first, second))[:, None]
        along = np.where((length_of(u_axis) > 0)[:, None], u_axis, along)
    along = normalise(along)
    return np.cos(angle) * along + np.sin(angle) * np.cross(normals, along)
