"""Legibility: one number for how well a picture is recognised through the glass."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.bench import measured_remedies as helps_module
from kiriko.core.bench.measured_remedies import (
    WORTH_READING,
    legible_by,
    nearer,
    way_to_glass,
    with_help,
)
from kiriko.core.bench.placement import Wishes, propose_behind, rig_of, viewer_of
from kiriko.core.glass.smoothed import vertex_normals
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.legibility import READABLE, card, card_legibility, likeness
from known.reference_rigs import ball_rig

WHOLE = np.ones((64, 64))


def small_card():
    return card()[2::4, 2::4, 0].astype(float)


def ssim(a, b):
    """Mean structural similarity over windows of 8 x 8 (Wang and others, 2004), of range 1."""
    values = []
    for y in range(0, 57, 4):
        for x in range(0, 57, 4):
            p, q = (image[y : y + 8, x : x + 8].ravel() for image in (a, b))
            c = np.cov(p, q, bias=True)
            values.append(
                (2 * p.mean() * q.mean() + 1e-4)
                * (2 * c[0, 1] + 9e-4)
                / ((p.mean() ** 2 + q.mean() ** 2 + 1e-4) * (c[0, 0] + c[1, 1] + 9e-4))
            )
    return float(np.mean(values))


def test_the_card_has_as_much_black_as_white():
    image = card()
    assert image[..., 0].mean() == 0.5
    assert set(np.unique(image)) == {0.0, 1.0}


@pytest.mark.parametrize(("gain", "veil"), [(1.0, 0.0), (0.3, 0.0), (0.5, 0.4)])
def test_brightness_and_an_even_veil_do_not_count(gain, veil):
    ideal = small_card()
    assert likeness(gain * ideal + veil, ideal, WHOLE) == pytest.approx(1.0)


def test_strewn_light_counts_as_its_part_of_the_variance():
    """Noise of k times the picture's deviation leaves 1 / sqrt(1 + k^2), in closed form."""
    ideal, noise = small_card(), np.random.default_rng(2).normal(size=(64, 64))
    noise -= noise.mean()
    noise -= (noise * (ideal - 0.5)).sum() / ((ideal - 0.5) ** 2).sum() * (ideal - 0.5)
    noise *= 0.5 / noise.std()
    for k in (0.1, 0.5, 1.0, 3.0):
        found = likeness(ideal + k * noise, ideal, WHOLE)
        assert found == pytest.approx(1 / np.sqrt(1 + k**2))


def test_it_orders_images_as_ssim_does():
    """More blocks that are shown elsewhere make both smaller, from the whole picture to none."""
    ideal, random = small_card(), np.random.default_rng(3)
    blocks = ideal.reshape(16, 4, 16, 4).swapaxes(1, 2).reshape(256, 4, 4)
    pairs = []
    for n in (0, 32, 64, 128, 192, 256):
        order = np.arange(256)
        some = random.permutation(256)[:n]
        order[some] = random.permutation(some)
        mixed = blocks[order].reshape(16, 16, 4, 4).swapaxes(1, 2).reshape(64, 64)
        pairs.append((likeness(mixed, ideal, WHOLE), ssim(mixed, ideal)))
    found, others = np.array(pairs).T
    assert found[0] == pytest.approx(1.0)
    assert others[0] == pytest.approx(1.0)
    assert (np.diff(found) < 0).all()
    assert (np.diff(others) < 0).all()
    assert np.corrcoef(found, others)[0, 1] > 0.98
    assert found[-1] < 0.15


def bumpy_rig(off: float):
    """A ball of glass whose vertices are off by so many edges, at random."""
    rig = ball_rig(4, pixels=64, display_pixels=128)
    (glass,) = rig.glasses
    mesh = glass.mesh
    along = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    edge = np.linalg.norm(np.diff(mesh.corners[:, :2], axis=1), axis=2).mean()
    by = off * edge * np.random.default_rng(4).normal(size=(len(along), 1))
    vertices = mesh.vertices + by * along
    normals = vertex_normals(vertices, mesh.triangles)[mesh.triangles]
    bumpy = replace(mesh, vertices=vertices, corner_normals=normals)
    return replace(rig, glasses=(replace(glass, mesh=bumpy),))


def test_bumps_make_a_picture_illegible_and_smoothing_mends_it():
    """The remedy foretells what it then does."""
    settings = Settings()
    clear, bumpy = bumpy_rig(0.0), bumpy_rig(0.5)
    assert run_steps(card_legibility(clear, settings)) > 0.99
    before = run_steps(card_legibility(bumpy, settings))
    assert before < READABLE
    helps = run_steps(legible_by(bumpy, settings, before))
    assert "kiriko.smooth_glass" in {help.operator for help in helps}
    assert list(helps) == sorted(helps, key=lambda help: -help.after)
    for help in helps:
        assert help.after >= before + WORTH_READING
        after = run_steps(card_legibility(with_help(bumpy, help), settings))
        assert after == pytest.approx(help.after)


def behind_a_ball(gap: float = 0.06):
    """A ball of radius 25 mm, and a picture on a display, so far behind its bounds, m."""
    given = ball_rig(4)
    proposal = propose_behind(np.array([[-0.025] * 3, [0.025] * 3]), Wishes(distance=gap))
    bare = replace(given, plates=(), displays=(), viewers=(), pictures=())
    return rig_of(proposal, bare, viewer_of(proposal, (64, 64)), (64, 64))


def test_a_display_moves_up_to_the_back_of_its_glass():
    """The ball's back is at 25 mm: the picture goes there, and the display stays behind it."""
    rig = behind_a_ball()
    picture, display = (part.mesh.vertices[:, 1] for part in (rig.picture_place, rig.display))
    way = way_to_glass(rig)
    assert way == pytest.approx(picture.mean() - 0.025, abs=1e-4)
    there = nearer(rig, way)
    assert there.picture_place.mesh.vertices[:, 1] == pytest.approx(picture - way)
    assert there.display.mesh.vertices[:, 1] == pytest.approx(display - way)
    assert way_to_glass(there) == pytest.approx(0.0, abs=1e-12)  # no display is within the glass


def test_the_plate_images_the_display_where_the_picture_moves():
    """The picture goes to the ball's face, 25 mm nearer, and its mirror image in the plate is on
    the display.
    """
    rig = ball_rig(4)
    way = way_to_glass(rig)
    assert way == pytest.approx(0.025, abs=1e-4)
    there = nearer(rig, way)
    corner, *_ = rig.plates[0].mesh.vertices
    a, b, c = rig.plates[0].mesh.corners[0]
    normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    for one in (rig, there):
        middle = one.picture_place.mesh.vertices.mean(axis=0)
        image = middle - 2 * ((middle - corner) @ normal) * normal
        assert one.display.mesh.vertices.mean(axis=0) == pytest.approx(image, abs=1e-9)


def test_no_way_to_the_glass_for_a_picture_without_a_plane():
    rig = ball_rig(4)
    place = replace(rig.picture_place, mesh=None)
    assert way_to_glass(replace(rig, pictures=(place,))) == 0.0


def test_a_remedy_that_was_measured_to_help_too_little_is_not_told(monkeypatch):
    """Each amount is tried until the picture can be read; a gain under WORTH_READING is none."""
    measured = {10: 0.45, 100: 0.69, "kiriko.move_to_glass": 0.4 + WORTH_READING / 2}
    monkeypatch.setattr(helps_module, "with_help", lambda rig, help: help)

    def card_of(help, settings, kept):
        yield 0.0
        return measured.get(help.operator, measured.get(help.amount))

    monkeypatch.setattr(helps_module, "card_legibility", card_of)
    (help,) = run_steps(legible_by(ball_rig(4), Settings(), 0.4))
    assert (help.operator, help.amount, help.after) == ("kiriko.smooth_glass", 100, 0.69)
    measured[10] = READABLE
    (help,) = run_steps(legible_by(ball_rig(4), Settings(), 0.4))
    assert (help.amount, help.after) == (10, READABLE)


def test_nothing_seen_is_not_legible():
    assert likeness(np.zeros((4, 4)), np.ones((4, 4)), np.ones((4, 4))) == 0.0
    assert likeness(np.ones((4, 4)), np.eye(4), np.zeros((4, 4))) == 0.0
