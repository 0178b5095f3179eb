"""The sight by way of a plate's mirrors, against closed
forms and against the seen image of an ideal plate.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.image import simulation
from kiriko.core.image.simulation import LUMINANCE, simulate, simulate_colours
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.plate import PlatePath, light_by_angle
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Display, MirrorArray
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.channel import channel_keys
from known.reference_rigs import ball_rig, box, cube_rig, lattice_image, rectangle, rig
from known.work import drain, solve

NO_GLASS = box([0.3, 0.03, 0.3])


def plate_view(plan, seed=0):
    return drain(simulation.plate_view(plan, seed))


def with_mirrors(a_rig, **values):
    return replace(a_rig, plates=(replace(a_rig.plates[0], array=MirrorArray(**values)),))


def plain_rig(**options):
    """An orthographic viewer who sees the mid-air image
    through a slab that does not refract, at 45 degrees.
    """
    return rig(NO_GLASS, ior=1.0, projection="orthographic", **options)


def test_an_ideal_plate_shows_the_seen_image():
    """Sample by sample the result of the shares by area: no further
    off than its own standard error, and unbiased.
    """
    a_rig = cube_rig(pixels=48, display_pixels=64, image=lattice_image(64))
    solution = solve(a_rig, brightness=True, only_through_glass=False)
    seen = solution.seen()
    plan = compile_plan(a_rig, Settings())
    found = [drain(simulate(plan, solution.source, 60, seed)) for seed in range(4)]
    off = [(some.image - seen) @ LUMINANCE for some in found]
    for some, apart in zip(found, off, strict=True):
        assert some.error > 0
        assert np.sqrt((apart**2).mean()) < 1.1 * some.error
        assert set(path for path, light in some.luminance.items() if light) == {PlatePath.IMAGED}
    assert np.sqrt((np.mean(off, axis=0) ** 2).mean()) < 0.65 * found[0].error


def test_all_the_light_of_a_white_room_is_counted_once():
    """Mirrors without loss in a white room: every class of light
    together is white, reflections of the faces too.
    """
    a_rig = with_mirrors(plain_rig(pixels=64), reflectance=1.0)
    room = box([3.0, 3.0, 3.0])
    inward = replace(
        room, triangles=room.triangles[:, ::-1], uv=np.tile([[0.0, 0], [1, 0], [0, 1]], (12, 1, 1))
    )
    a_rig = replace(a_rig, displays=(Display("room", inward, 4, 4),))
    found = drain(simulate(compile_plan(a_rig, Settings()), np.ones((4, 4, 3), np.float32), 2))

    # light that the first face reflects is seen, light of the second is lost
    (faces,) = compile_plan(a_rig, Settings()).arrays
    reflected = faces.reflected(np.zeros((1, 3)), np.array([[0.0, 1, 0]])).throughput[0]
    white = (1 - reflected) ** 2 + reflected

    assert found.image == pytest.approx(white, abs=1e-6)
    assert found.luminance[PlatePath.REFLECTED] == pytest.approx(reflected, rel=1e-5)
    assert found.luminance[PlatePath.IMAGED] == pytest.approx(
        0.863 * (1 - reflected) ** 2, rel=0.01
    )


def test_brightness_and_blur_have_closed_forms():
    """At 45 degrees in the symmetric plane: docs' share of
    light, and blur uniform in +- p P along each mirror.
    """
    a_rig = with_mirrors(plain_rig(pixels=200, field=0.02), has_fresnel=False)
    found = plate_view(compile_plan(a_rig, Settings(only_through_glass=False)))
    tangent = np.sin(np.pi / 4) / 1.52
    r = 2.5 * tangent / np.sqrt(1 - tangent**2) / np.sqrt(2)
    share = 1 - abs(r % 2 - 1)

    assert found.brightness == pytest.approx((share * 0.87) ** 2, rel=1e-9)
    assert (found.least, found.most) == pytest.approx(
        (found.brightness, found.brightness), rel=1e-9
    )

    # the two mirrors' shifts, each with a variance of (p P)^2 / 3; across the
    # ray the plane of incidence is seen under 45 degrees
    metres = 0.5e-3 * share * np.sqrt((1 + 0.5) / 3)
    assert found.blur == pytest.approx(metres / (0.02 / 200), rel=0.03)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("size", [(512, 512), (64, 640), (1500, 90)], ids=str)
def test_the_blur_is_of_the_viewer_whatever_the_display(size, turns):
    """Its closed form in viewer pixels, for fewer and more
    display pixels, oblong ones, and UV in quarter turns.
    """
    a_rig = with_mirrors(plain_rig(pixels=200, field=0.02), has_fresnel=False)
    uv = a_rig.display.mesh.uv - 0.5
    for _ in range(turns):
        uv = np.stack([-uv[..., 1], uv[..., 0]], axis=-1)
    turned = replace(a_rig.display.mesh, uv=uv + 0.5)
    display = Display("display", turned, *size)
    plan = compile_plan(replace(a_rig, displays=(display,)), Settings(only_through_glass=False))

    # mirrors along both diagonals shift by up to p P: each adds half of its variance across the
    # viewer's image, and half along the plane of incidence, which is seen under 45 degrees
    tangent = np.sin(np.pi / 4) / 1.52
    share = 1 - abs(2.5 * tangent / np.sqrt(1 - tangent**2) / np.sqrt(2) % 2 - 1)
    metres = 0.5e-3 * share * np.sqrt((1 + 0.5) / 3)

    assert plate_view(plan).blur == pytest.approx(metres / (0.02 / 200), rel=0.03)


def test_an_ideal_plate_has_no_brightness_to_tell():
    assert plate_view(compile_plan(plain_rig(pixels=16), Settings())) is None


def test_a_display_that_is_not_seen_has_none_either():
    a_rig = with_mirrors(plain_rig(pixels=16))
    away = Display("display", rectangle([5.0, 0, 0], [1, 0, 0], [0, 1, 0], 0.01, 0.01), 8, 8)
    assert (
        plate_view(
            compile_plan(replace(a_rig, displays=(away,)), Settings(only_through_glass=False))
        )
        is None
    )


@pytest.mark.parametrize("spp", [2, 3, 16, 64])
def test_the_standard_error_holds_for_any_number_of_samples(spp):
    """Of independent seeds: rms of their difference / sqrt 2, to 10 %. An odd number is
    rounded up.
    """
    plan = compile_plan(with_mirrors(plain_rig(pixels=48)), Settings())
    source = np.ones((512, 512, 3), np.float32)
    source[::16] = 0
    one, other = (drain(simulate(plan, source, spp, seed)) for seed in (1, 2))
    apart = ((one.image - other.image) @ LUMINANCE) / np.sqrt(2)
    assert np.sqrt((apart**2).mean()) == pytest.approx(one.error, rel=0.1)
    assert one.spp == other.spp == spp + spp % 2


def test_a_display_looked_at_straight_has_its_own_colours():
    """Before the viewer, past glass and plate: each quarter of
    the image is a pixel of the display, counted as NONE.
    """
    x, _, z = np.eye(3)
    a_rig = with_mirrors(rig(box([0.01] * 3, (0.5, 0, 0)), pixels=16, field=0.05))
    facing = Display("display", rectangle(np.zeros(3), x, z, 0.05, 0.05), 2, 2)
    plan = compile_plan(replace(a_rig, displays=(facing,)), Settings())
    source = np.array([[[0.1, 0.9, 0.3], [2.0, 0, 0]], [[0, 0.5, 0], [0.2, 0.3, 0.7]]], np.float32)
    found = drain(simulate(plan, source, 4))
    assert found.image == pytest.approx(source.repeat(8, axis=0).repeat(8, axis=1), abs=1e-6)
    assert found.error == pytest.approx(0, abs=1e-7)
    assert found.luminance.pop(PlatePath.NONE) == pytest.approx(
        float((source @ LUMINANCE).mean()), rel=1e-6
    )
    assert not any(found.luminance.values())


def test_brightness_is_the_share_that_each_direction_leaves():
    """Behind a ball, by angle: least, mean and most are those of
    other rays by the formula, without the ball's loss.
    """
    plan = compile_plan(ball_rig(3, pixels=64, field=0.02), Settings())
    found = plate_view(compile_plan(with_mirrors(plan.rig), Settings()))
    landings = trace_all(
        plan, *plan.rig.viewer.rays(np.random.default_rng(9).uniform(0, 64, (40_000, 2)))
    )

    # an ideal plate keeps the angle and, turned round, the azimuth
    plate = np.array([[1, 0, 0], [0, 0.5**0.5, 0.5**0.5], [0, -(0.5**0.5), 0.5**0.5]])
    along, up, across = plate @ landings.directions[landings.has_arrived].T
    share = light_by_angle(MirrorArray(), np.arccos(np.abs(across)), np.arctan2(up, along))[
        PlatePath.IMAGED
    ]

    assert found.least < found.brightness < found.most
    assert found.brightness == pytest.approx(share.mean(), abs=4 * found.brightness_error)
    assert (found.least, found.most) == pytest.approx((share.min(), share.max()), abs=0.01)
    assert share.max() > 1.05 * share.mean() > 1.1 * share.min()


def test_the_standard_errors_are_how_samples_spread():
    """Over 12 seeds, to a factor of 1.6: of 12 values a standard deviation is known to a fifth."""
    plan = compile_plan(with_mirrors(ball_rig(2, pixels=64)), Settings())
    found = [plate_view(plan, seed) for seed in range(12)]
    for name in ("brightness", "blur"):
        spread = np.std([getattr(some, name) for some in found], ddof=1)
        told = np.mean([getattr(some, f"{name}_error") for some in found])
        assert 1 / 1.6 < spread / told < 1.6, name


def test_slits_spread_light_by_their_diffraction():
    """At 45 degrees on a plate 0.15 m behind the picture, with mirrors along its diagonals: each
    mirror direction moves the image by x w l / p, 0.903 of the light within the first zeros
    (twice the integral of sinc^2 to 1), half of it within 0.2705.
    """
    a_rig = with_mirrors(rig(NO_GLASS, ior=1.0, pixels=64), pitch=0.25e-3)
    plan = compile_plan(a_rig, Settings())
    xy = np.full((40000, 2), 32.0)
    moved = simulation._diffracted(plan, xy, np.random.default_rng(0)) - xy
    metres = moved * 0.05 / 64 * [1, -1]  # of the picture's plane at 1 m, right and up
    unit = plan.settings.wavelength * 0.15 / 0.25e-3
    # normals (x +- (y + z) / sqrt 2) / sqrt 2 of the plate, as seen along y
    seen = np.array([[0.5**0.5, 0.5], [0.5**0.5, -0.5]])
    x = np.abs(metres @ np.linalg.inv(seen)) / unit
    assert (x < 1).mean(axis=0) == pytest.approx(0.9028, abs=0.006)
    assert np.median(x, axis=0) == pytest.approx(0.2705, rel=0.02)
    assert (x > 10).mean() == pytest.approx((1 / 10 - 1 / 50) / np.pi**2, rel=0.1)


def test_diffraction_blurs_only_plates_of_mirrors():
    """And keeps the mean light."""
    source = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    for a_rig, is_blurred in (
        (with_mirrors(plain_rig(pixels=48, display_pixels=64), pitch=0.1e-3), True),
        (plain_rig(pixels=48, display_pixels=64), False),
    ):
        plan = compile_plan(a_rig, Settings())
        one, other = (
            drain(simulate(plan, source, 8, has_diffraction=is_on)) for is_on in (False, True)
        )
        assert (one.image != other.image).any() == is_blurred
        assert one.image.mean() == pytest.approx(other.image.mean(), rel=0.02)


def test_each_colour_has_its_own_index_and_absorption():
    """Tinted glass fades colours by Beer and Lambert's law, with Brightness on or off."""
    clear = ball_rig(4, pixels=24, field=0.04, display_pixels=32)
    tinted = replace(clear, glasses=(replace(clear.glasses[0], absorption=(5.0, 20.0, 60.0)),))
    flat = np.full((32, 32, 3), 0.5, np.float32)

    def mean(a_rig):
        settings = Settings(brightness=True)
        keys = channel_keys(a_rig, settings)
        plans = [compile_plan(a_rig, key.of(settings)) for key in keys]
        return drain(simulate_colours(plans, flat, 16)).image[9:15, 9:15].mean(axis=(0, 1))

    middle = np.exp(-0.05 * np.array([5.0, 20.0, 60.0]))
    np.testing.assert_allclose(mean(tinted) / mean(clear), middle, rtol=0.03)


def test_diffraction_leaves_light_past_the_plate():
    """A display seen beside a small plate keeps its edges."""
    x, _, z = np.eye(3)
    a_rig = rig(box([0.02] * 3), pixels=48, field=0.3, plate=0.05)
    away = rectangle(np.array([0, 0.6, 0.12]), x, z, 0.4, 0.1)
    a_rig = replace(
        a_rig,
        glasses=(),
        plates=(replace(a_rig.plates[0], array=MirrorArray()),),
        displays=(replace(a_rig.displays[0], mesh=away, width=64, height=16),),
    )
    source = np.zeros((16, 64, 3), np.float32)
    source[:, 32:] = 1
    plan = compile_plan(a_rig, Settings(only_through_glass=False, only_through_plate=False))
    without, with_it = (
        drain(simulate(plan, source, 32, has_diffraction=one)).image for one in (False, True)
    )
    row = np.argmax(without.max(axis=(1, 2)) > 0.5) + 2
    np.testing.assert_array_equal(with_it[row], without[row])
