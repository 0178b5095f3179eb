"""The panels, drawn on a layout that checks what it is given and keeps it."""

import importlib
import json
from collections.abc import Callable
from types import FunctionType, ModuleType, SimpleNamespace

import bpy
import pytest
from small_rigs import small_rig

OWN = {
    "IDEAL": [],
    "CROSSED": ["pitch", "height", "ior", "reflectance", "crossing_error", "fresnel", "phase"],
    "HOLES": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
    "RADIAL": ["pitch", "height", "ior", "reflectance", "fresnel", "phase"],
}
ICONS = {item.identifier for item in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items}


class Layout:
    """Takes what a panel draws: properties have to be there, and operators, with the properties of theirs."""

    def __init__(self) -> None:
        self.props: list[str] = []
        self.texts: list[str] = []
        self.operators: list[str] = []

    def box(self, **options: object) -> "Layout":
        return self

    row = column = box

    def prop(self, data: bpy.types.bpy_struct, name: str, **options: object) -> None:
        assert name in data.bl_rna.properties
        self.props.append(name)

    def template_ID(self, data: bpy.types.bpy_struct, name: str, **options: object) -> None:  # noqa: N802, Blender's
        self.prop(data, name)

    def operator(self, name: str, icon: str = "NONE", **options: object) -> None:
        group, verb = name.split(".")
        getattr(getattr(bpy.ops, group), verb).get_rna_type()  # KeyError where there is none
        assert icon in ICONS
        self.operators.append(name)

    def operator_menu_enum(self, name: str, prop: str, icon: str = "NONE", **options: object) -> None:
        self.operator(name, icon)
        group, verb = name.split(".")
        assert getattr(getattr(bpy.ops, group), verb).get_rna_type().properties[prop].type == "ENUM"

    def label(self, text: str = "", icon: str = "NONE") -> None:
        assert icon in ICONS
        self.texts.append(text)

    def progress(self, factor: float, text: str) -> None:
        assert 0 <= factor <= 1
        self.texts.append(text)

    def template_icon(self, icon: int, scale: float) -> None:
        assert isinstance(icon, int)  # 0 without a window


@pytest.fixture
def drawn(kiriko: ModuleType, scene: bpy.types.Scene) -> Callable[..., Layout]:
    """Draws a panel by its module and name; returns what it drew."""

    def draw(module: str, name: str, active: bpy.types.Object | None = None) -> Layout:
        panel = getattr(importlib.import_module(f"{kiriko.__name__}.panels.{module}"), name)
        functions = {name: thing for name, thing in vars(panel).items() if isinstance(thing, FunctionType)}
        stand_in = type("Panel", (), functions)()
        stand_in.layout = Layout()
        # without a window there is neither a region nor a scale
        wide, system = SimpleNamespace(width=300), SimpleNamespace(ui_scale=1.0)
        preferences = SimpleNamespace(system=system)
        stand_in.draw(SimpleNamespace(scene=scene, active_object=active, preferences=preferences, region=wide))
        return stand_in.layout

    return draw


@pytest.mark.parametrize("model", OWN)
def test_a_plate_shows_the_settings_of_its_model(drawn: Callable[..., Layout], model: str) -> None:
    """An ideal plate has none but the model; only crossed layers can be crossed wrong."""
    plate = small_rig()["PLATE"]
    plate.kiriko.plate.model = model
    shown = drawn("rig", "VIEW3D_PT_kiriko_rig", plate)
    assert shown.props == ["role", "model", *OWN[model], "viewer", "picture_source"]
    assert "kiriko.plate_preset" in shown.operators
    assert f"Plate: {plate.name}" in shown.texts


def test_other_roles_show_nothing_of_a_plate(drawn: Callable[..., Layout]) -> None:
    """Glass, display and picture have settings of their own, and no preset."""
    parts = small_rig()
    for role, own in {"GLASS": "priority", "DISPLAY": "resolution", "PICTURE": "image"}.items():
        shown = drawn("rig", "VIEW3D_PT_kiriko_rig", parts[role])
        assert own in shown.props
        assert "model" not in shown.props
        assert "kiriko.plate_preset" not in shown.operators


def test_a_rig_in_the_making_says_what_it_lacks(drawn: Callable[..., Layout]) -> None:
    """Without any object each part that is needed is named."""
    text = " ".join(drawn("rig", "VIEW3D_PT_kiriko_rig").texts)
    for word in ("No glass", "No plate", "No display", "No picture", "No viewer"):
        assert word in text


def test_the_result_tells_brightness_and_blur_of_mirrors(drawn: Callable[..., Layout], scene: bpy.types.Scene) -> None:
    """The numbers of the solve in one sentence, with their standard errors; nothing of it with an ideal plate."""
    assert drawn("result", "VIEW3D_PT_kiriko_result").texts == ["Not solved yet."]
    plate = small_rig()["PLATE"].kiriko.plate
    bpy.ops.kiriko.solve()
    assert "Plate:" not in " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)
    plate.model = "CROSSED"
    bpy.ops.kiriko.solve()
    found = json.loads(scene.kiriko.result.details)["plate"]
    assert 0 < found["least"] < found["brightness"] < found["most"] < 1
    text = " ".join(drawn("result", "VIEW3D_PT_kiriko_result").texts)
    assert scene.kiriko.result.summary in text
    assert (
        f"Plate: {100 * found['brightness']:.1f}% (+- {100 * found['brightness_error']:.1f}%) of the light,"
        f" {100 * found['least']:.0f}% to {100 * found['most']:.0f}%;"
        f" blur {found['blur']:.2g} (+- {found['blur_error']:.1g}) viewer px"
    ) in text
    assert "Rays: " in " ".join(drawn("result", "VIEW3D_PT_kiriko_details").texts)


def test_a_blur_that_is_not_known_is_not_told(kiriko: ModuleType) -> None:
    """Brightness alone; and a blur of nothing has no standard error."""
    words = importlib.import_module(f"{kiriko.__name__}.panels.result").plate_words
    found = {"brightness": 0.5, "brightness_error": 0.01, "least": 0.25, "most": 0.75, "blur": None, "blur_error": None}
    assert words(found) == "Plate: 50.0% (+- 1.0%) of the light, 25% to 75%"
    assert words({**found, "blur": 0.0}).endswith("; blur 0 (+- 0) viewer px")
