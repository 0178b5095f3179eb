"""Dialogues and previews end with the rig with which they began, whichever is active by then."""

from types import ModuleType, SimpleNamespace

import bpy
import numpy as np

from extension import loaded
from small_rigs import pixels, show_scene
from test_rigs import choose, two

STOPPED = "{} stopped because its scene or rig was switched or deleted: start it again."


class Dialogue:
    """An operator's instance, as Blender keeps it while its dialogue is open."""

    def __init__(self, kiriko: ModuleType, module: str, name: str, **values: object) -> None:
        kind = getattr(loaded(f"operators.{module}"), name)
        self.reports: list[str] = []
        bases = [base for base in kind.__mro__ if base.__module__.startswith(kiriko.__name__)]
        own = {k: v for base in reversed(bases) for k, v in vars(base).items() if k[:2] != "__"}
        stand_in = type(name, (), {**own, **values})
        self.it = stand_in()
        self.it.report = lambda _, text: self.reports.append(text)
        self.it.properties = SimpleNamespace(is_property_set=lambda name: name in values)


def in_window(**more: object) -> SimpleNamespace:
    """The context of a window, whose file browser only notes that it was asked for."""
    names = ("scene", "view_layer", "evaluated_depsgraph_get", "active_object")
    manager = SimpleNamespace(fileselect_add=lambda _: None, invoke_confirm=None)
    of_scene = {name: getattr(bpy.context, name) for name in names}
    return SimpleNamespace(**{**of_scene, "window_manager": manager, "window": object(), **more})


def solved() -> tuple[bpy.types.Collection, bpy.types.Collection]:
    rigs = two()
    for rig in rigs:
        choose(rig)
        bpy.ops.kiriko.solve()
    return rigs


def test_export_writes_the_image_of_its_own_rig(kiriko, scene, tmp_path, monkeypatch):
    """The other rig was selected while the dialogue was open. A rig that is gone is told."""
    first, second = solved()
    choose(first)
    export = loaded("operators.export")
    written = []
    monkeypatch.setattr(
        export.image_io, "write", lambda path, image, *_, **__: written.append(image) or path
    )
    values = {"filepath": "", "overwrite": False, "allow_stale": True, "choose": True}
    dialogue = Dialogue(kiriko, "export", "KIRIKO_OT_export", **values)
    dialogue.it.invoke(in_window(), None)
    dialogue.it.filepath = str(tmp_path / "source.png")
    choose(second)
    assert dialogue.it.execute(in_window()) == {"FINISHED"}
    assert scene.kiriko == first.kiriko
    own = pixels(scene.kiriko.result.source)[..., :3]
    assert np.array_equal(written[0], own)

    again = Dialogue(kiriko, "export", "KIRIKO_OT_export", **values)
    again.it.invoke(in_window(), None)
    bpy.ops.kiriko.remove_rig()
    assert again.it.execute(in_window()) == {"CANCELLED"}
    assert again.reports == [STOPPED.format("Export Source Image")]


def test_a_preview_is_kept_with_its_own_rig(kiriko, scene):
    """Also where the window shows another scene when the render ends."""
    first, second = solved()
    choose(first)
    values = {
        "samples": 1, "percentage": 100, "border": (0, 1, 0, 1), "reflections": False,
        "surroundings": False, "filepath": "", "overwrite": False,
    }  # fmt: skip
    preview = Dialogue(kiriko, "preview", "KIRIKO_OT_preview", **values).it
    made = preview._prepare(in_window())
    made.render()
    choose(second)
    show_scene(bpy.data.scenes.new("Other"))
    preview._finish(made)
    made.close()
    assert bpy.context.scene.kiriko.result.preview is None
    assert scene.kiriko == first.kiriko
    assert scene.kiriko.result.preview.name == "Kiriko Preview"
    assert second.kiriko.result.preview is None


def test_a_picture_is_opened_for_its_own_rig(kiriko, scene, tmp_path):
    """And a drawing is refused where another scene is shown by then."""
    first, second = two()
    choose(first)
    image = bpy.data.images.new("sea", 4, 4)
    image.filepath_raw, image.file_format = str(tmp_path / "sea.png"), "PNG"
    image.save()
    dialogue = Dialogue(
        kiriko, "choose_picture", "KIRIKO_OT_open_picture", filepath="", files=[], fit=False
    )
    bpy.context.view_layer.objects.active = None
    dialogue.it.invoke(in_window(), None)
    dialogue.it.filepath = str(tmp_path / "sea.png")
    choose(second)
    plane = next(thing for thing in second.objects if thing.kiriko.role == "PICTURE")
    bpy.context.view_layer.objects.active = plane
    assert dialogue.it.execute(in_window()) == {"FINISHED"}
    for rig, name in ((first, "sea"), (second, "Kiriko Lattice.001")):
        plane = next(thing for thing in rig.objects if thing.kiriko.role == "PICTURE")
        nodes = plane.active_material.node_tree.nodes
        assert [n.image.name for n in nodes if n.type == "TEX_IMAGE"] == [name]

    drawing = Dialogue(kiriko, "bench_drawing", "KIRIKO_OT_bench_drawing", filepath="", paper="A4")
    drawing.it.invoke(in_window(), None)
    other = bpy.data.scenes.new("Other")
    assert drawing.it.execute(in_window(scene=other)) == {"CANCELLED"}
    assert drawing.reports == [STOPPED.format("Bench Drawing")]
