"""Numbers of files, by tables in place of powers."""

import numpy as np
import pytest

from kiriko.core.files import encoding

GAMMAS = (None, 1.0, 1.8, 2.2, 2.4, 3.0, 0.4545)


def by_powers(values: np.ndarray, kind: str, gamma: float | None) -> np.ndarray:
    top = np.iinfo(kind).max
    return np.rint(encoding.encode(values, gamma) * top).astype(kind)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_the_table_has_the_numbers_of_the_formula(gamma: float | None) -> None:
    """At every step from one number to the next, at both its neighbours, at all half floats, and
    everywhere else.
    """
    grid = np.linspace(-0.1, 1.1, 1 << 18, dtype=np.float32)
    # where the number changes, by the formula turned round: 4 neighbours each way
    codes = (np.arange(1, 256) - 0.5) / 255
    if gamma is None:
        steps = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    else:
        steps = codes**gamma
    near = steps.astype(np.float32).view(np.int32)[:, None] + np.arange(-4, 5, dtype=np.int32)
    small = np.geomspace(1e-45, 1, 1 << 16).astype(np.float32)
    odd = np.array([-0.0, 0.0, np.nan, np.inf, -np.inf, 1e-45, 1.0, -1e-30], np.float32)
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
    values = np.concatenate([halves, grid, near.view(np.float32).ravel(), small, odd])
    assert np.array_equal(
        encoding.quantised(values, "uint8", gamma), by_powers(values, "uint8", gamma)
    )


def test_a_table_is_used_for_displays_as_there_are() -> None:
    """And where none is possible the formula itself is used."""
    for gamma in (None, 1.8, 2.2, 2.4):
        assert encoding._table(gamma) is not None


def test_other_types_and_shapes_are_by_the_formula() -> None:
    """More numbers than are looked up at once, 16 bit, float64."""
    image = np.random.default_rng(1).random((500, 301, 3)).astype(np.float32)
    for values, kind in ((image, "uint8"), (image, "uint16"), (image.astype(float), "uint8")):
        found = encoding.quantised(values, kind)
        assert found.shape == image.shape
        assert found.dtype == kind
        assert np.array_equal(found, by_powers(values, kind, None))
    turned = image.transpose(1, 0, 2)[::-1]
    assert np.array_equal(encoding.quantised(turned, "uint8"), by_powers(turned, "uint8", None))
