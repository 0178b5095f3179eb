"""Numbers and lengths as people read them."""

import numpy as np


def number(value: float) -> str:
    """A number of two digits, never with an exponent."""
    return np.format_float_positional(float(f"{value:.2g}"), trim="-")


def millimetres(length: float) -> str:
    """A length, m, where no scene says which unit its people read."""
    return f"{number(1e3 * length)} mm"
