"""The manual's button in a checkout; tests/package has it in an installed zip."""

from types import ModuleType

import bpy
import pytest

from extension import loaded


@pytest.fixture
def opening(kiriko) -> ModuleType:
    """The module of the button."""
    return loaded("operators.open_manual")


def test_without_a_manual_the_button_is_grey(opening, monkeypatch, tmp_path):
    """It says why, and F1 finds no place of ours."""
    monkeypatch.setattr(opening, "FOLDER", tmp_path / "manual")
    with pytest.raises(RuntimeError, match="install Kiriko from its zip"):
        bpy.ops.kiriko.open_manual()
    prefix, places = opening.places()
    assert prefix.startswith("file://")
    assert places == []


def test_names_of_folders_may_have_any_letter(opening, monkeypatch, tmp_path):
    """Spaces, signs of URLs and other scripts are written as URLs write them."""
    folder = tmp_path / "ガラス 50 % #1" / "manual"
    (folder / "at").mkdir(parents=True)
    (folder / "at" / "bpy.ops.kiriko.solve.html").touch()
    monkeypatch.setattr(opening, "FOLDER", folder)
    prefix, places = opening.places()
    assert prefix.endswith("50%20%25%20%231/manual/at/")
    assert places == [("bpy.ops.kiriko.solve", "bpy.ops.kiriko.solve.html")]


def test_disabling_takes_the_lookup_back(opening):
    """Blender does not ask an extension that is gone."""
    hooks = bpy.utils._manual_map
    assert hooks.count(opening.places) == 1
    opening.unregister()
    assert opening.places not in hooks
    opening.register()
