"""The command line finds the scene that has the rig, and files where Blender would."""

import json
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from small_rigs import new_object, primitive, show_scene, small_rig

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
def test_the_only_scene_that_has_a_rig_is_taken(
    scene: bpy.types.Scene,
    run: Run,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    verb: tuple[str, ...],
) -> None:
    """Whichever scene was shown as the file was saved; a line says so."""
    small_rig()
    scene.name = "Bench"
    other_scene("Notes", has_rig=False)
    other_scene("Shelf", has_rig=False)
    saved_and_opened(tmp_path)
    assert bpy.context.scene.name == "Shelf"
    assert run(*verb, "--out", tmp_path / "out") == 0
    assert "kiriko: scene 'Bench'" in capsys.readouterr().out


def test_of_several_scenes_with_a_rig_none_is_guessed(
    scene: bpy.types.Scene, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
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
        "kiriko: The scene 'Notes' has no such rig; there is one in 'Bench', 'Table': choose a"
        " scene by --scene, before --command.\n"
    )
    assert not (tmp_path / "out").exists()
    assert run("solve", "--out", tmp_path / "out", "--rig", name) == 0
    assert "kiriko: scene 'Table'" in capsys.readouterr().out


def test_paths_begin_at_the_file_as_everywhere_in_blender(
    scene: bpy.types.Scene,
    run: Run,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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


@pytest.mark.parametrize("kind", ["turned", "loose", "wine", "closed"])
def test_the_report_has_what_the_checklist_knows_of_the_glass(
    scene: bpy.types.Scene, run: Run, look: Callable[[], list], tmp_path: Path, kind: str
) -> None:
    """Faces that look the other way, loose triangles, wine that is no part of the rig: word for
    word, and nothing of glass that is all right.
    """
    glass = small_rig()["GLASS"]
    ball = primitive("uvsphere", u_segments=32, v_segments=16, radius=0.02)
    ball.polygons.foreach_set("use_smooth", [True] * len(ball.polygons))
    if kind == "turned":
        for face in list(ball.polygons)[::2]:
            face.flip()
    if kind == "loose":
        corners = [vertex.co for vertex in ball.vertices] + [
            (0.03, 0, 0),
            (0.031, 0, 0),
            (0.03, 0.001, 0),
        ]
        faces = [list(face.vertices) for face in ball.polygons]
        n = len(ball.vertices)
        ball = bpy.data.meshes.new("loose")
        ball.from_pydata(corners, [], [*faces, (n, n + 1, n + 2)])
        ball.polygons.foreach_set("use_smooth", [True] * len(ball.polygons))
    if kind == "wine":
        wine = new_object(primitive("cube", size=0.01))
        material = bpy.data.materials.new("wine")
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        shader = tree.nodes.new("ShaderNodeBsdfGlass")
        tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs[0])
        wine.data.materials.append(material)
        wine.name = "Wine"
    if kind != "closed":
        glass.data = ball
    saved_and_opened(tmp_path)
    known = [entry.text for entry in look()]
    words = {"turned": "turned round", "loose": "is not closed: 3 edges", "wine": "'Wine' refracts"}
    assert bool(known) == (kind in words)
    assert all(words[kind] in text for text in known), known
    assert run("solve", "--out", tmp_path / "out") == 0
    notes = json.loads((tmp_path / "out" / "report.json").read_text())["notes"]
    assert set(known) <= set(notes)
    assert bool(notes) == bool(known)
    assert run("solve", "--out", tmp_path / "frames", "--frames", "1") == 0
    (line,) = (tmp_path / "frames" / "frames.jsonl").read_text().splitlines()
    assert set(known) <= set(json.loads(line)["notes"])
