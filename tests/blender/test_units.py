from collections.abc import Callable

import pytest

from extension import loaded


@pytest.fixture
def text(scene) -> Callable[..., str]:
    """A length, m, in words, in a scene of a unit system, unit and unit scale."""
    told = loaded("core.blender.data.units").length_text

    def tell(metres: float, system: str, unit: str = "ADAPTIVE", scale: float = 1.0) -> str:
        units = scene.unit_settings
        units.system, units.scale_length = system, scale
        if system != "NONE":
            units.length_unit = unit
        return told(scene, metres)

    return tell


@pytest.mark.parametrize(
    ("metres", "unit", "words"),
    [
        (0.04317, "METERS", "0.0432 m"),
        (11.2218, "METERS", "11.2 m"),
        (11.2218, "MILLIMETERS", "11200 mm"),
        (0.04317, "MILLIMETERS", "43.2 mm"),
        (0.488, "CENTIMETERS", "48.8 cm"),
        (0.04317, "KILOMETERS", "4.32 cm"),  # 0.00004 km is no number to read
        (2e-5, "METERS", "20 \N{MICRO SIGN}m"),
        (0.0, "MILLIMETERS", "0 mm"),
        (2e-9, "ADAPTIVE", "0.000000002 m"),  # Blender rounds it to nothing
    ],
)
def test_metric_lengths_are_told_in_the_scenes_unit(text, metres, unit, words):
    """In the unit the fields have where the number is readable, else in one that fits.

    Never with an exponent.
    """
    assert text(metres, "METRIC", unit) == words


@pytest.mark.parametrize(
    ("metres", "unit", "words"),
    [(0.0254, "INCHES", "1 in"), (1.172, "FEET", "3.85 ft"), (0.0254, "ADAPTIVE", '1"')],
)
def test_imperial_lengths(text, metres, unit, words):
    """An inch is an inch."""
    assert text(metres, "IMPERIAL", unit) == words


def test_the_unit_scale_changes_no_length(text):
    """A length in metres stays that; without units it is told in Blender's."""
    assert text(0.05, "METRIC", "MILLIMETERS", 0.001) == "50 mm"
    assert text(0.05, "NONE", scale=0.001) == "0.05 units"
