"""Work that is stopped or fails at any of its stages, and what becomes of the last result, the
scene and the files.
"""

from collections import Counter
from functools import partial
from math import inf

import bpy
import numpy as np
import pytest

from long_work import (
    ESC,
    EXTENSION,
    FEW,
    LONG,
    POINTS,
    SAMPLES,
    TIMER,
    asked,
    broken,
    errors,
    everything,
    forget,
    is_sentence,
    part,
    pressed,
    product,
    refusal,
    run,
    settle,
    state,
    tap,
    to_the_end,
    traces,
    whole,
)
from small_rigs import cube

TRACES = ("read", "plan", "trace")
FEW_TURNS = {"render_pictures", "draw_light_paths"}  # one for each viewer, or two in all
# the points that the work of an operator passes
PASSED = {
    "solve": tuple(POINTS),
    "simulate": (*TRACES, "write"),
    "visible_range": (*TRACES, "write"),
    "eye_box": (*TRACES, "write"),
    "draw_light_paths": (*TRACES, "write"),
    "render_pictures": ("read", "paint", "write"),
    "report": (*TRACES, "write"),
    "export_maps": (*TRACES, "write"),
    "export": ("write",),
    "preview": ("read", "paint", "write"),
    **dict.fromkeys(("fit_display", "fit_plate", "fit_picture_size"), TRACES),
    **dict.fromkeys(("best_place", "turn_back"), TRACES),
}


@pytest.mark.parametrize("name", LONG)
def test_esc_at_every_step_changes_nothing(rig, window, monkeypatch, name):
    """Wherever it is stopped all is as before.

    A result made afterwards is, to the bit, that of a fresh session.
    """
    monkeypatch.setattr(part("operators.remedies"), "SECONDS", inf)  # as many steps at any pace
    operator = pressed(name, window)
    _, n_steps = to_the_end(operator, window)

    # another result, in as many steps
    rig["PICTURE"].kiriko.image = bpy.data.images.new("white", 8, 8)
    before = state()
    for k in np.unique(np.linspace(0, n_steps, SAMPLES).astype(int)):
        forget()  # parts kept of a solve that was stopped save steps
        operator = pressed(name, window)
        for _ in range(k):
            assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert operator.modal(window, ESC) == {"CANCELLED"}
        assert window.is_clean
        assert not part("operators.work").is_busy()
        assert state() == before, k

    operator = pressed(name, window)
    to_the_end(operator, window)
    is_of_the_old = name == "simulate"  # the sight of a result that is out of date

    assert operator.said[-1][0] == ("WARNING" if is_of_the_old else "INFO"), operator.said
    assert window.is_clean
    after = product(name)
    assert after == whole(name)


@pytest.mark.parametrize("name", PASSED)
def test_an_error_at_any_point_is_one_sentence_and_changes_nothing(rig, monkeypatch, capsys, name):
    """Whatever goes wrong, foreseen or not, when a point is passed first or last, the last result
    and the scene survive. The next time all is well.
    """
    if PASSED[name] == TRACES:  # there is something to be mended
        rig["PICTURE"].location.x += 0.006
        rig["DISPLAY"].scale *= 0.8
        bpy.context.view_layer.update()

    def check(point: str, error: BaseException, nth: int) -> None:
        forget()  # or there is no tracing
        before = state()
        with broken(point, error, nth):
            text = refusal(run(name))
        assert state() == before, (point, error, nth)
        is_foreseen = isinstance(error, part("core.base.errors").KirikoError)
        assert text == str(error) if is_foreseen else "the scene is unchanged" in text
        assert ("Traceback" in capsys.readouterr().err) == (not is_foreseen)

    foreseen, odd = errors()[:2]
    for point in PASSED[name]:
        for error in (foreseen, odd):
            check(point, error, 1)
    forget()
    if PASSED[name] == TRACES:
        return
    passes: Counter[str] = Counter()
    with monkeypatch.context() as counted:
        for point in PASSED[name]:
            tap(counted, point, partial(passes.update, [point]))
        assert run(name)() == {"FINISHED"}
    assert set(passes) == set(PASSED[name])
    if name in LONG:
        assert product(name) == whole(name)

    # another result, in as many steps
    rig["PICTURE"].kiriko.image = bpy.data.images.new("white", 8, 8)
    for point in PASSED[name] if name != "report" else ():  # which takes its time
        if passes[point] > 1:
            check(point, odd, passes[point])


def test_an_error_in_the_interface_ends_the_work(rig, window):
    """Timer, status bar and progress go with it, and Live, which
    waits for long work to end, is not kept waiting.
    """
    for error in errors():
        operator = pressed("solve", window)
        operator.modal(window, TIMER)
        with broken("paint", error):
            outcome, _ = to_the_end(operator, window)
        assert outcome == {"CANCELLED"}
        (said,) = operator.said
        assert said[0] == "ERROR"
        assert is_sentence(said[1])
        assert window.is_clean
        assert not part("operators.work").is_busy()


@pytest.mark.parametrize("is_given", [True, False])
def test_esc_at_many_steps_of_add_rig_leaves_nothing(window, is_given):
    """Around a given glass, or a new ball, no object is made and no role is set until
    all is known.
    """
    if is_given:
        cube()
    before = state()
    n_steps = 0
    operator = pressed("add_rig", window)
    operator.viewer_resolution = 64

    assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
    while state() == before and operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        n_steps += 1
    assert operator.said[-1][0] in {"INFO", "WARNING"}
    assert n_steps > 3
    assert window.is_clean

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if is_given:
        cube()
    forget()
    before = state()

    for k in np.unique(np.linspace(0, n_steps - 1, 2 * SAMPLES).astype(int)):
        forget()  # parts kept of work that was stopped save steps
        operator = pressed("add_rig", window)
        operator.viewer_resolution = 64
        for _ in range(k):
            assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert operator.modal(window, ESC) == {"CANCELLED"}
        assert window.is_clean
        assert state() == before, k


def test_long_work_of_one_window_is_waited_for_in_another(rig, window):
    """A second one would have both take twice as long, in one session: it is refused with a
    sentence, changes nothing, and begins once the first has ended.
    """
    first = pressed("solve", window)
    second = asked("simulate")
    status = window.status
    assert second.invoke(window, None) == {"CANCELLED"}
    assert second.said == [("WARNING", "Kiriko is busy: wait, or press Esc.")]
    assert (len(window.timers), window.status) == (1, status)
    while first.modal(window, TIMER) != {"FINISHED"}:
        pass
    assert window.is_clean
    assert second.invoke(window, None) == {"RUNNING_MODAL"}
    second.cancel(window)
    assert window.is_clean


@pytest.mark.parametrize("point", ["read", "plan", "trace", "write"])
def test_a_rig_that_cannot_be_made_leaves_nothing(scene, point):
    """Add Rig, broken in its midst, takes back all that it made and set."""
    cube()
    before = state()
    for error in errors()[:FEW]:
        forget()  # or the glass is ready already
        with broken(point, error):
            refusal(lambda: bpy.ops.kiriko.add_rig(viewer_resolution=64))
        assert state() == before
    assert bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64)) == {"FINISHED"}


def test_an_error_in_live_is_one_sentence_and_the_image_stays(rig, live):
    """One that was foreseen leaves it on.

    Of any other it ends, leaves nothing behind, and can be turned on again.
    """
    for point in POINTS:
        for error in errors()[:FEW]:
            rig["GLASS"].rotation_euler.z += 0.01
            bpy.context.view_layer.update()
            before = state()
            with broken(point, error):
                settle()
            assert state()[1:] == before[1:], (point, error)
            assert is_sentence(live.status()[0])
            assert live.is_on() == isinstance(error, part("core.base.errors").KirikoError)
            if live.is_on():
                rig["GLASS"].rotation_euler.z += 0.01
                bpy.context.view_layer.update()
            else:
                assert traces() == []
                bpy.ops.kiriko.live()
            settle()
            assert not live.status()[1]

    near = np.frombuffer(product("solve"), np.float32)
    # glass that was turned: to rounding
    assert np.abs(near - np.frombuffer(whole("solve"), np.float32)).max() < 1e-6


@pytest.mark.parametrize("name", LONG)
def test_another_file_in_the_middle_is_not_written_to(rig, window, tmp_path, name):
    """Saving makes no difference.

    After a load or undo the work ends in a sentence, and nothing is written.
    """
    work = part("operators.work")
    path = str(tmp_path / "rig.blend")
    events = {
        "save": lambda: bpy.ops.wm.save_as_mainfile(filepath=path),
        "undo": bpy.ops.ed.undo,
        "load": lambda: bpy.ops.wm.open_mainfile(filepath=path),
    }
    for event, happen in events.items():
        for is_closed in (True, False):
            work.forget()
            bpy.ops.ed.undo_push(message="before")
            bpy.context.scene.kiriko.margin += 1
            bpy.ops.ed.undo_push(message="margin")
            operator = pressed(name, window)
            for _ in range(1 if name in FEW_TURNS else 3):
                assert operator.modal(window, TIMER) == {"PASS_THROUGH"}, operator.said
            happen()
            before = everything()
            if is_closed:  # as Blender does it in its interface
                operator.cancel(window)
            else:
                outcome, _ = to_the_end(operator, window)
                assert outcome == ({"FINISHED"} if event == "save" else {"CANCELLED"})
                assert is_sentence(operator.said[-1][1])
            assert window.is_clean
            assert not work.is_busy()
            assert everything() == before or (event == "save" and not is_closed)

    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_disabling_the_extension_ends_long_work(rig, window):
    """In the middle of a solve, too, timer and status bar go with it.

    Enabled again, it solves as before.
    """
    for n_steps in (0, 1, 5):
        before = state()
        operator = pressed("solve", window)
        for _ in range(n_steps):
            operator.modal(window, TIMER)
        bpy.ops.preferences.addon_disable(module=EXTENSION)
        try:
            assert window.is_clean
            assert operator._work.gi_frame is None
            assert not part("operators.work")._running
        finally:
            bpy.ops.preferences.addon_enable(module=EXTENSION)
        assert state() == before

    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    after = product("solve")
    assert after == whole("solve")


def test_disabling_the_extension_in_the_middle_of_live_and_enabling_it_again(rig, live):
    """Nothing of it is left, the image is saved with the file.

    Turned on again, it follows as before.
    """
    for n_turns in (0, 1, 3, 6):
        rig["GLASS"].rotation_euler.z += 0.1
        bpy.context.view_layer.update()
        for _ in range(n_turns):
            live.tick()
        bpy.ops.preferences.addon_disable(module=EXTENSION)
        try:
            assert traces() == []
            assert not live.is_on()
        finally:
            bpy.ops.preferences.addon_enable(module=EXTENSION)
        assert not bpy.context.scene.kiriko.result.source.is_dirty
        bpy.ops.kiriko.live()
        settle()
        after = product("solve")
        assert after == whole("solve")
