"""Files are written whole, a set of them all or none, to the place that their name means; of
several processes one alone claims a name.
"""

import errno
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError
from kiriko.core.files import disk, image_io, picture_file, png
from kiriko.core.files.encoding import Encoding

NAMES = ("a.csv", "b.json", "c.svg")


def contents(folder: Path) -> dict[str, str | None]:
    """The contents of a folder, by name; None for folders."""
    return {path.name: None if path.is_dir() else path.read_text() for path in folder.iterdir()}


def write_all(folder: Path, of: tuple[str, ...] = ()) -> None:
    with disk.together(folder, of) as new:
        for name in NAMES:
            disk.write_text(new / name, "new")


@pytest.mark.parametrize("there", [(), NAMES, NAMES[:1], NAMES[1:]])
def test_a_set_is_all_new(tmp_path: Path, there: tuple[str, ...]) -> None:
    """Whichever of the files were there, other files stay, and nothing else is left."""
    for name in (*there, "mine"):
        (tmp_path / name).write_text("old")
    write_all(tmp_path)
    assert contents(tmp_path) == {**dict.fromkeys(NAMES, "new"), "mine": "old"}


def test_a_file_of_a_set_that_has_no_new_one_goes_with_it(tmp_path: Path) -> None:
    """Once the set is there: where one of it cannot be written, all of before stays."""
    (tmp_path / "sub").mkdir()
    for name in ("b.json", "d.svg", "mine"):
        (tmp_path / name).write_text("old")
    before = contents(tmp_path)
    of = (*NAMES, "d.svg", "nowhere")
    with pytest.raises(ImageError), disk.together(tmp_path, of) as new:  # noqa: PT012 - a set
        (new / "b.json").write_text("new")
        (new / "sub").write_text("a folder is in the way")
    assert contents(tmp_path) == before
    with disk.together(tmp_path, of) as new:
        (new / "b.json").write_text("new")
    assert contents(tmp_path) == {"b.json": "new", "mine": "old", "sub": None}
    with pytest.raises(ImageError, match="sub"), disk.together(tmp_path, ("b.json", "sub")):
        pass  # a folder is no file of a set, which stays
    assert contents(tmp_path) == {"b.json": "new", "mine": "old", "sub": None}
    with disk.together(tmp_path, ("b.json",)):
        pass
    assert contents(tmp_path) == {"mine": "old", "sub": None}


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
@pytest.mark.parametrize(("owner", "step", "n"), [(Path, "write_text", 3), (shutil, "move", 6)])
@pytest.mark.parametrize("there", [(), NAMES, NAMES[:1], NAMES[1:]])
def test_a_set_stays_as_it_was_until_all_of_the_new_one_is_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    there: tuple[str, ...],
    owner: object,
    step: str,
    n: int,
    error: BaseException,
) -> None:
    """A disk that is full, or Esc, at the k-th file as it is written or brought near its place: no
    temporary folder is left, and the sentence names a file of the set in its own folder.
    """
    before = (*there, "gone.svg")
    for name in before:
        (tmp_path / name).write_text("old")
    own = getattr(owner, step)
    for k in range(n):
        steps = iter(range(n))

        def fail(*args: Any, steps: Iterator[int] = steps, k: int = k, **options: Any) -> Any:
            if next(steps) == k:
                raise error
            return own(*args, **options)

        with monkeypatch.context() as broken:
            broken.setattr(owner, step, fail)
            is_full = isinstance(error, OSError)
            with pytest.raises(ImageError if is_full else KeyboardInterrupt) as caught:
                write_all(tmp_path, (*NAMES, "gone.svg"))
        assert contents(tmp_path) == dict.fromkeys(before, "old")
        says = (f"'{tmp_path / name}' cannot be written (No space left)" for name in NAMES)
        assert not is_full or any(said in str(caught.value) for said in says)
    write_all(tmp_path, (*NAMES, "gone.svg"))
    assert contents(tmp_path) == dict.fromkeys(NAMES, "new")


CLAIM = """
import sys
from pathlib import Path
from kiriko.core.files import disk
print('ready', flush=True)
sys.stdin.read()
print([n for n in range(300) if disk.claim(Path(sys.argv[1]) / f"{n}.png")])
"""


def test_each_name_is_claimed_by_one_of_several_processes(tmp_path: Path) -> None:
    """Of 300 names that three processes claim at once each is given to one of them alone."""
    environment = {**os.environ, "PYTHONPATH": str(Path(disk.__file__).parents[3])}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", CLAIM, str(tmp_path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for _ in range(3)
    ]
    assert [process.stdout.readline() for process in processes] == ["ready\n"] * 3
    for process in processes:
        process.stdin.close()
    claimed = [n for process in processes for n in json.loads(process.stdout.read())]
    assert sorted(claimed) == list(range(300))
    assert {process.wait() for process in processes} == {0}


@pytest.mark.parametrize("name", ["金魚 1.png", "x" * 251 + ".png"])
def test_a_claim_is_an_empty_file_until_it_is_given_up(tmp_path: Path, name: str) -> None:
    """It goes with the claim; a file with contents stays."""
    path = tmp_path / name
    assert disk.claim(path)
    assert path.read_bytes() == b""
    assert not disk.claim(path)
    disk.give_up(path)
    assert contents(tmp_path) == {}
    disk.give_up(path)
    assert disk.claim(path)
    disk.write_text(path, "whole")
    disk.give_up(path)
    assert contents(tmp_path) == {name: "whole"}
    with pytest.raises(ImageError, match="cannot be written"):
        disk.claim(tmp_path / "no folder" / "frame.png")


@pytest.mark.parametrize("suffix", [".png", ".csv"])
def test_a_name_as_long_as_the_file_system_takes_can_be_written(
    tmp_path: Path, suffix: str
) -> None:
    """New, and once more in its place."""
    longest = os.pathconf(tmp_path, "PC_NAME_MAX") if hasattr(os, "pathconf") else 200
    path = tmp_path / ("x" * (longest - len(suffix)) + suffix)
    for _ in range(2):
        if suffix == ".csv":
            disk.write_text(path, "text")
        else:
            image_io.write(path, np.zeros((2, 2, 3)), "PNG8", overwrite=True)
        assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("is_set", [False, True])
@pytest.mark.parametrize("is_there", [False, True])
def test_a_symbolic_link_to_a_file_stays(tmp_path: Path, is_set: bool, is_there: bool) -> None:
    """A file in another folder is replaced; a link to nothing does not lead out of the folder."""
    near = tmp_path / "near"
    far = tmp_path / "far"
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
        disk.write_text(link, "new")

    assert link.is_symlink() == is_there
    assert contents(far) == ({"z": "new"} if is_there else {})
    assert contents(near) == dict.fromkeys(NAMES if is_set else NAMES[1:2], "new")


LINEAR = (0.0, 0.002, 0.0031308, 0.18, 0.5, 0.99, 1.0, 7.0, -1.0)
ENCODED = {  # by the two branches of IEC 61966-2-1, in decimals, times the type's greatest number
    "uint8": (0, 7, 10, 118, 188, 254, 255, 255, 0),
    "uint16": (0, 1693, 2651, 30235, 48192, 65246, 65535, 65535, 0),
}
REC709 = (
    0.64,
    0.33,
    0.30,
    0.60,
    0.15,
    0.06,
    0.3127,
    0.3290,
)  # ITU-R BT.709, items 1.3 and 1.4: red, green, blue, D65


def test_a_file_that_is_not_written_without_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenImageIO may give no reason; the sentence says so."""
    oiio = pytest.importorskip("OpenImageIO")
    silent = SimpleNamespace(open=lambda *_: False, geterror=str)
    with monkeypatch.context() as broken:
        broken.setattr(oiio, "ImageOutput", SimpleNamespace(create=lambda _: silent))
        with pytest.raises(ImageError, match=r"cannot be written \(no reason given\)"):
            image_io.write(tmp_path / "a", np.zeros((2, 2, 3)), "TIFF16")


@pytest.mark.parametrize("form", image_io.FORMATS)
def test_a_file_holds_the_numbers_its_format_asks_for(tmp_path: Path, form: str) -> None:
    """Integers are sRGB-encoded, clipped and rounded.

    Floats are linear light as they were. OpenImageIO reads them.
    """
    oiio = pytest.importorskip("OpenImageIO")
    pixels = np.repeat(np.array(LINEAR, np.float32)[None, :, None], 3, axis=2)
    image = oiio.ImageBuf(str(image_io.write(tmp_path / "a", pixels, form)))
    number = str(image.spec().format)

    assert number == {"PNG8": "uint8", "EXR_HALF": "half", "EXR_FLOAT": "float"}.get(form, "uint16")
    if number in ENCODED:
        found = np.asarray(image.get_pixels(getattr(oiio, number.upper())))
        assert found.reshape(-1, 3).tolist() == [[k] * 3 for k in ENCODED[number]]
    else:
        found = np.asarray(image.get_pixels(oiio.FLOAT)).reshape(-1, 3)
        assert np.array_equal(
            found, pixels[0].astype(np.float16 if number == "half" else np.float32)
        )
        told = image.spec().getattribute("chromaticities")
        assert told == pytest.approx(REC709, rel=1e-6)


def test_a_file_tells_how_large_its_image_is(tmp_path: Path) -> None:
    """80 pixels over 50.8 mm are 40 to the inch; 20 over 25.4 mm are 20 to the inch."""
    pytest.importorskip("OpenImageIO")
    _, about = image_io.read(
        image_io.write(tmp_path / "a", np.zeros((20, 80, 3)), "TIFF16", size=(0.0508, 0.0254))
    )
    assert (about["XResolution"], about["YResolution"]) == (pytest.approx(40), pytest.approx(20))
    assert (
        about["ImageDescription"]
        == "Kiriko source image; sRGB; kiriko:width_mm=50.8; kiriko:height_mm=25.4"
    )


@pytest.mark.parametrize(
    ("given", "form", "name"),
    [
        ("a", "PNG8", "a.png"),
        ("a.png", "PNG16", "a.png"),
        ("a.PNG", "PNG8", "a.PNG"),
        ("a.exr", "PNG8", "a.png"),
        ("a.b", "EXR_HALF", "a.b.exr"),
        ("a.tiff", "TIFF16", "a.tiff"),
        ("a.tif", "EXR_FLOAT", "a.exr"),
        ("a.jpg", "PNG8", "a.png"),
        ("a.doc", "PNG8", "a.doc.png"),
    ],
)
def test_a_name_gets_the_suffix_of_its_format(given: str, form: str, name: str) -> None:
    """In place of that of another image, else behind the text there."""
    assert (
        image_io.named_for(Path("some.where") / given, form, {".jpg"}) == Path("some.where") / name
    )


@pytest.mark.parametrize(
    ("given", "form", "meant"),
    [
        ("a.exr", "PNG8", "EXR_FLOAT"),
        ("a.exr", "EXR_HALF", "EXR_HALF"),
        ("a.png", "PNG16", "PNG16"),
        ("a.png", "EXR_HALF", "PNG8"),
        ("a.TIFF", "PNG8", "TIFF16"),
        ("a.jpg", "PNG16", "PNG16"),
        ("a", "EXR_HALF", "EXR_HALF"),
    ],
)
def test_a_suffix_asks_for_a_format(given: str, form: str, meant: str) -> None:
    """The one that is chosen where it fits, else the plainest."""
    assert image_io.format_for(given, form) == meant


def test_a_png_that_is_cut_or_changed_anywhere_is_not_whole(tmp_path: Path) -> None:
    """At each of its bytes; zeros in place of its end, as a disk may leave them, too."""
    pixels = np.random.default_rng(4).random((9, 7, 3)).astype(np.float32)
    path = image_io.write(tmp_path / "a", pixels, "PNG16", size=(0.1, 0.2))
    data = path.read_bytes()
    assert png.is_whole(path)
    for k in range(len(data)):
        changed = data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :]
        for broken in (data[:k], data[:k] + bytes(len(data) - k), changed):
            path.write_bytes(broken)
            assert png.is_whole(path) == (broken == data), k

    # whole chunks that are lost or added have right sums, too
    head, image, end = (data.index(name) - 4 for name in (b"IHDR", b"IDAT", b"IEND"))
    for other in (data[:image] + data[end:], data[:head] + data[end:], data + data[end:]):
        path.write_bytes(other)
        assert not png.is_whole(path)


@pytest.mark.parametrize("form", image_io.FORMATS)
def test_the_same_image_is_the_same_file(tmp_path: Path, form: str) -> None:
    """No date is written, which OpenImageIO puts into OpenEXR and TIFF where it is given none."""
    pixels = np.random.default_rng(2).random((20, 30, 3)).astype(np.float32)
    one = image_io.write(tmp_path / "a", pixels, form, size=(0.3, 0.2))
    time.sleep(1.1)  # dates are in whole seconds
    other = image_io.write(tmp_path / "b", pixels, form, size=(0.3, 0.2))
    assert one.read_bytes() == other.read_bytes()
    about = image_io.read(one)[1]
    assert not any(value for name, value in about.items() if "date" in name.lower())


def test_lines_are_added_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the disk takes a part of one."""
    path = tmp_path / "log"
    disk.append_line(path, "one")
    disk.append_line(path, "two ü")
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:2]))
    with pytest.raises(ImageError, match=r"log' cannot be written \(No space left"):
        disk.append_line(path, "three")
    assert path.read_text(encoding="utf-8") == "one\ntwo ü\n"


@pytest.mark.parametrize("is_plain", [False, True])
def test_an_encoded_png_says_its_colours(tmp_path: Path, is_plain: bool, monkeypatch) -> None:
    """The cICP chunk has H.273's codes, the file stays whole, and what reads pictures finds the
    light again; sRGB files have no such chunk.
    """
    if is_plain:
        monkeypatch.setattr(image_io, "has_openimageio", lambda: False)
    light = np.random.default_rng(3).random((4, 5, 3))
    path = image_io.write(tmp_path / "p3.png", light, "PNG16", gamma=Encoding("P3", 250.0))
    assert png.is_whole(path)
    data = path.read_bytes()
    at = data.index(b"cICP")
    assert data[at + 4 : at + 8] == bytes([12, 13, 0, 1])
    assert at < data.index(b"IDAT")
    numbers, _ = image_io.read(path)
    found = picture_file.light_said({picture_file.CICP: data[at + 4 : at + 8]}, numbers)
    np.testing.assert_allclose(found, light, atol=1e-4)
    for name, codes in (("PQ", (9, 16)), ("HLG", (9, 18))):
        path = image_io.write(tmp_path / f"{name}.png", light, "PNG16", gamma=Encoding(name, 1e3))
        assert b"cICP" + bytes([*codes, 0, 1]) in path.read_bytes()
    path = image_io.write(tmp_path / "srgb.png", light, "PNG16")
    assert b"cICP" not in path.read_bytes()
