import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.bench.picture_light import Spread, points_of, spread_of
from kiriko.core.bench.placement import Proposal, Wishes, propose, rig_of, viewer_of
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import ConstantIndex, Glass, Rig
from kiriko.core.rig.settings import Settings
from known.closed_forms import landing, through_ball
from known.reference_rigs import icosphere

NOTHING = Rig(viewers=(), glasses=(), plates=(), displays=())
BALL = np.array([[-0.025] * 3, [0.025] * 3])


def rig_around(
    glass: Glass, wishes: Wishes, pixels: tuple[int, int] = (64, 64)
) -> tuple[Rig, Proposal]:
    """A rig around one glass, and the proposal for it."""
    proposal = propose(glass.mesh.bounds, wishes)
    bench = Rig(viewers=(), glasses=(glass,), plates=(), displays=())
    return rig_of(proposal, bench, viewer_of(proposal, pixels), pixels), proposal


def spread_around(glass: Glass, wishes: Wishes) -> tuple[Rig, Spread]:
    rig, proposal = rig_around(glass, wishes)
    return rig, run_steps(spread_of(compile_plan(rig, Settings()), proposal.placement.display))


def ball(ior: float = 1.49) -> Glass:
    return Glass("ball", icosphere(0.025, 5), ConstantIndex(ior))


def test_points_stand_for_the_whole_picture() -> None:
    """Their areas sum to the picture's, and their mean place is its middle."""
    rig, proposal = rig_around(ball(), Wishes(picture=0.03))
    points, uv, area = points_of(rig.picture_place)
    assert area.sum() == pytest.approx(0.03**2, rel=1e-12)
    middle = proposal.placement.picture[:3, 3]
    assert np.average(points, axis=0, weights=area) == pytest.approx(middle, abs=1e-15)
    assert np.average(uv, axis=0, weights=area) == pytest.approx([0.5, 0.5], abs=1e-12)
    assert np.ptp(uv, axis=0) == pytest.approx(
        [1, 1]
    )  # corners are among them: light spreads furthest from there


def test_light_spreads_as_the_closed_form_has_it() -> None:
    """Through a ball the width of the display is that of the
    picture's corners, whose light lands furthest.
    """
    rig, spread = spread_around(ball(), Wishes(picture=0.025))
    corners = rig.picture_place.mesh.vertices
    directions = corners - rig.viewer.position
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    leave = through_ball(
        np.broadcast_to(rig.viewer.position, corners.shape), directions, 0.025, 1.49
    )
    off = np.abs(landing(rig, *leave) - 32).max() / 32
    width = np.ptp(rig.display.mesh.vertices[:, 0])
    assert spread.lost == {}
    assert spread.width(1.0) == pytest.approx(off * width, rel=1e-4)


def test_without_refraction_light_spreads_as_far_as_the_picture() -> None:
    """The plate's image of the picture is as large as the picture.

    Of its area 95 % are sqrt(0.95) of its width.
    """
    _, spread = spread_around(ball(1.0), Wishes(picture=0.025))
    assert spread.width(1.0) == pytest.approx(0.025, rel=1e-9)
    assert spread.width(1.0, 0.95) == pytest.approx(0.025 * np.sqrt(0.95), rel=1e-2)
    assert spread.width(2.0) == pytest.approx(0.05, rel=1e-9)  # twice as wide as high
    assert spread.weight.sum() == pytest.approx(1.0)


def test_shares_that_are_lost_are_areas_of_the_picture() -> None:
    """A display half as wide and high as the picture takes a quarter of it.

    The rest lands beside it.
    """
    _, spread = spread_around(ball(1.0), Wishes(picture=0.025, display=0.0125))
    assert spread.lost == {"missed the display": pytest.approx(0.75, rel=2e-2)}
    assert spread.off_display_weight.sum() == pytest.approx(0.75, rel=2e-2)


def test_a_rig_grows_with_large_glass_only() -> None:
    """Up to 0.1 m the bench is the reference's, from there on it is as much larger as the glass."""
    small = propose(BALL, Wishes())
    large = propose(40 * BALL, Wishes())
    assert (small.viewer_distance, small.plate) == (1.0, 0.488)
    assert (large.viewer_distance, large.plate) == pytest.approx((20.0, 20 * 0.488))
    assert (small.picture, small.field) == pytest.approx((0.025, 0.05))
    assert propose(BALL, Wishes(picture=0.02)).display == pytest.approx(
        0.2
    )  # ten times, until it is traced


def test_the_viewers_longer_side_is_the_field() -> None:
    """Whichever it is; pixels that are not square count by their shape."""
    proposal = propose(BALL, Wishes())
    for pixels, aspect, sides in (
        ((64, 32), 1.0, (0.05, 0.025)),
        ((32, 64), 1.0, (0.025, 0.05)),
        ((50, 50), 2.0, (0.05, 0.025)),
    ):
        left, right, bottom, top = viewer_of(proposal, pixels, aspect).window
        assert (right - left, top - bottom) == pytest.approx(sides)
