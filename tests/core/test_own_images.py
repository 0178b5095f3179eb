"""An image for each viewer, in that viewer's own pixels."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.measure.reference import showing
from kiriko.core.lab.measure.viewer_errors import viewer_reports
from kiriko.core.lab.warp.stmap import warp_map
from kiriko.core.native import loading
from kiriko.core.rig.parts import OwnImage, Picture
from kiriko.core.solve.session import Session
from known import closed_forms
from known.reference_rigs import ball_rig, box, lattice_image, rig
from known.work import drain, solve

SLAB = box([0.3, 0.02, 0.3])
RIGHT = np.array([1.0, 0, 0])


def ramp(width, height, low, high):
    """A picture whose colour goes over its places from a low one to a high one, each (3,)."""
    y, x = (np.mgrid[:height, :width] + 0.5) / [[[height]], [[width]]]
    colours = np.asarray(low) + np.stack([x, y, x], axis=2) * np.subtract(high, low)
    return np.dstack([colours, np.ones_like(x)]).astype(np.float32)


def white(size=8):
    return np.ones((size, size, 4), np.float32)


RAMPS = {
    "left": ramp(64, 64, (0.1, 0.2, 0.3), (0.9, 0.8, 0.7)),
    "right": ramp(96, 32, (0.8, 1.0, 0.1), (0.2, 0.4, 0.5)),
}


def colour_at(image, s, t):
    """The colours (n, 3) of a ramp at places of it, 0..1 to the right and down."""
    first, right, down = image[0, 0, :3], image[0, -1, :3], image[-1, 0, :3]
    height, width = image.shape[:2]
    x = (s * width - 0.5) / (width - 1)
    y = (t * height - 0.5) / (height - 1)
    return first + x[:, None] * (right - first) + y[:, None] * (down - first)


def two(a_rig, apart, images, weights=(1.0, 1.0)):
    """The rig with two viewers side by side that look the same way, each with its image."""
    viewers = tuple(
        replace(a_rig.viewer, position=a_rig.viewer.position + x * RIGHT, name=name, weight=weight)
        for x, name, weight in zip((-apart / 2, apart / 2), ("left", "right"), weights, strict=True)
    )
    own = tuple(OwnImage(name, image) for name, image in images.items())
    picture = Picture("renders", next(iter(images.values())), own=own)
    return replace(a_rig, viewers=viewers, pictures=(picture,))


def straight(apart, images=RAMPS, weights=(1.0, 1.0), **options):
    """Without glass, by orthographic viewers: where each ray lands is an affine map."""
    options = {"pixels": 64, "display_pixels": 80, "field": 0.02, "ior": 1.0} | options
    return two(rig(SLAB, projection="orthographic", **options), apart, images, weights)


def places(a_rig, viewer):
    """Where (2, H * W), 0..1 to the right and down, the middle of each display pixel is on a
    viewer's image, in closed form.
    """
    corners = np.array([[0, 0], [1, 0], [0, 1]]) * [viewer.width, viewer.height]
    at = closed_forms.landing(a_rig, *viewer.rays(corners))
    to_display = np.stack([at[1] - at[0], at[2] - at[0]], axis=1)
    y, x = np.mgrid[: a_rig.display.height, : a_rig.display.width] + 0.5
    return np.linalg.solve(to_display, np.stack([x.ravel(), y.ravel()]) - at[0][:, None])


def is_within(place):
    return ((place > 0.03) & (place < 0.97)).all(axis=0)


@pytest.mark.parametrize("way", ["kernel", "numpy"])
def test_viewers_who_see_other_pixels_each_see_their_image(way):
    """Two viewers beside each other share no display pixel: it shows the very colour of the one's
    image, at the place that the closed form tells, and each sees its own image, undistorted.
    """
    a_rig = straight(0.024)
    if way == "numpy":
        with loading.off():
            found = solve(a_rig)
    else:
        found = solve(a_rig)

    for channel in found.channels:
        place = places(a_rig, channel.viewer)
        inner = is_within(place)
        assert inner.mean() > 0.1
        image = RAMPS[channel.viewer.name]
        shown = found.source.reshape(-1, 3)[inner]
        np.testing.assert_allclose(shown, colour_at(image, *place[:, inner]), atol=1e-5)

        ideal = channel.ideal()
        y, x = (np.mgrid[:64, :64] + 0.5) / 64
        wanted = colour_at(image, x.ravel(), y.ravel()).reshape(64, 64, 3)
        np.testing.assert_allclose(ideal[2:-2, 2:-2], wanted[2:-2, 2:-2], atol=1e-5)
        seen = channel.seen(found.source)
        # two of its pixels, each way, see one of the display, whose middle is half of one off
        np.testing.assert_allclose(seen[4:-4, 4:-4], ideal[4:-4, 4:-4], atol=0.5 * 0.8 / 64 + 1e-5)


@pytest.mark.numpy_alone
def test_a_pixel_that_both_see_shows_the_mean_of_their_colours():
    """By weight, in closed form; beside the overlap each viewer's own colour."""
    a_rig = straight(0.006, weights=(1.0, 3.0))
    found = solve(a_rig)
    left, right = (places(a_rig, viewer) for viewer in a_rig.viewers)
    both = is_within(left) & is_within(right)
    assert both.mean() > 0.05
    colours = [
        colour_at(RAMPS[name], *place[:, both])
        for name, place in (("left", left), ("right", right))
    ]
    shown = found.source.reshape(-1, 3)
    np.testing.assert_allclose(shown[both], (colours[0] + 3 * colours[1]) / 4, atol=1e-5)
    alone = is_within(left) & ((right < -0.03) | (right > 1.03)).any(axis=0)
    assert alone.any()
    np.testing.assert_allclose(shown[alone], colour_at(RAMPS["left"], *left[:, alone]), atol=1e-5)


def test_through_glass_it_is_the_weighted_mean_of_solves_for_each():
    """Sum of w a T c over sum of w a T^2, whichever way a disagreement is settled."""
    a_rig = two(ball_rig(3, pixels=48, display_pixels=48), 0.02, RAMPS, (1.0, 3.0))
    both = solve(a_rig, brightness=True)
    apart = [
        solve(
            replace(a_rig, viewers=(viewer,), pictures=(Picture("one", RAMPS[viewer.name]),)),
            brightness=True,
        )
        for viewer in a_rig.viewers
    ]
    total = apart[0].first.coverage.weight[..., None] * apart[0].source
    total = total + 3 * apart[1].first.coverage.weight[..., None] * apart[1].source
    weight = both.weight[..., None]
    is_shown = weight[..., 0] > 1e-3
    mean = total / np.where(weight, weight, 1)
    np.testing.assert_allclose(both.source[is_shown], mean[is_shown], atol=1e-5)
    assert both.settled is None
    blended = solve(a_rig, brightness=True, disagreement="blended")
    assert np.array_equal(both.source, blended.source)


def test_one_image_for_all_is_the_picture_of_before():
    """Each viewer's own image may be the same: to the bit what one picture gives, blended."""
    image = lattice_image(64)
    a_rig = two(ball_rig(3, pixels=48, display_pixels=48), 0.02, {"left": image, "right": image})
    shared = replace(a_rig, pictures=(Picture("one", image),))
    found, before = solve(a_rig), solve(shared, disagreement="blended")
    assert np.array_equal(found.source, before.source)
    assert before.settled is not None


def test_other_images_trace_nothing_anew():
    """A session gives the bits of a new one, whatever images it solved for before."""
    a_rig = two(ball_rig(3, pixels=48, display_pixels=48), 0.02, RAMPS)
    swapped = dict(zip(RAMPS, reversed(RAMPS.values()), strict=True))
    kept = Session()
    solve(a_rig, kept)
    image = RAMPS["left"]
    for pictures in (
        two(a_rig, 0.0, swapped).pictures,
        (Picture("one", image),),
        a_rig.pictures,
        two(a_rig, 0.0, RAMPS | {"right": lattice_image(64)}).pictures,
    ):
        changed = replace(a_rig, pictures=pictures)
        again, new = solve(changed, kept), solve(changed)
        assert again.n_rays == 0
        assert np.array_equal(again.source, new.source)
        assert (again.settled is None) == (new.settled is None)

    # whose image it is goes by the viewer's name, not by its place in the list
    turned = replace(a_rig, viewers=a_rig.viewers[::-1])
    np.testing.assert_allclose(solve(turned).source, solve(a_rig).source, atol=1e-6)
    alone = solve(replace(a_rig, viewers=a_rig.viewers[1:]), kept)
    one = replace(a_rig, viewers=a_rig.viewers[1:], pictures=(Picture("one", RAMPS["right"]),))
    assert np.array_equal(alone.source, solve(one).source)


def test_what_is_told_of_viewers_with_their_own_images():
    """Nothing is displaced; where both see a pixel and ask for white and black, half of white stays
    off for each.
    """
    a_rig = straight(0.0, {"left": white(), "right": 0 * white() + [0, 0, 0, 1]})
    found = solve(a_rig)
    reports = drain(viewer_reports(found))
    for report in reports:
        assert report.n_points == 49
        assert report.mean_px is report.largest_px is report.largest_arcmin is None
        assert report.unremovable == pytest.approx(0.5, abs=1e-6)
        assert report.psnr == pytest.approx(20 * np.log10(2), abs=1e-3)


def test_maps_go_to_each_viewer_s_own_image():
    """To its size, and the same place in parts of it, in closed form."""
    a_rig = straight(0.0)
    for channel in solve(a_rig).channels:
        stmap = drain(warp_map(channel))
        image = RAMPS[channel.viewer.name]
        assert stmap.to_size == image.shape[1::-1]
        place = places(a_rig, channel.viewer)
        inner = is_within(place)
        st = stmap.st.reshape(-1, 2)[inner]
        np.testing.assert_allclose(st[:, 0], place[0, inner], atol=1e-6)
        np.testing.assert_allclose(st[:, 1], 1 - place[1, inner], atol=1e-6)


def test_another_picture_for_all_takes_the_place_of_each_one_s():
    """As charts that measure a rig are put in the picture's place."""
    a_rig = straight(0.0)
    assert a_rig.has_own_images
    assert not showing(a_rig, white()).has_own_images


def test_what_cannot_be_is_refused_in_one_sentence_and_nothing_is_lost():
    a_rig = straight(0.024)
    kept = Session()
    before = solve(a_rig, kept)

    missing = straight(0.024, {"left": RAMPS["left"]})
    words = r"^The viewer 'right' has no image of its own, but others do: choose one[^.]*\.$"
    with pytest.raises(RigError, match=words):
        solve(missing, kept)

    plane = rig(SLAB).picture.mesh
    on_plane = replace(a_rig, pictures=(replace(a_rig.picture, mesh=plane),))
    with pytest.raises(RigError, match=r"^The picture 'renders' has both a plane[^.]*\.$"):
        solve(on_plane, kept)

    again = solve(a_rig, kept)
    assert again.n_rays == 0
    assert np.array_equal(again.source, before.source)
