"""The command line finds the scene that has the rig, and files where Blender would."""

from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from small_rigs import show_scene, small_rig

Run = Callable[..., int]


def other_scene(name: str, has_rig: bool) -> bpy.types.Scene:
    """A further scene, with a small rig or none; it is shown."""
    scene = bpy.data.scenes.new(name)
    show_scene(scene)
    if has_rig:
        small_rig()
    return scene


def saved_and_opened(tmp_path: Path) -> None:
    """The file as the command line opens it."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))


@pytest.mark.parametrize("verb", [("solve",), ("solve", "--rig", "all"), ("maps",)])
def test_the_only_scene_that_has_a_rig_is_taken(scene, run, tmp_path, capsys, verb):
    """Whichever scene was shown as the file was saved; a line says so."""
    small_rig()
    scene.name = "Bench"
    other_scene("Notes", has_rig=False)
    other_scene("Shelf", has_rig=False)
    saved_and_opened(tmp_path)
    assert bpy.context.scene.name == "Shelf"
    assert run(*verb, "--out", tmp_path / "out") == 0
    assert "kiriko: scene 'Bench'" in capsys.readouterr().out


def test_of_several_scenes_with_a_rig_none_is_guessed(scene, run, tmp_path, capsys):
    """They are named, and so is the one that was looked at; a rig's name tells the scene, too. The
    scene that is shown counts where it has a rig.
    """
    small_rig()
    scene.name = "Bench"
    shown = other_scene("Table", has_rig=True)
    name = next(one.name for one in shown.collection.children)
    saved_and_opened(tmp_path)
    assert run("solve", "--out", tmp_path / "shown") == 0
    assert "scene 'Table'" not in capsys.readouterr().out
    other_scene("Notes", has_rig=False)
    saved_and_opened(tmp_path)
    assert run("solve", "--out", tmp_path / "out") == 1
    assert capsys.readouterr().err == (
        "kiriko: The scene 'Notes' has no such rig, but there is one in 'Bench', 'Table': choose a"
        " scene with --scene, before --command.\n"
    )
    assert not (tmp_path / "out").exists()
    assert run("solve", "--out", tmp_path / "out", "--rig", name) == 0
    assert "kiriko: scene 'Table'" in capsys.readouterr().out


def test_paths_begin_at_the_file_as_everywhere_in_blender(
    scene, run, tmp_path, capsys, monkeypatch
):
    """Results, photographs, pictures and zips with // are beside the .blend, wherever the command
    runs; others are where it runs.
    """
    small_rig()
    folder = tmp_path / "project"
    folder.mkdir()
    saved_and_opened(folder)
    monkeypatch.chdir(tmp_path)
    assert run("solve", "--out", "//results/first") == 0
    assert (folder / "results" / "first" / "report.json").is_file()
    assert run("solve", "--out", "here") == 0
    assert (tmp_path / "here" / "report.json").is_file()
    names = "//results/first/source.png", "//results/first/seen.png"
    assert run("solve", "--out", "//second", "--pictures", names[1]) == 0
    assert (folder / "second").is_dir()
    assert run("solve", "--out", "//frames", "--frames", "7", "--name", "at_##") == 0
    assert (folder / "frames" / "at_07.png").is_file()
    capsys.readouterr()
    for asked in (
        ("calibrate", "--measured", "//no.png"),
        ("job", "--zip", "//no.zip", "--frames", "1-2"),
    ):
        assert run(*asked, "--out", "//third") == 1
        assert str(folder / asked[2][2:]) in capsys.readouterr().err
