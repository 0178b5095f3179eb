"""Join: are all results of a job's tasks there, whole and alike? One log of all their logs."""

import hashlib
import json
from collections.abc import Generator, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...base.errors import MALFORMED, ImageError
from ...base.messages import Message
from ...files import disk, image_io

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


def told(n: int, size: tuple[int, int], folder: Path) -> Message:
    """The result in a sentence."""
    return Message(
        "all {n} images in '{folder}' are whole, each of {width} x {height} pixels",
        n=n,
        folder=folder,
        width=size[0],
        height=size[1],
    )
