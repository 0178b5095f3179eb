"""How large display, plate and picture have to be for the picture's light."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.part_sizes import (
    ROOM_SPARE,
    Wanted,
    fit_display,
    fit_picture,
    fit_plate,
    plane_of,
    plate_outline,
    resized,
)
from kiriko.core.bench.picture_light import outline_of
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh, Rig
from known.brute_force import share_arrived
from known.goblets import goblet
from known.proposed_rigs import plan_of, rig_around
from known.reference_rigs import box, icosphere


def ball(ior: float = 1.49) -> Glass:
    return Glass("ball", icosphere(0.025, 4), ConstantIndex(ior))


def slab(ior: float) -> Glass:
    return Glass("slab", box((0.1, 0.02, 0.1)), ConstantIndex(ior))


def with_display(rig: Rig, size: float, shift=0.0) -> Rig:
    mesh = rig.display.mesh
    middle = mesh.vertices.mean(axis=0)
    vertices = middle + size * (mesh.vertices - middle) + shift
    return replace(rig, displays=(replace(rig.display, mesh=replace(mesh, vertices=vertices)),))


def with_plate(rig: Rig, size: float, shift=0.0) -> Rig:
    plate = rig.plates[0]
    middle = plate.mesh.vertices.mean(axis=0)
    vertices = middle + size * (plate.mesh.vertices - middle) + shift
    return replace(rig, plates=(replace(plate, mesh=replace(plate.mesh, vertices=vertices)),))


def with_picture(rig: Rig, size: float, shift=0.0) -> Rig:
    place = resized(rig.picture_place, plane_of(rig), size, shift)
    return replace(rig, pictures=(place,))


def through_slab(across: np.ndarray, ior: float, distance: float, thick: float) -> np.ndarray:
    """Where rays at places (n, 2) of the picture's plane, in
    the middle of a slab, come to the picture's image.

    Each goes on in its own direction, moved towards the axis by the slab.
    """
    tangent = np.linalg.norm(across, axis=1, keepdims=True) / distance
    sine = tangent / np.sqrt(1 + tangent**2) / ior
    inner = sine / np.sqrt(1 - sine**2)
    with np.errstate(invalid="ignore"):
        moved = np.where(tangent > 0, thick * (tangent - inner) / (tangent * distance), 0.0)
    return across * (1 - moved)


@pytest.mark.parametrize("ior", [1.0, 1.5, 1.9])
def test_a_slabs_display_is_the_projected_picture(ior: float) -> None:
    """The width that its light takes, by Snell's law, and a hundredth."""
    rig = rig_around(slab(ior), picture=0.05, display=0.02)
    fitted = run_steps(fit_display(rig, plan_of()))
    line = np.linspace(-0.025, 0.025, 1001)
    outline = np.stack([line, np.full_like(line, 0.025)], axis=1)
    half = np.abs(through_slab(outline, ior, 1.0, 0.02)).max()
    assert fitted.width == pytest.approx(ROOM_SPARE * 2 * half, rel=1e-9)
    assert (fitted.after, fitted.lost) == (1.0, {})
    assert fitted.before == pytest.approx((0.02 / (2 * half)) ** 2, rel=0.03)
    assert fitted.more == pytest.approx(fitted.width - 0.02, rel=1e-12)
    assert fitted.for_most == pytest.approx(fitted.width * np.sqrt(0.95), rel=0.01)


@pytest.mark.parametrize("moves", [False, True])
def test_the_plate_is_as_large_as_the_picture_seen_on_it(moves: bool) -> None:
    """With an index of 1 light goes straight: the plate has to
    reach the picture's corners as the viewer sees them on it.
    """
    rig = rig_around(slab(1.0), picture=0.06, plate=0.04, display=0.02)
    rig = with_plate(rig, 1.0, np.array([0.002, 0.0, 0.0]))
    fitted = run_steps(fit_plate(rig, plan_of(), Wanted(moves=moves)))

    # corners on the plate's plane
    outline = plate_outline(rig.plates[0])
    normal = np.cross(*outline.axes)
    ways = rig.picture_place.mesh.vertices - rig.viewer.position
    far = ((outline.middle - rig.viewer.position) @ normal) / (ways @ normal)
    across = outline.across(rig.viewer.position + far[:, None] * ways)
    about = (across.min(axis=0) + across.max(axis=0)) / 2 if moves else np.zeros(2)
    half = np.abs(across - about).max()

    assert fitted.width == pytest.approx(ROOM_SPARE * 2 * half, rel=1e-9)
    assert fitted.shift == pytest.approx(about @ outline.axes, abs=1e-12)
    # the display is too small as before, and nothing else is lost
    assert set(fitted.lost) == {"missed the display"}


def test_a_balls_parts_are_as_large_as_they_have_to_be() -> None:
    """By brute force: all arrives, and not where display or plate are 2 % smaller."""
    rig = rig_around(ball(), picture=0.03, plate=0.4, display=0.02)
    for _ in range(2):
        fitted = run_steps(fit_plate(rig, plan_of()))
        rig = with_plate(rig, fitted.size, fitted.shift)
        fitted = run_steps(fit_display(rig, plan_of()))
        rig = with_display(rig, fitted.size, fitted.shift)

    assert (fitted.after, share_arrived(rig, 150)) == (1.0, 1.0)
    assert share_arrived(with_display(rig, 0.98), 150) < 1
    assert share_arrived(with_plate(rig, 0.98), 150) < 1


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("glass", [ball(), goblet()], ids=["ball", "goblet"])
def test_a_picture_is_as_large_as_gets_through(glass: Glass, moves: bool) -> None:
    """By brute force: all arrives, and not where it is 2 % larger.

    Where it may move it is no smaller.
    """
    rig = rig_around(glass, picture=0.05, display=0.3)
    if glass.name == "goblet":
        rig = with_picture(rig, 1.0, np.array([0.008, 0.0, 0.05]))
    fitted = run_steps(fit_picture(rig, plan_of(), Wanted(moves=moves)))
    changed = with_picture(rig, fitted.size, fitted.shift)
    assert fitted.after == 1.0
    assert share_arrived(changed, 150) == 1.0
    assert share_arrived(with_picture(changed, 1.02), 300) < 1.0
    if moves:
        assert fitted.size >= run_steps(fit_picture(rig, plan_of())).size * 0.99
    else:
        assert (fitted.shift == 0).all()


def test_a_small_picture_grows() -> None:
    """As far as its light lands on the display, but to no more than twice its size."""
    rig = rig_around(slab(1.0), picture=0.02, display=0.03)
    assert run_steps(fit_picture(rig, plan_of())).size == pytest.approx(1.5 / ROOM_SPARE, rel=2e-3)
    rig = rig_around(slab(1.0), picture=0.01, display=0.06)
    assert run_steps(fit_picture(rig, plan_of())).size == 2


def test_a_share_is_as_much_as_was_asked_for() -> None:
    """Of light that spreads as the picture does, 90 % take 0.9 of its area."""
    rig = rig_around(slab(1.0), picture=0.05, display=0.08)
    fitted = run_steps(fit_display(rig, plan_of(), Wanted(share=0.9)))
    assert fitted.width == pytest.approx(ROOM_SPARE * 0.05 * np.sqrt(0.9), rel=0.01)
    assert fitted.after == pytest.approx(0.9 * ROOM_SPARE**2, rel=0.01)


def test_a_hexagon_reaches_as_far_as_its_outline() -> None:
    """Places are within it, scaled by their reach, to the last bit, and not by less."""
    rng = np.random.default_rng(4)
    angle = np.pi / 3 * np.arange(6)
    corners = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    fan = np.array([[0, k, k + 1] for k in range(1, 5)])
    outline = outline_of(Mesh(corners, fan), np.array([1.0, 0, 0]), "It")
    places = rng.uniform(-2, 2, (200, 2))

    # distance to each of the six sides, of the apothem
    sides = np.stack([np.cos(angle + np.pi / 6), np.sin(angle + np.pi / 6)])
    wanted = (places @ sides).max(axis=1) / np.cos(np.pi / 6)
    assert outline.reach(places, np.zeros(2)) == pytest.approx(wanted, rel=1e-12)


def test_what_cannot_be_sized_is_refused_with_a_sentence() -> None:
    """A bent display, a picture of which nothing gets through, one in the viewer's own pixels."""
    rig = rig_around(slab(1.5), picture=0.02, display=0.03)
    bent = rig.display.mesh.vertices.copy()
    bent[0] += 0.01
    display = replace(rig.display, mesh=replace(rig.display.mesh, vertices=bent))
    with pytest.raises(RigError, match="The display 'Kiriko Display' isn't flat"):
        run_steps(fit_display(replace(rig, displays=(display,)), plan_of()))
    with pytest.raises(RigError, match="The display 'Kiriko Display' isn't flat"):
        run_steps(fit_plate(replace(rig, displays=(display,)), plan_of()))
    with pytest.raises(RigError, match="Hardly any of the picture"):
        run_steps(fit_picture(with_display(rig, 1.0, np.array([0.05, 0, 0])), plan_of()))
    with pytest.raises(
        RigError, match="No light of the picture reaches the plane of 'Kiriko Display'"
    ):
        run_steps(fit_display(with_plate(rig, 1.0, np.array([1.0, 0, 0])), plan_of()))
    with pytest.raises(
        RigError, match="No light of the picture reaches the plane of 'Kiriko Plate'"
    ):
        run_steps(fit_plate(with_plate(rig, 0.1, np.array([3.0, 0, 0])), plan_of()))
    own = replace(rig.picture_place, mesh=None)
    with pytest.raises(RigError, match="viewer's pixels"):
        run_steps(fit_picture(replace(rig, pictures=(own,)), plan_of()))
    fitted = run_steps(fit_display(replace(rig, pictures=(own,)), plan_of()))
    assert fitted.after == 1.0  # the whole of the viewer's image


@pytest.mark.parametrize("share", [1.0, 0.999, 0.9])
@pytest.mark.parametrize("size", [0.02, 0.025, 0.05])
def test_a_picture_fits_once(size: float, share: float) -> None:
    """What fits stays as it is; what arrives wholly is made no smaller."""
    rig = rig_around(ball(), picture=size, display=0.3)
    wanted = Wanted(share=share)
    sizes = []
    for _ in range(4):
        fitted = run_steps(fit_picture(rig, plan_of(), wanted))
        assert fitted.size >= 1 or fitted.before < share
        rig = with_picture(rig, fitted.size, fitted.shift)
        sizes.append(fitted.size)
    assert sizes[1:] == [1.0, 1.0, 1.0]


def test_a_limit_that_was_reached_is_told() -> None:
    """Where light goes as far as it was looked for; and nowhere else."""
    rig = rig_around(ball(), picture=0.03, plate=0.4, display=0.02)
    assert run_steps(fit_display(rig, plan_of())).limit == 0
    near = run_steps(fit_display(rig, plan_of(), Wanted(most=1.05)))
    assert near.limit == pytest.approx(1.05 * 0.02, rel=1e-9)
    assert near.size <= 1.05 * ROOM_SPARE
    small = with_plate(rig, 0.05)
    assert run_steps(fit_plate(small, plan_of())).limit == pytest.approx(4 * 0.02, rel=1e-9)
    rig = rig_around(slab(1.0), picture=0.01, display=0.06)
    assert run_steps(fit_picture(rig, plan_of())).limit == pytest.approx(0.02, rel=1e-9)


def aside(rig: Rig, x: float) -> Rig:
    """A rig with a second viewer, x m beside the first."""
    first = rig.viewers[0]
    other = replace(first, name="aside", position=first.position + np.array([x, 0, 0]))
    return replace(rig, viewers=(first, other))


@pytest.mark.parametrize("fit", [fit_display, fit_plate])
def test_a_part_is_as_large_as_that_of_the_viewer_who_needs_most(fit) -> None:
    """With its middle kept; in whatever order the viewers are. All light of both arrives."""
    rig = aside(with_plate(with_display(rig_around(ball(), display=0.5), 0.2), 0.4), 0.02)
    alone = [run_steps(fit(replace(rig, viewers=(one,)), plan_of())) for one in rig.viewers]
    both = run_steps(fit(rig, plan_of()))
    turned = run_steps(fit(replace(rig, viewers=rig.viewers[::-1]), plan_of()))
    assert both.width == pytest.approx(max(one.width for one in alone), rel=1e-9)
    assert turned.width == pytest.approx(both.width, rel=1e-9)
    assert alone[0].width != pytest.approx(alone[1].width, rel=1e-3)
    mean = np.mean([one.after for one in alone])
    assert both.after == pytest.approx(mean, abs=1e-6) or both.after > mean


def test_a_picture_is_as_large_as_gets_through_to_each_viewer() -> None:
    """No larger than that of the one to whom least gets through, and as large but for a hundredth;
    both see all of it.
    """
    rig = aside(rig_around(ball(), display=0.5), 0.02)
    alone = [run_steps(fit_picture(replace(rig, viewers=(one,)), plan_of())) for one in rig.viewers]
    both = run_steps(fit_picture(rig, plan_of()))
    assert both.width == pytest.approx(min(one.width for one in alone), rel=0.02)
    assert both.after > 0.999
