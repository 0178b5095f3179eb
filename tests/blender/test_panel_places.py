"""What people see first: few buttons and fields, and main buttons that never move."""

from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace

import bpy
import pytest

from extension import loaded
from panel_layout import Layout, Place
from small_rigs import cube, new_object, primitive, small_rig

pytestmark = pytest.mark.every_blender

MAIN = ["kiriko.solve", "kiriko.live", "kiriko.look_through", "kiriko.open_picture"]
MOST_BUTTONS, MOST_FIELDS = 10, 8
HEADER, HEIGHT = 28.0, 860.0  # px: a panel's head, and all panels


def open_panels() -> list[type]:
    """The panels of the tab that are open at first, from the top down."""
    found: list[type] = []
    for cls in loaded("panels").CLASSES:
        is_there = getattr(cls, "poll", lambda context: True)
        if getattr(cls, "bl_category", "") != "Kiriko" or not is_there(bpy.context):
            continue
        parent = getattr(cls, "bl_parent_id", "")
        is_shown = not parent or parent in [one.__name__ for one in found]
        if is_shown and "DEFAULT_CLOSED" not in getattr(cls, "bl_options", ()):
            found.append(cls)
    return found


def closed_panels() -> list[str]:
    """The panels of which only the head is shown at first."""
    return [
        cls.bl_label
        for cls in loaded("panels").CLASSES
        if getattr(cls, "bl_category", "") == "Kiriko"
        and "DEFAULT_CLOSED" in getattr(cls, "bl_options", ())
        and not hasattr(cls, "bl_parent_id")
    ]


def draw_header(panel: type, layout: Layout) -> None:
    """Draw the icons in a panel's head."""
    if hasattr(panel, "draw_header_preset"):
        panel.draw_header_preset(SimpleNamespace(layout=layout), bpy.context)


@pytest.mark.parametrize("kind", ["IN_GLASS", "BEHIND_GLASS"])
def test_add_rig_shows_few_buttons(drawn: Callable[..., Layout], kind: str) -> None:
    """At most ten buttons and eight fields, those in the heads too; all within 860 px, with
    two things to do.
    """
    cube().scale = (40, 40, 40)
    bpy.ops.kiriko.add_rig(kind=kind, viewer_resolution=64, display_resolution=(64, 64))
    shown = open_panels()
    assert [one.bl_label for one in shown] == ["Kiriko", "Result", "Rig", "Export"]

    to_do = [
        button.operator
        for entry in loaded("operators.look_over").look_now(bpy.context)
        for button in entry.buttons
    ]
    buttons, fields, height = [], [], HEADER * (len(shown) + len(closed_panels()))
    for panel in shown:
        layout = drawn(panel.__module__.rpartition(".")[2], panel.__name__, bpy.context.object)
        height += max(place.top + place.height for place in layout.places())
        draw_header(panel, layout)
        buttons += layout.buttons
        fields += layout.fields
    for button in to_do:  # the checklist has its own
        buttons.remove(button)
    assert len(buttons) <= MOST_BUTTONS, buttons
    assert len(fields) <= MOST_FIELDS, fields
    assert len(to_do) >= 2
    assert height <= HEIGHT
    assert buttons.count("kiriko.export") == 1


def test_what_few_people_need_is_closed(scene: bpy.types.Scene) -> None:
    """These heads alone are shown, in this order."""
    small_rig()
    names = ["Check", "Viewers", "More Exports", "Calibration", "Advanced"]
    assert closed_panels() == names


def steady(layout: Layout) -> list[Place]:
    """The places from the top down to the line of the state."""
    found = list(layout.places())
    last = next(n for n, place in enumerate(found) if place.name == MAIN[-1])
    state = found[last + 1]
    return [*found[: last + 1], Place("state", state.top, state.height)]


def entries(layout: Layout) -> list[Place]:
    """The places of the checklist's buttons."""
    last = next(n for n, p in enumerate(list(layout.places())) if p.name == MAIN[-1])
    return [p for p in list(layout.places())[last + 2 :] if p.name.startswith("kiriko.")]


def changes(scene: bpy.types.Scene) -> Iterator[str]:
    """Change what the checklist and Result have to say, step by step."""
    thing = cube()
    thing.scale = (40, 40, 40)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    parts = {one.kiriko.role: one for one in scene.objects}
    yield "new"
    bpy.ops.kiriko.make_glass(part=thing.name)
    yield "made glass"
    bpy.ops.kiriko.rescale_scene(factor=0.001)
    yield "smaller"
    parts["DISPLAY"].hide_viewport = parts["DISPLAY"].hide_render = True
    yield "without a display"
    parts["DISPLAY"].hide_viewport = parts["DISPLAY"].hide_render = False
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    yield "in edit mode"
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.kiriko.solve()
    yield "solved"
    scene.kiriko.result.is_coarse = True
    yield "coarse"
    new_object(primitive("cube", size=0.01), "PICTURE")
    yield "with two pictures"


def test_no_change_of_the_checklist_moves_a_main_button(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """The checklist, the state and a result leave all buttons above them where they are."""
    main = ("main_panel", "VIEW3D_PT_kiriko_main")
    places, lists = {}, set()
    for name in changes(scene):
        layout = drawn(*main)
        places[name] = steady(layout)
        lists.add((*(place.name for place in layout.places()),))
    assert len(lists) >= 6  # they are different
    assert len({(*found,) for found in places.values()}) == 1, places
    assert [place.name for place in places["new"]] == [*MAIN, "state"]


LIVE = {
    "reading": {"phrase": "reading the scene"},
    "solving": {"phrase": "solving", "progress": 0.4},
    "done": {},
    "trouble": {"problem": "No ray reaches the plate: turn the plate, or the viewer, or both."},
}


@pytest.mark.parametrize("state", [*LIVE, "off", "stopped", "other scene", "at work"])
def test_no_state_of_live_moves_a_button(
    drawn: Callable[..., Layout],
    kiriko: ModuleType,
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
    state: str,
) -> None:
    """Neither the main buttons nor those of the checklist; work shows its progress in one row."""
    main = ("main_panel", "VIEW3D_PT_kiriko_main")
    live, work = loaded("operators.live"), loaded("operators.work")
    small_rig()["GLASS"].kiriko.use_ior = False
    before = drawn(*main)
    assert "kiriko.make_glass" in before.operators
    if state == "stopped":
        live.stop("Live stopped: a file was loaded.")
    elif state == "other scene":
        live.start(bpy.data.scenes.new("other"))
    elif state == "at work":
        operator = SimpleNamespace(bl_label="Solve", progress=0.38)
        monkeypatch.setattr(work, "_running", [operator])
    elif state != "off":
        followed = live.start(scene)
        for name, value in LIVE[state].items():
            setattr(followed, name, value)
    try:
        after = drawn(*main)
    finally:
        live.stop()
    assert steady(after) == steady(before)
    assert entries(after) == entries(before)
    shown = [place.name for place in after.places()]
    assert ("progress" in shown) == (state in {"solving", "at work"})
    if state == "at work":
        assert "Solve 38 % (Esc stops)" in after.texts
    if state == "reading":
        assert any("reading the scene" in text for text in after.texts)


def test_the_picture_button_names_the_picture(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """Add Rig's own lattice is no choice; any other image is."""
    main = ("main_panel", "VIEW3D_PT_kiriko_main")
    cube()
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    assert "Choose Your Picture" in drawn(*main).labels
    bpy.data.images.new("lighthouse.png", 8, 8)
    bpy.ops.kiriko.choose_picture(image="lighthouse.png")
    assert "lighthouse.png" in drawn(*main).labels
    assert "Choose Your Picture" not in drawn(*main).labels


def test_a_product_in_the_list_is_that_of_its_line(
    drawn: Callable[..., Layout], scene: bpy.types.Scene
) -> None:
    """Its menu works whatever is active."""
    parts = small_rig()
    bpy.context.view_layer.objects.active = parts["GLASS"]
    shown = drawn("rig_panel", "VIEW3D_PT_kiriko_rig", parts["GLASS"])
    assert shown.operators.count("kiriko.select_part") == 5
    assert shown.fields.count("kiriko.display_preset") == 1
    bpy.ops.kiriko.display_preset(part=parts["DISPLAY"].name, preset="iPhone 15")
    assert "iPhone 15" in drawn("rig_panel", "VIEW3D_PT_kiriko_rig", parts["GLASS"]).labels
    assert bpy.ops.kiriko.plate_preset.poll()  # the rig's only one
    assert bpy.ops.kiriko.plate_preset(preset="ASKA3D-200") == {"FINISHED"}
    with pytest.raises(RuntimeError, match="Select an object with the role display"):
        bpy.ops.kiriko.display_preset(part=parts["GLASS"].name, preset="iPhone 15")
