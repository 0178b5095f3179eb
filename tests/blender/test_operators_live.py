import time
from collections.abc import Callable, Iterator
from math import inf
from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, pixels, primitive, show_scene, small_rig

MANY = 2000  # turns of which none of these rigs needs a tenth


# what is written of a final picture whose light was traced: the picture, then its numbers, too
FINAL = ["update_final", "update_solution"]


@pytest.fixture
def live(scene, kiriko, no_remedies) -> Iterator[ModuleType]:
    """Module operators.live on an empty scene; nothing is followed before and after."""
    yield kiriko.operators.live
    kiriko.operators.live.stop()


def settle(live: ModuleType) -> int:
    """Take the timer's turns until there is nothing left to do; returns their number."""
    for n in range(MANY):
        if live.tick() == live.live_follower.IDLE:
            return n
    raise AssertionError("Live never comes to rest.")


def until(written: list[str], live: ModuleType) -> None:
    """Take the timer's turns until something is written."""
    for _ in range(MANY):
        if written:
            return
        live.tick()
    raise AssertionError("Live never writes.")


def shown() -> np.ndarray:
    return pixels(bpy.context.scene.kiriko.result.source)[..., :3].copy()


def turn(thing: bpy.types.Object, angle: float = 0.1) -> None:
    """Turn an object about z by an angle in rad. A cube that
    is only moved bends light as it did before.
    """
    thing.rotation_euler.rotate_axis("Z", angle)
    bpy.context.view_layer.update()


def plain(live: ModuleType) -> np.ndarray:
    """The source image of the scene as it is, by a session that has never solved anything."""
    work = live.work
    session, steps = (loaded(f"core.{name}") for name in ("solve.session", "base.steps"))
    solve = session.Session().solve(work.read(bpy.context).rig, work.settings_of(bpy.context.scene))
    return steps.run_steps(solve).source


def traces(live: ModuleType) -> list[str]:
    """Functions of Kiriko that Blender would still call."""
    left = [name for name, handler in live.HANDLERS if handler in getattr(bpy.app.handlers, name)]
    return left + (["timer"] if bpy.app.timers.is_registered(live.tick) else [])


@pytest.fixture
def written(live, monkeypatch) -> list[str]:
    """Names of the writes that live does, in order. Each of them is the last step of its turn,
    however fast the steps after it would be.
    """
    calls = []

    def noting(name: str, own: Callable) -> Callable:
        def write(*arguments: object) -> object:
            calls.append(name)
            found = own(*arguments)
            time.sleep(live.live_follower.TURN)
            return found

        return write

    for name in ("update_coarse", "update_final", "update_solution"):
        own = getattr(live.live_follower, name)
        monkeypatch.setattr(live.live_follower, name, noting(name, own))
    return calls


def follow(live: ModuleType, **options: object) -> dict[str, bpy.types.Object]:
    """A small rig that is followed and up to date; the objects by role."""
    rig = small_rig(**options)
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    settle(live)
    return rig


def is_rounding(difference: np.ndarray) -> bool:
    """Glass that was moved or turned keeps its engine: its
    places are right to rounding, not to the bit.
    """
    return float(np.abs(difference).max()) < 1e-6


@pytest.mark.every_blender
def test_what_moves_leads_to_the_image_of_a_plain_solve(live):
    """After glass, camera, plate or picture were turned, the
    source image is that of a plain solve, to rounding.
    """
    rig = follow(live)
    before = shown()
    assert is_rounding(before - plain(live))
    for thing in (rig["GLASS"], bpy.context.scene.camera, rig["PLATE"], rig["PICTURE"]):
        turn(thing, 0.01)
        settle(live)
        after = shown()
        assert is_rounding(after - plain(live))
        assert not np.array_equal(after, before)
        before = after


def test_remedies_follow_the_final_image(live, monkeypatch):
    """As after Solve, where light is lost: a plate of 3 cm is too small."""
    monkeypatch.setattr(loaded("operators.remedies"), "SECONDS", inf)
    rig = follow(live)
    result = bpy.context.scene.kiriko.result
    kept = loaded("core.blender.data.stored_records")
    assert "helps" not in kept.StoredNumbers.read(result.details).by_name
    rig["PLATE"].scale *= 0.03 / max(rig["PLATE"].dimensions)
    bpy.context.view_layer.update()
    settle(live)
    helps = kept.StoredNumbers.read(result.details).by_name["helps"]
    assert "kiriko.fit_plate" in {help["operator"] for help in helps}


@pytest.mark.parametrize("is_live", [False, True])
def test_undo_of_a_fit_after_live_shows_the_result_of_the_scene(live, tmp_path, is_live):
    """The display has its size of before and the result is the one that Live made for it, not that
    of an older scene, whether Live is on or off by then, and a file was saved meanwhile.
    """
    watch = loaded("operators.watch")
    rig = small_rig()
    bpy.ops.kiriko.solve()
    first = shown()
    bpy.ops.ed.undo_push(message="solved")
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    turn(rig["GLASS"], 0.3)
    bpy.ops.ed.undo_push(message="turned")
    settle(live)
    after = shown()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"), copy=True)
    if not is_live:
        bpy.ops.kiriko.live()
    width = rig["DISPLAY"].dimensions.x
    assert bpy.ops.kiriko.fit_display() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Fit Display")
    assert rig["DISPLAY"].dimensions.x != pytest.approx(width, rel=1e-3)
    live.stop()

    bpy.ops.ed.undo()
    assert bpy.data.objects["Kiriko Display"].dimensions.x == pytest.approx(width)
    assert np.array_equal(shown(), after)
    assert not watch.has_changed(bpy.context)
    bpy.ops.ed.undo()
    assert np.array_equal(shown(), first)
    bpy.ops.ed.redo()
    assert np.array_equal(shown(), after)


@pytest.mark.parametrize("first", ["nothing", "solved", "other size"])
@pytest.mark.parametrize("is_live", [False, True])
def test_undo_into_live_takes_no_image_for_that_of_its_numbers(live, first, is_live):
    """Nor one that was never packed: of a rig that Live alone has solved, or that got another
    display. With Live on as it is undone, Live packs what it shows when it is stopped at once.
    """
    watch = loaded("operators.watch")
    rig = small_rig()
    if first != "nothing":
        bpy.ops.kiriko.solve()
    if first == "other size":
        rig["DISPLAY"].kiriko.resolution[0] //= 2
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    settle(live)
    for message, angle in (("one", 0.3), ("two", 0.2)):
        turn(rig["GLASS"], angle)
        settle(live)
        assert np.abs(shown() - plain(live)).max() < 1e-5
        bpy.ops.ed.undo_push(message=message)
    if not is_live:
        live.stop()
        bpy.ops.ed.undo_push(message="more")
        assert not watch.has_changed(bpy.context)

    bpy.ops.ed.undo()
    live.stop()
    assert np.abs(shown() - plain(live)).max() > 0.5
    assert watch.has_changed(bpy.context)


@pytest.mark.parametrize("is_changed", [False, True])
def test_live_keeps_the_image_of_an_opened_file(live, tmp_path, monkeypatch, is_changed):
    """A file that was solved and saved: nothing is solved or written while the scene is the same,
    not even a coarse image; where it was changed after the solve, it is.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = small_rig()
    bpy.ops.kiriko.solve()
    before = shown()
    if is_changed:
        turn(rig["GLASS"], 0.3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "solved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "solved.blend"))
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    settle(live)
    assert (live.followed().n_pictures > 0) == is_changed
    assert np.array_equal(shown(), before) != is_changed
    assert not bpy.context.scene.kiriko.result.is_coarse


def test_a_coarse_picture_comes_first(live, written, monkeypatch):
    """A viewer of 192 pixels is solved with 64 first, into an
    image of full size that is near the final one.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = follow(live, viewer_resolution=192)
    assert written == ["update_coarse", *FINAL]
    written.clear()
    turn(rig["GLASS"])
    until(written, live)
    coarse = shown()
    settle(live)

    assert written == ["update_coarse", *FINAL]
    assert coarse.shape == shown().shape
    off = np.abs(coarse - shown()).mean()
    moved = np.abs(shown() - np.roll(shown(), 4, axis=1)).mean()

    # the first picture shows where things are: a shift by 4 pixels is far more
    assert 0 < off < 0.1 * moved


def test_the_first_coarse_picture_is_on_the_display(live, written, monkeypatch):
    """Of a rig that was never solved, too: who looks through hard glass would see a dark display
    until the final picture. The note on the material that gave way is in the final result.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = small_rig(viewer_resolution=208)
    own = bpy.data.materials.new("Own Display")
    rig["DISPLAY"].data.materials.clear()
    rig["DISPLAY"].data.materials.append(own)
    live.start(bpy.context.scene)
    until(written, live)
    result = bpy.context.scene.kiriko.result
    assert result.is_coarse
    assert images_on(rig["DISPLAY"]) == [result.source]

    settle(live)
    assert written == ["update_coarse", *FINAL]
    assert images_on(rig["DISPLAY"]) == [result.source]
    assert result.notes.count("'Own Display'") == 1


def images_on(thing: bpy.types.Object) -> list[bpy.types.Image]:
    """The images that an object's materials show."""
    nodes = [node for slot in thing.material_slots for node in slot.material.node_tree.nodes]
    return [node.image for node in nodes if node.type == "TEX_IMAGE"]


def test_a_coarse_picture_is_not_exported(live, written, monkeypatch, tmp_path):
    """Where Live is turned off before the final picture, that is said, until a solve has
    made it; numbers of the picture before are not told beside it.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = follow(live, viewer_resolution=192)
    written.clear()
    turn(rig["GLASS"])
    until(written, live)
    result = bpy.context.scene.kiriko.result
    assert result.summary
    live.stop()

    assert result.is_coarse
    assert (result.summary, result.details) == ("", "")
    with pytest.raises(RuntimeError, match="final"):
        bpy.ops.kiriko.export(filepath=str(tmp_path / "source.png"))
    assert not list(tmp_path.iterdir())

    bpy.ops.kiriko.solve()
    assert bpy.ops.kiriko.export(filepath=str(tmp_path / "source.png")) == {"FINISHED"}


def test_writing_does_not_start_the_next_update(live, written):
    """Once up to date nothing more is written, whatever Blender tells
    of our own writing and of properties that do not count.
    """
    rig = follow(live)
    turn(rig["GLASS"])
    settle(live)
    written.clear()

    for change in (
        lambda: None,
        lambda: rig["GLASS"].select_set(False),
        lambda: new_object(primitive("cube", size=0.1)),
        lambda: bpy.context.scene.kiriko.result.source.update_tag(),
        lambda: setattr(rig["GLASS"], "name", "Renamed"),
    ):
        change()
        bpy.context.view_layer.update()
        settle(live)
        settle(live)

    assert written == []


@pytest.mark.parametrize(
    ("owner", "name", "value"),
    [
        ("GLASS", "ior", 1.6),
        ("DISPLAY", "resolution", (48, 48)),
        ("SCENE", "brightness", True),
        ("VIEWER", "resolution", (48, 32)),
        ("VIEWER", "use_resolution", False),
    ],
)
def test_settings_count_without_an_event(live, owner, name, value):
    """A script that changes one of Kiriko's settings wakes
    no handler, and is followed all the same.
    """
    rig = follow(live)
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 40, 50
    before = shown()
    scene = bpy.context.scene
    setattr({**rig, "SCENE": scene, "VIEWER": scene.kiriko.viewer}[owner].kiriko, name, value)
    settle(live)
    assert not np.array_equal(shown(), before)
    assert is_rounding(shown() - plain(live))


def test_new_picture_costs_no_tracing(live, written):
    """New pixels in the picture's image, or a margin, are painted at once, with the rays
    of before.
    """
    rig = follow(live, viewer_resolution=192)
    image = rig["PICTURE"].kiriko.image = bpy.data.images.new("mine", 8, 8)
    settle(live)
    written.clear()
    image.pixels.foreach_set(np.tile(np.array([1, 0, 0, 1], np.float32), 64))
    image.update_tag()
    bpy.context.view_layer.update()
    settle(live)

    assert written == ["update_solution"]
    assert '"rays": 0' in bpy.context.scene.kiriko.result.details
    assert shown()[..., 0].max() > 0.9
    assert shown()[..., 1:].max() == 0

    bpy.context.scene.kiriko.margin = 4
    settle(live)
    assert written == ["update_solution"] * 2
    assert '"rays": 0' in bpy.context.scene.kiriko.result.details


def test_what_solve_has_written_stays(live, written):
    """Begun after Solve it writes nothing until something changes; begun after undo, which may
    have put back the image alone, it paints anew, with the rays of before and nothing coarse.
    """
    rig = small_rig(viewer_resolution=192)
    bpy.ops.ed.undo_push(message="rig")
    bpy.ops.kiriko.solve()
    before = shown()
    bpy.ops.ed.undo_push(message="solved")
    for _ in range(2):
        bpy.ops.kiriko.live()
        assert live.status() == ("Live: reading the scene...", False)
        settle(live)
        assert written == []
        assert live.status() == ("Live: up to date.", False)
        assert np.array_equal(shown(), before)
        bpy.ops.kiriko.live()

    bpy.ops.kiriko.live()
    settle(live)
    turn(rig["GLASS"])
    settle(live)
    assert written[-1:] == ["update_solution"]
    assert not np.array_equal(shown(), before)
    live.stop()

    turn(rig["GLASS"], -0.1)
    bpy.ops.kiriko.solve()
    bpy.ops.ed.undo_push(message="turned back")
    bpy.ops.object.add()
    bpy.ops.ed.undo_push(message="added")
    bpy.ops.ed.undo()
    written.clear()
    bpy.ops.kiriko.live()
    settle(live)
    assert written == ["update_solution"]
    assert '"rays": 0' in bpy.context.scene.kiriko.result.details
    assert is_rounding(shown() - plain(live))


def test_what_solve_has_put_elsewhere_is_put_back(live, written):
    """A display whose material is another one by now gets the image again."""
    rig = small_rig()
    bpy.ops.kiriko.solve()
    rig["DISPLAY"].material_slots[0].material = bpy.data.materials.new("Mine")
    bpy.ops.kiriko.live()
    settle(live)
    assert written == ["update_solution"]
    image = bpy.context.scene.kiriko.result.source
    assert loaded("core.blender.result.on_display").is_on_display(rig["DISPLAY"], image)


def test_frames_are_followed(live):
    """An animated part is solved where it stands at the new frame."""
    rig = small_rig()
    for frame, angle in ((1, 0.0), (9, 0.2)):
        rig["GLASS"].rotation_euler.z = angle
        rig["GLASS"].keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(1)
    bpy.ops.kiriko.live()
    settle(live)
    before = shown()
    bpy.context.scene.frame_set(5)
    settle(live)
    assert not np.array_equal(shown(), before)
    assert is_rounding(shown() - plain(live))


def test_the_final_picture_comes_before_its_numbers(live, written, drawn, monkeypatch):
    """These take their time while nothing changes; a newer change ends them, and its picture comes
    as soon. Until they are there the result is none that could be exported, and that is said;
    numbers of the picture before are not told.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", np.inf)
    rig = follow(live)
    turn(rig["GLASS"])
    settle(live)
    result = bpy.context.scene.kiriko.result
    details, before = result.details, result.solved_for

    for _ in range(2):
        written.clear()
        turn(rig["GLASS"])
        until(written, live)
        assert written == FINAL[:1]
        assert is_rounding(shown() - plain(live))
        assert (result.is_coarse, result.summary, result.details) == (False, "", "")
        assert result.solved_for != before
        assert " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts) == (
            "Final image; still measuring..."
        )
        assert not bpy.ops.kiriko.export.poll()

    final = shown()
    settle(live)
    assert written == FINAL
    assert not result.is_coarse
    assert result.details != details
    np.testing.assert_array_equal(shown(), final)


def test_a_picture_may_stay_without_numbers(live, written, drawn):
    """Where nothing is at work any more: panel and export say so, it is saved with the file, and a
    solve has its numbers.
    """
    rig = follow(live)
    result = bpy.context.scene.kiriko.result
    turn(rig["GLASS"])
    written.clear()
    until(written, live)
    live.stop()
    assert written == FINAL[:1]
    final = shown()
    words = "The source image isn't final"
    panel = " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts)
    assert panel == f"{words}: press Solve, or let Live finish."
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.export(filepath="/nowhere.png")
    assert result.source.packed_file is not None
    result.source.reload()
    np.testing.assert_array_equal(shown(), final)

    bpy.ops.kiriko.solve()
    assert words not in " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").texts)
    assert is_rounding(shown() - final)
    assert result.details


def test_what_solve_wrote_is_not_kept_once_live_has_shown_another(live, written, monkeypatch):
    """Solved; then Live is stopped after a coarse picture of turned glass, which is turned back:
    the scene is the one that was solved, but the picture is not.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = small_rig(viewer_resolution=192)
    place = rig["GLASS"].matrix_world.copy()
    bpy.ops.kiriko.solve()
    before = shown()
    live.start(bpy.context.scene)
    settle(live)
    assert written == []
    turn(rig["GLASS"], 0.3)
    until(written, live)
    live.stop()
    assert not np.array_equal(shown(), before)

    rig["GLASS"].matrix_world = place
    bpy.context.view_layer.update()
    live.start(bpy.context.scene)
    settle(live)
    assert is_rounding(shown() - before)
    assert not bpy.context.scene.kiriko.result.is_coarse


def test_a_newer_change_ends_the_finer_picture_but_not_the_first(live, written, monkeypatch):
    """While something is dragged, first pictures follow each other.

    The final one comes when it stands still.
    """
    monkeypatch.setattr(live.live_follower, "QUICK", 0.0)
    rig = follow(live, viewer_resolution=192)
    written.clear()
    for _ in range(100):
        turn(rig["GLASS"], 1e-3)
        live.tick()
    assert len(written) > 4
    assert set(written) == {"update_coarse"}
    settle(live)
    assert written[-1] == "update_solution"
    assert is_rounding(shown() - plain(live))


@pytest.mark.parametrize("role", ["GLASS", "PLATE", "DISPLAY", "PICTURE"])
def test_deleted_object_is_one_sentence_and_the_image_stays(live, role):
    """A rig without one of its parts is named; the last image
    stays, in the middle of a solve, too; live goes on.
    """
    rig = follow(live)
    before = shown()
    turn(rig["GLASS"])
    live.tick()
    bpy.data.objects.remove(rig[role])
    bpy.context.view_layer.update()
    settle(live)
    text, is_problem = live.status()

    # a rig without a plate is one, whose light goes straight on and misses this display
    missing = "no ray reaches the display" if role == "PLATE" else f"no {role.lower()}"
    assert is_problem
    assert missing in text
    assert live.is_on()
    assert shown().shape == before.shape

    if role != "GLASS":
        turn(rig["GLASS"])
        settle(live)
        assert live.status() == (text, True)


def test_what_cannot_be_solved_is_followed_on(live):
    """A plate that no ray reaches is one sentence; moved back, the image is that of before."""
    rig = follow(live)
    before = shown()
    rig["PLATE"].location.x += 10
    bpy.context.view_layer.update()
    settle(live)

    assert live.status()[1]
    assert "no ray reaches the plate" in live.status()[0]
    assert np.array_equal(shown(), before)
    rig["PLATE"].location.x += 0.01
    bpy.context.view_layer.update()
    settle(live)

    assert live.status()[1]
    rig["PLATE"].location.x -= 10.01
    bpy.context.view_layer.update()
    settle(live)

    assert not live.status()[1]
    assert is_rounding(shown() - plain(live))


def test_undo_is_followed(live):
    """After undo, also in the middle of an update, the image is that of the scene as it then is."""
    small_rig()
    bpy.ops.kiriko.live()
    settle(live)
    before = shown()
    bpy.ops.ed.undo_push(message="rig")

    for n_turns in (0, MANY):
        glass = next(thing for thing in bpy.context.scene.objects if thing.kiriko.role == "GLASS")
        turn(glass)
        live.tick()
        if n_turns:
            settle(live)
            assert not np.array_equal(shown(), before)
        bpy.ops.ed.undo_push(message="move")
        bpy.ops.ed.undo()
        settle(live)
        assert live.is_on()
        assert np.array_equal(shown(), before)

    bpy.ops.ed.redo()
    settle(live)
    assert is_rounding(shown() - plain(live))
    assert not np.array_equal(shown(), before)


def show_another_scene(path: str) -> None:
    show_scene(bpy.data.scenes.new("other"))


def load_another_file(path: str) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def load_the_file_again(path: str) -> None:
    bpy.ops.wm.revert_mainfile()


def load_a_copy_of_the_file(path: str) -> None:
    """Which is another file, by its path."""
    bpy.ops.wm.save_as_mainfile(filepath=f"{path}.blend")
    bpy.ops.wm.open_mainfile(filepath=path)


STOPS = {
    show_another_scene: "its scene isn't open.",
    load_another_file: "its scene isn't open.",
    load_the_file_again: "its scene isn't open.",
    load_a_copy_of_the_file: "its scene isn't open.",
}


@pytest.mark.parametrize("happen", STOPS)
@pytest.mark.parametrize("n_turns", [0, 3, MANY])
def test_another_scene_or_file_stops_it(live, tmp_path, happen, n_turns):
    """At any moment: nothing of it is left, and the panel says why until the next file."""
    path = str(tmp_path / "rig.blend")
    rig = follow(live)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    turn(rig["GLASS"])
    for _ in range(n_turns):
        live.tick()
    happen(path)
    assert live.tick() is None
    assert not live.is_on()
    assert traces(live) == []
    assert live.status()[0] == f"Live stopped: {STOPS[happen]}"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert live.status() == ("", False)


@pytest.mark.parametrize("n_turns", [0, 1, 3, None])
def test_a_file_that_is_not_there_stops_nothing(live, tmp_path, n_turns):
    """Blender tells that another file is about to be loaded, and then that it is not. The image is
    saved within the file as ever.
    """
    rig = follow(live)
    turn(rig["GLASS"])
    if n_turns is None:
        settle(live)
    for _ in range(n_turns or 0):
        live.tick()
    with pytest.raises(RuntimeError, match="Cannot read file"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved away.blend"))
    assert live.is_on()
    settle(live)
    assert live.status()[0].startswith("Live: up to date")
    expected = plain(live)
    assert is_rounding(shown() - expected)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert is_rounding(shown() - expected)


def test_image_is_saved_with_the_file(live, tmp_path):
    """A file saved while live is on holds the image that is shown."""
    rig = follow(live)
    turn(rig["GLASS"])
    settle(live)
    before = shown()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert live.is_on()
    assert not bpy.context.scene.kiriko.result.source.is_dirty
    assert np.array_equal(shown(), before)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert np.array_equal(shown(), before)


@pytest.mark.every_blender
def test_turned_off_it_leaves_nothing_but_the_image(live, tmp_path):
    """Pressed again it ends; the image is packed, and no change is followed any more."""
    rig = follow(live)
    before = shown()
    assert set(traces(live)) == {"timer", *(name for name, _ in live.HANDLERS)}
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    assert not live.is_on()
    assert traces(live) == []
    assert live.status() == ("", False)
    assert not bpy.context.scene.kiriko.result.source.is_dirty
    assert np.array_equal(shown(), before)

    turn(rig["GLASS"])
    assert live.tick() is None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))

    assert np.array_equal(shown(), before)


def test_panel_and_status_bar_agree(live, drawn, monkeypatch):
    """Nothing is up to date in the panel while the status bar names a step; it is drawn anew
    whenever the text comes and goes. The numbers of a scene that has changed are faint.
    """
    rig = small_rig()
    monkeypatch.setattr(live.live_follower, "LONG", -1.0)  # each step is worth a word
    bpy.ops.kiriko.live()
    followed = live.followed()
    redrawn: list[str] = []
    monkeypatch.setattr(live.live_follower, "redraw", lambda: redrawn.append(followed._text))
    settle(live)
    summary = bpy.context.scene.kiriko.result.summary
    told = []
    changes = {False: lambda: rig["GLASS"].update_tag(), True: lambda: turn(rig["GLASS"])}
    for is_another, change in changes.items():
        change()
        is_faint = set()
        bpy.context.view_layer.update()
        for _ in range(MANY):
            is_over = live.tick() == live.live_follower.IDLE
            text = live.status()[0]
            assert (followed._text == "") == text.startswith("Live: up to date")
            assert redrawn[-1] == followed._text
            is_faint.add(
                summary in " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").faint)
            )
            told.append(text)
            if is_over:
                break
        assert is_faint == {False, is_another}
        assert summary not in " ".join(drawn("result_panel", "VIEW3D_PT_kiriko_result").faint)
    assert any("reading the scene" in text for text in told)
    assert followed._text == ""


def test_button_says_what_is_missing(live):
    """Without a display it cannot be turned on, and says so; it can always be turned off."""
    rig = small_rig()
    rig["DISPLAY"].kiriko.role = "NONE"
    with pytest.raises(RuntimeError, match="No display"):
        bpy.ops.kiriko.live()
    rig["DISPLAY"].kiriko.role = "DISPLAY"
    bpy.ops.kiriko.live()
    rig["DISPLAY"].kiriko.role = "NONE"
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    assert not live.is_on()


def test_kept_shapes_are_what_reading_anew_gives(live):
    """A mesh that stays is the same object.

    Moved, mirrored or edited it is, to the bit, that of a new reading.
    """
    shapes = loaded("core.blender.read.shapes")
    glass = small_rig()["GLASS"]
    for face in glass.data.polygons:
        face.use_smooth = face.index % 2 == 0
    kept = shapes.ShapeCache()
    told = lambda scene, depsgraph: kept.notice(depsgraph)  # noqa: E731 - the list wants a name to remove
    bpy.app.handlers.depsgraph_update_post.append(told)

    try:
        first = live.work.read(bpy.context, kept).rig
        again = live.work.read(bpy.context, kept).rig
        assert again.glasses[0].mesh is first.glasses[0].mesh
        assert again.picture.image is first.picture.image

        def edit() -> None:
            glass.data.vertices[0].co.x *= 1.5
            glass.data.update()

        for change in (
            lambda: setattr(glass, "location", (0.01, 0.02, 0.03)),
            lambda: setattr(glass, "scale", (-1.0, 1.0, 2.0)),
            edit,
            lambda: setattr(glass.kiriko, "surface", "FACETS"),
            lambda: setattr(glass.modifiers.new("more", "SUBSURF"), "levels", 2),
        ):
            before = live.work.read(bpy.context, kept).rig.glasses[0].mesh
            change()
            found = live.work.read(bpy.context, kept).rig.glasses[0].mesh
            anew = live.work.read(bpy.context).rig.glasses[0].mesh
            assert found is not before
            for name in ("vertices", "triangles", "corner_normals", "is_smooth"):
                assert np.array_equal(getattr(found, name), getattr(anew, name)), name
            assert (found.surface, found.rounding) == (anew.surface, anew.rounding)
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(told)


def test_another_scene_s_window_tells_which_one_live_follows(live, drawn):
    """There the button is not pressed, and has Live follow that scene: else nothing would happen
    in it, and one press would stop what goes on in the other window.
    """
    follow(live)
    first = bpy.context.scene
    other = bpy.data.scenes.new("other")
    panel = ("main_panel", "VIEW3D_PT_kiriko_main")
    assert "kiriko.live" in drawn(*panel).pressed
    show_scene(other)
    assert not bpy.ops.kiriko.live.poll()  # there is no rig
    small_rig()
    shown = drawn(*panel, of=other)
    assert "kiriko.live" not in shown.pressed
    assert f"Live follows the scene '{first.name}'." in " ".join(shown.texts)
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    assert live.followed().uid == other.session_uid
    settle(live)
    assert other.kiriko.result.source is not None
    assert bpy.ops.kiriko.live() == {"FINISHED"}
    assert not live.is_on()
