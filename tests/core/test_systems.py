"""The systems of Add Rig > More, against the sequences of surfaces that their light meets."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.bench.systems import SYSTEMS, viewer
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.plate import array_frame
from kiriko.core.light.rays import main_landings
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import MirrorArray, Plate
from kiriko.core.rig.settings import Settings
from known.reference_rigs import lattice_image, rectangle
from known.sequences import SEQUENCES, ball, landings, lens, mirror, to_plane
from known.work import solve

X, Y, Z = np.eye(3)
# display px; others are exact to rounding. The mesh of a ball is curved by its normals.
TOLERANCE = {"ANAMORPHOSIS": 0.02, "I_BALL": 0.05}


def ideal(a_rig):
    """A rig whose plates have no mirrors."""
    return replace(a_rig, plates=tuple(replace(one, array=None) for one in a_rig.plates))


@pytest.mark.parametrize("name", SEQUENCES)
def test_landings_are_those_of_the_sequence(name):
    """Of rays through the picture, all of which arrive."""
    a_rig = ideal(SYSTEMS[name].make())
    corners = a_rig.picture_place.mesh.vertices
    at = np.random.default_rng(0).random((400, 2))
    places = (
        corners[0] + at[:, :1] * (corners[1] - corners[0]) + at[:, 1:] * (corners[3] - corners[0])
    )
    o, d = a_rig.viewer.rays(a_rig.viewer.project(places))
    found = main_landings(trace_all(compile_plan(a_rig, Settings()), o, d), len(o))
    assert found.has_arrived.all()
    off = np.abs(found.xy - landings(name, a_rig, o, d)).max()
    assert off < TOLERANCE.get(name, 1e-6), off


BRIGHTNESS = {"PEPPER": 0.3, "AIRR": 0.25, "AIRR_POLARISED": 1.0, "I_BALL": 0.5}


@pytest.mark.parametrize("name", SYSTEMS)
def test_each_system_shows_its_whole_picture(name):
    """Solved in few pixels; the brightness of half mirrors is the product of their shares."""
    a_rig = SYSTEMS[name].make()
    eye = replace(a_rig.viewer, width=96, height=96)
    picture = a_rig.pictures[0].showing(lattice_image(128))
    found = solve(replace(a_rig, viewers=(eye,), pictures=(picture,)))
    assert found.picture_coverage > 0.99
    if name in BRIGHTNESS:
        assert found.channels[0].split.brightness == pytest.approx(BRIGHTNESS[name], rel=0.02)


def test_a_table_reflects_by_fresnel():
    """The brightness of a picture that stands on it is the mean of Fresnel's reflectance."""
    a_rig = SYSTEMS["ENCHANTABLE"].make()
    eye = replace(a_rig.viewer, width=64, height=64)
    picture = a_rig.pictures[0].showing(np.ones((8, 8, 4), np.float32))
    split = solve(replace(a_rig, viewers=(eye,), pictures=(picture,))).channels[0].split
    _, d = eye.rays(eye.project([[0, 0, 0.05]]))
    c1 = -d[0, 2]
    c2 = np.sqrt(1 - (1 - c1**2) / 1.5**2)
    s, p = (c1 - 1.5 * c2) / (c1 + 1.5 * c2), (1.5 * c1 - c2) / (1.5 * c1 + c2)
    assert split.brightness == pytest.approx((s**2 + p**2) / 2, rel=0.1)
    assert split.stray == 0


def test_the_camera_of_the_ball_sees_its_picture():
    """By the half mirror, up through the lens into the ball: its rays meet the picture's plane
    where the sequence of surfaces says.
    """
    a_rig = SYSTEMS["I_BALL"].make()
    middle = a_rig.half_mirrors[0].mesh.vertices.mean(axis=0)
    camera = viewer(middle + 0.25 * Y, middle, 0.02)
    wall = replace(a_rig.display, mesh=rectangle(0 * X, X, -Y, 0.06, 0.06))
    a_rig = replace(a_rig, viewers=(camera,), displays=(wall,))
    o, d = camera.rays(np.random.default_rng(0).uniform(0, 512, (400, 2)))
    found = main_landings(trace_all(compile_plan(a_rig, Settings()), o, d), len(o))
    assert found.has_arrived.all()
    n1, n2 = 1, 1.49
    up = [
        mirror(middle, Y + Z), lens(-0.12 * Z, Z, 0.08), ball(0.05, n1, n2, True),
        ball(0.047, n2, n1, True),
    ]  # fmt: skip
    for step in up:
        o, d = step(o, d)
    at = to_plane(o, d, 0 * X, Z)
    assert np.abs(found.positions - at).max() < 1e-5  # m


@pytest.mark.parametrize("degrees", [5, 20, 35, 50])
def test_light_by_its_number_of_reflections(degrees):
    """A layer of mirrors h / p high turns light exactly k times in a share of
    max(0, 1 - abs(r - k)), r = h / p times the slope in glass along the mirrors' normal (Maekawa
    et al. 2006). The throughput tells k.
    """
    rho, n = 0.5, 1.52
    array = MirrorArray("holes", 0.1e-3, 0.25e-3, n, rho, has_fresnel=False)
    sheet = Plate("plate", rectangle(0 * X, X, Y, 0.1, 0.1), array, side=X)
    frame = array_frame(sheet, Z)
    # along the normal of one direction of mirrors, at 45 degrees to the sides
    a = np.radians(degrees)
    d = np.sin(a) * (X + Y) / 2**0.5 - np.cos(a) * Z
    places = np.random.default_rng(0).uniform(-0.02, 0.02, (100_000, 3)) * [1, 1, 0]
    found = frame.folded(places, np.tile(d, (len(places), 1))).throughput
    sine = np.sin(a) / n
    r = sine / np.sqrt(1 - sine**2) * array.height / array.pitch
    for k in range(5):
        share = np.mean(np.isclose(found, rho**k))
        assert share == pytest.approx(max(0.0, 1 - abs(r - k)), abs=0.01)


def test_a_mirror_alone_may_be_moved():
    """A rig without glass measures its curved mirror as one with glass does, from any place."""
    a_rig = SYSTEMS["ANAMORPHOSIS"].make()
    picture = a_rig.pictures[0].showing(lattice_image(64))
    for dx in (-0.02, 0.02):
        eye = a_rig.viewer
        eye = replace(eye, position=eye.position + dx * X, width=64, height=64)
        found = solve(replace(a_rig, viewers=(eye,), pictures=(picture,)))
        assert found.picture_coverage > 0.9
