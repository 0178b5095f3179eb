"""Work that is stopped or fails at any of its stages, and what
becomes of the last result, the scene and the files.
"""

import errno
import importlib
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from small_rigs import cube, inventory, pixels, short_walks, small_rig

EXTENSION = "bl_ext.user_default.kiriko"
LONG = (
    "solve",
    "simulate",
    "visible_range",
    "eye_box",
    "render_pictures",
    "report",
    "export_maps",
)
OF_CORE = pytest.mark.newest_only(reason="their work is core's, and long; others' is Blender's")
SAMPLES = 5  # of the steps at which long work is stopped, the first and the last among them
MANY = 2000  # turns of Live, of which none of these rigs needs a tenth

# By operator: where each stage of its work is looked up. Some
# fail when they are called, some in their midst.
STAGES = {
    "solve": (
        "core.blender.scene.read",
        "core.solve.reach.planning",
        "core.light.kept.making_solids",
        "core.solve.reach.Sampling",
        "core.map.points.tracing",
        "core.solve.measured.measure",
        "core.solve.measured.plate_view",
        "core.solve.measured.look_beside",
        "core.solve.painting.cut_along_outline",
        "core.map.share_batches.divided",
        "core.solve.painting.find_strokes",
        "core.solve.painting.Painting.finished",
        "core.solve.painting.of_the_picture",
        "core.solve.session.remarks_on",
        "core.blender.result_numbers.costs",
        "core.blender.result.image_from_pixels",
        "core.blender.image.set_pixels",
        "core.blender.result.pack",
        "core.blender.result.put_on_display",
        "core.blender.shaders.show_image",
        "core.blender.shaders._front_only",
    ),
    "simulate": (
        "core.blender.scene.read",
        "core.solve.session.planning",
        "operators.simulate.pixels_from_image",
        "core.image.simulation.trace",
        "core.blender.image.set_pixels",
        "core.blender.result.pack",
    ),
    "visible_range": (
        "core.blender.scene.read",
        "core.solve.session.planning",
        "core.bench.visible_range.trace_all",
        "operators.visible_range.surface_object",
    ),
    "eye_box": (
        "core.blender.scene.read",
        "core.solve.session.planning",
        "core.measure.eye_box.places_shown",
        "core.measure.eye_box_surface.grid",
        "operators.eye_box.surface_object",
    ),
    "render_pictures": (
        "operators.render_pictures.read_viewers",
        "operators.render_pictures.eye_of",
        "core.blender.viewer_render._wanted",
        "core.blender.viewer_render._copied",
        "operators.viewer_images.give",
    ),
    "report": (
        "core.blender.scene.read",
        "core.measure.work_precision.make_reference",
        "core.measure.work_precision.splat",
        "core.image_io.write",
        "operators.report.plate_view",
        "operators.report.as_svg",
        "core.disk.write_text",
    ),
    "export_maps": (
        "core.blender.scene.read",
        "core.warp.view_from_display.candidates",
        "core.warp.settling.trace_points",
        "core.warp.files.write_exr",
        "core.disk.write_text",
        "core.image_io.put",
    ),
    "export": ("operators.export.pixels_from_image", "core.image_io._quantised"),
    "preview": (
        "core.blender.scene.read",
        "core.blender.preview.set_cycles",
        "core.blender.preview.has_header",
        "core.blender.preview.stored_numbers",
        "operators.preview.replace_image",
        "core.blender.result.pack",
    ),
}


def part(name: str) -> Any:
    """A module of the extension, as Blender has it, or a thing in one."""
    found = importlib.import_module(EXTENSION)
    names = name.split(".")
    for n, word in enumerate(names):
        try:
            found = importlib.import_module(f"{EXTENSION}.{'.'.join(names[: n + 1])}")
        except ModuleNotFoundError:
            found = getattr(found, word)
    return found


def errors() -> list[BaseException]:
    """Faults: foreseen ones and ones that nobody foresaw, with texts of several lines."""
    return [
        part("core.errors").RigError("Said in one sentence."),
        ValueError("an odd\nnumber"),
        KeyboardInterrupt(),
        MemoryError("Unable to allocate 4.00 GiB"),
        OSError(errno.ENOSPC, "No space left on device", "somewhere"),
    ]


FEW = 2  # of them, where it is the stage that counts


def everything() -> dict[str, list[tuple]]:
    """All datablocks of the file, by a mark that they keep as long as they live, and
    their users.
    """
    groups = (p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION")
    return {
        group: sorted(
            (b.name, b.session_uid, b.users, b.use_fake_user)
            for b in getattr(bpy.data, group)
            if b.name != "Render Result"  # Blender's own
        )
        for group in groups
        if group not in {"window_managers", "screens", "workspaces"}
    }


def marked(names: Iterable[str]) -> list:
    """Operators as parameters; the newest Blender alone runs those whose work is mostly core's."""
    return [
        pytest.param(name, marks=OF_CORE if name in ("eye_box", "report") else ()) for name in names
    ]


def state() -> tuple:
    """All of a file that Kiriko might write to."""
    scene = bpy.context.scene
    result = scene.kiriko.result
    slots = [(s.link, s.material) for thing in scene.objects for s in thing.material_slots]
    trees = [(m.name, m.node_tree) for m in bpy.data.materials if m.node_tree is not None]
    shown = [
        (name, [(n.name, getattr(n, "image", None)) for n in t.nodes], len(t.links))
        for name, t in trees
    ]
    numbers = (
        result.summary,
        result.seen_summary,
        result.details,
        result.notes,
        result.coverage,
        result.ladder,
    )
    chosen = (
        scene.camera,
        scene.kiriko.viewer,
        scene.kiriko.picture_source,
        [t.select_get() for t in scene.objects],
    )
    images = [
        None if image is None else pixels(image).tobytes() for image in (result.source, result.seen)
    ]
    where = [
        (thing.name, tuple(map(tuple, thing.matrix_world)), thing.kiriko.role)
        for thing in scene.objects
    ]

    return everything(), slots, shown, numbers, chosen, images, where, files()


def files() -> dict[str, bytes]:
    """The files in the folder of the report, by name."""
    folder = Path(bpy.context.scene.kiriko.report_folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.exists() else {}


def product(name: str) -> object:
    """The results of an operator, without the times it took."""
    result = bpy.context.scene.kiriko.result
    if name == "solve":
        return pixels(result.source).tobytes()
    if name == "simulate":
        return pixels(result.seen).tobytes()
    if name == "visible_range":
        mesh = bpy.data.objects["Kiriko Visible Range"].data
        return [tuple(v.co) for v in mesh.vertices], [
            d.value for d in mesh.attributes["brightness"].data
        ]
    if name == "eye_box":
        thing = bpy.data.objects["Kiriko Eye Box"]
        values = thing.data.attributes["displacement"].data
        return [tuple(v.co) for v in thing.data.vertices], [d.value for d in values]
    if name == "render_pictures":
        return pixels(bpy.context.scene.kiriko.picture_image).tobytes()
    if name == "export_maps":
        folder = Path(bpy.context.scene.kiriko.report_folder)
        read = part("core.image_io").read  # for the file has the hour in it, too
        return read(folder / "warp.exr")[0].tobytes(), files()["maps.json"]
    rungs = json.loads(files()["report.json"])["rungs"]
    return [{key: value for key, value in rung.items() if "seconds" not in key} for rung in rungs]


class Asked:
    """An operator whose properties are given here.

    Reports are kept. Its work is the real one's.
    """

    def __init__(self, name: str) -> None:
        self.real = getattr(part(f"operators.{name}"), f"KIRIKO_OT_{name}")
        self.bl_label = self.real.bl_label
        self.said = []
        for option, declared in self.real.__annotations__.items():
            setattr(self, option, declared.keywords.get("default", 0.0))
        self.shown = 0
        self.samples = 8
        self.share = 0.2
        folder = bpy.context.scene.kiriko.report_folder
        self.directory = folder if name == "export_maps" else ""
        self.is_in_dialogue = False
        self.overwrite = True
        self.seconds = 1.0

    def __getattr__(self, name: str) -> Any:  # its own functions
        if name == "real" or name.startswith("__"):
            raise AttributeError(name)
        return partial(getattr(self.real, name), self)

    def report(self, levels: set[str], text: str) -> None:
        self.said.append((*levels, text))

    def steps(self, context: Any) -> Any:
        return self.real.steps(self, context)

    def stays(self) -> str:
        return self.real.stays(self)


class Window:
    """The parts of Blender's interface that long work touches: a
    context with one window, in which nothing is seen.
    """

    def __init__(self) -> None:
        self.timers = []
        self.modal = []
        self.status = None
        self.progress = None
        self.window = self.window_manager = self.workspace = self
        self.screen = SimpleNamespace(areas=[])

    def __getattr__(self, name: str) -> Any:  # the rest is the module's own context
        return getattr(bpy.context, name)

    def temp_override(self, **_: object) -> Any:
        return nullcontext()

    def event_timer_add(self, seconds: float, window: object) -> object:
        self.timers.append(object())
        return self.timers[-1]

    def event_timer_remove(self, timer: object) -> None:
        self.timers.remove(timer)

    def modal_handler_add(self, operator: object) -> None:
        self.modal.append(operator)

    def progress_begin(self, low: int, high: int) -> None:
        self.progress = low

    def progress_update(self, value: int) -> None:
        self.progress = value

    def progress_end(self) -> None:
        self.progress = None

    def status_text_set(self, text: str | None) -> None:
        self.status = text

    @property
    def is_clean(self) -> bool:
        return not self.timers and self.status is None and self.progress is None


@pytest.fixture
def rig(
    scene: bpy.types.Scene,
    kiriko: ModuleType,
    no_remedies: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> dict:
    """A small rig with a result that is out of date, since the glass was turned.

    Work is short, a report is there.
    """
    module = part("core.bench.visible_range")
    monkeypatch.setattr(module, "SURVEY", replace(module.SURVEY, n_steps=6, fine_rad=0.05))
    short_walks(kiriko, monkeypatch)
    module = part("operators.report")
    short = module.Ladders(tolerances=(1.0,), spps=(1,), runs=1)
    monkeypatch.setattr(
        module, "measure", lambda *a, own=module.measure, **k: own(*a, **(k | {"ladders": short}))
    )
    rig = small_rig(viewer_resolution=32, display_resolution=(32, 32))
    scene.kiriko.tolerance = 1.0
    scene.kiriko.report_folder = str(tmp_path / "report")
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.svg").write_bytes(b"an earlier one")
    scene.kiriko.export_overwrite = True
    scene.kiriko.export_path = str(tmp_path / "report" / "source.png")
    bpy.ops.kiriko.solve()
    other = bpy.data.scenes.new("Other")  # of Render Pictures: a world alone
    other.render.engine, other.cycles.samples = "CYCLES", 1
    other.world = bpy.data.worlds.new("Other")
    rig["GLASS"].rotation_euler.z = 0.1
    bpy.context.view_layer.update()
    part("operators.work").forget()

    return rig


@pytest.fixture
def window(
    scene: bpy.types.Scene, kiriko: ModuleType, no_remedies: None, monkeypatch: pytest.MonkeyPatch
) -> Window:
    """An interface, each of whose turns does one step."""
    window = Window()
    app = SimpleNamespace(
        background=False,
        handlers=bpy.app.handlers,
        timers=bpy.app.timers,
        is_job_running=bpy.app.is_job_running,
    )
    shown = SimpleNamespace(app=app, context=window, data=bpy.data)
    monkeypatch.setattr(part("operators.work"), "bpy", shown)
    monkeypatch.setattr(part("operators.long_work"), "bpy", shown)
    monkeypatch.setattr(part("operators.long_work"), "TURN", 0.0)
    return window


TIMER = SimpleNamespace(type="TIMER")
ESC = SimpleNamespace(type="ESC")


def asked(name: str) -> Any:
    """An operator that does long work, and was not started yet."""
    return type("Long", (Asked, part("operators.long_work").LongWork), {})(name)


def pressed(name: str, window: Window) -> Any:
    """An operator that was invoked in the interface and waits for its first turn."""
    operator = asked(name)
    assert operator.invoke(window, None) == {"RUNNING_MODAL"}
    assert part("operators.work").is_busy()
    return operator


def run(name: str) -> Callable[[], object]:
    """A call of an operator by a script."""
    operator = getattr(bpy.ops.kiriko, name)
    given = Asked(name) if name in LONG else None
    options = {
        "simulate": ("samples",),
        "visible_range": ("share",),
        "eye_box": ("share",),
        "report": ("seconds", "overwrite"),
        "export_maps": ("directory", "overwrite"),
    }.get(name, ())
    always = {"allow_stale": True} if name == "export" else {}
    return lambda: operator(**always, **{option: getattr(given, option) for option in options})


def is_sentence(text: str) -> bool:
    """One line, with an end, for people."""
    return "\n" not in text and text.endswith(".") and "Traceback" not in text


def refusal(call: Callable[[], object]) -> str:
    """The one sentence with which an operator refuses."""
    with pytest.raises(RuntimeError) as caught:
        call()
    text = str(caught.value).removeprefix("Error: ").rstrip("\n")
    assert is_sentence(text), text
    return text


def whole(name: str) -> object:
    """The operator's results in a session that has never solved anything."""
    part("operators.work").forget()
    assert run(name)() == {"FINISHED"}
    return product(name)


def failing(error: BaseException) -> Callable[..., object]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


@contextmanager
def full_disk(size: int = 100) -> Iterator[None]:
    """No file can get larger than this, in bytes: writing fails in the system, as on a
    full disk.
    """
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", marked(LONG))
def test_esc_at_every_step_changes_nothing(
    rig: dict, window: Window, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Wherever it is stopped all is as before.

    A result made afterwards is, to the bit, that of a fresh session.
    """
    monkeypatch.setattr(part("operators.remedies"), "SECONDS", inf)  # as many steps at any pace
    operator = pressed(name, window)
    n_steps = 0
    while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        n_steps += 1

    # another result, in as many steps
    rig["PICTURE"].kiriko.image = bpy.data.images.new("white", 8, 8)
    before = state()
    for k in np.unique(np.linspace(0, n_steps, SAMPLES).astype(int)):
        part("operators.work").forget()  # parts kept of a solve that was stopped save steps
        operator = pressed(name, window)
        for _ in range(k):
            assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert operator.modal(window, ESC) == {"CANCELLED"}
        assert window.is_clean
        assert not part("operators.work").is_busy()
        assert state() == before, k

    operator = pressed(name, window)
    while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        pass
    is_of_the_old = name == "simulate"  # the sight of a result that is out of date

    assert operator.said[-1][0] == ("WARNING" if is_of_the_old else "INFO"), operator.said
    assert window.is_clean
    after = product(name)
    assert after == whole(name)


@pytest.mark.parametrize("way", ["SHARP", "BLENDED", "own images"])
def test_esc_stops_a_solve_of_several_viewers_and_leaves_all(
    rig: dict, window: Window, way: str
) -> None:
    """At any step: the image, the conflict, what is told of each viewer and the list are as before.
    Afterwards the result is that of a fresh session.
    """
    ours = bpy.context.scene.kiriko
    bpy.ops.kiriko.viewer_grid(heads=(3, 1, 1))
    if way == "own images":
        ours.picture_source = "IMAGE"
        for n, one in enumerate(ours.viewers):
            one.image = bpy.data.images.new(f"image {n}", 8, 8)
            one.image.generated_color = (0.3 * n, 0.5, 0.5, 1.0)
    else:
        ours.disagreement = way
    bpy.ops.kiriko.solve()
    assert len(json.loads(ours.result.details)["viewers"]) == 3

    def of_viewers() -> tuple:
        listed = [(one.camera, one.weight, one.is_on, one.image) for one in ours.viewers]
        return state(), pixels(ours.result.conflict).tobytes(), listed, ours.viewer_shown

    ours.viewers[1].weight = 3.0
    ours.viewers[2].camera.location.x += 0.02
    bpy.context.view_layer.update()
    part("operators.work").forget()
    operator = pressed("solve", window)
    n_steps = 0
    while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        n_steps += 1
    bpy.ops.kiriko.solve()
    expected = of_viewers()[1]

    ours.viewers[1].weight = 1.0
    bpy.ops.kiriko.solve()
    ours.viewers[1].weight = 3.0
    before = of_viewers()
    assert before[1] != expected
    for k in np.unique(np.linspace(1, n_steps, SAMPLES).astype(int)):
        part("operators.work").forget()
        operator = pressed("solve", window)
        for _ in range(k):
            assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert operator.modal(window, ESC) == {"CANCELLED"}
        assert window.is_clean
        assert not part("operators.work").is_busy()
        assert of_viewers() == before, k
    bpy.ops.kiriko.solve()
    assert of_viewers()[1] == expected


@pytest.mark.parametrize("name", marked(STAGES))
def test_an_error_in_any_stage_is_one_sentence_and_changes_nothing(
    rig: dict, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, name: str
) -> None:
    """Whatever goes wrong, foreseen or not, the last result and the scene survive.

    The next time all is well.
    """
    before = state()
    for n, stage in enumerate(STAGES[name]):
        owner, attribute = stage.rsplit(".", 1)
        few = errors()[:FEW]
        for error in [few[n % FEW]] if name == "report" else few:  # a report takes its time
            if name == "solve":
                part("operators.work").forget()  # or there is no tracing
            with monkeypatch.context() as broken:
                broken.setattr(part(owner), attribute, failing(error))
                text = refusal(run(name))
            assert state() == before, (stage, error)
            is_foreseen = isinstance(error, part("core.errors").KirikoError)
            assert (text == str(error)) if is_foreseen else ("the scene is as it was" in text), (
                stage,
                text,
            )
            assert ("Traceback" in capsys.readouterr().err) == (not is_foreseen)

    if name in LONG:
        assert run(name)() == {"FINISHED"}
        after = product(name)
        assert after == whole(name)


def test_an_error_in_the_interface_ends_the_work(
    rig: dict, window: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Timer, status bar and progress go with it, and Live, which
    waits for long work to end, is not kept waiting.
    """
    for error in errors():
        operator = pressed("solve", window)
        operator.modal(window, TIMER)
        with monkeypatch.context() as broken:
            broken.setattr(part("core.solve.painting"), "find_strokes", failing(error))
            while (outcome := operator.modal(window, TIMER)) == {"PASS_THROUGH"}:
                pass
        assert outcome == {"CANCELLED"}
        (said,) = operator.said
        assert said[0] == "ERROR"
        assert is_sentence(said[1])
        assert window.is_clean
        assert not part("operators.work").is_busy()


@pytest.fixture
def shown(rig: dict, monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The coarse source images that were shown.

    The rig is large enough for one, and nobody waits for it.
    """
    ours = bpy.context.scene.kiriko.viewer.kiriko
    ours.resolution = (160, 160)
    coarse = part("core.solve.coarse")
    solve = part("operators.solve")
    images = []
    monkeypatch.setattr(coarse, "COARSE", replace(coarse.COARSE, tracing_s=0.0))
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
        and part("core.blender.result").is_on_display(display, result.source)
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
    assert "'Mine' of the display" in scene.kiriko.result.notes
    assert "Esc keeps it" in window.status
    while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        pass

    assert len(shown) == 1
    assert told == sorted(told)
    assert operator.said == [("INFO", scene.kiriko.result.summary)]
    assert not scene.kiriko.result.is_coarse

    gave_way = (
        f"'Mine' of the display 'Kiriko Display' gave way to"
        f" '{rig['DISPLAY'].active_material.name}'."
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
    while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
        pass
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

    assert said.startswith("Stopped; a coarse source image stays: Undo")
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


@pytest.mark.parametrize(
    "stage", ["core.solve.measured.measure", "core.blender.shaders.show_image"]
)
def test_an_error_after_the_coarse_image_leaves_it(
    rig: dict, window: Window, shown: list, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    """Marked as partial, and told; the earlier image is an undo away."""
    owner, attribute = stage.rsplit(".", 1)
    for error in errors():
        shown.clear()
        part("operators.work").forget()
        operator = pressed("solve", window)
        step(operator, window, shown)
        with monkeypatch.context() as broken:
            broken.setattr(part(owner), attribute, failing(error))
            while (outcome := operator.modal(window, TIMER)) == {"PASS_THROUGH"}:
                pass
        assert outcome == {"FINISHED"}
        ((level, said),) = operator.said
        assert level == "ERROR"
        assert is_sentence(said)
        assert "coarse source image stays (Undo takes it back)" in said
        assert is_of_coarse(shown[0])
        assert window.is_clean
        bpy.ops.ed.undo_push(message="Solve")

    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_a_coarse_image_that_cannot_be_written_changes_nothing(
    rig: dict, window: Window, shown: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error while it is put in place ends the solve with the result of before."""
    before = state()
    for stage in (
        "core.blender.result.pack",
        "core.blender.result.put_on_display",
        "core.solve.coarse.enlarged",
    ):
        owner, attribute = stage.rsplit(".", 1)
        operator = pressed("solve", window)
        with monkeypatch.context() as broken:
            broken.setattr(part(owner), attribute, failing(ValueError("odd")))
            while (outcome := operator.modal(window, TIMER)) == {"PASS_THROUGH"}:
                pass
        assert outcome == {"CANCELLED"}
        assert "the scene is as it was" in operator.said[-1][1]
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
        part("operators.work").forget()
        bpy.context.scene.kiriko.margin += 1
        bpy.ops.ed.undo_push(message="margin")
        shown.clear()
        operator = pressed("solve", window)
        step(operator, window, shown)
        happen()
        before = state()
        while (outcome := operator.modal(window, key)) == {"PASS_THROUGH"}:
            pass
        assert outcome == {"CANCELLED"}
        assert "coarse" not in operator.said[-1][1]
        assert window.is_clean
        assert state() == before
        assert not bpy.context.scene.kiriko.result.is_coarse

    shown.clear()
    part("operators.work").forget()
    operator = pressed("solve", window)
    step(operator, window, shown)
    operator.cancel(window)

    assert window.is_clean
    assert is_of_coarse(shown[0])


def test_a_dialogue_that_is_left_before_any_work_ends_nothing(rig: dict, window: Window) -> None:
    """Blender cancels the operator of a dialogue on Esc: no work of it is there to be stopped, and
    that of another one goes on.
    """
    asked("export_atlas").cancel(window)
    assert not part("operators.work").is_busy()
    operator = pressed("solve", window)
    asked("export_atlas").cancel(window)
    assert part("operators.work").is_busy()
    operator.cancel(window)
    assert window.is_clean


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
        while operator.modal(window, TIMER) == {"PASS_THROUGH"}:
            pass
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


ADD_RIG_STAGES = (
    "core.blender.new_rig.read_parts",
    "core.blender.role_glass.read_glass",
    "core.light.kept.making_solids",
    "core.bench.light.tracing",
    "core.blender.rig_objects.lattice_file",
    "core.blender.rig_objects.packed_image",
    "core.blender.shaders.show_picture",
    "core.blender.new_rig.make_viewer",
)


@pytest.mark.parametrize("is_given", [True, False])
def test_esc_at_many_steps_of_add_rig_leaves_nothing(window: Window, is_given: bool) -> None:
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
    part("operators.work").forget()
    before = state()

    for k in np.unique(np.linspace(0, n_steps - 1, 2 * SAMPLES).astype(int)):
        part("operators.work").forget()  # parts kept of work that was stopped save steps
        operator = pressed("add_rig", window)
        operator.viewer_resolution = 64
        for _ in range(k):
            assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert operator.modal(window, ESC) == {"CANCELLED"}
        assert window.is_clean
        assert state() == before, k


def test_long_work_of_one_window_is_waited_for_in_another(rig: dict, window: Window) -> None:
    """A second one would have both take twice as long, in one session: it is refused with a
    sentence, changes nothing, and begins once the first has ended.
    """
    first = pressed("solve", window)
    second = asked("simulate")
    status = window.status
    assert second.invoke(window, None) == {"CANCELLED"}
    assert second.said == [("WARNING", "Kiriko is at work: wait for it or press Esc.")]
    assert (len(window.timers), window.status) == (1, status)
    while first.modal(window, TIMER) != {"FINISHED"}:
        pass
    assert window.is_clean
    assert second.invoke(window, None) == {"RUNNING_MODAL"}
    second.cancel(window)
    assert window.is_clean


def test_work_that_is_redone_shows_its_progress_at_the_pointer(window: Window) -> None:
    """The box at the lower left calls `execute`, in which no
    event is heard: the pointer is all that can change.
    """
    cube()
    operator = asked("add_rig")
    shown = []
    window.progress_update = shown.append
    assert operator.execute(window) == {"FINISHED"}
    assert shown == sorted(shown)
    assert len(set(shown)) > 3
    assert window.is_clean
    assert operator.said[-1][0] == "WARNING"  # the cube has no glass
    assert not window.timers


def test_a_rig_that_cannot_be_made_leaves_nothing(
    scene: bpy.types.Scene, kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Add Rig, broken in its midst, takes back all that it made and set."""
    cube()
    for stage in ADD_RIG_STAGES:
        owner, attribute = stage.rsplit(".", 1)
        before = state()
        for error in errors()[:FEW]:
            part("operators.work").forget()  # or the glass is ready already
            with monkeypatch.context() as broken:
                broken.setattr(part(owner), attribute, failing(error))
                refusal(lambda: bpy.ops.kiriko.add_rig(viewer_resolution=64))
            assert state() == before
    assert bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64)) == {"FINISHED"}


# operators that change the bench by the light that they trace
MENDERS = {
    "fit_display": {},
    "fit_plate": {},
    "fit_picture_size": {},
    "best_place": {"take": True},
    "turn_back": {"take": True},
}


@pytest.mark.parametrize("name", MENDERS)
def test_a_part_that_cannot_be_fitted_or_moved_stays(
    rig: dict, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Broken while it traces, or while it moves the part: everything is as it was."""
    rig["PICTURE"].location.x += 0.006
    rig["DISPLAY"].scale *= 0.8
    bpy.context.view_layer.update()
    before = state()
    for stage in ("core.bench.light.tracing", "core.bench.picture_light.points_of"):
        owner, attribute = stage.rsplit(".", 1)
        for error in errors()[:FEW]:
            with monkeypatch.context() as broken:
                broken.setattr(part(owner), attribute, failing(error))
                refusal(lambda: getattr(bpy.ops.kiriko, name)(**MENDERS[name]))
            assert state() == before


# when the last two fail the final picture is shown, and has no numbers
LIVE_STAGES = (
    "core.blender.scene.read",
    "core.solve.reach.planning",
    "core.map.points.tracing",
    "core.solve.painting.find_strokes",
    "core.blender.result.set_pixels",
    "operators.live_follower.update_solution",
    "core.blender.result_numbers.asdict",
)


def settle() -> None:
    """Take the turns of Live's timer until there is nothing left to do, or Live has ended."""
    live = part("operators.live")
    assert any(live.tick() in {None, live.live_follower.IDLE} for _ in range(MANY))


def traces() -> list[str]:
    """Functions of Live that Blender would still call."""
    live = part("operators.live")
    left = [name for name, handler in live.HANDLERS if handler in getattr(bpy.app.handlers, name)]
    return left + (["timer"] if bpy.app.timers.is_registered(live.tick) else [])


@pytest.fixture
def live(rig: dict) -> Iterator[ModuleType]:
    """Module operators.live, which follows the rig and is up to date."""
    live = part("operators.live")
    bpy.ops.kiriko.live()
    settle()
    yield live
    live.stop()


def test_an_error_in_live_is_one_sentence_and_the_image_stays(
    rig: dict, live: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was foreseen leaves it on.

    Of any other it ends, leaves nothing behind, and can be turned on again. After the final picture
    it is this one that stays, without numbers; all else is as before.
    """
    result = bpy.context.scene.kiriko.result
    for stage in LIVE_STAGES:
        owner, attribute = stage.rsplit(".", 1)
        for error in errors()[:FEW]:
            rig["GLASS"].rotation_euler.z += 0.01
            bpy.context.view_layer.update()
            before = state()
            with monkeypatch.context() as broken:
                broken.setattr(part(owner), attribute, failing(error))
                settle()
            _, slots, shown, numbers, chosen, images, where, files = state()
            if stage in LIVE_STAGES[-2:]:
                assert not result.is_coarse
                assert numbers == ("", "", "", "", 0.0, "")
                assert images[0] != before[5][0]
                images[0], numbers = before[5][0], before[3]
            now = (slots, shown, numbers, chosen, images, where, files)
            assert now == before[1:], (stage, error)
            assert is_sentence(live.status()[0])
            assert live.is_on() == isinstance(error, part("core.errors").KirikoError)
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


def test_a_full_disk_leaves_the_file_of_before(rig: dict, tmp_path: Path) -> None:
    """Export is refused in one sentence at whatever byte the disk is full.

    No part of a file is left.
    """
    for form in ("PNG8", "PNG16", "TIFF16", "EXR_HALF", "EXR_FLOAT"):
        bpy.context.scene.kiriko.export_format = form
        run("export")()
        before = files()
        name = part("core.image_io").named_for("source", form).name
        size = len(before[name])
        for room in (0, 100, size // 2, size - 13):
            with full_disk(room):
                assert "check the disk" in refusal(run("export"))
            assert files() == before, (form, room)
        with full_disk(size):
            assert run("export")() == {"FINISHED"}
        assert {name: len(content) for name, content in files().items()} == {
            k: len(v) for k, v in before.items()
        }


def test_what_the_system_refuses_leaves_the_files_of_before(
    rig: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that cannot be made, filled or renamed: all are as before, in a report all of them."""
    before = files()
    full = OSError(errno.ENOSPC, "No space left on device")
    calls = ((part("core.disk"), "_temporary"), (Path, "replace"), (Path, "write_text"))
    for (owner, call), name in zip(
        (*calls[:2], *calls[1:]), ("export", "export", "report", "report"), strict=True
    ):
        with monkeypatch.context() as broken:
            broken.setattr(owner, call, failing(full))
            assert "No space left on device" in refusal(run(name))
        assert files() == before


def test_a_preview_that_the_disk_cuts_off_changes_nothing(
    rig: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At whatever byte the temporary disk is full, one sentence says where to make room.

    A map is refused, too.
    """
    module = part("core.blender.preview")
    sizes = []
    reading = part("operators.work").read(bpy.context)
    close = module.Preview.close

    with monkeypatch.context() as spied:
        spied.setattr(
            module.Preview,
            "close",
            lambda self: [sizes.append(self.path.stat().st_size), close(self)],
        )
        assert bpy.ops.kiriko.preview(samples=1) == {"FINISHED"}
        module.render_map(bpy.context.scene, reading)

    kept = pixels(bpy.context.scene.kiriko.result.preview).copy()
    before = state()
    size = min(sizes)

    # the times in it make it some bytes longer or shorter
    for room in (0, 100, 300, 500, 2000, size // 2, size - 40):
        with full_disk(room):
            text = refusal(lambda: bpy.ops.kiriko.preview(samples=1))
            with pytest.raises(part("core.errors").ImageError, match="make room") as caught:
                module.render_map(bpy.context.scene, reading)
        assert "make room" in text
        assert f"'{tempfile.gettempdir()}'" in text
        assert is_sentence(str(caught.value))
        assert state() == before, room
        assert np.array_equal(pixels(bpy.context.scene.kiriko.result.preview), kept)

    with monkeypatch.context() as broken:
        broken.setattr(Path, "replace", failing(OSError(errno.ENOSPC, "No space left on device")))
        path = tmp_path / "report" / "preview.png"
        text = refusal(lambda: bpy.ops.kiriko.preview(samples=1, filepath=str(path)))

    assert f"'{path}' cannot be written (No space left on device)" in text
    assert state() == before


def test_a_report_on_a_full_disk_names_its_folder(rig: dict) -> None:
    """At whatever step the disk is full: never a temporary file
    or folder, of which nothing is left by then.
    """
    before = state()
    for room in (0, 100, 1500):
        with full_disk(room):
            text = refusal(run("report"))
        assert f"'{bpy.context.scene.kiriko.report_folder}" in text
        assert "kiriko-" not in text
        assert state() == before


def test_a_report_is_written_whole_or_not_at_all(
    rig: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the disk is full in its midst, the earlier one is still there.

    The ladder is the earlier one, too.
    """
    assert run("report")() == {"FINISHED"}
    before = state()
    calls = []
    write = Path.write_text

    def fill(path: Path, *text: str, **how: str) -> int:
        calls.append(path)
        if len(calls) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, *text, **how)

    monkeypatch.setattr(Path, "write_text", fill)
    text = refusal(run("report"))
    assert "report.svg' cannot be written (No space left on device)" in text
    assert str(Path(bpy.context.scene.kiriko.report_folder) / "report.svg") in text
    assert state() == before


def test_the_command_line_writes_all_files_or_none(
    rig: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """On a full disk, and after errors that nobody foresaw, the earlier files stay.

    One sentence, exit code 1.
    """
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    command = part("operators.command_line")
    folder = Path(bpy.context.scene.kiriko.report_folder)
    words = ["solve", "--out", str(folder), "--overwrite"]

    assert command.run(words) == 0
    before = files()
    sizes = {name: len(content) for name, content in before.items()}
    bpy.context.scene.kiriko.margin = 2
    capsys.readouterr()
    with full_disk(max(sizes.values()) - 1):  # some of the files have room
        assert command.run(words) == 1
    (line,) = capsys.readouterr().err.splitlines()

    assert line.startswith("kiriko: The file")
    assert is_sentence(line)
    assert files() == before
    for error in errors()[1:FEW]:
        with monkeypatch.context() as broken:
            broken.setattr(part("core.image_io"), "_quantised", failing(error))
            assert command.run(words) == 1
        assert is_sentence(capsys.readouterr().err.splitlines()[-1])
        assert files() == before

    new = tmp_path / "a" / "b"
    with full_disk():
        assert command.run(["solve", "--out", str(new)]) == 1
    assert not new.parent.exists()


@pytest.mark.parametrize("is_live", [False, True])
def test_the_source_is_saved_with_the_file_where_temporary_files_have_no_room(
    rig: dict, tmp_path: Path, is_live: bool
) -> None:
    """An image that cannot be compressed by way of a file is packed as it
    is: the same numbers after saving and loading.
    """
    with full_disk():
        if is_live:
            bpy.ops.kiriko.live()
            settle()
            bpy.ops.kiriko.live()
        else:
            bpy.ops.kiriko.solve()

    before = product("solve")
    assert bpy.context.scene.kiriko.result.source.packed_file is not None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))

    assert product("solve") == before
    assert before == whole("solve")


def test_a_picture_whose_file_is_gone_is_named(rig: dict, tmp_path: Path) -> None:
    """Before it was read the solve is refused; in the middle of a solve it makes no difference."""
    path = tmp_path / "mine.png"
    part("core.image_io").write(path, np.random.default_rng(1).random((8, 8, 3)), "PNG8")
    rig["PICTURE"].kiriko.image = image = bpy.data.images.load(str(path))
    content = path.read_bytes()
    path.unlink()
    before = state()
    text = refusal(run("solve"))

    assert "mine.png" in text
    assert "missing" in text
    assert state()[1:] == before[1:]
    path.write_bytes(content)
    image.reload()
    solved = asked("solve").steps(bpy.context)
    next(solved)
    path.unlink()
    part("core.steps").finish(solved)
    after = product("solve")
    path.write_bytes(content)

    assert after == whole("solve")
    bpy.ops.kiriko.live()
    settle()
    path.unlink()
    image.reload()
    bpy.context.view_layer.update()
    settle()
    text, is_problem = part("operators.live").status()

    assert is_problem
    assert "mine.png" in text
    assert product("solve") == after
    path.write_bytes(content)

    # that an image which no material uses is loaded again Blender does not tell
    for chosen in (None, image):
        image.reload()
        rig["PICTURE"].kiriko.image = chosen
        settle()

    assert not part("operators.live").status()[1]
    assert product("solve") == after
    part("operators.live").stop()


def test_a_library_that_is_gone_is_a_missing_part(
    rig: dict, linked: Callable, tmp_path: Path
) -> None:
    """Glass that was linked from a file which is not there any more is told as missing.

    The last image stays.
    """
    theirs = linked(rig["GLASS"])
    bpy.data.objects.remove(rig["GLASS"])
    bpy.context.scene.collection.objects.link(theirs)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    before = product("solve")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    (tmp_path / f"{theirs.name}.blend").unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))
    assert "glass" in refusal(run("solve")).lower()
    assert product("solve") == before


@pytest.mark.parametrize("name", marked(LONG))
def test_another_file_in_the_middle_is_not_written_to(
    rig: dict, window: Window, tmp_path: Path, name: str
) -> None:
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
            for _ in range(1 if name == "render_pictures" else 3):  # which has a turn a viewer
                assert operator.modal(window, TIMER) == {"PASS_THROUGH"}, operator.said
            happen()
            before = everything()
            if is_closed:  # as Blender does it in its interface
                operator.cancel(window)
            else:
                while (outcome := operator.modal(window, TIMER)) == {"PASS_THROUGH"}:
                    pass
                assert outcome == ({"FINISHED"} if event == "save" else {"CANCELLED"})
                assert is_sentence(operator.said[-1][1])
            assert window.is_clean
            assert not work.is_busy()
            assert everything() == before or (event == "save" and not is_closed)

    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_disabling_the_extension_ends_long_work(rig: dict, window: Window) -> None:
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


def test_disabling_the_extension_in_the_middle_of_live_and_enabling_it_again(
    rig: dict, live: ModuleType
) -> None:
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
