"""The catalogue of products, and its tables in the manual."""

import math
from math import hypot
from pathlib import Path

import pytest

from kiriko.core.rig.catalogue import (
    DISPLAYS,
    GLASSES,
    INCH,
    PLATES,
    DisplayProduct,
    GlassProduct,
    PlateProduct,
)

MANUAL = Path(__file__).resolve().parents[2] / "docs" / "manual"

# inches, by which makers name their displays
DIAGONALS = {
    "iPhone SE (2022)": 4.7,
    "iPhone 15": 6.12,
    "iPhone 15 Plus": 6.69,
    "iPad mini (2021)": 8.3,
    "iPad (2022)": 10.86,
    "iPad Pro 12.9 (2022)": 12.9,
    "Raspberry Pi Touch Display 2": 7.0,
    "Dell P2422H": 23.8,
    "Dell U2415": 24.1,
    "Dell U2723QE": 27.0,
    "Apple Studio Display": 27.0,
    "Samsung QM55R": 54.6,
    "Looking Glass Go": 6.0,
    "Looking Glass Portrait": 7.9,
    "Looking Glass 16": 15.6,
    "Looking Glass 32": 31.5,
    "Looking Glass 65": 64.8,
}

# mm, that a monitor tells the computer
EDIDS = {"Dell P2422H": (527, 296), "Dell U2415": (518, 324), "Dell U2723QE": (597, 336)}

# published fits of the index, squared, by the wavelength in um, squared: the terms of Sellmeier
# (strength, resonance), of refractiveindex.info's database
SELLMEIER = {
    "Acrylic": [(1.1819, 0.011313)],
    "N-BK7, K9": [
        (1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653),
    ],
    "Polycarbonate": [(1.4182, 0.021304)],
    "Water": [
        (5.684027565e-1, 5.101829712e-3), (1.726177391e-1, 1.821153936e-2),
        (2.086189578e-2, 2.620722293e-2), (1.130748688e-1, 10.69792721),
    ],
}  # fmt: skip
SODIUM = 0.58929  # um


def test_each_product_is_by_its_own_name_and_has_a_source() -> None:
    """Names are the keys by which scripts and the command line ask for products."""
    for products in (PLATES, DISPLAYS, GLASSES):
        assert all(name == product.name and product.source for name, product in products.items())


@pytest.mark.parametrize("name", DISPLAYS)
def test_a_display_is_as_large_as_its_diagonal_says(name: str) -> None:
    """Size and pixels are two figures of a maker, the diagonal a third; pixels are square."""
    display = DISPLAYS[name]
    width, height = display.size
    columns, rows = display.pixels
    assert hypot(width, height) / INCH == pytest.approx(DIAGONALS[name], rel=0.006)
    if display.views is None:
        assert width / columns == pytest.approx(height / rows, rel=0.01)
        assert width > height
    else:
        display.views.check(name)
    assert display.luminance is None or 100 <= display.luminance <= 3000


@pytest.mark.parametrize("name", EDIDS)
def test_a_monitor_is_as_large_as_it_says_itself(name: str) -> None:
    """To the millimetre to which it tells its size."""
    for side, told in zip(DISPLAYS[name].size, EDIDS[name], strict=True):
        assert 1e3 * side == pytest.approx(told, abs=0.5)


@pytest.mark.parametrize("name", SELLMEIER)
def test_an_index_is_that_of_its_published_dispersion(name: str) -> None:
    """To its last digit, at the sodium line."""
    squared = SODIUM**2
    terms = sum(a * squared / (squared - b) for a, b in SELLMEIER[name])
    digits = 1e-3 if name == "Acrylic" else 1e-4
    assert GLASSES[name].ior == pytest.approx((1 + terms) ** 0.5, abs=0.6 * digits)


def test_window_glass_is_as_measured() -> None:
    """Rubin's fit for clear soda-lime glass, which is no Sellmeier one."""
    fit = 1.5130 - 0.003169 * SODIUM**2 + 0.003962 / SODIUM**2
    assert GLASSES["Soda-Lime Glass"].ior == pytest.approx(fit, abs=5e-5)


@pytest.mark.parametrize("name", PLATES)
def test_a_plate_has_mirrors_that_can_be_made(name: str) -> None:
    """Its own check passes, and the name has its side."""
    plate = PLATES[name]
    plate.array.check(f"The plate '{name}'")
    assert name.endswith(f"-{1e3 * plate.side:.0f}")


def test_the_manual_lists_all_products_with_their_numbers() -> None:
    """English page: name, numbers and source of each product. Japanese page: name and numbers."""
    products = *PLATES.values(), *DISPLAYS.values(), *GLASSES.values()
    rows = [f"| {p.name} | {_numbers(p)} |" for p in products]
    english, japanese = (
        (MANUAL / language / "products.md").read_text(encoding="utf-8").splitlines()
        for language in ("en", "ja")
    )
    full = [f"{row} {p.source} |" for row, p in zip(rows, products, strict=True)]
    assert [row for row in full if row not in english] == []
    assert [row for row in rows if not any(line.startswith(row) for line in japanese)] == []


def _numbers(product: PlateProduct | DisplayProduct | GlassProduct) -> str:
    if isinstance(product, GlassProduct):
        return f"{product.ior:g}"
    if isinstance(product, PlateProduct):
        pitch, height = 1e3 * product.array.pitch, 1e3 * product.array.height
        return f"pitch {pitch:g} mm, layers of {height:g} mm, {1e3 * product.side:g} mm a side"
    width, height = (1e3 * length for length in product.size)
    columns, rows = product.pixels
    text = f"{width:.1f} x {height:.1f} mm, {columns} x {rows}"
    if product.views is not None:
        degrees = math.degrees(product.views.cone[0])
        return f"{text}, {product.views.n} views over {degrees:g} degrees"
    return (
        text
        if product.luminance is None
        else f"{text}, {product.luminance:g} cd/m\N{SUPERSCRIPT TWO}"
    )
