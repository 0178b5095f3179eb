"""From a place in a cell's image on the display back to the viewer's image.

A quad's image is bilinear in (s, t), both in -1/2..1/2: p = centre + s a + t b + s t c. With
(s0, t0) the solution for c = 0, the product k = s t solves the quadratic equation
k = (s0 - k cx) (t0 - k cy). Its root that is s0 t0 for c = 0 is the one within the quad.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.products import turn_covariance
from .cells import INSIDE, THINNEST


class Bilinear(NamedTuple):
    """Coefficients (c,) of a map from (s, t), both in -1/2..1/2, to quads."""

    constant: Floats
    s: Floats
    t: Floats
    st: Floats


def cell_from_display(x: Floats, y: Floats, total: Floats) -> Floats:
    """Coefficients (8, c) that take a point on the display to (s, t) in the cell.

    A quad is p = centre + s a + t b + s t c with s, t in -1/2..1/2, a triangle p = corner + s a
    + t b. Six coefficients invert the part without c, two are c in that frame.
    """
    # both coordinates, as polynomials of s and t
    if len(x) == 3:
        px = x[0]
        py = y[0]
        ax = x[1] - x[0]
        ay = y[1] - y[0]
        bx = x[2] - x[0]
        by = y[2] - y[0]
        cx = cy = np.zeros_like(px)
        det = 2 * total
    else:
        px, ax, bx, cx = _bilinear(x)
        py, ay, by, cy = _bilinear(y)
        det = total

    # the inverse of the linear part
    s_x = by / det
    s_y = -bx / det
    t_x = -ay / det
    t_y = ax / det

    return np.stack([
        *(s_x, s_y, -(s_x * px + s_y * py)),
        *(t_x, t_y, -(t_x * px + t_y * py)),
        *(s_x * cx + s_y * cy, t_x * cx + t_y * cy),
    ])  # fmt: skip


def view_from_cell(u: Floats, v: Floats) -> Floats:
    """Coefficients (8, c) of the viewer's u and v: constant, s, t and s t."""
    if len(u) == 3:
        zero = np.zeros_like(u[0])
        return np.stack([
            *(u[0], u[1] - u[0], u[2] - u[0], zero),
            *(v[0], v[1] - v[0], v[2] - v[0], zero),
        ])  # fmt: skip
    return np.stack([*_bilinear(u), *_bilinear(v)])


def _bilinear(x: Floats) -> Bilinear:
    """The map to quads (4, c)."""
    return Bilinear(
        0.25 * (x[0] + x[1] + x[2] + x[3]),
        0.5 * (x[1] + x[2] - x[0] - x[3]),
        0.5 * (x[2] + x[3] - x[0] - x[1]),
        x[0] - x[1] + x[2] - x[3],
    )


def on_view(
    inverse: Floats, forward: Floats, x: Floats, y: Floats, is_triangle: bool
) -> tuple[Floats, Floats]:
    """The viewer's u, v of points x, y on the display, kept
    within the cell so that no sliver is rounded out of it.

    With (s0, t0) the solution for c = 0, the product k = s t
    solves k = (s0 - k cx)(t0 - k cy), a quadratic equation.
    """
    s_x, s_y, s_1, t_x, t_y, t_1, cx, cy = inverse
    s = s_x * x + s_y * y + s_1
    t = t_x * x + t_y * y + t_1

    if is_triangle:
        s = np.clip(s, INSIDE, 1 - 2 * INSIDE)
        t = np.clip(t, INSIDE, 1 - INSIDE - s)
    else:
        linear = 1 + s * cy + t * cx
        root = np.sqrt(np.maximum(linear * linear - 4 * cx * cy * s * t, 0))
        k = 2 * s * t / np.maximum(linear + root, THINNEST)
        s, t = (np.clip(number, INSIDE - 0.5, 0.5 - INSIDE) for number in (s - k * cx, t - k * cy))

    k = s * t
    u0, us, ut, uk, v0, vs, vt, vk = forward
    return u0 + s * us + t * ut + k * uk, v0 + s * vs + t * vt + k * vk


def spread_on_view(
    inverse: Floats, forward: Floats, xx: Floats, xy: Floats, yy: Floats
) -> NDArray[np.float32]:
    """The covariance (3, n) on the viewer's image of that on
    the display, as if cells were parallelograms.

    Within the cell it is limited to the values that points of it
    can have, however rounding spoilt that of a sliver.
    """
    s_x, s_y, _, t_x, t_y, *_ = inverse
    _, us, ut, _, _, vs, vt, _ = forward
    ss, st, tt = turn_covariance((xx, xy, yy), s_x, s_y, t_x, t_y)

    ss = np.clip(ss, 0, 0.25)
    tt = np.clip(tt, 0, 0.25)
    most = np.sqrt(ss * tt)
    in_cell = ss, np.clip(st, -most, most), tt

    return turn_covariance(in_cell, us, ut, vs, vt).astype(np.float32)
