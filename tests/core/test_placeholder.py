"""Placeholders of processes that are at work, that were killed, and that are elsewhere."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kiriko.core import disk, placeholder
from kiriko.core.errors import ImageError

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell it safely")
HOLD = """
import sys, time
from pathlib import Path
from kiriko.core import placeholder
print(placeholder.claim(Path(sys.argv[1])), flush=True)
time.sleep(600)
"""


def mark_of(path: Path) -> Path:
    """The mark beside the file alone in a folder."""
    (mark,) = path.parent.glob(".kiriko-held-*")
    return mark


def test_one_of_many_is_given_a_place(tmp_path: Path) -> None:
    """An empty file holds it, which goes again; one with content stays."""
    path = tmp_path / "frame.png"
    assert placeholder.claim(path)
    assert path.read_bytes() == b""
    assert not placeholder.claim(path)
    placeholder.give_up(path)
    assert not list(tmp_path.iterdir())
    assert placeholder.claim(path)
    path.write_text("whole")
    placeholder.give_up(path)
    assert [one.read_text() for one in tmp_path.iterdir()] == ["whole"]
    with pytest.raises(ImageError, match="cannot be written"):
        placeholder.claim(tmp_path / "no folder" / "frame.png")


@LINUX
@pytest.mark.parametrize("way", ["claim", "remove_left"])
def test_the_place_of_a_process_that_was_killed_is_free(tmp_path: Path, way: str) -> None:
    """At once where it was one of this machine; as long as it runs it is not."""
    path = tmp_path / "frame.png"
    environment = {**os.environ, "PYTHONPATH": str(Path(placeholder.__file__).parents[2])}
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        assert other.stdout.readline() == "True\n"
        placeholder.remove_left(tmp_path)
        assert not placeholder.claim(path)
        assert path.read_bytes() == b""
    finally:
        other.send_signal(signal.SIGKILL)
        other.wait()
    if way == "claim":
        assert placeholder.claim(path)
        assert not placeholder.claim(path)
    else:
        placeholder.remove_left(tmp_path)
        assert not list(tmp_path.iterdir())


def test_elsewhere_a_place_is_free_when_it_was_not_touched_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of another machine nobody can tell whether a process runs: its mark's age tells, which is
    that of the last step of its work.
    """
    path = tmp_path / "frame.png"
    assert placeholder.claim(path)
    mark = mark_of(path)
    mark.write_text(mark.read_text().replace(disk.PREFIX, f"{disk.PREFIX}0123456789ab"))
    now = time.time()
    os.utime(mark, (now, now - placeholder.PATIENCE + 60))
    assert not placeholder.claim(path)
    os.utime(mark, (now, now - placeholder.PATIENCE - 60))
    monkeypatch.setattr(placeholder, "BEAT", -1.0)
    placeholder.keep(path)
    assert not placeholder.claim(path)
    os.utime(mark, (now, now - placeholder.PATIENCE - 60))
    assert placeholder.claim(path)


@pytest.mark.parametrize("name", ["金魚 1.png", "x" * 251 + ".png"])
def test_any_name_may_be_held(tmp_path: Path, name: str) -> None:
    """A mark's own name is no longer than systems take, and tells the file's."""
    path = tmp_path / name
    assert placeholder.claim(path)
    assert not placeholder.claim(path)
    mark = mark_of(path)
    old = time.time() - placeholder.PATIENCE - 60
    os.utime(mark, (old, old))
    placeholder.remove_left(tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_empty_file_without_a_mark_is_nobody_s(tmp_path: Path) -> None:
    path = tmp_path / "frame.png"
    path.touch()
    assert placeholder.claim(path)
    assert not placeholder.claim(path)


def test_what_is_whole_stays_where_its_mark_was_left(tmp_path: Path) -> None:
    """As of a process that was killed right after its file."""
    path = tmp_path / "frame.png"
    assert placeholder.claim(path)
    path.write_text("whole")
    mark = mark_of(path)
    mark.write_text(mark.read_text().replace(disk.PREFIX, f"{disk.PREFIX}0123456789ab"))
    old = time.time() - placeholder.PATIENCE - 60
    os.utime(mark_of(path), (old, old))
    placeholder.remove_left(tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["frame.png"]
