"""Dispersion: each wavelength has its own index, and each primary of the display its own map."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.light import mesh_cache
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import main_landings
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.catalogue import GLASSES
from kiriko.core.rig.dispersion import (
    C_LINE,
    F_LINE,
    P3_PRIMARIES,
    SRGB_PRIMARIES,
    VISIBLE,
    WAVELENGTH,
    AbbeIndex,
    ConstantIndex,
    ShiftedIndex,
)
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.closed_forms import abbe_number, landing, through_ball, through_slab
from known.reference_rigs import ball_rig, box, lattice_image, rig
from known.work import drain, solve

# index at 587.6 nm and Abbe number, as published with the coefficients
PUBLISHED = {
    "N-BK7, K9": (1.5168, 64.17, 5e-6, 0.005),
    "N-SF11": (1.78472, 25.68, 5e-6, 0.005),
    "Fused Silica": (1.458464, 67.82, 5e-6, 0.01),
    "Casting Resin (CR-39)": (1.498, 59.3, 5e-6, 1e-6),
}
# indices measured by Sultanova et al. (2009) to 0.001; nm
LINES = (436.8, 486.1, 587.6, 632.8, 703.0, 833.0, 879.0, 1052.0)
MEASURED = {
    "Acrylic": (1.502, 1.497, 1.491, 1.489, 1.486, 1.484, 1.483, 1.481),
    "Polycarbonate": (1.612, 1.599, 1.585, 1.580, 1.575, 1.569, 1.568, 1.565),
    "Polystyrene": (1.617, 1.606, 1.592, 1.587, 1.582, 1.577, 1.576, 1.572),
}


def dispersing(a_rig, abbe=30.0):
    """The rig with an Abbe number for its glass, at the same index."""
    (glass,) = a_rig.glasses
    return replace(a_rig, glasses=(replace(glass, ior=AbbeIndex(glass.ior.value, abbe)),))


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_catalogued_glass_has_its_published_index_and_abbe_number(name):
    """Published with the coefficients: glass codes, and Malitson's own table."""
    nd, abbe, of_index, of_abbe = PUBLISHED[name]
    found = GLASSES[name].dispersion
    assert found.at(587.5618e-9) == pytest.approx(nd, abs=of_index + 1e-6)
    assert abbe_number(found) == pytest.approx(abbe, abs=of_abbe + 0.001)


@pytest.mark.parametrize("name", MEASURED)
def test_a_polymer_has_its_measured_indices(name):
    """One term of Sellmeier fits the measured table to 0.0016, about the accuracy of its digits."""
    found = [GLASSES[name].dispersion.at(1e-9 * nm) for nm in LINES]
    np.testing.assert_allclose(found, MEASURED[name], atol=0.0016)


def test_a_formula_gives_the_index_of_its_product():
    """The catalogue's index is that at the sodium line, rounded."""
    for product in GLASSES.values():
        if product.dispersion is not None:
            is_rough = product.name in ("Acrylic", "Casting Resin (CR-39)")
            digits = 1e-3 if is_rough else 1e-4
            assert product.dispersion.at(589.29e-9) == pytest.approx(product.ior, abs=0.6 * digits)


def test_cauchy_meets_both_lines_exactly():
    """V = (nd - 1) / (nF - nC), and the index at the d line has the same bits."""
    index = AbbeIndex(1.6, 25.0)
    assert index.at(WAVELENGTH) == 1.6
    assert 0.6 / (index.at(F_LINE) - index.at(C_LINE)) == pytest.approx(25.0, rel=1e-12)
    assert abbe_number(index) == pytest.approx(25.0, rel=1e-12)
    assert abbe_number(ConstantIndex(1.6)) == np.inf


def test_a_shifted_index_has_the_slope_of_its_formula():
    """The artist's index at the d line, to the bit, and the formula's differences."""
    formula = GLASSES["N-SF11"].dispersion
    index = ShiftedIndex(formula, 1.5)
    assert index.at(WAVELENGTH) == 1.5
    step = index.at(464e-9) - index.at(611e-9)
    assert step == pytest.approx(formula.at(464e-9) - formula.at(611e-9), rel=1e-12)


def test_numbers_out_of_bounds_are_refused_in_one_sentence():
    """A wavelength outside a formula, an Abbe number of 0 or less, and primaries nobody sees."""
    with pytest.raises(RigError, match=r"wavelength of 400 nm is outside .*436\.8 to 1052"):
        GLASSES["Acrylic"].dispersion.at(400e-9)
    small = ball_rig(2, pixels=16, display_pixels=16)
    for abbe in (0.0, -5.0, np.nan):
        with pytest.raises(RigError, match="Abbe Number"):
            dispersing(small, abbe).check()
    display = replace(small.displays[0], primaries=(611e-9, 549e-9, 1e-9))
    with pytest.raises(RigError, match="Primaries 1: set it from 360 to 830"):
        replace(small, displays=(display,)).check()


@pytest.mark.parametrize("wavelength", SRGB_PRIMARIES)
@pytest.mark.parametrize("shape", ["slab", "ball"])
def test_light_of_each_colour_lands_by_its_closed_form(shape, wavelength):
    """Snell's law with the index of its wavelength: a slab to 1e-9 px, a ball to 1e-9 m."""
    mesh_rig = rig(box([0.06, 0.02, 0.06])) if shape == "slab" else ball_rig(6)
    a_rig = dispersing(mesh_rig)
    n = a_rig.glasses[0].ior.at(wavelength)
    assert abs(n - 1.49) > 1e-4
    viewer = a_rig.viewers[0]
    xy = np.random.default_rng(1).uniform(160, 352, (500, 2))
    o, d = viewer.rays(xy)
    if shape == "slab":
        out = through_slab(o, d, np.array([0, -1.0, 0]), np.array([0, -0.01, 0]), 0.02, n)
    else:
        out = through_ball(o, d, 0.025, n)
    plan = compile_plan(a_rig, Settings(wavelength=wavelength))
    found = main_landings(trace_all(plan, o, d), len(xy))
    off = np.abs(found.xy - landing(a_rig, *out))[found.has_arrived]
    assert len(off) > 100
    pixel = 0.05 / 512
    assert off.max() < (1e-9 if shape == "slab" else 1e-9 / pixel)


def test_each_colour_is_seen_where_it_belongs():
    """Through a ball, each colour of the source image is the source image of a solve at its
    wavelength, and the seen image joins what each channel sees.
    """
    small = dispersing(ball_rig(3, pixels=64, display_pixels=96, image=lattice_image(64)))
    found = solve(small)
    (channel,) = found.channels
    assert [one.wavelength for one in channel.colours] == list(SRGB_PRIMARIES)
    seen, ideal = found.seen(), found.ideal()
    for k, wavelength in enumerate(SRGB_PRIMARIES):
        alone = drain(
            Session().solve(small.in_one_colour(wavelength), Settings(wavelength=wavelength))
        )
        np.testing.assert_array_equal(found.source[..., k], alone.source[..., k])
        np.testing.assert_array_equal(seen[..., k], alone.seen()[..., k])
    weights = [one.coverage.weight for one in channel.colours]
    np.testing.assert_array_equal(found.weight, weights[0] + weights[1] + weights[2])
    both = channel.seen(np.concatenate([found.source, found.source], axis=2))
    np.testing.assert_array_equal(both[..., 3:], seen)
    assert np.abs(seen - ideal).mean() < 0.01
    assert "a map for each colour" in found.used


def test_one_map_serves_all_colours_that_land_together():
    """Weak dispersion: one map, whose image is that without dispersion, and the distance between
    the colours is reported; it is in proportion to 1 / V.
    """
    small = ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64))
    plain, weak = solve(small), solve(dispersing(small, 3e4))
    np.testing.assert_array_equal(weak.source, plain.source)
    assert weak.n_rays == plain.n_rays
    assert plain.colour is None
    assert weak.colour.is_one_map
    assert any("at most" in str(name) for name in weak.left_out)
    strong = solve(dispersing(small, 30.0))
    assert strong.colour.apart == pytest.approx(1e3 * weak.colour.apart, rel=0.05)


def test_maps_of_three_colours_are_traced_from_one_preparation(monkeypatch):
    """The fit of the mesh does not depend on the index: the surface is made once."""
    made = []
    make = mesh_cache.solid_steps
    monkeypatch.setattr(mesh_cache, "solid_steps", lambda mesh: (made.append(mesh), make(mesh))[1])
    small = ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64))
    assert len(solve(dispersing(small)).first.colours) == 3
    assert len(made) == 1


def test_lateral_colour_is_that_of_the_closed_form():
    """Before: through a ball, red and blue landings at one display point are seen as far apart as
    the closed forms of both colours say; after: within the tolerance of the maps.
    """
    small = dispersing(ball_rig(6, pixels=96, display_pixels=256, image=lattice_image(64)))
    found = solve(small, tolerance=0.01)
    viewer = small.viewers[0]

    def lands(xy, wavelength):
        n = small.glasses[0].ior.at(wavelength)
        return landing(small, *through_ball(*viewer.rays(xy), 0.025, n))

    spread = np.array([0.7548776662466927, 0.5698402909980532])
    xy = 96 * ((0.5 + np.arange(1024)[:, None] * spread) % 1)
    red, green, blue = SRGB_PRIMARIES
    target = lands(xy, green)
    places = []
    for wavelength in (red, blue):
        at = xy.copy()
        for _ in range(8):  # Newton
            miss = target - lands(at, wavelength)
            sides = [
                (lands(at + 1e-3 * e, wavelength) - lands(at, wavelength)) / 1e-3 for e in np.eye(2)
            ]
            slope = np.stack(sides, axis=2)
            at = (
                at
                + np.linalg.solve(np.nan_to_num(slope) + 1e-12 * np.eye(2), miss[..., None])[..., 0]
            )
        places.append(at)
    apart = np.linalg.norm(places[0] - places[1], axis=1)
    middle = np.linalg.norm(xy - 48, axis=1) < 20
    assert found.colour.before.largest_px >= np.nanmax(apart[middle]) > 0.01
    assert found.colour.after.largest_px < 0.05 * found.colour.before.largest_px
    assert found.colour.after.mean_px < 0.001 * found.colour.before.mean_px
    tangent = viewer.window[1] / 48  # per px, at the middle
    assert found.colour.before.mean_arcmin == pytest.approx(
        found.colour.before.mean_px * np.degrees(tangent) * 60, rel=0.01
    )


def test_another_display_has_other_primaries():
    """Display P3's red is deeper: the colours land further apart."""
    small = dispersing(ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64)))
    wide = replace(small, displays=(replace(small.displays[0], primaries=P3_PRIMARIES),))
    assert solve(wide).colour.apart > solve(small).colour.apart


def test_an_abbe_number_leaves_the_index_of_visible_light_above_0():
    """At the least Abbe number, Cauchy's index is 0 at the red end of visible light."""
    lines = F_LINE**-2 - C_LINE**-2
    least = 0.49 / 1.49 * (WAVELENGTH**-2 - VISIBLE[1] ** -2) / lines
    assert AbbeIndex(1.49, least).at(VISIBLE[1]) == pytest.approx(0, abs=1e-12)
    AbbeIndex(1.49, 1.001 * least).check("The glass")
    with pytest.raises(RigError, match=r"set it above 0\.2487"):
        AbbeIndex(1.49, 0.999 * least).check("The glass")
