"""The conflict of several viewers, as one of the result's images."""

import json

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import pixels, small_rig

pytestmark = pytest.mark.usefixtures("no_remedies")


@pytest.fixture
def rig(scene) -> dict[str, bpy.types.Object]:
    """A rig around a cube, with two eyes; the objects by role."""
    found = small_rig()
    bpy.ops.kiriko.two_eyes()
    return found


def result() -> bpy.types.PropertyGroup:
    return bpy.context.scene.kiriko.result


def reported() -> dict:
    return json.loads(result().details).get("conflict")


def one_eye() -> None:
    """Switch all viewers but one off."""
    listed = bpy.context.scene.kiriko.viewers
    for one in [one for one in listed if one.is_on][1:]:
        one.is_on = False


def solved() -> object:
    """Core's own solution of the scene."""
    work = loaded("operators.work")
    steps = loaded("core.base.steps")
    settings = work.settings_of(bpy.context.scene)
    return steps.run_steps(work.session().solve(work.read(bpy.context).rig, settings))


def values(colours: np.ndarray) -> np.ndarray:
    """Where on the scale 0..1 each pixel (H, W, 3) of linear light is, to a two thousandth, by
    its nearest colour of those of matplotlib's anchors; NaN for black.
    """
    anchors = [
        (0.267, 0.005, 0.329),
        (0.229, 0.322, 0.546),
        (0.128, 0.567, 0.551),
        (0.369, 0.789, 0.383),
        (0.993, 0.906, 0.144),
    ]
    at = np.linspace(0, 1, 2001)
    scale = np.stack(
        [np.interp(at, np.linspace(0, 1, 5), one) for one in zip(*anchors, strict=True)], axis=1
    )
    encoded = np.where(
        colours <= 0.0031308,
        12.92 * colours,
        1.055 * np.maximum(colours, 0) ** (1 / 2.4) - 0.055,
    ).reshape(-1, 3)
    distance = ((encoded[:, None] - scale) ** 2).sum(axis=2)
    found = np.where(encoded.sum(axis=1) > 0, at[distance.argmin(axis=1)], np.nan)
    return found.reshape(colours.shape[:2])


@pytest.mark.parametrize("way", ["SHARP", "BLENDED"])
def test_the_image_is_core_s_conflict_in_colours(drawn, kiriko, rig, way):
    """Of places where they are compared, of colours else; the panel tells where the scale ends."""
    reports = loaded("core.lab.measure.viewer_errors")
    steps = loaded("core.base.steps")
    bpy.context.scene.kiriko.disagreement = way
    bpy.ops.kiriko.solve()
    found = solved()
    _, in_light = steps.run_steps(reports.conflict_in_light(found))
    expected = found.settled.conflict if way == "SHARP" else in_light
    unit = "px" if way == "SHARP" else "white"
    assert reported() == {"largest": expected.max(), "unit": unit}

    image = result().conflict
    assert image.name == "Kiriko Conflict"
    assert image.is_float
    assert image.packed_file is not None
    shown = values(pixels(image)[..., :3])
    is_asked = np.any([one.coverage.weight > 0 for one in found.channels], axis=0)
    np.testing.assert_allclose(shown[is_asked], (expected / expected.max())[is_asked], atol=1e-3)
    assert np.isnan(shown[~is_asked]).all()
    words = " px of the picture" if way == "SHARP" else " of white"
    texts = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)
    assert "Conflict at most" in texts
    assert words in texts


def test_without_glass_there_is_no_conflict(rig):
    """With index 1 it is 0 to rounding and to a pixel's own curvature, and not stretched to colours
    as if it were something.
    """
    glass = next(one for one in bpy.context.scene.objects if one.kiriko.role == "GLASS")
    glass.kiriko.use_ior, glass.kiriko.ior = True, 1.0
    bpy.ops.kiriko.solve()
    assert reported()["largest"] < 0.01
    shown = values(pixels(result().conflict)[..., :3])
    assert np.nanmax(shown) == pytest.approx(reported()["largest"] / 0.01, abs=1e-3)


def test_it_goes_with_the_second_viewer(rig):
    """Image and panel's line; one that the artist uses stays."""
    bpy.ops.kiriko.solve()
    name = result().conflict.name
    bpy.ops.kiriko.show_image(image=name)
    assert result().shown == result().conflict
    one_eye()
    bpy.ops.kiriko.solve()
    assert result().conflict is None
    assert reported() is None
    assert name not in bpy.data.images
    assert result().shown == result().source

    for one in bpy.context.scene.kiriko.viewers:
        one.is_on = True
    bpy.ops.kiriko.solve()
    bpy.data.images[name].use_fake_user = True
    one_eye()
    bpy.ops.kiriko.solve()
    assert result().conflict is None
    assert name in bpy.data.images


def test_solving_again_puts_no_second_one_beside_it(rig):
    for _ in range(2):
        bpy.ops.kiriko.solve()
    assert [one.name for one in bpy.data.images if "Conflict" in one.name] == ["Kiriko Conflict"]


def test_it_is_shown_and_is_no_picture_to_choose(drawn, rig):
    bpy.ops.kiriko.solve()
    assert result().shown == result().source
    bpy.ops.kiriko.show_image(image="Kiriko Conflict")
    assert result().shown == result().conflict
    with pytest.raises(RuntimeError, match="The result has no image 'x': choose another"):
        bpy.ops.kiriko.show_image(image="x")
    assert result().shown == result().conflict
    assert "Kiriko Conflict" not in drawn("object", "VIEW3D_MT_kiriko_images").labels
    listed = drawn("result_panel", "VIEW3D_MT_kiriko_result_images").labels
    assert listed == ["Kiriko Source", "Kiriko Conflict"]


def test_remove_rig_takes_it_along(rig):
    bpy.ops.kiriko.solve()
    bpy.ops.kiriko.remove_rig()
    assert result().conflict is None
    assert not [one.name for one in bpy.data.images if "Conflict" in one.name]


def test_undo_and_a_file_keep_it(rig, tmp_path):
    bpy.ops.kiriko.solve()
    bpy.ops.ed.undo_push(message="solved")
    before = pixels(result().conflict).copy()
    one_eye()
    bpy.ops.kiriko.solve()
    bpy.ops.ed.undo_push(message="one eye")
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(pixels(result().conflict), before)

    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    np.testing.assert_array_equal(pixels(result().conflict), before)
    assert reported()["largest"] > 0
