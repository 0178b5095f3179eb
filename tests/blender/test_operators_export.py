import errno
import importlib
import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import inventory, pixels, short_reports, small_rig

# half of the steps a format has between 0 and 1; half floats have 11 bits
STEP = {
    "PNG8": 0.5 / 255,
    "PNG16": 0.5 / 65535,
    "TIFF16": 0.5 / 65535,
    "EXR_HALF": 2.0**-11,
    "EXR_FLOAT": 0.0,
}


@pytest.fixture
def io(kiriko) -> ModuleType:
    return loaded("core.files.image_io")


@pytest.fixture
def solved(scene) -> bpy.types.Scene:
    """A solved rig whose display is 40 mm wide and half as high, 64 x 32 pixels."""
    small_rig(display_size=0.04, display_resolution=(64, 32))
    bpy.ops.kiriko.solve()
    return scene


@pytest.mark.every_blender
@pytest.mark.parametrize("form", STEP)
def test_file_holds_the_source_at_the_displays_resolution(solved, io, tmp_path, form):
    """A file read back is the source image to half a step of
    the format, as sRGB unless the format is linear.
    """
    solved.kiriko.export_format = form
    solved.kiriko.export_path = str(tmp_path / "source")
    assert bpy.ops.kiriko.export() == {"FINISHED"}
    (path,) = tmp_path.iterdir()

    assert path.name == f"source{io.FORMATS[form].suffix}"
    numbers, about = io.read(path)
    source = pixels(solved.kiriko.result.source)[..., :3].astype(float)
    expected = source if form.startswith("EXR") else io.encode(source)

    assert numbers.shape == (32, 64, 3)
    assert np.abs(numbers - expected).max() <= STEP[form] + 1e-7
    assert "kiriko:width_mm=40; kiriko:height_mm=20" in about["ImageDescription"]

    # pixels per inch; PNG keeps whole pixels a metre, and
    # OpenImageIO reads them to a tenth of a pixel an inch
    assert about["XResolution"] == pytest.approx(64 / (40 / 25.4), abs=0.05)
    space = str(about["oiio:ColorSpace"]).lower()

    assert ("lin" in space) if form.startswith("EXR") else ("srgb" in space)


def test_existing_file_is_replaced_only_when_told(solved, tmp_path):
    """Without overwrite the file stays as it is and the sentence says so.

    With it the new one stands there.
    """
    path = tmp_path / "source.png"
    path.write_bytes(b"mine")
    solved.kiriko.export_path = str(path)
    with pytest.raises(RuntimeError, match="already exists"):
        bpy.ops.kiriko.export()
    assert path.read_bytes() == b"mine"
    bpy.ops.kiriko.export(overwrite=True)
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in tmp_path.iterdir()] == ["source.png"]


def test_folder_that_cannot_be_written_is_one_sentence(solved, tmp_path):
    """A path below a file, or in no folder, is refused with its name, and nothing is left there."""
    (tmp_path / "file").write_bytes(b"")
    for folder in (tmp_path / "file", tmp_path / "nowhere"):
        solved.kiriko.export_path = str(folder / "source.png")
        with pytest.raises(RuntimeError, match=f"The folder '{folder}' cannot be written"):
            bpy.ops.kiriko.export()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_relative_path_needs_a_saved_file(solved, tmp_path):
    """A path that begins with // is refused in a file never
    saved, and is beside the .blend in a saved one.
    """
    solved.kiriko.export_path = "//out.png"
    with pytest.raises(RuntimeError, match="never saved"):
        bpy.ops.kiriko.export()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.kiriko.export()
    assert (tmp_path / "out.png").exists()


def test_export_without_a_source_says_to_solve_first(scene):
    """The button is grey before the first solve and says why."""
    with pytest.raises(RuntimeError, match="solve first"):
        bpy.ops.kiriko.export()


def test_the_suffix_of_an_explicit_path_chooses_the_format(solved, tmp_path):
    """With PNG in the panel, source.exr is written as EXR, all else
    as the panel says, under the name Blender gives it.

    Where the suffix is that of an image of another kind it is
    replaced, and any other stays, with the right one after.
    """
    solved.kiriko.export_format = "PNG16"
    for name in ("a.exr", "b", "c.tif", "d.png", "e.JPG", "f.1", "g.png.webp"):
        assert bpy.ops.kiriko.export(filepath=str(tmp_path / name)) == {"FINISHED"}
    names = ["a.exr", "b.png", "c.tif", "d.png", "e.png", "f.1.png", "g.png.png"]
    assert sorted(p.name for p in tmp_path.iterdir()) == names
    assert (tmp_path / "a.exr").read_bytes()[:4] == b"v/1\x01"


@pytest.mark.parametrize("form", ["PNG8", "PNG16"])
def test_png_is_written_without_openimageio(solved, io, tmp_path, form, monkeypatch):
    """By Blender: every pixel is the same as by OpenImageIO, the number of channels too.

    No datablock is left over.
    """
    numbers = np.random.default_rng(2).uniform(-0.1, 1.1, (32, 64, 3)).astype(np.float32)
    # every number of 8 bit, and the halves between two, where ways of rounding differ
    numbers[:4].reshape(-1)[:511] = ((np.arange(511) / 510 + 0.055) / 1.055) ** 2.4
    core = io.__package__.removesuffix(".files")
    importlib.import_module(f"{core}.blender.data.image").set_pixels(
        solved.kiriko.result.source, numbers
    )
    solved.kiriko.export_format = form
    before = inventory()
    bpy.ops.kiriko.export(filepath=str(tmp_path / "with.png"))
    with monkeypatch.context() as missing:
        missing.setitem(sys.modules, "OpenImageIO", None)
        assert bpy.ops.kiriko.export(filepath=str(tmp_path / "without.png")) == {"FINISHED"}

    assert inventory() == before
    expected, found = ((tmp_path / name).read_bytes() for name in ("with.png", "without.png"))
    assert expected[16:26] == found[16:26]  # of the header: width, height, bits, kind of colour
    assert np.array_equal(io.read(tmp_path / "with.png")[0], io.read(tmp_path / "without.png")[0])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["with.png", "without.png"]


@pytest.mark.parametrize("form", ["TIFF16", "EXR_HALF", "EXR_FLOAT"])
def test_what_cannot_be_written_is_grey_with_the_reason(solved, tmp_path, form, monkeypatch):
    """Without OpenImageIO the button names the missing module before anything is done.

    With PNG it can be pressed.
    """
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    solved.kiriko.export_format = form
    assert not bpy.ops.kiriko.export.poll()
    with pytest.raises(RuntimeError, match=r"no OpenImageIO to write .*: choose \.png"):
        bpy.ops.kiriko.export(filepath=str(tmp_path / "a"))
    solved.kiriko.export_format = "PNG8"
    assert bpy.ops.kiriko.export.poll()
    with pytest.raises(RuntimeError, match="OpenImageIO"):
        bpy.ops.kiriko.export(filepath=str(tmp_path / "a.exr"))
    assert not list(tmp_path.iterdir())


def test_a_png_that_cannot_be_saved_is_one_sentence(solved, tmp_path, monkeypatch):
    """Without OpenImageIO, too, a file is whole or is not there."""

    def full(path: Path, data: bytes) -> None:
        with path.open("wb") as file:
            file.write(data[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RuntimeError, match=r"a\.png' cannot be written \(No space left") as caught:
        bpy.ops.kiriko.export(filepath=str(tmp_path / "a.png"))
    assert "Traceback" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_paths_beside_the_blend_bring_no_warning(solved, tmp_path, kiriko, monkeypatch):
    """The README's example, and the paths of the other
    operators, may begin with // in every version.
    """
    short_reports(kiriko, monkeypatch)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bpy.ops.kiriko.export(filepath="//source.exr")
        bpy.ops.kiriko.preview(filepath="//preview.png", samples=1, percentage=10)
        bpy.ops.kiriko.report(directory="//report", seconds=0.0)
        with pytest.raises(RuntimeError, match=r"measured\.csv"):
            bpy.ops.kiriko.calibrate(filepath="//measured.csv")
    assert (tmp_path / "source.exr").exists()
    assert (tmp_path / "preview.png").exists()
    assert (tmp_path / "report" / "report.csv").exists()


class Chosen(SimpleNamespace):
    """Stands for the operator within the file dialogue, which needs a window."""

    bl_label = "Export"
    is_in_dialogue = True
    is_to_ask = False
    overwrite = False
    allow_stale = False

    def __init__(self, cls: type, filepath: str) -> None:
        super().__init__(filepath=filepath, told=[], form="PNG8", named_form="PNG8")
        self.report = lambda level, text: self.told.append((level, text))
        self._form = lambda context: cls._form(self, context)
        self._named = lambda path: cls._named(self, path)
        self.end_with = lambda context: None  # it began with the rig that is active


def test_the_dialogue_completes_the_name_and_the_panel_follows(solved, tmp_path, kiriko):
    """So a name that is taken is red before it is chosen, and then replaced.

    A name that was not shown is not.
    """
    cls = loaded("operators.export").KIRIKO_OT_export
    for typed, named in (
        ("a", "a.png"),
        ("a.jpg", "a.png"),
        ("a.exr", "a.exr"),
        ("a.b", "a.b.png"),
    ):
        chosen = Chosen(cls, str(tmp_path / typed))
        assert cls.check(chosen, bpy.context) == (
            typed != named or named.endswith(".exr")
        )  # whose format follows
        assert chosen.filepath == str(tmp_path / named)
        assert not cls.check(chosen, bpy.context)

    chosen = Chosen(cls, str(tmp_path / "a.png"))
    for form, name in (("EXR_HALF", "a.exr"), ("TIFF16", "a.tif"), ("PNG16", "a.png")):
        chosen.form = form  # in the properties of the dialogue
        assert cls.check(chosen, bpy.context)
        assert (Path(chosen.filepath).name, chosen.form) == (name, form)
    chosen.filepath = str(tmp_path / "b.exr")  # typed
    assert cls.check(chosen, bpy.context)
    assert chosen.form == "EXR_FLOAT"

    (tmp_path / "a.png").write_bytes(b"mine")
    hidden = Chosen(cls, str(tmp_path / "a"))
    assert cls.execute(hidden, bpy.context) == {"CANCELLED"}
    assert "already exists" in hidden.told[0][1]
    assert solved.kiriko.export_path == "//source.png"

    for name, form in (("a.png", "PNG8"), ("a.exr", "EXR_FLOAT")):
        assert cls.execute(Chosen(cls, str(tmp_path / name)), bpy.context) == {"FINISHED"}
        assert (solved.kiriko.export_path, solved.kiriko.export_format) == (
            str(tmp_path / name),
            form,
        )

    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
