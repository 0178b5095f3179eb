"""Long work of operators in an interface that is not seen, and faults that stop it."""

import errno
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import pytest

from extension import EXTENSION
from small_rigs import pixels, short_walks, small_rig

LONG = (
    "solve",
    "simulate",
    "visible_range",
    "eye_box",
    "draw_light_paths",
    "render_pictures",
    "report",
    "export_maps",
)
SAMPLES = 5  # of the steps at which long work is stopped, the first and the last among them
MANY = 2000  # turns of Live, of which none of these rigs needs a tenth
# Where work can be stopped by a fault: functions that all work of a kind goes through.
POINTS = {
    "read": ("core.blender.read.scene_parts.read_parts", "core.blender.read.scene.read_viewers"),
    "plan": ("core.light.compile_plan.compile_plan_steps",),
    "trace": ("core.light.trace.tracing",),
    "paint": (
        "core.solve.painting.paint",
        "core.blender.preview.preview_settings.set_cycles",
        "core.blender.preview.viewer_render.render_for",
    ),
    "write": (
        "core.blender.data.image.set_pixels",
        "core.blender.data.image.packed_image",
        "core.blender.data.made_objects.surface_object",
        "core.blender.result.light_path_curves.draw_paths",
        "core.files.disk.together",
        "operators.viewer_images.give",
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


def tap(patch: pytest.MonkeyPatch, point: str, heard: Callable[[], object]) -> None:
    """Call `heard` each time that work passes a point, from whatever module."""
    modules = [m for name, m in sys.modules.items() if name.startswith(EXTENSION)]
    for function in map(part, POINTS[point]):

        def port(*args: Any, _own: Callable = function, **options: Any) -> Any:
            heard()
            return _own(*args, **options)

        for module in modules:
            for name, thing in list(vars(module).items()):
                if thing is function:
                    patch.setattr(module, name, port)


@contextmanager
def broken(point: str, error: BaseException, nth: int = 1) -> Iterator[None]:
    """Work fails at a point: the first time that it passes it, or a later one."""
    passes = count(1)
    with pytest.MonkeyPatch.context() as patch:
        tap(patch, point, lambda: failing(error)() if next(passes) >= nth else None)
        yield


def errors() -> list[BaseException]:
    """Faults: foreseen ones and ones that nobody foresaw, with texts of several lines."""
    return [
        part("core.base.errors").RigError("Said in one sentence."),
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
    if name == "draw_light_paths":
        curves = [thing for thing in bpy.context.scene.objects if thing.type == "CURVE"]
        return [[tuple(p.co) for p in s.points] for one in curves for s in one.data.splines]
    if name == "render_pictures":
        return pixels(bpy.context.scene.kiriko.picture_image).tobytes()
    if name == "export_maps":
        folder = Path(bpy.context.scene.kiriko.report_folder)
        read = part("core.files.image_io").read  # for the file has the hour in it, too
        return read(folder / "warp.exr")[0].tobytes(), files()["maps.json"]
    rungs = json.loads(files()["report.json"])["rungs"]
    return [{key: value for key, value in rung.items() if "seconds" not in key} for rung in rungs]


def forget() -> None:
    """Let go what is kept of other work, and would save steps of the next."""
    part("operators.work").forget()


class Asked:
    """An operator whose properties are given here.

    Reports are kept. Its work is the real one's.
    """

    def __init__(self, name: str) -> None:
        classes = part("operators").CLASSES
        self.real = next(cls for cls in classes if cls.__name__ == f"KIRIKO_OT_{name}")
        self.bl_label, self.bl_options = self.real.bl_label, self.real.bl_options
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
    module = part("core.lab.calibrate.visible_range")
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
    scene.kiriko.export_path = str(tmp_path / "report" / "source.png")
    bpy.ops.kiriko.solve()
    other = bpy.data.scenes.new("Other")  # of Render Pictures: a world alone
    other.render.engine, other.cycles.samples = "CYCLES", 1
    other.world = bpy.data.worlds.new("Other")
    rig["GLASS"].rotation_euler.z = 0.1
    bpy.context.view_layer.update()
    forget()

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


def to_the_end(operator: Any, window: Window, key: SimpleNamespace = TIMER) -> tuple[set, int]:
    """Take turns until the operator ends: its outcome, and the number of turns before."""
    n = 0
    while (outcome := operator.modal(window, key)) == {"PASS_THROUGH"}:
        n += 1
    return outcome, n


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
    always = {
        "export": {"allow_stale": True, "overwrite": True},
        "best_place": {"take": True},
        "turn_back": {"take": True},
    }.get(name, {})
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
    forget()
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
