"""Bench drawings against the rigs they were drawn of, measured on the paper."""

import re
from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiriko.core.lab.calibrate.drawn import Lattice
from kiriko.core.lab.drawing.bench import (
    SCALES,
    contour,
    draw_bench,
    draw_seen,
    find_datum,
    rectangle,
    standing,
)
from kiriko.core.lab.drawing.svg import SIZES
from kiriko.core.rig.rig import Rig
from known.reference_rigs import ball_rig, box, cube_rig, icosphere
from known.reference_rigs import rectangle as a_rectangle

PAPER = 0.01  # mm, to which coordinates are written


def test_contour_of_a_ball_is_its_circle() -> None:
    """It runs around once, and every point of it is as far from
    the axis as the ball's radius but for the mesh's chords.
    """
    direction = np.array([0.36, 0.48, 0.8])
    ends = contour(icosphere((0.025,) * 3, 4), direction)
    flat = ends - (ends @ direction)[..., None] * direction
    assert np.linalg.norm(flat, axis=2) == pytest.approx(0.025, rel=0.005)

    # each place is the end of two edges
    _, times = np.unique(np.round(ends.reshape(-1, 3), 9), axis=0, return_counts=True)
    assert (times == 2).all()


def test_contour_of_a_cube_is_its_edges() -> None:
    """All twelve, wherever they are seen from; none of the diagonals."""
    ends = contour(box((0.03,) * 3), np.array([0.0, 1.0, 0.0]))
    edges = np.unique(np.sort(np.round(ends, 9), axis=1), axis=0)
    assert len(edges) == 12
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(0.03)


@given(
    width=st.floats(0.01, 2),
    height=st.floats(0.01, 2),
    turn=st.floats(0, 6.3),
    tilt=st.floats(0, 3),
)
@settings(max_examples=50, deadline=None)
def test_rectangle_is_found_again(width: float, height: float, turn: float, tilt: float) -> None:
    """A turned rectangle has its own corners, from the lower left of its UV map on."""
    right = np.array([np.cos(turn), np.sin(turn), 0])
    up = np.array([-np.sin(turn) * np.cos(tilt), np.cos(turn) * np.cos(tilt), np.sin(tilt)])
    centre = np.array([0.1, -0.2, 0.3])
    found = rectangle(a_rectangle(centre, right, up, width, height))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    expected = centre + signs @ np.stack([width * right, height * up])

    assert found.corners == pytest.approx(expected, abs=1e-12)
    assert found.size == pytest.approx((width, height))
    assert found.normal == pytest.approx(np.cross(right, up), abs=1e-12)


def test_body_is_no_rectangle() -> None:
    assert rectangle(box((0.03,) * 3)) is None


def test_places_are_measured_from_the_lowest_edge_of_the_plate() -> None:
    """The reference bench: a plate of 488 mm at 45 degrees, 150 mm behind the glass."""
    a_rig = ball_rig()
    datum = find_datum(a_rig, a_rig.viewer)
    low = 0.244 / 2**0.5
    assert datum.place == pytest.approx([0, 0.15 - low, -low])

    parts = {part.role.name: part for part in standing(a_rig, datum)}
    assert parts["GLASS"].centre == pytest.approx([low - 0.15, 0, low], abs=1e-9)
    assert parts["PLATE"].tilt == pytest.approx(45)
    assert parts["DISPLAY"].tilt == pytest.approx(0, abs=1e-6)
    assert parts["PICTURE"].tilt == pytest.approx(90)
    assert abs(parts["PICTURE"].azimuth) == pytest.approx(180)


def drawn_paths(svg: str) -> list[np.ndarray]:
    """Ends (n, 2, 2), mm, of the lines of each path."""
    return [
        np.array([float(x) for x in re.findall(r"-?\d+\.\d+", way)]).reshape(-1, 2, 2)
        for way in re.findall(r'<path d="([^"]*)"', svg)
    ]


@pytest.mark.parametrize("paper", SIZES)
@pytest.mark.parametrize("a_rig", [ball_rig, cube_rig])
def test_drawing_is_to_scale(a_rig: Callable[[], Rig], paper: str) -> None:
    """The plate's edge measures 488 mm on the plan at the scale
    that is told, and all lines stand on the paper.
    """
    the_rig = a_rig()
    svg = draw_bench(the_rig, the_rig.viewer, paper)
    told, times = map(float, re.search(r"Scale (\S+) : (\S+) on", svg).groups())
    scale = told / times
    assert min(abs(scale - other) for other in SCALES) < 1e-12

    ends = np.concatenate(drawn_paths(svg))
    assert (ends >= 0).all()
    assert (ends <= SIZES[paper]).all()
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert np.abs(lengths - 488 * scale).min() < 2 * PAPER
    assert "488.0 x 488.0" in svg


def test_dots_stand_where_the_viewer_sees_the_lattice() -> None:
    """Each against the straight line from the viewer to its place on the picture's plane."""
    a_rig = ball_rig()
    lattice = Lattice(5, 4, 0.1)
    svg = draw_seen(a_rig, a_rig.viewer, lattice)
    dots = np.array(
        [[float(x) for x in pair] for pair in re.findall(r'<circle cx="(\S+)" cy="(\S+)"', svg)]
    )

    corners = rectangle(a_rig.picture_place.mesh).corners
    points = corners[0] + lattice.uv @ (corners[[1, 3]] - corners[0])
    seen = a_rig.viewer.project(points)

    frame = next(lines for lines in drawn_paths(svg) if len(lines) == 4)
    start = frame.reshape(-1, 2).min(axis=0)
    scale = np.ptp(frame.reshape(-1, 2), axis=0)[0] / a_rig.viewer.width
    assert dots == pytest.approx(start + scale * seen, abs=2 * PAPER)

    x, y = seen[0]
    assert f"{x:.1f}, {y:.1f}" in svg


def test_any_name_is_text() -> None:
    """Signs of XML, and those that it has no place for."""
    a_rig = ball_rig(2)
    (glass,) = a_rig.glasses
    a_rig = replace(a_rig, glasses=(replace(glass, name="a<&\x0b切子"),))
    texts = [part.text for part in ElementTree.fromstring(draw_bench(a_rig, a_rig.viewer)).iter()]
    assert "a<& 切子" in texts
