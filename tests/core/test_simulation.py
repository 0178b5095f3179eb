"""What is seen by way of a plate's mirrors, against closed forms and against the seen image of an ideal plate."""

from dataclasses import replace

import numpy as np
import pytest
from reference_rigs import box, cube_rig, lattice_image, rectangle, rig
from work import drain, solve

from kiriko.core.plan import Settings, make_plan
from kiriko.core.plate import PlatePath
from kiriko.core.rig import Display, MirrorArray
from kiriko.core.simulation import LUMINANCE, plate_view, simulate

NO_GLASS = box([0.3, 0.03, 0.3])


def with_mirrors(a_rig, **values):
    return replace(a_rig, plates=(replace(a_rig.plates[0], array=MirrorArray(**values)),))


def plain_rig(**options):
    """An orthographic viewer who sees the mid-air image through a slab that does not refract, at 45 degrees."""
    return rig(NO_GLASS, ior=1.0, projection="orthographic", **options)


def test_an_ideal_plate_shows_the_seen_image():
    """Sample by sample what the shares give by area: no further off than its own standard error, and unbiased."""
    a_rig = cube_rig(pixels=48, display_pixels=64, image=lattice_image(64))
    solution = solve(a_rig, brightness=True, only_through_glass=False)
    seen = solution.seen()
    plan = make_plan(a_rig, Settings())
    found = [drain(simulate(plan, solution.source, 60, seed)) for seed in range(4)]
    off = [(some.image - seen) @ LUMINANCE for some in found]
    for some, apart in zip(found, off, strict=True):
        assert some.error > 0
        assert np.sqrt((apart**2).mean()) < 1.1 * some.error
        assert set(path for path, light in some.luminance.items() if light) == {PlatePath.IMAGED}
    assert np.sqrt((np.mean(off, axis=0) ** 2).mean()) < 0.65 * found[0].error


def test_the_standard_error_is_what_two_runs_differ_by():
    a_rig = with_mirrors(cube_rig(pixels=48, display_pixels=64, image=lattice_image(64)))
    plan = make_plan(a_rig, Settings())
    source = np.ones((64, 64, 3), np.float32)
    source[::2] = 0
    one, other = (drain(simulate(plan, source, 5, seed)) for seed in (1, 2))  # 5 is no square: parts by lot
    apart = np.sqrt((((one.image - other.image) @ LUMINANCE) ** 2).mean())
    assert apart == pytest.approx(np.sqrt(2) * one.error, rel=0.1)
    for some in (one, other):
        assert sum(some.luminance.values()) == pytest.approx(float((some.image @ LUMINANCE).mean()), rel=1e-5)


def test_all_the_light_of_a_white_room_is_counted_once():
    """Mirrors without loss in a white room: every class of light together is white, reflections of the faces too."""
    a_rig = with_mirrors(plain_rig(pixels=64), reflectance=1.0)
    room = box([3.0, 3.0, 3.0])
    inward = replace(room, triangles=room.triangles[:, ::-1], uv=np.tile([[0.0, 0], [1, 0], [0, 1]], (12, 1, 1)))
    a_rig = replace(a_rig, displays=(Display("room", inward, 4, 4),))
    found = drain(simulate(make_plan(a_rig, Settings()), np.ones((4, 4, 3), np.float32), 2))
    # what the first face reflects is seen, what the second does is lost
    (faces,) = make_plan(a_rig, Settings()).arrays.values()
    reflected = faces.reflected(np.zeros((1, 3)), np.array([[0.0, 1, 0]])).throughput[0]
    white = (1 - reflected) ** 2 + reflected
    assert found.image == pytest.approx(white, abs=1e-6)
    assert found.luminance[PlatePath.REFLECTED] == pytest.approx(reflected, rel=1e-5)
    assert found.luminance[PlatePath.IMAGED] == pytest.approx(0.863 * (1 - reflected) ** 2, rel=0.01)


def test_brightness_and_blur_have_closed_forms():
    """At 45 degrees in the symmetric plane: docs' share of light, and blur uniform in +- p P along each mirror."""
    a_rig = with_mirrors(plain_rig(pixels=200, field=0.02), has_fresnel=False)
    found = plate_view(make_plan(a_rig, Settings(only_through_glass=False)))
    tangent = np.sin(np.pi / 4) / 1.52
    r = 2.5 * tangent / np.sqrt(1 - tangent**2) / np.sqrt(2)
    share = 1 - abs(r % 2 - 1)
    assert found.brightness == pytest.approx((share * 0.87) ** 2, rel=1e-9)
    assert (found.least, found.most) == pytest.approx((found.brightness, found.brightness), rel=1e-9)
    # the two mirrors' shifts, each with a variance of (p P)^2 / 3; across the ray what lies in the plane of incidence
    # is seen under 45 degrees
    metres = 0.5e-3 * share * np.sqrt((1 + 0.5) / 3)
    assert found.blur == pytest.approx(metres / (0.02 / 200), rel=0.03)


def test_an_ideal_plate_has_no_brightness_to_tell():
    assert plate_view(make_plan(plain_rig(pixels=16), Settings())) is None


def test_a_display_that_is_not_seen_has_none_either():
    a_rig = with_mirrors(plain_rig(pixels=16))
    away = Display("display", rectangle([5.0, 0, 0], [1, 0, 0], [0, 1, 0], 0.01, 0.01), 8, 8)
    assert plate_view(make_plan(replace(a_rig, displays=(away,)), Settings(only_through_glass=False))) is None
