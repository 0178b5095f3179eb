"""Numbers and lengths as text."""

import numpy as np


def number(value: float) -> str:
    """A number with two significant digits, never with an exponent."""
    return np.format_float_positional(float(f"{value:.2g}"), trim="-")


def millimetres(length: float) -> str:
    """A length, m, in millimetres."""
    return f"{number(1e3 * length)} mm"
