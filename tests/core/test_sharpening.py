"""Sharpened source images, against the conditions of an optimum and against what they promise."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.image.seen_quality import quality
from kiriko.core.rig.dispersion import AbbeIndex
from kiriko.core.rig.views import Views
from kiriko.core.solve import sharpening
from kiriko.core.solve.session import Session
from kiriko.core.solve.sharpening import Looker, SeenMatrix, sharpen
from known.reference_rigs import ball_rig, cube_rig, zone_plate
from known.work import drain, solve


def with_pupil(a_rig, pupil, focus=None):
    viewer = replace(a_rig.viewer, pupil=pupil, focus=focus)
    return replace(a_rig, viewers=(viewer,))


def tiny(**options):
    image = np.random.default_rng(0).random((12, 12, 4)).astype(np.float32)
    image[..., 3] = 1
    return cube_rig(**{"pixels": 10, "display_pixels": 14, "image": image} | options)


def matrix_of(solution, number=0):
    """The dense matrix (h w, H W), a column for each display pixel, from seen images alone."""
    height, width = solution.source.shape[:2]
    ones = np.eye(height * width, dtype=np.float32).reshape(height, width, -1)
    views = solution.views[number]
    run_steps(views.trace())
    return run_steps(views.seeing(ones)).reshape(-1, height * width).astype(float)


@pytest.mark.parametrize("black", [0.0, 0.1])
def test_the_light_is_the_optimum_within_its_bounds(black, monkeypatch):
    """Two viewers, one with a pupil: at the least squares' minimum the gradient vanishes where the
    light is free, and pushes against the bound where it is not (Karush, Kuhn and Tucker).
    """
    monkeypatch.setattr(sharpening, "LEAST_GAIN", 1e-9)
    monkeypatch.setattr(sharpening, "MOST_STEPS", 20000)
    a_rig = tiny()
    one = replace(a_rig.viewer, pupil=0.02, focus=1.3)
    aside = one.position + np.array([0.02, 0, 0])
    other = replace(a_rig.viewer, name="b", weight=0.5, position=aside)
    display = replace(a_rig.display, black_level=black)
    a_rig = replace(a_rig, viewers=(one, other), displays=(display,))
    solution = solve(a_rig, sharpen=True)
    light = display.light_of(solution.source).reshape(-1, 3).astype(float)

    gradient = 0.0
    is_seen = np.zeros(len(light), bool)
    for k, (channel, weight) in enumerate(zip(solution.channels, (1.0, 0.5), strict=True)):
        a = matrix_of(solution, k)
        cover = np.minimum(a.sum(axis=1), 1.0)  # without throughput
        target = cover[:, None] * channel.ideal().reshape(-1, 3)
        gradient = gradient + weight * a.T @ (a @ light - target)
        is_seen |= a.sum(axis=0) > 0
    least = (light < black + 1e-6) & is_seen[:, None]
    most = (light > 1 - 1e-6) & is_seen[:, None]
    free = is_seen[:, None] & ~least & ~most
    assert free.sum() > 50
    assert least.sum() > 5
    assert most.sum() > 5
    assert np.abs(gradient[free]).max() < 1e-4
    assert gradient[least].min() > -1e-4
    assert gradient[most].max() < 1e-4
    unseen = ~is_seen.reshape(14, 14)
    assert (solution.source[unseen] == solve(a_rig).source[unseen]).all()


def test_the_matrix_and_its_transpose_agree():
    """<A x, r> = <x, A^T r>, with entries cached and made again."""
    a_rig = with_pupil(ball_rig(3, pixels=40, display_pixels=50), 0.004)
    solution = solve(a_rig, brightness=True)
    run_steps(solution.views[0].trace())
    random = np.random.default_rng(1)
    x, r = random.random((2, 50, 50)), random.random((2, 40, 40))
    matrix = SeenMatrix(solution.views[0])
    for _ in range(2):
        left = (run_steps(matrix.seen(x)) * r).sum()
        assert left == pytest.approx((x * run_steps(matrix.back(r))).sum(), rel=1e-12)


@pytest.mark.parametrize("pupil", [0.0, 0.004])
def test_sharpening_gains_two_decibels_as_seen(pupil):
    """By the report, and by the seen images of the two source images."""
    image = zone_plate(512, 10)
    a_rig = with_pupil(ball_rig(4, pixels=96, field=0.044, display_pixels=96, image=image), pupil)
    session = Session()
    plain, sharp = solve(a_rig, session), solve(a_rig, session, sharpen=True)
    report = sharp.sharpened
    assert report.after[0].psnr >= report.before[0].psnr + 2
    assert report.after[0].ssim > report.before[0].ssim
    assert "sharpening" in sharp.used
    assert sharp.source.min() >= 0
    assert sharp.source.max() <= 1

    ideal = sharp.ideal()
    off = [run_steps(sharp.seeing_with_pupil(one.source)) - ideal for one in (plain, sharp)]
    inside = np.s_[30:66, 30:66]
    gain = 10 * np.log10((off[0][inside] ** 2).mean() / (off[1][inside] ** 2).mean())
    assert gain >= 2
    again = solve(a_rig, session, sharpen=True)
    assert again.sharpened is report
    assert (solve(a_rig, session).source == plain.source).all()


def test_light_of_another_wavelength_counts_only_for_its_colours():
    """A matrix with weights (1, 0, 0) changes red alone."""
    solution = solve(tiny())
    run_steps(solution.views[0].trace())
    looker = Looker(SeenMatrix(solution.views[0]), solution.ideal(), np.array([1.0, 0, 0]))
    found = drain(sharpen([looker], solution.source, 0.0)).light
    assert (found[..., 1:] == solution.source[..., 1:]).all()
    assert (found[..., 0] != solution.source[..., 0]).any()


def test_the_figures_of_quality_have_closed_forms():
    """An offset of 0.1 has 20 dB; light 0.2 above a flat ideal rings by 0.2; equal images are 1."""
    ideal = np.full((30, 30, 3), 0.5)
    whole = np.ones((30, 30), bool)
    same = quality(ideal, ideal, whole)
    assert (same.psnr, same.ringing) == (None, 0.0)
    assert same.ssim == pytest.approx(1)
    off = quality(ideal + 0.1, ideal, whole)
    assert (off.psnr, off.ringing) == pytest.approx((20.0, 0.1))
    step = np.zeros((30, 30, 3))
    step[:, 15:] = 1
    blurred = step.copy()
    blurred[:, 14:16] = 0.5
    assert quality(blurred, step, whole).ringing == 0
    assert quality(blurred, step, whole).ssim < 1
    assert quality(ideal, ideal, ~whole) is None


@pytest.mark.parametrize("kind", ["views", "dispersion"])
def test_quilts_and_dispersed_light_are_sharpened(kind):
    """Each through its own shares: what all viewers see comes nearer to their pictures."""
    image = zone_plate(256, 8)
    a_rig = with_pupil(ball_rig(4, pixels=64, field=0.044, display_pixels=64, image=image), 0.004)
    if kind == "views":
        views = Views(8, cone=(np.radians(60.0), 0.0))
        a_rig = replace(a_rig, displays=(replace(a_rig.display, views=views),))
        turn = np.radians(5.0)
        aside = replace(
            a_rig.viewer, name="aside", position=[np.sin(turn), -np.cos(turn), 0] * np.ones(3)
        )
        axes = np.array(
            [[np.cos(turn), np.sin(turn), 0], [0, 0, 1], [-np.sin(turn), np.cos(turn), 0]]
        )
        a_rig = replace(a_rig, viewers=(a_rig.viewer, replace(aside, axes=axes)))
    else:
        (glass,) = a_rig.glasses
        a_rig = replace(a_rig, glasses=(replace(glass, ior=AbbeIndex(glass.ior.value, 20.0)),))
    session = Session()
    plain, sharp = solve(a_rig, session), solve(a_rig, session, sharpen=True)
    report = sharp.sharpened
    assert len(sharp.views) == (2 if kind == "views" else 3)
    assert sharp.source.shape == plain.source.shape
    assert all(x.psnr > y.psnr + 1 for x, y in zip(report.after, report.before, strict=True))
    seen = [run_steps(sharp.seeing_with_pupil(one.source)) for one in (plain, sharp)]
    inside = np.s_[24:40, 24:40]
    off = [((one - sharp.ideal())[inside] ** 2).mean() for one in seen]
    assert off[1] < off[0] / 10**0.1


def test_a_session_sharpens_again_for_another_black():
    """Its light has another bound, though the painted light is the same."""
    a_rig = cube_rig(pixels=32, display_pixels=32, image=zone_plate(64, 8))
    other = replace(a_rig, displays=(replace(a_rig.display, black_level=0.3),))
    session = Session()
    solve(a_rig, session, sharpen=True)
    again, fresh = solve(other, session, sharpen=True), solve(other, sharpen=True)
    assert again.sharpened.figures == fresh.sharpened.figures
    assert (again.source == fresh.source).all()
