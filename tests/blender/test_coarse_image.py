"""The coarse image that a solve in the interface shows before its end."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from long_work import (
    ESC,
    TIMER,
    Window,
    broken,
    errors,
    forget,
    is_sentence,
    part,
    pressed,
    product,
    state,
    to_the_end,
    whole,
)
from small_rigs import inventory, pixels


@pytest.fixture
def shown(rig: dict, monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The coarse source images that were shown.

    The rig is large enough for one, and nobody waits for it.
    """
    ours = bpy.context.scene.kiriko.viewer.kiriko
    ours.resolution = (160, 160)
    first_picture = part("core.solve.first_picture")
    solve = part("operators.solve")
    images = []
    monkeypatch.setattr(first_picture, "WAIT_S", 0.0)
    write = solve.write_coarse
    monkeypatch.setattr(solve, "write_coarse", lambda *a: (images.append(a[-1]), write(*a))[1])
    bpy.ops.ed.undo_push(message="rig")
    return images


def step(operator: Any, window: Window, shown: list) -> None:
    """Go on until a coarse image is shown."""
    while not shown:
        assert operator.modal(window, TIMER) == {"PASS_THROUGH"}, operator.said


def is_of_coarse(image: np.ndarray) -> bool:
    """Is the result a coarse image, packed, on the display, and no more?"""
    scene = bpy.context.scene
    result = scene.kiriko.result
    display = next(o for o in scene.objects if o.kiriko.role == "DISPLAY")
    return (
        result.is_coarse
        and result.source.name == "Kiriko Source"
        and result.source.packed_file is not None
        and not result.source.is_dirty
        and np.array_equal(pixels(result.source)[..., :3], image)
        and part("core.blender.result.on_display").is_on_display(display, result.source)
        and not (result.summary or result.details or result.seen_summary or result.coverage)
        and not bpy.ops.kiriko.export.poll()
    )


def test_a_coarse_image_is_shown_before_the_end(rig: dict, window: Window, shown: list) -> None:
    """It says that it is one, as does the status bar.

    The result is a script's to the bit, with all that it tells.
    """
    material = bpy.data.materials.new("Mine")
    rig["DISPLAY"].active_material = material
    bpy.ops.ed.undo_push(message="material")
    scene = bpy.context.scene
    told = []
    operator = pressed("solve", window)
    window.progress_update = told.append
    step(operator, window, shown)

    assert is_of_coarse(shown[0])
    assert "'Mine' of 'Kiriko Display'" in scene.kiriko.result.notes
    assert "Esc keeps" in window.status
    to_the_end(operator, window)

    assert len(shown) == 1
    assert told == sorted(told)
    assert operator.said == [("INFO", scene.kiriko.result.summary)]
    assert not scene.kiriko.result.is_coarse

    gave_way = (
        f"'Mine' of 'Kiriko Display' was replaced by '{rig['DISPLAY'].active_material.name}'."
    )

    assert gave_way in scene.kiriko.result.notes
    after = product("solve")
    assert after == whole("solve")
    assert len(shown) == 1  # by no script


def test_a_coarse_image_is_shown_in_editors_that_show_none(
    rig: dict, window: Window, shown: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An artist's image stays, and a render until the final image is there."""
    mine = bpy.data.images.new("Mine", 8, 8)
    render = type("Render", (), {"type": "RENDER_RESULT"})()
    spaces = [SimpleNamespace(image=image) for image in (None, mine, render)]
    areas = [
        SimpleNamespace(type="IMAGE_EDITOR", spaces=SimpleNamespace(active=space))
        for space in spaces
    ]
    screen = SimpleNamespace(areas=areas)
    windows = part("operators.windows")
    operator = pressed("solve", window)
    monkeypatch.setattr(windows, "all_windows", lambda: [SimpleNamespace(screen=screen)])
    monkeypatch.setattr(windows, "redraw", lambda: None)
    step(operator, window, shown)
    source = bpy.context.scene.kiriko.result.source
    assert [space.image for space in spaces] == [source, mine, render]

    spaces[0].image = None  # Blender itself puts the image there that takes its place
    to_the_end(operator, window)
    final = bpy.context.scene.kiriko.result.source
    assert [space.image for space in spaces] == [final, mine, final]


def test_esc_keeps_the_coarse_image_and_undo_takes_it_back(
    rig: dict, window: Window, shown: list, tmp_path: Path
) -> None:
    """It is an undo step of its own, is saved with the file, and the next solve makes it final."""
    before = state()[3:6]
    operator = pressed("solve", window)
    step(operator, window, shown)
    assert operator.modal(window, ESC) == {"FINISHED"}  # of which Blender makes an undo step

    bpy.ops.ed.undo_push(message="Solve")
    assert window.is_clean
    assert not part("operators.work").is_busy()
    ((_, said),) = operator.said

    assert said.startswith("Stopped; the rough image was kept. Undo")
    assert is_sentence(said)
    assert is_of_coarse(shown[0])
    bpy.ops.ed.undo()

    assert (state()[3], state()[5]) == (before[0], before[2])
    assert not bpy.context.scene.kiriko.result.is_coarse
    bpy.ops.ed.redo()
    assert is_of_coarse(shown[0])

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert is_of_coarse(shown[0])
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert not bpy.context.scene.kiriko.result.is_coarse

    after = product("solve")
    assert after == whole("solve")


@pytest.mark.parametrize("point", ["trace", "paint", "write"])
def test_an_error_after_the_coarse_image_leaves_it(
    rig: dict, window: Window, shown: list, point: str
) -> None:
    """Marked as partial, and told; the earlier image is an undo away."""
    for error in errors():
        shown.clear()
        forget()
        operator = pressed("solve", window)
        step(operator, window, shown)
        with broken(point, error):
            outcome, _ = to_the_end(operator, window)
        assert outcome == {"FINISHED"}
        ((level, said),) = operator.said
        assert level == "ERROR"
        assert is_sentence(said)
        assert "the rough image was kept (Undo removes it)" in said
        assert is_of_coarse(shown[0])
        assert window.is_clean
        bpy.ops.ed.undo_push(message="Solve")

    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_a_coarse_image_that_cannot_be_written_changes_nothing(
    rig: dict, window: Window, shown: list
) -> None:
    """An error while it is put in place ends the solve with the result of before."""
    before = state()
    operator = pressed("solve", window)
    with broken("write", ValueError("odd")):
        outcome, _ = to_the_end(operator, window)
    assert outcome == {"CANCELLED"}
    assert "the scene is unchanged" in operator.said[-1][1]
    assert state() == before


def test_what_happens_to_the_file_after_the_coarse_image(
    rig: dict, window: Window, shown: list, tmp_path: Path
) -> None:
    """Where its window closes it stays.

    Undo and another file take it away, and nothing is said of it then.
    """
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    for happen, key in (
        (bpy.ops.ed.undo, ESC),
        (bpy.ops.ed.undo, TIMER),
        (lambda: bpy.ops.wm.open_mainfile(filepath=path), ESC),
        (lambda: bpy.ops.wm.open_mainfile(filepath=path), TIMER),
    ):
        forget()
        bpy.context.scene.kiriko.margin += 1
        bpy.ops.ed.undo_push(message="margin")
        shown.clear()
        operator = pressed("solve", window)
        step(operator, window, shown)
        happen()
        before = state()
        outcome, _ = to_the_end(operator, window, key)
        assert outcome == {"CANCELLED"}
        assert "coarse" not in operator.said[-1][1]
        assert window.is_clean
        assert state() == before
        assert not bpy.context.scene.kiriko.result.is_coarse

    shown.clear()
    forget()
    operator = pressed("solve", window)
    step(operator, window, shown)
    operator.cancel(window)

    assert window.is_clean
    assert is_of_coarse(shown[0])


def test_only_what_is_traced_while_somebody_watches_is_coarse(
    rig: dict, window: Window, shown: list
) -> None:
    """No coarse image is made for another picture, nor beside Live,
    which would take one for its own; none is left.
    """
    live = part("operators.live")
    before = inventory()

    def solve() -> None:
        operator = pressed("solve", window)
        to_the_end(operator, window)
        assert operator.said[-1][0] == "INFO"

    solve()
    assert len(shown) == 1
    assert inventory() == before
    rig["PICTURE"].kiriko.image = bpy.data.images.new("white", 8, 8)
    solve()

    assert len(shown) == 1
    live.start(bpy.context.scene)
    try:
        rig["GLASS"].rotation_euler.z += 0.1
        solve()
    finally:
        live.stop()

    assert len(shown) == 1
