"""Displays with views in Blender: settings, reading, and their look in Cycles."""

import json

import bpy
import numpy as np
import pytest

from small_rigs import small_rig

CONE = np.radians(60.0), np.radians(40.0)


@pytest.fixture
def display(scene) -> bpy.types.Object:
    """The display of a small rig, with 9 x 3 views."""
    thing = small_rig(display_resolution=(32, 32))["DISPLAY"]
    ours = thing.kiriko.views
    ours.use, ours.columns, ours.rows, ours.cone = True, 9, 3, CONE
    return thing


def read(core):
    return core.blender.read.scene.read(bpy.context)


def test_the_settings_of_a_display_are_its_views(core, scene, display):
    """Numbers of the interface are those of the record; millimetres become metres, and 0 means
    infinity.
    """
    views = read(core).rig.display.views
    assert (views.columns, views.rows, views.overlap, views.distance) == (9, 3, 0.0, np.inf)
    assert views.cone == pytest.approx(CONE)
    display.kiriko.views.distance, display.kiriko.views.overlap = 500.0, 0.25
    views = read(core).rig.display.views
    assert (views.overlap, views.distance) == (0.25, 0.5)
    display.kiriko.views.use = False
    assert read(core).rig.display.views is None


@pytest.mark.parametrize(("overlap", "distance"), [(0.0, 0.0), (0.4, 400.0)])
def test_cycles_sees_the_views_that_kiriko_traces(core, scene, display, overlap, distance):
    """A quilt of one colour in each view, seen in Cycles through the cube and by the map: the
    preview's material finds the view from the direction of light, by nodes of its own.
    """
    ours = display.kiriko.views
    ours.overlap, ours.distance, ours.cone = overlap, distance, (0.05, 0.04)
    reading = read(core)
    steps = core.solve.session.Session().solve(reading.rig, core.rig.settings.Settings())
    solution = core.base.steps.run_steps(steps)
    views, size = reading.rig.display.views, reading.rig.display.size
    quilt = np.zeros_like(solution.source)
    for view in range(views.n):
        colour = (view % 9 + 1) / 10, (view // 9 + 1) / 4, 0.5
        core.files.quilt.tile_of(quilt, view, views.tiling(size))[:] = colour
    seen = solution.seen(quilt)
    render = core.blender.preview.cycles_preview.render_preview(
        scene, reading, quilt, samples=64, fresnel=False
    )[..., :3]
    # away from borders of the glass, which a renderer's filter blurs
    whole = solution.first.view_coverage > 0.99
    inside = whole.copy()
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            inside &= np.roll(whole, step, axis)
    assert inside.sum() > 300
    assert len(np.unique(np.rint(seen[inside][:, 0] * 10))) > 2
    difference = np.abs(render - seen)[inside]
    assert np.median(difference) < 1e-3
    assert difference.mean() < 0.01


def test_the_quilt_is_exported_by_the_name_players_read(core, scene, display, tmp_path):
    """The file has the size of all tiles and their numbers in its name; each view is a tile, and
    the interlaced image is made of them.
    """
    display.kiriko.views.rows = 1
    bpy.ops.kiriko.solve()
    assert bpy.ops.kiriko.export(filepath=str(tmp_path / "ball.png")) == {"FINISHED"}
    file = tmp_path / "ball_qs3x3a1.png"
    quilt, _ = core.files.image_io.read(file)
    assert quilt.shape[:2] == (96, 96)
    assert quilt[..., :3].max() > 0.5

    assert bpy.ops.kiriko.export_views(filepath=str(tmp_path / "view.png")) == {"FINISHED"}
    for view in 0, 4, 8:
        tile, _ = core.files.image_io.read(tmp_path / f"view_{view}.png")
        top, left = 32 * (2 - view // 3), 32 * (view % 3)
        assert (tile == quilt[top : top + 32, left : left + 32]).all()

    path, sheet = tmp_path / "woven.png", tmp_path / "visual.json"
    numbers = {"pitch": 100, "slope": -7, "center": 0, "DPI": 300, "screenW": 30, "screenH": 40}
    sheet.write_text(json.dumps(numbers), encoding="utf-8")
    written = bpy.ops.kiriko.export_interlaced(filepath=str(path), calibration=str(sheet))
    assert written == {"FINISHED"}
    assert core.files.image_io.read(path)[0].shape[:2] == (40, 30)
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.kiriko.export_interlaced(filepath=str(path), calibration=str(tmp_path / "none"))


def test_what_views_cannot_do(core, scene, display, tmp_path):
    """Maps have one place for each pixel: refused. So are two displays."""
    bpy.ops.kiriko.solve()
    with pytest.raises(RuntimeError, match="one place for each pixel"):
        bpy.ops.kiriko.export_maps(directory=str(tmp_path))
    with pytest.raises(RuntimeError, match="single row of views"):
        bpy.ops.kiriko.export_interlaced(filepath=str(tmp_path / "a.png"))
