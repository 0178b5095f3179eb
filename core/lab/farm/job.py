"""Farm jobs in the Open Job Description format, and the join of their results.

Each task starts Blender with factory settings and runs Kiriko from the zip in the bundle. All
paths in a bundle are relative, and arguments are a list, so no shell parses them. The template is
JSON: the specification accepts it as well as YAML, and Python writes it without a library.

The join checks that all results exist, complete and of one size, and merges the logs.
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

from ...base.errors import MALFORMED, ImageError, RigError, out_of_range
from ...base.messages import Message
from ...files import disk, image_io
from ...files.frame_list import frames_of, in_ranges

SPECIFICATION = "jobtemplate-2023-09"
CHUNKING = "TASK_CHUNKING"  # an extension of the specification
BOOTSTRAP = "kiriko_bootstrap.py"
FLAMENCO = "kiriko_frames.js"
KIRIKO = "kiriko"  # the bundle's folder for the bootstrap and the zips
OUT = "source"  # the bundle's folder for the results
MOST = 1024  # values of a task parameter, by the specification
LONGEST_NAME = 128  # characters, by the specification
LONGEST_TEXT = 1024  # characters of a parameter, by the specification
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")  # not allowed in a job's name


@dataclass(frozen=True)
class TaskChoice:
    """A value of a task parameter, and the folder of its results."""

    value: str
    folder: str


@dataclass(frozen=True)
class Job:
    """Description of a solve job.

    blend : file name in the bundle
    version : Kiriko's
    frames : list of frames, as in core/files/frame_list.py; '' for the current frame
    chunk : frames per task
    rigs : rigs to solve; empty for the active rig
    path : property that varies, '' for none
    values : its values
    options : further options of the verb solve
    viewers : viewers solved separately; empty for all together
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
        """Raise RigError if no scheduler would accept the job, or no task could run."""
        if not (self.frames or self.rigs or self.viewers or self.values):
            raise RigError("The job has only one task. Give it frames, rigs or values.")
        length = len(in_ranges(frames_of(self.frames))) if self.frames else 0
        if length > LONGEST_TEXT:
            raise RigError(
                "The job's list of frames has {n} characters, more than {most}. Use ranges, or"
                " make several jobs.",
                n=length,
                most=LONGEST_TEXT,
            )
        if bool(self.values) != bool(self.path):
            raise RigError(
                "The job needs both a property and its values. Give --vary and --values together."
            )
        if self.chunk < 1:
            raise RigError("A task of the job has no frames. Set 1 or more per task.")
        for choices in (self.rigs, self.viewers, self.values):
            if len(choices) > MOST:
                raise RigError(
                    "The job has {n} values, more than {most}. Make several jobs.",
                    n=len(choices),
                    most=MOST,
                )
        given = (option.removeprefix("--name=") for option in self.options)
        texts = (self.name, self.blend, self.path, *given)
        refuse_braces(*texts, *(one.value for one in (*self.rigs, *self.viewers, *self.values)))

    @property
    def template(self) -> dict[str, Any]:
        """The job template."""
        solve = step("Solve", self.version, _solve(self), space=_space(self))
        join = step("Join", self.version, _join(self), after="Solve")
        extensions = (CHUNKING,) if self.frames else ()
        parameters = [*files(self.blend), *_frames(self)]
        return whole(self.name, parameters, [solve, join], extensions)

    @property
    def folders(self) -> tuple[str, ...]:
        """Result folders within the job's folder; '.' without choices."""
        kinds = (self.rigs, self.viewers, self.values)
        folders = [[one.folder for one in choices] for choices in kinds if choices]
        return tuple("/".join(parts) or "." for parts in product(*folders))


def refuse_braces(*texts: str) -> None:
    """Raise RigError if a text would be read as a parameter."""
    for text in texts:
        if "{{" in text:
            raise RigError(
                "The name '{text}' contains double braces, which mark a parameter in a job. Rename"
                " it.",
                text=text,
            )


def whole(
    name: str,
    parameters: list[dict[str, Any]],
    steps: list[dict[str, Any]],
    extensions: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A job template."""
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
    """A step whose tasks run a verb of Kiriko's command line in Blender with factory settings.

    version : Kiriko's
    after : name of the preceding step
    space : task parameters; None for a single task
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
    """Default values of a template's parameters, relative to the bundle."""
    definitions = template["parameterDefinitions"]
    return {
        "parameterValues": [{"name": one["name"], "value": one["default"]} for one in definitions]
    }


def asset_references(files: list[str]) -> dict[str, Any]:
    """The .blend's external files, for schedulers that copy them."""
    return {
        "assetReferences": {
            "inputs": {"filenames": sorted(files), "directories": []},
            "outputs": {"directories": []},
            "referencedPaths": [],
        }
    }


def files(blend: str) -> list[dict[str, Any]]:
    """Parameters common to all jobs."""
    return [
        _path("BlendFile", "FILE", "IN", blend, "The scene"),
        _path("Kiriko", "DIRECTORY", "IN", KIRIKO, f"Kiriko's zips and {BOOTSTRAP}"),
        _path("OutDir", "DIRECTORY", "OUT", OUT, "The results"),
        {
            "name": "Blender",
            "type": "STRING",
            "default": "blender",
            "description": "Path of Blender on the workers",
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
    """The parameter space of the tasks. Each choice is paired with its folder."""
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
        # CONTIGUOUS would split every second frame into tasks of one frame
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
        arguments.append("--rig={{Task.Param.Rig}}")  # the = allows a name that begins with a dash
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
        arguments.append("--overwrite")  # a killed task may run again
    return [*arguments, *job.options, "--out", "/".join(folder)]


def _join(job: Job) -> list[str]:
    frames = ["--frames={{Param.Frames}}"] if job.frames else []
    folders = [] if job.folders == (".",) else ["--folders", *job.folders]
    return ["join", *frames, *job.options, "--out", "{{Param.OutDir}}", *folders]


SHARES = 10  # tasks
ROUNDS = 2  # of making positions: the first grid nearly always meets its tolerance


@dataclass(frozen=True)
class AtlasJob:
    """Description of an atlas job.

    blend : file name in the bundle
    version : Kiriko's
    options : of the verb atlas, which define the atlas
    shares : number of tasks for the positions
    overwrite : whether the plan may replace the atlas of another rig or box
    """

    name: str
    blend: str
    version: str
    options: tuple[str, ...]
    shares: int = SHARES
    overwrite: bool = False

    def check(self) -> None:
        """Raise RigError if no scheduler would accept the job."""
        if not 1 <= self.shares <= MOST:
            raise out_of_range(Message("The atlas"), "Tasks", self.shares, 1, MOST)
        refuse_braces(self.name, self.blend)

    @property
    def template(self) -> dict[str, Any]:
        """The job template."""
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
            "description": "Number of tasks for the head positions",
        }
        return whole(self.name, [*files(self.blend), shares], steps)

    def _step(
        self, name: str, *how: str, after: str | None = None, space: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        verb = ["atlas", *self.options, *how, "--out", "{{Param.OutDir}}"]
        return step(name, self.version, verb, after, space)


LOG = "frames.jsonl"
PARTS = "frames.*.jsonl"  # the tasks' logs
LONGEST = 100  # characters of the frames in a log's name; file systems allow 255 in total
NAMED = 5  # file names in a message


def log_of(part: str) -> str:
    """File name of a task's log, from its frames, valid on every system. A long list is cut, and a
    hash keeps it unique.
    """
    frames = part.replace(":", "_").replace(",", "+").replace(" ", "")
    if len(frames) > LONGEST:
        digest = hashlib.sha1(part.encode(), usedforsecurity=False).hexdigest()[:16]
        frames = f"{frames[: LONGEST - 17]}+{digest}"
    return f"frames.{frames}.jsonl"


def check(files: Iterable[Path]) -> Generator[float, None, tuple[int, int]]:
    """Check that all images exist, are complete and have one size.

    Yields progress 0..1, returns width and height, px.

    Raises
    ------
    ImageError : an image is missing, broken, or differs in size from the first
    """
    files = list(files)
    missing = [path.name for path in files if not disk.is_there(path) or not path.stat().st_size]
    if missing:
        raise ImageError(
            "{n} of {whole} images are missing in '{folder}' ({names}{more}). Run their tasks"
            " again.",
            n=len(missing),
            whole=len(files),
            folder=files[0].parent,
            names=", ".join(missing[:NAMED]),
            more=" ..." if len(missing) > NAMED else "",
        )

    size = None
    for k, path in enumerate(files):
        yield k / len(files)
        pixels, _ = image_io.read(path)  # read completely, because the file's end may be missing
        height, width = pixels.shape[:2]
        size = size or (width, height)
        if (width, height) != size:
            raise ImageError(
                "The image '{path}' has {width} x {height} pixels, but the first of its job has"
                " {first} x {second}. Remove it and run its task again.",
                path=path,
                width=width,
                height=height,
                first=size[0],
                second=size[1],
            )
    return size or (0, 0)


def join_logs(folder: Path) -> int:
    """Merge the tasks' logs into one, a line per frame in order. Returns the number of lines.

    If a task ran more than once, the successful run counts. Truncated lines of killed tasks are
    omitted.
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
    """All log lines in a folder, newest last within each log."""
    found = []
    for path in (folder / LOG, *sorted(folder.glob(PARTS))):
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        for line in text.splitlines():
            with suppress(*MALFORMED):
                about = json.loads(line)
                found.append({**about, "frame": int(about["frame"])})
    return found


def join_report(n: int, size: tuple[int, int], folder: Path) -> Message:
    """The result of the join as a message."""
    return Message(
        "all {n} images in '{folder}' are complete, with {width} x {height} pixels each",
        n=n,
        folder=folder,
        width=size[0],
        height=size[1],
    )
