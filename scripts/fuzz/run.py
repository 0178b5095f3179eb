"""Random rigs through the operators: each ends in a valid result or in one message. Runs inside
Blender; see dev.py.

A rig is made only from the two numbers [seed, k], so `dev.py fuzz --seed SEED --only K` repeats a
failure. Rigs run in a process of their own. A clock outside of Python ends it if a rig takes too
long, and the next process continues with the next rig.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import process_time
from typing import Any

import bpy
import numpy as np

from environments import as_module
from kiriko.core.base.steps import run_steps
from kiriko.core.blender.data.image import pixels_from_image
from kiriko.core.blender.preview import (
    cycles_preview as blender_preview,
)
from kiriko.core.blender.read import scene as blender_scene
from kiriko.core.blender.read.nested_glass import interfaces
from kiriko.core.light import kernel_tracer
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import Step, trace_all, tracing
from kiriko.core.native import loading
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.accuracy import find_contradicted
from kiriko.core.solve.session import Session
from known.both_ways import find_parted
from known.registered import registered
from sanitise_kernel import NOT_HERE, sanitised

from .rigs import Dice, make_rig

SECONDS = 60.0  # of the processor, for one rig; more is a hang
BY_NUMPY = 5  # times as many without the kernel
# ratio of wall seconds to processor seconds: a rig may wait, a machine may be busy
IDLE = 10
# for the visible range, which needs half a million rays
FEW_FACES = 100
FEW_EVENTS = 32
AT_ONCE = 100  # rigs in one process
BOTH_WAYS = 2000  # rays traced both by numpy and by the kernel
LONGEST = 500  # characters of an error
MOST_SAID = 3000  # of the output of a terminated process
SANITISER = re.compile(r"ERROR: AddressSanitizer|\S+: runtime error: ")
QUOTED = re.compile(r"'[^']*'")
NONSENSE = re.compile(r"\b(nan|inf|Traceback)\b")
NEXT_SENTENCE = re.compile(r"[.!?]\s+[A-Z]")
MOST_SENTENCES = 3  # the fault, the state, and the remedy
NUMBER = re.compile(r"-?\d[\d.e+-]*")
ROUNDING = 1e-6  # tolerance of shares at 0, at 1 and of their sum
# properties of a scene that control its display, or are created on access
UNTOLD = {
    "rna_type", "users", "is_updated", "is_updated_data", "is_evaluated", "original", "preview",
    "session_uid", "tag", "is_dirty", "has_data", "bindcode", "pixels", "depsgraph", "is_editmode",
    "packed_files", "packed_file", "frame_float", "is_library_indirect", "id_data",
    "is_runtime_data", "is_missing", "view_layers", "keying_sets_all", "all_objects",
}  # fmt: skip
GROUPS = (
    "scenes", "collections", "objects", "meshes", "cameras", "materials", "images", "node_groups",
    "worlds", "curves", "metaballs", "lattices", "lights", "textures", "texts",
)  # fmt: skip


@dataclass
class Outcome:
    """The outcome of a rig.

    verdict : solved, refused or failed
    text : the sentence of a refusal, or of a fault
    drawn : the wild choices in the rig
    also : the words of further operators, by name
    warnings : places in the code that numpy warned of
    judged : comparison with Cycles, None where there was none
    seconds : of the processor
    """

    k: int
    verdict: str
    text: str = ""
    drawn: list[str] = field(default_factory=list)
    also: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    judged: dict[str, float] | None = None
    seconds: float = 0.0


class WrongError(Exception):
    """An operator did none of the things it may do."""


# The scene's contents


def told_of(value: Any, depth: int = 4) -> Any:
    """A property's value in a comparable form."""
    if isinstance(value, bpy.types.ID):
        return f"{type(value).__name__} {value.name}"
    if isinstance(value, bpy.types.bpy_struct):
        return properties(value, depth - 1) if depth else ""
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, str | int | bool | set | None):
        return repr(value)

    if isinstance(value, bpy.types.bpy_prop_collection):
        is_short = depth and len(value) <= 1000
        return [told_of(item, depth - 1) for item in value] if is_short else len(value)
    return np.array(value).tobytes() if hasattr(value, "__len__") else repr(value)


def properties(thing: bpy.types.bpy_struct, depth: int = 4) -> dict[str, Any]:
    """All properties of a thing in Blender's interface."""
    names = [name for name in thing.bl_rna.properties.keys() if name not in UNTOLD]  # noqa: SIM118 - no dict
    return {name: told_of(getattr(thing, name, None), depth) for name in names}


def column(items: Any, name: str, width: int, dtype: type) -> bytes:
    """One property of all items, as bytes."""
    found = np.empty(len(items) * width, dtype)
    items.foreach_get(name, found)
    return found.tobytes()


def inventory() -> dict[str, dict[str, Any]]:
    """Everything in the file, by kind and name of its datablock."""
    found: dict[str, dict[str, Any]] = {}
    for group in GROUPS:
        for block in getattr(bpy.data, group):
            if block.name == "Render Result":
                continue
            if group == "meshes":  # their vertices are too many to read one by one
                told: dict[str, Any] = {"materials": told_of(block.materials)}
                told["vertices"] = column(block.vertices, "co", 3, np.float32)
                told["corners"] = column(block.loops, "vertex_index", 1, np.int32)
                told["smooth"] = column(block.polygons, "use_smooth", 1, np.bool_)
                layers = block.uv_layers
                told["uv"] = [column(layer.uv, "vector", 2, np.float32) for layer in layers]
            else:
                told = properties(block)
            if group == "images" and block.size[0] * block.size[1] > 0:
                told["pixels"] = pixels_from_image(block).tobytes()
            found[f"{group} {block.name}"] = told

    return found


def differences(before: dict[str, dict[str, Any]], after: dict[str, dict[str, Any]]) -> list[str]:
    """Changed properties, as "kind name property"."""
    both = before.keys() & after.keys()
    changed = [
        f"{name} {key}"
        for name in both
        for key in {*before[name], *after[name]}
        if before[name].get(key) != after[name].get(key)
    ]
    gone = [f"{name} is gone" for name in before.keys() - both]
    return gone + [f"{name} is new" for name in after.keys() - both] + changed


SOLVES = re.compile(
    r"scenes \S+ kiriko(_scene)?|collections .* kiriko"
    r"|images Kiriko (Source|Seen)(\.\d{3})?( is new| \w+)"
    r"|materials .* Source\S* (is new|\w+)"
    r"|materials .* use_fake_user|materials Kiriko Display\S* \w+"  # Add Rig's, which gives way
    r"|objects (Kiriko )?Display\S* (material_slots|active_material)|meshes .* materials"
)
SHOWS_RANGE = re.compile(
    r"(objects|meshes) Kiriko Visible Range is new|collections .* (collection_)?objects|scenes \S+"
    r" (objects|collection)"
)
SHOWS_BOX = re.compile(SHOWS_RANGE.pattern.replace("Visible Range", "Eye Box"))
GIVES_PICTURES = re.compile(r"images .* (is new|users)|(scenes|collections) .* kiriko(_scene)?")
# glass is made see-through in Solid, too
ADDS = re.compile(
    r".* is new|objects .* (kiriko|display_type)|materials .* (kiriko|diffuse_color)|scenes .*"
    r"|collections .*"
)
# the others the work of a solve
MAY_CHANGE = {
    "KIRIKO_OT_visible_range": SHOWS_RANGE,
    "KIRIKO_OT_eye_box": SHOWS_BOX,
    "KIRIKO_OT_render_pictures": GIVES_PICTURES,
    "KIRIKO_OT_add_rig": ADDS,
}


# possible ends of an operator


def refusal(error: RuntimeError) -> str:
    """The sentence an operator was left with; WrongError when it is none."""
    text = str(error).strip().removeprefix("Error: ")
    # work.sentence's words for an unexpected error
    if "Traceback" in text or "please report" in text.lower():
        raise WrongError(text)
    text = re.sub(r"^Operator bpy\.ops\.\S+ (failed, )?", "", text)
    plain = QUOTED.sub("''", text)

    for is_wrong, why in (
        (not text.endswith("."), "does not end with a full stop"),
        ("\n" in text, "has several lines"),
        (len(NEXT_SENTENCE.findall(plain)) >= MOST_SENTENCES, "has too many sentences"),
        (NONSENSE.search(plain), "has a value that is not a number"),
        (not 10 < len(text) <= LONGEST, "is too short or too long"),
    ):
        if is_wrong:
            raise WrongError(f"the error {why}: {text}")

    return text


def call(operator: Any, **options: object) -> str:
    """Run an operator; an empty text, or the sentence it refused with, having changed nothing."""
    bpy.context.view_layer.update()
    before = inventory()
    try:
        result = operator(**options)
    except RuntimeError as error:
        text = refusal(error)
        bpy.context.view_layer.update()
        changed = differences(before, inventory())
        if changed:
            raise WrongError(f"refused ({text}), but changed {', '.join(changed[:5])}") from None
        return text

    if result != {"FINISHED"}:
        raise WrongError(f"{operator.idname()} returned {result}")
    bpy.context.view_layer.update()
    allowed = MAY_CHANGE.get(operator.idname(), SOLVES)
    changed = [text for text in differences(before, inventory()) if not allowed.fullmatch(text)]
    if changed:
        raise WrongError(f"{operator.idname()} changed {', '.join(changed[:5])}")

    return ""


def need(is_so: bool, otherwise: str) -> None:
    """WrongError unless it is so."""
    if not is_so:
        raise WrongError(otherwise)


def are_shares(values: Any) -> bool:
    """Whether all numbers are within 0..1, up to rounding."""
    values = np.asarray(values, float)
    return bool(((values >= -ROUNDING) & (values <= 1 + ROUNDING)).all())


def no_constant(name: str) -> None:
    """For json: NaN and Infinity are none of its numbers."""
    raise WrongError(f"the details hold {name}")


def check_result(scene: bpy.types.Scene) -> np.ndarray:
    """WrongError unless the scene's result is one; the source image (h, w, 3)."""
    result = scene.kiriko.result
    details = json.loads(result.details, parse_constant=no_constant)
    need(result.source is not None, "there is no source image")
    pixels = pixels_from_image(result.source)[..., :3]
    need(np.isfinite(pixels).all(), "the source image has pixels that are not finite")
    need((pixels >= 0).all(), f"the source image has negative pixels: {pixels.min()}")
    size = tuple(details["resolution"])
    need(pixels.shape[1::-1] == size, f"the source image has the size {pixels.shape}")
    sizes = [tuple(o.kiriko.resolution) for o in bpy.data.objects]
    lit = [o for o in bpy.data.objects if o.kiriko.role in {"DISPLAY", "SCREEN"}]
    # several displays are stacked in one image
    need(size in sizes or len(lit) > 1, "another resolution")
    coverage = result.coverage, details["view_coverage"], details["display_coverage"]
    shares = [*coverage, *details["misses"].values()]
    need(are_shares(shares), f"shares beyond 0..1: {shares}")
    whole = details["picture_coverage"] + sum(details["misses"].values())
    need(abs(whole - 1) < ROUNDING, f"coverage and reasons sum to {whole}")
    for text in (result.summary, *result.notes.splitlines()):
        need(text.endswith(".") and not NONSENSE.search(QUOTED.sub("", text)), f"the note: {text}")

    return pixels


def check_solution(
    scene: bpy.types.Scene, reading: blender_scene.Reading, source: np.ndarray
) -> None:
    """WrongError unless core alone comes to the same source image (h, w, 3), and its numbers are
    possible.
    """
    ours = scene.kiriko
    names = (
        "tolerance", "max_events", "effort", "only_through_glass", "only_through_plate",
        "brightness", "margin", "suppress_glare", "sharpen",
    )  # fmt: skip
    settings = Settings(**{name: getattr(ours, name) for name in names}, ghosts=ours.ghosts.lower())
    solution = run_steps(Session().solve(reading.rig, settings))
    need(np.array_equal(solution.source, source), "core alone comes to another source image")
    need(are_shares(solution.display_coverage), "display coverage beyond 0..1")
    need(are_shares(solution.first.view_coverage), "view coverage beyond 0..1")
    weight = solution.weight
    need(np.isfinite(weight).all() and (weight >= 0).all(), "weights that cannot be")
    is_seen = weight > 0
    is_bare = solution.display_coverage <= 0
    need(not (is_seen & is_bare).any(), "display pixels are seen that are not covered")
    if not (ours.margin or ours.sharpen):  # a pupil's rim may see more
        need(not source[~is_seen].any(), "display pixels shine that are not seen")
    seen = solution.seen()
    need(np.isfinite(seen).all() and (seen >= 0).all(), "the seen image is none")
    check_kernel(reading.rig, settings)


def check_kernel(rig: Rig, settings: Settings) -> None:
    """Raise WrongError if the compiled kernel misses a face that numpy hits."""
    size = rig.viewer.width, rig.viewer.height
    plan = compile_plan(rig, settings)
    if kernel_tracer.left_out(plan.layers, plan.parts.kind, plan.is_polarised) is None:
        places = np.random.default_rng(0).random((BOTH_WAYS, 2)) * size
        found = find_parted(plan, *rig.viewer.rays(places))
        told = f"of {found.n_rays} rays the kernel leads {found.n_wrong} past a face"
        need(found.n_wrong == 0, told)


# Cycles as judge


def is_comparable(reading: blender_scene.Reading, dice: Dice) -> bool:
    """Whether Cycles, in single precision and with one index per interface, can trace the same."""
    _, notes = interfaces(reading.rig.glasses)
    return dice.is_tame and not notes and all(plate.array is None for plate in reading.rig.plates)


@dataclass(frozen=True, eq=False)
class Compared:
    """Landings of the viewer's pixel middles (n,), row by row, in core and in Cycles.

    is_ours, is_theirs : rays that arrive in core, and in Cycles
    off : display px apart, NaN unless both arrive
    is_glass, by_gap, by_odd_normal : core's rays that hit glass, pass a gap in it, and are bent by
        a normal that contradicts its face
    """

    is_ours: np.ndarray
    is_theirs: np.ndarray
    off: np.ndarray
    is_glass: np.ndarray
    by_gap: np.ndarray
    by_odd_normal: np.ndarray


def compared(scene: bpy.types.Scene, reading: blender_scene.Reading) -> Compared:
    """Landings in core and in Cycles."""
    rig = reading.rig
    x, y = np.meshgrid(np.arange(rig.viewer.width) + 0.5, np.arange(rig.viewer.height) + 0.5)
    rays = rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    settings = Settings(max_events=scene.kiriko.max_events, only_through_glass=False)
    plan = compile_plan(rig, settings)
    every = trace_all(plan, *rays)
    through = trace_all(compile_plan(rig, replace(settings, only_through_glass=True)), *rays)
    xy = np.full((x.size, 2), np.nan)
    inside, _ = every.pixels(rig.display.width, rig.display.height)
    xy[every.sample[inside]] = every.xy[inside]
    is_glass, by_gap = np.zeros((2, x.size), bool)
    is_glass[through.sample[through.reason != Reason.MISSED_GLASS]] = True
    by_gap[every.sample[every.leak >= 0]] = True
    steps: list[Step] = []
    run_steps(tracing(plan, *rays, steps=steps))
    by_odd_normal = find_contradicted(plan, rays[0], steps) >= 0

    carried = blender_preview.render_map(scene, reading).reshape(-1, 3)
    is_theirs = carried[:, 2] > 0.5
    theirs = (carried[:, :2] * [1, -1] + [0, 1]) * [rig.display.width, rig.display.height]
    off = np.where(is_theirs, np.linalg.norm(xy - theirs, axis=1), np.nan)
    return Compared(np.isfinite(xy[:, 0]), is_theirs, off, is_glass, by_gap, by_odd_normal)


def judge(scene: bpy.types.Scene, reading: blender_scene.Reading) -> dict[str, float] | None:
    """Differences of landings in core and in Cycles, display px, and shares, 0..1; without light at
    normals that contradict their face, which Cycles corrects.
    """
    found = compared(scene, reading)
    agrees = ~found.by_odd_normal
    return how_far(found.is_ours & agrees, found.is_theirs & agrees, found.off)


def how_far(is_ours: np.ndarray, is_theirs: np.ndarray, off: np.ndarray) -> dict[str, float] | None:
    """Median and 95 % of the rays that arrive in both, and shares; None if none arrives in
    Cycles.
    """
    off = off[is_ours & is_theirs]
    if not is_theirs.any():
        return None
    if not len(off):
        return {"median": math.nan, "most": math.nan, "only_theirs": 1.0, "both": 0.0}

    only_theirs = (is_theirs & ~is_ours).sum()
    return {
        "median": float(np.median(off)),
        "most": float(np.quantile(off, 0.95)),
        "only_theirs": float(only_theirs / is_theirs.sum()),
        "apart": float((only_theirs + (off > 1).sum()) / is_theirs.sum()),
        "both": float(len(off) / is_ours.sum()),
    }


# One rig, many rigs


def add_rig_around(dice: Dice) -> str:
    """Take all but the glass out of the scene and let Add Rig make the rest."""
    scene = bpy.context.scene
    for thing in list(scene.objects):
        if thing.kiriko.role in {"GLASS", "NONE"} and thing.type not in {"CAMERA"}:
            thing.select_set(thing.visible_get())
        elif not dice.chance(0.05):
            bpy.data.objects.remove(thing)

    sizes = "distance", "picture_size", "field", "viewer_distance"
    text = call(
        bpy.ops.kiriko.add_rig,
        viewer_resolution=dice.pixels(),
        display_resolution=(dice.pixels(), dice.pixels()),
        tilt=dice.rng.uniform(0.1, 1.4),
        azimuth=dice.rng.uniform(-10, 10),
        kind=dice.pick(("IN_GLASS", "BEHIND_GLASS")),
        look_down=dice.rng.uniform(0, np.pi / 2),
        **{name: dice.pick((0.0, 0.0, dice.log(1e-6, 1e6))) for name in sizes},
    )
    text = text or call(bpy.ops.kiriko.solve)
    if not text:
        check_result(scene)
    return text


def simulate(dice: Dice) -> str:
    """Simulate the seen image."""
    text = call(bpy.ops.kiriko.simulate, samples=int(dice.rng.integers(2, 5)))
    if not text:
        seen = pixels_from_image(bpy.context.scene.kiriko.result.seen)
        need(np.isfinite(seen).all() and (seen >= 0).all(), "the simulated image is none")
    return text


def export(dice: Dice) -> str:
    """Export the source image."""
    forms = "PNG8", "PNG16", "TIFF16", "EXR_HALF", "EXR_FLOAT"
    bpy.context.scene.kiriko.export_format = dice.pick(forms)
    with tempfile.TemporaryDirectory() as folder:
        text = call(bpy.ops.kiriko.export, filepath=str(Path(folder) / "source"))
        written = [path.stat().st_size for path in Path(folder).iterdir()]
        need(text or (len(written) == 1 and written[0] > 0), f"wrote files of {written} bytes")
    return text


def solve_again(dice: Dice) -> str:
    """Move a part, and solve again."""
    scene = bpy.context.scene
    thing = dice.pick([o for o in scene.objects if o.kiriko.role != "NONE"])
    thing.location = (np.array(thing.location) * dice.rng.uniform(0.98, 1.02)).tolist()
    text = call(bpy.ops.kiriko.solve)
    if not text:
        check_result(scene)
    return text


def visible_range(dice: Dice) -> str:
    """Show the visible range."""
    return call(bpy.ops.kiriko.visible_range)


def eye_box(dice: Dice) -> str:
    """Show the eye box."""
    limit, share = dice.log(1e-2, 1e3), dice.rng.uniform(0.01, 1.0)
    return call(bpy.ops.kiriko.eye_box, limit=limit, share=share)


def render_pictures(dice: Dice) -> str:
    """Render another scene, of a world alone, for each viewer."""
    other = bpy.data.scenes.new("Other")
    other.render.engine, other.cycles.samples = "CYCLES", 1
    # Blender names a new scene's colour space as its form is first set
    other.render.image_settings.file_format = "PNG"
    text = call(bpy.ops.kiriko.render_pictures)
    if not text:
        ours = bpy.context.scene.kiriko
        images = [one.image for one in ours.viewers if one.is_on] or [ours.picture_image]
        need(all(image and image.has_data for image in images), "a viewer has no picture")
    return text


# how often, and after a solve alone
ON_RESULT = {simulate: 0.2, export: 0.15, solve_again: 0.2}
ANYWAY = {visible_range: 0.04, add_rig_around: 0.05, eye_box: 0.04, render_pictures: 0.05}
OF_FEW_FACES = visible_range, eye_box


def also(dice: Dice, outcome: Outcome, often: dict[Callable[[Dice], str], float]) -> None:
    """Further operators, on the result or in its place."""
    scene = bpy.context.scene
    for further, part in often.items():
        if not dice.chance(part):
            continue
        if further in OF_FEW_FACES:
            meshes = [o.data for o in scene.objects if o.type == "MESH"]
            if sum(len(mesh.polygons) for mesh in meshes) >= FEW_FACES:
                continue
            scene.kiriko.max_events = min(scene.kiriko.max_events, FEW_EVENTS)
        outcome.also[further.__name__] = further(dice)


def try_rig(seed: int, k: int, is_judged: bool = False) -> Outcome:
    """Make the rig [seed, k] in a new file and try it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    package = bpy.types.KIRIKO_OT_solve.__module__.removesuffix(".solve")
    # parts kept of the rig before do not belong to this one
    importlib.import_module(f"{package}.work").forget()
    started = process_time()
    outcome = Outcome(k, "failed")

    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        dice = make_rig(np.random.default_rng([seed, k]))
        outcome.drawn = dice.drawn
        scene = bpy.context.scene
        try:
            outcome.text = call(bpy.ops.kiriko.solve)
            if not outcome.text:
                source = check_result(scene)
                reading = blender_scene.read(bpy.context, scene)
                if dice.chance(0.12):
                    check_solution(scene, reading, source)
                if is_judged and is_comparable(reading, dice):
                    outcome.judged = judge(scene, reading)
                also(dice, outcome, ON_RESULT)
            also(dice, outcome, ANYWAY)
            outcome.verdict = "refused" if outcome.text else "solved"
        except WrongError as error:
            outcome.text = str(error)

    outcome.warnings = [
        f"{Path(w.filename).name}:{w.lineno} {w.message}" for w in warned if "kiriko" in w.filename
    ]
    outcome.seconds = process_time() - started
    return outcome


def work_off(options: argparse.Namespace) -> None:
    """Try rigs, and write the outcome of each to the log.

    Ends the process when one takes too long.
    """
    registered()
    n_judged = options.judge
    for k in options.only:
        with options.log.open("a") as lines:
            lines.write(json.dumps({"began": k}) + "\n")
        with ended_after(options.seconds):
            outcome = try_rig(options.seed, k, n_judged > 0)
        n_judged -= outcome.judged is not None
        with options.log.open("a") as lines:
            lines.write(json.dumps(asdict(outcome)) + "\n")


@contextlib.contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """End the process from outside of Python after so many processor seconds, which do not depend
    on the machine's load. On Windows, and for a waiting process, after `IDLE` times as many wall
    seconds.
    """
    faulthandler.dump_traceback_later(IDLE * seconds, exit=True)
    if hasattr(signal, "setitimer"):
        # once the stack is told the signal does what it does by default: it ends the process
        faulthandler.register(signal.SIGPROF, chain=True)
        signal.setitimer(signal.ITIMER_PROF, seconds)
    yield
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, 0)
    faulthandler.cancel_dump_traceback_later()


def in_processes(
    options: argparse.Namespace, rigs: list[int], variables: dict[str, str]
) -> list[Outcome]:
    """Outcomes of rigs, each in a process, with these environment variables, that may crash with
    it.
    """
    found: list[Outcome] = []
    while len(found) < len(rigs):
        some = rigs[len(found) : len(found) + AT_ONCE]
        left = options.judge - sum(outcome.judged is not None for outcome in found)
        with tempfile.TemporaryDirectory() as folder:
            log, errors = Path(folder) / "log", Path(folder) / "errors"
            log.touch()
            numbers = {"seed": options.seed, "judge": left, "seconds": options.seconds, "log": log}
            words = [str(word) for name, value in numbers.items() for word in (f"--{name}", value)]
            code: int | None = None
            with errors.open("w") as file, contextlib.suppress(subprocess.TimeoutExpired):
                code = subprocess.run(
                    [sys.executable, *as_module("fuzz.run"), *words, "--only", *map(str, some)],
                    stdout=subprocess.DEVNULL,
                    stderr=file,
                    timeout=len(some) * (IDLE * options.seconds + 10) + 60,
                    env={**os.environ, **variables},
                ).returncode
            said = errors.read_text(errors="replace")
            lines = [json.loads(line) for line in log.read_text().splitlines()]
        new = [Outcome(**line) for line in lines if "began" not in line]
        if len(new) < len(some):
            if not lines:
                raise SystemExit(f"Blender did not start:\n{said}")
            is_late = hasattr(signal, "SIGPROF") and code == -signal.SIGPROF
            how = f"Timeout, after {options.seconds:g} s" if is_late else f"ended with code {code}"
            new.append(Outcome(lines[-1]["began"], "failed", f"{how}:\n{last_of(said)}"))
        for outcome in new:
            if outcome.verdict == "failed":
                wild = ", ".join(outcome.drawn) or "-"
                print(f"\nFAILED: python3 scripts/dev.py fuzz --seed {options.seed}", end=" ")
                print(f"--only {outcome.k}\n  wild: {wild}\n  {outcome.text}\n", flush=True)
        found += new
        print(f"{len(found)} of {len(rigs)}", flush=True)

    return found


def last_of(said: str) -> str:
    """Last output of a process; of a sanitiser's report, its beginning."""
    report = SANITISER.search(said)
    return said[report.start() :][:MOST_SAID] if report else said[-MOST_SAID:]


def kind_of(text: str) -> str:
    """A sentence without its names and numbers."""
    return NUMBER.sub("#", QUOTED.sub("'..'", text)) or "done"


def print_summary(found: list[Outcome]) -> None:
    """How often rigs ended in which way."""
    words = {"solve": [kind_of(o.text) for o in found if o.verdict != "failed"]}
    for name in dict.fromkeys(name for outcome in found for name in outcome.also):
        words[name] = [kind_of(o.also[name]) for o in found if name in o.also]
    words["numpy warned of, in rigs"] = [text for o in found for text in set(o.warnings)]
    for name, texts in words.items():
        if texts:
            print(f"\n{name}:")
        for text, n in Counter(texts).most_common(20):
            print(f"{n:6d}  {text}")

    slowest = sorted(found, key=lambda outcome: -outcome.seconds)[:5]
    print("\nmost seconds:", ", ".join(f"{o.k} ({o.seconds:.1f} s)" for o in slowest))
    counts = Counter(outcome.verdict for outcome in found)
    print(f"{len(found)} rigs:", ", ".join(f"{n} {word}" for word, n in counts.most_common()))
    judged = [outcome for outcome in found if outcome.judged]
    for key in ("median", "most", "only_theirs", "both") if judged else ():
        values = [outcome.judged[key] for outcome in judged]
        worst = judged[int(np.nanargmax(values))].k
        print(
            f"Cycles, {len(judged)} rigs: {key} {np.nanmedian(values):.2g} in the median,", end=""
        )
        print(f" at most {np.nanmax(values):.2g} (rig {worst})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=2000, help="how many (2000)")
    parser.add_argument("--seed", type=int, default=0, help="of all rigs (0)")
    parser.add_argument("--only", type=int, nargs="+", metavar="K", help="these rigs of the seed")
    parser.add_argument(
        "--judge", type=int, default=0, metavar="N", help="compare the first N with Cycles"
    )
    parser.add_argument(
        "--seconds", type=float, help="of the processor, for one rig; more is a hang"
    )
    parser.add_argument("--log", type=Path, help=argparse.SUPPRESS)
    parser.add_argument(
        "--sanitised",
        action="store_true",
        help="with a kernel that stops at a wrong access or an undefined step; on Linux, with gcc",
    )
    options = parser.parse_args()
    if options.log is not None:
        work_off(options)
        return

    variables = sanitised() if options.sanitised else {}
    if variables is None:
        raise SystemExit(NOT_HERE)
    by_numpy = BY_NUMPY if loading.library() is None else 1
    options.seconds = options.seconds or SECONDS * by_numpy
    found = in_processes(options, options.only or list(range(options.rigs)), variables)
    print_summary(found)
    sys.exit(any(outcome.verdict == "failed" for outcome in found))


if __name__ == "__main__":
    main()
