"""Flamenco's job type, by its documented interface; `dev.py farm` runs its tasks."""

import shutil

import pytest

from known.flamenco import compiled, words_of

NODE = shutil.which("node")
SETTINGS = {
    "frames": "1-12",
    "chunk_size": 5,
    "kiriko": "/share/金魚 job/kiriko",
    "output": "/share/a job/out",
    "rig": "",
    "viewers": "",
    "format": "PNG8",
    "overwrite": False,
    "blendfile": "/share/a job/rig.blend",
}

needs_node = pytest.mark.skipif(NODE is None, reason="there is no node on the PATH")


@needs_node
def test_tasks_are_chunks_and_a_join_that_waits_for_them():
    """Each frame is in one task, and the join depends on all."""
    made = compiled(NODE, **SETTINGS)
    assert made["error"] is None
    *solve, join = made["tasks"]
    assert [task["name"] for task in solve] == ["solve-1-5", "solve-6-10", "solve-11-12"]
    assert join["dependencies"] == [task["name"] for task in solve]
    assert {task["type"] for task in made["tasks"]} == {"blender"}

    words = words_of(solve[1], "blender")
    assert words[:5] == ["blender", "-b", "-y", "--factory-startup", SETTINGS["blendfile"]]
    assert words[words.index("--python") + 1] == f"{SETTINGS['kiriko']}/kiriko_bootstrap.py"
    kiriko = words[words.index("--") + 1 :]
    assert kiriko[:3] == ["solve", "--frames=6-10", "--log=6-10"]
    assert kiriko[-2:] == ["--out", SETTINGS["output"]]
    assert "--overwrite" not in kiriko
    assert words_of(join, "blender")[-6:-4] == ["join", "--frames=1-12"]


@needs_node
def test_settings_are_those_that_the_tasks_use():
    """Flamenco's panel shows each setting once, and each has the kind that Flamenco knows; rig and
    overwrite come into the tasks.
    """
    made = compiled(NODE, **{**SETTINGS, "rig": "Rig 二", "overwrite": True})
    settings = {one["key"]: one for one in made["type"]["settings"]}
    assert settings.keys() == SETTINGS.keys()
    assert {one["type"] for one in settings.values()} <= {"string", "int32", "bool", "float"}
    words = words_of(made["tasks"][0], "blender")
    assert "--rig=Rig 二" in words
    assert "--overwrite" in words


@needs_node
def test_each_viewer_has_tasks_and_a_folder_of_its_own():
    """Also where names differ in capitals or in what no folder can have; the join sees them all."""
    wanted = "Left 眼, left 眼,-a/b,-a:b"
    made = compiled(NODE, **{**SETTINGS, "viewers": wanted, "chunk_size": 12})
    assert made["error"] is None
    *solve, join = made["tasks"]
    assert join["dependencies"] == [task["name"] for task in solve]
    assert len(set(join["dependencies"])) == 4
    words = [words_of(task, "blender") for task in solve]
    for name, of_task in zip(wanted.split(","), words, strict=True):
        assert f"--only-viewer={name.strip()}" in of_task
    folders = [of_task[-1].removeprefix(f"{SETTINGS['output']}/") for of_task in words]
    assert len({folder.lower() for folder in folders}) == 4
    assert not any(set('/\\:*?"<>|') & set(folder) or folder[0] == "-" for folder in folders)
    joined = words_of(join, "blender")
    at = joined.index("--folders")
    assert joined[at + 1 : at + 5] == folders
    assert joined[-1] == SETTINGS["output"]


@needs_node
@pytest.mark.parametrize(
    ("change", "said"),
    [({"kiriko": " "}, "'kiriko' is empty"), ({"chunk_size": 0}, "no frames")],
)
def test_bad_settings_are_refused(change, said):
    """With a sentence, before any task is made."""
    made = compiled(NODE, **{**SETTINGS, **change})
    assert said in made["error"]
    assert made["tasks"] == []
