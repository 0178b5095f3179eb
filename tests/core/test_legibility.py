"""Legibility: one number for how well a picture is recognised through the glass."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.bench.helps import smoothing
from kiriko.core.glass.smoothed import smoothed, vertex_normals
from kiriko.core.settings import Settings
from kiriko.core.solve.legibility import READABLE, card, card_legibility, likeness
from kiriko.core.steps import finish
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
    assert finish(card_legibility(clear, settings)) > 0.99
    before = finish(card_legibility(bumpy, settings))
    assert before < READABLE
    help = finish(smoothing(bumpy, settings, before))
    assert help.operator == "kiriko.smooth_glass"
    assert help.after > before + 0.1
    (glass,) = bumpy.glasses
    assert help.part == glass.name
    mended = replace(glass, mesh=smoothed(glass.mesh, round(help.amount)))
    after = finish(card_legibility(replace(bumpy, glasses=(mended,)), settings))
    assert after == pytest.approx(help.after)


def test_nothing_seen_is_not_legible():
    assert likeness(np.zeros((4, 4)), np.ones((4, 4)), np.ones((4, 4))) == 0.0
    assert likeness(np.ones((4, 4)), np.eye(4), np.zeros((4, 4))) == 0.0
