"""Jobs of Flamenco: the script of the job type, run in node as the manager runs it."""

import json
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent.parent
SCRIPT = ROOT / "farm" / "kiriko_frames.js"


def compiled(node: Path | str, **settings: object) -> dict[str, Any]:
    """The job type, the tasks of a job with these settings, and the error or None."""
    harness = Path(__file__).with_suffix(".js")
    done = subprocess.run(
        [node, harness, SCRIPT],
        input=json.dumps({"settings": settings}),
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    return json.loads(done.stdout)


def words_of(task: dict[str, Any], blender: str) -> list[str]:
    """The command line that a worker makes of a task."""
    (command,) = task["commands"]
    assert command["name"] == "blender-render"
    given = command["parameters"]
    assert (given["exe"], given["exeArgs"]) == ("{blender}", "{blenderArgs}")
    start = [blender, "-b", "-y", *given["argsBefore"]]
    return [*start, given["blendfile"], *given["args"]]
