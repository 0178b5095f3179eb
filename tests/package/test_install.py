import json
import os
import sys
from pathlib import Path

import addon_utils
import bpy
import numpy as np
import pytest


@pytest.fixture
def rig(installed, tmp_path) -> Path:
    """A saved file with the rig that one button makes, seen with few pixels, and roughly."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kiriko.add_rig(viewer_resolution=96, display_resolution=(96, 96))
    bpy.context.scene.kiriko.tolerance = 1.0
    path = tmp_path / "rig.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def brightness(image: bpy.types.Image) -> np.ndarray:
    """Sum of red, green and blue of each pixel."""
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(-1, image.channels)[:, :3].sum(axis=1)


def test_installed_extension_breaks_no_policy(installed):
    """Blender has no complaint about the installed extension."""
    assert addon_utils._extensions_warnings_get() == {}


def solve() -> list[str]:
    """Press Solve, look at the source image, which is not black, and return the engine used."""
    before = set(bpy.data.images)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    (source,) = set(bpy.data.images) - before
    assert np.isfinite(brightness(source)).all()
    assert (brightness(source) > 0).mean() > 0.01  # the picture fills a good part of the display
    return json.loads(bpy.context.scene.kiriko.result.details)["used"]


def scale_glass(factor: float) -> None:
    """Give the glass another shape, of which Kiriko keeps nothing."""
    (glass,) = (thing for thing in bpy.context.scene.objects if thing.kiriko.role == "GLASS")
    glass.scale *= factor


def test_solve_from_the_zip(rig, installed):
    """Two clicks after the install there is a source image that
    is not black, traced by the bundled kernel.
    """
    assert "compiled kernel" in solve()
    loading = sys.modules[f"{installed}.core.native.loading"]
    assert loading.find_library().is_relative_to(os.environ["BLENDER_USER_RESOURCES"])


def test_solve_without_the_kernel(rig, monkeypatch):
    """Where it does not run, the bundled embreex is asked."""
    monkeypatch.setenv("KIRIKO_KERNEL", "off")
    scale_glass(0.99)
    assert "ray engine (Embree)" in solve()
    assert Path(sys.modules["embreex"].__file__).is_relative_to(
        os.environ["BLENDER_USER_RESOURCES"]
    )


def test_solve_without_wheels(rig, monkeypatch):
    """With neither of both a source image is made as well."""
    monkeypatch.setenv("KIRIKO_KERNEL", "off")
    monkeypatch.setitem(sys.modules, "embreex", None)
    scale_glass(0.98)
    assert "ray engine (Blender's BVH)" in solve()


def test_command_line(rig, commands, tmp_path):
    """`blender --background rig.blend --command kiriko solve
    --out DIR` writes files and ends with exit code 0.
    """
    out = tmp_path / "out"
    assert commands["kiriko"](["solve", "--out", str(out)]) == 0
    assert [path for path in out.iterdir() if path.stat().st_size > 0]


def test_command_line_without_a_file(installed, commands, tmp_path, capfd):
    """Without a .blend, as when the named one is missing, the
    command fails with one sentence on stderr.
    """
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert commands["kiriko"](["solve", "--out", str(tmp_path / "out")]) != 0
    assert len(capfd.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_plate_material_from_the_zip(installed):
    """The zip brings the plate's materials along."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert bpy.ops.kiriko.add_plate_material() == {"FINISHED"}
    assert bpy.context.object.active_material.name == "Kiriko Plate"
