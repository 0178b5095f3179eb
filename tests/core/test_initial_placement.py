"""Where a new picture stands: in the glass as the viewer sees it, as large as gets through."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.bench.initial_placement import ENOUGH, LEAST, Bundle, Request, grid_over, settle
from kiriko.core.bench.picture_light import Spread
from kiriko.core.bench.placement import Proposal, Wishes, propose, rig_of, viewer_of
from kiriko.core.rig.rig import ConstantIndex, Glass, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.brute_force import share_arrived
from known.goblets import goblet
from known.reference_rigs import box, icosphere

PIXELS = 64, 64


def settled(
    *glasses: Glass, wishes: Wishes | None = None, settings: Settings | None = None
) -> tuple[Rig, Proposal, Spread]:
    """A new rig around glasses, with its picture in its place."""
    wishes = wishes or Wishes()
    bounds = np.stack([glass.mesh.bounds for glass in glasses])
    bounds = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    proposal = propose(bounds, wishes)
    bench = Rig(viewers=(), glasses=glasses, plates=(), displays=())
    request = Request(bench, bounds, wishes, viewer_of(proposal, PIXELS), PIXELS)

    session = Session()
    steps = settle(request, proposal, lambda rig: session.plan(rig, settings or Settings()))
    proposal, spread = run_steps(steps)
    return request.rig(proposal), proposal, spread


def test_the_largest_square_ends_at_the_nearest_lost_ray() -> None:
    """By brute force over all squares about each place of a grid of rays with holes."""
    rng = np.random.default_rng(5)
    half = np.array([0.02, 0.03])
    at, step = grid_over(half, 41)
    bundle = Bundle(at, at, rng.uniform(size=len(at)) > 0.02, step, half)
    places = at[rng.choice(len(at), 40)]
    found = bundle.largest(places, 1.0)
    for place, side in zip(places, found, strict=True):
        distance = step * np.round(np.abs(at - place).max(axis=1) / step)
        edge = (half - np.abs(place)).min()
        fits = [
            2 * d + step
            for d in np.unique(distance)
            if bundle.is_good[distance <= d].all() and d <= edge + step / 2
        ]
        assert side == pytest.approx(min(max(fits, default=0.0), 2 * edge), abs=1e-12)


@pytest.mark.parametrize("ior", [1.33, 1.49, 1.6])
def test_a_balls_picture_stands_in_its_centre(ior: float) -> None:
    """To the last bit, half as large as the ball, and all of it arrives."""
    ball = Glass("ball", icosphere(0.025, 4), ConstantIndex(ior))
    _, proposal, spread = settled(ball)
    assert (
        proposal.placement.picture == propose(ball.mesh.bounds, Wishes()).placement.picture
    ).all()
    assert proposal.picture == pytest.approx(0.5 * np.ptp(ball.mesh.bounds[:, 0]), rel=1e-12)
    assert spread.lost == {}


def test_a_goblets_picture_stands_in_its_bowl() -> None:
    """In its axis, all of it arrives, where the middle of the box shows less."""
    rig, proposal, spread = settled(goblet())
    x, y, z = proposal.placement.picture[:3, 3]
    assert (x, y) == pytest.approx((0, 0), abs=1e-3)
    assert z - proposal.picture / 2 > -0.01  # above the stem, whose top is at -10 mm
    assert z + proposal.picture / 2 < 0.1
    assert sum(spread.lost.values()) <= 1 - ENOUGH
    assert share_arrived(rig) > 0.998

    middle = replace(proposal, placement=propose(rig.glasses[0].mesh.bounds, Wishes()).placement)
    bench = Rig(viewers=(), glasses=rig.glasses, plates=(), displays=())
    assert share_arrived(rig_of(middle, bench, rig.viewer, PIXELS)) < 0.8


def test_the_widest_of_several_glasses_has_the_picture() -> None:
    """A rod and a block beside each other: in the middle of the block, at its depth, too."""
    rod = Glass("rod", box((0.01, 0.01, 0.08), (-0.04, 0.0, 0.0)))
    block = Glass("block", box((0.05, 0.02, 0.04), (0.02, 0.03, 0.012)))
    rig, proposal, spread = settled(rod, block)
    assert np.abs(proposal.placement.picture[:3, 3] - (0.02, 0.03, 0.012)).max() < 0.004
    assert spread.lost == {}
    assert share_arrived(rig) == 1.0


def test_the_display_stands_at_the_pictures_image() -> None:
    """Wherever the picture stands: each of its corners, mirrored at the plate, lands there."""
    block = Glass("block", box((0.02, 0.02, 0.02), (0.03, 0.0, 0.02)), ConstantIndex(1.0))
    rod = Glass("rod", box((0.002, 0.002, 0.08), (-0.04, 0.0, 0.0)), ConstantIndex(1.0))
    rig, proposal, spread = settled(block, rod)
    assert proposal.placement.picture[0, 3] > 0.02
    assert spread.width(1.0) == pytest.approx(proposal.picture, rel=1e-9)  # index 1: as it is
    plate = proposal.placement.plate
    away = (proposal.placement.picture[:3, 3] - plate[:3, 3]) @ plate[:3, 2]
    image = proposal.placement.picture[:3, 3] - 2 * away * plate[:3, 2]
    assert proposal.placement.display[:3, 3] == pytest.approx(image, abs=1e-15)
    assert rig.display.mesh.vertices.mean(axis=0) == pytest.approx(image, abs=1e-12)


def test_a_size_that_was_asked_for_is_kept() -> None:
    """The place alone is sought, and what does not get through is told."""
    _, proposal, spread = settled(goblet(), wishes=Wishes(picture=0.1))
    assert proposal.picture == 0.1
    assert sum(spread.lost.values()) > 0.05
    assert proposal.placement.picture[2, 3] > 0.02


def test_a_picture_is_not_made_smaller_than_the_least() -> None:
    """In glass of which little gets through it keeps a quarter of the glass, where most arrives."""
    rng = np.random.default_rng(2)
    ball = icosphere(0.025, 2, smooth=False)
    crystal = Glass(
        "crystal", replace(ball, vertices=ball.vertices * rng.uniform(0.7, 1, (162, 1)))
    )
    _, proposal, spread = settled(crystal)
    bounds = crystal.mesh.bounds
    smaller = min(np.ptp(bounds[:, 0]), np.ptp(bounds[:, 2]))
    assert proposal.picture >= LEAST * smaller * (1 - 1e-12)
    assert spread.weight.sum() > 0.5
