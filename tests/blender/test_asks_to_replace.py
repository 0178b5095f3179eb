"""Before files are replaced, a window asks; a script passes `overwrite`."""

from types import SimpleNamespace

import bpy
import pytest

from extension import loaded
from small_rigs import small_rig


class Pressed:
    """A button in a window, with its reports and the questions of its dialogue."""

    def __init__(self, module: str, name: str, **values: object) -> None:
        kind = getattr(loaded(f"operators.{module}"), f"KIRIKO_OT_{name}")
        own: dict[str, object] = {}
        for base in reversed(kind.__mro__[:-1]):
            own |= {k: v for k, v in vars(base).items() if k[:2] != "__"}
        self.reports: list[str] = []
        self.questions: list[dict[str, object]] = []
        own |= {"overwrite": False, "bl_rna": None, **values}
        self.it = type(kind.__name__, (), own)()
        self.it.report = lambda _, text: self.reports.append(text)

    def invoke(self) -> set[str]:
        manager = SimpleNamespace(invoke_confirm=self.ask)
        return self.it.invoke(
            SimpleNamespace(
                scene=bpy.context.scene,
                view_layer=bpy.context.view_layer,
                evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
                active_object=None,
                window=object(),
                window_manager=manager,
            ),
            None,
        )

    def ask(self, *_: object, **question: object) -> set[str]:
        self.questions.append(question)
        return {"RUNNING_MODAL"}


@pytest.fixture
def in_window(kiriko, monkeypatch):
    """Dialogues appear."""
    monkeypatch.setattr(loaded("operators.long_work"), "has_window", lambda _: True)


def test_a_report_asks(scene, tmp_path, in_window):
    """Once for all of its files that exist."""
    small_rig()
    for name in ("report.svg", "report.csv", "mine.txt"):
        (tmp_path / name).write_text("mine")
    pressed = Pressed("report", "report", directory="", seconds=0.0)
    scene.kiriko.report_folder = str(tmp_path)
    assert pressed.invoke() == {"RUNNING_MODAL"}
    (question,) = pressed.questions
    assert question["message"] == f"{tmp_path / 'report.csv'}, report.svg"
    assert pressed.reports == []


def test_a_movie_asks_and_is_replaced_after_a_yes(scene, tmp_path, kiriko, monkeypatch):
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    scene.frame_start = scene.frame_end = 1
    scene.kiriko.movie_path, scene.kiriko.movie_codec = "//film", "FFV1"
    film = tmp_path / "film.mkv"
    film.write_text("mine")
    pressed = Pressed("frames", "export_movie", frames="1")
    with monkeypatch.context() as patch:
        patch.setattr(loaded("operators.long_work"), "has_window", lambda _: True)
        assert pressed.invoke() == {"RUNNING_MODAL"}
    assert pressed.questions[0]["message"] == str(film)
    assert film.read_text() == "mine"
    assert pressed.it.execute(bpy.context) == {"FINISHED"}
    assert film.stat().st_size > 100

    with pytest.raises(RuntimeError, match="choose another or pass overwrite=True"):
        bpy.ops.kiriko.export_movie(frames="1")


@pytest.mark.parametrize(
    ("module", "name", "values"),
    [
        ("frames", "export_movie", {"frames": ""}),
        ("report", "report", {"directory": "", "seconds": 0.0}),
    ],
)
def test_an_unsaved_file_is_one_sentence(scene, in_window, module, name, values):
    """Its relative path has no folder."""
    small_rig()
    pressed = Pressed(module, name, **values)
    assert pressed.invoke() == {"CANCELLED"}
    assert len(pressed.reports) == 1
    assert "never saved" in pressed.reports[0]


def test_dialogues_of_folders_pass_their_answer_on(kiriko):
    """Overwrite is each operator's own, not the rig's."""
    assert "export_overwrite" not in bpy.context.scene.kiriko.bl_rna.properties
    for module, name in (("export_maps", "export_maps"), ("export_atlas", "export_atlas")):
        assert (
            "overwrite" in getattr(loaded(f"operators.{module}"), f"KIRIKO_OT_{name}").in_dialogue
        )
