"""Sets of files whose writing is interrupted by a kill."""

import importlib
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from environments import link_package

KILLED = """
import os, sys
from pathlib import Path
from kiriko.core import disk
whole = disk._Move.do
def first_only(move, *, is_alone):
    whole(move, is_alone=is_alone)
    os._exit(9)
disk._Move.do = first_only
with disk.together(Path(sys.argv[1])) as new:
    for name in "ab":
        (new / name).write_text("new")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell a process is gone")
def test_a_set_that_was_killed_on_its_way_is_written_again(
    kiriko: ModuleType, tmp_path: Path
) -> None:
    """Files of a part of a set do not make the next run ask for --overwrite; a user's file does."""
    core = importlib.import_module(f"{kiriko.__name__}.core.disk")
    folder = importlib.import_module(f"{kiriko.__name__}.operators.folder")
    (tmp_path / "mine").write_text("mine")
    variables = {**os.environ, "PYTHONPATH": str(link_package())}
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    assert subprocess.run(command, env=variables).returncode == 9
    assert (tmp_path / "a").exists()
    assert not (tmp_path / "b").exists()

    with folder.made(tmp_path):
        folder.refuse_existing(tmp_path, "ab", "add --overwrite")
        with core.together(tmp_path) as new:
            for name in "ab":
                (new / name).write_text("again")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        **{"a": "again", "b": "again"},
        "mine": "mine",
    }
    with folder.made(tmp_path), pytest.raises(core.ImageError, match="has a already"):
        folder.refuse_existing(tmp_path, "a", "add --overwrite")
