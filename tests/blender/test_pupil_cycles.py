"""A viewer's pupil against Cycles with depth of field."""

import bpy
import numpy as np
import pytest

from small_rigs import small_rig


def read(scene):
    from kiriko.core.blender.read import scene as blender_scene

    bpy.context.view_layer.update()
    return blender_scene.read(bpy.context.evaluated_depsgraph_get(), scene)


def viewer_of(scene):
    from kiriko.core.blender.data.camera_viewer import viewer_of

    return viewer_of(scene)


def rms(a, b, inside=np.s_[:]):
    return float(np.sqrt(((a - b)[inside] ** 2).mean()))


def test_a_camera_gives_its_pupil(kiriko, scene):
    """A diameter in mm; with depth of field the focal length over the f-number, and its focus, in
    Blender units as in Cycles.
    """
    small_rig()
    camera = viewer_of(scene)
    assert read(scene).rig.viewer.pupil == 0
    camera.kiriko.pupil = 4.0
    viewer = read(scene).rig.viewer
    assert (viewer.pupil, viewer.focus) == (pytest.approx(0.004), None)

    camera.kiriko.use_dof = True
    camera.data.dof.aperture_fstop, camera.data.dof.focus_distance = 8.0, 0.9
    viewer = read(scene).rig.viewer
    assert viewer.pupil == pytest.approx(1e-3 * camera.data.lens / 8)
    assert viewer.focus == pytest.approx(0.9)
    camera.data.dof.focus_object = next(o for o in scene.objects if o.kiriko.role == "GLASS")
    assert read(scene).rig.viewer.focus == pytest.approx(1.0)
    scene.unit_settings.scale_length = 0.1
    assert read(scene).rig.viewer.focus == pytest.approx(0.1)
    assert read(scene).rig.viewer.pupil == pytest.approx(1e-4 * camera.data.lens / 8)


def finely_ringed():
    """Give the picture grey rings, light that can become both brighter and darker."""
    image = bpy.data.images["Kiriko Lattice"]
    width, height = image.size
    y, x = (np.mgrid[:height, :width] + 0.5) / [[[height]], [[width]]] - 0.5
    light = 0.5 + 0.25 * np.cos(8 * np.pi * (x * x + y * y) * 4)
    pixels = np.stack([light, light, light, np.ones_like(x)], axis=2)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.update()
    image.update_tag()


@pytest.mark.parametrize("pupil", [4.0, 30.0])
def test_the_seen_image_is_that_of_cycles_with_depth_of_field(kiriko, scene, pupil):
    """To the noise of a render; a pupil that blurs by pixels is far from the pinhole's image. A
    sharpened image gains 2 dB in Cycles, too.
    """
    from kiriko.core.base.steps import run_steps
    from kiriko.core.blender.preview.cycles_preview import render_preview
    from kiriko.core.rig.settings import Settings
    from kiriko.core.solve.session import Session

    small_rig(viewer_resolution=96, display_resolution=(96, 96))
    finely_ringed()
    viewer_of(scene).kiriko.pupil = pupil
    reading = read(scene)
    session = Session()
    found = {
        is_on: run_steps(session.solve(reading.rig, Settings(sharpen=is_on)))
        for is_on in (False, True)
    }
    ideal = found[True].ideal()
    inside = np.s_[18:78, 18:78]
    errors = {}
    for is_on, solution in found.items():
        render = render_preview(scene, reading, solution.source, samples=256, fresnel=False)
        render = render[..., :3]
        seen = run_steps(solution.seeing_with_pupil(solution.source))
        assert rms(render, seen) < 0.008
        if pupil > 10:
            assert rms(render, seen) < rms(render, solution.seen()) / 3
        errors[is_on] = rms(render, ideal, inside)
    assert 20 * np.log10(errors[False] / errors[True]) >= 2


def test_a_report_has_the_sharpness_of_a_pupil(kiriko, scene):
    """Figures, a drawing and a sentence; a rig without pupils has none of them."""
    from kiriko.core.base.steps import run_steps
    from kiriko.core.lab.measure.sharpness import FILE, in_words
    from kiriko.operators import report

    small_rig()
    assert FILE not in report.extra_names(read(scene).rig)
    viewer_of(scene).kiriko.pupil = 4.0
    rig = read(scene).rig
    assert FILE in report.extra_names(rig)
    (figures,), drawings = run_steps(report._sharpness_of(bpy.context, rig))
    assert "<circle" in drawings[FILE]
    error = figures["mean_focus_error_dioptres"]
    assert abs(error) < 0.1
    assert f"{error:+.2f} dioptres from the picture" in str(in_words(figures))


def test_the_pupil_shows_in_the_comparison_and_makes_no_result_stale(kiriko, scene):
    """Before and After and Simulate see through it; the source image stays that of the scene."""
    small_rig()
    bpy.ops.kiriko.solve()
    camera = viewer_of(scene)
    from kiriko.operators import before_after, watch

    def after():
        from kiriko.core.base.steps import run_steps

        return run_steps(before_after.comparing(bpy.context, is_for_file=True)).comparison.after

    sharp = after()
    camera.kiriko.pupil = 60.0
    bpy.context.view_layer.update()
    assert not watch.has_changed(bpy.context)
    assert bpy.ops.kiriko.simulate.poll()
    assert rms(sharp, after()) > 1e-3
    scene.kiriko.sharpen = True
    assert watch.has_changed(bpy.context)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert not watch.has_changed(bpy.context)
    assert '"psnr"' in scene.kiriko.result.details
    camera.kiriko.pupil = 50.0
    assert watch.has_changed(bpy.context)
