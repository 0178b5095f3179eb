"""Fit Picture, Fit Display and Fit Plate."""

import re

import bpy
import numpy as np
import pytest

from small_rigs import cube, small_rig

SINGLE = 1e-6  # m


def corners(thing: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    return np.array([thing.matrix_world @ vertex.co for vertex in thing.data.vertices])


def metres(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"m": 1.0, "mm": 1e-3}[unit]


def coverage() -> float:
    bpy.ops.kiriko.solve()
    return bpy.context.scene.kiriko.result.coverage


PARTS = {"PICTURE": "picture_size", "DISPLAY": "display", "PLATE": "plate"}


@pytest.mark.parametrize("role", PARTS)
def test_a_part_is_as_large_as_it_has_to_be(scene, capfd, role):
    """All of the picture arrives then, its middle stays, and it says what changed.

    Where display or plate are 2 % smaller, or the picture is 2 % larger, some is lost.
    """
    sizes = {"PICTURE": {"display_size": 0.02}, "DISPLAY": {"display_size": 0.02}}
    rig = small_rig(**sizes.get(role, {"plate_size": 0.03, "display_size": 0.06}))
    thing = rig[role]
    before = corners(thing)
    lost = coverage()
    assert lost < 0.95

    assert getattr(bpy.ops.kiriko, f"fit_{PARTS[role]}")() == {"FINISHED"}
    after = corners(thing)
    assert after.mean(axis=0) == pytest.approx(before.mean(axis=0), abs=SINGLE)
    width = np.linalg.norm(after[1] - after[0])
    text = re.search(
        rf"Info: '{thing.name}' is now ([\d.]+ m+) wide: ([\d.]+) % of the picture arrives"
        r" \(([\d.]+) % before\)",
        capfd.readouterr().out,
    )
    assert metres(text[1]) == pytest.approx(width, rel=5e-3)
    assert float(text[2]) >= 99.9
    assert float(text[3]) == pytest.approx(100 * lost, abs=1.5)

    whole = coverage()
    assert whole > 0.998
    thing.scale *= 1.02 if role == "PICTURE" else 0.98
    assert coverage() < whole


def test_a_moved_part_may_be_smaller(scene):
    """A display beside the light comes to it where it may move, and is smaller than where not."""
    rig = small_rig(display_size=0.05)
    rig["DISPLAY"].location.x += 0.01
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.kiriko.fit_display()
    still = rig["DISPLAY"].dimensions.x
    bpy.ops.kiriko.fit_display(move=True)
    display = bpy.data.objects["Kiriko Display"]
    assert display.location.x == pytest.approx(0.0, abs=1e-4)
    assert display.dimensions.x < still - 0.015
    assert coverage() > 0.998


def test_units_and_parents(scene):
    """In a scene of millimetres, below a turned parent: the same size and place in the world."""
    scene.unit_settings.scale_length = 0.001
    rig = small_rig_in_mm()
    display = rig["DISPLAY"]
    parent = bpy.data.objects.new("parent", None)
    scene.collection.objects.link(parent)
    parent.rotation_euler, parent.scale = (0.3, 0.2, 0.1), (2.0, 2.0, 2.0)
    display.parent = parent
    bpy.context.view_layer.update()
    display.matrix_parent_inverse = parent.matrix_world.inverted()
    before = corners(display)
    bpy.ops.kiriko.fit_display(move=True)
    after = corners(display)
    assert np.abs(after.mean(axis=0) - before.mean(axis=0)).max() < 0.5  # mm
    ways = [np.diff(points[:2], axis=0)[0] for points in (before, after)]
    directions = [way / np.linalg.norm(way) for way in ways]
    assert directions[0] == pytest.approx(directions[1], abs=1e-5)
    assert coverage() > 0.998


def small_rig_in_mm() -> dict[str, bpy.types.Object]:

    glass = cube(side=50.0)
    glass.kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(
        viewer_resolution=64,
        display_resolution=(64, 64),
        field=40,
        picture_size=30,
        display_size=20,
    )
    return {thing.kiriko.role: thing for thing in bpy.context.scene.objects}


def test_what_is_held_says_so(scene):
    """Locked, animated, held by a constraint: the reason, and everything as it was."""
    rig = small_rig(display_size=0.02)
    display = rig["DISPLAY"]
    before = corners(display)
    display.lock_scale[0] = True
    with pytest.raises(RuntimeError, match="'Kiriko Display' keeps its size: its transform is"):
        bpy.ops.kiriko.fit_display()
    display.lock_scale[0] = False
    constraint = display.constraints.new("LIMIT_SCALE")
    constraint.use_max_x, constraint.max_x = True, 0.1
    bpy.context.view_layer.update()
    held = corners(display)
    with pytest.raises(RuntimeError, match="keeps its size: a constraint or a driver holds"):
        bpy.ops.kiriko.fit_display()
    assert (corners(display) == held).all()
    display.constraints.remove(constraint)
    display.location.x += 0.004
    display.lock_location[0] = True
    before = corners(display)
    with pytest.raises(RuntimeError, match="keeps its size: its transform is locked"):
        bpy.ops.kiriko.fit_display(move=True)
    assert (corners(display) == before).all()


@pytest.mark.parametrize("display", [1.0, 12.0])
def test_the_share_that_is_told_is_true_beside_edges_of_the_glass(scene, capfd, display):
    """Where light beside an edge goes far aside in a strip as thin as 1/500 of the picture: what
    is told is what the solve finds, and what arrived before is not cut.
    """
    cube(2.0).kiriko.use_ior = True
    bpy.ops.kiriko.add_rig()
    next(t for t in scene.objects if t.kiriko.role == "PICTURE").scale *= 2.5
    bpy.ops.kiriko.fit_display()
    next(t for t in scene.objects if t.kiriko.role == "DISPLAY").scale *= display
    before = coverage()
    capfd.readouterr()
    bpy.ops.kiriko.fit_plate()
    text = re.search(
        r": ([\d.]+) % of the picture arrives \(([\d.]+) % before", capfd.readouterr().out
    )
    after = coverage()
    assert after > before - 5e-4
    assert float(text[1]) / 100 == pytest.approx(after, abs=1e-3)
    assert float(text[2]) / 100 == pytest.approx(before, abs=1e-3)
