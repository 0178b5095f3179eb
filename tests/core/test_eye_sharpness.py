"""Sharpness through a pupil, against slab, lens and ball in closed form."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.image.flat_picture import view_of_picture
from kiriko.core.lab.measure.places_seen import grid_on
from kiriko.core.lab.measure.sharpness import as_svg, check_pupils, sharpness_of
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import ConstantIndex, Glass, Lens
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.reference_rigs import ball_rig, box, rectangle
from known.work import drain

X, Y, Z = np.eye(3)
INDEX, THICK, BEFORE, BEHIND = 1.5, 0.06, 0.3, 0.2  # m, of the slab, and the air around it


def bench(pupil=0.004, wide=0.2, **parts):
    """A viewer at the origin, and a display behind glass; the picture is 0.4 m away."""
    base = ball_rig(2, pixels=256)
    eye = replace(
        base.viewer, position=0 * Y, window=(-0.5, 0.5, -0.5, 0.5), pupil=pupil, focus=None
    )
    far = BEFORE + THICK + BEHIND
    display = replace(
        base.display, mesh=rectangle(far * Y, X, Z, 1.0, 1.0), width=1000, height=1000
    )
    picture = replace(base.picture, mesh=rectangle(0.4 * Y, X, Z, wide, wide))
    parts = {"glasses": (), "plates": ()} | parts
    return replace(base, viewers=(eye,), displays=(display,), pictures=(picture,), **parts)


def slab():
    mesh = box([2.0, THICK, 2.0], (BEFORE + THICK / 2) * Y)
    return (Glass("slab", mesh, ConstantIndex(INDEX)),)


def found(a_rig, n=5, **settings):
    (one,) = drain(sharpness_of(compile_plan(a_rig, Settings(**settings)), n))
    return one


def lines_of_sight(a_rig, n=5):
    uv = grid_on(a_rig.picture_place, n)
    return a_rig.viewer.rays(view_of_picture(a_rig.picture_place, a_rig.viewer, uv))[1]


def test_a_slab_moves_and_splits_the_focus():
    """Along a ray at i in air and r in glass the distances are a + t / n + b across the plane of
    incidence, and a + t cos^2 i / (n cos^2 r) + b in it (Coddington), along the ray.
    """
    a_rig = bench(glasses=slab())
    one = found(a_rig)
    d = lines_of_sight(a_rig)
    for v, at in zip(one.vergence.reshape(-1, 2, 2), d, strict=True):
        cos_i = at @ Y
        cos_r = np.sqrt(1 - (1 - cos_i**2) / INDEX**2)
        air, glass = (BEFORE + BEHIND) / cos_i, THICK / cos_r
        across = 1 / (air + glass / INDEX)
        within = 1 / (air + glass * cos_i**2 / (INDEX * cos_r**2))
        assert np.sort(np.linalg.eigvals(v)) == pytest.approx(sorted([across, within]), rel=1e-6)
        assert v[0, 1] == pytest.approx(v[1, 0], abs=1e-6)
        if cos_i < 1 - 1e-9:
            right = X - (X @ at) * at
            right /= np.linalg.norm(right)
            plane = (Y - cos_i * at) / np.sqrt(1 - cos_i**2)
            t = np.array([plane @ right, plane @ np.cross(right, at)])
            assert t @ v @ t == pytest.approx(within, rel=1e-6)
    middle = one.best_focus[2, 2]
    assert middle == pytest.approx(1 / (BEFORE + THICK / INDEX + BEHIND), rel=1e-6)
    assert one.picture[2, 2] == pytest.approx(1 / 0.4)


def test_a_focus_off_by_v_makes_a_disc_of_pupil_times_v():
    """Its rms is the diameter / sqrt 8, and 2 J1(x) / x is a half at x = 2.21508."""
    one = found(bench(wide=0.02, glasses=slab()))
    off = 1 / 0.4 - one.best_focus[2, 2]
    blur = np.degrees(0.004 * off)
    assert one.rms[2, 2] == pytest.approx(60 * blur / 8**0.5, rel=0.01)
    assert one.mtf50[2, 2] == pytest.approx(2.21508 / (np.pi * blur), rel=0.02)


def test_a_display_in_the_picture_is_sharp():
    """No glass, display and picture in one plane: no spot, and the vergence of the distance."""
    far = BEFORE + THICK + BEHIND
    a_rig = bench(glasses=slab(), pupil=0.006)
    a_rig = replace(
        a_rig,
        glasses=(replace(a_rig.glasses[0], ior=ConstantIndex(1.0)),),
        pictures=(replace(a_rig.picture, mesh=rectangle(far * Y, X, Z, 0.2, 0.2)),),
    )
    one = found(a_rig)
    assert one.rms.max() < 1e-6
    assert one.best_focus == pytest.approx(one.picture, rel=1e-7)


def test_a_thin_lens_has_its_conjugate():
    """From the lens the display appears at q with 1 / q = 1 / b - 1 / f, before the axis' eye."""
    lens = Lens("lens", rectangle(BEFORE * Y, X, Z, 0.5, 0.5), 0.7)
    one = found(bench(wide=0.02, lenses=(lens,)), only_through_glass=False)
    apparent = 1 / (1 / (THICK + BEHIND) - 1 / 0.7)
    assert one.vergence[2, 2] == pytest.approx(np.eye(2) / (BEFORE + apparent), rel=1e-6, abs=1e-6)


def test_a_ball_as_by_exact_rays():
    """V from landings of the closed form: J_theta^-1 J_s, by differences of its own."""
    base = ball_rig(5, pixels=512, picture=0.02)
    a_rig = replace(base, viewers=(replace(base.viewer, pupil=0.004),))
    one = found(a_rig)

    def lands(o, d):
        return closed_forms.landing(a_rig, *closed_forms.through_ball(o, d, 0.025, 1.49))

    d = lines_of_sight(a_rig)
    right = closed_forms.unit(X - (d @ X)[:, None] * d)
    up = np.cross(right, d)
    o = np.tile(a_rig.viewer.position, (len(d), 1))
    h = 1e-5
    by_angle, by_place = (
        np.stack([(lands(*plus) - lands(*minus)) / (2 * h) for plus, minus in pairs], axis=2)
        for pairs in (
            [
                ((o, closed_forms.unit(d + h * e)), (o, closed_forms.unit(d - h * e)))
                for e in (right, up)
            ],
            [((o + h * e, d), (o - h * e, d)) for e in (right, up)],
        )
    )
    exact = np.linalg.solve(by_angle, by_place).reshape(5, 5, 2, 2)
    assert one.vergence == pytest.approx(exact, rel=1e-3, abs=1e-3)


def test_two_eyes_converge_where_they_look():
    """Both eyes see a display without glass: focus and convergence are at its distance."""
    far = BEFORE + THICK + BEHIND
    a_rig = bench(wide=0.1)
    a_rig = replace(
        a_rig, pictures=(replace(a_rig.picture, mesh=rectangle(far * Y, X, Z, 0.1, 0.1)),)
    )
    eyes = [
        replace(a_rig.viewer, name=name, position=x * X)
        for name, x in (("left", -0.03), ("right", 0.03))
    ]
    plan = compile_plan(replace(a_rig, viewers=tuple(eyes)), Settings(only_through_glass=False))
    left, right = drain(sharpness_of(plan, 5))
    assert (left.viewer, right.viewer) == ("left", "right")
    assert left.converged[2, 2] == pytest.approx(1 / far, rel=1e-6)
    assert np.abs(left.best_focus - left.converged).max() < 0.05  # each from its own place
    data = left.as_data()
    assert data["mean_focus_less_convergence_dioptres"] == pytest.approx(0, abs=0.02)
    assert ET.fromstring(as_svg(plan.rig, [left, right])).tag.endswith("svg")


def test_no_pupil_is_refused():
    with pytest.raises(RigError, match="No viewer has a pupil"):
        check_pupils(bench(pupil=0.0))
