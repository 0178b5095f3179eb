"""Files are written whole, a set of them all or none, to the place that their name means."""

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from kiriko.core import image_io
from kiriko.core.errors import ImageError

NAMES = ("a.csv", "b.json", "c.svg")


def contents(folder: Path) -> dict[str, str | None]:
    """What is in a folder, by name; None for folders."""
    return {path.name: None if path.is_dir() else path.read_text() for path in folder.iterdir()}


def write_all(folder: Path) -> None:
    with image_io.together(folder) as new:
        for name in NAMES:
            image_io.write_text(new / name, "new")


@pytest.mark.parametrize("there", [(), NAMES, NAMES[:1], NAMES[1:]])
def test_a_set_is_all_new(tmp_path: Path, there: tuple[str, ...]) -> None:
    """Whichever of the files were there, other files stay, and nothing else is left."""
    for name in (*there, "mine"):
        (tmp_path / name).write_text("old")
    write_all(tmp_path)
    assert contents(tmp_path) == {**dict.fromkeys(NAMES, "new"), "mine": "old"}


@pytest.mark.parametrize("there", [(), NAMES, NAMES[:1], NAMES[1:]])
def test_a_set_is_all_as_before_whichever_move_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: tuple[str, ...]
) -> None:
    """The k-th file that cannot be moved, old or new: the sentence names a file of the set in its own folder."""
    for name in there:
        (tmp_path / name).write_text("old")
    own = Path.replace
    for k in range(len(there) + len(NAMES)):
        moves = iter(range(100))

        def move(path: Path, target: Path, moves: Iterator[int] = moves, k: int = k) -> Path:
            if next(moves) == k:
                raise OSError(errno.EBUSY, "Device or resource busy")
            return own(path, target)

        with monkeypatch.context() as broken, pytest.raises(ImageError, match="busy") as caught:  # noqa: PT012 - a set
            broken.setattr(Path, "replace", move)
            with image_io.together(tmp_path) as new:
                for name in NAMES:
                    (new / name).write_text("new")
        assert any(f"'{tmp_path / name}'" in str(caught.value) for name in NAMES)
        assert contents(tmp_path) == dict.fromkeys(there, "old"), k


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_in_the_way_of_a_set_stays(tmp_path: Path, name: str) -> None:
    """It is not replaced like a file, nor is any other of the set."""
    before = {other: None if other == name else "old" for other in NAMES}
    for other in NAMES:
        (tmp_path / other).mkdir() if other == name else (tmp_path / other).write_text("old")
    with pytest.raises(ImageError, match=f"'{tmp_path / name}' cannot be written") as caught:
        write_all(tmp_path)
    assert str(caught.value).endswith(".")
    assert contents(tmp_path) == before


@pytest.mark.parametrize("suffix", [".png", ".csv"])
def test_a_name_as_long_as_the_file_system_takes_can_be_written(tmp_path: Path, suffix: str) -> None:
    """New, and once more in its place."""
    longest = os.pathconf(tmp_path, "PC_NAME_MAX") if hasattr(os, "pathconf") else 200
    path = tmp_path / ("x" * (longest - len(suffix)) + suffix)
    for _ in range(2):
        if suffix == ".csv":
            image_io.write_text(path, "text")
        else:
            image_io.write(path, np.zeros((2, 2, 3)), "PNG8", overwrite=True)
        assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("is_set", [False, True])
@pytest.mark.parametrize("is_there", [False, True])
def test_a_symbolic_link_stays_and_what_it_points_to_is_new(tmp_path: Path, is_set: bool, is_there: bool) -> None:
    """A file in another folder, by a relative link; where it is not there yet, it is made."""
    near, far = tmp_path / "near", tmp_path / "far"
    near.mkdir()
    far.mkdir()
    if is_there:
        (far / "z").write_text("old")
    link = near / NAMES[1]
    try:
        link.symlink_to(Path("..") / "far" / "z")
    except OSError:
        pytest.skip("no symbolic links here")
    if is_set:
        write_all(near)
    else:
        image_io.write_text(link, "new")
    assert link.is_symlink()
    assert contents(far) == {"z": "new"}
    assert contents(near) == dict.fromkeys(NAMES if is_set else NAMES[1:2], "new")
