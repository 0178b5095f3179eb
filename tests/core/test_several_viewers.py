"""Several viewers of one display: what they ask of it, how that is settled, what each sees."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base import free_memory
from kiriko.core.base.errors import RigError
from kiriko.core.image.source_image import splat
from kiriko.core.lab.measure.viewer_errors import conflict_in_light, displaced, viewer_reports
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.map import shares
from kiriko.core.native import loading
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known import closed_forms
from known.reference_rigs import ball_rig, bottle, box, icosphere, lattice_image, rig
from known.work import drain, solve

THICKNESS = 0.02
SLAB = box([0.3, THICKNESS, 0.3])
FINE = {"tolerance": 1e-6}


def ramp(size=64):
    """A picture whose colour tells the place."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    return np.stack([x, y, 0 * x + 0.25, 0 * x + 1], axis=2).astype(np.float32)


def waves(size=64):
    """A smooth picture without symmetries."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    waves = 0.5 + 0.4 * np.sin(7 * x + 3 * y), 0.5 + 0.4 * np.cos(5 * y - 2 * x * y)
    return np.stack([*waves, x * y, np.ones_like(x)], axis=2).astype(np.float32)


def aside(viewer, right, up=0.0, name="aside", **changes):
    """The same viewer, moved by some m, and turned to the origin again."""
    position = viewer.position + np.array([right, 0, up])
    forward = -position / np.linalg.norm(position)
    across = np.cross(forward, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(across, forward), forward])
    return replace(viewer, position=position, axes=axes, name=name, **changes)


def eyes(a_rig, apart=0.2, weights=(1.0, 1.0)):
    """The rig with two eyes in place of its viewer."""
    places = zip((-apart / 2, apart / 2), ("left", "right"), weights, strict=True)
    viewers = tuple(aside(a_rig.viewer, x, 0.03, name, weight=w) for x, name, w in places)
    return replace(a_rig, viewers=viewers)


def slab_rig(**options):
    return rig(SLAB, **{"pixels": 64, "display_pixels": 64, "image": ramp()} | options)


def asked(a_rig, viewer, xy):
    """Display px on which the rays of viewer px (n, 2) land by the closed form of the slab, and the
    places of the picture, m from its middle, that are seen there straight.
    """
    o, d = viewer.rays(xy)
    near = np.array([0, -THICKNESS / 2, 0])
    out = closed_forms.through_slab(o, d, np.array([0, -1.0, 0]), near, THICKNESS, 1.49)
    straight = o - (o[:, 1] / d[:, 1])[:, None] * d
    return closed_forms.landing(a_rig, *out), straight[:, [0, 2]]


def asked_at(a_rig, viewer, at):
    """The places of the picture, m, that a viewer asks display px (n, 2) to show."""
    xy = np.full(at.shape, viewer.width / 2)
    for _ in range(30):
        here, straight = asked(a_rig, viewer, xy)
        by = [(asked(a_rig, viewer, xy + 1e-3 * e)[0] - here) / 1e-3 for e in np.eye(2)]
        step = np.linalg.solve(np.stack(by, axis=2), (at - here)[..., None])[..., 0]
        xy = xy + step
    assert np.abs(step).max() < 1e-9
    return straight


def off_in_view(viewer, xy, places):
    """By how many viewer px (n,) places of the picture, m, are seen straight beside xy (n, 2)."""
    points = np.stack([places[:, 0], 0 * places[:, 0], places[:, 1]], axis=1)
    return np.linalg.norm(viewer.project(points) - xy, axis=1)


@pytest.mark.parametrize("disagreement", ["sharp", "blended"])
def test_without_glass_all_viewers_agree(disagreement):
    """Index 1: no conflict but rounding, and the source image is that of any of them. By
    orthographic viewers, whose maps are affine, so that a pixel's mean is the place of its middle.
    """
    a_rig = slab_rig(ior=1.0, display=0.025, projection="orthographic", field=0.08)
    a_rig = eyes(a_rig)  # the display is smaller than the picture, all of which the ramp goes over
    both = solve(a_rig, disagreement=disagreement)
    assert both.settled.conflict.max() < 1e-9
    alone = [solve(replace(a_rig, viewers=(viewer,))) for viewer in a_rig.viewers]
    overlap = np.minimum(*(one.display_coverage for one in alone)) > 0.999
    assert overlap.mean() > 0.3
    for one in alone:
        np.testing.assert_allclose(both.source[overlap], one.source[overlap], atol=1e-6)
    off, conflict = drain(conflict_in_light(both))
    assert max(off) < 1e-6
    assert conflict[overlap].max() < 1e-6


@pytest.mark.parametrize("display", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("disagreement", ["sharp", "blended"])
def test_a_pixel_that_a_frame_cuts_is_no_disagreement(display, disagreement):
    """Index 1, viewers side by side whose images end on the display: each sees another part of the
    pixels there, and asks for the place of that part.
    """
    a_rig = slab_rig(ior=1.0, display=display, display_pixels=32)
    beside = replace(
        a_rig.viewer, position=a_rig.viewer.position + 0.01 * a_rig.viewer.axes[0], name="beside"
    )
    both = solve(replace(a_rig, viewers=(a_rig.viewer, beside)), disagreement=disagreement, **FINE)
    seen = [placed.coverage.of_display for placed in both.channels]
    assert any(((part > 0.01) & (part < 0.99)).any() for part in seen)
    assert both.settled.conflict.max() < 1e-9


def test_each_of_two_eyes_is_displaced_by_half_of_the_difference():
    """Behind a slab, in closed form: each sees a point where the mean of the two places that the
    eyes ask for is that point, to 1e-6 viewer px.
    """
    a_rig = eyes(slab_rig(display_pixels=512))  # means over a pixel are those of a real display
    solution = solve(a_rig, **FINE)
    wanted = 0.03 * ((np.mgrid[:7, :7] + 0.5) / 7 - 0.5) * [[[-1]], [[1]]]
    points = np.stack([wanted[1].ravel(), wanted[0].ravel()], axis=1)
    for number, viewer in enumerate(a_rig.viewers):
        seen, straight = displaced(solution, number)
        np.testing.assert_allclose(off_in_view(viewer, straight, points), 0, atol=1e-9)
        at, _ = asked(a_rig, viewer, seen)
        own, other = (asked_at(a_rig, v, at) for v in (viewer, a_rig.viewers[1 - number]))
        assert off_in_view(viewer, straight, own).min() > 0.5  # there is something to be settled
        assert off_in_view(viewer, straight, (own + other) / 2).max() < 1e-6


@pytest.mark.parametrize("way", ["kernel", "numpy"])
def test_sharp_paints_the_place_in_the_middle(way):
    """The colour of a ramp in each display pixel is that of the mean place, in closed form."""
    a_rig = eyes(slab_rig(display=0.025), weights=(1.0, 3.0))
    if way == "numpy":
        with loading.off():
            solution = solve(a_rig, **FINE)
    else:
        solution = solve(a_rig, **FINE)
    row, column = (index.ravel() for index in np.mgrid[8:56, 8:56])
    at = np.stack([column, row], axis=1) + 0.5
    left, right = (asked_at(a_rig, viewer, at) for viewer in a_rig.viewers)
    place = (left + 3 * right) / 4 / 0.03 + 0.5
    found = solution.source[row, column]
    np.testing.assert_allclose(found[:, 0], place[:, 0], atol=1e-5)
    np.testing.assert_allclose(found[:, 1], 1 - place[:, 1], atol=1e-5)
    # sqrt(1 * 3) / (1 + 3) is the deviation of two values by these weights, for a difference of 1
    apart = np.linalg.norm(left - right, axis=1) / 0.03 * a_rig.picture.image.shape[1]
    conflict = solution.settled.conflict[row, column]
    np.testing.assert_allclose(conflict, np.sqrt(3) / 4 * apart, rtol=1e-4)


def test_blended_is_the_limit_of_the_splat_over_all_viewers():
    """The distance falls as samples^-1/2, to the end of the ladder."""
    a_rig = eyes(ball_rig(4, pixels=96, display_pixels=48, image=waves()), 0.02, (1, 2.5))
    solution = solve(a_rig, disagreement="blended")
    plan = compile_plan(a_rig, Settings())
    whole = np.minimum(*(one.coverage.of_display for one in solution.channels)) > 0.999
    assert whole.mean() > 0.2
    ladder = np.array([1, 4, 16, 64])
    errors = []
    for spp in ladder:
        difference = drain(splat(plan, int(spp), seed=int(spp)))[whole] - solution.source[whole]
        errors.append(np.sqrt((difference**2).mean()))
    slope = np.polyfit(np.log(ladder), np.log(errors), 1)[0]
    assert -0.6 < slope < -0.42, errors


def test_blended_is_the_mean_of_what_each_asks_for_by_weight():
    """Sum of w a T c over sum of w a T^2, from solves for each alone."""
    a_rig = eyes(slab_rig(image=lattice_image(64)), weights=(1.0, 3.0))
    both = solve(a_rig, disagreement="blended", brightness=True)
    apart = [solve(replace(a_rig, viewers=(v,)), brightness=True) for v in a_rig.viewers]
    total = apart[0].first.coverage.weight[..., None] * apart[0].source
    total = total + 3 * apart[1].first.coverage.weight[..., None] * apart[1].source
    weight = both.weight[..., None]
    is_shown = weight[..., 0] > 1e-3
    mean = total / np.where(weight, weight, 1)
    np.testing.assert_allclose(both.source[is_shown], mean[is_shown], atol=1e-5)


def test_only_a_viewer_that_moved_is_traced_again():
    """Its rays alone are traced, the map of the other stays, and the image is that of a new
    session, bit for bit; a weight or another way to settle it traces nothing.
    """
    a_rig = eyes(ball_rig(3, pixels=48, display_pixels=48, image=lattice_image(64)), 0.02)
    kept = Session()
    before = solve(a_rig, kept)
    left, right = a_rig.viewers
    moved = replace(a_rig, viewers=(left, aside(right, 0.001, name="right")))
    found = solve(moved, kept)
    assert found.channels[0].view_map is before.channels[0].view_map
    assert found.n_rays == found.channels[1].view_map.n_rays > 0
    assert np.array_equal(found.source, solve(moved).source)

    for others, settings in (
        ((left, replace(right, weight=2.0)), {}),
        ((right, left), {}),
        ((left, right), {"disagreement": "blended"}),
        ((left, right), {}),
    ):
        kept = Session()
        solve(a_rig, kept)
        changed = replace(a_rig, viewers=others)
        again = solve(changed, kept, **settings)
        assert again.n_rays == 0
        assert np.array_equal(again.source, solve(changed, **settings).source)

    less = solve(replace(a_rig, viewers=(right,)), kept)
    assert less.n_rays == 0
    assert np.array_equal(less.source, solve(replace(a_rig, viewers=(right,))).source)


@pytest.mark.parametrize("ghosts", ["mean", "strongest"])
@pytest.mark.parametrize("disagreement", ["sharp", "blended"])
def test_shares_of_viewers_are_made_again_alike(monkeypatch, ghosts, disagreement):
    """Kept or made again: the same image. All viewers together keep no more than one would."""
    a_rig = eyes(ball_rig(3, pixels=48, display_pixels=64, image=lattice_image(64)), 0.02)
    expected = solve(a_rig, ghosts=ghosts, disagreement=disagreement)
    n = max(len(channel.shares) for channel in expected.channels)
    assert all(channel.shares.are_cached for channel in expected.channels)
    monkeypatch.setattr(shares, "MOST_CACHED", n)
    found = solve(a_rig, ghosts=ghosts, disagreement=disagreement)
    assert not any(channel.shares.are_cached for channel in found.channels)
    np.testing.assert_allclose(found.source, expected.source, atol=1e-6)


def test_what_is_white_for_all_is_white_whichever_path_is_shown():
    """Two eyes behind a bottle ask for white; the mean of whites is off from none."""
    options = {"pixels": 96, "display_pixels": 96, "field": 0.06, "picture": 0.05, "display": 0.1}
    a_rig = rig(bottle(), image=lattice_image(128), **options)
    white = replace(a_rig.picture, image=np.ones((64, 64, 4), np.float32))
    other = aside(a_rig.viewer, 0.001, name="other")
    a_rig = replace(a_rig, pictures=(white,), viewers=(a_rig.viewer, other))
    plain, strongest = (
        drain(conflict_in_light(solve(a_rig, ghosts=ghosts)))[0] for ghosts in ("mean", "strongest")
    )
    assert max(plain) < 1e-3
    assert max(strongest) < 1e-3


def test_a_viewer_whose_light_is_lost_has_no_error_to_remove():
    a_rig = slab_rig()
    away = aside(a_rig.viewer, 3.0, name="away")  # so far that no light of the plate comes there
    found = solve(replace(a_rig, viewers=(a_rig.viewer, away)))
    assert found.channels[1].coverage.weight.sum() == 0
    (_, unremovable), _ = drain(conflict_in_light(found))
    assert unremovable == 0


def test_a_picture_that_is_no_flat_rectangle_is_blended():
    """Places on it are not compared, and the result says so."""
    a_rig = eyes(slab_rig(image=lattice_image(64)))
    round_one = replace(icosphere(0.01, 2), uv=np.random.default_rng(0).random((320, 3, 2)))
    a_rig = replace(a_rig, pictures=(replace(a_rig.picture, mesh=round_one),))
    sharp, blended = (solve(a_rig, disagreement=way) for way in ("sharp", "blended"))
    assert sharp.settled is None
    assert np.array_equal(sharp.source, blended.source)
    assert [note for note in sharp.notes if "isn't a flat rectangle" in note]
    assert not [note for note in blended.notes if "isn't a flat rectangle" in note]


def test_the_worst_viewer_is_told_first():
    """By the largest displacement; the one that counts most is displaced least."""
    a_rig = slab_rig()
    viewers = tuple(
        aside(a_rig.viewer, x, name=name, weight=weight)
        for x, name, weight in ((-0.1, "left", 8.0), (0.0, "middle", 1.0), (0.1, "right", 1.0))
    )
    reports = drain(viewer_reports(solve(replace(a_rig, viewers=viewers))))
    assert [report.viewer for report in reports] == ["right", "middle", "left"]
    assert reports[0].largest_px > reports[1].largest_px > reports[2].largest_px > 0
    assert [report.n_points for report in reports] == [49, 49, 49]
    # an angle of a pixel in the middle of the image, of a field of 50 mm a metre away
    pixel = np.degrees(0.05 / 64) * 60
    assert reports[0].mean_arcmin == pytest.approx(reports[0].mean_px * pixel, rel=0.02)
    assert all(report.unremovable > 0 for report in reports)


def test_a_viewer_that_sees_nothing_is_told_and_comes_first():
    """Beside others that see all, of whom one is displaced."""
    a_rig = slab_rig()
    viewers = (
        aside(a_rig.viewer, 0.0, name="here"),
        aside(a_rig.viewer, 0.1, name="there"),
        aside(a_rig.viewer, 30.0, name="blind"),
    )
    solution = solve(replace(a_rig, viewers=viewers))
    reports = drain(viewer_reports(solution))
    assert reports[0].viewer == "blind"
    assert (reports[0].coverage, reports[0].n_points, reports[0].largest_px) == (0, 0, None)
    assert reports[1].largest_px >= reports[2].largest_px > 0
    (told,) = [remark for remark in solution.notes if "can't see the picture" in remark]
    assert "'blind'" in told


def test_one_viewer_is_displaced_by_nothing():
    (report,) = drain(viewer_reports(solve(slab_rig())))
    assert report.largest_px == report.largest_arcmin == 0
    assert report.unremovable < 1e-12
    assert report.n_points == 49


BAD = {
    "twice": (lambda a, b: (a, replace(a, weight=2.0)), "2 viewers are named 'left': rename"),
    "of one name": (
        lambda a, b: (a, replace(b, name=a.name)),
        "2 viewers are named 'left': rename or remove all but one",
    ),
    "0": (lambda a, b: (a, replace(b, weight=0.0)), "'right' has Weight 0: set it above 0"),
    "-1": (lambda a, b: (replace(a, weight=-1.0), b), "'left' has Weight -1: set it above 0"),
    "nan": (lambda a, b: (a, replace(b, weight=np.nan)), "has Weight nan: set it above 0"),
    "behind": (
        lambda a, b: (a, replace(b, position=np.array([0.1, 1.0, -0.5]))),
        "The plate 'plate' is between the viewers '(left|right)' and '(left|right)': move",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_viewers_that_cannot_be_are_refused_in_one_sentence(name):
    change, words = BAD[name]
    a_rig = eyes(slab_rig())
    with pytest.raises(RigError, match=rf"^[^.]*{words}[^.]*\.$"):
        solve(replace(a_rig, viewers=change(*a_rig.viewers)))
    with pytest.raises(
        RigError, match="Disagreement is 'loud': set it to one of 'sharp', 'blended'"
    ):
        solve(a_rig, disagreement="loud")


def test_the_memory_of_all_viewers_is_told_before_it_is_taken(monkeypatch):
    """What one may take, nine may not; those whose maps are there need none."""
    a_rig = ball_rig(2, pixels=512, display_pixels=256)
    nine = replace(
        a_rig, viewers=tuple(aside(a_rig.viewer, 0.001 * k, name=str(k)) for k in range(9))
    )
    monkeypatch.setattr(free_memory, "available", lambda: 300e6)
    solve(replace(a_rig, viewers=nine.viewers[:1]))
    with pytest.raises(RigError, match="GB are free"):
        solve(nine)
