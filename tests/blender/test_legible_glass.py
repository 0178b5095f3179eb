"""Glass that shows no picture: it is said before a solve, and the remedy is measured."""

import importlib

import bpy
import numpy as np
import pytest

from extension import loaded
from known.reference_rigs import wavy_slab
from panel_layout import told
from small_rigs import primitive
from test_checklist import press


def bumpy(scene: bpy.types.Scene, off: float) -> bpy.types.Object:
    """A smooth ball whose vertices are off by so many radii at random, selected as glass."""
    mesh = primitive("icosphere", subdivisions=5, radius=0.03)
    points = np.array([vertex.co for vertex in mesh.vertices])
    points *= 1 + off * np.random.default_rng(4).normal(size=(len(points), 1))
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.shade_smooth()
    return selected(scene, mesh)


def wavy(scene: bpy.types.Scene) -> bpy.types.Object:
    """A slab whose faces are wavy, selected as glass."""
    slab = wavy_slab(n=32)
    mesh = bpy.data.meshes.new("slab")
    mesh.from_pydata(slab.vertices.tolist(), [], slab.triangles.tolist())
    mesh.shade_smooth()
    return selected(scene, mesh)


def selected(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """An object of a mesh, selected as glass."""
    glass = bpy.data.objects.new("bunny", mesh)
    scene.collection.objects.link(glass)
    glass.kiriko.use_ior = True
    glass.select_set(True)
    bpy.context.view_layer.objects.active = glass
    bpy.context.view_layer.update()
    return glass


SMALL = {"viewer_resolution": 64, "display_resolution": (128, 128)}


def test_blenders_smooth_modifier_makes_the_mesh_that_was_measured(kiriko, scene):
    """Places to float32, and normals of the smooth-shaded mesh to a hundredth of a degree."""
    core = f"{kiriko.__name__}.core"
    smoothing = importlib.import_module(f"{core}.glass.smoothed")
    reading = importlib.import_module(f"{core}.blender.read.read_mesh")
    glass = bumpy(scene, 0.01)
    local = reading.read_local(glass.data, has_normals=True)
    mesh, _ = reading.in_world(local, np.eye(4))
    wanted = smoothing.smoothed(mesh, 10)

    assert bpy.ops.kiriko.smooth_glass(part=glass.name, iterations=10) == {"FINISHED"}
    shown = glass.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    found = np.array([vertex.co for vertex in shown.vertices])
    assert np.abs(found - wanted.vertices).max() < 1e-7
    normals = np.array([normal.vector for normal in shown.vertex_normals])
    there = smoothing.vertex_normals(wanted.vertices, wanted.triangles)
    assert np.abs(normals - there).max() < 2e-4


def test_a_remedy_is_told_before_a_solve_as_it_was_measured(scene, look, drawn, monkeypatch):
    """Add Rig says that nobody recognises the picture; the checklist's button makes it as legible
    as it says.
    """
    module = loaded("operators.add_rig")
    whole = module.legible
    monkeypatch.setattr(module, "legible", lambda *given, is_watched: whole(*given, True))
    glass = bumpy(scene, 0.05)
    bpy.ops.kiriko.add_rig(**SMALL)
    assert "The picture is hard to recognise: legibility" in scene.kiriko.result.notes
    entry = next(one for one in look() if "hard to recognise" in one.text)
    assert entry.can_wait
    foretold = float(entry.text.split("raises the legibility to ")[1].split(" %")[0]) / 100
    assert foretold > 0.7

    press(look(), "hard to recognise")
    assert glass.modifiers[0].type == "SMOOTH"
    assert not [text for text in told(look()) if "recognise" in text]
    bpy.ops.kiriko.solve()
    kept = loaded("core.blender.data.stored_records")
    legibility = kept.StoredNumbers.read(scene.kiriko.result.details).by_name["legibility"]
    assert legibility == pytest.approx(foretold, abs=0.02)
    shown = drawn("result_panel", "VIEW3D_PT_kiriko_details").texts
    assert [text for text in shown if text.startswith("Legibility: ")]


def test_a_display_far_behind_waves_moves_up_to_them_as_it_was_measured(scene, look):
    """Waves strew light over a display that is far behind them. The checklist's button moves it to
    their back, the picture before it, and the legibility becomes what the checklist foretold.
    """
    kept = loaded("core.blender.data.stored_records")
    legible = loaded("operators.remedies").legible
    work = loaded("operators.work")
    result = loaded("core.blender.result.write_result")
    steps = loaded("core.base.steps")
    wavy(scene)
    bpy.ops.kiriko.add_rig(kind="BEHIND_GLASS", distance=0.2, picture_size=0.04, **SMALL)
    bpy.ops.kiriko.solve()
    rig = work.read(bpy.context).rig
    result.write_legibility(scene, *steps.run_steps(legible(rig, work.settings_of(scene), True)))
    parts = {thing.kiriko.role: thing for thing in scene.objects}
    before = {role: thing.matrix_world.copy() for role, thing in parts.items()}

    entry = next(one for one in look() if "hard to recognise" in one.text)
    foretold = (
        float(entry.text.split("Move to Glass raises the legibility to ")[1].split(" %")[0]) / 100
    )
    (button,) = [one for one in entry.buttons if one.operator == "kiriko.move_to_glass"]
    assert bpy.ops.kiriko.move_to_glass(**dict(button.properties)) == {"FINISHED"}
    bpy.context.view_layer.update()
    shifts = {
        role: np.array(parts[role].matrix_world - before[role])[:3, 3]
        for role in ("PICTURE", "DISPLAY", "GLASS", "VIEWER")
        if role in parts
    }
    assert shifts["PICTURE"] == pytest.approx(shifts["DISPLAY"], abs=1e-6)
    assert not shifts["GLASS"].any()
    back = max(vertex.co.y for vertex in parts["GLASS"].data.vertices)
    assert parts["PICTURE"].matrix_world.translation.y == pytest.approx(back, abs=1e-6)

    bpy.ops.kiriko.solve()
    legibility = kept.StoredNumbers.read(scene.kiriko.result.details).by_name["legibility"]
    assert legibility == pytest.approx(foretold, abs=0.01)
    assert not [text for text in told(look()) if "recognise" in text]
    assert bpy.ops.kiriko.move_to_glass(take=True) == {"FINISHED"}
    assert parts["PICTURE"].matrix_world.translation.y == pytest.approx(back, abs=1e-6)


def test_clear_glass_needs_no_remedy(scene, look, monkeypatch):
    """A ball shows all of the card: no remedy is tried, even for somebody who reads the list."""
    module = loaded("operators.add_rig")
    remedies = loaded("operators.remedies")
    whole = module.legible
    monkeypatch.setattr(module, "legible", lambda *given, is_watched: whole(*given, True))
    monkeypatch.setattr(remedies, "legible_by", None)
    bumpy(scene, 0.0)
    bpy.ops.kiriko.add_rig(**SMALL)
    kept = loaded("core.blender.data.stored_records")
    assert kept.StoredNumbers.read(scene.kiriko.result.details).by_name["legibility"] > 0.99
    assert not [text for text in told(look()) if "recognise" in text]
