"""Placeholders of processes that are at work, that were killed, and that are elsewhere."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from kiriko.core import own_files, placeholder
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
    mark.write_text(mark.read_text().replace(own_files.PREFIX, f"{own_files.PREFIX}0123456789ab"))
    now = time.time()
    os.utime(mark, (now, now - placeholder.PATIENCE + 60))
    assert not placeholder.claim(path)
    os.utime(mark, (now, now - placeholder.PATIENCE - 60))
    monkeypatch.setattr(placeholder, "BEAT", -1.0)
    placeholder.keep()
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
    mark.write_text(mark.read_text().replace(own_files.PREFIX, f"{own_files.PREFIX}0123456789ab"))
    old = time.time() - placeholder.PATIENCE - 60
    os.utime(mark_of(path), (old, old))
    placeholder.remove_left(tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["frame.png"]


def test_a_mark_of_work_goes_once_its_process_is_gone(tmp_path: Path) -> None:
    """As of one that was killed on another machine; one that goes on stays."""
    with placeholder.taking_part(tmp_path):
        (mark,) = tmp_path.iterdir()
        left = tmp_path / f"another{placeholder.AT_WORK}"
        left.write_text(
            mark.read_text().replace(own_files.PREFIX, f"{own_files.PREFIX}0123456789ab")
        )
        old = time.time() - placeholder.PATIENCE - 60
        os.utime(left, (old, old))
        placeholder.remove_left(tmp_path)
        assert list(tmp_path.iterdir()) == [mark]


def test_work_began_with_the_first_of_those_at_work(tmp_path: Path) -> None:
    """Whoever has ended since: a process that comes later than all of them begins anew."""
    with ExitStack() as second:
        with placeholder.taking_part(tmp_path) as began:
            file = tmp_path / "frame.png"
            file.touch()
            assert began <= file.stat().st_mtime
            os.utime(next(tmp_path.glob(f"*{placeholder.AT_WORK}")), (began - 9, began - 9))
            time.sleep(0.05)  # longer than the clock of any disk that tests run on stands
            assert second.enter_context(placeholder.taking_part(tmp_path)) == began
        with placeholder.taking_part(tmp_path) as third:
            assert third == began
    file.unlink()
    assert not list(tmp_path.iterdir())
    with placeholder.taking_part(tmp_path) as anew:
        assert anew > began
    with (
        pytest.raises(ImageError, match=r"The folder '.*no' cannot be written"),
        placeholder.taking_part(tmp_path / "no"),
    ):
        pass


def test_work_of_one_that_was_killed_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its mark tells by its age, which is that of the last step of a process at work, and goes."""
    with ExitStack() as first:
        began = first.enter_context(placeholder.taking_part(tmp_path))
        (mark,) = tmp_path.iterdir()
        old = began - placeholder.PATIENCE - 60
        time.sleep(0.05)
        os.utime(mark, (old, old))
        monkeypatch.setattr(placeholder, "BEAT", -1.0)
        placeholder.keep()
        with placeholder.taking_part(tmp_path) as other:
            assert other == began
        os.utime(mark, (old, old))
        with placeholder.taking_part(tmp_path) as other:
            assert other > began
            assert not mark.exists()
    assert not list(tmp_path.iterdir())
