"""Light beside the glass: its amount, how it is seen, and how it is suppressed."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.image.glare import StrayLight
from kiriko.core.image.simulation import LUMINANCE
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.map.shares import Coverage
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.rasterised import rasterise
from known.reference_rigs import ball_rig, box, icosphere, lattice_image, rectangle, rig
from known.work import solve


def ball(**options):
    """A ball whose rim sees the display far from where the picture's middle does."""
    sizes = {"picture": 0.036, "field": 0.08, "display": 0.1}
    return ball_rig(3, pixels=96, display_pixels=128, image=lattice_image(128), **sizes, **options)


def two_balls():
    """Glass of two parts, with a bare way between them."""
    glass = tuple(rig(icosphere(0.012, 2, centre=(x, 0, 0))).glasses[0] for x in (-0.014, 0.014))
    return rig(glass, pixels=96, display_pixels=96, image=lattice_image(64), picture=0.04)


def prism():
    """A flat glass, of which the light leaves on several sides."""
    return rig(
        box([0.03] * 3, degrees_about_z=20), pixels=96, display_pixels=128, image=lattice_image(64)
    )


RIGS = {"ball": ball, "two balls": two_balls, "prism": prism}


def bent_display():
    """The ball's rig with a display of two planes: light beyond the plate is traced to it."""
    a_rig = ball()
    display = a_rig.displays[0]
    vertices = display.mesh.vertices + np.array([[0, 0, 0.002]] + 3 * [[0, 0, 0]])
    return replace(
        a_rig, displays=(replace(display, mesh=replace(display.mesh, vertices=vertices)),)
    )


@pytest.mark.parametrize("make", [*RIGS.values(), bent_display], ids=[*RIGS, "bent display"])
def test_light_beside_the_glass_lands_where_it_does_when_it_counts(make):
    """A ray beside the glass still counts as one that missed it.

    It lands where it does when it carries the picture.
    """
    a_rig = make()
    rays = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, 96, (4000, 2)))
    all_count = trace_all(compile_plan(a_rig, Settings(only_through_glass=False)), *rays)
    plain = trace_all(compile_plan(a_rig, Settings()), *rays)
    found = trace_all(compile_plan(a_rig, Settings(suppress_glare=0.5)), *rays)

    assert np.array_equal(found.reason, plain.reason)
    is_beside = all_count.has_arrived & (plain.reason == Reason.MISSED_GLASS)
    assert is_beside.sum() > 100
    assert np.array_equal(found.xy[is_beside], all_count.xy[is_beside])
    assert (found.branch[is_beside] != 0).all()
    assert np.array_equal(found.xy[plain.branch != 0], plain.xy[plain.branch != 0])

    # whatever else has a landing beside the glass is beyond a flat display
    others = (found.branch != 0) & (plain.branch == 0) & ~is_beside
    assert (all_count.reason[others] == Reason.MISSED_DISPLAY).all()


@pytest.mark.parametrize("name", RIGS)
def test_what_is_seen_beside_is_what_is_seen_when_all_light_counts(name):
    """Light beside the glass is added to the view through it,
    whether or not it was followed while solving.
    """
    a_rig = RIGS[name]()
    everything = solve(a_rig, only_through_glass=False)
    source = solve(a_rig).source
    expected = everything.seen(source)
    for glare in (0.0, 0.3):
        found = solve(a_rig, suppress_glare=glare)
        off = np.abs(found.seen(source, past_glass=True) - expected)
        assert (off > 2e-3).mean() < 1e-3  # where the rim is seen in the rim
        assert off.mean() < 1e-5
        assert np.abs(found.seen(source) - expected).max() > 0.05
    np.testing.assert_array_equal(everything.seen(source, past_glass=True), expected)


def test_suppressed_wholly_all_sight_lines_are_alike():
    """With weight 1, and no picture beside the glass, the
    source image is that of light that counts everywhere.
    """
    a_rig = ball()
    found = solve(a_rig, suppress_glare=1.0).source
    expected = solve(a_rig, only_through_glass=False).source
    assert np.abs(found - expected).mean() < 1e-5
    assert np.abs(found - expected).max() < 2e-3
    assert np.abs(found - solve(a_rig).source).max() > 0.05


def test_least_squares_with_weight():
    """Each pixel has the value that minimises the squares, by sums of random rays.

    Light beside the glass is wanted to be 0.
    """
    a_rig = ball()
    n = 400_000
    weight = solve(a_rig).weight
    source = solve(a_rig).source
    xy = np.random.default_rng(2).uniform(0, 96, (n, 2))
    landings = trace_all(
        compile_plan(a_rig, Settings(only_through_glass=False)), *a_rig.viewer.rays(xy)
    )
    is_beside = (
        trace_all(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(xy)).reason
        == Reason.MISSED_GLASS
    )
    is_on, pixel = landings.pixels(128, 128)
    past_glass = (
        np.bincount(pixel[is_on & is_beside], minlength=128 * 128).reshape(128, 128) * 96**2 / n
    )

    for glare in (0.25, 1.0):
        expected = source * (weight / np.maximum(weight + glare * past_glass, 1e-9))[..., None]
        found = solve(a_rig, suppress_glare=glare).source
        contested = (weight > 0.2) & (past_glass > 0.2)
        assert contested.sum() > 100
        difference = (found - expected)[contested]
        assert np.abs(difference).mean() < 0.01
        assert abs(difference.mean()) < 2e-3


def test_more_weight_is_less_glare_and_a_darker_picture():
    """The share of light beside the glass falls with the weight, and so does the light
    through it.
    """
    a_rig = ball()
    session = Session()
    before = None
    for glare in (0.0, 0.1, 0.5, 1.0):
        found = solve(a_rig, session, suppress_glare=glare)
        here = found.first.glare.share, float(found.seen().sum())
        assert before is None or (here[0] < before[0] and here[1] < before[1])
        assert (found.source >= 0).all()
        before = here
    assert solve(a_rig, session, suppress_glare=0.7).n_rays == 0  # the optics are the same
    assert solve(a_rig, session, only_through_glass=False).first.glare is None


def test_coverage_knows_the_glass_alone():
    """The covered, missed and painted shares are told as
    before: light beside the glass carries no picture.
    """
    wide = rectangle([0, 0, 0], [1, 0, 0], [0, 0, 1], 0.06, 0.06)
    a_rig = replace(ball(), pictures=(replace(ball().picture, mesh=wide),))
    one = solve(a_rig)
    other = solve(a_rig, suppress_glare=1.0)
    assert one.picture_coverage < 0.9
    assert other.picture_coverage == pytest.approx(one.picture_coverage, abs=1e-6)
    assert other.misses.keys() == one.misses.keys()
    assert other.misses["missed the glass"] == pytest.approx(
        one.misses["missed the glass"], abs=1e-3
    )
    np.testing.assert_allclose(other.first.view_coverage, one.first.view_coverage, atol=1e-4)
    # strips at the rim, thinner than a pixel, lie before the dark in one and not in the other
    apart = np.abs(other.display_coverage - one.display_coverage)
    assert (apart > 1e-3).mean() < 1e-3
    assert apart.max() < 0.01


def test_the_share_that_is_told_is_the_one_that_is_seen():
    """The share of the light, as a sample of rays has it, is
    that of the seen image: to three standard errors.
    """
    for name, make in RIGS.items():
        found = solve(make())
        through, both = (
            dot_luminance(found.seen(past_glass=past_glass)) for past_glass in (False, True)
        )
        assert found.first.glare.share == pytest.approx(1 - through / both, abs=0.03), name


def dot_luminance(image):
    return float((image @ LUMINANCE).sum())


@pytest.mark.parametrize(
    ("place", "where"),
    [
        ((50, 50), "all around it"),
        ((95, 50), "mostly right of it"),
        ((5, 50), "mostly left of it"),
        ((50, 2), "mostly above it"),
        ((50, 99), "mostly below it"),
        ((2, 2), "mostly above and left of it"),
    ],
)
def test_where_the_glare_is(place, where):
    """Told by the sides of the glass, as the viewer sees it: x to the right, y down."""
    random = np.random.default_rng(1)
    through = random.normal(50, 8, (500, 2))
    past_glass = random.normal(place, 1, (100, 2))
    light = StrayLight(
        np.concatenate([through, past_glass]),
        np.zeros(600, np.int64),
        np.ones(600),
        np.arange(600) >= 500,
        np.ones(600, bool),
    )
    found = light.seen_of(np.ones((1, 1, 3), np.float32))

    assert found.where == where
    assert found.share == pytest.approx(1 / 6)
    assert light.seen_of(np.zeros((1, 1, 3), np.float32)) == (0.0, "")


def test_grown_margins_stay_dark_where_they_would_be_seen():
    """Pixels beside covered ones that are seen beside the glass are not grown into."""
    a_rig = ball()
    plain = solve(a_rig, margin=6)
    held = solve(a_rig, margin=6, suppress_glare=1.0)
    past_glass = Coverage(held.first.view_map.display_size, held.first.view_map.view_size)

    for piece in held.first.view_map.pieces(past_glass=True):
        past_glass.add(
            rasterise(held.first.view_map.display_size, held.first.view_map.view_size, *piece[:3])
        )

    grown = (plain.weight == 0) & (plain.source.max(axis=2) > 0)
    is_beside = past_glass.weight > 0
    assert (grown & is_beside).sum() > 20
    assert (grown & ~is_beside).sum() > 20
    assert (held.source[grown & is_beside] == 0).all()
    assert (
        held.source[grown & ~is_beside].max(axis=1) > 0
    ).mean() > 0.8  # but growth out of the dark


def test_the_error_of_the_map_is_that_of_the_light_through_the_glass():
    """Smooth light beside the glass does not dilute the numbers
    told of the picture: errors, shares and warnings.
    """
    glass = icosphere(0.02, 2, smooth=False)
    a_rig = rig(
        glass, pixels=64, display_pixels=64, field=0.09, display=0.12, image=lattice_image(64)
    )
    one = solve(a_rig)
    other = solve(a_rig, suppress_glare=1.0)

    assert one.first.map_error.sampled > 0.2
    for name in ("unresolved", "sampled", "facet_limited"):
        assert getattr(other.first.map_error, name) == pytest.approx(
            getattr(one.first.map_error, name), abs=0.05
        )

    told = [
        [r.text.split(":")[0][:20] for r in found.remarks if r.is_warning] for found in (one, other)
    ]
    assert len(told[0]) == len(told[1]) > 0


@pytest.mark.parametrize("glare", [-0.1, 1.5, np.nan])
def test_a_weight_that_is_none_is_refused(glare):
    with pytest.raises(RigError, match=r"has Suppress Glare .*: set it from 0 to 1"):
        solve(ball(), suppress_glare=glare)
