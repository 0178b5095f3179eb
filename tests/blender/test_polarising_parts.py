"""Polarisers, wave plates and polarised displays as objects, and their look in Cycles."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, primitive, small_rig

RIGHT = np.radians(90)


def sheet(role: str, y: float = -0.5, angle: float = 0.0) -> bpy.types.Object:
    """An upright square before the viewer; its first edge runs along x."""
    thing = new_object(primitive("grid", x_segments=1, y_segments=1, size=0.1), role)
    thing.name, thing.location, thing.rotation_euler.x = role, (0, y, 0), RIGHT
    thing.kiriko.element.angle = angle
    return thing


@pytest.fixture
def objects(scene):
    """A rig without glass whose display shows the picture's place, by role."""
    rig = small_rig(picture_size=0.04, display_size=0.04, field=0.04)
    bpy.data.objects.remove(rig.pop("GLASS"))
    scene.kiriko.only_through_glass = False
    return rig


def throughput(core) -> float:
    """Of the middle ray; 0 if it does not arrive."""
    a_rig = core.blender.read.scene.read(bpy.context).rig
    plan = core.light.compile_plan.compile_plan(
        a_rig, core.rig.settings.Settings(only_through_glass=False)
    )
    found = core.light.trace.trace_all(plan, *a_rig.viewer.rays(np.array([[32.0, 32.0]])))
    return float((found.throughput * found.has_arrived)[0])


def test_the_settings_of_objects_are_read(core, scene, objects):
    """Malus by the axes of two objects; a wave plate by its retardance; a display by its own."""
    first, second = sheet("POLARISER", -0.5), sheet("POLARISER", -0.4, 0.4)
    assert throughput(core) == pytest.approx(np.cos(0.4) ** 2 / 2)
    second.kiriko.element.extinction = 0.5
    assert throughput(core) == pytest.approx((np.cos(0.4) ** 2 + np.sin(0.4) ** 2 / 2) / 2)
    second.kiriko.role = "WAVE_PLATE"
    first.kiriko.element.angle = second.kiriko.element.angle = 0.0
    film = core.blender.read.scene.read(bpy.context).rig.wave_plates[0]
    assert (film.retardance, film.angle) == (0.25, 0.0)

    display = objects["DISPLAY"].kiriko.element
    display.is_polarised, display.angle = True, 0.3
    level = throughput(core)
    display.angle = 0.3 + RIGHT
    assert level + throughput(core) == pytest.approx(1)
    assert 0.01 < level < 0.99


def test_cycles_shows_films_by_their_mean_transmittance(core, scene, objects):
    """Half of the light passes a polariser, and a note says that Cycles has no polarisation."""

    def shown() -> float:
        reading = core.blender.read.scene.read(bpy.context)
        source = np.ones((64, 64, 3), np.float32)
        preview = core.blender.preview.cycles_preview
        return float(preview.render_preview(scene, reading, source, samples=4)[..., :3].mean())

    looks = core.blender.read.part_roles.in_blender("DISPLAY").looks
    before = shown()
    assert not looks(core.blender.read.scene.read(bpy.context).rig)[1]
    film = sheet("WAVE_PLATE")
    assert shown() == pytest.approx(before, rel=0.01)
    film.kiriko.role = "POLARISER"
    assert shown() == pytest.approx(before / 2, rel=0.01)
    (note,) = looks(core.blender.read.scene.read(bpy.context).rig)[1]
    assert "Cycles has no polarisation" in str(note)


def test_a_reflective_polariser_is_a_half_mirror(core, scene, objects):
    """Its setting is read."""
    thing = sheet("HALF_MIRROR")
    thing.kiriko.element.polarising = True
    (mirror,) = core.blender.read.scene.read(bpy.context).rig.half_mirrors
    assert mirror.polarising
    assert replace(mirror, polarising=False).amplitudes != mirror.amplitudes


@pytest.mark.parametrize("kind", ["AIRR_POLARISED", "KOIZUMI_SANO"])
def test_systems_made_of_objects_polarise_as_in_core(core, scene, kind):
    """Axes survive the way into objects and back: the same rays are as bright."""
    assert bpy.ops.kiriko.add_rig(kind=kind) == {"FINISHED"}
    made = core.blender.read.scene.read(bpy.context).rig
    expected = loaded("core.bench.systems").SYSTEMS[kind].make()
    xy = np.random.default_rng(0).uniform(0.4, 0.6, (200, 2)) * expected.viewer.width
    shares = []
    for a_rig in (made, expected):
        plan = core.light.compile_plan.compile_plan(a_rig, core.rig.settings.Settings())
        found = core.light.trace.trace_all(plan, *expected.viewer.rays(xy))
        shares.append(np.zeros(200))
        np.maximum.at(shares[-1], found.sample, found.throughput * found.has_arrived)
    assert shares[1].mean() > 0.1
    np.testing.assert_allclose(*shares, rtol=1e-3)
