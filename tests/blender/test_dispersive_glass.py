"""Glass with dispersion in a scene: solved in its colours, reported, and exported."""

import bpy
import pytest

from extension import loaded
from small_rigs import primitive, small_rig

pytestmark = pytest.mark.usefixtures("no_remedies")


@pytest.fixture
def rig(scene):
    parts = small_rig()
    mesh = primitive("uvsphere", u_segments=16, v_segments=8, radius=0.025)
    mesh.shade_smooth()
    parts["GLASS"].data = mesh
    return parts


def numbers_of(scene):
    records = loaded("core.blender.data.stored_records")
    return records.StoredNumbers.read(scene.kiriko.result.details).by_name


def test_a_result_tells_its_lateral_colour(rig, scene):
    """Strong dispersion: a map for each colour, and the distances before and after; none: no word
    of it.
    """
    bpy.ops.kiriko.solve()
    assert numbers_of(scene)["colour"] is None
    assert "colour" not in scene.kiriko.result.notes
    rig["GLASS"].kiriko.dispersion = "N-SF11"
    bpy.ops.kiriko.solve()
    found = numbers_of(scene)
    assert "Each colour has a map of its own" in scene.kiriko.result.notes
    assert "a map for each colour" in found["used"]
    before, after = found["colour"]["before"], found["colour"]["after"]
    assert before["mean_px"] > 10 * after["mean_px"]


def test_an_abbe_number_of_zero_is_refused_in_one_sentence(rig, scene):
    """So is a primary outside a catalogued formula."""
    rig["GLASS"].kiriko.dispersion, rig["GLASS"].kiriko.abbe = "ABBE", 0.0
    with pytest.raises(RuntimeError, match="Abbe Number 0: set it above 0"):
        bpy.ops.kiriko.solve()
    rig["GLASS"].kiriko.dispersion = "Acrylic"
    display = rig["DISPLAY"].kiriko.display
    display.primaries, display.wavelengths = "CUSTOM", (611, 549, 400)
    with pytest.raises(RuntimeError, match="wavelength of 400 nm is outside"):
        bpy.ops.kiriko.solve()


def test_an_exported_file_has_the_encoding_of_its_display(rig, scene, tmp_path):
    """Display P3, in PNG's cICP chunk."""
    bpy.ops.kiriko.solve()
    rig["DISPLAY"].kiriko.display.encoding = "P3"
    assert bpy.ops.kiriko.export(filepath=str(tmp_path / "source.png")) == {"FINISHED"}
    assert b"cICP\x0c\x0d\x00\x01" in (tmp_path / "source.png").read_bytes()
