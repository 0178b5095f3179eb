"""Several viewers of one display, in Blender: the list, two eyes, heads over a box."""

import importlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from panel_layout import Layout
from small_rigs import inventory, pixels, record_text, short_reports, show_scene, small_rig

pytestmark = pytest.mark.usefixtures("no_remedies")

LEFT, RIGHT = "Kiriko Left Eye", "Kiriko Right Eye"


@pytest.fixture
def rig(scene: bpy.types.Scene) -> dict[str, bpy.types.Object]:
    """A rig around a cube; the objects by role."""
    return small_rig()


@pytest.fixture
def watch(kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Module operators.watch, which does not wait for quiet."""
    module = importlib.import_module(f"{kiriko.__name__}.operators.watch")
    for name in ("QUIET", "SHARE"):
        monkeypatch.setattr(module, name, 0.0)
    monkeypatch.setattr(module.chosen, "POLLING", 0.0)
    yield module
    kiriko.operators.live.stop()


def ours() -> bpy.types.PropertyGroup:
    return bpy.context.scene.kiriko


def listed() -> list[tuple[str | None, float, bool]]:
    """Camera, weight and on of each entry; None for the rig's own viewer."""
    return [(one.camera and one.camera.name, one.weight, one.is_on) for one in ours().viewers]


def read(kiriko: ModuleType) -> Any:
    """The rig as it is solved."""
    work = importlib.import_module(f"{kiriko.__name__}.operators.work")
    return work.read(bpy.context).rig


def names(kiriko: ModuleType) -> list[str]:
    return [viewer.name for viewer in read(kiriko).viewers]


def camera(x: float = 0.0, name: str = "mine") -> bpy.types.Object:
    """A copy of the rig's viewer, moved by x, with its pixels."""
    viewer = ours().viewer
    thing = viewer.copy()
    thing.name = name
    thing.location.x += x
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add(*cameras: bpy.types.Object) -> None:
    """Put cameras into the list as a click does, with each active."""
    for thing in cameras:
        bpy.context.view_layer.objects.active = thing
        bpy.ops.kiriko.add_viewer()


def details() -> dict[str, Any]:
    return json.loads(ours().result.details)


def source() -> np.ndarray:
    return pixels(ours().result.source).copy()


def test_the_viewer_of_the_rig_is_the_first_of_the_list(kiriko: ModuleType, rig: dict) -> None:
    """There is no list before there is a second one. Scripts that set the viewer go on working, and
    so do those that write the list.
    """
    viewer = ours().viewer
    assert (listed(), names(kiriko)) == ([], [viewer.name])
    add(camera())
    assert listed() == [(None, 1, True), ("mine", 1, True)]
    assert sorted(names(kiriko)) == ["Kiriko Viewer", "mine"]

    ours().viewer = camera(0.01, "other")
    assert sorted(names(kiriko)) == ["mine", "other"]
    ours().viewers.clear()
    assert names(kiriko) == ["other"]

    one = ours().viewers.add()
    one.camera, one.weight = viewer, 2.0
    assert [(v.name, v.weight) for v in read(kiriko).viewers] == [("Kiriko Viewer", 2.0)]


def test_moved_and_removed_the_first_is_always_the_viewer(kiriko: ModuleType, rig: dict) -> None:
    """Weights go along with cameras, and no camera is lost; the last one alone is no list."""
    add(camera(0.01, "b"), camera(0.02, "c"))
    for one, weight in zip(ours().viewers, (1, 2, 3), strict=True):
        one.weight = weight
    assert ours().viewer_shown == 2

    bpy.ops.kiriko.move_viewer(step=-1)
    assert listed() == [(None, 1, True), ("c", 3, True), ("b", 2, True)]
    bpy.ops.kiriko.move_viewer(step=-1)
    assert listed() == [(None, 3, True), ("Kiriko Viewer", 1, True), ("b", 2, True)]
    assert (ours().viewer.name, ours().viewer_shown) == ("c", 0)
    bpy.ops.kiriko.move_viewer(step=-1)
    assert ours().viewer.name == "c"

    bpy.ops.kiriko.remove_viewer()
    assert listed() == [(None, 1, True), ("b", 2, True)]
    assert ours().viewer.name == "Kiriko Viewer"
    ours().viewer_shown = 1
    bpy.ops.kiriko.remove_viewer()
    assert (listed(), ours().viewer.name) == ([], "Kiriko Viewer")
    assert {"b", "c"} <= {thing.name for thing in bpy.context.scene.objects}


@pytest.mark.parametrize("mode", ["OFFAXIS", "PARALLEL", "TOE"])
@pytest.mark.parametrize("fit", ["AUTO", "VERTICAL"])
def test_two_eyes_are_those_of_the_stereo_settings(
    kiriko: ModuleType, rig: dict, mode: str, fit: str
) -> None:
    """By Blender's own projection: off-axis, both see a point straight ahead at the convergence
    distance in the middle of their images; turned in, too; parallel, it is apart by the parallax.
    """
    viewer = ours().viewer
    viewer.scale = (2, 2, 2)
    viewer.data.sensor_fit, viewer.data.sensor_height = fit, 20.0
    stereo = viewer.data.stereo
    stereo.convergence_mode, stereo.interocular_distance = mode, 0.06
    stereo.convergence_distance = 0.8
    bpy.context.view_layer.update()
    place, turn, _ = viewer.matrix_world.decompose()
    assert bpy.ops.kiriko.two_eyes() == {"FINISHED"}
    assert listed() == [(None, 1, False), (LEFT, 1, True), (RIGHT, 1, True)]
    assert names(kiriko) == [LEFT, RIGHT]

    left, right = (bpy.data.objects[name] for name in (LEFT, RIGHT))
    for thing, side in ((left, -1), (right, 1)):
        expected = place + turn @ Vector((side * 0.03, 0, 0))
        assert (thing.matrix_world.translation - expected).length < 1e-6
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 64
    point = place + turn @ Vector((0, 0, -0.8))
    seen = [world_to_camera_view(scene, thing, point) for thing in (left, right)]
    size = 20.0 if fit == "VERTICAL" else viewer.data.sensor_width
    parallax = 0.03 / 0.8 * viewer.data.lens / size if mode == "PARALLEL" else 0.0
    assert seen[0][:2] == pytest.approx((0.5 + parallax, 0.5), abs=1e-5)
    assert seen[1][:2] == pytest.approx((0.5 - parallax, 0.5), abs=1e-5)
    of_rig = read(kiriko).viewers
    found = [one.project(np.array([point]))[0] / one.width for one in of_rig]
    np.testing.assert_allclose(found, [[s[0], 1 - s[1]] for s in seen], atol=1e-5)


def test_eyes_of_a_new_rig_converge_in_its_glass(kiriko: ModuleType, rig: dict) -> None:
    """65 mm apart, both see its middle in the middle of their images."""
    bpy.ops.kiriko.two_eyes()
    left, right = read(kiriko).viewers
    assert np.linalg.norm(left.position - right.position) == pytest.approx(0.065, abs=1e-6)
    for eye in (left, right):
        np.testing.assert_allclose(eye.project(np.zeros((1, 3))), [[32, 32]], atol=1e-3)


def test_eyes_go_along_with_the_viewer(kiriko: ModuleType, rig: dict) -> None:
    """Moved and turned, it takes them along; a second click takes their place."""
    bpy.ops.kiriko.two_eyes()
    before = [one.position for one in read(kiriko).viewers]
    ours().viewer.location.x += 0.1
    after = [one.position for one in read(kiriko).viewers]
    np.testing.assert_allclose(np.subtract(after, before), [[0.1, 0, 0]] * 2, atol=1e-6)

    known = inventory()
    bpy.ops.kiriko.two_eyes()
    assert inventory() == known
    add(camera())
    bpy.ops.kiriko.viewer_grid(heads=(2, 1, 1))
    assert [name for name, *_ in listed()] == [None, "mine", "Kiriko Head", "Kiriko Head.001"]
    assert LEFT not in bpy.data.objects
    assert len(bpy.data.cameras) == 3


def test_a_grid_looks_at_the_picture_from_all_over_a_box(kiriko: ModuleType, rig: dict) -> None:
    """Its cameras stand where they are asked to, in all orders; each sees the middle of the picture
    where the viewer sees it, and as large: by Blender's own projection.
    """
    viewer, scene = ours().viewer, bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 64
    middle = rig["PICTURE"].matrix_world.translation
    expected = world_to_camera_view(scene, viewer, middle)
    bpy.ops.kiriko.viewer_grid(heads=(3, 2, 2), box=(0.12, 0.06, 0.1))
    made = [one.camera for one in ours().viewers][1:]
    assert len(made) == len(names(kiriko)) == 12
    local = [viewer.matrix_world.inverted() @ thing.matrix_world.translation for thing in made]
    grid = [(x, y, -z) for x in (-0.06, 0, 0.06) for y in (-0.03, 0.03) for z in (-0.05, 0.05)]
    np.testing.assert_allclose(local, grid, atol=1e-6)
    for thing in made:
        found = world_to_camera_view(scene, thing, middle)
        assert found[:2] == pytest.approx(expected[:2], abs=1e-4)
        assert thing.data.lens / found[2] == pytest.approx(viewer.data.lens / expected[2], rel=1e-4)


def test_a_grid_before_images_of_the_viewers_own_looks_where_eyes_converge(
    kiriko: ModuleType, rig: dict
) -> None:
    """There is no plane in the room. All see the point straight ahead of the viewer at its
    convergence distance in the middle of their images, and as large, by Blender's own projection;
    and what each is to see can be solved for. A head that would be there is told of.
    """
    viewer, scene = ours().viewer, bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 64
    ours().picture_source = "IMAGE"
    viewer.data.stereo.convergence_distance = 0.9
    before = inventory()
    with pytest.raises(RuntimeError, match="is at its Convergence Plane Distance or behind it"):
        bpy.ops.kiriko.viewer_grid(heads=(1, 1, 2), box=(0, 0, 5))
    assert (inventory(), listed()) == (before, [])

    point = viewer.matrix_world @ Vector((0, 0, -0.9))
    assert bpy.ops.kiriko.viewer_grid(heads=(2, 2, 2), box=(0.12, 0.06, 0.1)) == {"FINISHED"}
    made = [one.camera for one in ours().viewers][1:]
    assert len(made) == 8
    for thing in made:
        found = world_to_camera_view(scene, thing, point)
        assert found[:2] == pytest.approx((0.5, 0.5), abs=1e-4)
        assert thing.data.lens / found[2] == pytest.approx(viewer.data.lens / 0.9, rel=1e-4)
    for one in ours().viewers:
        one.image = bpy.data.images["Kiriko Lattice"].copy()
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert len(details()["viewers"]) == 8


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"heads": (1, 1, 1)}, "The grid has 1 heads: set 2 to 1000 in all"),
        ({"heads": (100, 100, 1)}, "The grid has 10000 heads: set 2 to 1000 in all"),
        ({"heads": (1, 1, 2), "box": (0, 0, 5)}, "is at the picture 'Kiriko Picture' or behind"),
        ({"box": (float("nan"), 0, 0)}, "The grid measures nan x 0 x 0 m: set three lengths"),
        (
            {"box": (0.1, float("inf"), 0)},
            "The grid measures 0.1 x .* x 0 m: set three lengths",
        ),
    ],
)
def test_a_grid_that_cannot_be_changes_nothing(rig: dict, values: dict, words: str) -> None:
    """One sentence, and all is as it was."""
    before = inventory()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.viewer_grid(**values)
    assert (inventory(), listed()) == (before, [])


def test_an_orthographic_viewer_has_no_eyes(rig: dict) -> None:
    """One sentence, and all is as it was."""
    ours().viewer.data.type = "ORTHO"
    before = inventory()
    with pytest.raises(RuntimeError, match="'Kiriko Viewer' is orthographic"):
        bpy.ops.kiriko.two_eyes()
    assert (inventory(), listed()) == (before, [])


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("interocular_distance", NAN, "nan m apart and converge"),
        ("interocular_distance", INF, "m apart and converge"),
        ("interocular_distance", 0.0, "0 m apart and converge"),
        ("convergence_distance", NAN, "converge at nan m"),
    ],
)
def test_stereo_settings_that_are_no_lengths_are_told(
    rig: dict, name: str, value: float, told: str
) -> None:
    setattr(ours().viewer.data.stereo, name, value)
    before = inventory()
    with pytest.raises(RuntimeError, match=f"eyes of 'Kiriko Viewer' are .*{told}.*Stereoscopy"):
        bpy.ops.kiriko.two_eyes()
    if name == "convergence_distance":
        ours().picture_source = "IMAGE"
        with pytest.raises(RuntimeError, match="converge at nan m"):
            bpy.ops.kiriko.viewer_grid()
    assert (inventory(), listed()) == (before, [])


def off(*numbers: int) -> None:
    for n in numbers:
        ours().viewers[n].is_on = False


def weigh(weight: float) -> None:
    ours().viewers[1].weight = weight


def unlink() -> None:
    bpy.context.scene.collection.objects.unlink(bpy.data.objects["mine"])


BAD: dict[str, tuple[Callable[[], object], str]] = {
    "twice": (
        lambda: setattr(ours().viewers[1], "camera", ours().viewer),
        "2 viewers are named 'Kiriko Viewer': rename",
    ),
    "deleted": (
        lambda: bpy.data.objects.remove(bpy.data.objects["mine"]),
        "An entry in the viewer list has no camera",
    ),
    "deleted by hand": (
        unlink,
        "The viewer 'mine' is not in any scene",
    ),
    "0": (lambda: weigh(0), "The viewer 'mine' has Weight 0: set it above 0"),
    "-1": (lambda: weigh(-1), "The viewer 'mine' has Weight -1: set it above 0"),
    "all off": (lambda: off(0, 1), "All viewers are off. Turn one on"),
    "both sides": (
        lambda: setattr(bpy.data.objects["mine"], "location", (0, 2, -2)),
        "is between the viewers '(mine|Kiriko Viewer)' and '(mine|Kiriko Viewer)'",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_list_that_cannot_be_is_refused_in_one_sentence(rig: dict, name: str) -> None:
    """The last result stays, and so does the list."""
    add(camera(0.01))
    bpy.ops.kiriko.solve()
    before, entries = source(), len(listed())
    change, words = BAD[name]
    change()
    ours().viewer_shown = 0
    with pytest.raises(RuntimeError, match=rf"^Error: [^.]*{words}.*\.\n?$"):
        bpy.ops.kiriko.solve()
    assert np.array_equal(source(), before)
    assert len(listed()) == entries


def test_a_linked_camera_of_the_same_name_is_told_apart(rig: dict, linked: Callable) -> None:
    """It is in the list once, as the viewer is: renaming the viewer helps."""
    own = camera(0.01)
    theirs = linked(own)
    bpy.data.objects.remove(own)
    bpy.context.scene.collection.objects.link(theirs)
    add(theirs)
    ours().viewer.name = "mine"
    assert ours().viewer.name == theirs.name == "mine"
    words = "2 viewers are named 'mine': rename or remove all but"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.solve()
    ours().viewer.name = "other"
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_both_ways_to_settle_it_and_weights_reach_the_solve(kiriko: ModuleType, rig: dict) -> None:
    """The image in Blender is that of core for these viewers, to the bit; three ways, three."""
    session = importlib.import_module(f"{kiriko.__name__}.core.solve.session")
    steps = importlib.import_module(f"{kiriko.__name__}.core.base.steps")
    settings = importlib.import_module(f"{kiriko.__name__}.core.rig.settings")
    bpy.ops.kiriko.two_eyes()
    found = []
    for way, weight in (("SHARP", 1.0), ("BLENDED", 1.0), ("BLENDED", 4.0)):
        ours().disagreement = way
        ours().viewers[1].weight = weight
        bpy.ops.kiriko.solve()
        rig = read(kiriko)
        assert [one.weight for one in rig.viewers] == [weight, 1.0]
        how = settings.Settings(tolerance=ours().tolerance, disagreement=way.lower())
        expected = steps.run_steps(session.Session().solve(rig, how)).source
        np.testing.assert_array_equal(source()[..., :3], expected)
        found.append(expected)
    assert not np.array_equal(found[0], found[1])
    assert not np.array_equal(found[1], found[2])


def test_the_chosen_viewer_is_shown_and_the_image_stays(
    kiriko: ModuleType, watch: ModuleType, rig: dict
) -> None:
    """What is told, compared and simulated is of the chosen one. The result stays current, and
    solved again it is the same but for the order of sums.
    """
    compared = importlib.import_module(f"{kiriko.__name__}.operators.compared")
    viewer = importlib.import_module(f"{kiriko.__name__}.core.blender.data.camera_viewer")
    bpy.ops.kiriko.two_eyes()
    shown = []
    for number, name in ((1, LEFT), (2, RIGHT)):
        ours().viewer_shown = number
        if shown:
            assert not watch.has_changed(bpy.context)
        bpy.ops.kiriko.solve()
        assert viewer.viewer_of(bpy.context.scene).name == names(kiriko)[0] == name
        assert ours().result.summary.startswith(f"'{name}': The display shows ")
        bpy.ops.kiriko.simulate(samples=2)
        seen = pixels(ours().result.seen).copy()
        bpy.ops.kiriko.before_after()
        found = compared.found(bpy.context.scene)
        assert found.camera == bpy.data.objects[name].session_uid
        bpy.ops.kiriko.before_after()
        shown.append((source(), seen))
    (first, left), (second, right) = shown
    np.testing.assert_allclose(first, second, atol=1e-5)
    assert np.abs(left - right).max() > 0.05

    ours().viewers[2].is_on = False  # another is shown in the place of one that is off
    assert names(kiriko) == [LEFT]
    assert viewer.viewer_of(bpy.context.scene).name == LEFT


def test_the_preview_is_that_of_the_chosen_viewer(kiriko: ModuleType, rig: dict) -> None:
    """Cycles sees what the chosen viewer is predicted to see, and not what the other one is."""
    work = importlib.import_module(f"{kiriko.__name__}.operators.work")
    steps = importlib.import_module(f"{kiriko.__name__}.core.base.steps")
    ours().viewer.data.stereo.interocular_distance = 0.1
    bpy.ops.kiriko.two_eyes()
    for number in (1, 2):
        ours().viewer_shown = number
        bpy.ops.kiriko.solve()
        bpy.ops.kiriko.preview(samples=16, reflections=False, surroundings=False)
        rendered = pixels(ours().result.preview)[..., :3]
        reading = work.read(bpy.context)
        solved = steps.run_steps(
            work.session().solve(reading.rig, work.settings_of(bpy.context.scene))
        )
        errors = [
            float(np.sqrt(((channel.seen(solved.source, past_glass=True) - rendered) ** 2).mean()))
            for channel in solved.channels
        ]
        assert errors[0] < 0.25 * errors[1]


def test_each_viewer_is_told_of_the_worst_first(
    drawn: Callable[..., Layout], kiriko: ModuleType, rig: dict
) -> None:
    """A line in the panel for each, with the numbers of core; there is none for one viewer."""
    reports = importlib.import_module(f"{kiriko.__name__}.core.lab.measure.viewer_errors")
    steps = importlib.import_module(f"{kiriko.__name__}.core.base.steps")
    work = importlib.import_module(f"{kiriko.__name__}.operators.work")
    panel = importlib.import_module(
        f"{kiriko.__name__}.panels.viewers_panel"
    ).VIEW3D_PT_kiriko_seen_by
    bpy.ops.kiriko.solve()
    assert "viewers" not in details()
    assert not panel.poll(bpy.context)

    add(camera(-0.002, "near"), camera(0.008, "far"))
    ours().viewers[0].weight = 4
    bpy.ops.kiriko.solve()
    told = details()["viewers"]
    rig = read(kiriko)
    solved = steps.run_steps(work.session().solve(rig, work.settings_of(bpy.context.scene)))
    expected = steps.run_steps(reports.viewer_reports(solved))
    assert told == [vars(one) for one in expected]
    assert told[0]["viewer"] == "far"

    assert panel.poll(bpy.context)
    text = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)
    places = [text.index(f"'{one['viewer']}' sees") for one in told]
    assert places == sorted(places)
    assert f"{told[0]['psnr']:.1f} dB" in text


def test_the_panel_tells_how_many_points_where_a_viewer_does_not_see_all(
    drawn: Callable[..., Layout], rig: dict
) -> None:
    """Of the 7 x 7: of those that are off by so much, and of those that both eyes see."""
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.solve()
    text = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)
    assert [one["n_points"] for one in details()["viewers"]] == [49, 49]
    assert "points" not in text

    display = rig["DISPLAY"]
    display.matrix_world.translation.x -= 0.3 * display.dimensions.x
    bpy.ops.kiriko.solve()
    text = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)
    for one in details()["viewers"]:
        assert 0 < one["n_points"] < 49
        assert f"of the picture, {one['n_points']} of 49 points, displaced" in text
    pair = details()["two_eyes"]
    assert 0 < pair["n_points"] < 49
    assert f"Both see {pair['n_points']} of 49 points" in text


def test_two_that_are_no_pair_are_told_so_in_a_report(
    kiriko: ModuleType, rig: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sentence on eyes that look in different directions stands among what is missing."""
    module = importlib.import_module(f"{kiriko.__name__}.operators.report")
    steps = importlib.import_module(f"{kiriko.__name__}.core.base.steps")
    turned = camera(0.02)
    turned.rotation_euler.z += 0.9
    add(turned)
    monkeypatch.setattr(module, "_has", lambda check, of_rig: False)
    found = steps.run_steps(module.find_extras(bpy.context, read(kiriko)))
    assert list(found.numbers) == ["missing"]  # the turned one does not see the picture, either
    assert list(found.numbers["missing"]) == ["two_eyes", "viewers"]
    assert "not a pair of eyes" in found.numbers["missing"]["two_eyes"]

    bpy.ops.kiriko.two_eyes()
    found = steps.run_steps(module.find_extras(bpy.context, read(kiriko)))
    assert list(found.numbers["missing"]) == ["viewers"]  # three are asked for no depth


def test_two_that_are_no_pair_are_told_why_in_words(
    run: Callable[..., int],
    drawn: Callable[..., Layout],
    kiriko: ModuleType,
    rig: dict,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In the panel and in the terminal, once, the sentence of core, while two are on; of one above
    the other, also where the picture is in their own pixels.
    """
    two_eyes = importlib.import_module(f"{kiriko.__name__}.core.lab.measure.two_eyes")
    errors = importlib.import_module(f"{kiriko.__name__}.core.base.errors")
    above = camera(0.0, "above")
    above.location.z += 0.005
    add(above)

    def refused() -> str:
        with pytest.raises(errors.RigError, match="are not a pair of eyes") as error:
            two_eyes.pair_of(read(kiriko))
        return str(error.value)

    why = refused()
    bpy.ops.kiriko.solve()
    assert "two_eyes" not in details()
    assert why in " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)

    short_reports(kiriko, monkeypatch)
    file = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    for verb, more in (("solve", ()), ("eyes", ()), ("report", ("--seconds", 0))):
        capsys.readouterr()
        assert run(verb, "--out", tmp_path / verb, *more) == 0
        assert capsys.readouterr().out.count(why) == 1

    add(camera(0.005, "third"))
    bpy.ops.kiriko.solve()
    assert "no_pair" not in details()
    ours().viewers[[name for name, *_ in listed()].index("third")].is_on = False
    ours().picture_source = "IMAGE"
    for one in ours().viewers:
        one.image = bpy.data.images["Kiriko Lattice"]
    bpy.ops.kiriko.solve()
    assert details()["no_pair"] == refused()


def test_of_two_eyes_depth_and_disparity_are_told(
    drawn: Callable[..., Layout], kiriko: ModuleType, rig: dict
) -> None:
    """In the panel, in the scene's unit, with core's numbers; those of a display of the smallest
    pixels are the same to 1 %. Of a third viewer, or of one alone, nothing is told.
    """
    two_eyes = importlib.import_module(f"{kiriko.__name__}.core.lab.measure.two_eyes")
    steps = importlib.import_module(f"{kiriko.__name__}.core.base.steps")
    work = importlib.import_module(f"{kiriko.__name__}.operators.work")
    bpy.ops.kiriko.two_eyes()
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    bpy.ops.kiriko.solve()
    told = details()["two_eyes"]
    settings = work.settings_of(bpy.context.scene)
    solved = steps.run_steps(work.session().solve(read(kiriko), settings))
    left, right, sights = two_eyes.sights_of(solved)
    assert (told["left"], told["right"]) == (left.name, right.name) == (LEFT, RIGHT)
    assert told["n_points"] == 49
    assert told["mean_depth_m"] == sights.mean_depth
    assert told["largest_depth_m"] == sights.largest_depth
    assert told["mean_vertical_arcmin"] == sights.mean_vertical
    assert told["largest_vertical_arcmin"] == sights.largest_vertical
    assert told["mean_horizontal_arcmin"] == sights.mean_horizontal
    assert told["largest_horizontal_arcmin"] == sights.largest_horizontal

    fine = steps.run_steps(two_eyes.two_eyes(read(kiriko), settings)).for_both
    assert fine.mean_depth > 1e-3
    assert told["mean_depth_m"] == pytest.approx(fine.mean_depth, rel=0.01)
    assert told["largest_vertical_arcmin"] == pytest.approx(fine.largest_vertical, rel=0.01)

    text = " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)
    assert f"{1e3 * told['mean_depth_m']:.3g} mm in front of its plane on average" in text
    assert "Vertical disparity" in text
    for largest, is_warned in ((14.9, False), (15.0, True)):
        changed = {**details(), "two_eyes": {**told, "largest_vertical_arcmin": largest}}
        bpy.context.scene.kiriko.result.details = record_text(changed)
        texts = drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts
        assert ("Eyes tire above 15 arcmin" in texts) == is_warned

    add(camera(0.01))
    bpy.ops.kiriko.solve()
    assert "two_eyes" not in details()
    assert "plane" not in " ".join(drawn("viewers_panel", "VIEW3D_PT_kiriko_seen_by").texts)


def test_of_a_picture_that_is_no_flat_rectangle_coverage_is_told(rig: dict) -> None:
    """Without places to compare there are no displacements, and no traceback."""
    mesh = rig["PICTURE"].data
    mesh.vertices[0].co.z += 0.002
    add(camera(0.01))
    bpy.ops.kiriko.solve()
    for one in details()["viewers"]:
        assert set(one) == {"viewer", "weight", "coverage"}
    assert "a flat rectangle" in ours().result.notes


def test_the_panel_shows_a_list_where_there_are_several(
    drawn: Callable[..., Layout], rig: dict
) -> None:
    """Drawing makes no entry. With one viewer it is the field it was, without Disagreement."""
    shown = drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers")
    assert "viewer" in shown.props
    assert not {"viewers", "disagreement"} & set(shown.props)
    assert {"kiriko.add_viewer", "kiriko.two_eyes", "kiriko.viewer_grid"} <= set(shown.operators)
    assert listed() == []

    add(camera())
    for number, field in ((0, "viewer"), (1, "camera")):
        ours().viewer_shown = number
        shown = drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers")
        assert {"viewers", "weight", "is_on", "disagreement", field} <= set(shown.props)
        assert {"Kiriko Viewer", "mine"} <= set(shown.texts)
    bpy.data.objects.remove(bpy.data.objects["mine"])
    assert "No camera" in drawn("viewers_panel", "VIEW3D_PT_kiriko_viewers").texts


def test_undo_and_a_file_keep_the_list(kiriko: ModuleType, rig: dict, tmp_path: Path) -> None:
    """Each click is one step back and forth; saved and opened again all of it is there."""
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.kiriko.two_eyes()
    bpy.ops.ed.undo_push(message="eyes")
    bpy.ops.ed.undo()
    assert (listed(), LEFT in bpy.data.objects) == ([], False)
    bpy.ops.ed.redo()
    assert names(kiriko) == [LEFT, RIGHT]

    ours().viewers[2].weight, ours().disagreement = 3.0, "BLENDED"
    before = listed()
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert (listed(), ours().disagreement) == (before, "BLENDED")
    assert [one.weight for one in read(kiriko).viewers] == [1.0, 3.0]


def test_a_file_without_a_list_is_solved_as_before(
    watch: ModuleType, kiriko: ModuleType, rig: dict, tmp_path: Path
) -> None:
    """Its result stays current, and its image the same, to the bit: none of it is in the file."""
    bpy.ops.kiriko.solve()
    before = source()
    assert not ours().is_property_set("viewers")
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not watch.has_changed(bpy.context)
    bpy.ops.kiriko.solve()
    np.testing.assert_array_equal(source(), before)


def test_what_changes_the_image_for_several_viewers_counts(watch: ModuleType, rig: dict) -> None:
    """The second one moved, its weight, its pixels, whether it is on; not the order of two that are
    alike but for their places, their names, nor the choice of the one that is shown.
    """
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.solve()
    right = bpy.data.objects[RIGHT]
    for change in (
        lambda: bpy.ops.kiriko.move_viewer(step=1),
        lambda: setattr(right, "name", "Aardvark"),
        lambda: setattr(ours(), "viewer_shown", 2),
        lambda: setattr(ours(), "viewer_shown", 0),
    ):
        change()
        assert not watch.has_changed(bpy.context)

    for owner, name, value in (
        (right, "location", right.location + Vector((1e-4, 0, 0))),
        (ours().viewers[1], "weight", 2.0),
        (right.kiriko, "resolution", (64, 65)),
        (ours().viewers[2], "is_on", False),
    ):
        before = getattr(owner, name)
        before = tuple(before) if hasattr(before, "__len__") else before
        setattr(owner, name, value)
        assert watch.has_changed(bpy.context)
        setattr(owner, name, before)
        assert not watch.has_changed(bpy.context)


def test_live_follows_each_viewer(kiriko: ModuleType, watch: ModuleType, rig: dict) -> None:
    """The second one moved, its weight, one turned off: each makes the image that Solve makes.
    Another one chosen traces nothing.
    """
    live = kiriko.operators.live
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.live()

    def settle() -> None:
        bpy.context.view_layer.update()
        for _ in range(4000):
            if live.tick() == live.live_follower.IDLE:
                return

    settle()
    changes = (
        lambda: bpy.data.objects[RIGHT].location.__setitem__(0, 0.004),
        lambda: setattr(ours().viewers[2], "weight", 3.0),
        lambda: setattr(ours(), "disagreement", "BLENDED"),
        lambda: setattr(ours(), "viewer_shown", 2),
        lambda: setattr(ours().viewers[1], "is_on", False),
    )
    for change in changes:
        before = source()
        change()
        settle()
        assert not live.followed().problem
        found = source()
        is_choice = ours().viewer_shown == 2 and ours().viewers[1].is_on
        assert np.allclose(found, before, atol=1e-5) == is_choice
        assert not is_choice or details()["rays"] == 0
        assert ("viewers" in details()) == ours().viewers[1].is_on
        bpy.ops.kiriko.solve()
        np.testing.assert_allclose(found, source(), atol=1e-6)


def test_remove_rig_takes_its_eyes_along(rig: dict) -> None:
    """Nothing is left of them. A camera of the artist's in the list stays in the scene."""
    mine = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
    bpy.context.scene.collection.objects.link(mine)
    add(mine)
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.remove_rig()
    assert [thing.name for thing in bpy.data.objects] == ["Cube", "mine"]
    assert [lens.name for lens in bpy.data.cameras] == ["mine"]
    assert not any("Eye" in name for name, *_ in listed() if name)


def test_each_rig_has_a_list_of_its_own(kiriko: ModuleType, rig: dict) -> None:
    """Chosen and chosen back, each has its viewers."""
    first = ours().viewer.users_collection[0]
    bpy.ops.kiriko.two_eyes()
    for thing in bpy.context.selected_objects:
        thing.select_set(False)
    bpy.ops.kiriko.add_rig()
    assert (listed(), ours().viewer.name) == ([], "Kiriko Viewer.001")
    bpy.ops.kiriko.choose_rig(rig=first.name)
    assert names(kiriko) == [LEFT, RIGHT]


def test_the_command_line_writes_what_each_sees(
    run: Callable[..., int], rig: dict, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A report on each, the worst first; with --viewers their images and the conflict's. Names that
    are not there are told in a sentence.
    """
    add(camera(0.02))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    plain, every, one = (tmp_path / name for name in ("plain", "every", "one"))
    assert run("solve", "--out", plain) == 0
    report = json.loads((plain / "report.json").read_text())
    assert {told["viewer"] for told in report["viewers"]} == {"Kiriko Viewer", "mine"}
    assert not list(plain.glob("*mine*"))

    assert run("solve", "--out", every, "--viewers", "all") == 0
    of_viewers = {
        *(f"{kind}_{name}.png" for kind in ("ideal", "seen") for name in ("Kiriko_Viewer", "mine")),
        "conflict.exr",
    }
    files = {path.name for path in every.iterdir()}
    assert files == of_viewers | {path.name for path in plain.iterdir()}
    shown = bpy.data.images.load(str(every / "seen_mine.png"))
    again = bpy.data.images.load(str(every / "seen.png"))  # the one that is shown
    np.testing.assert_array_equal(pixels(shown), pixels(again))
    conflict = pixels(bpy.data.images.load(str(every / "conflict.exr")))[..., 0]
    assert 0 < conflict.max() < 1024

    assert run("solve", "--out", one, "--viewers", "mine") == 0
    assert (one / "seen_mine.png").exists()
    assert not (one / "seen_Kiriko_Viewer.png").exists()
    capsys.readouterr()
    assert run("solve", "--out", tmp_path / "none", "--viewers", "nobody") == 1
    told = "The rig has no viewer 'nobody', only 'Kiriko Viewer', 'mine'."
    assert told in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(("way", "unit"), [("SHARP", "px"), ("BLENDED", "white")])
def test_the_conflict_s_file_has_the_numbers_that_are_told(
    run: Callable[..., int], rig: dict, tmp_path: Path, way: str, unit: str
) -> None:
    """Of places where these are settled, else of colours, of which two that count alike are half of
    white apart from their mean at most.
    """
    add(camera(0.02))
    bpy.context.scene.kiriko.disagreement = way
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    out = tmp_path / "out"
    assert run("solve", "--out", out, "--viewers", "all") == 0
    told = json.loads((out / "report.json").read_text())["conflict"]
    largest = pixels(bpy.data.images.load(str(out / "conflict.exr")))[..., 0].max()
    assert told == {"largest": pytest.approx(largest, rel=1e-6), "unit": unit}
    assert largest > 0
    assert unit == "px" or largest <= 0.5


def test_a_photograph_is_of_the_first_viewer(rig: dict, tmp_path: Path) -> None:
    """Amounts are kept along its axes: calibration by another one is refused."""
    path = tmp_path / "points.csv"
    path.write_text("column,row,x,y\n")
    add(camera(0.02))
    with pytest.raises(RuntimeError, match="choose 'Kiriko Viewer' in the list of viewers"):
        bpy.ops.kiriko.calibrate(filepath=str(path))


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1)])
def test_eyes_of_a_mirrored_viewer_look_where_it_looks(
    kiriko: ModuleType, rig: dict, scale: tuple[float, float, float]
) -> None:
    ours().viewer.scale = scale
    bpy.context.view_layer.update()
    expected = read(kiriko).viewers[0].axes
    ours().viewer.data.stereo.convergence_mode = "PARALLEL"
    bpy.ops.kiriko.two_eyes()
    for eye in read(kiriko).viewers:
        np.testing.assert_allclose(eye.axes, expected, atol=1e-6)


def of_another_scene(left: bpy.types.Object) -> Callable[[], bool]:
    bpy.ops.scene.new(type="LINK_COPY")
    copy = bpy.context.scene
    return lambda: all(one.camera for one in copy.kiriko.viewers if one.is_on)


def of_a_marker(left: bpy.types.Object) -> Callable[[], bool]:
    marker = bpy.context.scene.timeline_markers.new("eye", frame=3)
    marker.camera = left
    return lambda: marker.camera is not None


def of_the_scene(left: bpy.types.Object) -> Callable[[], bool]:
    bpy.context.scene.camera = left
    return lambda: bpy.context.scene.camera is not None


def a_copy(left: bpy.types.Object) -> Callable[[], bool]:
    copy = left.copy()
    copy.name = "My own"
    bpy.context.scene.collection.objects.link(copy)
    add(copy)
    return lambda: "My own" in bpy.data.objects


@pytest.mark.parametrize("use", [of_another_scene, of_a_marker, of_the_scene, a_copy])
def test_eyes_that_are_used_elsewhere_stay(
    kiriko: ModuleType, rig: dict, use: Callable[[bpy.types.Object], Callable[[], bool]]
) -> None:
    """Other eyes take their place in the list alone."""
    bpy.ops.kiriko.two_eyes()
    first = bpy.context.scene
    is_there = use(bpy.data.objects[LEFT])
    if bpy.context.scene != first:
        show_scene(first)
    assert bpy.ops.kiriko.two_eyes() == {"FINISHED"}
    assert is_there()
    assert sum(one.is_on for one in first.kiriko.viewers) == 2


def in_a_view(kiriko: ModuleType) -> None:
    bpy.ops.kiriko.look_through()


def in_before_and_after(kiriko: ModuleType) -> None:
    bpy.ops.kiriko.before_after()


def taken_out(kiriko: ModuleType) -> None:
    bpy.ops.kiriko.remove_viewer()


def in_a_copy_of_the_scene(kiriko: ModuleType) -> None:
    bpy.ops.scene.new(type="FULL_COPY")


def deleted(kiriko: ModuleType) -> None:
    bpy.data.objects.remove(ours().viewers[1].camera)


@pytest.mark.parametrize(
    "use", [in_a_view, in_before_and_after, taken_out, in_a_copy_of_the_scene, deleted]
)
def test_eyes_made_again_leave_none_behind(
    kiriko: ModuleType, rig: dict, use: Callable[[ModuleType], None]
) -> None:
    """Neither a camera nor an entry: Kiriko's own views look through the new ones."""
    bpy.ops.kiriko.two_eyes()
    use(kiriko)
    scene = bpy.context.scene
    for _ in range(2):
        bpy.ops.kiriko.two_eyes()
        cameras = {thing for thing in scene.objects if thing.type == "CAMERA"}
        first, *eyes = ours().viewers
        assert len(listed()) == len(cameras) == 3
        assert {ours().viewer, *(one.camera for one in eyes)} == cameras
        assert (first.camera, first.is_on) == (None, False)
        if scene.kiriko_scene.looking:
            look = importlib.import_module(f"{kiriko.__name__}.core.blender.view.looking_through")
            assert [camera for _, camera in look.views(scene)] == [eyes[0].camera]
    assert sum(lens.users > 0 for lens in bpy.data.cameras) == 3 * len(bpy.data.scenes)


def test_a_copy_of_an_eye_is_the_artist_s(rig: dict) -> None:
    """Whether or not it is in the list, in a scene and in a full copy of it."""
    bpy.ops.kiriko.two_eyes()
    for _ in range(2):
        copy = ours().viewers[1].camera.copy()
        bpy.context.scene.collection.objects.link(copy)
        bpy.ops.kiriko.two_eyes()
        assert copy.name in bpy.context.scene.objects
        bpy.ops.scene.new(type="FULL_COPY")


def test_a_box_in_millimetres_is_as_large(kiriko: ModuleType, scene: bpy.types.Scene) -> None:
    scene.unit_settings.scale_length = 0.001
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.kiriko.viewer_grid()
    places = [viewer.position for viewer in read(kiriko).viewers]
    assert np.linalg.norm(places[-1] - places[0]) == pytest.approx(0.12, rel=1e-4)


def test_an_empty_entry_is_told_in_its_own_words(kiriko: ModuleType, rig: dict) -> None:
    """And is never the rig's viewer."""
    viewer = ours().viewer
    bpy.context.view_layer.objects.active = rig["GLASS"]
    bpy.ops.kiriko.add_viewer()
    with pytest.raises(RuntimeError, match="entry in the viewer list has no camera"):
        bpy.ops.kiriko.solve()
    bpy.ops.kiriko.move_viewer(step=-1)
    assert ours().viewer == viewer


@pytest.mark.parametrize("name", ["fit_display", "fit_picture_size"])
def test_fitting_counts_all_viewers(kiriko: ModuleType, rig: dict, name: str) -> None:
    """A part is as large as the one needs who needs most, here the eye beside the viewer; the
    picture is as large as gets through to that one.
    """
    ours().viewer.data.stereo.interocular_distance = 0.03
    bpy.ops.kiriko.two_eyes()
    role = "DISPLAY" if name == "fit_display" else "PICTURE"
    widths = []
    for on in ((0,), (0, 2), (2,)):
        off(0, 1, 2)
        for n in on:
            ours().viewers[n].is_on = True
        ours().viewer_shown = 0
        bpy.context.view_layer.update()
        assert getattr(bpy.ops.kiriko, name)() == {"FINISHED"}
        widths.append(rig[role].dimensions[0])
    viewer, both, eye = widths
    assert abs(both / viewer - 1) > 0.004
    assert (both < viewer) == (role == "PICTURE")
    assert both == pytest.approx(eye, rel=0.002)


def test_eyes_of_a_rescaled_scene_are_as_far_apart_as_before(
    kiriko: ModuleType, scene: bpy.types.Scene
) -> None:
    """Those of people, who do not become smaller."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32))
    bpy.ops.kiriko.rescale_scene(factor=0.01)
    bpy.ops.kiriko.two_eyes()
    left, right = (viewer.position for viewer in read(kiriko).viewers)
    assert np.linalg.norm(right - left) == pytest.approx(0.065, rel=1e-4)


def test_files_of_viewers_with_long_names_are_whole(
    run: Callable[..., int], rig: dict, tmp_path: Path
) -> None:
    """As long as Blender takes them, alike to the last letters, in letters of several bytes."""
    add(*(camera(0.01 * k, name) for k, name in enumerate(("a" * 255, "a" * 255, "ガ" * 85), 1)))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert run("solve", "--out", tmp_path / "out", "--viewers", "all") == 0
    assert len(list((tmp_path / "out").glob("seen_*.png"))) == 4


def test_eyes_and_heads_made_again_keep_their_weights(rig: dict) -> None:
    """Each its own, wherever it is in the list; others begin with 1."""
    bpy.ops.kiriko.two_eyes()
    bpy.data.objects[LEFT].name = "mine now"
    ours().viewers[1].weight, ours().viewers[2].weight = 3.0, 5.0
    ours().viewer_shown = 2
    bpy.ops.kiriko.move_viewer(step=-1)
    bpy.ops.kiriko.two_eyes()
    assert listed() == [(None, 1, False), (LEFT, 3, True), (RIGHT, 5, True)]

    bpy.ops.kiriko.viewer_grid(heads=(3, 1, 1))
    assert [weight for _, weight, _ in listed()] == [1, 1, 1, 1]
    for one, weight in zip(ours().viewers, (2, 3, 4, 5), strict=True):
        one.weight = weight
    bpy.ops.kiriko.viewer_grid(heads=(3, 1, 1), box=(0.2, 0, 0))
    assert [weight for _, weight, _ in listed()] == [2, 3, 4, 5]
    bpy.ops.kiriko.viewer_grid(heads=(2, 1, 1))
    assert [weight for _, weight, _ in listed()] == [2, 1, 1]


def test_a_viewer_that_is_set_counts_and_is_shown(kiriko: ModuleType, rig: dict) -> None:
    """As by a script of before there were several, though Two Eyes had turned its entry off. What
    buttons do turns nothing on.
    """
    bpy.ops.kiriko.two_eyes()
    viewer = ours().viewer
    bpy.ops.kiriko.viewer_grid(heads=(2, 1, 1))
    assert not listed()[0][2]
    ours().viewer = camera(0.01)
    assert [one.is_on for one in ours().viewers] == [True, True, True]
    assert read(kiriko).viewer.name == "mine"

    off(0)
    ours().viewer_shown = 1
    ours().viewer = viewer
    assert (listed()[0], ours().viewer_shown) == ((None, 1, True), 0)
    off(0)
    add(camera(0.02, "more"))
    ours().viewer = None
    assert not listed()[0][2]


def test_the_first_viewer_follows_the_scene_s_camera_until_one_is_chosen(
    kiriko: ModuleType, rig: dict
) -> None:
    """Whatever buttons do with the others; moved down it is that camera."""
    scene, one, two = bpy.context.scene, camera(0.01, "one"), camera(0.02, "two")
    others = camera(0.03, "more"), camera(0.04, "most")
    ours().viewer = None
    scene.camera = one
    add(*others)
    bpy.ops.kiriko.remove_viewer()
    assert (ours().viewer, names(kiriko)) == (None, ["more", "one"])
    scene.camera = two
    assert sorted(names(kiriko)) == ["more", "two"]

    ours().viewer_shown = 0
    bpy.ops.kiriko.move_viewer(step=1)
    assert (ours().viewer.name, listed()[1][0]) == ("more", "two")
    scene.camera = one
    assert sorted(names(kiriko)) == ["more", "two"]


def test_images_of_a_viewer_are_called_by_its_name(kiriko: ModuleType, rig: dict) -> None:
    """Where it has others: who chooses another one knows whose they are."""
    bpy.ops.kiriko.two_eyes()
    bpy.ops.kiriko.solve()
    for number, name in ((1, LEFT), (2, RIGHT)):
        ours().viewer_shown = number
        bpy.ops.kiriko.simulate(samples=2)
        bpy.ops.kiriko.preview(samples=1, percentage=10)
        result = ours().result
        found = [result.seen.name, result.preview.name]
        assert found == [f"Kiriko Seen - {name}", f"Kiriko Preview - {name}"]
    off(2)
    bpy.ops.kiriko.simulate(samples=2)
    assert ours().result.seen.name == "Kiriko Seen"
    assert [one.name for one in bpy.data.images if "Seen" in one.name] == ["Kiriko Seen"]
