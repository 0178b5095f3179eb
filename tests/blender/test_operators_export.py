import importlib
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from small_rigs import pixels, small_rig

# half of the steps a format has between 0 and 1; half floats have 11 bits
STEP = {"PNG8": 0.5 / 255, "PNG16": 0.5 / 65535, "TIFF16": 0.5 / 65535, "EXR_HALF": 2.0**-11, "EXR_FLOAT": 0.0}


@pytest.fixture
def io(kiriko: ModuleType) -> ModuleType:
    return importlib.import_module(f"{kiriko.__name__}.core.image_io")


@pytest.fixture
def solved(scene: bpy.types.Scene) -> bpy.types.Scene:
    """A solved rig whose display is 40 mm wide and half as high, 64 x 32 pixels."""
    small_rig(display_size=0.04, display_resolution=(64, 32))
    bpy.ops.kiriko.solve()
    return scene


@pytest.mark.parametrize("form", STEP)
def test_file_holds_the_source_at_the_displays_resolution(
    solved: bpy.types.Scene, io: ModuleType, tmp_path: Path, form: str
) -> None:
    """What is read back is the source image to half a step of the format, as sRGB unless the format is linear."""
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
    # pixels per inch; PNG keeps whole pixels a metre, and OpenImageIO reads them to a tenth of a pixel an inch
    assert about["XResolution"] == pytest.approx(64 / (40 / 25.4), abs=0.05)
    space = str(about["oiio:ColorSpace"]).lower()
    assert ("lin" in space) if form.startswith("EXR") else ("srgb" in space)


def test_existing_file_is_replaced_only_when_told(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """Without overwrite the file stays as it is and the sentence says so; with it the new one stands there."""
    path = tmp_path / "source.png"
    path.write_bytes(b"mine")
    solved.kiriko.export_path = str(path)
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.kiriko.export()
    assert path.read_bytes() == b"mine"
    bpy.ops.kiriko.export(overwrite=True)
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in tmp_path.iterdir()] == ["source.png"]


def test_folder_that_cannot_be_written_is_one_sentence(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """A path below a file, or in no folder, is refused with its name, and nothing is left there."""
    (tmp_path / "file").write_bytes(b"")
    for folder in (tmp_path / "file", tmp_path / "nowhere"):
        solved.kiriko.export_path = str(folder / "source.png")
        with pytest.raises(RuntimeError, match=f"The folder '{folder}' cannot be written"):
            bpy.ops.kiriko.export()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_relative_path_needs_a_saved_file(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """A path that begins with // is refused in a file never saved, and is beside the .blend in a saved one."""
    solved.kiriko.export_path = "//out.png"
    with pytest.raises(RuntimeError, match="never saved"):
        bpy.ops.kiriko.export()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.kiriko.export()
    assert (tmp_path / "out.png").exists()


def test_export_without_a_source_says_to_solve_first(scene: bpy.types.Scene) -> None:
    """The button is grey before the first solve and says why."""
    with pytest.raises(RuntimeError, match="solve first"):
        bpy.ops.kiriko.export()


def test_broken_image_file_is_one_sentence(io: ModuleType, tmp_path: Path, kiriko: ModuleType) -> None:
    """Reading a file that is missing, or is no image, names it."""
    errors = importlib.import_module(f"{kiriko.__name__}.core.errors")
    (tmp_path / "broken.png").write_bytes(b"no image")
    for name in ("broken.png", "missing.png"):
        with pytest.raises(errors.ImageError, match=name):
            io.read(tmp_path / name)


def test_a_name_that_no_file_can_have_is_one_sentence(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """A name that is too long is refused, not raised through."""
    with pytest.raises(RuntimeError, match="choose another") as caught:
        bpy.ops.kiriko.export(filepath=str(tmp_path / ("x" * 300 + ".png")))
    assert "Traceback" not in str(caught.value)


def test_the_suffix_of_an_explicit_path_chooses_the_format(solved: bpy.types.Scene, tmp_path: Path) -> None:
    """With PNG in the panel, source.exr is written as EXR, and a name without suffix as the panel says."""
    solved.kiriko.export_format = "PNG16"
    for name in ("a.exr", "b", "c.tif", "d.png"):
        assert bpy.ops.kiriko.export(filepath=str(tmp_path / name)) == {"FINISHED"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.exr", "b.png", "c.tif", "d.png"]
    assert (tmp_path / "a.exr").read_bytes()[:4] == b"v/1\x01"
