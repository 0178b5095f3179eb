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


COLOURS = np.array([[0.1, 0.5, 0.9], [1.0, 1.0, 1.0], [0.01, 0.02, 0.005], [0.8, 0.1, 0.3]])
# by colour-science 0.4.7, whose published matrices are rounded to four digits
BY_COLOUR_SCIENCE = {
    ("P3", 250.0): [
        [0.45053, 0.72655, 0.93447], [1, 1, 1],
        [0.11077, 0.15027, 0.07164], [0.84107, 0.38587, 0.57851],
    ],
    ("PQ", 400.0): [
        [0.51447, 0.57420, 0.63540], [0.65258, 0.65258, 0.65258],
        [0.25105, 0.27904, 0.20328], [0.58871, 0.45813, 0.52324],
    ],
    ("PQ", 1000.0): [
        [0.60927, 0.67149, 0.73433], [0.75183, 0.75183, 0.75183],
        [0.32126, 0.35322, 0.26568], [0.68646, 0.54971, 0.61847],
    ],
    ("HLG", 1000.0): [
        [0.77748, 0.88815, 0.99538], [1, 1, 1],
        [0.27844, 0.33684, 0.19481], [0.93016, 0.68140, 0.81096],
    ],
    ("HLG", 500.0): [
        [0.76197, 0.87322, 0.98076], [1, 1, 1],
        [0.22784, 0.27563, 0.15941], [0.90584, 0.65433, 0.78578],
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "white"), BY_COLOUR_SCIENCE)
def test_an_encoding_is_that_of_an_independent_library(name: str, white: float) -> None:
    """Rec.709 light to Display P3, PQ and HLG, to the library's own rounding."""
    found = encoding.encode(COLOURS, encoding.Encoding(name, white))
    np.testing.assert_allclose(found, BY_COLOUR_SCIENCE[name, white], atol=2e-4)


def test_reference_levels_are_those_of_the_standards() -> None:
    """BT.2408: 203 cd/m^2 is 58 % of PQ, 75 % of HLG at 1000 cd/m^2; ST 2084: 100 cd/m^2 is 50.8 %;
    white, black, and colours out of 0..1.
    """
    grey = np.full((1, 3), 1.0)
    for white, level in ((100.0, 0.5081), (203.0, 0.5807), (10000.0, 1.0)):
        found = encoding.encode(grey, encoding.Encoding("PQ", white))
        np.testing.assert_allclose(found, level, atol=1e-4)
    hlg = encoding.Encoding("HLG", 1000.0)
    np.testing.assert_allclose(encoding.encode(0.203 * grey, hlg), 0.75, atol=1e-3)
    for name in encoding.ENCODINGS:
        for white in (0.1, 250.0, 1e5):
            curve = encoding.Encoding(name, white)
            assert encoding.encode(0 * grey, curve).max() < 1e-6
            wild = np.array([[-1.0, 2.0, np.nan], [np.inf, 0.0, 1.0]])
            assert np.isfinite(encoding.encode(wild, curve)).all()
    with_alpha = np.full((2, 2, 4), 0.25, np.float32)
    found = encoding.quantised(with_alpha, "uint8", hlg)
    assert found.dtype == np.uint8
    assert (found[..., 3] == 64).all()
