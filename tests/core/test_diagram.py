"""Diagrams are read back as a viewer would: points stand
where the ticks say, and no label covers another.
"""

import xml.etree.ElementTree as ElementTree
from itertools import combinations
from math import log10

import pytest

from kiriko.core.lab.drawing.svg import COLOURS, HEIGHT, WIDTH, Curve, linear, log_log

SVG = "{http://www.w3.org/2000/svg}"
LETTER = 0.55  # of the font's size: the mean width of a letter of Helvetica


def read(text):
    return ElementTree.fromstring(text)


def ticks(svg, axis):
    """Values and places, px, of the ticks of an axis."""
    of_axis = [t for t in svg.iter(f"{SVG}text") if t.get("class") == f"{axis} tick"]
    return [(float(t.text), float(t.get(axis)) - (4 if axis == "y" else 0)) for t in of_axis]


def curves_of(svg):
    return [g for g in svg.iter(f"{SVG}g") if g.get("class") == "curve"]


def points_of(curve):
    (line,) = curve.iter(f"{SVG}polyline")
    return [tuple(map(float, pair.split(","))) for pair in line.get("points").split()]


def box(text):
    """The box of a label, px: left, right, top, bottom."""
    x = float(text.get("x"))
    y = float(text.get("y"))
    size = float(text.get("font-size"))
    wide = LETTER * size * len(text.text)
    left = x - wide if text.get("text-anchor") == "end" else x
    return left, left + wide, y - size, y


def by_ticks(pairs, value, scale):
    """Where a value stands by the first and last tick, px."""
    first, a = pairs[0]
    last, b = pairs[-1]
    return a + (b - a) * (scale(value) - scale(first)) / (scale(last) - scale(first))


def same(value):
    return value


@pytest.mark.parametrize(("draw", "scale"), [(linear, same), (log_log, log10)])
def test_points_stand_where_the_ticks_say(draw, scale):
    points = ((0.02, 3.0), (0.4, 71.0), (7.3, 0.5))
    svg = read(draw("title", "across", "up", [Curve("one", points)], ["a note"]))
    (curve,) = curves_of(svg)
    for (x, y), (across, down) in zip(points, points_of(curve), strict=True):
        assert across == pytest.approx(by_ticks(ticks(svg, "x"), x, scale), abs=0.02)
        assert down == pytest.approx(by_ticks(ticks(svg, "y"), y, scale), abs=0.02)


@pytest.mark.parametrize("most", [0.7, 1.0, 3.3, 41.0, 9.9e5])
def test_linear_axes_have_four_to_ten_round_steps(most):
    """From 0 to the largest value and less than a step beyond it."""
    svg = read(linear("", "", "", [Curve("one", ((most, most),))]))
    values = [value for value, _ in ticks(svg, "x")]
    step = values[1]
    assert values[0] == 0
    assert 4 <= len(values) - 1 <= 10
    assert values[-2] < most * (1 - 1e-9) <= values[-1]
    assert float(f"{step:e}".split("e")[0]) in (1, 2, 5)


def test_no_label_covers_another_of_its_curve_or_leaves_the_diagram():
    """Points far apart have their labels; of a crowd the first does."""
    crowd = tuple((1.0 + 0.001 * k, 1.0 + 0.001 * k) for k in range(5))
    far = ((10.0, 1.0), (1.0, 10.0), (10.0, 10.0))
    points = (*crowd, *far)
    for n in (1, 2):
        curves = [
            Curve(f"curve {k}", points, tuple(f"label {i}" for i in range(8))) for k in range(n)
        ]
        svg = read(log_log("", "", "", curves))
        for curve in curves_of(svg):
            labels = list(curve.iter(f"{SVG}text"))
            assert [label.text for label in labels] == ["label 0", "label 5", "label 6", "label 7"]
            for one, other in combinations(map(box, labels), 2):
                assert (
                    one[1] <= other[0]
                    or other[1] <= one[0]
                    or one[3] <= other[2]
                    or other[3] <= one[2]
                )
            for left, right, top, bottom in map(box, labels):
                assert 0 <= left < right <= WIDTH
                assert 0 <= top < bottom <= HEIGHT


def test_curves_are_told_apart_and_named():
    """By colour and by mark, in the diagram and in its legend.

    Names are text, whatever stands in them.
    """
    names = ["a < b", "c & d"]
    svg = read(
        log_log("x > y", "", "", [Curve(name, ((1.0, 1.0), (10.0, 10.0))) for name in names])
    )

    assert [curve.find(f"{SVG}title").text for curve in curves_of(svg)] == names
    assert [curve.get("fill") for curve in curves_of(svg)] == list(COLOURS[:2])
    (legend,) = (g for g in svg.iter(f"{SVG}g") if g.get("class") == "legend")
    assert [text.text for text in legend.iter(f"{SVG}text")] == names
    assert [mark.tag.removeprefix(SVG) for mark in legend if mark.tag != f"{SVG}text"] == [
        "circle",
        "rect",
    ]
    assert [mark.get("fill") for mark in legend if mark.tag != f"{SVG}text"] == list(COLOURS[:2])
    assert "x > y" in [text.text for text in svg.iter(f"{SVG}text")]
