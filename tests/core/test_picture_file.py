"""What an image file says about itself."""

import struct
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from kiriko.core.files import image_io, picture_file, png
from known.profiles import COLUMNS, fixed, profile, with_code_points

AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # chromaticities of ACEScg
NOISE = np.random.default_rng(5).random((48, 64, 3)).astype(np.float32)


def write(path: Path, kind: str = "uint8", pixels: np.ndarray = NOISE, **about: object) -> Path:
    spec = oiio.ImageSpec(*pixels.shape[1::-1], pixels.shape[2], kind)
    for name, value in about.items():
        if isinstance(value, bytes):
            numbers = np.frombuffer(value, np.uint8)
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), numbers)
        elif isinstance(value, tuple):
            spec.attribute(name, f"float[{len(value)}]", value)
        else:
            spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), oiio.geterror()
    assert out.write_image(pixels)
    assert out.close()
    return path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.jpg", "uint8"),
        ("a.tif", "uint8"),
        ("a.tif", "uint16"),
        ("a.tif", "float"),
        ("a.webp", "uint8"),
    ],
)
def test_a_file_that_is_cut_anywhere_is_told_from_a_whole_one(
    tmp_path: Path, name: str, kind: str
) -> None:
    """Kinds of which Blender shows a part, with the rest grey or black."""
    path = write(tmp_path / name, kind)
    assert not picture_file.is_cut(path)
    data = path.read_bytes()
    for part in np.random.default_rng(1).integers(16, len(data) - 2, 20):
        path.write_bytes(data[:part])
        assert picture_file.is_cut(path), part


def test_marks_in_a_jpegs_thumbnail_are_not_its_end(tmp_path: Path) -> None:
    """A photograph has a smaller JPEG, whole, in its metadata."""
    data = write(tmp_path / "a.jpg").read_bytes()
    small = write(tmp_path / "b.jpg", pixels=NOISE[:8, :8]).read_bytes()
    extra = b"\xff\xe1" + struct.pack(">H", len(small) + 2) + small
    path = tmp_path / "c.jpg"
    path.write_bytes(data[:2] + extra + data[2:])
    assert not picture_file.is_cut(path)
    path.write_bytes(data[:2] + extra + data[2 : len(data) // 2])
    assert picture_file.is_cut(path)


def test_an_exr_without_all_of_its_header_is_told(tmp_path: Path) -> None:
    """Each cut before the first line of pixels, and none after."""
    path = write(tmp_path / "a.exr", "half", ImageDescription="words")
    data = path.read_bytes()
    end = data.index(b"screenWindowWidth\0float\0") + 24 + 4 + 4 + 1
    for part, is_there in ((end - 1, False), (20, False), (9, False), (end, True)):
        path.write_bytes(data[:part])
        assert picture_file.has_header(path) == is_there, part


# where the first row and the first column are seen: Exif 2.32, 4.6.4
SIDES = {
    1: ("top", "left"),
    2: ("top", "right"),
    3: ("bottom", "right"),
    4: ("bottom", "left"),
    5: ("left", "top"),
    6: ("right", "top"),
    7: ("right", "bottom"),
    8: ("left", "bottom"),
}


def side(image: np.ndarray, name: str, start: str) -> np.ndarray:
    """The pixels along a side, from its end on another one."""
    line = {"top": image[0], "bottom": image[-1], "left": image[:, 0], "right": image[:, -1]}[name]
    return line[::-1] if start in {"bottom", "right"} else line


@pytest.mark.parametrize("orientation", SIDES)
def test_photographs_are_turned_as_exif_has_it(tmp_path: Path, orientation: int) -> None:
    path = write(tmp_path / "a.png", Orientation=orientation)
    assert picture_file.said_by(path).get("Orientation", 1) == orientation
    stored, seen = image_io.read(path)[0], picture_file.read_photograph(path)
    row, column = SIDES[orientation]
    assert np.array_equal(side(seen, row, column), stored[0])
    assert np.array_equal(side(seen, column, row), stored[:, 0])


@pytest.mark.parametrize("orientation", [0, *SIDES, 9])
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif", "a.webp"])
def test_the_orientation_is_read_without_openimageio(
    tmp_path: Path, name: str, orientation: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As OpenImageIO reads it, and none in a file that is cut anywhere before it."""
    path = write(tmp_path / name, Orientation=orientation)
    said = picture_file.said_by(path).get("Orientation", 1)
    data = path.read_bytes()
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    assert picture_file.said_by(path).get("Orientation", 1) == said
    for part in range(0, len(data), 61):
        path.write_bytes(data[:part])
        assert picture_file.said_by(path).get("Orientation", 1) in {1, said}


@pytest.mark.parametrize("orientation", SIDES)
@pytest.mark.parametrize(
    ("name", "kind", "n"),
    [
        ("a.jpg", "uint8", 3),
        ("a.png", "uint8", 4),
        ("a.png", "uint16", 4),
        ("a.tif", "uint16", 4),
        ("a.tif", "float", 3),
        ("a.exr", "half", 3),
    ],
)
def test_an_upright_file_has_the_same_numbers_and_profile(
    tmp_path: Path, orientation: int, name: str, kind: str, n: int
) -> None:
    """Each number as it stands, also of colours that are clear, and nothing to be turned."""
    numbers = np.random.default_rng(6).random((5, 7, n)).astype(np.float32)
    made = profile(COLUMNS["P3"], CURVES["gamma"][0])
    about = {"chromaticities": AP1} if name == "a.exr" else {"ICCProfile": made}
    about |= {"Orientation": orientation, "oiio:UnassociatedAlpha": 1}
    path = write(tmp_path / name, kind, numbers, **about)
    data, suffix = picture_file.upright(path)
    new = tmp_path / f"new{suffix}"
    new.write_bytes(data)

    stored, seen = raw(path), raw(new)
    assert seen.dtype == stored.dtype
    assert np.array_equal(seen, picture_file.turned(stored, orientation))
    said = picture_file.said_by(new)
    assert said.get("Orientation", 1) == 1
    light = picture_file.light_said(said, np.eye(3))
    assert np.array_equal(light, picture_file.light_said(picture_file.said_by(path), np.eye(3)))
    assert light is not None


def raw(path: Path) -> np.ndarray:
    """Numbers as they stand, not multiplied by alpha."""
    plain = oiio.ImageSpec()
    plain.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), plain)
    return source.read_image(source.spec().format)


# to linear Rec.709, as CSS Color Module Level 4 has them
REC709_FROM = {
    "sRGB": np.eye(3),
    "P3": [[1.22494, -0.22494, 0], [-0.04206, 1.04206, 0], [-0.01964, -0.07864, 1.09827]],
    "Adobe": [[1.39836, -0.39836, 0], [0, 1, 0], [0, -0.04293, 1.04293]],
}

X = np.linspace(0, 1, 1024)
SRGB = np.where(X <= 0.04045, X / 12.92, ((X + 0.055) / 1.055) ** 2.4)
CURVES = {
    "gamma": (b"curv\0\0\0\0" + struct.pack(">IH", 1, 563) + b"\0\0", X ** (563 / 256)),
    "linear": (b"curv\0\0\0\0" + struct.pack(">I", 0), X),
    "table": (
        b"curv\0\0\0\0" + struct.pack(">I1024H", 1024, *np.rint(65535 * SRGB).astype(int)),
        SRGB,
    ),
    "sRGB": (
        b"para\0\0\0\0\0\3\0\0" + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045),
        SRGB,
    ),
    "power": (b"para\0\0\0\0\0\0\0\0" + fixed(1.8), X**1.8),
    "shifted": (
        b"para\0\0\0\0\0\2\0\0" + fixed(2.0, 1.2, -0.2, 0.05),
        np.maximum(1.2 * X - 0.2, 0) ** 2 + 0.05,
    ),
}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("columns", COLUMNS)
def test_light_by_a_profile_is_that_of_closed_forms(
    tmp_path: Path, columns: str, curve: str
) -> None:
    """As it is in a PNG, which the profile goes through."""
    tag, wanted = CURVES[curve]
    path = write(tmp_path / "a.png", ICCProfile=profile(COLUMNS[columns], tag))
    numbers = np.column_stack([X, X[::-1], np.roll(X, 300)])
    light = np.column_stack([wanted, wanted[::-1], np.roll(wanted, 300)])
    found = picture_file.light_said(picture_file.said_by(path), numbers)
    # five digits of the columns
    assert np.abs(found - light @ np.transpose(REC709_FROM[columns])).max() < 1e-3


def test_light_by_chromaticities_is_that_of_a_closed_form(tmp_path: Path) -> None:
    """ACEScg to Rec.709 by Bradford's adaptation, as published with ACES."""
    path = write(tmp_path / "a.exr", "float", chromaticities=AP1)
    found = picture_file.light_said(picture_file.said_by(path), np.eye(3))
    wanted = [
        [1.70505, -0.62179, -0.08326],
        [-0.13026, 1.1408, -0.01055],
        [-0.024, -0.12897, 1.15297],
    ]
    assert np.abs(found - np.transpose(wanted)).max() < 1e-4


def test_light_by_a_pngs_code_points_is_that_of_a_closed_form(tmp_path: Path) -> None:
    """Display P3, as Blender 5.2 marks what it renders for such a display."""
    path = tmp_path / "a.png"
    path.write_bytes(with_code_points(png.encoded(np.zeros((4, 4, 3), np.uint8)), 12))
    found = picture_file.light_said(picture_file.said_by(path), np.tile(X[:, None], 3))
    assert np.abs(found - SRGB[:, None]).max() < 1e-3
    found = picture_file.light_said(picture_file.said_by(path), np.eye(3))
    assert np.abs(found - np.transpose(REC709_FROM["P3"])).max() < 1e-3


@pytest.mark.parametrize("part", [0, 100, 140, 300])
def test_a_profile_that_cannot_be_read_has_no_light(part: int) -> None:
    """One that is cut off, or whose colours are no matrix."""
    whole = profile(COLUMNS["sRGB"], CURVES["gamma"][0])
    said = {"ICCProfile": np.frombuffer(whole[:part], np.uint8)}
    assert picture_file.light_said(said, np.eye(3)) is None
    assert picture_file.light_said({}, np.eye(3)) is None


def test_what_follows_the_end_of_a_jpeg_does_not_count(tmp_path: Path) -> None:
    """A motion photograph is a JPEG with a film behind it; a cut JPEG with bytes behind is cut."""
    path = tmp_path / "photo.jpg"
    spec = image_io.openimageio().ImageSpec(64, 48, 3, "uint8")
    random = np.random.default_rng(3)
    image_io.put(path, spec, random.integers(0, 255, (48, 64, 3), np.uint8))
    whole = path.read_bytes()
    for k in range(40):
        path.write_bytes(whole + random.bytes(5000) + b"\xff\xda" * (k % 2))
        assert not picture_file.is_cut(path)
    for k in range(40):
        path.write_bytes(whole[: len(whole) * (k + 20) // 60 - 2])
        assert picture_file.is_cut(path)


def test_a_gif_ends_with_a_semicolon(tmp_path: Path) -> None:
    """GIF89a, 27: the trailer 3B."""
    path = tmp_path / "still.gif"
    whole = b"GIF89a\x01\0\x01\0\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\x01\0\x01\0\0\x02\x02D\x01\0;"
    for data, is_cut in ((whole, False), (whole + b"\0", False), (whole[:-6], True)):
        path.write_bytes(data)
        assert picture_file.is_cut(path) == is_cut
