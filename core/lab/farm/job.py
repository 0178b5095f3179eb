"""A job as Open Job Description has it: a template of steps and tasks that any of its schedulers
runs.

Each task starts Blender with factory settings, which runs Kiriko from the zip in the bundle. All
paths of a bundle are relative to it, and arguments are a list, so that no shell has to read them.
The template is JSON, which the specification takes next to YAML and Python writes without help.

Join: the results of all tasks are there, whole and alike; one log of all their logs.
"""

import hashlib
import json
import re
from collections.abc import Generator, Iterable
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from ...base.errors import MALFORMED, ImageError, RigError
from ...base.messages import Message
from ...files import disk, image_io
from ...files.frame_list import frames_of, in_ranges

SPECIFICATION = "jobtemplate-2023-09"
CHUNKING = "TASK_CHUNKING"  # its extension
BOOTSTRAP = "kiriko_bootstrap.py"
FLAMENCO = "kiriko_frames.js"
KIRIKO = "kiriko"  # the folder in a bundle with the bootstrap and the zips
OUT = "source"  # the folder in a bundle for the results
MOST = 1024  # values of a task parameter that the specification allows
LONGEST_NAME = 128  # letters of a job's name
LONGEST_TEXT = 1024  # letters of a parameter
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")  # letters that no job's name has


@dataclass(frozen=True)
class TaskChoice:
    """A value that tasks differ in, and the folder for the results of each."""

    value: str
    folder: str


@dataclass(frozen=True)
class Job:
    """The tasks that are wanted.

    blend : name of the file in the bundle
    version : Kiriko's
    frames : list of them, as core/files/frame_list.py reads it; '' for the scene as it stands
    chunk : frames for a task
    viewers : each alone; none: all of the rig at once
    rigs : those that are solved; none: the one that the file shows
    path : of a property that takes other values, '' if none does
    values : these values
    options : further ones of the verb solve
    """

    name: str
    blend: str
    version: str
    frames: str = ""
    chunk: int = 10
    rigs: tuple[TaskChoice, ...] = ()
    path: str = ""
    values: tuple[TaskChoice, ...] = ()
    options: tuple[str, ...] = ()
    viewers: tuple[TaskChoice, ...] = ()

    def check(self) -> None:
        """Raise RigError where no scheduler would take such a job, or no task could run."""
        if not (self.frames or self.rigs or self.viewers or self.values):
            raise RigError("The job has one task only: give it frames, rigs or values.")
        length = len(in_ranges(frames_of(self.frames))) if self.frames else 0
        if length > LONGEST_TEXT:
            raise RigError(
                "The job's list of frames has {n} letters, and a parameter takes {most}: give"
                " ranges, or make several jobs.",
                n=length,
                most=LONGEST_TEXT,
            )
        if self.values and not self.path:
            raise RigError("The job has values of no property: name one by --vary.")
        if self.path and not self.values:
            raise RigError(
                "The job has no values of the property '{path}': give some by --values.",
                path=self.path,
            )
        if self.chunk < 1:
            raise RigError("A task of the job has no frames: set 1 or more for each.")
        for what in (self.rigs, self.viewers, self.values):
            if len(what) > MOST:
                raise RigError(
                    "The job has {n} values, and a task parameter takes {most}: make several jobs.",
                    n=len(what),
                    most=MOST,
                )
        given = (option.removeprefix("--name=") for option in self.options)
        texts = (self.name, self.blend, self.path, *given)
        refuse_braces(*texts, *(one.value for one in (*self.rigs, *self.viewers, *self.values)))

    @property
    def template(self) -> dict[str, Any]:
        """Its template."""
        solve = step("Solve", self.version, _solve(self), space=_space(self))
        join = step("Join", self.version, _join(self), after="Solve")
        extensions = (CHUNKING,) if self.frames else ()
        parameters = [*files(self.blend), *_frames(self)]
        return whole(self.name, parameters, [solve, join], extensions)

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders of the results within that of the job; '.' where there is no choice."""
        kinds = (self.rigs, self.viewers, self.values)
        folders = [[one.folder for one in choices] for choices in kinds if choices]
        return tuple("/".join(parts) or "." for parts in product(*folders))


def refuse_braces(*texts: str) -> None:
    """Raise RigError where a text would be read as a parameter."""
    for text in texts:
        if "{{" in text:
            raise RigError(
                "The name '{text}' has two braces, which a job reads as a parameter: rename it.",
                text=text,
            )


def whole(
    name: str,
    parameters: list[dict[str, Any]],
    steps: list[dict[str, Any]],
    extensions: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A template of parameters and steps."""
    return {
        "specificationVersion": SPECIFICATION,
        **({"extensions": list(extensions)} if extensions else {}),
        "name": _CONTROL.sub("_", name)[:LONGEST_NAME],
        "parameterDefinitions": parameters,
        "steps": steps,
    }


def step(
    name: str,
    version: str,
    verb: list[str],
    after: str | None = None,
    space: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """A step whose tasks run a verb of Kiriko's command line, in a Blender with factory settings.

    version : Kiriko's
    after : the step that it waits for
    space : the parameters that its tasks differ in; None: it is one task
    """
    start = ("--background", "{{Param.BlendFile}}", "--factory-startup", "--python-exit-code", "1")
    kiriko = ("--python", f"{{{{Param.Kiriko}}}}/{BOOTSTRAP}", "--", "--version", version)
    action = {"command": "{{Param.Blender}}", "args": [*start, *kiriko, *verb]}
    return {
        "name": name,
        **({"dependencies": [{"dependsOn": after}]} if after else {}),
        **({"parameterSpace": space} if space else {}),
        "script": {"actions": {"onRun": action}},
    }


def parameter_values(template: dict[str, Any]) -> dict[str, Any]:
    """The values of a template's parameters, relative to the bundle."""
    definitions = template["parameterDefinitions"]
    return {
        "parameterValues": [{"name": one["name"], "value": one["default"]} for one in definitions]
    }


def asset_references(files: list[str]) -> dict[str, Any]:
    """The files beside the bundle that its .blend reads, for schedulers that copy them."""
    return {
        "assetReferences": {
            "inputs": {"filenames": sorted(files), "directories": []},
            "outputs": {"directories": []},
            "referencedPaths": [],
        }
    }


def files(blend: str) -> list[dict[str, Any]]:
    """The parameters that every job has."""
    return [
        _path("BlendFile", "FILE", "IN", blend, "The scene"),
        _path("Kiriko", "DIRECTORY", "IN", KIRIKO, f"Kiriko's zips and {BOOTSTRAP}"),
        _path("OutDir", "DIRECTORY", "OUT", OUT, "The results"),
        {
            "name": "Blender",
            "type": "STRING",
            "default": "blender",
            "description": "The program, as workers find it",
        },
    ]


def _frames(job: Job) -> list[dict[str, Any]]:
    if not job.frames:
        return []
    return [
        {
            "name": "Frames",
            "type": "STRING",
            "default": in_ranges(frames_of(job.frames)),
            "description": "Such as 1-250:2",
        },
        {
            "name": "ChunkSize",
            "type": "INT",
            "default": job.chunk,
            "minValue": 1,
            "description": "Frames for a task",
        },
    ]


def _path(name: str, kind: str, flow: str, default: str, about: str) -> dict[str, Any]:
    return {
        "name": name,
        "type": "PATH",
        "objectType": kind,
        "dataFlow": flow,
        "default": default,
        "description": about,
    }


def _space(job: Job) -> dict[str, Any]:
    """The parameters that tasks differ in. A choice and its folder go together."""
    definitions: list[dict[str, Any]] = []
    factors = []
    for name, choices in (("Rig", job.rigs), ("Viewer", job.viewers), ("Value", job.values)):
        if choices:
            pairs = (
                (name, [c.value for c in choices]),
                (f"{name}Folder", [c.folder for c in choices]),
            )
            definitions += [{"name": n, "type": "STRING", "range": values} for n, values in pairs]
            factors.append(f"({name},{name}Folder)")
    if job.frames:
        # not contiguous: every second frame is a chunk of as many frames, too
        chunks = {"defaultTaskCount": "{{Param.ChunkSize}}", "rangeConstraint": "NONCONTIGUOUS"}
        definitions.append(
            {"name": "Frame", "type": "CHUNK[INT]", "range": "{{Param.Frames}}", "chunks": chunks}
        )
        factors.append("Frame")

    combined = {} if factors == ["Frame"] else {"combination": "*".join(factors)}
    return {"taskParameterDefinitions": definitions, **combined}


def _solve(job: Job) -> list[str]:
    folder = ["{{Param.OutDir}}"]
    arguments = ["solve"]
    if job.rigs:
        arguments.append("--rig={{Task.Param.Rig}}")  # with = a name may begin with a dash
        folder.append("{{Task.Param.RigFolder}}")
    if job.viewers:
        arguments.append("--only-viewer={{Task.Param.Viewer}}")
        folder.append("{{Task.Param.ViewerFolder}}")
    if job.values:
        arguments += ["--set", job.path, "{{Task.Param.Value}}"]
        folder.append("{{Task.Param.ValueFolder}}")
    if job.frames:
        arguments += ["--frames={{Task.Param.Frame}}", "--log={{Task.Param.Frame}}"]
    else:
        arguments.append("--overwrite")  # a task that was killed may be run again
    return [*arguments, *job.options, "--out", "/".join(folder)]


def _join(job: Job) -> list[str]:
    frames = ["--frames={{Param.Frames}}"] if job.frames else []
    folders = [] if job.folders == (".",) else ["--folders", *job.folders]
    return ["join", *frames, *job.options, "--out", "{{Param.OutDir}}", *folders]


SHARES = 10  # tasks
ROUNDS = 2  # of shares: a grid of the first keeps its tolerance nearly always


@dataclass(frozen=True)
class AtlasJob:
    """The atlas that is wanted.

    blend : name of the file in the bundle
    version : Kiriko's
    options : of the verb atlas, which say what atlas it is
    shares : tasks that share the places
    overwrite : may the plan replace the atlas of another rig or box?
    """

    name: str
    blend: str
    version: str
    options: tuple[str, ...]
    shares: int = SHARES
    overwrite: bool = False

    def check(self) -> None:
        """Raise RigError where no scheduler would take such a job."""
        if not 1 <= self.shares <= MOST:
            raise RigError(
                "{n} tasks cannot share the places of the head: set 1 to {most}.",
                n=self.shares,
                most=MOST,
            )
        refuse_braces(self.name, self.blend)

    @property
    def template(self) -> dict[str, Any]:
        """Its template."""
        share = {"name": "Share", "type": "INT", "range": "1-{{Param.Shares}}"}
        space = {"taskParameterDefinitions": [share]}
        steps = [self._step("Plan", "--plan", *(["--overwrite"] if self.overwrite else []))]

        def add(name: str, *how: str, space: dict[str, Any] | None = None) -> None:
            steps.append(self._step(name, *how, after=steps[-1]["name"], space=space))

        for n in range(1, ROUNDS + 1):
            if n > 1:
                add(f"Halve {n - 1}", "--halve")
            add(f"Places {n}", "--share={{Task.Param.Share}}/{{Param.Shares}}", space=space)
        add("Join")

        shares = {
            "name": "Shares",
            "type": "INT",
            "default": self.shares,
            "minValue": 1,
            "maxValue": MOST,
            "description": "Tasks that share the places of the head",
        }
        return whole(self.name, [*files(self.blend), shares], steps)

    def _step(
        self, name: str, *how: str, after: str | None = None, space: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        verb = ["atlas", *self.options, *how, "--out", "{{Param.OutDir}}"]
        return step(name, self.version, verb, after, space)


LOG = "frames.jsonl"
PARTS = "frames.*.jsonl"  # the logs of tasks
LONGEST = 100  # letters of a task's frames in its log's name: systems take 255 for the whole
TOLD = 5  # files that a sentence names


def log_of(part: str) -> str:
    """The name of a task's log, by the frames that it solves, as every system allows it: of a long
    list its beginning, and a sum by which it is another than those of other lists.
    """
    frames = part.replace(":", "_").replace(",", "+").replace(" ", "")
    if len(frames) > LONGEST:
        digest = hashlib.sha1(part.encode(), usedforsecurity=False).hexdigest()[:16]
        frames = f"{frames[: LONGEST - 17]}+{digest}"
    return f"frames.{frames}.jsonl"


def check(files: Iterable[Path]) -> Generator[float, None, tuple[int, int]]:
    """See that all images are there, whole and of one size.

    Yields progress 0..1, returns width and height, px.

    Raises
    ------
    ImageError
        One is missing, broken, or of another size than the first.
    """
    files = list(files)
    missing = [path.name for path in files if not disk.is_there(path) or not path.stat().st_size]
    if missing:
        raise ImageError(
            "{n} of {whole} images are missing in '{folder}' ({names}{more}): run their tasks"
            " again.",
            n=len(missing),
            whole=len(files),
            folder=files[0].parent,
            names=", ".join(missing[:TOLD]),
            more=" ..." if len(missing) > TOLD else "",
        )

    size = None
    for k, path in enumerate(files):
        yield k / len(files)
        pixels, _ = image_io.read(path)  # all of it: the end of a file may be missing
        height, width = pixels.shape[:2]
        size = size or (width, height)
        if (width, height) != size:
            raise ImageError(
                "The image '{path}' has {width} x {height} pixels, and the first of its job has"
                " {first} x {second}: remove it and run its task again.",
                path=path,
                width=width,
                height=height,
                first=size[0],
                second=size[1],
            )
    return size or (0, 0)


def join_logs(folder: Path) -> int:
    """Put the logs of tasks into one, with a line for each frame in its order: that of the run
    that wrote it, where a task was run again. The number of lines.

    Lines that were cut, as of a task that was killed, are left out.
    """
    by_frame: dict[int, dict[str, Any]] = {}
    for about in logged(folder):
        if not about.get("error") or about["frame"] not in by_frame:
            by_frame[about["frame"]] = about

    if by_frame:
        lines = [json.dumps(by_frame[frame]) for frame in sorted(by_frame)]
        disk.write_text(folder / LOG, "".join(f"{line}\n" for line in lines))
    for path in folder.glob(PARTS):
        path.unlink()
    return len(by_frame)


def logged(folder: Path) -> list[dict[str, Any]]:
    """The lines of all logs of frames in a folder, the newest of each log last."""
    found = []
    for path in (folder / LOG, *sorted(folder.glob(PARTS))):
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        for line in text.splitlines():
            with suppress(*MALFORMED):
                about = json.loads(line)
                found.append({**about, "frame": int(about["frame"])})
    return found


def join_report(n: int, size: tuple[int, int], folder: Path) -> Message:
    """The result in a sentence."""
    return Message(
        "all {n} images in '{folder}' are whole, each of {width} x {height} pixels",
        n=n,
        folder=folder,
        width=size[0],
        height=size[1],
    )
