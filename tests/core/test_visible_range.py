"""From where the picture is seen: without glass, where a plate's outline and the
display's say so.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.calibrate.visible_range import SURVEY, visible_range
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.plate import PlatePath, light_by_angle
from kiriko.core.rig.rig import MirrorArray
from kiriko.core.rig.settings import Settings
from known.reference_rigs import box, cube_rig, rig
from known.work import drain

MIDDLE = SURVEY.n_steps // 2


def found(a_rig, enough=1.0):
    return drain(visible_range(compile_plan(a_rig, Settings(only_through_glass=False)), enough))


@pytest.mark.parametrize("plate", [0.1, 0.2])
def test_without_glass_the_plates_outline_says_how_far(plate):
    """A picture of almost no size is seen while the line through it
    meets the plate, 0.15 m behind it at 45 degrees.
    """
    glass = box([1e-3] * 3, (0.3, 0.3, 0.3))
    seen = found(rig(glass, ior=1.0, picture=1e-4, display=0.01, plate=plate))
    sideways = np.arctan(plate / 2 / 0.15)
    edge = plate / 2 / np.sqrt(2)  # of the plate's upper edge: higher and further by so much

    # who looks up from below sees the upper edge, which leans away from the picture
    below = np.arctan(edge / (0.15 + edge))
    above = np.arctan(edge / (0.15 - edge))
    assert seen.extent == pytest.approx(
        (sideways, sideways, below, above), abs=1.5 * SURVEY.fine_rad + 1e-3
    )
    assert seen.share[MIDDLE, MIDDLE] == 1.0
    assert seen.brightness[MIDDLE, MIDDLE] == 1.0
    assert np.linalg.norm(seen.positions, axis=2) == pytest.approx(1.0)


def test_half_a_display_shows_half_the_picture():
    """No glass: the display is the picture's mirror image, so a
    part of it shows the same part of the picture.
    """
    glass = box([1e-3] * 3, (0.3, 0.3, 0.3))
    a_rig = rig(glass, ior=1.0, picture=0.03, display=0.015)
    seen = found(a_rig, 0.2)
    assert seen.share[MIDDLE, MIDDLE] == pytest.approx(0.25, abs=0.02)
    assert np.isnan(found(a_rig, 0.5).extent).all()


def test_a_picture_that_goes_with_the_viewer_has_no_range():
    a_rig = cube_rig()
    with pytest.raises(RigError, match="picture plane"):
        found(replace(a_rig, pictures=(replace(a_rig.picture, mesh=None),)))


def test_a_picture_behind_the_viewer_is_refused():
    a_rig = cube_rig()
    viewer = replace(a_rig.viewer, axes=a_rig.viewer.axes * np.array([[-1.0], [1], [-1]]))
    with pytest.raises(RigError, match="behind the viewer"):
        found(replace(a_rig, viewers=(viewer,)))


def test_a_plate_to_the_right_is_seen_from_the_left():
    """The line through the picture meets it on the other side:
    left and right are told apart, in the grid too.
    """
    glass = box([1e-3] * 3, (0.3, 0.3, 0.3))
    a_rig = rig(glass, ior=1.0, picture=1e-4, display=0.2, plate=0.1)
    (plate,) = a_rig.plates
    moved = replace(
        plate, mesh=replace(plate.mesh, vertices=plate.mesh.vertices + np.array([0.03, 0, 0]))
    )
    seen = found(replace(a_rig, plates=(moved,)))
    left = np.arctan(0.08 / 0.15)
    right = np.arctan(0.02 / 0.15)

    assert seen.extent[:2] == pytest.approx((left, right), abs=1.5 * SURVEY.fine_rad)
    row = seen.share[MIDDLE] > 0
    assert row[:MIDDLE].sum() > 2 * row[MIDDLE + 1 :].sum() > 0
    assert (seen.positions[MIDDLE, :MIDDLE, 0] < 0).all()


def test_brightness_is_what_the_plate_leaves_of_the_light_that_comes():
    """Mirrors at 45 degrees in the symmetric plane: their share
    by the formula, whether the display is all seen.
    """
    glass = box([1e-3] * 3, (0.3, 0.3, 0.3))
    (share,) = light_by_angle(MirrorArray(), np.array([np.pi / 4]))[PlatePath.IMAGED]
    for display in (0.05, 0.015):
        a_rig = rig(glass, ior=1.0, picture=0.03, display=display)
        seen = found(replace(a_rig, plates=(replace(a_rig.plates[0], array=MirrorArray()),)), 0.2)
        assert seen.brightness[MIDDLE, MIDDLE] == pytest.approx(share, rel=5e-3)
        assert 0.5 < share < 0.9
